"""Nodes of the drained ground at several levels: painted ones over unpainted ones, in cached chunks.

Node (i, j) of level k stands (i, j) · r0 · 2^k m east and north of the sketch's south-west corner, with r0 =
extent / 256. Samples of a cell size read the coarsest level whose spacing it reaches.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import compress
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import (
    Float32Array,
    Float64Array,
    LatticeArray,
    StructuredArray,
    UInt8Array,
)
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.box_index import ITEM, content_items, touch_any
from sketchterrain.io.disk_cache import RecordCache
from sketchterrain.io.resources import kernel_constants
from sketchterrain.landforms.base_ground import BaseGround, NodeSource

NODE_BITS = int(kernel_constants("layers/relief.clh", "NODE_BITS")[0])
"""Of the spacing of level 0, lattice units."""
CHUNK = 64
"""Nodes along a side of a cached chunk."""
SQUARE = 8
"""Nodes along a side of a square that has extremes of its own."""
APRON = (2, 3)
"""Nodes that are read south-west and north-east of a position's: the spline's, displaced by a spacing."""
COARSEST = 14

_ITEM_NODES = 32  # of level 0 along a side of an item
_PAINTED_LEVELS = 6
_MAX_CHUNKS_BYTES = 1 << 25
_ROUNDING = 4  # lattice units


def node_level(cell: float, extent: float) -> int:
    """Return the level of the nodes that samples of a cell size (m) read."""
    level = 0
    while level < COARSEST and cell >= extent * 2.0 ** (level + 1 + NODE_BITS - 24):
        level += 1
    return level


_NODE: Final[Any] = np.dtype([("height", "f4"), ("rock", "u1"), ("wetness", "u1")])


@dataclass(frozen=True, eq=False)
class PaintedNodes:
    """Drained nodes of one level, rows northward from node (column, row); heights are NaN outside of them."""

    column: int
    row: int
    height: Float32Array  # m
    rock: UInt8Array  # 0 … 255
    wetness: UInt8Array  # 0 … 255
    area: Float32Array  # m²: how much ground drains through a node


class GroundBeside(NamedTuple):
    """Ground beside elevation data, and the data's weights."""

    base: BaseGround
    height: Float64Array  # m, at the nodes of the finest level that was drained

    def share(self, level: int, nodes: PaintedNodes) -> Float64Array:
        """Return the heights (m) of nodes of a level by the weight that the data leave."""
        data = self.base.window(level, nodes.column, nodes.row, *nodes.height.shape)
        return np.asarray((1.0 - data.weight.astype(np.float64)) * nodes.height)


