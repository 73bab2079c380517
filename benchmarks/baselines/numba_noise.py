"""The noise compiled from Python by numba: a point at a time, rows in parallel, as one writes it there."""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.benchmarks.baselines.problem import Absent, Rival

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.benchmarks.baselines.problem import NoiseProblem

__all__ = ["rival"]

_HALF, _ZERO = np.float32(0.5), np.float32(0)
_UNSKEW = np.float32(0.21138669673055244)
_BACK = np.float32(0.21138669673055244 - 1)
_BOTH = np.float32(2 * 0.21138669673055244 - 1)
_SCALE = np.float32(3.259629011154175e-08)
_FRACTION = np.float32(2.0**-24)
_STRIDE_U, _STRIDE_V = np.uint32(0x9E3779B1), np.uint32(0x85EBCA77)


def rival(problem: NoiseProblem) -> Rival | Absent:
    """Return the compiled loop, or say that numba is not installed."""
    if find_spec("numba") is None:
        return Absent("numba", "not installed: pip install numba")
    import numba

    most = int(numba.config.NUMBA_NUM_THREADS)
    threads = min(problem.threads, most)
    rows = _compiled(numba)
    out = np.empty((problem.side, problem.side), np.float32)

    def run() -> np.ndarray[Any, np.dtype[np.float32]]:
        numba.set_num_threads(threads)
        rows(problem.corner, problem.turned, problem.amplitude, out)
        return out

    return Rival(f"numba {numba.__version__}", threads, run)


def _compiled(numba: Any) -> Callable[..., None]:
    inline = numba.njit(inline="always")
    parallel = numba.njit(parallel=True)

    @inline  # type: ignore[untyped-decorator, unused-ignore]
    def corner(word: Any, dx: Any, dy: Any) -> Any:
        h = np.uint32(word)
        h = np.uint32(h ^ (h >> 15))
        h = np.uint32(h * np.uint32(0x735A2D97))
        h = np.uint32(h ^ (h >> 15))
        fade = max(_HALF - (dx * dx + dy * dy), _ZERO)
        fade *= fade
        return fade * fade * (np.float32(np.int32(h)) * dx + np.float32(np.int32(np.uint32(h << 16))) * dy)

    @parallel  # type: ignore[untyped-decorator, unused-ignore]
    def rows(corners: Any, turned: Any, amplitude: Any, out: Any) -> None:
        for row in numba.prange(out.shape[0]):
            for column in range(out.shape[1]):
                total = _ZERO
                for i in range(len(amplitude)):
                    x, y = (row, -column) if turned[i] else (column, row)
                    bits = corners[i, 3]
                    u = np.int32(1399 * x + 375 * y + np.int64(corners[i, 0]))
                    v = np.int32(375 * x + 1399 * y + np.int64(corners[i, 1]))
                    h = np.uint32(
                        corners[i, 2] + np.uint32(u >> bits) * _STRIDE_U + np.uint32(v >> bits) * _STRIDE_V
                    )
                    fu = np.float32(np.uint32(np.uint32(u) << (32 - bits)) >> 8) * _FRACTION
                    fv = np.float32(np.uint32(np.uint32(v) << (32 - bits)) >> 8) * _FRACTION
                    lower = fu > fv
                    unskewed = (fu + fv) * _UNSKEW
                    dx, dy = fu - unskewed, fv - unskewed
                    value = corner(h, dx, dy)
                    if lower:
                        value += corner(h + _STRIDE_U, dx + _BACK, dy + _UNSKEW)
                    else:
                        value += corner(h + _STRIDE_V, dx + _UNSKEW, dy + _BACK)
                    value += corner(h + _STRIDE_U + _STRIDE_V, dx + _BOTH, dy + _BOTH)
                    total += amplitude[i] * (value * _SCALE)
                out[row, column] = total

    return rows  # type: ignore[no-any-return, unused-ignore]
