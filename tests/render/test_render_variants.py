"""Choosing a variant of Mitsuba: what is missing is said, and nothing aborts."""

import os
import subprocess
import sys
from pathlib import Path

import drjit as dr
import mitsuba as mi
import pytest

from dsbrdf import render
from dsbrdf.render import variants

#: Versions that Dr.Jit accepts, and with which it then aborts.
ABORTING = sorted(Path("/usr/lib").glob("*/libLLVM-1[56].so"))


def run(code, **environment):
    """Output of Python code in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**os.environ, **environment},
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_without_mitsuba(monkeypatch):
    monkeypatch.setitem(sys.modules, "mitsuba", None)
    with pytest.raises(ModuleNotFoundError, match=r"needs Mitsuba 3: pip install 'dsbrdf\[render\]'"):
        variants.choose()


def test_the_package_is_imported_without_mitsuba():
    out = run("import sys; sys.modules['mitsuba'] = None; import dsbrdf.render; print('fine')")
    assert out == "fine\n"


def test_other_variants_are_refused():
    out = run(
        "import mitsuba as mi; from dsbrdf import render\n"
        "for variant in (None, 'scalar_rgb', 'llvm_ad_spectral'):\n"
        "    if variant: mi.set_variant(variant)\n"
        "    try: render.register()\n"
        "    except render.RenderError as error: print(error)\n"
    )
    first, second, third = out.splitlines()
    assert "no variant of Mitsuba is set" in first
    assert "not in scalar_rgb: set one of these, or load a file written by dsbrdf export" in second
    assert "not in llvm_ad_spectral" in third


@pytest.mark.parametrize("version", [(15, 0, 6), (16, 0, 1)])
def test_llvm_that_would_abort(monkeypatch, version):
    render.choose("llvm_ad_rgb")
    monkeypatch.setattr(dr.detail, "llvm_version", lambda: version)
    with pytest.raises(
        render.RenderError, match=r"LLVM 1\d.*aborts the process: install LLVM 17 .*libllvm19"
    ):
        render.register()
    with pytest.raises(render.RenderError, match="DRJIT_LIBLLVM_PATH"):
        render.choose("llvm_ad_rgb")
    try:
        with pytest.warns(UserWarning, match="rendering in scalar_rgb, which is slow: Dr.Jit found LLVM 1"):
            assert render.choose() == "scalar_rgb"
    finally:
        mi.set_variant("llvm_ad_rgb")


def test_a_process_survives_libraries_that_abort():
    """With the real libraries, where this machine has them."""
    code = (
        "from dsbrdf import DSBRDF, Lobes, render\n"
        "import numpy as np\n"
        "try: render.choose('llvm_ad_rgb')\n"
        "except render.RenderError as error: print(error)\n"
        "print(render.choose())\n"
        "from dsbrdf.render.scene import View, render as picture\n"
        "one = np.ones((1, 1))\n"
        "model = DSBRDF(Lobes(one, one, 0 * one, 0 * one, np.zeros((3, 1, 1))))\n"
        "print(picture(model, View(size=4, spp=4)).max() > 0.0)\n"
    )
    for library in ABORTING or [Path("/no/such/libLLVM.so")]:
        first, variant, lit = run(code, DRJIT_LIBLLVM_PATH=str(library)).splitlines()[-3:]
        assert "cannot render in llvm_ad_rgb" in first
        assert "libllvm19" in first
        assert variant == "scalar_rgb"
        assert lit == "True"


def test_a_working_variant_stays():
    mi.set_variant("llvm_ad_rgb")
    assert render.choose() == "llvm_ad_rgb"
    assert variants.missing_plugin() == ""


def test_unknown_variant():
    with pytest.raises(render.RenderError, match="cannot render in llvm_rgb"):
        render.choose("llvm_rgb")
