"""Wetness of drained ground: a topographic wetness index that spreads over level ground.

The index is log₂(a / S) with the drainage area a per width of a node, over the spacing of level 0, and the
slope S to the lowest neighbour (Beven & Kirkby 1979, "A physically based, variable contributing area model of
basin hydrology"). Level ground beside a channel is as wet, though little drains through it: from node to
node the index falls by no more than a part of the way and of the rise (compare Böhner & Selige 2006, "Spatial
prediction of soil attributes using terrain analysis and climate regionalisation").
"""

import numpy as np

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.host.library import host_function

_MEAN, _MEAN_ROCK = 0.3, 0.06  # of ground without rock, and of rock


def wetness(height: Float64Array, area: Float64Array, spacing: float, finest: float) -> Float32Array:
    """Return the wetness, 0 … 1, of nodes of a spacing (m), whose heights (m) may be NaN.

    Areas are m²; `finest` is the spacing (m) of level 0. A node's own area counts as one of level 0.
    """
    rows, columns = height.shape
    wet, scratch = np.empty((rows, columns), np.float32), np.empty((2, rows + 2, columns + 2))
    given = np.ascontiguousarray(height, np.float64), np.ascontiguousarray(area, np.float64)
    host_function("wetness")(*given, spacing, finest, wet, scratch)
    return wet


def mean_wetness(rock: Float32Array) -> Float32Array:
    """Return the mean wetness, 0 … 1, of ground of which some is rock (0 … 1)."""
    return np.asarray(np.float32(_MEAN) - np.float32(_MEAN - _MEAN_ROCK) * rock)
