"""Which azimuthal term should a lobe carry? Fits every candidate to every material, tabulates the errors.

A lobe is `expm1(kappa cos(theta_h)^gamma) (1 + beta g(theta_h, theta_d) cos(2 phi_d))`. The script tries
fixed factors g, `cos(4 phi_d)` in place of `cos(2 phi_d)`, and gives the floors that bound them:

    python benchmarks/azimuthal_forms.py forms MERL [RGL]       the forms, docs/azimuthal.md
    python benchmarks/azimuthal_forms.py materials MERL [RGL]   a row a material, docs/tables/azimuthal.md
    python benchmarks/azimuthal_forms.py ingredients            closed-form reflectances, parts switched off

MERL is a folder of tables in the format of the MERL database (`.binary`), RGL one of measurements of the RGL
database (`.bsdf`, isotropic). The tables are Markdown. Numbers are the relative (energy-normalised) RMS over
all samples, slices and channels. The fit sets beta to zero where it does not pay, as
`dsbrdf.paper.fit_slices(azimuthal=True)` does.

MERL tables are collapsed as `dsbrdf.paper.fit_slices` does it by default: 18 slices, theta_h of a degree and more,
perimeter masked. RGL files are evaluated at theta_d = 0, 5, ..., 85 degrees, theta_h = i^2 / 90 degrees from
one degree on (the lower edges of the cells of a MERL table) and every third degree of phi_d. A value is the
mean over the reciprocal pair; it counts if neither of the two is negative and no direction is more than 80
degrees from the normal. There is no perimeter mask on them.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dsbrdf import _core, half_diff
from dsbrdf.geometry.grids import cell_angles
from dsbrdf.measured.formats.merl import read_merl
from dsbrdf.measured.formats.rgl import read_rgl
from dsbrdf.measured.reflectance import coated, ggx, oren_nayar
from dsbrdf.paper import metrics
from dsbrdf.paper.collapse import MIN_THETA_H, SliceProfile, slice_mask, slice_rows
from dsbrdf.paper.slice_fit import fit_profiles

Array = NDArray[np.float64]
Form = Callable[[Array, Array], Array]
Reflectance = Callable[[Array, Array], Array]

#: The factor of `dsbrdf.half_diff.azimuthal_factor`, by its name in `FORMS`.
CHOSEN = f"T, c = {half_diff.AZIMUTHAL_WIDTH:g} (chosen)"
PHI_D = np.deg2rad(np.arange(180) + 0.5)
#: RGL protocol.
RGL_THETA_D = np.deg2rad(np.arange(0.0, 90.0, 5.0))
RGL_PHI_D = np.deg2rad(np.arange(0.0, 180.0, 3.0))
RGL_LARGEST_THETA = np.deg2rad(80.0)


def _saturating(p: Array, q: Array) -> Array:
    """`p / sqrt(p^2 + q^2)`, 0 at 0."""
    length = np.hypot(p, q)
    return np.divide(p, length, out=np.zeros_like(length), where=length > 0.0)


def product_form(c: float) -> Form:
    """`p / sqrt(p^2 + (c q)^2)` of `dsbrdf.half_diff.azimuthal_factor`, with another width c."""
    return lambda h, d: _saturating(np.sin(h) * np.sin(d), c * np.cos(h) * np.cos(d))


#: Factors g(theta_h, theta_d) by name; a row of the table each.
FORMS: Mapping[str, Form] = {
    "1": lambda h, d: np.ones(np.broadcast_shapes(h.shape, d.shape)),
    CHOSEN: lambda h, d: half_diff.azimuthal_factor(h, d),
    "T, c = 0.03": product_form(0.03),
    "T, c = 0.05": product_form(0.05),
    "T, c = 0.1": product_form(0.1),
    "T, c = 0.3": product_form(0.3),
    "T, c = 1": product_form(1.0),
    "sin h / sqrt(sin^2 h + (0.03 cos h)^2)": lambda h, d: _saturating(
        np.sin(h) + 0.0 * d, 0.03 * np.cos(h) + 0.0 * d
    ),
    "tanh(10 h)": lambda h, d: np.tanh(10.0 * h) + 0.0 * d,
    "tanh(30 h)": lambda h, d: np.tanh(30.0 * h) + 0.0 * d,
    "sin h": lambda h, d: np.sin(h) + 0.0 * d,
    "sin^2 h": lambda h, d: np.sin(h) ** 2 + 0.0 * d,
    "sin h sin d": lambda h, d: np.sin(h) * np.sin(d),
    "sin^2 h sin^2 d": lambda h, d: (np.sin(h) * np.sin(d)) ** 2,
}


@dataclass(frozen=True)
class Samples:
    """Slices of a material: values (slice, channel, theta_h, phi_d) in 1/sr, NaN where masked."""

    name: str
    theta_d: Array
    theta_h: Array
    phi_d: Array
    values: Array

    def moments(self, harmonic: int) -> Array:
        """Moments (slice, channel, theta_h, 6) over phi_d, with `c = cos(harmonic phi_d)`."""
        valid = np.isfinite(self.values)
        f = np.where(valid, self.values, 0.0)
        c = np.cos(harmonic * self.phi_d)
        n = valid.astype(float)
        return np.stack(
            [n.sum(-1), f.sum(-1), (f * f).sum(-1), n @ c, n @ c**2, f @ c],
            axis=-1,
        )

    def profiles(self) -> list[SliceProfile]:
        """The slices as `dsbrdf.paper.fit_slices` sees them."""
        moments = self.moments(2)
        return [SliceProfile(float(d), self.theta_h, m) for d, m in zip(self.theta_d, moments, strict=True)]

    def floor(self, harmonics: tuple[int, ...]) -> Array:
        """Sum of squares (slice, channel) that the best harmonics at each (theta_h, theta_d) leave."""
        valid = np.isfinite(self.values)
        f = np.where(valid, self.values, 0.0)
        basis = np.stack([np.cos(k * self.phi_d) for k in harmonics])
        gram = np.einsum("schp,ip,jp->schij", valid.astype(float), basis, basis, optimize=True)
        right = f @ basis.T
        coefficients = (np.linalg.pinv(gram, rcond=1e-9, hermitian=True) @ right[..., None])[..., 0]
        left = np.where(valid, f - coefficients @ basis, 0.0)
        return (left**2).sum((-2, -1))

    def symmetric_floor(self) -> Array:
        """Sum of squares (slice, channel) that the best symmetric function leaves.

        One that is reciprocal and mirror-symmetric is the same at phi_d and at 180 degrees less phi_d.
        """
        key = np.round(np.degrees(np.minimum(self.phi_d, np.pi - self.phi_d)), 6)
        left = np.zeros(self.values.shape[:2])
        for angle in np.unique(key):
            pair = self.values[..., key == angle]
            count = np.isfinite(pair).sum(-1, keepdims=True)
            mean = np.nansum(pair, -1, keepdims=True) / np.maximum(count, 1)
            left += np.nansum((pair - mean) ** 2, axis=(-2, -1))
        return left


def merl_samples(path: Path) -> Samples:
    """Default slices of a table in MERL format."""
    measured = read_merl(path)
    rows = slice_rows(len(measured.theta_d))
    mask = slice_mask(measured, rows, MIN_THETA_H, True, 1)
    values = np.moveaxis(measured.rows(rows), 2, 0)
    values = np.where(mask[:, None, :, None], values, np.nan)
    return Samples(path.stem, measured.theta_d[rows], measured.theta_h, measured.phi_d, values)


def rgl_samples(path: Path) -> Samples:
    """Slices of an RGL measurement, see the module's text."""
    measured = read_rgl(path)
    theta_h = cell_angles("edge")[0]
    theta_h = theta_h[theta_h >= MIN_THETA_H - 1e-12]
    wi, wo = half_diff.to_directions(theta_h[:, None], RGL_THETA_D[:, None, None], RGL_PHI_D)
    pair = np.stack([measured.eval(wi, wo), measured.eval(wo, wi)])
    near = np.minimum(wi[..., 2], wo[..., 2]) >= np.cos(RGL_LARGEST_THETA) - 1e-12
    counts = near[..., None] & (pair >= 0.0).all(0)
    values = np.moveaxis(np.where(counts, pair.mean(0), np.nan), -1, 1)
    return Samples(path.stem.removesuffix("_rgb"), RGL_THETA_D, theta_h, RGL_PHI_D, values)


