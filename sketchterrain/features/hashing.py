"""Random numbers that are functions of what they are for: no state, so no order of asking can change them.

Keys are folded with the finaliser of splitmix64 (Steele, Lea & Flood 2014).
"""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np
import numpy.typing as npt

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_FIRST = np.uint64(0xBF58476D1CE4E5B9)
_SECOND = np.uint64(0x94D049BB133111EB)
_MASK = (1 << 64) - 1

Key = int | npt.NDArray[np.integer[Any]]


def hashed(seed: int, stream: str, *keys: Key) -> npt.NDArray[np.uint64]:
    """Hash integer keys to 64 bits, elementwise.

    Parameters
    ----------
    seed : int
        Seed of the terrain; only its low 64 bits count.
    stream : str
        What the number is for. Different streams are independent.
    *keys : int or integer array
        Broadcast against each other. Negative values are welcome.

    Returns
    -------
    uint64 array of the keys' broadcast shape.
    """
    start = (seed & _MASK) ^ (zlib.crc32(stream.encode()) << 32)
    state = _mixed(np.asarray(start, dtype=np.uint64))
    for key in keys:
        state = _mixed(state ^ _mixed(_words(key)))
    return state


def unit(seed: int, stream: str, *keys: Key) -> npt.NDArray[np.float64]:
    """Like `hashed`, as float64 evenly spread over [0, 1)."""
    return (hashed(seed, stream, *keys) >> np.uint64(11)).astype(np.float64) * 2.0**-53


def smooth_noise(
    seed: int, stream: str, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Value noise in [0, 1] on the unit lattice: smooth, about one swing per two units."""
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    u, v = x - column, y - row
    u, v = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v)
    south = (1.0 - u) * unit(seed, stream, column, row) + u * unit(seed, stream, column + 1, row)
    north = (1.0 - u) * unit(seed, stream, column, row + 1) + u * unit(seed, stream, column + 1, row + 1)
    return (1.0 - v) * south + v * north


def _words(key: Key) -> npt.NDArray[np.uint64]:
    if isinstance(key, int):
        return np.asarray(key & _MASK, dtype=np.uint64)
    return np.asarray(key).astype(np.uint64)


def _mixed(state: npt.NDArray[np.uint64]) -> npt.NDArray[np.uint64]:
    with np.errstate(over="ignore"):  # wrapping is the point
        state = np.asarray(state + _GOLDEN)
        state = (state ^ (state >> np.uint64(30))) * _FIRST
        state = (state ^ (state >> np.uint64(27))) * _SECOND
        return np.asarray(state ^ (state >> np.uint64(31)))
