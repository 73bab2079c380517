"""Water that roads cross: the level of floods of rivers, lakes and the sea."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.landforms.placement.feature_types import Lake, River, is_inside

_FLOOD: Final = 0.5  # of a river's depth, above its surface: its banks' tops
_BANKS = 1.3  # half widths of a river with its banks


@dataclass(frozen=True, eq=False)
class Floods:
    """Levels (m) of the floods of waters as a function of positions (n,), m; NaN on land."""

    rivers: Sequence[River]
    lakes: Sequence[Lake]
    sea_level: float | None
    ground: Callable[[Float64Array, Float64Array], Float64Array]

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return levels (n,), m."""
        level, at = np.full(len(x), np.nan), np.stack([x, y], axis=1)
        if self.sea_level is not None:
            level[self.ground(x, y) < self.sea_level] = self.sea_level
        for lake in self.lakes:
            inside = is_inside(lake.shape, at)
            level[inside] = np.fmax(level[inside], lake.level)
        if self.rivers:
            tree, half, top, reach = self._river_points
            away, nearest = tree.query(at, distance_upper_bound=reach)
            found = np.isfinite(away)
            nearest = np.where(found, nearest, 0)
            wet = found & (away < half[nearest])
            level[wet] = np.fmax(level[wet], top[nearest[wet]])
        return level

    @cached_property
    def _river_points(self) -> tuple[cKDTree, Float64Array, Float64Array, float]:
        """Points of rivers, their half widths with banks and tops of banks (n,), and how far these reach."""
        line, width, depth = (
            np.concatenate([getattr(river, name) for river in self.rivers]).astype(np.float64)
            for name in ("centreline", "centreline_width", "centreline_depth")
        )
        half = 0.5 * _BANKS * width
        gap = 0.5 * max(
            float(np.hypot(*np.diff(river.centreline[:, :2], axis=0).T).max()) for river in self.rivers
        )
        return cKDTree(line[:, :2]), half, line[:, 2] + _FLOOD * depth, float(half.max()) + gap
