"""Stale tiles: which ones show the terrain before a change, and when they are valid again.

A tile stores its own vertices and its parent's at the same positions. So a rewritten tile is valid if its
parent's own vertices are: those of a parent that is not stale, or that is written by the same batch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.tiles.codes import boxes_of, contains, decode, keys_of, parent_of
from sketchterrain.tiles.orders import Batch
from sketchterrain.tiles.wanted import ROOT_LEVEL

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Bounds, Int64Array
    from sketchterrain.tiles.pool import TilePool


_MARGIN: Final = 2
"""Quads beyond a tile's border that its parent's normals read."""


def mark_stale(
    pool: TilePool, areas: Sequence[Bounds], *, extent: float, quads: int, kept: Int64Array
) -> int:
    """Mark tiles stale in `areas` (west, south, east, north, m); return the number removed.

    Tiles in `kept` (sorted) stay in the pool, stale until they are rewritten; other affected tiles are
    removed.
    """
    codes, slots = pool.tiles()
    touched = _touched(codes, areas, extent, quads)
    stays = touched & contains(kept, codes)
    pool.stale[slots[stays]] = True
    gone = codes[touched & ~stays]
    pool.remove(gone)
    return len(gone)


def stale_ancestors(pool: TilePool, codes: Int64Array) -> Int64Array:
    """Return the stale ancestors of tiles, coarser ones first."""
    above = codes[:0]
    while codes.size:
        codes = np.unique(parent_of(codes[decode(codes)[0] > ROOT_LEVEL]))
        above = np.union1d(above, codes)
    return _stale(pool, above)


def rewrite_batch(pool: TilePool, codes: Int64Array) -> Batch:
    """Return the batch that rewrites cached tiles, with the stale parents that they read."""
    above = codes[decode(codes)[0] > ROOT_LEVEL]
    codes = np.union1d(codes, _stale(pool, np.unique(parent_of(above))))
    codes = codes[np.argsort(decode(codes)[0], kind="stable")]
    return create_batch(pool, codes, pool.find(codes))


def create_batch(pool: TilePool, codes: Int64Array, slots: Int64Array) -> Batch:
    """Return the batch that writes tiles into slots; their parents are in the pool."""
    parents = np.where(decode(codes)[0] > ROOT_LEVEL, pool.find(parent_of(codes)), -1)
    return Batch(tuple(keys_of(codes)), slots, parents)


def mark_written(pool: TilePool, batch: Batch) -> None:
    """Clear the stale flag of a batch's tiles, except those that read a stale parent."""
    parents = batch.parents
    wrong = (parents >= 0) & pool.stale[parents] & ~np.isin(parents, batch.slots)
    pool.stale[batch.slots] &= wrong


def _stale(pool: TilePool, codes: Int64Array) -> Int64Array:
    slots = pool.find(codes)
    held = slots >= 0
    return codes[held][pool.stale[slots[held]]]


def _touched(codes: Int64Array, areas: Sequence[Bounds], extent: float, quads: int) -> npt.NDArray[np.bool_]:
    """Return which tiles have a vertex that may change, its normal and its parent's included."""
    if not len(areas) or not len(codes):
        return np.zeros(len(codes), np.bool_)
    flat = np.zeros(len(codes))
    boxes = boxes_of(codes, extent, flat, flat)
    low, high = boxes.low[:, None, :2], boxes.high[:, None, :2]
    margin = _MARGIN * (high - low) / quads
    box = np.asarray(areas, np.float64).reshape(1, -1, 4)
    intersects_bounds = (box[..., :2] <= high + margin) & (box[..., 2:] >= low - margin)
    return np.asarray(intersects_bounds.all(axis=-1).any(axis=-1))
