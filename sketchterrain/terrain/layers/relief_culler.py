"""Nodes of the drained ground around evaluated blocks, on a device."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.lattice import covered_places, unique_places
from sketchterrain.landforms.node_raster import (
    APRON,
    CHUNK,
    NODE_BITS,
    SQUARE,
    NodeWindow,
    node_level,
    square_extremes,
)
from sketchterrain.terrain.culler import MAX_CELL_SIZES, upload_reals
from sketchterrain.terrain.layers.layer import Culled, LayerChange, Sampling, TerrainLayer, WorldSettings
from sketchterrain.terrain.layers.relief import NearNodes, ReliefLayer

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

# On the device: the nodes have ten times as many bytes as the extremes that the cache counts.
_MAX_RECTANGLES = 24
_MAX_EXTREMES_BYTES = 1 << 22
# Nodes of blocks are uploaded as one rectangle if that has at most so many times the chunks that they read.
_MAX_SURPLUS = 3


@dataclass(frozen=True, eq=False)
class _Rectangle:
    """Chunks on the device."""

    buffers: dict[str, Any]  # by the names of the kernels' arguments
    extremes: Float64Array  # (squares, 5)


def _rectangles() -> LRUCache:
    return LRUCache(_MAX_RECTANGLES, max_bytes=_MAX_EXTREMES_BYTES)


class ReliefCuller:
    """Rectangles of nodes around blocks; no bit depends on the rectangle that a node is read from."""

    def __init__(self, layer: ReliefLayer, context: ComputeContext, world: WorldSettings) -> None:
        self._layer = layer
        self._context = context
        self._world = world
        self._reader = layer.reader()
        self._params = LRUCache(MAX_CELL_SIZES)
        self._rectangles = _rectangles()

    def updated(self, layer: TerrainLayer, change: LayerChange) -> ReliefCuller:
        """Return the culler of a layer with another painted raster; unchanged chunks are retained."""
        assert isinstance(layer, ReliefLayer)  # noqa: S101 # a layer is followed by one of its kind
        other = copy(self)
        other._layer, other._rectangles = layer, _rectangles()
        other._reader = self._reader.updated(layer.painted, change.boxes)
        return other

    def cull(self, blocks: LatticeArray, sampling: Sampling, around: LatticeArray | None = None) -> Culled:
        """Return the nodes that blocks (n, 4) read."""
        del around
        params = self._params.get_or_compute(
            sampling.cell,
            lambda: upload_reals(self._context, self._layer.pack(sampling).arrays),
        )
        level = node_level(sampling.cell, self._world.extent)
        bits = NODE_BITS + level
        low = (blocks[:, :2] >> bits) - APRON[0]
        high = (blocks[:, 2:] >> bits) + APRON[1]
        places = unique_places(covered_places(low // CHUNK, high // CHUNK)[1])
        corner, end = places.min(axis=0), places.max(axis=0)
        if np.prod(end - corner + 1) <= _MAX_SURPLUS * len(places):
            key = level, places.tobytes()
            found = self._rectangles.get_or_compute(key, lambda: self._uploaded(level, places, corner, end))
            buffers, width = found.buffers, int(end[0] - corner[0] + 1) * CHUNK
            first = low - corner * CHUNK
            form = np.stack([first[:, 1] * width + first[:, 0], np.full(len(blocks), width)], axis=-1)
            block, square = covered_places(first // SQUARE, (first + high - low) // SQUARE)
            near = found.extremes[square[:, 1] * (width // SQUARE) + square[:, 0]]
        else:
            parts = [
                self._reader.window(level, *(int(n) for n in (*a, *(b - a + 1)[::-1])))
                for a, b in zip(low, high, strict=True)
            ]
            rows_of = (
                np.concatenate([each.ravel() for each in values]) for values in zip(*parts, strict=True)
            )
            buffers = self._buffers(NodeWindow(*rows_of))
            size = high - low + 1
            form = np.stack([np.cumsum(np.prod(size, axis=1)) - np.prod(size, axis=1), size[:, 0]], axis=-1)
            block = np.arange(len(blocks))
            near = np.array([_extremes(part) for part in parts])
        form[:, 0] += APRON[0] * (form[:, 1] + 1)
        # From the node of the block's corner, or coarse nodes would be farther than 32 bits.
        lists: dict[str, Any] = {"relief_at": (low + APRON[0]) << bits, "relief_form": form.astype(np.int32)}
        ends = np.searchsorted(block, np.arange(len(blocks)))
        lowest = np.minimum.reduceat(near[:, :1], ends)
        extremes = np.concatenate([lowest, np.maximum.reduceat(near[:, 1:], ends)], axis=1)
        return Culled(params | buffers, lists, NearNodes(level, extremes))

    def _uploaded(
        self, level: int, places: LatticeArray, corner: LatticeArray, end: LatticeArray
    ) -> _Rectangle:
        window = self._reader.joined(level, places, corner, end)
        return _Rectangle(self._buffers(window), square_extremes(window))

    def _buffers(self, window: NodeWindow) -> dict[str, Any]:
        return {f"relief_{name}": self._context.upload(each) for name, each in window._asdict().items()}


def _extremes(window: NodeWindow) -> tuple[float, ...]:
    """Return the extremes of a window, as of `square_extremes`."""
    height, *shares, _ = window
    step = max(float(np.abs(np.diff(height, axis=axis)).max()) for axis in (0, 1))
    return float(height.min()), float(height.max()), step, *(float(each.max()) for each in shares)
