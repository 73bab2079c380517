"""Wetness of drained ground: a topographic wetness index that spreads over level ground.

The index is log₂(a / S) with the drainage area a per width of a node, over the spacing of level 0, and the
slope S to the lowest neighbour (Beven & Kirkby 1979, "A physically based, variable contributing area model of
basin hydrology"). Level ground beside a channel is as wet, though little drains through it: from node to
node the index falls by no more than `_SPREAD`, and `_RISE` times the way up in the same unit (compare Böhner
& Selige 2006, "Spatial prediction of soil attributes using terrain analysis and climate regionalisation").

The logarithm is linear between powers of two, so that its bits depend on no library.
"""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from math import nan, sqrt

import numpy as np

from sketchterrain.array_types import Float32Array
from sketchterrain.landforms.hashed_noise import compiled

_LEVEL = 1 / 32  # slope below which ground is level
_SPREAD, _RISE = 0.5, 12.0  # of the index, over the spacing of level 0
_DRY, _WET = 7.0, 13.0  # index that gives 0, and 1
_MEAN, _MEAN_ROCK = 0.3, 0.06  # of ground without rock, and of rock
_SWEEPS = 2


@compiled
def wetness(height, area, spacing, finest):
    """Return the wetness, 0 … 1, float32, of nodes of a spacing (m), whose heights (m) may be NaN.

    Areas are m²; `finest` is the spacing (m) of level 0. A node's own area counts as one of level 0.
    """
    rows, columns = height.shape
    # with a margin of NaN, which no comparison chooses
    z, index = np.full((rows + 2, columns + 2), nan), np.full((rows + 2, columns + 2), nan)
    for j, i in np.ndindex(rows, columns):
        z[j + 1, i + 1] = height[j, i]
    ratio = np.empty(columns)
    for j in range(1, rows + 1):
        _start(z[j - 1], z[j], z[j + 1], area[j - 1], spacing, finest, ratio, index[j])
    for _ in range(_SWEEPS):
        for j in range(1, rows + 1):
            _spread(z[j - 1], z[j], index[j - 1], index[j], spacing, finest)
            for i in range(1, columns + 1):
                left = _left(index[j, i - 1], z[j, i] - z[j, i - 1], spacing, finest)
                index[j, i] = _higher(index[j, i], left)
        for j in range(rows, 0, -1):
            _spread(z[j + 1], z[j], index[j + 1], index[j], spacing, finest)
            for i in range(columns, 0, -1):
                left = _left(index[j, i + 1], z[j, i] - z[j, i + 1], spacing, finest)
                index[j, i] = _higher(index[j, i], left)
    return _smoothed(index)


@compiled
def _higher(a, b):
    """Return b if it is greater than a, which nothing is if either is NaN."""
    return b if b > a else a


@compiled
def _left(index, rise, way, finest):
    """Return what is left of the index after a way (m) and a rise (m), if any."""
    return index - (_SPREAD * way + _RISE * (rise if rise > 0.0 else 0.0)) / finest


@compiled
def _start(south, here, north, area, spacing, finest, ratio, index):
    """Write the index of a row of nodes before it spreads, from their areas and the three rows of heights."""
    own, width, level = spacing * spacing - finest * finest, finest * spacing, _LEVEL * spacing
    for i in range(area.size):
        z, fall = here[i + 1], level
        for other in (here[i], here[i + 2], south[i + 1], north[i + 1]):
            fall = _higher(fall, z - other)
        for other in (south[i], south[i + 2], north[i], north[i + 2]):
            fall = _higher(fall, (z - other) * sqrt(0.5))
        ratio[i] = _higher(1.0, (area[i] - own) / width) * spacing / fall
    bits = ratio.view(np.int64)
    for i in range(area.size):  # 2^(e − 1022) m with 1/2 ≤ m < 1, of which the index is e − 1022 + 2 m − 2
        index[i + 1] = np.float64((bits[i] >> 52) - 1022) if here[i + 1] == here[i + 1] else nan
        bits[i] = (bits[i] & 0xFFFFFFFFFFFFF) | 0x3FF0000000000000
    for i in range(area.size):
        index[i + 1] = index[i + 1] + ratio[i] - 2


@compiled
def _spread(before, here, given, index, spacing, finest):
    """Raise the index of a row of nodes to what the row before it leaves to it."""
    for i in range(here.size - 2):
        z, slant = here[i + 1], spacing * sqrt(2.0)
        west = _left(given[i], z - before[i], slant, finest)
        east = _left(given[i + 2], z - before[i + 2], slant, finest)
        south = _left(given[i + 1], z - before[i + 1], spacing, finest)
        index[i + 1] = _higher(_higher(_higher(index[i + 1], west), east), south)


@compiled
def _smoothed(index):
    """Return the wetness of means (1 2 1) of an index with a margin of NaN; 0 where it is NaN."""
    rows, columns = index.shape[0] - 2, index.shape[1] - 2
    value, weight = np.zeros(index.shape), np.zeros(index.shape)
    result = np.zeros((rows, columns), np.float32)
    for j, i in np.ndindex(rows + 2, columns + 2):
        inside = index[j, i] == index[j, i]
        value[j, i], weight[j, i] = (index[j, i], 1.0) if inside else (0.0, 0.0)
    for j, i in np.ndindex(rows, columns):
        wet = (_mean(value, j, i) / max(_mean(weight, j, i), 1.0) - _DRY) / (_WET - _DRY)
        result[j, i] = min(max(wet, 0.0), 1.0) if weight[j + 1, i + 1] else 0.0
    return result


@compiled
def _mean(a, j, i):
    """Return the weighted sum (1 2 1) of the nodes from (j, i) on."""
    south = a[j, i] + 2 * a[j, i + 1] + a[j, i + 2]
    here = south + 2 * a[j + 1, i] + 4 * a[j + 1, i + 1] + 2 * a[j + 1, i + 2]
    return here + a[j + 2, i] + 2 * a[j + 2, i + 1] + a[j + 2, i + 2]


def mean_wetness(rock: Float32Array) -> Float32Array:
    """Return the mean wetness, 0 … 1, of ground of which some is rock (0 … 1)."""
    return np.asarray(np.float32(_MEAN) - np.float32(_MEAN - _MEAN_ROCK) * rock)
