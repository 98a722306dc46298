"""Make the relative links of a page absolute, for places that show it alone, as PyPI does the README.

    python tools/absolute_links.py README.md https://github.com/OWNER/NAME REF

The page is changed in place. Pictures become `URL/raw/REF/PATH`, other files `URL/blob/REF/PATH`; the paths are from
the root of the repository.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

LINK = re.compile(r"(!?)\[((?:!\[[^\]]*\]\([^)]*\)|[^\]])*)\]\((?![a-z]+:|#)([^)]+)\)")


def absolute(text: str, url: str, ref: str) -> str:
    """Markdown whose links to files of the repository are absolute."""

    def replaced(found: re.Match[str]) -> str:
        picture, label, path = found.groups()
        kind = "raw" if picture else "blob"
        # A picture may be what is shown of a link
        return f"{picture}[{LINK.sub(replaced, label)}]({url.rstrip('/')}/{kind}/{ref}/{path})"

    return LINK.sub(replaced, text)


def main() -> None:
    page, url, ref = sys.argv[1:]
    path = Path(page)
    path.write_text(absolute(path.read_text(encoding="utf-8"), url, ref), encoding="utf-8")


if __name__ == "__main__":
    main()
