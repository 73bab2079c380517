"""Quadtree keys packed into integers, world bounds, and triangles of a tile beside coarser neighbours.

Sets of tiles are sorted arrays of codes. Bits of a code, from the highest: 6 level, 28 column, 28 row, each
shifted to be ≥ 0; a neighbour is one addition away. A morph control lies on the half-tile grid of its level
and has a code of its own: 5 bits level, 29 and 29 bits position.

Along a coarser tile every other border vertex collapses onto its even neighbour, and degenerate triangles are
dropped. Vertices move so that the parent's diagonals stay edges: westward and eastward along the northern and
southern border, northward and southward along the western and eastern one. Where two such borders meet at an
end of the quads' anti-diagonal, that quad is cut the other way, to avoid a triangle without area.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache, lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array
from sketchterrain.errors import InputError

_BITS: Final = 28
_MIDDLE: Final = 1 << (_BITS - 1)
_MASK: Final = (1 << _BITS) - 1
FARTHEST_TILE: Final = _MIDDLE // 2
"""Largest column and row; neighbours and children of such tiles have codes too."""
_LEVELS: Final = 32
_CONTROL_BITS: Final = _BITS + 1
_CONTROL_LEVELS: Final = 16

AROUND: Final = ((-1, 1), (0, 1), (1, 1), (-1, 0), (1, 0), (-1, -1), (0, -1), (1, -1))
"""Steps east and north to the eight neighbours, from the north-west row by row."""
_CHILDREN: Final = np.array([[0, 0], [1, 0], [0, 1], [1, 1]])


class TileKey(NamedTuple):
    """Quadtree key: level (0 is as wide as the sketch), column eastward, row northward."""

    level: int
    col: int
    row: int


class Boxes(NamedTuple):
    """Axis-aligned boxes: opposite corners (m), shape (n, 3)."""

    low: Float64Array
    high: Float64Array

    def subset(self, which: npt.NDArray[Any]) -> Boxes:
        """Return some of the boxes, by index or mask."""
        return Boxes(self.low[which], self.high[which])


def code_of(level: int | Int64Array, col: int | Int64Array, row: int | Int64Array) -> Int64Array:
    """Return codes of tiles; columns and rows in ±2^27 - 1."""
    return np.asarray(
        ((level + _LEVELS) << (2 * _BITS)) + ((col + _MIDDLE) << _BITS) + (row + _MIDDLE), np.int64
    )


def decode(codes: Int64Array) -> tuple[Int64Array, Int64Array, Int64Array]:
    """Return level, column and row."""
    return (
        (codes >> (2 * _BITS)) - _LEVELS,
        ((codes >> _BITS) & _MASK) - _MIDDLE,
        (codes & _MASK) - _MIDDLE,
    )


def keys_of(codes: Int64Array) -> list[TileKey]:
    """Return the keys of codes."""
    return [TileKey(*place) for place in np.stack(decode(codes), axis=-1).tolist()]


def parent_of(codes: Int64Array) -> Int64Array:
    """Return the code of each tile's parent."""
    level, col, row = decode(codes)
    return code_of(level - 1, col >> 1, row >> 1)


def children_of(codes: Int64Array) -> Int64Array:
    """Return the four children of each, shape (n, 4): south-west, south-east, north-west, north-east."""
    level, col, row = (part[:, None] for part in decode(codes))
    return code_of(level + 1, 2 * col + _CHILDREN[:, 0], 2 * row + _CHILDREN[:, 1])


def neighbours_of(codes: Int64Array) -> Int64Array:
    """Return the eight tiles of the same level around each, shape (n, 8), in the order of ``AROUND``."""
    steps = np.array([(east << _BITS) + north for east, north in AROUND], np.int64)
    return np.asarray(codes[:, None] + steps)


