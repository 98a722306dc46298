"""What the compiled kernel says of its build, and how it takes and gives arrays."""

import numpy as np
import pytest

from dsbrdf import __version__, _core


def test_build_info():
    info = _core.build_info()
    assert info["version"] == __version__
    assert info["compiler"].startswith("rustc 1.")
    assert info["profile"] in ("release", "debug")
    assert info["target"].count("-") >= 2
    assert info["threads"] >= 1
    assert info["vectors"]


def test_other_types_of_numbers_are_refused():
    for other in ("float32", "int64", ">f8", "complex128"):
        with pytest.raises(
            TypeError, match=r"of another kind is needed: (buffer contents are not|.* big-endian)"
        ):
            _core.first_not_unit(np.ones((2, 3), other), 1e-3)
    with pytest.raises(TypeError, match="an array of another kind is needed"):
        _core.first_not_unit([[0.0, 0.0, 1.0]], 1e-3)


def test_strides_are_refused_and_nothing_is_contiguous():
    with pytest.raises(ValueError, match="'directions' must be C-contiguous"):
        _core.first_not_unit(np.ones((4, 6))[:, ::2], 1e-3)
    with pytest.raises(ValueError, match="'directions' must be C-contiguous"):
        _core.first_not_unit(np.ones((3, 4)).T, 1e-3)
    assert _core.first_not_unit(np.ones((4, 6))[:0, ::2], 1e-3) is None


def test_what_is_read_only_is_read():
    directions = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]])
    directions.flags.writeable = False
    assert _core.first_not_unit(directions, 1e-3) == 1


def test_arrays_made_are_their_own():
    y = np.array([1.0, 3.0, 2.0])
    found = _core.decreasing(y, np.ones(3))
    assert found.dtype == np.float64
    assert found.flags.owndata
    assert found.flags.writeable
    np.testing.assert_array_equal(found, [2.0, 2.0, 2.0])
    assert _core.decreasing(np.empty(0), np.empty(0)).shape == (0,)
