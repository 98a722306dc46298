"""The three spectra of `dsbrdf.export.spectrum`: what they are made of, and how well they keep a colour.

Prints the table that the module holds. Takes two seconds. Needs Mitsuba, for the colour matching functions of the CIE
1931 observer and the illuminant D65.

Least squared slope over nodes every 20 nm, such that the spectra lie in [0, 1], add up to one, and under D65 are the
three primaries of sRGB: the conditions of Mallett and Yuksel, Spectral Primary Decomposition for Rendering with sRGB
Reflectance, EGSR 2019.
"""

import numpy as np
from scipy.optimize import minimize

#: Chromaticities of the primaries.
PRIMARIES = np.array([[0.64, 0.33], [0.30, 0.60], [0.15, 0.06]])
DIGITS = 6


def colour_of_nodes(nodes):
    """Linear sRGB under D65 (3, node) of spectra that are 1 at one node, linear between nodes, constant beyond."""
    import mitsuba as mi

    mi.set_variant("scalar_rgb")
    wavelength = np.arange(360.0, 830.5)
    observer = np.array([mi.cie1931_xyz(float(w)) for w in wavelength]).T
    light = observer * np.array([mi.cie_d65(float(w)) for w in wavelength])
    light /= light[1].sum()
    x, y = PRIMARIES.T
    xyz = np.stack([x / y, np.ones(3), (1.0 - x - y) / y])
    to_rgb = np.linalg.inv(xyz * np.linalg.solve(xyz, light.sum(1)))
    hats = np.stack([np.interp(wavelength, nodes, row) for row in np.eye(len(nodes))], axis=1)
    return to_rgb @ light @ hats


def optimise(colour):
    """Spectra (node, 3)."""
    n = colour.shape[1]
    slope = np.kron(np.eye(3), np.diff(np.eye(n), axis=0))
    # The third spectrum's colour follows from those of the first two and of the sum
    conditions = np.vstack([np.kron(np.eye(3), colour)[:6], np.tile(np.eye(n), 3)])
    wanted = np.concatenate([np.eye(3).ravel()[:6], np.ones(n)])
    result = minimize(
        lambda x: (((slope @ x) ** 2).sum(), 2.0 * slope.T @ (slope @ x)),
        np.full(3 * n, 1.0 / 3.0),
        jac=True,
        bounds=[(0.0, 1.0)] * (3 * n),
        constraints={"type": "eq", "fun": lambda x: conditions @ x - wanted, "jac": lambda _: conditions},
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-13},
    )
    if not result.success:
        raise RuntimeError(result.message)
    red, green, _ = np.clip(result.x.reshape(3, n), 0.0, 1.0).round(DIGITS)
    return np.stack([red, green, (1.0 - red - green).round(DIGITS)], axis=1)


if __name__ == "__main__":
    from dsbrdf.export.spectrum import BASIS, WAVELENGTHS

    colour = colour_of_nodes(WAVELENGTHS)
    basis = optimise(colour)
    print(np.array2string(basis, separator=", ", suppress_small=True))
    print("differs from the package's table by at most", np.abs(basis - BASIS).max())
    print(
        "a colour that went through the spectra is off by at most", np.abs(colour @ BASIS - np.eye(3)).max()
    )
