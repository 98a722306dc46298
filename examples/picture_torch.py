"""A material from a picture, through a renderer of your own in PyTorch: scores of the space by gradient descent.

    python examples/picture_torch.py

The renderer is three lines: a sphere in a few distant lights.
"""

import array_api_compat.torch as xp
import numpy as np
import torch

import dsbrdf
from dsbrdf.model.evaluation import evaluate
from dsbrdf.space import from_scores

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
target = torch.log(torch.as_tensor(picture) + 1e-3)
wi, wo, cosine, deviations = map(torch.as_tensor, (wi, wo, cosine, np.sqrt(space.fpca.variances[:30])))

z = torch.zeros(30, dtype=torch.float64, requires_grad=True)
adam = torch.optim.Adam([z], lr=0.1)
for _ in range(150):
    adam.zero_grad()
    # Squared errors of the logarithm, and the prior: z are scores in standard deviations
    made = (evaluate(from_scores(space, z * deviations, xp), wi, wo) * cosine).sum(0)
    value = 100.0 * torch.mean((torch.log(made + 1e-3) - target) ** 2) + 0.02 * torch.sum(z**2)
    value.backward()
    adam.step()
found = space.model((z * deviations).detach().numpy(), "found")
nearest = [name for name, _ in space.nearest(found, 3)]
print(f"loss {value:.3f}; nearest: {', '.join(nearest)}")
