"""Measured reflectance, from a file, a database or a formula, as a `MeasuredBRDF` or as `Samples`.

Read `source` (where a measurement came from), `table` (a BRDF tabulated over half and difference angles) and `samples`
(pairs of directions) first. `lookup` evaluates a table between its cells. `read` opens a file of any format with one of
the readers in `formats`. `reflectance` and `built_in` make materials from formulas, `databases` and `_download` fetch
measured ones, and `convert` takes one format to another.
"""

from dsbrdf.measured.formats.merl import MerlFormatError, read_merl, write_merl
from dsbrdf.measured.read import read, read_samples
from dsbrdf.measured.samples import Samples
from dsbrdf.measured.source import Source
from dsbrdf.measured.table import MeasuredBRDF, tabulate

__all__ = [
    "MeasuredBRDF",
    "MerlFormatError",
    "Samples",
    "Source",
    "read",
    "read_merl",
    "read_samples",
    "tabulate",
    "write_merl",
]
