"""Deterministic synthetic country: fields with shared borders, holes and roads, at one density."""

from __future__ import annotations

from typing import Final

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.document.sketch import Sketch
from sketchterrain.features.table import AREA, LINE, FeatureTable, starts

EXTENT: Final = 100_000.0
"""m; with all of the land as Bruneton & Neyret's data: 600,000 curves, 190,000 areas."""
SIDE: Final = 436
"""Cells along a side of all of the land."""
SEED: Final = 28

_CELL = 228.5  # m
_JITTER = np.array([0.12, 0.18])  # cells: of corners; corners of a line are half a cell apart
_BEND = 0.05  # cells: of the vertex in the middle of a curve
_MERGED, _SPLIT, _HOLED = 0.11, 0.04, 0.04  # shares of pairs of cells, of the cells, of the other ones
_HOLE, _HOLE_VERTICES = 0.2, 6  # its radius in cells
_ROADS, _FIRST_ROAD = 40, 18  # lines between roads
_USES = ("field", "meadow", "forest", "built_up")
_SHARES, _HOLE_SHARES = (0.70, 0.84, 0.96), (0.0, 0.3, 0.7)  # cumulative
_IDS = 3  # a cell: its first half, its second half, its hole


def curve_count(side: int) -> int:
    """Return about how many curves lie between corners in so many cells along a side."""
    return round(3.13 * side * side)


def synthetic_land(side: int = SIDE) -> Sketch:
    """Return the sketch of a country in the middle of 100 × 100 km, so many cells (even) along a side.

    Cells are laid like bricks, so that three curves meet at a corner, and each is shared by two areas; some
    are merged, some split, some have a hole that is an area of its own. A smaller country is the middle of a
    larger one, with the same ids: only their number differs.
    """
    land = _Land(side)
    return Sketch(
        name="synthetic land",
        extent=EXTENT,
        seed=SEED,
        vectors={"landuse": land.areas(), "road": land.roads()},
    )


