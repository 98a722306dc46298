"""Sphinx configuration of the documentation: `python -m sphinx -W docs OUT`."""

import importlib
import inspect

import dsbrdf

project = "dsbrdf"
author = "The dsbrdf developers"
copyright = author
release = version = dsbrdf.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.viewcode",
]
templates_path = ["_templates"]
html_theme = "furo"
html_title = f"dsbrdf {release}"

# Links to a heading, as in page.md#a-heading, are checked too
myst_heading_anchors = 4
# A single backtick is a name of the package where there is one, and plain code elsewhere
default_role = "py:obj"
autodoc_typehints = "none"
numpydoc_show_class_members = False

#: Modules of the reference, in the order of the layers.
MODULES = ["", ".geometry.half_diff", ".measured", ".model.hemi_epd", ".library", ".space", ".fitting", ".baselines",
           ".shader", ".export", ".plot", ".batch", ".images", ".render", ".view", ".paper", ".comparison"]  # fmt: skip


def names(module: str) -> list[str]:
    """Names that a module shows; those of `dsbrdf` itself are not shown again where they come from."""
    owner = importlib.import_module(module)
    values = {name: getattr(owner, name) for name in owner.__all__}
    face = [] if owner is dsbrdf else [getattr(dsbrdf, name) for name in dsbrdf.__all__]
    return [
        name
        for name, value in values.items()
        if not (inspect.ismodule(value) or any(value is shown for shown in face))
    ]


autosummary_context = {"names": {f"dsbrdf{module}": names(f"dsbrdf{module}") for module in MODULES}}