@lru_cache(1 << 15)  # frame after frame asks for the same ones
def around(code: int, inside: tuple[int, int, int, int]) -> Sequence[int]:
    """Return those of a tile's eight neighbours inside a range of columns and rows."""
    col, row = ((code >> _BITS) & _MASK) - _MIDDLE, (code & _MASK) - _MIDDLE
    west, east, south, north = inside
    return [
        code + (x << _BITS) + y for x, y in AROUND if west <= col + x <= east and south <= row + y <= north
    ]


@lru_cache(1 << 15)
def parents_around(code: int, inside: tuple[int, int, int, int]) -> Sequence[int]:
    """Return the parents of a tile and of its neighbours inside a range of columns and rows.

    At most four: the tile's own parent and those across its two outer sides.
    """
    col, row = ((code >> _BITS) & _MASK) - _MIDDLE, (code & _MASK) - _MIDDLE
    west, east, south, north = inside
    cols = [c for c in (col >> 1, (col >> 1) + 2 * (col & 1) - 1) if west <= c <= east]
    rows = [r for r in (row >> 1, (row >> 1) + 2 * (row & 1) - 1) if south <= r <= north]
    level = ((code >> (2 * _BITS)) - 1) << (2 * _BITS)
    return [level + ((c + _MIDDLE) << _BITS) + r + _MIDDLE for c in cols for r in rows]


def index_in(found: Int64Array, codes: Int64Array) -> npt.NDArray[np.intp]:
    """Return the index of each code in a sorted array, -1 if missing; any shape."""
    if not found.size:
        return np.full(codes.shape, -1, np.intp)
    at = np.minimum(np.searchsorted(found, codes), found.size - 1)
    return np.where(found[at] == codes, at, -1)


def contains(found: Int64Array, codes: Int64Array) -> npt.NDArray[np.bool_]:
    """Return which codes are in a sorted array; any shape."""
    return index_in(found, codes) >= 0


def boxes_of(codes: Int64Array, extent: float, bottom: Float64Array, top: Float64Array) -> Boxes:
    """Return the boxes of tiles whose terrain lies between two heights (m)."""
    level, col, row = decode(codes)
    width = extent * np.exp2(-level.astype(np.float64))
    west, south = col * width, row * width
    return Boxes(np.stack([west, south, bottom], -1), np.stack([west + width, south + width, top], -1))


def control_codes(codes: Int64Array) -> Int64Array:
    """Return the codes of each tile's nine controls, shape (n, 3, 3): row 0 north, column 0 west."""
    level, col, row = (part[:, None, None] for part in decode(codes))
    x = 2 * col + np.arange(3)[None, None, :] + (1 << _BITS)
    y = 2 * row + np.arange(2, -1, -1)[None, :, None] + (1 << _BITS)
    return np.asarray(((level + _CONTROL_LEVELS) << (2 * _CONTROL_BITS)) + (x << _CONTROL_BITS) + y, np.int64)


UNBOUNDED: Final = (float("-inf"), float("-inf"), float("inf"), float("inf"))
"""West, south, east, north (m) of an unbounded world."""


def tile_range(bounds: Bounds, width: float) -> Bounds:
    """Return first and last column, first and last row of the tiles of a width (m) that intersect bounds."""
    west, south, east, north = (np.array(bounds) / width).tolist()
    return float(np.floor(west)), float(np.ceil(east)) - 1, float(np.floor(south)), float(np.ceil(north)) - 1


def intersects_bounds(codes: Int64Array, extent: float, bounds: Bounds) -> npt.NDArray[np.bool_]:
    """Return which tiles share more than a border with the bounds; any shape."""
    if bounds == UNBOUNDED:
        return np.ones(codes.shape, np.bool_)
    level, col, row = decode(codes)
    width = extent * np.exp2(-level.astype(np.float64))
    west, south, east, north = bounds
    inside = (col * width < east) & ((col + 1) * width > west)
    return np.asarray(inside & (row * width < north) & ((row + 1) * width > south))