class _Land:
    """Corners and middles of curves of the whole land, and the cells of the one asked for.

    Line r has corners every half cell; cells of row r, between lines r and r + 1, begin at every second one.
    """

    def __init__(self, side: int) -> None:
        rng = np.random.default_rng(SEED)
        row, half = np.indices((SIDE + 1, 2 * SIDE + 2))
        at = np.stack([0.5 * half, row], axis=-1) + rng.uniform(-1.0, 1.0, (*row.shape, 2)) * _JITTER
        margin = 0.5 * (EXTENT - _CELL * (SIDE + 0.5))
        self._corner = at * _CELL + margin
        across, up = (0.5 * (at + np.roll(at, -1, axis)) for axis in (1, 0))
        self._across, self._up = (
            (middle + rng.uniform(-_BEND, _BEND, at.shape)) * _CELL + margin for middle in (across, up)
        )
        cells = rng.random((4, SIDE, SIDE))
        self._merged, self._split, self._holed, self._use = cells
        self._hole_use = rng.random((SIDE, SIDE))
        first = (SIDE - side) // 4 * 2
        self._cells = np.arange(first, first + side)

    def areas(self) -> FeatureTable:
        """Return the layer of land use."""
        row, column = (each.ravel() for each in np.meshgrid(self._cells, self._cells, indexing="ij"))
        merged = self._merged[row, column // 2 * 2] < _MERGED
        split = ~merged & (self._split[row, column] < _SPLIT)
        holed = ~merged & ~split & (self._holed[row, column] < _HOLED)
        first, pair = 2 * column + row % 2, merged & (column % 2 == 0)
        number = _IDS * (row * SIDE + column) + 1
        use = np.searchsorted(_SHARES, self._use[row, column], side="right")
        hole_use = np.searchsorted(_HOLE_SHARES, self._hole_use[row, column], side="right")
        plain = ~merged & ~split & ~holed
        outer, hole = self._rings(row[holed], first[holed], 2), self._holes(row[holed], first[holed])
        groups = [
            (self._rings(row[plain], first[plain], 2), number[plain], use[plain], (12,)),
            (self._rings(row[pair], first[pair], 4), number[pair], use[pair], (20,)),
            (self._rings(row[split], first[split], 1), number[split], use[split], (8,)),
            (self._rings(row[split], first[split] + 1, 1), number[split] + 1, use[split], (8,)),
            (np.concatenate([outer, hole[:, ::-1]], axis=1), number[holed], use[holed], (12, _HOLE_VERTICES)),
            (hole, number[holed] + 2, hole_use[holed], (_HOLE_VERTICES,)),
        ]
        sizes = np.concatenate([np.tile(group[3], len(group[1])) for group in groups])
        rings = np.concatenate([np.full(len(group[1]), len(group[3])) for group in groups])
        ids, uses = (np.concatenate([group[k] for group in groups]) for k in (1, 2))
        of_ring = np.repeat(ids, rings)
        by_id, ring_by_id, vertex_by_id = (
            np.argsort(each, kind="stable") for each in (ids, of_ring, np.repeat(of_ring, sizes))
        )
        return FeatureTable(
            "landuse",
            np.concatenate([group[0].reshape(-1, 2) for group in groups])[vertex_by_id],
            starts(sizes[ring_by_id]),
            starts(rings[by_id]),
            np.full(len(ids), AREA, np.uint8),
            ids[by_id],
            np.ones(len(ids), np.uint8),
            {"use": tuple(np.array(_USES)[uses[by_id]].tolist())},
        )

    def roads(self) -> FeatureTable:
        """Return roads along every so many lines and columns: lines that share vertices where they meet."""
        low, high = int(self._cells[0]), int(self._cells[-1]) + 1
        rows = [line for line in range(_FIRST_ROAD, SIDE + 1, _ROADS) if low <= line <= high]
        columns = [line for line in range(_FIRST_ROAD, SIDE, _ROADS) if low <= line < high]
        halves = np.arange(2 * low + 1, 2 * high + 1)
        lines = [_woven(self._corner[row, halves], self._across[row, halves[:-1]]) for row in rows]
        for column in columns:
            for south, north in zip([low, *rows], [*rows, high], strict=True):
                if south < north:
                    lines.append(self._upward(column, south, north))
        count = len(lines)
        return FeatureTable(
            "road",
            np.concatenate(lines) if lines else np.zeros((0, 2)),
            starts([len(line) for line in lines]),
            np.arange(count + 1),
            np.full(count, LINE, np.uint8),
            np.arange(1, count + 1),
            np.ones(count, np.uint8),
        )

    def _upward(self, column: int, south: int, north: int) -> Float64Array:
        """Return a road along the sides of bricks, from one line to another one."""
        points = []
        for row in range(south, north):
            half = 2 * column + row % 2
            points += [self._corner[row, half], self._up[row, half], self._corner[row + 1, half]]
            if row + 1 < north:
                points.append(self._across[row + 1, 2 * column])
        return np.array(points)

    def _rings(self, row: Int64Array, first: Int64Array, wide: int) -> Float64Array:
        """Return borders (n, 4 wide + 4, 2) of areas from a half of a row on, so many halves wide."""
        half = first[:, None] + np.arange(wide + 1)
        south, north = (
            _woven(self._corner[line, half], self._across[line, half[:, :-1]])
            for line in (row[:, None], row[:, None] + 1)
        )
        east, west = (self._up[row, side][:, None] for side in (first + wide, first))
        return np.concatenate([south, east, north[:, ::-1], west], axis=1)

    def _holes(self, row: Int64Array, first: Int64Array) -> Float64Array:
        """Return hexagons (n, 6, 2) in the middle of cells."""
        middle = self._rings(row, first, 2).mean(axis=1)
        turn = 2.0 * np.pi * np.arange(_HOLE_VERTICES) / _HOLE_VERTICES
        outline = _HOLE * _CELL * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        return np.asarray(middle[:, None] + outline)


def _woven(corner: Float64Array, middle: Float64Array) -> Float64Array:
    """Return corners (…, n, 2) with the middles (…, n - 1, 2) between them."""
    result = np.empty((*corner.shape[:-2], 2 * corner.shape[-2] - 1, 2))
    result[..., ::2, :], result[..., 1::2, :] = corner, middle
    return result