@dataclass(frozen=True)
class Outcome:
    """Relative RMS of a fit, and whether any lobe has a beta."""

    error: float
    has_beta: bool


def fit_form(samples: Samples, moments: Array, n_lobes: int, form: Form | None) -> Outcome:
    """Fits jointly with a factor g, or without the azimuthal term."""
    theta_h = np.broadcast_to(samples.theta_h, (len(samples.theta_d), len(samples.theta_h)))
    factor = np.zeros(theta_h.shape) if form is None else form(theta_h, samples.theta_d[:, None])
    result = _core.fit(
        np.ascontiguousarray(moments),
        half_diff.log_cos(theta_h),
        np.ascontiguousarray(factor),
        n_lobes=n_lobes,
        method="joint",
        azimuthal=form is not None,
        follow=True,
        log_offset=None,
    )
    error = float(np.sqrt(np.sum(result["objective"]) / moments[..., 2].sum()))
    return Outcome(error, bool(np.any(result["beta"])))


def read_all(merl: Path, rgl: Path | None, every: int) -> Iterator[tuple[bool, Samples]]:
    """Materials, and whether each is from the second folder."""
    for path in sorted(merl.glob("*.binary"))[::every]:
        yield False, merl_samples(path)
    for path in sorted(rgl.glob("*.bsdf")) if rgl else []:
        yield True, rgl_samples(path)


