"""The `dsbrdf` command, one module a subcommand: parse, call, print.

Numeric modules are imported where they are used, so that help comes at once.
"""

# In the order of the help
from dsbrdf.cli import demo, fit, info, check, view, render, photo, export, convert  # noqa: F401  # isort: skip
from dsbrdf.cli import library, space, plan, data, compare, paper  # noqa: F401  # isort: skip
from dsbrdf.cli._app import app, main

__all__ = ["app", "main"]
