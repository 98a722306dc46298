"""Hand-made models of every schema and their values, written beside this file; it takes a second.

`model-schema-1.json` is what `save` wrote when the schema was 1 and there was no spike yet,
`model-schema-1-spike.json` the same with one; `model-schema-2.json` has a summary of what was measured.
Every later version has to read them: do not write them again when the layout changes, add the next. The
files `*-values.json` have values of the models in 1/sr at angles (theta_h, theta_d, phi_d) from mpmath and
the formulas alone: at slices, between them, and beyond the first and last.

Run with `python tests/golden/models.py`; it needs mpmath, and the package for a model not yet there.
"""

import json
from pathlib import Path

import mpmath as mp
import numpy as np

HERE = Path(__file__).parent
#: Of the azimuthal term; a file of schema 1 does not hold it.
WIDTH = "0.01"
SPIKE = [[0.0, 30.0], [4.5, 0.1], [0.0, 7.0]]
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
PROFILE = {
    "theta_d": [0.1, 0.6],
    "theta_h": [[0.0, 0.25, 1.0]],
    "mean": [[[1.5, 0.2, None], [2.0, 0.1, 0.0]], [[1.0, 0.125, 1e-9], [None, None, None]]],
    "amplitude": [[[None, 0.01, None], [None, -0.02, 0.0]], [[0.5, 0.0, 1e-12], [None, None, None]]],
}
ANGLES = [
    [0.0, 0.1, 0.0],
    [0.008, 0.3, 2.0],
    [0.0175, 1.3, 1.0],
    [0.05, 0.1, 0.7],
    [0.3, 0.6, 1.5],
    [0.9, 0.6, 0.0],
    [0.2, 0.35, 2.5],
    [0.02, 1.05, 1.0],
    [0.1, 0.02, 0.3],
    [0.04, 1.5, 3.0],
]


def write_model(path, spike, profile):
    """A model file of the package."""
    from dsbrdf import DSBRDF
    from dsbrdf.measured.source import Source
    from dsbrdf.paper.collapse import MeasuredProfile

    if profile:
        arrays = {name: np.array(values, dtype=float) for name, values in profile.items()}
        profile = MeasuredProfile(**arrays | {"theta_h": np.repeat(arrays["theta_h"], 2, axis=0)})
    source = {"file": "hand.binary", "sha256": "0" * 64, "description": "made by hand: é, 1/sr"}
    model = DSBRDF(
        **MODEL,
        spike=spike,
        name="hand-made",
        source=Source(description=source["description"], recorded=source),
        fit_options={
            "method": "joint",
            "n_slices": 3,
            "perimeter_mask": True,
            "min_theta_h": 0.017453292519943295,
        },
        errors={"rel_rms": 0.012345678901234567, "monotone_floor": float("nan")},
        profile=profile,
    )
    model.save(path)


def slice_value(spike, s, channel, theta_h, theta_d, phi_d):
    """Sum over the lobes of slice `s` with the azimuthal term, and the spike, which ends at one degree."""
    p, q = mp.sin(theta_h) * mp.sin(theta_d), mp.cos(theta_h) * mp.cos(theta_d)
    factor = p / mp.sqrt(p**2 + (mp.mpf(WIDTH) * q) ** 2)
    lobes = zip(*(MODEL[key][s][channel] for key in ("kappa", "gamma", "beta")), strict=True)
    light = sum(
        mp.expm1(k * mp.cos(theta_h) ** g) * (1 + b * factor * mp.cos(2 * phi_d)) for k, g, b in lobes
    )
    cap = 1 - (mp.sin(theta_h) / mp.sin(mp.pi / 180)) ** 2
    return light + (spike[s][channel] * max(cap, 0) if spike else 0)


def value(spike, channel, theta_h, theta_d, phi_d):
    """Value of the model, linear in theta_d between slices and held beyond the first and last."""
    nodes = [mp.mpf(node) for node in MODEL["theta_d"]]
    low = max([i for i in range(len(nodes) - 1) if nodes[i] <= theta_d], default=0)
    weight = min(max((theta_d - nodes[low]) / (nodes[low + 1] - nodes[low]), 0), 1)
    below, above = (slice_value(spike, s, channel, theta_h, theta_d, phi_d) for s in (low, low + 1))
    return (1 - weight) * below + weight * above


def main():
    """Write the values, and the models that are not there."""
    cases = (
        ("model-schema-1", None, None),
        ("model-schema-1-spike", SPIKE, None),
        ("model-schema-2", SPIKE, PROFILE),
    )
    for name, spike, profile in cases:
        if not (HERE / f"{name}.json").exists():
            write_model(HERE / f"{name}.json", spike, profile)
        with mp.workdps(40):
            values = [
                [float(value(spike, channel, *map(mp.mpf, at))) for channel in range(2)] for at in ANGLES
            ]
        text = json.dumps({"angles": ANGLES, "values": values}, indent=1)
        (HERE / f"{name}-values.json").write_text(text + "\n")


if __name__ == "__main__":
    main()
