"""Variances and scores of an FPCA by scikit-fda, written to `fpca.json` beside this file.

Run with `python tests/reference/fpca.py`; it needs scikit-fda 0.10 with multimethod below 2.1, and takes ten seconds.

scikit-fda has no weights of functions: the curves are scaled by the roots of those of Eq. (7).
"""

import json
from pathlib import Path

import numpy as np
from skfda.preprocessing.dim_reduction import FPCA
from skfda.representation.basis import BSplineBasis, FDataBasis, VectorValuedBasis

N, DOMAIN = 25, (0.0, np.pi / 2)


def main() -> None:
    rng = np.random.default_rng(2011)
    curves = (1.0 + rng.normal(size=(N, 2, 6)) * [1.0, 0.5, 0.5, 0.3, 0.4, 1.0]) * [[0.7], [300.0]]
    basis = BSplineBasis(DOMAIN, n_basis=6, order=3)
    mean = curves.mean(0)
    scale = 1.0 / np.sqrt(np.einsum("fc,cd,fd->f", mean, basis.gram_matrix(), mean))
    scaled = FDataBasis(VectorValuedBasis([basis, basis]), (curves * scale[:, None]).reshape(N, -1))
    fpca = FPCA(n_components=12)
    scores = fpca.fit_transform(scaled)
    content = {
        "curves": curves.tolist(),
        "variances": fpca.explained_variance_.tolist(),
        "scores": scores.tolist(),
    }
    Path(__file__).with_suffix(".json").write_text(json.dumps(content) + "\n")


if __name__ == "__main__":
    main()
