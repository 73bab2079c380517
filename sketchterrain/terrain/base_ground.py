"""Elevation data at the nodes of the drained ground.

The ground under a sketch is w z + (1 - w) u: elevation data z by their weight w, procedural ground u. Nodes hold
(1 - w) u and what painted features add; kernels read w by the same splines as these and add w z.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.elevation.base import BaseElevation
from sketchterrain.placement.hashing import rounded

_MAX_BYTES = 1 << 25
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
        x, y = np.meshgrid(cell * (column + np.arange(columns)), cell * (row + np.arange(rows)))
        weight = rounded(self.base.weight(x, y), 2.0**-20).astype(np.float32)
        height, (rock,) = np.zeros(x.shape), np.zeros((1, *x.shape), np.float32)
        inside = weight > 0.0
        if inside.any():
            found = self.base.heights(x[inside], y[inside], cell)
            height[inside] = found.height
            slope = np.hypot(found.east, found.north)
            share = np.clip((slope - _ROCK_FROM) / (_ROCK_FULL - _ROCK_FROM), 0.0, 1.0)
            rock[inside] = share * share * (3.0 - 2.0 * share)
        return BaseNodes(height, weight, rock)
