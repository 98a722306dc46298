"""Exported files in the programs they are for. Not part of the default run: each needs a program.

    pytest tests/programs

MaterialX, USD and Slang are Python packages (materialx, usd-core, slangpy) and may be in another environment, whose
interpreter DSBRDF_PROGRAMS names; DSBRDF_BLENDER names one that has bpy; DSBRDF_NODE names a folder where npm has
installed gltf-validator and three. What is not there is skipped.
"""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from by_hand import by_hand
from pairs import TINY, random_pairs

import dsbrdf
from dsbrdf.export import blender, export, preview

HERE = Path(__file__).parent
MODELS = {
    "copper": by_hand([0.8, 0.5], [30.0, 8.0], [-0.4, 0.3], tint=(1.2, 0.9, 0.4), name='copper "2" \\'),
    "plastic": by_hand([2.0, 0.15, 0.4], [300.0, 0.3, 30.0], [0.3, -0.2, 0.1], name="plastic"),
    "grey": by_hand([0.5], [3.0], [0.0], tint=(1.0,), name="grey"),
}


def run(*command, cwd=None):
    done = subprocess.run([*map(str, command)], capture_output=True, text=True, check=False, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def interpreter(variable, module):
    """A Python that has a module, or a skipped test."""
    python = os.environ.get(variable, sys.executable)
    if subprocess.run([python, "-c", f"import {module}"], capture_output=True, check=False).returncode:
        pytest.skip(f"{python} has no {module}; {variable} names one that has")
    return python


@pytest.fixture(params=MODELS)
def model(request):
    return MODELS[request.param]


def test_gltf(model, tmp_path):
    folder = os.environ.get("DSBRDF_NODE")
    if not folder:
        pytest.skip("DSBRDF_NODE names no folder")
    for name in ("gltf", "glb"):
        export(model, tmp_path / f"x.{name}", name)
    run("node", HERE / "check_gltf.mjs", tmp_path / "x.gltf", tmp_path / "x.glb", cwd=folder)


MATERIALX = """
import sys, MaterialX as mx
from MaterialX import PyMaterialXGenGlsl as glsl, PyMaterialXGenShader as generate
document = mx.createDocument()
mx.readFromXmlFile(document, sys.argv[1])
library = mx.createDocument()
mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), library)
document.importLibrary(library)
valid, message = document.validate()
assert valid, message
(material,) = generate.findRenderableElements(document)
generator = glsl.EsslShaderGenerator.create()
context = generate.GenContext(generator)
context.registerSourceCodeSearchPath(mx.getDefaultDataSearchPath())
made = generator.generate(material.getName(), material, context)
print(made.getSourceCode("pixel").count("\\n"))
"""


def test_openpbr(model, tmp_path):
    """The document is valid, and MaterialX makes a shader of it."""
    python = interpreter("DSBRDF_PROGRAMS", "MaterialX")
    export(model, tmp_path / "x.mtlx", "openpbr")
    assert int(run(python, "-c", MATERIALX, tmp_path / "x.mtlx")) > 100


USD = """
import sys
from pxr import Usd, UsdShade, UsdValidation
stage = Usd.Stage.Open(sys.argv[1])
every = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
errors = UsdValidation.ValidationContext(every).Validate(stage)
assert not errors, [error.GetMessage() for error in errors]
material, _ = UsdShade.MaterialBindingAPI(stage.GetPrimAtPath("/World/Sphere")).ComputeBoundMaterial()
surface, *_ = material.ComputeSurfaceSource()
assert surface.GetShaderId() == "UsdPreviewSurface"
print(surface.GetInput("roughness").Get())
"""


def test_usd(model, tmp_path):
    python = interpreter("DSBRDF_PROGRAMS", "pxr")
    export(model, tmp_path / "x.usda", "usd")
    assert 0.0 < float(run(python, "-c", USD, tmp_path / "x.usda")) <= 1.0


def test_blender(model, tmp_path):
    """A picture of Cycles under one lamp against sums of our own: the colour of every pixel but the rim's."""
    python = interpreter("DSBRDF_BLENDER", "bpy")
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("scalar_rgb")
    export(model, tmp_path / "x.py", "blender")
    run(python, HERE / "blender_picture.py", tmp_path / "x.py", tmp_path / "x.exr")
    bitmap = mi.Bitmap(str(tmp_path / "x.exr")).convert(
        mi.Bitmap.PixelFormat.RGBA, mi.Struct.Type.Float32, False
    )
    found = np.array(bitmap)
    material, _ = preview.fit_preview(model, blender.FORM)
    wanted = sphere_picture(material, (-0.5, 0.6, 0.7), 2.0, len(found))
    inside = np.isfinite(wanted).all(-1) & (found[..., 3] > 0.999)
    assert inside.sum() > 1000
    error = np.abs(found[..., :3] - wanted)[inside] / (wanted[inside] + 0.02)
    assert np.median(error) < 0.02
    assert np.quantile(error, 0.9) < 0.1


def sphere_picture(material, lamp, irradiance, size):
    """Radiance (size, size, 3) of a unit sphere, NaN beside it and near its rim, as `blender_picture.py` has it."""
    at = ((np.arange(size) + 0.5) / size * 2.0 - 1.0) * np.tan(np.deg2rad(13.0))
    x, y = np.meshgrid(at, -at)
    ray = np.stack([x, y, -np.ones_like(x)], axis=-1)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    origin = np.array([0.0, 0.0, 5.4])
    b = ray @ origin
    root = b * b - origin @ origin + 1.0
    point = origin + (-b - np.sqrt(np.maximum(root, 0.0)))[..., None] * ray
    z, view = point / np.linalg.norm(point, axis=-1, keepdims=True), -ray
    x_axis = np.cross(np.array([0.0, 1.0, 0.0]), z)
    x_axis /= np.linalg.norm(x_axis, axis=-1, keepdims=True)
    y_axis = np.cross(z, x_axis)
    toward = np.array(lamp) / np.linalg.norm(lamp)
    wi = np.stack([(axis * toward).sum(-1) for axis in (x_axis, y_axis, z)], axis=-1)
    wo = np.stack([(axis * view).sum(-1) for axis in (x_axis, y_axis, z)], axis=-1)
    values = material.eval(wi, wo) * np.maximum(wi[..., 2:], 0.0) * irradiance
    good = (root > 0.0) & (wo[..., 2] > 0.25)
    return np.where(good[..., None], values, np.nan)


def test_slang_and_hlsl(tmp_path, rng):
    """Slang compiles both: values, densities, and Slang's derivative against JAX's."""
    import jax
    from jax import numpy as jnp

    python = interpreter("DSBRDF_PROGRAMS", "slangpy")
    model = MODELS["plastic"]
    wi, wo = random_pairs(rng, 2000)
    np.savez(tmp_path / "pairs.npz", wi=wi, wo=wo)
    with jax.enable_x64(True):
        lobes = dataclasses.replace(model.lobes)

        def total(a, b):
            return dsbrdf.model.evaluation.evaluate_any(lobes, a[None], b[None]).sum()

        expected = np.asarray(jax.vmap(jax.grad(total))(jnp.array(wi), jnp.array(wo)))
    for language in ("slang", "hlsl"):
        code, out = tmp_path / f"x.{language}", tmp_path / f"{language}.npz"
        export(model, code, language)
        run(python, HERE / "slang_values.py", code, tmp_path / "pairs.npz", out)
        got = np.load(out)
        np.testing.assert_allclose(got["values"][:, :3], model.eval(wi, wo), rtol=1e-3, atol=TINY)
        np.testing.assert_allclose(got["values"][:, 3], model.pdf(wi, wo), rtol=1e-3)
    slope = np.load(tmp_path / "slang.npz")["slope"]
    scale = np.linalg.norm(expected, axis=1, keepdims=True) + 1e-6
    error = (np.abs(slope - expected) / scale).max(1)
    # Within a tenth of a degree of the pole, a part of the pairs, single precision does not tell phi_d
    assert np.median(error) < 1e-5
    assert np.quantile(error, 0.9) < 0.01
