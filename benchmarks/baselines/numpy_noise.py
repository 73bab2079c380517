"""The noise in NumPy: float32 and 32-bit integers, an octave of the whole grid at a time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array
from sketchterrain.benchmarks.baselines.problem import NoiseProblem, Rival
from sketchterrain.terrain.noise import SKEW_OTHER, SKEW_SAME, STRIDES

if TYPE_CHECKING:
    Words = npt.NDArray[np.uint32]

_UNSKEW = np.float32(0.21138669673055244)
_SCALE = np.float32(3.259629011154175e-08)
_STRIDE_U, _STRIDE_V = (np.uint32(stride) for stride in STRIDES)
_BOTH = np.uint32((STRIDES[0] + STRIDES[1]) & 0xFFFFFFFF)
_ONE = np.float32(1)
_MIX = np.uint32(15)


def rival(problem: NoiseProblem) -> Rival:
    """Return the sum over whole arrays; NumPy uses one thread for it."""
    return Rival(f"NumPy {np.__version__}, float32", 1, lambda: _fbm(problem))


def _fbm(problem: NoiseProblem) -> Float32Array:
    step = np.arange(problem.side, dtype=np.int32)
    column, row = step[None, :], step[:, None]
    total = np.zeros((problem.side, problem.side), np.float32)
    for corner, turned, amplitude in zip(problem.corner, problem.turned, problem.amplitude, strict=True):
        x, y = (row, -column) if turned else (column, row)
        u = SKEW_SAME * x + SKEW_OTHER * y + np.int32(corner[0])
        v = SKEW_OTHER * x + SKEW_SAME * y + np.int32(corner[1])
        total += amplitude * _simplex(u, v, corner[2], int(corner[3]))
    return total


def _simplex(u: npt.NDArray[np.int32], v: npt.NDArray[np.int32], seed: np.uint32, bits: int) -> Float32Array:
    h = seed + (u >> bits).astype(np.uint32) * _STRIDE_U + (v >> bits).astype(np.uint32) * _STRIDE_V
    fu, fv = _fraction(u, bits), _fraction(v, bits)
    lower = fu > fv
    unskewed = (fu + fv) * _UNSKEW
    x, y = fu - unskewed, fv - unskewed
    near, far = _UNSKEW, _UNSKEW - _ONE
    total = _corner(h, x, y)
    middle = h + np.where(lower, _STRIDE_U, _STRIDE_V)
    total += _corner(middle, x + np.where(lower, far, near), y + np.where(lower, near, far))
    total += _corner(h + _BOTH, x + (near + far), y + (near + far))
    return total * _SCALE


def _fraction(u: npt.NDArray[Any], bits: int) -> Float32Array:
    return (((u << (32 - bits)).view(np.uint32)) >> 8).astype(np.float32) * np.float32(2.0**-24)


def _corner(h: Words, dx: Float32Array, dy: Float32Array) -> Float32Array:
    h = h ^ (h >> _MIX)
    h *= np.uint32(0x735A2D97)
    h ^= h >> _MIX
    fade = np.maximum(np.float32(0.5) - (dx * dx + dy * dy), np.float32(0))
    fade *= fade
    ramp = h.view(np.int32).astype(np.float32) * dx
    ramp += (h << 16).view(np.int32).astype(np.float32) * dy
    fade *= fade
    fade *= ramp
    return fade
