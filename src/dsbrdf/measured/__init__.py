"""Measured reflectance: one reader a file format, all giving a `MeasuredBRDF` or `Samples`."""

from dsbrdf.measured.brdf import MeasuredBRDF, Source, tabulate
from dsbrdf.measured.merl import MerlFormatError, read_merl, write_merl
from dsbrdf.measured.read import read, read_samples
from dsbrdf.measured.samples import Samples

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
