"""Measured reflectance: one reader a file format, all giving a `MeasuredBRDF`."""

from dsbrdf.measured.brdf import MeasuredBRDF, Source, tabulate
from dsbrdf.measured.merl import MerlFormatError, read_merl, write_merl
from dsbrdf.measured.read import read

__all__ = ["MeasuredBRDF", "MerlFormatError", "Source", "read", "read_merl", "tabulate", "write_merl"]
