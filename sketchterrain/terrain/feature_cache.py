"""The features around what is evaluated, on the device; kept while the same ground is asked for."""

from __future__ import annotations

from collections import OrderedDict
from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.terrain.culling import feature_index, feature_lists, features_near, painted_near
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_features, slot_count, support_radii
from sketchterrain.terrain.recipe import FINEST_CELL

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Bounds, LatticeArray, StructuredArray
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.culling import BoxIndex, Lists
    from sketchterrain.terrain.packing import PackedFeatures
    from sketchterrain.terrain.recipe import TerrainRecipe


_MOST_SHEETS = 4096
_MOST_GATHERED = 64
# A sheet is at least so many times as wide as half of the painted features reach.
_PAINTED_REACHES = 4
_EVERYWHERE_BITS = 56
# Blocks wider than so many sheets are looked after one by one.
_WIDEST_BLOCK = 6
# Sheets are gathered in rectangles whose borders are multiples of so many, if these hold at most so often
# what one block needs; what fills them is found in squares of 2^bits by as many at once.
_ALIGNED = 2
_MOST_AROUND = 6
_FOUND_TOGETHER_BITS = 2
_ROUNDING = 4  # lattice units


@dataclass(frozen=True, eq=False)
class FeatureBatch:
    """Features that may reach some ground, for one cell size, in the order of their ids.

    Attributes
    ----------
    at, shape
        Device buffers of ``Features`` in ``kernels/world.clh``.
    packed : PackedFeatures
        The same here.
    slots : int
        How many kinds there are.
    index, order
        From :func:`~sketchterrain.terrain.culling.feature_index`.
    smallest : float
        Radius (m) of the smallest; 0 where smaller ones have been left out.
    """

    at: Any
    shape: Any
    packed: PackedFeatures
    slots: int
    index: BoxIndex
    order: LatticeArray
    smallest: float

    def lists(self, blocks: LatticeArray) -> Lists:
        """Return which of them reach which block: ``starts`` and ``list`` of the kernels' ``Features``."""
        return feature_lists(self.index, self.order, self.packed.slot, self.slots, blocks)


