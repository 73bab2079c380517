"""Culling: which features, lakes, covers and arcs of river affect which block."""

from __future__ import annotations

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, LatticeArray, StructuredArray
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import (
    PackedFeatures,
    PackedFields,
    PackedRivers,
    pack_features,
    support_radii,
)
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    Lists = tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]

# Blocks times items up to which brute force is quicker.
_FEW = 1 << 14
# Ratio of successive cell sizes, as a power of two.
_SIZE_BITS = 2

_painted_index: WeakKeyDictionary[TerrainRecipe, BoxIndex] = WeakKeyDictionary()


class BoxIndex:
    """Index of boxes on the lattice, given by corners (n, 2) and a margin (n,) on all sides, rounded up.

    Each box is stored in the cell of its south-west corner, in a grid whose cells are at least as large as
    the box: boxes that touch a block are in its cells or in those just west and south of them. Cells of one
    row are adjacent in one sorted array, so that a row of a block is a pair of binary searches.
    """

    def __init__(self, low: LatticeArray, high: LatticeArray, margin: Float64Array) -> None:
        grow = np.ceil(margin).astype(np.int64)[:, None]
        self._low, self._high = low - grow, high + grow
        self._levels: tuple[LatticeArray, ...] | None = None

    def __len__(self) -> int:
        return len(self._low)

    def touching(self, blocks: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
        """Return pairs (block, item) that touch blocks (m, 4), borders included, by block, then by item."""
        if len(self) * len(blocks) <= _FEW:
            touch = _overlap(blocks[:, None], self._low, self._high)
            block, item = np.nonzero(touch)
            return block, item
        block, item = self._candidates(blocks)
        touch = _overlap(blocks[block], self._low[item], self._high[item])
        bits = len(self).bit_length()
        order = np.sort(block[touch] << bits | item[touch])
        return order >> bits, order & ((1 << bits) - 1)

    def _candidates(self, blocks: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
        """Return pairs of blocks and items in cells near them."""
        if self._levels is None:
            self._levels = self._build()
        bits, origin, width, rows, base, keys, items = self._levels
        # One row of this for every size of cell and block.
        size, block = (np.ravel(part) for part in np.indices((len(bits), len(blocks))))
        shift, area = bits[size][:, None], blocks[block]
        first = np.maximum(((area[:, :2] - origin) >> shift) - 1, 0)
        last = np.minimum((area[:, 2:] - origin) >> shift, np.stack([width, rows], axis=-1)[size] - 1)
        count = np.where(last[:, 0] >= first[:, 0], np.maximum(last[:, 1] - first[:, 1] + 1, 0), 0)
        part, offset = _runs(count)
        row = base[size[part]] + (first[part, 1] + offset) * width[size[part]]
        start = np.searchsorted(keys, row + first[part, 0])
        end = np.searchsorted(keys, row + last[part, 0], side="right")
        row_of, place = _runs(end - start)
        return block[part[row_of]], items[start[row_of] + place]

    def _build(self) -> tuple[LatticeArray, ...]:
        """Return for each cell size bits, columns, rows and first key; then sorted keys and their items."""
        low, span = self._low, np.max(self._high - self._low, axis=1)
        origin = low.min(axis=0)
        whole = int((low.max(axis=0) - origin).max()) + 1
        # Limit the number of rows, however small the items.
        least = max(whole // (2 * int(np.sqrt(len(low))) + 1), 1).bit_length()
        needed = np.maximum(np.ceil(np.log2(span + 1.0)).astype(np.int64), least)
        needed = -(-needed // _SIZE_BITS) * _SIZE_BITS
        bits, size = np.unique(needed, return_inverse=True)
        cell = (low - origin) >> needed[:, None]
        columns, rows = (np.full(len(bits), 0) for _ in range(2))
        np.maximum.at(columns, size, cell[:, 0] + 1)
        np.maximum.at(rows, size, cell[:, 1] + 1)
        base = np.cumsum(columns * rows) - columns * rows
        keys = base[size] + cell[:, 1] * columns[size] + cell[:, 0]
        items = np.argsort(keys, kind="stable")
        return bits, origin, columns, rows, base, keys[items], items


def _overlap(blocks: LatticeArray, low: LatticeArray, high: LatticeArray) -> BoolArray:
    """Return whether blocks (…, 4) and boxes (…, 2) have a point in common."""
    return np.asarray(
        (blocks[..., 0] <= high[..., 0])
        & (blocks[..., 2] >= low[..., 0])
        & (blocks[..., 1] <= high[..., 1])
        & (blocks[..., 3] >= low[..., 1])
    )


def _runs(count: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
    """Return, for concatenated runs of these lengths, each element's run and its index in the run."""
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)


def features_near(recipe: TerrainRecipe, blocks: LatticeArray, min_radius: float) -> StructuredArray:
    """Return the painted features whose support meets any block (n, 4), and the fill that may, sorted by id.

    Blocks are west, south, east, north in lattice units; fill with a radius (m) below ``min_radius`` is
    omitted.
    """
    features = np.concatenate([painted_near(recipe, blocks), _fill_near(recipe, blocks, min_radius)])
    _, unique = np.unique(features["id"], return_index=True)
    return features[unique]


def painted_near(recipe: TerrainRecipe, blocks: LatticeArray) -> StructuredArray:
    """Return the painted features whose support meets any of the blocks, sorted by id."""
    if recipe not in _painted_index:
        packed = pack_features(recipe, recipe.painted, 0.0)
        _painted_index[recipe] = BoxIndex(
            packed.at, packed.at, packed.support / metres_per_unit(recipe.extent)
        )
    _, item = _painted_index[recipe].touching(blocks)
    return recipe.painted[np.unique(item)]


def _fill_near(recipe: TerrainRecipe, blocks: LatticeArray, min_radius: float) -> StructuredArray:
    """Return the fill that may affect any of the blocks, possibly with duplicates."""
    if recipe.fill.max_radius < min_radius or recipe.fill.max_radius == 0:
        return recipe.painted[:0]
    margin = recipe.fill.max_radius * support_radii(recipe) + 1
    metres = blocks * metres_per_unit(recipe.extent) + margin * np.array([-1, -1, 1, 1])
    return np.concatenate(
        [recipe.fill.within(*area, min_radius=min_radius) for area in _merge_if_compact(metres)]
    )


def _merge_if_compact(areas: Float64Array) -> list[tuple[float, float, float, float]]:
    """Return one bounding rectangle where it is little larger than the rectangles together."""
    west, south = areas[:, :2].min(axis=0)
    east, north = areas[:, 2:].max(axis=0)
    covered = float(np.sum((areas[:, 2] - areas[:, 0]) * (areas[:, 3] - areas[:, 1])))
    if (east - west) * (north - south) <= 2 * covered:
        return [(float(west), float(south), float(east), float(north))]
    return [(float(w), float(s), float(e), float(n)) for w, s, e, n in areas]


def feature_index(recipe: TerrainRecipe, packed: PackedFeatures) -> tuple[BoxIndex, LatticeArray]:
    """Return an index of features sorted by slot, then by id, and the feature of each of its items."""
    order = np.lexsort((np.arange(packed.slot.size), packed.slot))
    support = packed.support[order] / metres_per_unit(recipe.extent)
    return BoxIndex(packed.at[order], packed.at[order], support), order


def river_index(recipe: TerrainRecipe, packed: PackedRivers) -> BoxIndex:
    """Return an index of the arcs of centrelines."""
    unit = metres_per_unit(recipe.extent)
    end = packed.start + np.rint(packed.chord / unit).astype(np.int64)
    support = packed.support / unit * (1 + 1e-5) + 2
    return BoxIndex(np.minimum(packed.start, end), np.maximum(packed.start, end), support)


def field_index(fields: PackedFields) -> BoxIndex:
    """Return an index of lakes or covers."""
    return BoxIndex(fields.at, fields.far, np.full(len(fields.at), 2.0))


def feature_lists(
    index: BoxIndex, order: LatticeArray, slot: LatticeArray, slots: int, blocks: LatticeArray
) -> Lists:
    """Return ``starts`` (blocks × (slots + 1)) and ``list`` of ``Features`` in ``kernels/world.clh``.

    ``index`` and ``order`` are those of :func:`feature_index`, ``slot`` is each feature's kind.
    """
    block, position = index.touching(blocks)
    member = order[position]
    # Pairs are sorted by block, then by slot, so that each list is one run.
    counts = np.bincount(block * slots + slot[member], minlength=len(blocks) * slots)
    ends = np.cumsum(counts).reshape(-1, slots)
    starts = np.empty((len(blocks), slots + 1), np.int32)
    starts[:, :-1] = ends - counts.reshape(-1, slots)
    starts[:, -1] = ends[:, -1]
    return starts, member.astype(np.int32)


def item_lists(index: BoxIndex, blocks: LatticeArray, visible: BoolArray | None = None) -> Lists:
    """Return ``starts`` (blocks + 1) and ``list`` of the visible items that affect each block."""
    starts = np.zeros(len(blocks) + 1, np.int32)
    if not len(index):
        return starts, np.zeros(0, np.int32)
    block, item = index.touching(blocks)
    if visible is not None:
        block, item = block[visible[item]], item[visible[item]]
    np.cumsum(np.bincount(block, minlength=len(blocks)), out=starts[1:])
    return starts, item.astype(np.int32)
