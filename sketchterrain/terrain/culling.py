"""Which features, lakes, covers and pieces of river reach which block of ground."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import slot_count, support_radii

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features.catalogue import Points
    from sketchterrain.terrain.field_packing import PackedFields
    from sketchterrain.terrain.packing import PackedFeatures, PackedRivers
    from sketchterrain.terrain.recipe import TerrainRecipe

__all__ = ["feature_lists", "features_near", "field_lists", "river_lists"]

# Blocks times features that one comparison may hold at a time.
_CHUNK = 4_000_000


def features_near(recipe: TerrainRecipe, blocks: npt.NDArray[np.int64], min_radius: float) -> Points:
    """Return painted features and the fill that may reach any of the blocks, sorted by id.

    Parameters
    ----------
    recipe
    blocks
        West, south, east, north of each block, lattice units, shape (n, 4).
    min_radius
        Features below it are not wanted, m.
    """
    painted = recipe.painted
    if recipe.fill.max_radius < min_radius or recipe.fill.max_radius == 0:
        return painted
    margin = recipe.fill.max_radius * support_radii(recipe) + 1
    metres = blocks * metres_per_unit(recipe.extent) + margin * np.array([-1, -1, 1, 1])
    fill = [recipe.fill.within(*area, min_radius=min_radius) for area in _joined(metres)]
    found = np.concatenate([painted, *fill])
    _, unique = np.unique(found["id"], return_index=True)
    return found[unique]


def _joined(areas: npt.NDArray[np.float64]) -> list[tuple[float, float, float, float]]:
    """One rectangle around all, where that is little more ground than the rectangles themselves."""
    west, south = areas[:, :2].min(axis=0)
    east, north = areas[:, 2:].max(axis=0)
    ground = float(np.sum((areas[:, 2] - areas[:, 0]) * (areas[:, 3] - areas[:, 1])))
    if (east - west) * (north - south) <= 2 * ground:
        return [(float(west), float(south), float(east), float(north))]
    return [(float(w), float(s), float(e), float(n)) for w, s, e, n in areas]


def feature_lists(
    recipe: TerrainRecipe, packed: PackedFeatures, blocks: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return ``starts`` (blocks × (slots + 1)) and ``list`` of ``Features`` in ``kernels/world.clh``."""
    slots = slot_count(recipe)
    order = np.lexsort((np.arange(packed.slot.size), packed.slot))
    reach = packed.support[order] / metres_per_unit(recipe.extent)
    block, position = _touching(blocks, packed.at[order], packed.at[order], reach)
    # Rows come sorted by block and then by slot, so that each list is one run.
    key = block * slots + packed.slot[order][position]
    counts = np.bincount(key, minlength=len(blocks) * slots).reshape(-1, slots)
    return _starts(counts), order[position].astype(np.int32)


def river_lists(
    recipe: TerrainRecipe, packed: PackedRivers, blocks: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return ``starts`` (blocks + 1) and ``list`` of ``Rivers`` in ``kernels/world.clh``."""
    unit = metres_per_unit(recipe.extent)
    end = packed.start + np.rint(packed.along[:, :2] / unit).astype(np.int64)
    reach = np.maximum(packed.up[:, 3], packed.down[:, 3]) / unit * (1 + 1e-5) + 2
    low, high = np.minimum(packed.start, end), np.maximum(packed.start, end)
    block, position = _touching(blocks, low, high, reach)
    counts = np.bincount(block, minlength=len(blocks))
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return starts, position.astype(np.int32)


def field_lists(
    fields: PackedFields, shown: npt.NDArray[np.bool_], blocks: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
    """Return ``starts`` (blocks + 1) and ``list`` of ``Fields`` in ``kernels/fields.clh``, of those shown."""
    chosen = np.flatnonzero(shown)
    block, position = _touching(blocks, fields.at[chosen], fields.far[chosen], np.full(chosen.size, 2.0))
    counts = np.bincount(block, minlength=len(blocks))
    starts = np.concatenate([[0], np.cumsum(counts)]).astype(np.int32)
    return starts, chosen[position].astype(np.int32)


def _touching(
    blocks: npt.NDArray[np.int64],
    low: npt.NDArray[np.int64],
    high: npt.NDArray[np.int64],
    reach: npt.NDArray[np.float64],
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Pairs (block, item) in which the item's box, widened by its reach, touches the block; in order."""
    grow = np.ceil(reach).astype(np.int64)[:, None]
    low, high = low - grow, high + grow
    rows = max(1, _CHUNK // max(len(low), 1))
    found_block, found_item = [], []
    for first in range(0, len(blocks), rows):
        part = blocks[first : first + rows, None, :]
        touch = (
            (part[..., 0] <= high[:, 0])
            & (part[..., 2] >= low[:, 0])
            & (part[..., 1] <= high[:, 1])
            & (part[..., 3] >= low[:, 1])
        )
        block, item = np.nonzero(touch)
        found_block.append(block + first)
        found_item.append(item)
    return np.concatenate(found_block), np.concatenate(found_item)


def _starts(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.int32]:
    """Turn list lengths (blocks × slots) into starts with the end of each block's last list appended."""
    ends = np.cumsum(counts).reshape(counts.shape)
    return np.column_stack([ends - counts, ends[:, -1]]).astype(np.int32)