class FeatureCache:
    """Features of a recipe by the ground they may reach.

    The world is cut into square sheets about as wide as features reach. What stands on a sheet is found once;
    blocks of ground are given the features of all sheets around them. Which of those reach a block is for
    :meth:`FeatureBatch.lists` to say, exactly, so that sheets change no bit.

    Parameters
    ----------
    recipe : TerrainRecipe
    context : ComputeContext
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
        width = max(self._margin, int(_PAINTED_REACHES * support_radii(recipe) * painted / unit), 1)
        # Where there is nothing, one sheet is enough.
        empty = self._margin == 0 and recipe.painted.size == 0
        self._bits = _EVERYWHERE_BITS if empty else width.bit_length()
        self._sheets: OrderedDict[tuple[int, int], StructuredArray] = OrderedDict()
        self._gathered: OrderedDict[tuple[float, bytes], FeatureBatch] = OrderedDict()

    def with_recipe(self, recipe: TerrainRecipe) -> FeatureCache:
        """Return those of a recipe that differs in its painted features' strengths alone."""
        other = copy(self)
        other._recipe = recipe
        other._gathered = OrderedDict()
        return other

    def updated(self, recipe: TerrainRecipe, areas: Sequence[Bounds]) -> FeatureCache:
        """Return those of a changed recipe, which keep what stands where nothing has changed.

        Parameters
        ----------
        recipe
            With the same noises and kinds of feature.
        areas
            Rectangles (m) that hold all that another feature reaches.
        """
        other = FeatureCache(recipe, self._context)
        if other._margin != self._margin or abs(other._bits - self._bits) > 1:
            return other
        other._bits = self._bits
        changed = np.array(areas, np.float64).reshape(-1, 4) / metres_per_unit(recipe.extent)
        changed += [-_ROUNDING, -_ROUNDING, _ROUNDING, _ROUNDING]
        sheets = list(self._sheets.items())
        ground = self._ground_of(np.array([key for key, _ in sheets], np.int64).reshape(-1, 2))
        for (key, points), meets in zip(sheets, _meet_any(ground, changed).tolist(), strict=True):
            if not meets:
                other._sheets[key] = points
        for known, found in self._gathered.items():
            if not _meet_any(self._ground_of_key(known[1]), changed).any():
                other._gathered[known] = found
        return other

    def _ground_of(self, sheets: LatticeArray) -> LatticeArray:
        """Return west, south, east and north of sheets, lattice units."""
        return np.concatenate([sheets, sheets + 1], axis=1) << self._bits

    def _ground_of_key(self, where: bytes) -> LatticeArray:
        """Return the ground of what was gathered under a key."""
        numbers = np.frombuffer(where, np.int64, offset=1)
        return numbers.reshape(-1, 4) if where[0] else self._ground_of(numbers.reshape(-1, 2))

    def batch(self, blocks: LatticeArray, cell: float) -> FeatureBatch:
        """Return the features that may reach any of the blocks.

        Parameters
        ----------
        blocks : (n, 4) int64
            West, south, east, north of each block, lattice units.
        cell : float
            Effective cell size, m: smaller features are left out.
        """
        wide = int((blocks[:, 2:] - blocks[:, :2]).max()) > _WIDEST_BLOCK << self._bits
        sheets = blocks if wide else self._sheets_around(blocks)
        where = bytes([wide]) + sheets.tobytes()
        # All that stands there shows in full at the finest cells, which one list serves.
        for known in (FINEST_CELL, cell):
            found = self._gathered.get((known, where))
            if found is not None and (known == cell or 2 * cell <= found.smallest):
                self._gathered.move_to_end((known, where))
                return found
        near = features_near(self._recipe, blocks, cell) if wide else self._features_of(sheets, cell)
        # Of the fill, small ones may have been left out.
        whole = cell == FINEST_CELL or not (wide or self._recipe.fill.max_radius < cell)
        found = self._packed(near, cell, float(near["radius"].min(initial=np.inf)) if whole else 0.0)
        self._gathered[FINEST_CELL if 2 * cell <= found.smallest else cell, where] = found
        if len(self._gathered) > _MOST_GATHERED:
            self._gathered.popitem(last=False)
        return found

    def _packed(self, near: StructuredArray, cell: float, smallest: float) -> FeatureBatch:
        packed = pack_features(self._recipe, near, cell)
        index, order = feature_index(self._recipe, packed)
        upload = self._context.upload
        return FeatureBatch(
            upload(packed.at),
            upload(packed.shape.astype(self._context.real_dtype)),
            packed,
            self._slots,
            index,
            order,
            smallest,
        )

    def _sheets_around(self, blocks: LatticeArray) -> LatticeArray:
        """Columns and rows of the sheets that hold what may reach the blocks, shape (n, 2)."""
        first = (blocks[:, :2] - self._margin) >> self._bits
        last = (blocks[:, 2:] + self._margin) >> self._bits
        most = (last - first).max(axis=0) + 1
        low, high = first.min(axis=0) & -_ALIGNED, last.max(axis=0) | (_ALIGNED - 1)
        if np.prod(high - low + 1) <= _MOST_AROUND * np.prod(most):
            # The same rectangle for many sets of blocks, whose features are then packed once.
            grid = np.mgrid[low[0] : high[0] + 1, low[1] : high[1] + 1]
            return np.ascontiguousarray(grid.reshape(2, -1).T)
        step = np.indices(tuple(most)).reshape(2, -1).T
        sheets = (first[:, None] + step)[np.all(step <= (last - first)[:, None], axis=-1)]
        low = sheets.min(axis=0)
        rows = int(np.ptp(sheets[:, 1])) + 1
        # As one number each: rows of an array take many times as long to tell apart.
        number = np.unique((sheets[:, 0] - low[0]) * rows + (sheets[:, 1] - low[1]))
        return np.asarray(np.stack(np.divmod(number, rows), axis=-1) + low)

    def _features_of(self, sheets: LatticeArray, cell: float) -> StructuredArray:
        """All features of sheets, sorted by id, without the fill where none of it shows at a cell size."""
        ground = self._ground_of(sheets)
        found = painted_near(self._recipe, ground)
        if self._margin and self._recipe.fill.max_radius >= cell:
            found = np.concatenate([found, *self._fill_of(sheets)])
        _, unique = np.unique(found["id"], return_index=True)
        return found[unique]

    def _fill_of(self, sheets: LatticeArray) -> list[StructuredArray]:
        """Return the fill whose centres lie in each sheet."""
        keys = [(int(column), int(row)) for column, row in sheets]
        missing = [key for key in keys if key not in self._sheets]
        if missing:
            side = metres_per_unit(self._recipe.extent) * 2.0**self._bits
            square = 1 << _FOUND_TOGETHER_BITS
            corners = np.unique(np.array(missing) >> _FOUND_TOGETHER_BITS, axis=0) << _FOUND_TOGETHER_BITS
            lost = (corners[:, None] + np.indices((square, square)).reshape(2, -1).T).reshape(-1, 2)
            missing = [(col, row) for col, row in lost.tolist() if (col, row) not in self._sheets]
            found = self._within(corners, square)
            # Found in a little more ground, so that rounding at a sheet's border loses and doubles none.
            column, row = (np.floor(found[axis] / side).astype(np.int64) for axis in ("x", "y"))
            for key in missing:
                self._sheets[key] = found[(column == key[0]) & (row == key[1])]
        result = [self._sheets[key] for key in keys]
        for key in keys:
            self._sheets.move_to_end(key)
        while len(self._sheets) > max(_MOST_SHEETS, len(keys)):
            self._sheets.popitem(last=False)
        return result

    def _within(self, corners: LatticeArray, square: int) -> StructuredArray:
        """Return the fill with centres in squares of sheets and a little around, each once."""
        side = metres_per_unit(self._recipe.extent) * 2.0**self._bits
        parts = []
        whole = np.ptp(corners, axis=0) // square + 1
        if np.prod(whole) <= 4 * len(corners):
            areas = [(*corners.min(axis=0), *(corners.max(axis=0) + square))]
        else:
            areas = [(*corner, *(corner + square)) for corner in corners]
        for west, south, east, north in areas:
            box = (west * side - 1, south * side - 1, east * side + 1, north * side + 1)
            parts.append(self._recipe.fill.within(*(float(edge) for edge in box)))
        found = np.concatenate(parts)
        _, unique = np.unique(found["id"], return_index=True)
        return found[unique]


def _meet_any(ground: LatticeArray, areas: npt.NDArray[np.float64]) -> npt.NDArray[np.bool_]:
    """Tell which rectangles meet any of some areas, both in lattice units."""
    low, high = ground[:, None, :2], ground[:, None, 2:]
    return np.asarray(((areas[:, :2] <= high) & (areas[:, 2:] >= low)).all(axis=-1).any(axis=-1))
