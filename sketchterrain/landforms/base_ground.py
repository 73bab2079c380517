"""Elevation data at the nodes of the drained ground.

The ground under a sketch is w z + (1 - w) (u + e): elevation data z by their weight w, procedural ground u
on a smooth continuation e of z - u, into voids and beyond the rim. Nodes hold (1 - w) (u + e) and what
painted features add; kernels read w by the same splines and add w z.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.ndimage import map_coordinates, minimum_filter

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.elevation.base import NODE_REACH, BaseElevation
from sketchterrain.geometry.hashing import gaussian_filter, rounded
from sketchterrain.landforms.placement.feature_types import smoothstep

_MAX_BYTES = 1 << 25
_WEIGHT_STEP = 2.0**-20
_LEVEL = 4  # of nodes of the continuation, at least: they need no drainage
_MOST_NODES = 64  # along the data's longer side; as many again on each side
_BLURS = (1.0, 2.0, 4.0, 8.0, 16.0, 32.0)  # nodes, until all is continued
_LEAST_SHARE = 0.02  # of nodes with data in a blur
_ROCK_FROM, _ROCK_FULL = 0.6, 1.1  # slopes


class NodeValues(Protocol):
    """Heights (m), shares of rock (0 … 1) and wetness (0 … 1) of a window of nodes, (rows, columns)."""

    @property
    def height(self) -> Float64Array: ...  # noqa: D102
    @property
    def rock(self) -> Float32Array: ...  # noqa: D102
    @property
    def wetness(self) -> Float32Array: ...  # noqa: D102


class NodeSource(Protocol):
    """Unpainted ground as a value: equal and hashable by all that its nodes depend on."""

    def window(
        self, level: int, column: int, row: int, rows: int, columns: int, *, painted: bool = True
    ) -> NodeValues:
        """Return a window of nodes from the south-western one on, rows northward.

        Unless ``painted``, heights of the painted region's nodes may be NaN.
        """
        ...

    def prepare(
        self, level: int, corners: LatticeArray, rows: int, columns: int, *, painted: bool = True
    ) -> None:
        """Compute at once what windows of a size need, by their south-western nodes (n, 2)."""
        ...


class BaseNodes(NamedTuple):
    """Elevation data at a window of nodes, (rows, columns), rows northward."""

    height: Float64Array  # m; 0 where the weight is 0
    weight: Float32Array  # 0 … 1
    rock: Float32Array  # 0 … 1: share of bare rock by the slope
    around: Float64Array  # m: what procedural ground is raised by


@dataclass(frozen=True, eq=False)
class BaseGround:
    """Elevation data at nodes r0 · 2^level apart, and procedural ground."""

    base: BaseElevation
    spacing: float  # r0, m
    source: NodeSource  # procedural ground

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave out what is cached."""
        return BaseGround, (self.base, self.spacing, self.source)

    def digest_parts(self) -> tuple[bytes, float, NodeSource]:
        """Return what it depends on."""
        return self.base.id, self.spacing, self.source

    def window(self, level: int, column: int, row: int, rows: int, columns: int) -> BaseNodes:
        """Return the data at a window of nodes of a level from the south-western one (column, row) on."""
        at = level, column, row, rows, columns
        return self._windows.get_or_compute(at, lambda: self._window(*at))

    @cached_property
    def _windows(self) -> LRUCache:
        return LRUCache(max_bytes=_MAX_BYTES)

    def _window(self, level: int, column: int, row: int, rows: int, columns: int) -> BaseNodes:
        cell = self.spacing * 2.0**level
        x, y = np.meshgrid(
            cell * np.arange(column - NODE_REACH, column + columns + NODE_REACH),
            cell * np.arange(row - NODE_REACH, row + rows + NODE_REACH),
        )
        weight = rounded(self.base.weight(x, y), _WEIGHT_STEP).astype(np.float32)
        inner = np.s_[NODE_REACH:-NODE_REACH, NODE_REACH:-NODE_REACH]
        around = self._around.at(x[inner], y[inner])
        if not weight[inner].any():
            nothing = np.zeros((rows, columns), np.float32)
            return BaseNodes(nothing.astype(np.float64), nothing, nothing, around)
        found = self.base.heights(x, y, cell)
        # No node has a weight where displaced splines would read it beside the data.
        weight[minimum_filter(found.weight, 2 * NODE_REACH + 1) < 1.0] = 0.0
        height, slope = np.where(weight > 0.0, [found.height, np.hypot(found.east, found.north)], 0.0)
        rock = smoothstep((slope - _ROCK_FROM) / (_ROCK_FULL - _ROCK_FROM)).astype(np.float32)
        return BaseNodes(height[inner].copy(), weight[inner].copy(), rock[inner].copy(), around)

    @cached_property
    def _around(self) -> _Continuation:
        """The difference of the data from procedural ground, continued by ever wider blurs."""
        reach = self.base.patchwork.reach
        low, high = (each.astype(np.float64) for each in (reach[:, :2].min(axis=0), reach[:, 2:].max(axis=0)))
        side, level = float((high - low).max()), _LEVEL
        while side > _MOST_NODES * self.spacing * 2.0**level:
            level += 1
        cell = self.spacing * 2.0**level
        west, south = (int(each) for each in np.floor((low - side) / cell))
        columns, rows = (int(each) + 2 for each in np.ceil((high + side) / cell) - (west, south))
        x, y = np.meshgrid(cell * (west + np.arange(columns)), cell * (south + np.arange(rows)))
        found = self.base.heights(x, y, cell)
        known = found.weight >= 1.0
        if not known.any():  # narrower than a cell
            nearest = np.hypot(x - low[0], y - low[1]).argmin()
            known.flat[nearest] = True
            found.height.flat[nearest] = self.base.patchwork.middle
        procedural = self.source.window(level, west, south, rows, columns).height
        change = continued(np.where(known, found.height - procedural, 0.0), known)
        return _Continuation(cell * west, cell * south, cell, change)


class _Continuation(NamedTuple):
    """Heights by a quadratic B-spline; beyond its rim the height there."""

    west: float  # m
    south: float
    cell: float
    coefficients: Float64Array  # m, rows northward

    def at(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return heights (m) at points (m) of one shape."""
        places = [(y - self.south) / self.cell, (x - self.west) / self.cell]
        return rounded(map_coordinates(self.coefficients, places, order=2, prefilter=False, mode="nearest"))


def continued(height: Float64Array, known: BoolArray) -> Float64Array:
    """Return heights (rows, columns), which are 0 where they are not known, continued and smoothed."""
    level, left = height.copy(), ~known
    for blur in _BLURS:
        share, mean = (
            gaussian_filter(each, blur, axes=(0, 1)) for each in (known.astype(np.float64), height)
        )
        now = left & ((share > _LEAST_SHARE) | (blur == _BLURS[-1]))
        level[now] = (mean / np.maximum(share, 1e-12))[now]
        left &= ~now
    return gaussian_filter(level, 1.0, axes=(0, 1))
