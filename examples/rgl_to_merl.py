"""Convert RGL files to MERL files that other programs read, and say what that loses.

Run as `python examples/rgl_to_merl.py FILE.bsdf [...]`.
"""

import sys
from pathlib import Path

from dsbrdf.export.convert import convert


def main():
    """Write each file as MERL `.binary` in the current folder."""
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    for path in map(Path, sys.argv[1:]):
        print(convert(path, f"{path.stem}.binary"))


if __name__ == "__main__":
    main()
