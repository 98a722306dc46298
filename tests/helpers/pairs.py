"""Pairs of directions in single precision, and how near to Python what runs on a graphics processor comes."""

import numpy as np

#: In 1/sr. Next to a slice whose value is next to nothing, single precision blurs the share of the other slice.
TINY = 1e-8
DECODED = ("nickel", "specular-blue-phenolic", "chrome")


def hemisphere(rng, n):
    z, phi = rng.random(n), 2.0 * np.pi * rng.random(n)
    return np.stack([np.sqrt(1.0 - z * z) * np.cos(phi), np.sqrt(1.0 - z * z) * np.sin(phi), z], axis=-1)


def random_pairs(rng, n=20000):
    """Directions in single precision: half of them anywhere, half with a half vector 0.0001 to 1 from the normal."""
    wi, wo = hemisphere(rng, n), hemisphere(rng, n)
    near = n // 2
    tilt = 10.0 ** rng.uniform(-4.0, 0.0, (near, 1)) * rng.standard_normal((near, 2))
    half = np.concatenate([tilt, np.ones((near, 1))], axis=-1)
    half /= np.linalg.norm(half, axis=-1, keepdims=True)
    mirrored = 2.0 * (half * wo[:near]).sum(-1, keepdims=True) * half - wo[:near]
    wi[:near] = np.where(mirrored[:, 2:] > 0.0, mirrored, wi[:near])
    return wi.astype(np.float32).astype(float), wo.astype(np.float32).astype(float)
