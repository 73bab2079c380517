"""Which features, lakes, covers and pieces of river reach which block of ground."""

from __future__ import annotations

from typing import TYPE_CHECKING
from weakref import WeakKeyDictionary

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_features, support_radii
from sketchterrain.terrain.reach_index import ReachIndex

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features.catalogue import Points
    from sketchterrain.terrain.field_packing import PackedFields
    from sketchterrain.terrain.packing import PackedFeatures, PackedRivers
    from sketchterrain.terrain.recipe import TerrainRecipe

    Lattice = npt.NDArray[np.int64]
    Lists = tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]

_painted: WeakKeyDictionary[TerrainRecipe, ReachIndex] = WeakKeyDictionary()


def features_near(recipe: TerrainRecipe, blocks: Lattice, min_radius: float) -> Points:
    """Return the painted features that reach any of the blocks, and the fill that may, sorted by id.

    Parameters
    ----------
    recipe
    blocks
        West, south, east, north of each block, lattice units, shape (n, 4).
    min_radius
        Features of the fill below it are not wanted, m.
    """
    found = np.concatenate([painted_near(recipe, blocks), _fill_near(recipe, blocks, min_radius)])
    _, unique = np.unique(found["id"], return_index=True)
    return found[unique]


def painted_near(recipe: TerrainRecipe, blocks: Lattice) -> Points:
    """Return the painted features that reach any of the blocks, sorted by id."""
    if recipe not in _painted:
        packed = pack_features(recipe, recipe.painted, 0.0)
        _painted[recipe] = ReachIndex(packed.at, packed.at, packed.support / metres_per_unit(recipe.extent))
    _, item = _painted[recipe].touching(blocks)
    return recipe.painted[np.unique(item)]


def _fill_near(recipe: TerrainRecipe, blocks: Lattice, min_radius: float) -> Points:
    """Return the fill that may reach any of the blocks; what may reach several can come twice."""
    if recipe.fill.max_radius < min_radius or recipe.fill.max_radius == 0:
        return recipe.painted[:0]
    margin = recipe.fill.max_radius * support_radii(recipe) + 1
    metres = blocks * metres_per_unit(recipe.extent) + margin * np.array([-1, -1, 1, 1])
    return np.concatenate([recipe.fill.within(*area, min_radius=min_radius) for area in _joined(metres)])


def _joined(areas: npt.NDArray[np.float64]) -> list[tuple[float, float, float, float]]:
    """One rectangle around all, where that is little more ground than the rectangles themselves."""
    west, south = areas[:, :2].min(axis=0)
    east, north = areas[:, 2:].max(axis=0)
    ground = float(np.sum((areas[:, 2] - areas[:, 0]) * (areas[:, 3] - areas[:, 1])))
    if (east - west) * (north - south) <= 2 * ground:
        return [(float(west), float(south), float(east), float(north))]
    return [(float(w), float(s), float(e), float(n)) for w, s, e, n in areas]


def feature_index(recipe: TerrainRecipe, packed: PackedFeatures) -> tuple[ReachIndex, Lattice]:
    """Return an index of features sorted by slot and then by id, and which feature each of its items is."""
    order = np.lexsort((np.arange(packed.slot.size), packed.slot))
    reach = packed.support[order] / metres_per_unit(recipe.extent)
    return ReachIndex(packed.at[order], packed.at[order], reach), order


def river_index(recipe: TerrainRecipe, packed: PackedRivers) -> ReachIndex:
    """Return an index of the pieces of centrelines."""
    unit = metres_per_unit(recipe.extent)
    end = packed.start + np.rint(packed.along[:, :2] / unit).astype(np.int64)
    reach = packed.reach / unit * (1 + 1e-5) + 2
    return ReachIndex(np.minimum(packed.start, end), np.maximum(packed.start, end), reach)


def field_index(fields: PackedFields) -> ReachIndex:
    """Return an index of lakes or covers."""
    return ReachIndex(fields.at, fields.far, np.full(len(fields.at), 2.0))


def feature_lists(index: ReachIndex, order: Lattice, slot: Lattice, slots: int, blocks: Lattice) -> Lists:
    """Return ``starts`` (blocks × (slots + 1)) and ``list`` of ``Features`` in ``kernels/world.clh``.

    Parameters
    ----------
    index, order
        From :func:`feature_index`.
    slot
        Kind of each feature.
    slots
        How many kinds there are.
    blocks
        As in :func:`features_near`.
    """
    block, position = index.touching(blocks)
    member = order[position]
    # Rows come sorted by block and then by slot, so that each list is one run.
    counts = np.bincount(block * slots + slot[member], minlength=len(blocks) * slots)
    ends = np.cumsum(counts).reshape(-1, slots)
    starts = np.empty((len(blocks), slots + 1), np.int32)
    starts[:, :-1] = ends - counts.reshape(-1, slots)
    starts[:, -1] = ends[:, -1]
    return starts, member.astype(np.int32)


def item_lists(index: ReachIndex, blocks: Lattice, shown: npt.NDArray[np.bool_] | None = None) -> Lists:
    """Return ``starts`` (blocks + 1) and ``list`` of items that reach each block, of those shown."""
    starts = np.zeros(len(blocks) + 1, np.int32)
    if not len(index):
        return starts, np.zeros(0, np.int32)
    block, item = index.touching(blocks)
    if shown is not None:
        block, item = block[shown[item]], item[shown[item]]
    np.cumsum(np.bincount(block, minlength=len(blocks)), out=starts[1:])
    return starts, item.astype(np.int32)
