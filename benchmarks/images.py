"""What pictures tell of reflectance: errors of materials found in one picture of a sphere, or in distant lights.

python benchmarks/images.py FOLDER HALL.hdr VENICE.hdr MATERIAL...

FOLDER holds measured files, NAME.binary or NAME.bsdf; two environment maps. Pictures of 64 x 64 pixels are rendered
from the measured table by Mitsuba under one map, with 1 % of noise; the material is left out of the prior. What is
found is compared with the table, and with the table's picture under the other map.

dirs: RMS of ln((model + 1e-3) / (f + 1e-3)) over pairs of directions below 80 degrees; cells: that of `dsbrdf.fit`,
over all cells with 1e-6; inner: the same over the cells whose directions are both below 80 degrees; relit: relative
RMS of the picture under the other map; dE: its mean CIEDE2000; in: share of ln f within the 95 % band; rms: of the
residuals; worth: independent pixels; decided: numbers. Half a minute a material, most of it for the truth.
"""

from __future__ import annotations

import argparse
import time
import warnings
from functools import cache
from pathlib import Path

import numpy as np

import dsbrdf
from dsbrdf import images, library
from dsbrdf.fitting import metrics
from dsbrdf.geometry import half_diff
from dsbrdf.images import fit as image_fit
from dsbrdf.images import linear
from dsbrdf.images.view import Camera, points

SIZE, SPP, BATCHES = 64, 256, 12
NOISE = 0.01
N_PAIRS = 20_000
DISTANT = (1, 3, 10)
#: Widths of the facets of Lambert + GGX.
ALPHAS = np.geomspace(0.01, 1.0, 36)


def truth(measured, envmap):
    """Radiance (height, width, 3) of a sphere with a table under a map, by Mitsuba."""
    import mitsuba as mi

    mi.set_variant("llvm_ad_rgb")
    from dsbrdf import render

    render.register()
    scene = mi.load_dict(
        {
            "type": "scene",
            "integrator": {"type": "direct", "hide_emitters": True, "emitter_samples": 4, "bsdf_samples": 2},
            "sensor": {
                "type": "orthographic",
                "to_world": mi.ScalarTransform4f().look_at(origin=[0, 0, 5], target=[0, 0, 0], up=[0, 1, 0]),
                "film": {
                    "type": "hdrfilm",
                    "width": SIZE,
                    "height": SIZE,
                    "pixel_format": "rgb",
                    "component_format": "float32",
                    "rfilter": {"type": "box"},
                },
            },
            "light": {"type": "envmap", "filename": str(envmap)},
            "object": {"type": "sphere", "bsdf": render.to_dict(measured)},
        }
    )
    return np.mean([np.array(mi.render(scene, spp=SPP, seed=i), float) for i in range(BATCHES)], axis=0)


def noisy(image, seed=0):
    return image * (1.0 + NOISE * np.random.default_rng(seed).standard_normal(image.shape))


def pairs(rng, n, limit=80.0):
    z, phi = rng.uniform(np.cos(np.deg2rad(limit)), 1.0, (2, n)), 2.0 * np.pi * rng.random((2, n))
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(phi), s * np.sin(phi), z], axis=-1)


class Scaled:
    """A model times a factor a channel."""

    def __init__(self, model, factor):
        self.model, self.factor = model, factor

    def eval(self, wi, wo):
        """Values (..., channel)."""
        return self.factor * self.model.eval(wi, wo)


