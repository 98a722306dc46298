"""A sphere of the web page in a tab of its own, for tests, and the geometry of its picture."""

import contextlib
import functools
import json
import warnings

import numpy as np
from browser import material_json, open_modules, watched

import dsbrdf
from dsbrdf import shader

N = 48
#: As in renderer.js: distance of the viewer in radii, share of the picture that the sphere takes.
DISTANCE, COVER = 5.0, 0.88
HALF_WIDTH = 1.0 / np.sqrt(DISTANCE**2 - 1.0) / COVER
POINT_LIGHT = np.array([-0.5, 0.5, np.sqrt(0.5)])

SET_UP = """
async ([shaders, materials, size]) => {
    const { Sphere } = await import("/sphere.js");
    const typed = (material) => {
        for (const key of ["scale", "gamma", "beta", "falloff", "colour"]) {
            material[key] = new Float32Array(material[key]);
        }
        return material;
    };
    window.materials = materials.map(typed);
    window.canvas = document.createElement("canvas");
    canvas.width = canvas.height = size;
    document.body.append(canvas);
    window.errors = [];
    window.sphere = new Sphere(canvas, shaders, { onError: (text) => errors.push(text) });
    sphere.maxSamples = 1e6;
    sphere.setMaterials(window.materials[0]);
}
"""
CONVERGE = """
async (n) => {
    sphere.nPairs = Math.min(n, 32);
    while (sphere.nSamples < n) {
        sphere.render();
        sphere.meanPixel();
        await new Promise((resolve) => setTimeout(resolve));
    }
    return Array.from(sphere.pixels().data);
}
"""


def quiet_fit(measured, n_lobes="auto"):
    """`fit` where running out of iterations is not the point."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", dsbrdf.ConvergenceWarning)
        return dsbrdf.fit(measured, n_lobes)


@functools.cache
def model_of(name, n_lobes):
    """The model of a built-in material, fitted once."""
    return quiet_fit(dsbrdf.material(name), n_lobes).model


def fitted(*names):
    """Models of built-in materials by name."""
    return {name: model_of(name, 3) for name in names}


@contextlib.contextmanager
def shown(browser, models):
    """Call what this gives with names of models: a tab with `sphere`, `materials`, `canvas` and `errors`.

    At the end the tabs are closed, and none may have complained.
    """
    pages = []

    def call(*names, size=N, script=None):
        page = open_modules(browser, before=script)
        pages.append((page, watched(page)))
        page.evaluate(SET_UP, [shader.sources(), [material_json(models[name]) for name in names], size])
        return page

    yield call
    for page, errors in pages:
        page.close()
        assert not errors


def picture(page, n_samples, size=N):
    return np.reshape(page.evaluate(CONVERGE, n_samples), (size, size, 3))


def inside(size=N, margin=1.0):
    y, x = np.mgrid[:size, :size] + 0.5 - size / 2
    return np.hypot(x, y) < COVER * size / 2 - margin


def hit(rows, columns, size=N, n_sub=3):
    """Normals and directions toward the viewer (pixel, place in it, 3) of pixels."""
    sub = (np.arange(n_sub) + 0.5) / n_sub
    down, right = (grid.ravel() for grid in np.meshgrid(sub, sub, indexing="ij"))
    x = (2.0 * (columns[:, None] + right) / size - 1.0) * HALF_WIDTH
    y = (1.0 - 2.0 * (rows[:, None] + down) / size) * HALF_WIDTH
    ray = np.stack([x, y, -np.ones_like(x)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    along = -DISTANCE * ray[..., 2]
    point = np.array([0.0, 0.0, DISTANCE]) + (along - np.sqrt(along**2 - DISTANCE**2 + 1.0))[..., None] * ray
    return point / np.linalg.norm(point, axis=-1, keepdims=True), -ray


def frame(normal):
    """Rows tangent, bitangent and normal."""
    helper = np.array([0.0, 1.0, 0.0]) if abs(normal[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    tangent = np.cross(helper, normal)
    tangent /= np.linalg.norm(tangent)
    return np.stack([tangent, np.cross(normal, tangent), normal])


def environment_pixels(page):
    # As text: the driver hands over a list number by number
    script = "const p = sphere.environmentPixels(); return JSON.stringify([p.width, p.height, Array.from(p.data)]);"
    width, height, data = json.loads(page.evaluate(f"(() => {{ {script} }})()"))
    return np.reshape(data, (height, width, 4))[..., :3]
