"""The noise compiled from Python by numba, rows in parallel: as one writes it, and with vectors in mind."""

from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import numpy as np

from sketchterrain.benchmarks.baselines.noise import Absent, NoiseProblem, Rival

_HALF, _ZERO = np.float32(0.5), np.float32(0)
_UNSKEW = np.float32(0.21138669673055244)
_BACK = np.float32(0.21138669673055244 - 1)
_BOTH = np.float32(2 * 0.21138669673055244 - 1)
_SCALE = np.float32(3.259629011154175e-08)
_FRACTION = np.float32(2.0**-24)
_STRIDE_U, _STRIDE_V = np.uint32(0x9E3779B1), np.uint32(0x85EBCA77)


def rival(problem: NoiseProblem) -> Rival | Absent:
    """Return the sum a point at a time, as one writes it; or say that numba is not installed."""
    return _rival(problem, "numba, a point at a time", _by_points)


def by_rows(problem: NoiseProblem) -> Rival | Absent:
    """Return the sum an octave of a row at a time, written so that its compiler can use vectors."""
    return _rival(problem, "numba, an octave of a row at a time", _by_rows)


def _rival(
    problem: NoiseProblem, name: str, compiled: Callable[[Any], Callable[..., None]]
) -> Rival | Absent:
    if find_spec("numba") is None:
        return Absent(name, "not installed: pip install 'sketchterrain[peers]'")
    import numba

    most = int(numba.config.NUMBA_NUM_THREADS)
    threads = min(problem.threads, most)
    rows = compiled(numba)
    out = np.empty((problem.side, problem.side), np.float32)

    def run() -> np.ndarray[Any, np.dtype[np.float32]]:
        numba.set_num_threads(threads)
        rows(problem.corner, problem.turned, problem.amplitude, out)
        return out

    return Rival(f"{name} ({numba.__version__})", threads, run)


def _corner(numba: Any) -> Callable[..., Any]:
    inline = numba.njit(inline="always")

    @inline  # type: ignore[untyped-decorator, unused-ignore]
    def corner(word: Any, dx: Any, dy: Any) -> Any:
        h = np.uint32(word)
        h = np.uint32(h ^ (h >> np.uint32(15)))
        h = np.uint32(h * np.uint32(0x735A2D97))
        h = np.uint32(h ^ (h >> np.uint32(15)))
        fade = max(_HALF - (dx * dx + dy * dy), _ZERO)
        fade *= fade
        east, north = np.float32(np.int32(h)), np.float32(np.int32(np.uint32(h << np.uint32(16))))
        return fade * fade * (east * dx + north * dy)

    return corner  # type: ignore[no-any-return, unused-ignore]


def _by_points(numba: Any) -> Callable[..., None]:
    corner, parallel = _corner(numba), numba.njit(parallel=True)

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


def _by_rows(numba: Any) -> Callable[..., None]:
    corner, parallel = _corner(numba), numba.njit(parallel=True)
    same, other = np.int32(1399), np.int32(375)

    @parallel  # type: ignore[untyped-decorator, unused-ignore]
    def rows(corners: Any, turned: Any, amplitude: Any, out: Any) -> None:
        for row in numba.prange(out.shape[0]):
            line = out[row]
            line[:] = _ZERO
            for i in range(len(amplitude)):
                bits, above = np.int32(corners[i, 3]), np.uint32(32 - corners[i, 3])
                step_u, step_v = (-other, -same) if turned[i] else (same, other)
                up_u, up_v = (same, other) if turned[i] else (other, same)
                first_u = np.int32(np.int32(corners[i, 0]) + np.int32(row) * up_u)
                first_v = np.int32(np.int32(corners[i, 1]) + np.int32(row) * up_v)
                seed, weight = np.uint32(corners[i, 2]), np.float32(amplitude[i] * _SCALE)
                for k in range(len(line)):
                    u = np.int32(first_u + step_u * np.int32(k))
                    v = np.int32(first_v + step_v * np.int32(k))
                    cell_u, cell_v = np.uint32(u >> bits), np.uint32(v >> bits)
                    h = np.uint32(seed + np.uint32(cell_u * _STRIDE_U) + np.uint32(cell_v * _STRIDE_V))
                    fu = np.float32(np.int32(np.uint32(np.uint32(u) << above) >> np.uint32(8))) * _FRACTION
                    fv = np.float32(np.int32(np.uint32(np.uint32(v) << above) >> np.uint32(8))) * _FRACTION
                    lower = fu > fv
                    unskewed = (fu + fv) * _UNSKEW
                    dx, dy = fu - unskewed, fv - unskewed
                    middle = np.uint32(h + (_STRIDE_U if lower else _STRIDE_V))
                    across, along = dx + (_BACK if lower else _UNSKEW), dy + (_UNSKEW if lower else _BACK)
                    last = corner(np.uint32(h + _STRIDE_U + _STRIDE_V), dx + _BOTH, dy + _BOTH)
                    line[k] += weight * (corner(h, dx, dy) + corner(middle, across, along) + last)

    return rows  # type: ignore[no-any-return, unused-ignore]