def inner_cells(model, measured, limit=80.0):
    """RMS of ln((model + 1e-6) / (f + 1e-6)) over the cells that pictures show."""
    theta_h, theta_d, phi_d = measured.theta_h, measured.theta_d, measured.phi_d
    which = np.arange(len(phi_d))[metrics.PHI_STEP // 2 :: metrics.PHI_STEP]
    which = which if which.size else np.arange(len(phi_d))
    wi, wo = half_diff.to_directions(theta_h[:, None, None], theta_d[:, None], phi_d[which])
    values = np.moveaxis(measured.planes[..., which] * measured.scale[:, None, None, None], 0, -1)
    seen = (values > 0.0).all(-1) & (np.minimum(wi[..., 2], wo[..., 2]) > np.cos(np.deg2rad(limit)))
    ratio = (model.eval(wi[seen], wo[seen]) + metrics.LOG_OFFSET) / (values[seen] + metrics.LOG_OFFSET)
    return np.sqrt((np.log(ratio) ** 2).mean())


def errors(model, measured, picture, relit, posterior=None, *, to_scale=False):
    """dirs, cells, inner, relit, dE and in."""
    from dsbrdf.render import picture as tone
    from dsbrdf.render import quality

    wi, wo = pairs(np.random.default_rng(3), N_PAIRS)
    f = measured.eval(wi, wo)
    some = (f > 0.0).all(1)
    wi, wo, f = wi[some], wo[some], f[some]
    factor = np.ones(3)
    if to_scale:
        for _ in range(6):
            factor = factor * np.exp(np.log((f + 1e-3) / (factor * model.eval(wi, wo) + 1e-3)).mean(0))
        relit = relit * (relit * picture).sum((0, 1)) / (relit**2).sum((0, 1))
    g = factor * model.eval(wi, wo)
    seen = picture.any(-1) & relit.any(-1)
    full = [np.concatenate([image, seen[..., None]], -1) for image in (relit, picture)]
    off = np.log(g / f)[:2000]
    inside = np.nan
    if posterior is not None:
        off -= off.mean(0) if to_scale else 0.0
        inside = (np.abs(off) < 1.96 * posterior.deviation(wi[:2000], wo[:2000])).mean()
    return (
        np.sqrt((np.log((g + 1e-3) / (f + 1e-3)) ** 2).mean()),
        metrics.errors(Scaled(model, factor), measured).log,
        inner_cells(Scaled(model, factor), measured),
        np.sqrt(((relit - picture)[seen] ** 2).sum() / (picture[seen] ** 2).sum()),
        quality.compare(*full, tone.exposure_of(full[1])).mean,
        inside,
    )


@cache
def node_directions():
    """Directions (position, azimuth, 3) toward light and camera of the nodes of `dsbrdf.images.linear`."""
    ln_cos, x = linear.NODES.positions
    theta_h, theta_d = np.arccos(np.exp(ln_cos)), np.arccos(x)
    g = np.maximum(half_diff.azimuthal_factor(theta_h, theta_d), 1e-6)
    phi = 0.5 * np.arccos(np.clip(linear.AZIMUTHS / g[:, None], -1.0, 1.0))
    # Where one of the directions would be below the horizon, the azimuth that is nearest to the other ones
    least = np.arccos(np.clip(0.99 / np.maximum(np.tan(theta_h) * np.tan(theta_d), 0.99), -1.0, 1.0))
    # Pixels up to 80 degrees see no more than 85, and GGX has no end at 90
    theta_d = np.minimum(theta_d, np.deg2rad(86.0))
    return half_diff.to_directions(theta_h[:, None], theta_d[:, None], np.maximum(phi, least[:, None]))


def pixels_of(weights, model):
    """Pixels (pixel, 3) of anything with `eval`, by the weights of its values at nodes."""
    value = model.eval(*node_directions()).reshape(-1, 3)
    return np.stack([w @ value[:, c] for c, w in enumerate(weights)], axis=1)


def lambert_ggx(problem):
    """Lambert + GGX of the pixels of a problem: the best albedo and F0 of each width, and the best width of ALPHAS.

    For a width the picture is linear in albedo and F0, so that a search over two numbers a channel finds them.
    """
    from scipy.optimize import least_squares

    from dsbrdf.baselines.microfacet import LambertGGX

    target = np.arcsinh(0.5 * problem.pixels / problem.offset)
    none, one = np.zeros(3), np.ones(1)
    base = pixels_of(problem.weights, LambertGGX(np.ones(3), none[:, None], one, np.array([0.3])))
    base -= pixels_of(problem.weights, LambertGGX(none, none[:, None], one, np.array([0.3])))
    best = None
    for alpha in ALPHAS:
        width = np.array([alpha])
        grazing = pixels_of(problem.weights, LambertGGX(none, none[:, None], one, width))
        facets = pixels_of(problem.weights, LambertGGX(none, np.ones((3, 1)), one, width)) - grazing
        cost, numbers = 0.0, []
        for c, offset in enumerate(problem.offset):
            parts = np.stack([base[:, c], facets[:, c]], axis=1)

            def residual(z, parts=parts, rest=grazing[:, c], offset=offset, wanted=target[:, c]):
                return np.arcsinh(0.5 * (parts @ np.exp(z) + rest) / offset) - wanted

            def slopes(z, parts=parts, rest=grazing[:, c], offset=offset):
                return parts * np.exp(z) / np.hypot(parts @ np.exp(z) + rest, 2.0 * offset)[:, None]

            found = [
                least_squares(residual, np.log(start), slopes, bounds=(-14.0, 3.5))
                for start in ((0.3, 0.05), (0.02, 0.5))
            ]
            found = min(found, key=lambda end: end.cost)
            cost += found.cost
            numbers.append(np.exp(found.x))
        if best is None or cost < best[0]:
            albedo, f0 = np.transpose(numbers)
            best = cost, LambertGGX(albedo, f0[:, None], one, width)
    return best[1]


@cache
def all_weights(light):
    """Weights of all pixels of a sphere in a light."""
    return linear.weights(points("sphere", (SIZE, SIZE), Camera()), light).astype(np.float32)


def relit_by_nodes(model, light):
    """Picture (height, width, 3) of a sphere, as `images.relight` makes it of a model."""
    image = np.zeros((SIZE * SIZE, 3))
    image[points("sphere", (SIZE, SIZE), Camera()).pixel] = pixels_of(all_weights(light), model)
    return image.reshape(SIZE, SIZE, 3)


def relit_baseline(model, light, normals="sphere"):
    """Picture (height, width, 3) with anything that has `eval`."""
    seen = points(normals, (SIZE, SIZE), Camera())
    leaves = np.flatnonzero((light.parts.max(1) < 0) & (light.flux.sum(1) > 0.0))
    toward, flux = light.direction[leaves], light.flux[leaves]
    image = np.zeros((SIZE * SIZE, 3))
    # A pixel is the mean of its points
    of_point = np.repeat(seen.pixel, np.diff(seen.start))
    for normal, view, pixel in zip(seen.normal, seen.view, of_point, strict=True):
        across = np.cross(normal, [0.3, 0.5, 0.8])
        across /= np.linalg.norm(across)
        turn = np.stack([across, np.cross(normal, across), normal])
        wi, wo = toward @ turn.T, turn @ view
        up = wi[:, 2] > 0.0
        image[pixel] += (model.eval(wi[up], wo) * flux[up] * wi[up, 2:]).sum(0)
    return image.reshape(SIZE, SIZE, 3) / np.diff(seen.start)[0]


def tilted(degrees, seed=1):
    """Normals (height, width, 3) of a sphere, tilted in waves by so many degrees (RMS)."""
    seen = points("sphere", (SIZE, SIZE), Camera(), least_cosine=0.0)
    normals = np.zeros((SIZE * SIZE, 3))
    normals[seen.pixel] = seen.normal.reshape(len(seen.pixel), -1, 3).mean(1)
    rng = np.random.default_rng(seed)
    waves = rng.normal(size=(3, 3)) * 4.0
    tilt = np.deg2rad(degrees) * np.sin(normals @ waves + rng.uniform(0, 6, 3))
    found = np.where(normals.any(-1, keepdims=True), normals + tilt, 0.0)
    length = np.linalg.norm(found, axis=-1, keepdims=True)
    return np.divide(found, length, out=np.zeros_like(found), where=length > 0.0).reshape(SIZE, SIZE, 3)


def prior_without(name):
    (own,) = [n for n in library.names() if n in (name, f"{name}_rgb")]
    return dsbrdf.space.builtin(without=[own])


def found_in(image, light, prior, **options):
    clock = time.process_time()
    found = images.fit_image(image, "sphere", light, prior=prior, **options)
    return found, time.process_time() - clock


def row(label, values):
    print(f"{label:34s}" + " ".join(f"{value:7.3f}" for value in values), flush=True)


def seen_only(image):
    """A picture, black where `fit_image` does not look."""
    shown = np.zeros(SIZE * SIZE, bool)
    shown[points("sphere", (SIZE, SIZE), Camera()).pixel] = True
    return np.where(shown.reshape(SIZE, SIZE, 1), image, 0.0)


def distant_lights(n):
    """Directions toward n lights around the camera, and one of them behind the object."""
    angle = 2.0 * np.pi * np.arange(n) * 0.381966
    z = np.linspace(0.8, -0.6, n) if n > 1 else np.array([0.5])
    s = np.sqrt(1.0 - z * z)
    return np.stack([s * np.cos(angle), s * np.sin(angle), z], axis=-1)


def shaded(measured, direction):
    """Picture of a table in one distant light, each pixel the mean over 8 x 8 points."""
    seen = points("sphere", (SIZE, SIZE), Camera(), least_cosine=0.0, per_side=8)
    toward, view = seen.pairs(direction)
    up = (toward[:, 2] > 0.0) & (view[:, 2] > 0.0)
    values = np.zeros((len(up), 3))
    values[up] = np.pi * measured.eval(toward[up], view[up]) * toward[up, 2:]
    image = np.zeros((SIZE * SIZE, 3))
    image[seen.pixel] = seen.means(values)
    return image.reshape(SIZE, SIZE, 3)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("maps", type=Path, nargs=2)
    parser.add_argument("materials", nargs="+")
    parser.add_argument("--ggx", action="store_true", help="also Lambert + GGX, ten seconds each")
    parser.add_argument("--distant", action="store_true", help="also one, three and ten distant lights")
    parser.add_argument("--unknown", action="store_true", help="also the light unknown")
    parser.add_argument("--mistakes", action="store_true", help="also wrong normals, light and exposure")
    parser.add_argument("--bumpy", action="store_true", help="also an object with bumps of 20 degrees")
    parser.add_argument("--cache", type=Path, default=Path("truth"), help="folder of rendered pictures")
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    lights = [images.Light.from_map(path) for path in args.maps]
    results: dict[str, list] = {}

    def note(label, name, values):
        results.setdefault(label, []).append(values)
        row(f"{label} {name}", values)

    for name in args.materials:
        (path,) = [p for p in (args.folder / f"{name}.binary", args.folder / f"{name}.bsdf") if p.exists()]
        measured, prior = dsbrdf.read(path), prior_without(name)
        rendered = []
        for envmap in args.maps:
            cached = args.cache / f"{name}-{envmap.stem}.npy"
            if not cached.exists():
                cached.parent.mkdir(exist_ok=True)
                np.save(cached, truth(measured, envmap))
            rendered.append(seen_only(np.load(cached)[..., :3]))
        for i, (image, light) in enumerate(zip(rendered, lights, strict=True)):
            way = f"{args.maps[i].stem} -> {args.maps[1 - i].stem}"
            other_light, other = lights[1 - i], rendered[1 - i]

            def scored(
                found, seconds, *, to_scale=False, other_light=other_light, other=other, measured=measured
            ):
                relit = seen_only(images.relight(found.model, "sphere", other_light, size=SIZE))
                measures = errors(found.model, measured, other, relit, found.posterior, to_scale=to_scale)
                return (*measures, found.rms, found.n_effective, found.n_decided, seconds)

            note(way, name, scored(*found_in(noisy(image), light, prior)))
            if args.ggx:
                inputs = image_fit._inputs(noisy(image), "sphere", light, None, Camera())
                model = lambert_ggx(image_fit._problem(*inputs, prior.gaussian(), False))
                measures = errors(model, measured, other, seen_only(relit_by_nodes(model, other_light)))
                note(f"{way}, Lambert + GGX", name, measures[:5])
            if args.unknown:
                found = found_in(noisy(image), "unknown", prior)
                note(f"{way}, light unknown", name, scored(*found, to_scale=True))
            if args.mistakes and i == 0:
                turned = np.roll(light.map, round(5.0 / 360.0 * light.map.shape[1]), axis=1)
                note(
                    "light turned by 5 degrees",
                    name,
                    scored(*found_in(noisy(image), images.Light.from_map(turned), prior)),
                )
                note("exposure 5 % off", name, scored(*found_in(1.05 * noisy(image), light, prior)))
                note("normals 2 degrees off", name, scored(*found_with_normals(noisy(image), light, prior)))
        if args.bumpy:
            normals = tilted(20.0, seed=2)
            image = noisy(relit_baseline(measured, lights[0], normals))
            clock = time.process_time()
            found = images.fit_image(image, normals, lights[0], prior=prior, mask=image.any(-1))
            seconds = time.process_time() - clock
            relit = seen_only(images.relight(found.model, "sphere", lights[1], size=SIZE))
            measures = errors(found.model, measured, rendered[1], relit, found.posterior)
            note("bumpy", name, (*measures, found.rms, found.n_effective, found.n_decided, seconds))
        if args.distant:
            for n in DISTANT:
                toward = distant_lights(n)
                shown = [noisy(shaded(measured, direction), seed) for seed, direction in enumerate(toward)]
                found, seconds = found_in(shown, [images.Light.distant(d, np.pi) for d in toward], prior)
                relit = seen_only(images.relight(found.model, "sphere", lights[0], size=SIZE))
                measures = errors(found.model, measured, rendered[0], relit, found.posterior)
                note(
                    f"{n} distant", name, (*measures, found.rms, found.n_effective, found.n_decided, seconds)
                )
    print("\nmedians: dirs, cells, inner, relit, dE, in, rms, worth, decided, CPU seconds")
    for label, rows in results.items():
        row(label, np.median(rows, axis=0))


def found_with_normals(image, light, prior):
    """The fit with smooth errors of 2 degrees in the normals."""
    clock = time.process_time()
    found = images.fit_image(image, tilted(2.0), light, prior=prior, mask=image.any(-1))
    return found, time.process_time() - clock


if __name__ == "__main__":
    main()