def touches_areas(codes: Int64Array, extent: float, areas: Sequence[Bounds], margin: float) -> BoolArray:
    """Return which tiles, with a margin (of their width), touch areas (west, south, east, north; m)."""
    flat = np.zeros(len(codes))
    boxes = boxes_of(codes, extent, flat, flat)
    low, high = boxes.low[:, None, :2], boxes.high[:, None, :2]
    more = margin * (high - low)
    box = np.asarray(areas, np.float64).reshape(1, -1, 4)
    meets = (box[..., :2] <= high + more) & (box[..., 2:] >= low - more)
    return np.asarray(meets.all(axis=-1).any(axis=-1))


def clip_boxes(boxes: Boxes, bounds: Bounds) -> Boxes:
    """Return boxes clipped to bounds; boxes outside become flat."""
    if bounds == UNBOUNDED:
        return boxes
    low, high = boxes.low.copy(), boxes.high.copy()
    for corners in (low, high):
        corners[:, :2] = np.clip(corners[:, :2], bounds[:2], bounds[2:])
    return Boxes(low, high)


NORTH, SOUTH, WEST, EAST = 1, 2, 4, 8
"""Bits of a case: that side borders on a coarser tile, or on one that shows only its parent."""
PARENT: Final = 16
"""Case of a tile that shows only its parent: every other vertex suffices."""
CASES: Final = 17


@cache
def tile_indices(quads: int) -> tuple[npt.NDArray[np.uint32], npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return (indices, first, count): the uint32 triangles of every case, and each case's part of them.

    `quads` is the even number of quads along a side. Triangles are counter-clockwise from above; vertices are
    numbered in rows from north to south, each from west to east; quads are cut from north-west to south-east.
    """
    if quads < 2 or quads % 2:
        raise InputError(f"expected an even number of quads ≥ 2, got {quads}")
    cases = [_case(quads, case) for case in range(CASES)]
    count = np.array([len(case) for case in cases], np.int64)
    indices = np.concatenate(cases).astype(np.uint32)
    for array in (indices, count, first := np.cumsum(count) - count):
        array.setflags(write=False)
    return indices, first, count


def _case(quads: int, case: int) -> Int64Array:
    side = quads + 1
    vertex = np.arange(side * side, dtype=np.int64).reshape(side, side)
    if case == PARENT:
        return _cut(vertex[::2, ::2]).reshape(-1)
    seen = vertex.copy()
    odd = np.arange(1, quads, 2)
    if case & NORTH:
        seen[0, odd] = vertex[0, odd - 1]
    if case & SOUTH:
        seen[-1, odd] = vertex[-1, odd + 1]
    if case & WEST:
        seen[odd, 0] = vertex[odd - 1, 0]
    if case & EAST:
        seen[odd, -1] = vertex[odd + 1, -1]
    nw, ne, sw, se = _corners(seen)
    triangles = _cut(seen)
    for corner, borders in (((0, -1), NORTH | EAST), ((-1, 0), SOUTH | WEST)):
        if case & borders == borders:
            one, two, three, four = (int(each[corner]) for each in (nw, sw, se, ne))
            triangles[corner] = [(one, two, four), (two, three, four)]
    triangles = triangles.reshape(-1, 3)
    a, b, c = triangles.T
    return np.asarray(triangles[(a != b) & (b != c) & (a != c)].reshape(-1))


def _corners(vertex: Int64Array) -> tuple[Int64Array, Int64Array, Int64Array, Int64Array]:
    """Return the north-west, north-east, south-west and south-east vertices of each quad."""
    return vertex[:-1, :-1], vertex[:-1, 1:], vertex[1:, :-1], vertex[1:, 1:]


def _cut(vertex: Int64Array) -> Int64Array:
    """Return the two triangles of each quad, shape (rows, columns, 2, 3)."""
    nw, ne, sw, se = _corners(vertex)
    return np.stack([np.stack([nw, sw, se], -1), np.stack([nw, se, ne], -1)], axis=2)