def forms_of(samples: Samples, n_lobes: int) -> dict[str, Outcome]:
    """Fits of all forms to a material, and the floors."""
    moments = samples.moments(2)
    energy = moments[..., 2].sum()
    found = {"no term (beta = 0)": fit_form(samples, moments, n_lobes, None)}
    for name, form in FORMS.items():
        found[f"g = {name}"] = fit_form(samples, moments, n_lobes, form)
    found["g = 1, cos 4 phi_d instead"] = fit_form(samples, samples.moments(4), n_lobes, FORMS["1"])
    floors = {
        "floor: a": samples.floor((0,)),
        "floor: a + b cos 2 phi_d": samples.floor((0, 2)),
        "floor: a + d cos 4 phi_d": samples.floor((0, 4)),
        "floor: a + b cos 2 phi_d + d cos 4 phi_d": samples.floor((0, 2, 4)),
        "floor: any function of phi_d": samples.symmetric_floor(),
    }
    return found | {name: Outcome(float(np.sqrt(x.sum() / energy)), True) for name, x in floors.items()}


def print_forms(merl: Path, rgl: Path | None, n_lobes: int, every: int) -> None:
    """The table of forms: median and mean over the MERL tables, then each RGL file."""
    tables: list[dict[str, Outcome]] = []
    measured: dict[str, dict[str, Outcome]] = {}
    for is_rgl, samples in read_all(merl, rgl, every):
        found = forms_of(samples, n_lobes)
        if is_rgl:
            measured[samples.name] = found
        else:
            tables.append(found)
    print(f"K = {n_lobes}, {len(tables)} tables.\n")
    print("| form | median | mean | beta = 0 |", *(f" {name} |" for name in measured), sep="")
    print("|---|---|---|---|" + "---|" * len(measured))
    for form in tables[0]:
        column = np.array([found[form].error for found in tables])
        zero = sum(not found[form].has_beta for found in tables)
        cells = [f"{np.median(column):.4f}", f"{column.mean():.4f}", "" if "floor" in form else str(zero)]
        cells += [f"{found[form].error:.3f}" for found in measured.values()]
        print(f"| {form} | {' | '.join(cells)} |")


