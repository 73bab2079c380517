"""Layers on a device: their buffers, what affects which block; points and the drained ground by squares."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, LatticeArray, StructuredArray
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.box_index import BoxIndex, item_lists, slot_lists, touch_any
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
from sketchterrain.terrain.layers.layer import (
    MAX_CELL_SIZES,
    Culled,
    LayerChange,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    upload_real,
    upload_reals,
)
from sketchterrain.terrain.layers.points import (
    PackedFeatures,
    PointFinder,
    PointsLayer,
    support_radii,
    unique_by_id,
)
from sketchterrain.terrain.layers.relief import NearNodes, ReliefLayer
from sketchterrain.terrain.noise import FINEST_CELL

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext


class Culler(Protocol):
    """A layer on a device."""

    def updated(self, layer: TerrainLayer, change: LayerChange) -> Culler:
        """Return the same for a changed layer with the same key, sharing what is unchanged."""
        ...

    def cull(self, blocks: LatticeArray, sampling: Sampling, around: LatticeArray | None = None) -> Culled:
        """Return what affects blocks (n, 4) of west, south, east and north, lattice units.

        ``around`` (m, 4): fewer, larger blocks that contain all of them, to select items by.
        """
        ...


class WholeCuller:
    """A layer all of whose items are on the device at once."""

    def __init__(self, layer: TerrainLayer, context: ComputeContext, world: WorldSettings) -> None:
        self._layer = layer
        self._context = context
        self._world = world
        self._packed = LRUCache(MAX_CELL_SIZES)
        self._shared = LRUCache(MAX_CELL_SIZES)  # buffers of arrays, by these

    def updated(self, layer: TerrainLayer, change: LayerChange) -> WholeCuller:
        """Return the culler of a changed layer."""
        del change
        return WholeCuller(layer, self._context, self._world)

    def cull(self, blocks: LatticeArray, sampling: Sampling, around: LatticeArray | None = None) -> Culled:
        """Return what affects blocks."""
        del around
        packed, buffers, index = self._packed.get_or_compute(
            self._layer.pack_key(sampling.cell), lambda: self._upload(sampling)
        )
        if index is None:
            return Culled(buffers, {}, packed)
        starts, members = item_lists(index, blocks, packed.visible)
        prefix = packed.lists
        return Culled(buffers, {f"{prefix}_starts": starts, f"{prefix}_list": members}, packed)

    def _upload(self, sampling: Sampling) -> tuple[Packed, dict[str, Any], BoxIndex | None]:
        packed = self._layer.pack(sampling)
        buffers = {
            name: self._shared.get_or_compute(id(array), partial(self._held, array))[1]
            for name, array in packed.arrays.items()
        }
        return packed, buffers, None if packed.boxes is None else BoxIndex(packed.boxes)

    def _held(self, array: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], Any]:
        """Return an array, whose id is its own while it is held, and its buffer."""
        return array, upload_real(self._context, array)


def list_arrays(culled: Mapping[str, Culled]) -> dict[str, npt.NDArray[Any]]:
    """Return the lists of all layers, by the names of the kernels' arguments."""
    return {name: array for each in culled.values() for name, array in each.lists.items()}


_MAX_SQUARES = 4096
_MAX_BATCHES = 64
# Width of a square over the median support of painted features.
_PAINTED_SUPPORTS = 4
_EVERYWHERE_BITS = 56
# Blocks wider than so many squares are queried one by one.
_WIDEST_BLOCK = 6
# Squares are batched in rectangles whose borders are multiples of so many, if these hold at most so many
# times the squares of one block; their fill is queried in groups of 2^bits by as many.
_ALIGNED = 2
_MAX_SURPLUS = 6
_GROUP_BITS = 2
_ROUNDING = 4  # lattice units


@dataclass(frozen=True, eq=False)
class FeatureBatch:
    """Features near some blocks, for one cell size, in the order of their ids."""

    buffers: dict[str, Any]  # by the names of the kernels' arguments
    packed: PackedFeatures  # the same on the host
    index: BoxIndex  # of the features in ``order``: by slot, then by id
    order: LatticeArray
    smallest: float  # least radius (m); 0 where smaller features have been omitted


