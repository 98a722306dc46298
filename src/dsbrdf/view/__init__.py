"""The web page: materials to look at, in one self-contained HTML file."""

from dsbrdf.view.page import frame, page, view

__all__ = ["frame", "page", "view"]