def print_materials(merl: Path, rgl: Path | None, every: int) -> None:
    """One row a material: errors with and without the term for K = 2 and 3, the floors, where beta = 0."""
    head = ("material", "K=2 without", "K=2 with", "K=3 without", "K=3 with", "bivariate floor")
    head += ("monotone floor", "azimuthal floor", "beta = 0 at K =")
    rows: dict[bool, list[tuple[str, list[float], list[str]]]] = {False: [], True: []}
    for is_rgl, samples in read_all(merl, rgl, every):
        rows[is_rgl].append((samples.name, *material_row(samples)))
    for is_rgl, title in ((False, "Tables in MERL format"), (True, "RGL measurements")):
        if rows[is_rgl]:
            print(f"\n## {title}: {len(rows[is_rgl])}\n\n| {' | '.join(head)} |\n|{'---|' * len(head)}")
            numbers = np.array([row for _, row, _ in rows[is_rgl]])
            print_row("**median**", np.median(numbers, axis=0))
            print_row("**mean**", numbers.mean(0))
            for name, row, zero in rows[is_rgl]:
                print_row(name, row, ", ".join(zero))


def material_row(samples: Samples) -> tuple[list[float], list[str]]:
    """Numbers of `print_materials`, and the K at which beta is zero."""
    moments = samples.moments(2)
    fits = {k: [fit_form(samples, moments, k, form) for form in (None, FORMS[CHOSEN])] for k in (2, 3)}
    zero = np.full((*moments.shape[:2], 1), 1e-12)
    errors = metrics.fit_errors(samples.profiles(), zero, np.ones_like(zero), 0.0 * zero)
    floors = [errors.bivariate_floor, errors.monotone_floor, errors.azimuthal_floor]
    without = [str(k) for k, (_, fit) in fits.items() if not fit.has_beta]
    return [fit.error for pair in fits.values() for fit in pair] + floors, without


def print_row(name: str, numbers: Array | list[float], mark: str = "") -> None:
    print(f"| {name} |", *(f" {x:.4f} |" for x in numbers), f" {mark} |", sep="")


def aperture(reflectance: Reflectance, radius: float, count: int = 200) -> Reflectance:
    """Mean of a reflectance over discs of directions, `radius` in radians, about both directions."""
    rng = np.random.default_rng(0)
    r, phi = radius * np.sqrt(rng.random((count, 2))), 2.0 * np.pi * rng.random((count, 2))

    def tilted(w: Array, r: float, phi: float) -> Array:
        x = np.cross(w, np.array([0.0, 1.0, 0.0]))
        x /= np.linalg.norm(x, axis=-1, keepdims=True)
        v = w + r * (np.cos(phi) * x + np.sin(phi) * np.cross(w, x))
        return v / np.linalg.norm(v, axis=-1, keepdims=True)

    def mean(wi: Array, wo: Array) -> Array:
        pairs = zip(r, phi, strict=True)
        return sum(reflectance(tilted(wi, a[0], b[0]), tilted(wo, a[1], b[1])) for a, b in pairs) / count

    return mean


BASE = partial(coated, albedo=0.5, eta=1.5, alpha=0.1, weights=0.0)
#: Reflectances of which every part is known.
INGREDIENTS: Mapping[str, Reflectance] = {
    "D alone": partial(ggx, alpha=0.1, masking=False, foreshortening=False),
    "D and Fresnel (n = 1.5)": partial(ggx, alpha=0.1, masking=False, foreshortening=False, fresnel=1.5),
    "D / (cos_i cos_o)": partial(ggx, alpha=0.1, masking=False),
    "D and masking G": partial(ggx, alpha=0.1, foreshortening=False),
    "all of GGX, alpha 0.05": partial(ggx, alpha=0.05),
    "all of GGX, alpha 0.1": partial(ggx, alpha=0.1),
    "all of GGX, alpha 0.3": partial(ggx, alpha=0.3),
    "all of GGX, alpha 0.1, gold": partial(ggx, alpha=0.1, fresnel=0.428 + 2.460j),
    "all of GGX, alpha 0.1, n = 1.5": partial(ggx, alpha=0.1, fresnel=1.5),
    "Lambertian base under a coat, no highlight": BASE,
    "the same, not coupled to the coat": partial(BASE, coupling=False),
    "Oren-Nayar, sigma 0.5": partial(oren_nayar, albedo=0.5, sigma=0.5),
    "Oren-Nayar base under a coat": partial(BASE, sigma=0.5),
    "glossy plastic: base, coat, GGX alpha 0.1": partial(BASE, weights=1.0),
    "D alone, alpha 0.05, seen through 1 degree": aperture(
        partial(ggx, alpha=0.05, masking=False, foreshortening=False), np.deg2rad(1.0)
    ),
}
#: (theta_d, theta_h) in degrees at which b / a is printed.
POINTS = ((20, 5), (20, 45), (45, 5), (45, 30), (60, 5), (60, 15), (75, 5), (75, 10))


