"""The search for lobes, in parts."""

import numpy as np

from dsbrdf.fitting import estimator


def test_where_nothing_is_expected_lobes_rise_no_more_than_fresnels_factor(rng):
    sizes, n_lobes = (4, 3, 2, 2, 2), 3
    x = rng.normal(size=n_lobes * sum(sizes[:-1]) + 3 * n_lobes * sizes[-1])
    scale = x[: n_lobes * sum(sizes[:-1])].reshape(n_lobes, -1)[:, : sizes[0]]
    scale[0, :2], scale[1, :2], scale[2, :2] = (6.0, 1.0), (-9.0, 1.0), (-6.9, -7.0)
    ended = estimator._ending_low(x, sizes, n_lobes)
    peaks = np.expm1(np.exp(ended[: n_lobes * sum(sizes[:-1])].reshape(n_lobes, -1)[:, :2]))
    np.testing.assert_allclose(peaks[0, 0] / peaks[0, 1], estimator.RISE)
    changed = np.flatnonzero(ended != x)
    assert changed.tolist() == [0]
