"""A material from a picture, through a renderer of your own in JAX: scores of the space by gradient descent.

    python examples/picture_jax.py

The renderer is three lines: a sphere in a few distant lights.
"""

import jax
import jax.numpy as jnp
import numpy as np

import dsbrdf
from dsbrdf.model.evaluation import evaluate
from dsbrdf.space import from_scores

jax.config.update("jax_enable_x64", True)
space = dsbrdf.space.builtin(without=["blue-rubber"])
truth = dsbrdf.library.load("blue-rubber")

# Directions toward light and camera in the frame of each point of a sphere
x, y = np.meshgrid(np.linspace(-0.9, 0.9, 12), np.linspace(-0.9, 0.9, 12))
normal = np.stack([x, y, np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))], axis=-1)[x**2 + y**2 < 0.9]
across = np.cross(normal, [0.3, 0.5, 0.8])
across /= np.linalg.norm(across, axis=-1, keepdims=True)
frame = np.stack([across, np.cross(normal, across), normal], axis=1)
lights = np.array([[0.0, 0.6, 0.8], [0.8, 0.0, 0.6], [-0.6, -0.48, 0.64], [0.0, 0.96, -0.28]])
wi, wo = np.einsum("nij,lj->lni", frame, lights), frame[..., 2]
cosine = np.maximum(wi[..., 2:], 0.0)
picture = (np.asarray(truth.eval(wi, wo)) * cosine).sum(0)
deviations = jnp.asarray(np.sqrt(space.fpca.variances[:30]))


def loss(z):
    """Squared errors of the logarithm, and the prior: z are scores in standard deviations."""
    lobes = from_scores(space, z * deviations, jnp)
    made = (evaluate(lobes, jnp.asarray(wi), jnp.asarray(wo)) * cosine).sum(0)
    return 100.0 * jnp.mean((jnp.log(made + 1e-3) - jnp.log(picture + 1e-3)) ** 2) + 0.02 * jnp.sum(z**2)


step = jax.jit(jax.value_and_grad(loss))
z, speed, size = jnp.zeros(30), jnp.zeros(30), jnp.zeros(30)
for i in range(1, 151):  # Adam
    value, slope = step(z)
    speed, size = 0.9 * speed + 0.1 * slope, 0.99 * size + 0.01 * slope**2
    z = z - 0.1 * (speed / (1 - 0.9**i)) / (jnp.sqrt(size / (1 - 0.99**i)) + 1e-8)
found = space.model(np.asarray(z * deviations), "found")
nearest = [name for name, _ in space.nearest(found, 3)]
print(f"loss {value:.3f}; nearest: {', '.join(nearest)}")