@dataclass(frozen=True, eq=False)
class DrainedRaster:
    """The painted region, drained as one raster, and its means at coarser levels."""

    levels: tuple[PaintedNodes, ...]
    beside: GroundBeside | None = None  # over elevation data, of the last level that was drained

    @classmethod
    def from_drained(
        cls, levels: Sequence[PaintedNodes], beside: GroundBeside | None = None
    ) -> DrainedRaster:
        """Return the raster of some levels, finest first, and the means of the last one at coarser ones.

        Over elevation data the ground beside them, and what features add, have means, not what nodes hold of
        both: the weights of the data at coarse nodes are no means.
        """
        every = list(levels)
        if beside is None:
            while len(every) < _PAINTED_LEVELS:
                every.append(_halved(every[-1]))
            return cls(tuple(every))
        ground = replace(every[-1], height=beside.height.astype(np.float32))
        height = every[-1].height - beside.share(len(every) - 1, ground)
        added = replace(ground, height=height.astype(np.float32))
        while len(every) < _PAINTED_LEVELS:
            added, ground = _halved(added), _halved(ground)
            height = added.height + beside.share(len(every), ground)
            every.append(replace(added, height=height.astype(np.float32)))
        return cls(tuple(every), beside)

    def items(self) -> StructuredArray:
        """Return blocks of nodes by their contents, and the boxes (lattice units) that they affect."""
        contents: list[bytes] = []
        corners: list[tuple[int, int, int, int]] = []
        for level, nodes in enumerate(self.levels):
            side, bits = max(_ITEM_NODES >> level, 1), NODE_BITS + level
            reach = (3 << bits >> 1) + (1 << NODE_BITS) + _ROUNDING
            south, west = nodes.row % side, nodes.column % side
            rows, columns = (
                -(-(start + count) // side)
                for start, count in zip((south, west), nodes.height.shape, strict=True)
            )
            window = np.zeros((rows * side, columns * side), _NODE)
            window["height"] = np.nan
            inner = window[south : south + nodes.height.shape[0], west : west + nodes.height.shape[1]]
            for name in _NODE.names:
                inner[name] = getattr(nodes, name)
            blocks = window.reshape(rows, side, columns, side).swapaxes(1, 2)
            for row, column in np.argwhere(~np.isnan(blocks["height"]).all(axis=(2, 3))).tolist():
                place = level, nodes.row - south + side * row, nodes.column - west + side * column
                contents.append(np.array(place).tobytes() + blocks[row, column].tobytes())
                corners.append((place[2], place[1], bits, reach))
        if not contents:
            return np.zeros(0, ITEM)
        west, south, bits, reach = np.array(corners, np.int64).T
        low = np.stack([west << bits, south << bits], axis=-1) - reach[:, None]
        width = np.maximum(_ITEM_NODES >> (bits - NODE_BITS), 1) << bits
        return content_items(contents, low, low + (width + 2 * reach)[:, None])


def _halved(nodes: PaintedNodes) -> PaintedNodes:
    """Return every second node of a level, each the mean (1 2 1) of those around it."""
    column, row = -(-nodes.column // 2), -(-nodes.row // 2)
    skip = np.s_[2 * row - nodes.row :: 2, 2 * column - nodes.column :: 2]
    inside = ~np.isnan(nodes.height)
    weight = _smoothed(inside.astype(np.float64))

    def mean(values: Float32Array | UInt8Array) -> Float64Array:
        total = _smoothed(np.where(inside, values, 0).astype(np.float64))
        return np.asarray((total / np.maximum(weight, 1e-9))[skip])

    height = np.where(inside[skip], mean(nodes.height), np.nan).astype(np.float32)
    rock, wet = (np.rint(mean(each)).astype(np.uint8) for each in (nodes.rock, nodes.wetness))
    return PaintedNodes(column, row, height, rock, wet, mean(nodes.area).astype(np.float32))


def _smoothed(values: Float64Array) -> Float64Array:
    padded = np.pad(values, 1)
    rows = padded[:-2] + 2 * padded[1:-1] + padded[2:]
    return np.asarray(rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:])


class NodeWindow(NamedTuple):
    """Nodes as they are read, (rows, columns): heights (m), rock and wetness (0 … 255), weights of a base."""

    height: Float32Array
    rock: UInt8Array
    wetness: UInt8Array
    base: Float32Array  # 0 … 1; empty without a base


CHUNK_RECORD: np.dtype[np.void] = np.dtype([(name, _NODE[name], (CHUNK, CHUNK)) for name in _NODE.names])
"""A chunk of unpainted nodes in a cache on disk."""

_NO_BASE = np.zeros((0, 0), np.float32)


class NodeReader:
    """Chunks of nodes of the painted raster over unpainted ground, in a bounded cache and perhaps on disk."""

    def __init__(
        self,
        source: NodeSource,
        painted: DrainedRaster | None,
        disk: RecordCache | None = None,
        base: BaseGround | None = None,
    ) -> None:
        self._source = source
        self._painted = painted
        self._base = base
        self._disk = disk
        self._chunks = LRUCache(max_bytes=_MAX_CHUNKS_BYTES)

    def updated(self, painted: DrainedRaster | None, boxes: LatticeArray) -> NodeReader:
        """Return the reader of another painted raster that differs in boxes (n, 4), lattice units."""
        other = copy(self)
        other._painted = painted
        keys = self._chunks.keys()
        level, *place = np.array(keys, np.int64).reshape(-1, 3).T
        low = np.stack(place, axis=1)
        chunks = np.concatenate([low, low + 1], axis=1) * CHUNK << (NODE_BITS + level)[:, None]
        other._chunks = self._chunks.retained(compress(keys, ~touch_any(chunks, boxes)))
        return other

    def chunks(self, level: int, places: LatticeArray) -> list[NodeWindow]:
        """Return chunks (n, 2) of a level by their columns and rows."""
        keys = [(level, int(column), int(row)) for column, row in places]
        found: list[Any] = [self._cached(key) for key in keys]
        missing = [number for number, chunk in enumerate(found) if chunk is None]
        if missing:
            low, high = places[missing].min(axis=0), places[missing].max(axis=0) + 1
            if np.prod(high - low) > 2 * len(missing):  # far apart
                self._source.prepare(
                    level, CHUNK * places[missing], CHUNK, CHUNK, painted=not self._painted_at(level)
                )
                return [
                    self._read(level, place, place + 1)[0] if chunk is None else chunk
                    for place, chunk in zip(places, found, strict=True)
                ]
            new = self._read(level, low, high)
            width = int(high[0] - low[0])
            for number in missing:
                column, row = (int(part) for part in places[number] - low)
                found[number] = new[row * width + column]
        return found

    def _cached(self, key: tuple[int, int, int]) -> NodeWindow | None:
        chunk: NodeWindow | None = self._chunks.get(key)
        content = self._disk.get(self._disk_key(key)) if chunk is None and self._disk is not None else None
        if content is not None:
            record = np.frombuffer(bytearray(content), CHUNK_RECORD)
            nodes = [record[name][0] for name in ("height", "rock", "wetness")]
            chunk = self._chunks.store(key, self._finished(nodes, key))
        return chunk

    def _disk_key(self, key: tuple[int, int, int]) -> tuple[int, int, int, int]:
        return *key, len(self._painted_at(key[0]))

    def _read(self, level: int, low: LatticeArray, high: LatticeArray) -> list[NodeWindow]:
        """Return the chunks of a rectangle, rows northward, and cache them."""
        columns, rows = (int(part) for part in high - low)
        corner = int(low[0]) * CHUNK, int(low[1]) * CHUNK
        whole = not self._painted_at(level)
        nodes = self._source.window(level, *corner, rows * CHUNK, columns * CHUNK, painted=whole)
        shares = [np.rint(np.clip(each, 0, 1) * 255).astype(np.uint8) for each in (nodes.rock, nodes.wetness)]
        window: list[npt.NDArray[Any]] = [nodes.height.astype(np.float32), *shares]
        chunks, records = [], {}
        for r, c in np.ndindex(rows, columns):
            part = np.s_[r * CHUNK : (r + 1) * CHUNK, c * CHUNK : (c + 1) * CHUNK]
            own = [each[part].copy() for each in window]
            key = level, int(low[0]) + c, int(low[1]) + r
            records[self._disk_key(key)] = b"".join(each.tobytes() for each in own)
            chunks.append(self._chunks.store(key, self._finished(own, key)))
        if self._disk is not None:
            self._disk.add(records)
        return chunks

    def _painted_at(self, level: int) -> tuple[PaintedNodes, ...]:
        return self._painted.levels[level : level + 1] if self._painted is not None else ()

    def _finished(self, unpainted: list[npt.NDArray[Any]], key: tuple[int, int, int]) -> NodeWindow:
        """Return a chunk of unpainted nodes (in place) without those of a base, and with painted ones."""
        height, rock, wetness = unpainted
        weight = _NO_BASE
        if self._base is not None:
            data = self._base.window(key[0], CHUNK * key[1], CHUNK * key[2], CHUNK, CHUNK)
            weight, free = data.weight, 1.0 - data.weight.astype(np.float64)
            height[...] = free * (height + data.around)
            rock[...] = np.rint(free * rock + 255.0 * data.weight * data.rock)
        chunk = NodeWindow(height, rock, wetness, weight)
        self._paint_over(chunk, key)
        return chunk

    def _paint_over(self, chunk: NodeWindow, key: tuple[int, int, int]) -> None:
        """Write the painted nodes into a chunk."""
        height, *shares, _ = chunk
        for own in self._painted_at(key[0]):
            south, west = own.row - CHUNK * key[2], own.column - CHUNK * key[1]
            h, w = own.height.shape
            here = np.s_[max(south, 0) : max(south + h, 0), max(west, 0) : max(west + w, 0)]
            target = height[here]
            there = np.s_[max(-south, 0) :, max(-west, 0) :]
            z = own.height[there][: target.shape[0], : target.shape[1]]
            inside = ~np.isnan(z)
            target[inside] = z[inside]
            for share, painted_share in zip(shares, (own.rock, own.wetness), strict=True):
                share[here][inside] = painted_share[there][: target.shape[0], : target.shape[1]][inside]

    def window(self, level: int, column: int, row: int, rows: int, columns: int) -> NodeWindow:
        """Return the nodes of a window, from chunks."""
        low = np.array([column, row]) // CHUNK
        high = np.array([column + columns - 1, row + rows - 1]) // CHUNK
        joined = self.joined(level, grid(low, high), low, high)
        south, west = row - int(low[1]) * CHUNK, column - int(low[0]) * CHUNK
        part = np.s_[south : south + rows, west : west + columns]
        return NodeWindow._make(each[part] for each in joined)

    def joined(self, level: int, places: LatticeArray, low: LatticeArray, high: LatticeArray) -> NodeWindow:
        """Return chunks (n, 2) in one window from ``low`` to ``high``, with heights of NaN elsewhere."""
        width, count = ((high - low + 1) * CHUNK).tolist()
        height, shares = np.full((count, width), np.nan, np.float32), np.zeros((2, count, width), np.uint8)
        weight = _NO_BASE if self._base is None else np.zeros(height.shape, np.float32)
        window = NodeWindow(height, shares[0], shares[1], weight)
        for (column, row), chunk in zip(
            ((places - low) * CHUNK).tolist(), self.chunks(level, places), strict=True
        ):
            part = np.s_[row : row + CHUNK, column : column + CHUNK]
            window.height[part] = chunk.height
            window.rock[part], window.wetness[part] = chunk.rock, chunk.wetness
            if self._base is not None:
                window.base[part] = chunk.base
        return window


def square_extremes(window: NodeWindow) -> Float64Array:
    """Return extremes of squares of nodes (n, 5), row by row, of a window of whole chunks.

    They are the lowest and the highest height, the greatest difference (m) of neighbours inside of the square
    and on its eastern and northern border, and the greatest rock and wetness. Heights of NaN count nowhere.
    """
    rows, columns = (count // SQUARE for count in window.height.shape)

    def squares(values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        return values.reshape(rows, SQUARE, columns, SQUARE)

    height = window.height
    step = np.zeros((2, *height.shape), np.float32)
    np.abs(np.diff(height, axis=1), out=step[0, :, :-1])
    np.abs(np.diff(height, axis=0), out=step[1, :-1])
    parts = (
        np.fmin.reduce(squares(height), axis=(1, 3)),
        np.fmax.reduce(squares(height), axis=(1, 3)),
        np.fmax.reduce(squares(np.fmax(step[0], step[1])), axis=(1, 3)),
        squares(window.rock).max(axis=(1, 3)),
        squares(window.wetness).max(axis=(1, 3)),
    )
    return np.stack([part.ravel().astype(np.float64) for part in parts], axis=-1)


def grid(low: LatticeArray, high: LatticeArray) -> LatticeArray:
    """Return columns and rows from a corner to another, both inclusive, (n, 2)."""
    place = np.mgrid[low[0] : high[0] + 1, low[1] : high[1] + 1]
    return np.ascontiguousarray(place.reshape(2, -1).T)
