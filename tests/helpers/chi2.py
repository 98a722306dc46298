"""The package's chi-square test, under its name in the tests."""

from dsbrdf.model.chi_square import CELLS, cell_integrals, counts, direction, p_value, sidak

__all__ = ["CELLS", "cell_integrals", "counts", "direction", "p_value", "sidak"]
