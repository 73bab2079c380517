"""Cache of the features around evaluated blocks, on the device."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, LatticeArray, StructuredArray
from sketchterrain.terrain.culling import BoxIndex, feature_index, feature_lists, features_near, painted_near
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import PackedFeatures, pack_features, slot_count, support_radii
from sketchterrain.terrain.recipe import FINEST_CELL, TerrainRecipe

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.culling import Lists

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

    at: Any  # device buffers of ``Features`` in ``kernels/world.clh``
    row: Any
    packed: PackedFeatures  # the same on the host
    slots: int  # number of kinds
    index: BoxIndex  # see :func:`~sketchterrain.terrain.culling.feature_index`
    order: LatticeArray
    smallest: float  # least radius (m); 0 where smaller features have been omitted

    def lists(self, blocks: LatticeArray) -> Lists:
        """Return which features affect which block: ``starts`` and ``list`` of the kernels' ``Features``."""
        return feature_lists(self.index, self.order, self.packed.slot, self.slots, blocks)


class FeatureCache:
    """Features of a recipe, cached by squares of the world about as wide as the features' support.

    Blocks get the features of all squares around them; :meth:`FeatureBatch.lists` culls exactly, so that no
    bit depends on the squares.
    """

    def __init__(self, recipe: TerrainRecipe, context: ComputeContext) -> None:
        self._recipe = recipe
        self._context = context
        self._slots = slot_count(recipe)
        self._margin = 0
        unit = metres_per_unit(recipe.extent)
        if recipe.fill.max_radius > 0:
            self._margin = int((recipe.fill.max_radius * support_radii(recipe) + 1) / unit) + 1
        painted = float(np.median(recipe.painted["radius"])) if recipe.painted.size else 0.0
        width = max(self._margin, int(_PAINTED_SUPPORTS * support_radii(recipe) * painted / unit), 1)
        # Without features, one square is enough.
        empty = self._margin == 0 and recipe.painted.size == 0
        self._bits = _EVERYWHERE_BITS if empty else width.bit_length()
        self._squares: OrderedDict[tuple[int, int], StructuredArray] = OrderedDict()
        self._batches: OrderedDict[tuple[float, bytes], FeatureBatch] = OrderedDict()

    def with_recipe(self, recipe: TerrainRecipe) -> FeatureCache:
        """Return the cache of a recipe that differs only in its painted features' strengths."""
        other = copy(self)
        other._recipe = recipe
        other._batches = OrderedDict()
        return other

    def updated(self, recipe: TerrainRecipe, areas: Sequence[Bounds]) -> FeatureCache:
        """Return the cache of a changed recipe with the same noises and kinds of features.

        Squares and batches outside the areas (m), which contain the support of all changed features, are
        retained.
        """
        other = FeatureCache(recipe, self._context)
        if other._margin != self._margin or abs(other._bits - self._bits) > 1:
            return other
        other._bits = self._bits
        changed = np.array(areas, np.float64).reshape(-1, 4) / metres_per_unit(recipe.extent)
        changed += [-_ROUNDING, -_ROUNDING, _ROUNDING, _ROUNDING]
        squares = list(self._squares.items())
        ground = self._blocks_of(np.array([key for key, _ in squares], np.int64).reshape(-1, 2))
        for (key, points), meets in zip(squares, _overlap_any(ground, changed).tolist(), strict=True):
            if not meets:
                other._squares[key] = points
        for known, found in self._batches.items():
            if not _overlap_any(self._key_blocks(known[1]), changed).any():
                other._batches[known] = found
        return other

    def _blocks_of(self, squares: LatticeArray) -> LatticeArray:
        """Return west, south, east and north of squares, lattice units."""
        return np.concatenate([squares, squares + 1], axis=1) << self._bits

    def _key_blocks(self, key: bytes) -> LatticeArray:
        """Return the blocks of a batch's key."""
        numbers = np.frombuffer(key, np.int64, offset=1)
        return numbers.reshape(-1, 4) if key[0] else self._blocks_of(numbers.reshape(-1, 2))

    def batch(self, blocks: LatticeArray, cell: float) -> FeatureBatch:
        """Return the features near any block (n, 4), without those too small for the cell size (m)."""
        wide = int((blocks[:, 2:] - blocks[:, :2]).max()) > _WIDEST_BLOCK << self._bits
        squares = blocks if wide else self._squares_around(blocks)
        key = bytes([wide]) + squares.tobytes()
        # Features that are all fully visible share the batch of the finest cell.
        for known in (FINEST_CELL, cell):
            found = self._batches.get((known, key))
            if found is not None and (known == cell or 2 * cell <= found.smallest):
                self._batches.move_to_end((known, key))
                return found
        near = features_near(self._recipe, blocks, cell) if wide else self._features_of(squares, cell)
        # Small fill features may have been omitted.
        complete = cell == FINEST_CELL or not (wide or self._recipe.fill.max_radius < cell)
        found = self._packed(near, cell, float(near["radius"].min(initial=np.inf)) if complete else 0.0)
        self._batches[FINEST_CELL if 2 * cell <= found.smallest else cell, key] = found
        if len(self._batches) > _MAX_BATCHES:
            self._batches.popitem(last=False)
        return found

    def _packed(self, near: StructuredArray, cell: float, smallest: float) -> FeatureBatch:
        packed = pack_features(self._recipe, near, cell)
        index, order = feature_index(self._recipe, packed)
        upload = self._context.upload
        return FeatureBatch(
            upload(packed.at),
            upload(packed.row.astype(self._context.real_dtype)),
            packed,
            self._slots,
            index,
            order,
            smallest,
        )

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
        step = np.indices(tuple(most)).reshape(2, -1).T
        squares = (first[:, None] + step)[np.all(step <= (last - first)[:, None], axis=-1)]
        low = squares.min(axis=0)
        rows = int(np.ptp(squares[:, 1])) + 1
        # As one number each: np.unique of rows is many times slower.
        number = np.unique((squares[:, 0] - low[0]) * rows + (squares[:, 1] - low[1]))
        return np.asarray(np.stack(np.divmod(number, rows), axis=-1) + low)

    def _features_of(self, squares: LatticeArray, cell: float) -> StructuredArray:
        """Return all features of squares, sorted by id, without the fill if too small for the cell size."""
        ground = self._blocks_of(squares)
        found = painted_near(self._recipe, ground)
        if self._margin and self._recipe.fill.max_radius >= cell:
            found = np.concatenate([found, *self._fill_of(squares)])
        _, unique = np.unique(found["id"], return_index=True)
        return found[unique]

    def _fill_of(self, squares: LatticeArray) -> list[StructuredArray]:
        """Return the fill centred in each square."""
        keys = [(int(column), int(row)) for column, row in squares]
        missing = [key for key in keys if key not in self._squares]
        if missing:
            side = metres_per_unit(self._recipe.extent) * 2.0**self._bits
            square = 1 << _GROUP_BITS
            corners = np.unique(np.array(missing) >> _GROUP_BITS, axis=0) << _GROUP_BITS
            lost = (corners[:, None] + np.indices((square, square)).reshape(2, -1).T).reshape(-1, 2)
            missing = [(col, row) for col, row in lost.tolist() if (col, row) not in self._squares]
            found = self._within(corners, square)
            # Queried in a slightly larger area, so that rounding at a square's border loses and doubles none.
            column, row = (np.floor(found[axis] / side).astype(np.int64) for axis in ("x", "y"))
            for key in missing:
                self._squares[key] = found[(column == key[0]) & (row == key[1])]
        result = [self._squares[key] for key in keys]
        for key in keys:
            self._squares.move_to_end(key)
        while len(self._squares) > max(_MAX_SQUARES, len(keys)):
            self._squares.popitem(last=False)
        return result

    def _within(self, corners: LatticeArray, square: int) -> StructuredArray:
        """Return the fill centred in or just outside groups of squares, without duplicates."""
        side = metres_per_unit(self._recipe.extent) * 2.0**self._bits
        parts = []
        complete = np.ptp(corners, axis=0) // square + 1
        if np.prod(complete) <= 4 * len(corners):
            areas = [(*corners.min(axis=0), *(corners.max(axis=0) + square))]
        else:
            areas = [(*corner, *(corner + square)) for corner in corners]
        for west, south, east, north in areas:
            box = (west * side - 1, south * side - 1, east * side + 1, north * side + 1)
            parts.append(self._recipe.fill.within(*(float(edge) for edge in box)))
        found = np.concatenate(parts)
        _, unique = np.unique(found["id"], return_index=True)
        return found[unique]


def _overlap_any(ground: LatticeArray, areas: Float64Array) -> BoolArray:
    """Return which rectangles overlap any of some areas, both in lattice units."""
    low, high = ground[:, None, :2], ground[:, None, 2:]
    return np.asarray(((areas[:, :2] <= high) & (areas[:, 2:] >= low)).all(axis=-1).any(axis=-1))