class PointCuller:
    """Features of a layer, cached by squares of the world about as wide as the features' support.

    Blocks get the features of all squares around them; their lists are culled exactly, so that no bit depends
    on the squares.
    """

    def __init__(
        self,
        layer: PointsLayer,
        context: ComputeContext,
        world: WorldSettings,
        finder: PointFinder | None = None,
    ) -> None:
        self._layer = layer
        self._context = context
        self._world = world
        self.finder = PointFinder(layer, world) if finder is None else finder
        self._worlds = LRUCache(MAX_CELL_SIZES)
        self._margin = 0
        unit = world.unit
        if layer.fill.max_radius > 0:
            self._margin = int((layer.fill.max_radius * support_radii(world.fidelity) + 1) / unit) + 1
        painted = float(np.median(layer.painted["radius"])) if layer.painted.size else 0.0
        width = max(self._margin, int(_PAINTED_SUPPORTS * support_radii(world.fidelity) * painted / unit), 1)
        # Without features, one square is enough.
        empty = self._margin == 0 and layer.painted.size == 0
        self._bits = _EVERYWHERE_BITS if empty else width.bit_length()
        self._squares = LRUCache(_MAX_SQUARES)  # fill by column and row
        self._batches = LRUCache(_MAX_BATCHES)  # by cell size and squares

    def updated(self, layer: TerrainLayer, change: LayerChange) -> PointCuller:
        """Return the culler of a changed layer with the same key.

        Squares and batches that no change touches are retained.
        """
        assert isinstance(layer, PointsLayer)  # noqa: S101 # a layer is followed by one of its kind
        finder = self.finder.updated(layer, change)
        other = PointCuller(layer, self._context, self._world, finder)
        if other._margin != self._margin or abs(other._bits - self._bits) > 1:
            return other
        other._bits = self._bits
        other._squares = self._outside(self._squares, change.unbounded)
        if layer.dune_styles == self._layer.dune_styles:  # which lists' numbers depend on
            other._worlds = self._worlds
            other._batches = self._outside(self._batches, change.boxes)
        return other

    def _outside(self, cache: LRUCache, areas: LatticeArray) -> LRUCache:
        """Return the entries that touch none of some areas (n, 4)."""
        keys = cache.keys()
        blocks = [self._key_blocks(key) for key in keys]
        grown = areas + np.array([-_ROUNDING, -_ROUNDING, _ROUNDING, _ROUNDING])
        touched = touch_any(np.concatenate([np.zeros((0, 4), np.int64), *blocks]), grown)
        parts = np.split(touched, np.cumsum([len(each) for each in blocks]))[:-1]
        return cache.retained(key for key, part in zip(keys, parts, strict=True) if not part.any())

    def cull(self, blocks: LatticeArray, sampling: Sampling, around: LatticeArray | None = None) -> Culled:
        """Return what affects blocks (n, 4), lattice units.

        ``around`` (m, 4): fewer, larger blocks that contain all of them, to select features by.
        """
        world = self._worlds.get_or_compute(
            sampling.cell,
            lambda: upload_reals(self._context, self._layer.pack(sampling).arrays),
        )
        batch = self.batch(blocks if around is None else around, sampling.cell)
        starts, members = slot_lists(batch.index, blocks, batch.packed.slot, self._layer.slots, batch.order)
        lists = {"point_starts": starts, "point_list": members}
        return Culled(world | batch.buffers, lists, batch.packed)

    def near(self, blocks: LatticeArray) -> StructuredArray:
        """Return the features that may affect any of the blocks, sorted by id."""
        return self.finder.near(blocks, min_radius=0.0)

    def _blocks_of(self, squares: LatticeArray) -> LatticeArray:
        """Return west, south, east and north of squares, lattice units."""
        return np.concatenate([squares, squares + 1], axis=1) << self._bits

    def _key_blocks(self, key: tuple[Any, Any]) -> LatticeArray:
        """Return the blocks of the key of a square or of a batch."""
        squares = key[1]
        if not isinstance(squares, bytes):
            return self._blocks_of(np.array([key]))
        numbers = np.frombuffer(squares, np.int64, offset=1)
        return numbers.reshape(-1, 4) if squares[0] else self._blocks_of(numbers.reshape(-1, 2))

    def batch(self, blocks: LatticeArray, cell: float) -> FeatureBatch:
        """Return the features near any block (n, 4), without those too small for the cell size (m)."""
        wide = int((blocks[:, 2:] - blocks[:, :2]).max()) > _WIDEST_BLOCK << self._bits
        squares = blocks if wide else self._squares_around(blocks)
        key = bytes([wide]) + squares.tobytes()
        # Features that are all fully visible share the batch of the finest cell.
        for known in (FINEST_CELL, cell):
            found: FeatureBatch | None = self._batches.get((known, key))
            if found is not None and (known == cell or 2 * cell <= found.smallest):
                return found
        near = self.finder.near(blocks, min_radius=cell) if wide else self._features_of(squares, cell)
        # Small fill features may have been omitted.
        complete = cell == FINEST_CELL or not (wide or self._layer.fill.max_radius < cell)
        batch = self._packed(near, cell, float(near["radius"].min(initial=np.inf)) if complete else 0.0)
        known = FINEST_CELL if 2 * cell <= batch.smallest else cell
        return self._batches.store((known, key), batch)

    def _packed(self, near: StructuredArray, cell: float, smallest: float) -> FeatureBatch:
        packed = self._layer.pack_features(near, self._world, cell)
        order = np.lexsort((np.arange(packed.slot.size), packed.slot))
        wide = np.ceil(packed.support[order] / self._world.unit).astype(np.int64)[:, None]
        at = packed.at[order]
        index = BoxIndex(np.concatenate([at - wide, at + wide], axis=1))
        buffers = upload_reals(self._context, {"point_at": packed.at, "point_row": packed.row})
        return FeatureBatch(buffers, packed, index, order, smallest)

    def _squares_around(self, blocks: LatticeArray) -> LatticeArray:
        """Return columns and rows of the squares with features near the blocks, shape (n, 2)."""
        first = (blocks[:, :2] - self._margin) >> self._bits
        last = (blocks[:, 2:] + self._margin) >> self._bits
        most = (last - first).max(axis=0) + 1
        low, high = first.min(axis=0) & -_ALIGNED, last.max(axis=0) | (_ALIGNED - 1)
        if np.prod(high - low + 1) <= _MAX_SURPLUS * np.prod(most):
            # One rectangle for many sets of blocks, whose features are then packed once.
            grid = np.mgrid[low[0] : high[0] + 1, low[1] : high[1] + 1]
            return np.ascontiguousarray(grid.reshape(2, -1).T)
        return unique_places(covered_places(first, last)[1])

    def _features_of(self, squares: LatticeArray, cell: float) -> StructuredArray:
        """Return all features of squares, sorted by id, without the fill if too small for the cell size."""
        ground = self._blocks_of(squares)
        found = self.finder.painted_near(ground)
        if self._margin and self._layer.fill.max_radius >= cell:
            return unique_by_id([found, *self._fill_of(squares)])
        return found

    def _fill_of(self, squares: LatticeArray) -> list[StructuredArray]:
        """Return the fill centred in each square."""
        keys = [(int(column), int(row)) for column, row in squares]
        known = {key: self._squares.get(key) for key in keys}
        missing = [key for key, features in known.items() if features is None]
        if missing:
            side = self._world.unit * 2.0**self._bits
            square = 1 << _GROUP_BITS
            corners = np.unique(np.array(missing) >> _GROUP_BITS, axis=0) << _GROUP_BITS
            group = (corners[:, None] + np.indices((square, square)).reshape(2, -1).T).reshape(-1, 2)
            found = self._within(corners, square)
            # Queried in a slightly larger area, so that rounding at a square's border loses and doubles none.
            column, row = (np.floor(found[axis] / side).astype(np.int64) for axis in ("x", "y"))
            for key in map(tuple, group.tolist()):
                own = self._squares.store(key, found[(column == key[0]) & (row == key[1])])
                if key in known:
                    known[key] = own
        return list(known.values())

    def _within(self, corners: LatticeArray, square: int) -> StructuredArray:
        """Return the fill centred in or just outside groups of squares, without duplicates."""
        side = self._world.unit * 2.0**self._bits
        parts = []
        complete = np.ptp(corners, axis=0) // square + 1
        if np.prod(complete) <= 4 * len(corners):
            areas = [(*corners.min(axis=0), *(corners.max(axis=0) + square))]
        else:
            areas = [(*corner, *(corner + square)) for corner in corners]
        for west, south, east, north in areas:
            box = (west * side - 1, south * side - 1, east * side + 1, north * side + 1)
            parts.append(self._layer.fill.within(*(float(edge) for edge in box)))
        return unique_by_id(parts)


# On the device: the nodes have ten times as many bytes as the extremes that the cache counts.
_MAX_RECTANGLES = 24
_MAX_EXTREMES_BYTES = 1 << 22
# Nodes of blocks are uploaded as one rectangle if that has at most so many times the chunks that they read.
_MAX_NODE_SURPLUS = 3


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
        if np.prod(end - corner + 1) <= _MAX_NODE_SURPLUS * len(places):
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
