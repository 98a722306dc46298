"""Make the library of materials that comes with the package.

python tools/library.py MERL RGL [OUT]

MERL is a folder of the 100 tables decoded from neural fits of MERL materials, RGL one of .bsdf files. Each material is
fitted with five lobes, which is best for the space and the prior (decision record 0023). About two minutes.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import dsbrdf
from dsbrdf import library
from dsbrdf.batch import fit_many
from dsbrdf.measured.source import Source
from dsbrdf.space import FIT

SOURCES = {
    "NBRDF-decoded MERL": {
        "what": "tables decoded from published neural fits of the 100 MERL materials, not the measurements",
        "licence": "MIT (the weights of the networks)",
        "citation": "A. Sztrajman, G. Rainer, T. Ritschel, T. Weyrich, Neural BRDF representation and importance "
        "sampling, Computer Graphics Forum 40(6), 2021; of W. Matusik et al., A data-driven reflectance model, "
        "SIGGRAPH 2003",
    },
    "RGL": {
        "what": "measured files of the RGL material database",
        "licence": "CC0",
        "citation": "J. Dupuy, W. Jakob, An adaptive parameterization for efficient material acquisition and "
        "rendering, SIGGRAPH Asia 2018",
    },
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("merl", type=Path)
    parser.add_argument("rgl", type=Path)
    parser.add_argument(
        "out", type=Path, nargs="?", default=Path(library.__file__).with_name(f"materials{library.SUFFIX}")
    )
    args = parser.parse_args()
    models: list[dsbrdf.DSBRDF] = []
    for folder, pattern, source in (
        (args.merl, "*.binary", "NBRDF-decoded MERL"),
        (args.rgl, "*.bsdf", "RGL"),
    ):
        for outcome in fit_many(sorted(folder.glob(pattern)), strict=True, **FIT):
            recorded = {**outcome.model.source.to_json(), "description": source}
            models.append(outcome.model.replace(source=Source(description=source, recorded=recorded)))
    library.write(args.out, models, SOURCES)
    print(f"{args.out}: {len(models)} materials, {args.out.stat().st_size / len(models):.0f} bytes each")


if __name__ == "__main__":
    main()
