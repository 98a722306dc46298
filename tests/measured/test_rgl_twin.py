"""The RGL reader against a plain evaluation in double precision, one pair of directions at a time.

It integrates the density of half vectors by the trapezoid rule over its nodes and the point itself, which is exact for
what is linear between nodes, and keeps no tables. Mitsuba, to which `test_rgl.py` compares, has single precision.
"""

import numpy as np
import pytest

from dsbrdf.measured.formats.rgl import read_rgl
from dsbrdf.measured.formats.tensor_file import read_tensor_file

NAMES = (
    "aurora_white",
    "cc_ibiza_sunset",
    "chm_orange",
    "ilm_solo_m_68",
    "irid_flake_paint1",
    "vch_silk_blue",
)


def mixed(fields, name, theta_i):
    """A table (incident, ...) between its two nearest incident angles."""
    nodes, table = fields["theta_i"].astype(float), fields[name][0].astype(float)
    k = min(max(int(np.searchsorted(nodes, theta_i)), 1), len(nodes) - 1)
    share = (theta_i - nodes[k - 1]) / (nodes[k] - nodes[k - 1])
    return table[k - 1] * (1 - share) + table[k] * share


def along(row, x):
    """A row of nodes over [0, 1], linear in between."""
    return np.interp(x, np.linspace(0, 1, len(row)), row)


def integral(row, end):
    """Integral of such a row from 0 to `end`."""
    nodes = np.linspace(0, 1, len(row))
    points = np.append(nodes[nodes < end], end)
    return np.trapezoid(along(row, points), points)


def bilinear(table, x, y):
    return along([along(row, x) for row in table], y)


def twin(fields, wi, wo):
    """Reflectance times the cosine of `wo`."""
    theta_i = np.arccos(wi[2])
    half = (wi + wo) / np.linalg.norm(wi + wo)
    u = np.sqrt(2 * np.arccos(half[2]) / np.pi)
    v = (np.arctan2(half[1], half[0]) - np.arctan2(wi[1], wi[0])) / (2 * np.pi) + 0.5
    v -= np.floor(v)

    # Each density integrates to one before they are mixed
    unit = np.array(
        [d / integral([integral(row, 1) for row in d], 1) for d in fields["vndf"][0].astype(float)]
    )
    density = mixed({"theta_i": fields["theta_i"], "vndf": unit[None]}, "vndf", theta_i)
    rows = [integral(row, 1) for row in density]
    t = integral(rows, v) / integral(rows, 1)
    at_v = [along(column, v) for column in density.T]
    s = integral(at_v, u) / integral(at_v, 1)

    value = np.array([bilinear(channel, s, t) for channel in mixed(fields, "rgb", theta_i)])
    sigma = along(fields["sigma"][0].astype(float), np.sqrt(2 * theta_i / np.pi))
    return value * along(fields["ndf"][0].astype(float), u) / (4 * sigma)


@pytest.mark.shared
@pytest.mark.parametrize("name", NAMES)
def test_values_are_those_of_the_twin(data, rng, name):
    path = data / "data" / "rgl" / f"{name}_rgb.bsdf"
    fields, brdf = read_tensor_file(path), read_rgl(path)
    z, phi = rng.uniform(0.1, 1.0, (2, 30)), rng.uniform(-np.pi, np.pi, (2, 30))
    radius = np.sqrt(1.0 - z**2)
    wi, wo = np.stack([radius * np.cos(phi), radius * np.sin(phi), z], axis=-1)
    # Half of them near the mirror direction, where values are large
    wo[::2] = wi[::2] * [-1, -1, 1] + rng.normal(0.0, 0.05, (15, 3))
    wo[:, 2] = np.abs(wo[:, 2])
    wo /= np.linalg.norm(wo, axis=-1, keepdims=True)
    expected = np.array([twin(fields, *pair) for pair in zip(wi, wo, strict=True)])
    value = brdf.eval(wi, wo) * wo[:, 2:]
    np.testing.assert_allclose(value, expected, rtol=1e-7, atol=1e-10 * np.abs(expected).max())
