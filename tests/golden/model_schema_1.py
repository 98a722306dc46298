"""A hand-made model of schema 1 and its values, written beside this file; it takes a second.

`model-schema-1.json` is what `save` wrote when the schema was 1. Every later version has to read it: do not
write it again when the layout changes, add the next. `model-schema-1-values.json` has values of that model in
1/sr at angles (theta_h, theta_d, phi_d) from mpmath and the formulas alone: at slices, between them, and
beyond the first and last.

Run with `python tests/golden/model_schema_1.py`; it needs mpmath, and for the first file the package.
"""

import json
from pathlib import Path

import mpmath as mp

HERE = Path(__file__).parent
WIDTH = "0.03"
MODEL = {
    "theta_d": [0.1, 0.6, 1.2],
    "kappa": [
        [[0.1, 1.2345678901234567], [0.3, 2.5]],
        [[1 / 3, 0.7], [1e-14, 3.3]],
        [[0.2, 5.0], [0.05, 1.1]],
    ],
    "gamma": [
        [[0.5, 123.456], [0.0, 1e4]],
        [[2 / 3, 50.0], [1.0, 1e-3]],
        [[0.7, 20.0], [0.4, 7.0]],
    ],
    "beta": [
        [[0.0, -0.25], [0.0, 0.1]],
        [[0.1, -1.0], [1.0, 0.0]],
        [[0.3, -0.5], [0.0, 1e-17]],
    ],
}
ANGLES = [
    [0.0, 0.1, 0.0],
    [0.05, 0.1, 0.7],
    [0.3, 0.6, 1.5],
    [0.9, 0.6, 0.0],
    [0.2, 0.35, 2.5],
    [0.02, 1.05, 1.0],
    [0.1, 0.02, 0.3],
    [0.04, 1.5, 3.0],
]


def write_model():
    """`model-schema-1.json`."""
    from dsbrdf import DSBRDF
    from dsbrdf.measured.brdf import Source

    source = {"file": "hand.binary", "sha256": "0" * 64, "description": "made by hand: é, 1/sr"}
    model = DSBRDF(
        **MODEL,
        name="hand-made",
        source=Source(description=source["description"], recorded=source),
        fit_options={
            "method": "joint",
            "n_slices": 3,
            "perimeter_mask": True,
            "min_theta_h": 0.017453292519943295,
        },
        errors={"rel_rms": 0.012345678901234567, "monotone_floor": float("nan")},
    )
    model.save(HERE / "model-schema-1.json")


def slice_value(s, channel, theta_h, theta_d, phi_d):
    """Sum over the lobes of slice `s` with the azimuthal term."""
    p, q = mp.sin(theta_h) * mp.sin(theta_d), mp.cos(theta_h) * mp.cos(theta_d)
    factor = p / mp.sqrt(p**2 + (mp.mpf(WIDTH) * q) ** 2)
    lobes = zip(*(MODEL[key][s][channel] for key in ("kappa", "gamma", "beta")), strict=True)
    return sum(mp.expm1(k * mp.cos(theta_h) ** g) * (1 + b * factor * mp.cos(2 * phi_d)) for k, g, b in lobes)


def value(channel, theta_h, theta_d, phi_d):
    """Value of the model, linear in theta_d between slices and held beyond the first and last."""
    nodes = [mp.mpf(node) for node in MODEL["theta_d"]]
    low = max([i for i in range(len(nodes) - 1) if nodes[i] <= theta_d], default=0)
    weight = min(max((theta_d - nodes[low]) / (nodes[low + 1] - nodes[low]), 0), 1)
    below, above = (slice_value(s, channel, theta_h, theta_d, phi_d) for s in (low, low + 1))
    return (1 - weight) * below + weight * above


def main():
    """Write both files; the first only if there is none."""
    if not (HERE / "model-schema-1.json").exists():
        write_model()
    with mp.workdps(40):
        values = [[float(value(channel, *map(mp.mpf, angles))) for channel in range(2)] for angles in ANGLES]
    text = json.dumps({"angles": ANGLES, "values": values}, indent=1)
    (HERE / "model-schema-1-values.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