def modulation(reflectance: Reflectance, theta_h: Array | float, theta_d: float) -> Array:
    """Ratio b / a of `a + b cos(2 phi_d)` (theta_h,)."""
    wi, wo = half_diff.to_directions(np.atleast_1d(theta_h)[:, None], theta_d, PHI_D)
    f = reflectance(wi, wo)[..., 0]
    return 2.0 * (f * np.cos(2.0 * PHI_D)).mean(-1) / f.mean(-1)


def closed_form(reflectance: Reflectance, name: str) -> Samples:
    """Default slices of a reflectance."""
    theta_h, theta_d, phi_d = cell_angles()
    theta_h, theta_d = theta_h[theta_h >= MIN_THETA_H], theta_d[slice_rows(len(theta_d))]
    wi, wo = half_diff.to_directions(theta_h[:, None], theta_d[:, None, None], phi_d)
    values = np.moveaxis(reflectance(wi, wo), -1, 1)
    inside = theta_h[:, None] < np.pi / 2 - theta_d[:, None, None, None]
    return Samples(name, theta_d, theta_h, phi_d, np.where(inside, values, np.nan))


def print_ingredients() -> None:
    """Ratio b / a of closed-form reflectances and the errors of their fits; then lobes of GGX."""
    degrees = np.deg2rad(POINTS)
    print("| b / a at theta_d, theta_h |", *(f" {d}, {h} |" for d, h in POINTS), " without | with |", sep="")
    print("|---|" + "---|" * (len(POINTS) + 2))
    for name, reflectance in INGREDIENTS.items():
        ratios = [modulation(reflectance, h, d)[0] for d, h in degrees]
        cells = ["0" if abs(ratio) < 5e-4 else f"{ratio:+.3f}" for ratio in ratios]
        if "seen through" in name:
            cells += ["", ""]
        else:
            samples = closed_form(reflectance, name)
            moments = samples.moments(2)
            cells += [f"{fit_form(samples, moments, 3, form).error:.4f}" for form in (None, FORMS[CHOSEN])]
        print(f"| {name} | {' | '.join(cells)} |")
    print("\n| GGX, K = 2 | theta_d | lobe 1: kappa, gamma, beta | lobe 2 |\n|---|---|---|---|")
    for alpha in (0.05, 0.1, 0.2, 0.4):
        for kind, fresnel in (("gold", 0.428 + 2.460j), ("n = 1.5", 1.5)):
            profiles = closed_form(partial(ggx, alpha=alpha, fresnel=fresnel), kind).profiles()
            parameters, _ = fit_profiles(profiles, 2, azimuthal=True)
            for row in (3, 9, 15):
                lobes = [", ".join(f"{x[row, 0, k]:.3g}" for x in parameters) for k in (0, 1)]
                theta_d = np.degrees(profiles[row].theta_d)
                print(f"| alpha {alpha}, {kind} | {theta_d:.1f} | {' | '.join(lobes)} |")


def main() -> None:
    parser = argparse.ArgumentParser(description="Tables of azimuthal terms, in Markdown.")
    parser.add_argument("table", choices=("forms", "materials", "ingredients"))
    parser.add_argument("merl", type=Path, nargs="?", help="folder of MERL tables (.binary)")
    parser.add_argument("rgl", type=Path, nargs="?", help="folder of RGL measurements (.bsdf)")
    parser.add_argument("--n-lobes", type=int, default=3, help="lobes a slice and channel, for 'forms'")
    parser.add_argument("--every", type=int, default=1, help="take every n-th MERL table only")
    args = parser.parse_args()
    if args.table == "ingredients":
        print_ingredients()
    elif args.merl is None:
        parser.error(f"'{args.table}' needs a folder of MERL tables")
    elif args.table == "forms":
        print_forms(args.merl, args.rgl, args.n_lobes, args.every)
    else:
        print_materials(args.merl, args.rgl, args.every)


if __name__ == "__main__":
    main()
