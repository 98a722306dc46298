"""How near the nearest materials of programs come to measurements, and whether they keep the hue.

    python benchmarks/engine.py FILE... [--models DIR] [--formats gltf openpbr blender usd principled] [--out rows.json]

For each measured file the model is fitted (or read from DIR/<name>.json), and of it the material of each format. cbrt:
relative RMS of the cube root of `f cos cos` against the measurement, below 80 degrees. sphere: CIEDE2000 of a sphere
against the model. diffuse: CIEDE2000 of pi f, off the highlight (theta_h 45 to 60, theta_d 10 to 40 degrees). specular:
of the highlight (theta_h 0.5 degrees, theta_d 10 to 40), both at the luminance of the measured one, whose largest
channel is 1. About 3 s of processor time a file and five formats, with models.
"""

from __future__ import annotations

import argparse
import json
import warnings
from pathlib import Path
from typing import Any

import numpy as np

import dsbrdf
from dsbrdf.baselines.engine import cbrt_error
from dsbrdf.export import blender, gltf, openpbr, preview, principled, usd
from dsbrdf.geometry import half_diff
from dsbrdf.geometry.colour import LUMINANCE
from dsbrdf.geometry.colour_difference import ciede2000, lab

FORMS = {"gltf": gltf.FORM, "openpbr": openpbr.FORM, "blender": blender.FORM, "usd": usd.FORM}
COLUMNS = ("cbrt", "sphere", "diffuse", "specular")
LIMIT = 0.15


def nearest(name: str, model: Any) -> tuple[Any, preview.Nearness]:
    """The material of a format, and how far it is from the model."""
    if name != "principled":
        return preview.fit_preview(model, FORMS[name])
    content, near = principled.fit_principled(model)
    x = np.array([*content["base_color"]["value"], *(content[key] for key in principled.NAMES)])
    return principled.Principled(x), near


def colours(reflectance: Any) -> tuple[np.ndarray, np.ndarray]:
    """Of the diffuse part and of the highlight, linear."""
    theta_d = np.deg2rad([10.0, 20.0, 30.0, 40.0])
    off = half_diff.to_directions(np.deg2rad([45.0, 50.0, 55.0, 60.0])[:, None], theta_d, 0.5 * np.pi)
    at = half_diff.to_directions(np.deg2rad(0.5), theta_d, 0.5 * np.pi)
    return np.pi * reflectance.eval(*off).mean((0, 1)), reflectance.eval(*at).mean(0)


def hues(material: Any, measured: Any) -> tuple[float, float]:
    """Colour differences of the diffuse part and of the highlight."""
    (diffuse, specular), (of, highlight) = colours(measured), colours(material)
    highlight = highlight * (specular @ LUMINANCE) / max(highlight @ LUMINANCE, 1e-12) / specular.max()
    pairs = ((diffuse, of), (specular / specular.max(), highlight))
    first, second = (ciede2000(*(lab(np.clip(x, 0.0, 1.0)) for x in pair)) for pair in pairs)
    return float(first), float(second)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", type=Path, nargs="+")
    parser.add_argument("--models", type=Path)
    parser.add_argument("--formats", nargs="+", default=[*FORMS, "principled"])
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    warnings.simplefilter("ignore")
    rows: dict[str, dict[str, tuple[float, ...]]] = {}
    for path in args.files:
        measured = dsbrdf.read(path)
        stored = args.models and args.models / f"{path.stem}.json"
        model = dsbrdf.load(stored) if stored else dsbrdf.fit(measured).model
        rows[path.stem] = {}
        for name in args.formats:
            material, near = nearest(name, model)
            error = cbrt_error(material, measured)
            rows[path.stem][name] = (error, near.ciede2000, *hues(material, measured))
        shown = "  ".join(" ".join(f"{x:.3g}" for x in row) for row in rows[path.stem].values())
        print(f"{path.stem:28s} {shown}", flush=True)
        if args.out:
            args.out.write_text(json.dumps(rows), encoding="utf-8")
    print(
        "\n| format | " + " | ".join(f"{c}: median, worst" for c in COLUMNS) + f" | cbrt above {LIMIT:.0%} |"
    )
    print("|---" * (len(COLUMNS) + 2) + "|")
    for name in args.formats:
        values = np.array([row[name] for row in rows.values()])
        middle, worst = np.median(values, axis=0), values.max(0)
        cells = [f"{100 * middle[0]:.1f} %, {100 * worst[0]:.0f} %"]
        cells += [f"{m:.1f}, {w:.1f}" for m, w in zip(middle[1:], worst[1:], strict=True)]
        above = sorted((row[name][0], key) for key, row in rows.items() if row[name][0] > LIMIT)
        print(
            f"| `{name}` | {' | '.join(cells)} | {', '.join(f'{k} {100 * e:.0f} %' for e, k in above[::-1])} |"
        )


if __name__ == "__main__":
    main()
