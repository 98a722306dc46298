"""The samplers of the shaders over random models, run by headless Chromium: a white furnace, and against their density.

    PYTHONPATH=tests/fuzz:tests/helpers python tests/fuzz/shaders.py [--models 200]

GLSL (WebGL2) and WGSL (WebGPU) draw from the same numbers. Each model is seen at one of four angles, one after the
other. Prints how many fail, and the extremes. Takes some seconds a model. Slang and HLSL are made line by line from
the same source; nothing here runs them.
"""

import sys

import numpy as np
from browser import chromium, run_glsl, run_wgsl, secure_page
from renders import ANGLES, SIGNIFICANCE, main, random_model
from scipy import stats

from dsbrdf import shader
from dsbrdf.model.chi_square import cell_integrals, p_value, sidak

N_SAMPLES = 100_000
#: By language: what runs it, the expression of a sample, and the type of a vector.
RUNS = {
    "glsl": (run_glsl, "vec4(dsbrdf_sample(a.xyz, b.xyz), 1.0)", "vec4"),
    "wgsl": (run_wgsl, "vec4f(dsbrdf_sample(a.xyz, b.xyz), 1.0)", "vec4f"),
}


def check(seeds):
    """Failures as text, the worst deviation of a furnace in standard deviations, its brightest, the least p-value."""
    failures, worst, brightest, least = [], 0.0, 0.0, 1.0
    n_tests = len(seeds) * len(RUNS)
    significance = sidak(SIGNIFICANCE, n_tests)
    sigmas = float(stats.norm.isf(significance / 6.0))
    with chromium() as browser:
        page = secure_page(browser)
        for seed in seeds:
            model, theta = random_model(seed), ANGLES[seed % len(ANGLES)]
            wo = np.array([np.sin(theta), 0.0, np.cos(theta)])
            u = np.random.default_rng(seed).random((N_SAMPLES, 3), dtype=np.float32)
            toward = np.tile(wo, (N_SAMPLES, 1))
            mass = cell_integrals(lambda wi, m=model, w=wo: m.pdf(wi, w), wo * [-1.0, -1.0, 1.0])
            albedo = model.albedo(theta)
            for language, (run, sample, vector) in RUNS.items():
                where = f"model {seed} at {np.rad2deg(theta):.0f} degrees in {language}"
                code = shader.baked(model, language)
                wi = run(page, code, sample, toward, u)[:, :3]
                both = f"{vector}(dsbrdf_eval(b.xyz, a.xyz), dsbrdf_pdf(b.xyz, a.xyz))"
                values = run(page, code, both, toward, wi)
                above = wi[:, 2] > 0.0
                weight = np.zeros((N_SAMPLES, 3))
                weight[above] = values[above, :3] * wi[above, 2:] / values[above, 3:]
                assert np.isfinite(weight).all(), where
                error = np.maximum(weight.std(0) / np.sqrt(N_SAMPLES), 1e-9)
                # The quadrature is good to a thousandth, shaders round to single precision
                off = np.maximum(np.abs(weight.mean(0) - albedo) - 2e-3 * albedo, 0.0) / error
                bright, p = float((weight.mean(0) - 4.0 * error).max()), p_value(wi, mass)
                worst, brightest, least = max(worst, off.max()), max(brightest, bright), min(least, p)
                if off.max() > sigmas or bright > 1.003:
                    failures.append(
                        f"{where}: furnace off by {off.max():.1f} standard deviations, {bright:.4f}"
                    )
                if p < significance:
                    failures.append(f"{where}: samples do not follow their density, p-value {p:.1e}")
    return failures, worst, brightest, least


if __name__ == "__main__":
    sys.exit(main(check, __doc__, f" in {' and '.join(RUNS)}"))
