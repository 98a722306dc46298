"""Reference values of `dsbrdf.measured.formats.rgl` from Mitsuba 3, written to `rgl.json` beside this file.

Run with `DSBRDF_TEST_DATA=FOLDER python tests/reference/rgl.py`; it needs the RGL files, Mitsuba and NumPy,
and takes seconds. The plugin `measured` evaluates f(wi, wo) cos(theta_o) in single precision.

Half of the pairs have both directions uniform over the hemisphere, half a uniform incident direction and a
half vector that is denser toward the normal. Coordinates and values are numbers of single precision, at nine
digits, which is all they have.
"""

import json
import os
from pathlib import Path

import mitsuba as mi
import numpy as np

PAIRS = 48
RNG = np.random.default_rng(7)


def direction(cos_theta):
    """Unit vectors of these polar cosines and random azimuths."""
    phi = RNG.uniform(-np.pi, np.pi, np.shape(cos_theta))
    sin_theta = np.sqrt(1 - cos_theta**2)
    return np.stack([sin_theta * np.cos(phi), sin_theta * np.sin(phi), cos_theta], axis=-1)


def pairs():
    """Directions (PAIRS, 3) toward the light and the viewer, above the horizon, in single precision."""
    wi, wo = direction(RNG.uniform(0, 1, (2, 20 * PAIRS)))
    half = direction(np.cos(np.pi / 2 * RNG.uniform(0, 0.8, len(wi)) ** 2))
    mirrored = 2 * np.sum(half * wi, axis=-1, keepdims=True) * half - wi
    wo[::2] = mirrored[::2]
    keep = (wi[:, 2] > 0.05) & (wo[:, 2] > 0.05)
    return wi[keep][:PAIRS].astype(np.float32), wo[keep][:PAIRS].astype(np.float32)


def evaluate(bsdf, wi, wo):
    interaction = mi.SurfaceInteraction3f()
    interaction.wi = mi.Vector3f(*map(float, wi))
    return np.array(bsdf.eval(mi.BSDFContext(), interaction, mi.Vector3f(*map(float, wo))))


def digits(array):
    return [[float(f"{x:.9g}") for x in row] for row in array]


def main():
    mi.set_variant("scalar_rgb")
    wi, wo = pairs()
    root = Path(os.environ["DSBRDF_TEST_DATA"])
    values = {}
    for path in sorted([*root.glob("rgl/*.bsdf"), *root.glob("data/rgl/*.bsdf")]):
        bsdf = mi.load_dict({"type": "measured", "filename": str(path)})
        values[path.name] = digits([evaluate(bsdf, *pair) for pair in zip(wi, wo, strict=True)])
    reference = {"mitsuba": mi.__version__, "wi": digits(wi), "wo": digits(wo), "f_cos": values}
    text = json.dumps(reference).replace("], [", "],\n[")
    Path(__file__).with_suffix(".json").write_text(text + "\n")


if __name__ == "__main__":
    main()
