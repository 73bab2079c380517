"""Bounds of the detail that a cell size omits, from the tails of the series that heights are made of."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.terrain.layers.layer import Culled, DetailState, Sampling
from sketchterrain.terrain.recipe import TerrainRecipe

_ROUNDING = 1e-6  # of the height
_MAX_CACHED = 64


class DetailBound:
    """Bounds of |height at full detail - height at a cell size| over blocks of terrain.

    Each noise misses the octaves that the cell size fades out, none of which exceeds its amplitude. A noise
    that warps outlines moves a profile by no more than the profile's steepest slope; one that scales heights
    counts with the height it multiplies, bounded by how near the features come to the block. Features, lakes
    and channels that fade out count with the share that is lost.
    """

    def __init__(self, recipe: TerrainRecipe) -> None:
        self._recipe = recipe
        self._cache = LRUCache(_MAX_CACHED)

    def bounds(self, culled: Mapping[str, Culled], blocks: LatticeArray, sampling: Sampling) -> Float64Array:
        """Return the bound (n,), m, of blocks (n, 4), from what affects them at the cell size."""
        state = DetailState.empty(blocks, self._cache)
        for layer in self._recipe.layers:
            if layer.name in culled:
                layer.omitted(state, culled[layer.name], sampling)
        return np.asarray(state.bound + np.where(state.bound > 0, _ROUNDING * state.scale, 0.0))
