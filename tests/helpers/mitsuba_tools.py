"""Mitsuba for the tests: the compiled variant, pairs of directions, and the domain of its chi-square test."""

import drjit as dr
import mitsuba as mi
import numpy as np

from dsbrdf import render

VARIANT = "llvm_ad_rgb"


def compiled():
    """Set the compiled variant, with the plugins."""
    render.choose(VARIANT)
    render.register()


def load(reflectance):
    return mi.load_dict(render.to_dict(reflectance))


def vectors(array):
    return mi.Vector3f(np.ascontiguousarray(np.atleast_2d(array).T, dtype=np.float32))


def interaction(wi):
    wi = vectors(wi)
    si = dr.zeros(mi.SurfaceInteraction3f, dr.width(wi))
    si.wi = wi
    return si


def evaluate(bsdf, wi, wo):
    """Values without the cosine (n, 3), and densities (n,)."""
    value, density = bsdf.eval_pdf(mi.BSDFContext(), interaction(wi), vectors(wo))
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.array(value).T / np.atleast_2d(wo)[:, 2:], np.array(density)


def draw(bsdf, wi, rng, n):
    """Directions (n, 3), densities (n,) and weights (n, 3) for one direction."""
    numbers = rng.random((3, n), dtype=np.float32)
    si = interaction(np.broadcast_to(wi, (n, 3)))
    record, weight = bsdf.sample(mi.BSDFContext(), si, mi.Float(numbers[0]), mi.Point2f(numbers[1:]))
    return np.array(record.wo).T.astype(float), np.array(record.pdf), np.array(weight).T


class MirrorDomain:
    """The upper hemisphere with cells that shrink toward a direction at azimuth pi, to resolve near-mirrors."""

    POWER = 4

    def __init__(self, theta):
        self.theta = float(theta)

    def bounds(self):
        return mi.ScalarBoundingBox2f([-1.0, 0.0 if self.theta == 0.0 else -1.0], [1.0, 1.0])

    def aspect(self):
        return 1

    def _polar(self, y):
        room = dr.select(y < 0.0, self.theta, 0.5 * dr.pi - self.theta)
        return self.theta + room * dr.sign(y) * dr.abs(y) ** self.POWER, room * dr.abs(y) ** (self.POWER - 1)

    def map_forward(self, p):
        theta, _ = self._polar(p.y)
        phi = dr.pi * (1.0 + dr.sign(p.x) * dr.abs(p.x) ** self.POWER)
        sin, cos = dr.sincos(theta)
        sin_phi, cos_phi = dr.sincos(phi)
        return mi.Vector3f(sin * cos_phi, sin * sin_phi, cos)

    def map_backward(self, w):
        theta = dr.atan2(dr.sqrt(w.x * w.x + w.y * w.y), w.z) - self.theta
        room = dr.select(theta < 0.0, max(self.theta, 1e-6), 0.5 * dr.pi - self.theta)
        x = dr.atan2(-w.y, -w.x) / dr.pi
        x, y = (dr.sign(a) * dr.minimum(dr.abs(a), 1.0) ** (1.0 / self.POWER) for a in (x, theta / room))
        return mi.Vector2f(x, dr.maximum(y, 0.0 if self.theta == 0.0 else -1.0))

    def jacobian(self, w):
        """Solid angle for an area of the domain."""
        p = self.map_backward(w)
        theta, polar = self._polar(p.y)
        return dr.sin(theta) * self.POWER**2 * polar * dr.pi * dr.abs(p.x) ** (self.POWER - 1)


def chi2_test(bsdf, theta_i, of_density=None, n=200_000):
    """Mitsuba's chi-square test of `sample` against `pdf`, or against that of another bsdf."""
    domain, context = MirrorDomain(theta_i), mi.BSDFContext()
    wi = [float(np.sin(theta_i)), 0.0, float(np.cos(theta_i))]

    def sample(numbers):
        si = dr.zeros(mi.SurfaceInteraction3f, n)
        si.wi = mi.Vector3f(*wi)
        record, _ = bsdf.sample(context, si, numbers[0], mi.Point2f(numbers[1], numbers[2]))
        lit = (record.wo.z > 0.0) & (record.pdf > 0.0)
        return dr.select(lit, record.wo, mi.Vector3f(0.0, 0.0, 1.0)), dr.select(lit, 1.0, 0.0)

    def density(wo):
        si = dr.zeros(mi.SurfaceInteraction3f, dr.width(wo))
        si.wi = mi.Vector3f(*wi)
        return (of_density or bsdf).pdf(context, si, wo) * domain.jacobian(wo)

    return mi.chi2.ChiSquareTest(domain, sample, density, sample_dim=3, sample_count=n, res=61, ires=10)
