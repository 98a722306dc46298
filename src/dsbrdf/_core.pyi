"""Signatures of the compiled kernel; see crates/dsbrdf-py."""

from typing import Any, Protocol, TypedDict

import numpy as np
from numpy.typing import NDArray

_Floats = NDArray[np.float64]

class _Fit(TypedDict):
    kappa: _Floats
    gamma: _Floats
    beta: _Floats
    objective: list[float]
    iterations: list[int]
    status: list[int]
    em_history: list[list[float]]

class _Solution(TypedDict):
    n_lobes: int
    x: _Floats
    squares: float
    objective: float
    log_det: float
    iterations: int
    converged: bool

class _Build(TypedDict):
    version: str
    target: str
    profile: str
    compiler: str
    vectors: str
    threads: int

class _Options(Protocol):
    sizes: tuple[int, int, int, int, int]
    loss: str
    offset: list[float]
    penalty: tuple[float, float, float]
    n_effective: float

class Observations:
    def __new__(
        cls, ln_cos: _Floats, x: _Floats, azimuth: _Floats, value: _Floats, weight: _Floats
    ) -> Observations: ...
    def __len__(self) -> int: ...
    def thinned(self, n: int) -> Observations: ...
    def grow(self, options: Any, max_lobes: int) -> list[_Solution]: ...
    def refine(
        self,
        options: Any,
        n_lobes: int,
        x: list[float],
        *,
        iterations: int,
        tolerance: float,
        prior: tuple[list[float], list[float]] | None = None,
    ) -> _Solution: ...
    def normal_equations(
        self, options: Any, n_lobes: int, x: list[float]
    ) -> tuple[float, _Floats, _Floats]: ...

def build_info() -> _Build: ...
def collapse(
    bytes: NDArray[np.uint8], shape: list[int], scale: _Floats, cos_2phi: _Floats, theta_d: list[int]
) -> _Floats: ...
def plain_numbers(
    block: bytes, delimiter: int | None, n_columns: int, used: list[int], comma: bool
) -> _Floats | None: ...
def decreasing(y: _Floats, weight: _Floats) -> _Floats: ...
def fit(
    moments: _Floats,
    ln_cos: _Floats,
    factor: _Floats,
    *,
    n_lobes: int,
    method: str,
    azimuthal: bool,
    follow: bool,
    log_offset: float | None,
    max_height: _Floats | None = None,
) -> _Fit: ...
def grow(moments: _Floats, ln_cos: _Floats, n_lobes: int) -> list[tuple[_Floats, _Floats]]: ...
def em(
    moments: _Floats,
    ln_cos: _Floats,
    n_lobes: int,
    *,
    max_rounds: int,
    tolerance: float,
    start: list[tuple[float, float]] | None = None,
) -> tuple[list[tuple[float, float]], list[float], bool]: ...
def eval(
    wi: _Floats,
    wo: _Floats,
    scale: _Floats,
    gamma: _Floats,
    beta: _Floats,
    falloff: _Floats,
    colour: _Floats,
    azimuthal_width: float,
) -> _Floats: ...
def eval_slices(
    wi: _Floats,
    wo: _Floats,
    theta_d: _Floats,
    kappa: _Floats,
    gamma: _Floats,
    beta: _Floats,
    spike: _Floats,
    azimuthal_width: float,
    spike_sin2: float,
) -> _Floats: ...
def first_not_unit(directions: _Floats, tolerance: float) -> int | None: ...
def picture_weights(
    normal: _Floats,
    view: _Floats,
    start: list[int],
    direction: _Floats,
    flux: _Floats,
    radius: _Floats,
    parts: NDArray[np.int32],
    n_roots: int,
    nodes: tuple[int, int],
    azimuthal_width: float,
) -> _Floats: ...

class TexelPlan:
    def __new__(
        cls,
        layout: Any,
        at: tuple[_Floats, ...],
        cell: list[int],
        cos_product: list[float],
        weighing: Any,
        prior: tuple[list[float], list[float]],
        starts: _Floats,
        reference: tuple[_Floats, ...],
        iterations: int,
    ) -> TexelPlan: ...
    def fit(self, values: NDArray[Any]) -> tuple[_Floats, _Floats, _Floats, NDArray[np.uint32]]: ...

def eval_texels(layout: Any, unknowns: _Floats, at: tuple[_Floats, ...]) -> _Floats: ...
