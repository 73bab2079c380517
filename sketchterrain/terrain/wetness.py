"""Wetness of drained ground: a topographic wetness index that spreads over level ground.

The index is log₂(a / S) with the drainage area a per width of a node, over the spacing of level 0, and the
slope S to the lowest neighbour (Beven & Kirkby 1979, "A physically based, variable contributing area model of
basin hydrology"). Level ground beside a channel is as wet, though little drains through it: from node to
node the index falls by no more than `_SPREAD`, and `_RISE` times the way up in the same unit (compare Böhner
& Selige 2006, "Spatial prediction of soil attributes using terrain analysis and climate regionalisation").

The logarithm is linear between powers of two, so that its bits depend on no library.
"""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from math import frexp, isnan, nan, sqrt

import numpy as np
from numba import njit

from sketchterrain.array_types import Float32Array

_LEVEL = 1 / 32  # slope below which ground is level
_SPREAD, _RISE = 0.5, 12.0  # of the index, over the spacing of level 0
_DRY, _WET = 7.0, 13.0  # index that gives 0, and 1
_MEAN, _MEAN_ROCK = 0.3, 0.06  # of ground without rock, and of rock
_SWEEPS = 2

_compiled = njit(cache=True, nogil=True, error_model="numpy")


@_compiled
def wetness(height, area, spacing, finest):
    """Return the wetness, 0 … 1, float32, of nodes of a spacing (m), whose heights (m) may be NaN.

    Areas are m²; `finest` is the spacing (m) of level 0. A node's own area counts as one of level 0.
    """
    rows, columns = height.shape
    index = np.full((rows, columns), nan)
    own = spacing * spacing - finest * finest
    for j in range(rows):
        for i in range(columns):
            z = height[j, i]
            if isnan(z):
                continue
            steepest = _LEVEL * spacing
            for dj, di in ((-1, -1), (-1, 0), (-1, 1), (0, -1), (0, 1), (1, -1), (1, 0), (1, 1)):
                if 0 <= j + dj < rows and 0 <= i + di < columns:
                    fall = z - height[j + dj, i + di]
                    fall = fall if dj * di == 0 else fall * sqrt(0.5)
                    if fall > steepest:
                        steepest = fall
            nodes = max((area[j, i] - own) / (finest * spacing), 1.0)
            mantissa, exponent = frexp(nodes * spacing / steepest)
            index[j, i] = exponent + 2 * mantissa - 2
    for _ in range(_SWEEPS):
        for j in range(rows):
            for i in range(columns):
                _spread(height, index, j, i, -1, spacing, finest)
        for j in range(rows - 1, -1, -1):
            for i in range(columns - 1, -1, -1):
                _spread(height, index, j, i, 1, spacing, finest)
    return _smoothed(index)


@_compiled
def _spread(height, index, j, i, step, spacing, finest):
    """Raise the index of a node to what the neighbours before it, or after it, leave to it."""
    if isnan(index[j, i]):
        return
    rows, columns = index.shape
    best = index[j, i]
    for dj, di in ((step, -1), (step, 0), (step, 1), (0, step)):
        if 0 <= j + dj < rows and 0 <= i + di < columns:
            rise = max(height[j, i] - height[j + dj, i + di], 0.0)
            way = spacing if dj * di == 0 else spacing * sqrt(2.0)
            left = index[j + dj, i + di] - (_SPREAD * way + _RISE * rise) / finest
            if left > best:
                best = left
    index[j, i] = best


@_compiled
def _smoothed(index):
    """Return the wetness of means (1 2 1) of the index; 0 where it is NaN."""
    rows, columns = index.shape
    result = np.zeros((rows, columns), np.float32)
    for j in range(rows):
        for i in range(columns):
            if isnan(index[j, i]):
                continue
            total, weights = 0.0, 0.0
            for dj in range(-1, 2):
                for di in range(-1, 2):
                    if 0 <= j + dj < rows and 0 <= i + di < columns and not isnan(index[j + dj, i + di]):
                        weight = (2.0 - abs(dj)) * (2.0 - abs(di))
                        total += weight * index[j + dj, i + di]
                        weights += weight
            result[j, i] = min(max((total / weights - _DRY) / (_WET - _DRY), 0.0), 1.0)
    return result


def mean_wetness(rock: Float32Array) -> Float32Array:
    """Return the mean wetness, 0 … 1, of ground of which some is rock (0 … 1)."""
    return np.asarray(np.float32(_MEAN) - np.float32(_MEAN - _MEAN_ROCK) * rock)
