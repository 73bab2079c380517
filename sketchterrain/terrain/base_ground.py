"""Elevation data at the nodes of the drained ground.

The ground under a sketch is w z + (1 - w) u: elevation data z by their weight w, procedural ground u.
Nodes hold (1 - w) u and what painted features add; kernels read w by the same splines and add w z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import minimum_filter

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.elevation.base import BaseElevation
from sketchterrain.placement.hashing import rounded

REACH: Final = 3
"""Nodes by which displaced splines reach beyond a node, and a little more."""

_MAX_BYTES = 1 << 25
_WEIGHT_STEP = 2.0**-20
_ROCK_FROM, _ROCK_FULL = 0.6, 1.1  # slopes


class BaseNodes(NamedTuple):
    """Elevation data at a window of nodes, (rows, columns), rows northward."""

    height: Float64Array  # m; 0 where the weight is 0
    weight: Float32Array  # 0 … 1
    rock: Float32Array  # 0 … 1: share of bare rock by the slope


@dataclass(frozen=True, eq=False)
class BaseGround:
    """Elevation data at nodes r0 · 2^level apart; a value by the data's id and the spacing."""

    base: BaseElevation
    spacing: float  # r0, m

    def __post_init__(self) -> None:
        object.__setattr__(self, "_windows", LRUCache(max_bytes=_MAX_BYTES))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, BaseGround) and self._key() == other._key()

    def __hash__(self) -> int:
        return hash(self._key())

    def _key(self) -> tuple[bytes, float]:
        return self.base.id, self.spacing

    def window(self, level: int, column: int, row: int, rows: int, columns: int) -> BaseNodes:
        """Return the data at a window of nodes of a level from the south-western one (column, row) on."""
        at = level, column, row, rows, columns
        windows: LRUCache = self._windows  # type: ignore[attr-defined]
        return windows.get_or_compute(at, lambda: self._window(*at))

    def _window(self, level: int, column: int, row: int, rows: int, columns: int) -> BaseNodes:
        cell = self.spacing * 2.0**level
        x, y = np.meshgrid(
            cell * np.arange(column - REACH, column + columns + REACH),
            cell * np.arange(row - REACH, row + rows + REACH),
        )
        weight = rounded(self.base.weight(x, y), _WEIGHT_STEP).astype(np.float32)
        inner = np.s_[REACH:-REACH, REACH:-REACH]
        if not weight[inner].any():
            return BaseNodes(np.zeros((rows, columns)), *np.zeros((2, rows, columns), np.float32))
        found = self.base.heights(x, y, cell)
        # No node has a weight where displaced splines would read it beside the data.
        weight[minimum_filter(found.weight, 2 * REACH + 1) < 1.0] = 0.0
        height, slope = np.where(weight > 0.0, [found.height, np.hypot(found.east, found.north)], 0.0)
        share = np.clip((slope - _ROCK_FROM) / (_ROCK_FULL - _ROCK_FROM), 0.0, 1.0)
        rock = (share * share * (3.0 - 2.0 * share)).astype(np.float32)
        return BaseNodes(height[inner].copy(), weight[inner].copy(), rock[inner].copy())
