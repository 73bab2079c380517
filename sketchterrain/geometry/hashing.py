"""Stateless random numbers by hashing, and rounding that is the same on every CPU.

Keys are folded with the finaliser of splitmix64 (Steele, Lea & Flood 2014).

The last bits of exponentials, powers and sines depend on the CPU: NumPy and the C library choose their code
by its features (AVX2, FMA, AVX-512). Sums, products, quotients and square roots are exact everywhere. So
results of the former are rounded to a step far above these differences and far below what is visible.
"""

import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_SHIFTS = (np.uint64(30), np.uint64(27), np.uint64(31))
_MASK = (1 << 64) - 1

Key = int | npt.NDArray[np.integer[Any]]


def hash_keys(seed: int, stream: str, *keys: Key) -> npt.NDArray[np.uint64]:
    """Return 64-bit hashes of integer keys, elementwise with broadcasting; negative keys are allowed.

    Only the low 64 bits of `seed` count. Different streams are independent.
    """
    state: int | npt.NDArray[np.uint64] = _start(seed & _MASK, stream)
    for key in keys:
        word = _word(key & _MASK) if isinstance(key, int) else _mixed(np.asarray(key).astype(np.uint64))
        # Python integers are mixed as such: NumPy's overhead would dominate.
        both_whole = isinstance(state, int) and isinstance(word, int)
        state = (
            _word(int(state ^ word)) if both_whole else _mixed(np.asarray(_as_word(state) ^ _as_word(word)))
        )
    return np.asarray(state, dtype=np.uint64)


def hash_unit(seed: int, stream: str, *keys: Key) -> npt.NDArray[np.float64]:
    """Return `hash_keys` as float64, uniform in [0, 1)."""
    return _unit(hash_keys(seed, stream, *keys))


def _unit(bits: npt.NDArray[np.uint64]) -> npt.NDArray[np.float64]:
    return (bits >> np.uint64(11)).astype(np.float64) * 2.0**-53


def value_noise(
    seed: int, stream: str, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Return value noise in [0, 1] on the unit lattice: smooth, about one swing per two units."""
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    u, v = x - column, y - row
    u, v = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v)
    start = np.uint64(_start(seed & _MASK, stream))
    columns = [_mixed(start ^ _mixed(np.asarray(column + k).astype(np.uint64))) for k in (0, 1)]
    rows = [_mixed(np.asarray(row + k).astype(np.uint64)) for k in (0, 1)]
    # As `hash_unit` of column and row, with each key mixed once.
    south, north = (
        (1.0 - u) * _unit(_mixed(columns[0] ^ key)) + u * _unit(_mixed(columns[1] ^ key)) for key in rows
    )
    return (1.0 - v) * south + v * north


@lru_cache(maxsize=256)
def _start(seed: int, stream: str) -> int:
    return _word(seed ^ (zlib.crc32(stream.encode()) << 32))


def _word(state: int) -> int:
    """Return what `_mixed` returns for one number below 2^64."""
    state = (state + int(_GOLDEN)) & _MASK
    state = ((state ^ (state >> 30)) * int(_FIRST)) & _MASK
    state = ((state ^ (state >> 27)) * int(_SECOND)) & _MASK
    return state ^ (state >> 31)


def _as_word(state: int | npt.NDArray[np.uint64]) -> np.uint64 | npt.NDArray[np.uint64]:
    return np.uint64(state) if isinstance(state, int) else state


def _mixed(state: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    if state.ndim == 0:
        return np.asarray(_word(int(state)), dtype=np.uint64)
    # Overflow is intended; arrays wrap without a warning.
    state = state + _GOLDEN
    state ^= state >> _SHIFTS[0]
    state *= _FIRST
    state ^= state >> _SHIFTS[1]
    state *= _SECOND
    state ^= state >> _SHIFTS[2]
    return state


STEP = 2.0**-10
"""Rounding step of river points and water levels, m."""

RATIO_STEP = 2.0**-20
"""Rounding step of ratios near 1."""

# Not ½: straight strokes have points exactly halfway between steps, which could round either way.
_UP_FROM = 0.53
_WEIGHT_STEP = 2.0**-40


def rounded(values: npt.ArrayLike, step: float = STEP) -> Float64Array:
    """Round to multiples of a step, a power of two; multiples keep their bits."""
    return np.asarray(np.floor(np.asarray(values, dtype=np.float64) / step + (1.0 - _UP_FROM)) * step)


def gaussian_filter(
    values: npt.ArrayLike,
    sigma: float,
    *,
    axes: Sequence[int] = (-1,),
    mode: Literal["nearest", "reflect", "wrap"] = "nearest",
    truncate: float = 4.0,
) -> Float64Array:
    """Blur along axes as SciPy's `gaussian_filter` does, with weights that are the same on every CPU."""
    from scipy.ndimage import correlate1d  # slow to import: not for a list of targets

    radius = int(truncate * sigma + 0.5)
    weights = rounded(np.exp(-0.5 * (np.arange(-radius, radius + 1) / sigma) ** 2), _WEIGHT_STEP)
    weights /= weights.sum()  # exact in any order
    blurred = np.asarray(values, dtype=np.float64)
    for axis in axes:
        blurred = correlate1d(blurred, weights, axis=axis, mode=mode)
    return blurred
