"""Culling: which features, lakes, covers and arcs of river affect which block."""

from __future__ import annotations

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_features, support_radii
from sketchterrain.terrain.reach_index import BoxIndex

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import LatticeArray, StructuredArray
    from sketchterrain.terrain.field_packing import PackedFields
    from sketchterrain.terrain.packing import PackedFeatures, PackedRivers
    from sketchterrain.terrain.recipe import TerrainRecipe

    Lists = tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]

_painted_index: WeakKeyDictionary[TerrainRecipe, BoxIndex] = WeakKeyDictionary()


def features_near(recipe: TerrainRecipe, blocks: LatticeArray, min_radius: float) -> StructuredArray:
    """Return the painted features whose support meets any block (n, 4), and the fill that may, sorted by id.

    Blocks are west, south, east, north in lattice units; fill with a radius (m) below ``min_radius`` is
    omitted.
    """
    found = np.concatenate([painted_near(recipe, blocks), _fill_near(recipe, blocks, min_radius)])
    _, unique = np.unique(found["id"], return_index=True)
    return found[unique]


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


def _merge_if_compact(areas: npt.NDArray[np.float64]) -> list[tuple[float, float, float, float]]:
    """Return one bounding rectangle where it is little larger than the rectangles together."""
    west, south = areas[:, :2].min(axis=0)
    east, north = areas[:, 2:].max(axis=0)
    ground = float(np.sum((areas[:, 2] - areas[:, 0]) * (areas[:, 3] - areas[:, 1])))
    if (east - west) * (north - south) <= 2 * ground:
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
    end = packed.start + np.rint(packed.along[:, :2] / unit).astype(np.int64)
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


def item_lists(index: BoxIndex, blocks: LatticeArray, visible: npt.NDArray[np.bool_] | None = None) -> Lists:
    """Return ``starts`` (blocks + 1) and ``list`` of the visible items that affect each block."""
    starts = np.zeros(len(blocks) + 1, np.int32)
    if not len(index):
        return starts, np.zeros(0, np.int32)
    block, item = index.touching(blocks)
    if visible is not None:
        block, item = block[visible[item]], item[visible[item]]
    np.cumsum(np.bincount(block, minlength=len(blocks)), out=starts[1:])
    return starts, item.astype(np.int32)
