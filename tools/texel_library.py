"""Make the materials of few lobes that the prior of textures is made of.

python tools/texel_library.py MERL RGL [OUT]

MERL is a folder of the 100 tables decoded from neural fits of MERL materials, RGL one of .bsdf files. Each material is
fitted with two lobes of compact curves (decision record 0026). About a minute of processor time.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from dsbrdf import library
from dsbrdf.batch import fit_many, texels

N_LOBES = 2


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("merl", type=Path)
    parser.add_argument("rgl", type=Path)
    where = Path(texels.__file__).with_name(f"lobes-{N_LOBES}{library.SUFFIX}")
    parser.add_argument("out", type=Path, nargs="?", default=where)
    args = parser.parse_args()
    paths = [*sorted(args.merl.glob("*.binary")), *sorted(args.rgl.glob("*.bsdf"))]
    models = []
    for outcome in fit_many(paths, strict=True, n_lobes=N_LOBES, curves="compact"):
        assert outcome.model is not None
        # What is known of the measurements is in the library of five lobes
        models.append(outcome.model.replace(source=library.load(outcome.model.name).source))
    library.write(args.out, models, library.builtin().sources)
    print(f"{args.out}: {len(models)} materials, {args.out.stat().st_size / len(models):.0f} bytes each")


if __name__ == "__main__":
    main()
