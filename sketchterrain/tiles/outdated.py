"""Tiles that show the ground as it was before a change: which they are, and when they are right again.

A tile holds its own vertices and its parent's at the same places. So one that is written anew is right if
its parent's own vertices are: those of a parent that is not outdated, or that is written by the same batch.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.tiles.codes import boxes_of, contains, keys_of, parent_of, place_of
from sketchterrain.tiles.orders import Batch
from sketchterrain.tiles.wanted import ROOT_LEVEL

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.tiles.codes import Codes
    from sketchterrain.tiles.pool import TilePool

    Box = tuple[float, float, float, float]
    Slots = npt.NDArray[np.int64]

_MARGIN: Final = 2
"""Quads beyond a tile's border that its parent's normals read."""


def outdate(pool: TilePool, areas: Sequence[Box], *, extent: float, quads: int, kept: Codes) -> int:
    """Note that the ground is another one in some areas; return how many tiles are forgotten for it.

    Parameters
    ----------
    pool
        The tiles that are held.
    areas
        West, south, east and north of each (m); elsewhere every vertex stays as it is.
    extent
        Width of a tile of level 0 (m).
    quads
        Along a tile's side.
    kept
        Tiles that are not forgotten, sorted: they are outdated until they are written anew.
    """
    codes, slots = pool.all()
    touched = _touched(codes, areas, extent, quads)
    stays = touched & contains(kept, codes)
    pool.outdated[slots[stays]] = True
    gone = codes[touched & ~stays]
    pool.drop(gone)
    return len(gone)


def outdated_above(pool: TilePool, codes: Codes) -> Codes:
    """Return the outdated tiles that some tiles lie in, coarser ones first."""
    above = codes[:0]
    while codes.size:
        codes = np.unique(parent_of(codes[place_of(codes)[0] > ROOT_LEVEL]))
        above = np.union1d(above, codes)
    return _outdated(pool, above)


def rewriting(pool: TilePool, codes: Codes) -> Batch:
    """Return the batch that writes held tiles anew, with those parents that they read."""
    above = codes[place_of(codes)[0] > ROOT_LEVEL]
    codes = np.union1d(codes, _outdated(pool, np.unique(parent_of(above))))
    codes = codes[np.argsort(place_of(codes)[0], kind="stable")]
    return batch_of(pool, codes, pool.find(codes))


def batch_of(pool: TilePool, codes: Codes, slots: Slots) -> Batch:
    """Return the batch that writes tiles into slots, parents that are held beside them."""
    parents = np.where(place_of(codes)[0] > ROOT_LEVEL, pool.find(parent_of(codes)), -1)
    return Batch(tuple(keys_of(codes)), slots, parents)


def written(pool: TilePool, batch: Batch) -> None:
    """Note that a batch was written; what read a parent that is not right stays outdated."""
    parents = batch.parents
    wrong = (parents >= 0) & pool.outdated[parents] & ~np.isin(parents, batch.slots)
    pool.outdated[batch.slots] &= wrong


def _outdated(pool: TilePool, codes: Codes) -> Codes:
    slots = pool.find(codes)
    held = slots >= 0
    return codes[held][pool.outdated[slots[held]]]


def _touched(codes: Codes, areas: Sequence[Box], extent: float, quads: int) -> npt.NDArray[np.bool_]:
    """Tell which tiles have a vertex that may be another one, its normal or its parent's included."""
    if not len(areas) or not len(codes):
        return np.zeros(len(codes), np.bool_)
    flat = np.zeros(len(codes))
    boxes = boxes_of(codes, extent, flat, flat)
    low, high = boxes.low[:, None, :2], boxes.high[:, None, :2]
    margin = _MARGIN * (high - low) / quads
    box = np.asarray(areas, np.float64).reshape(1, -1, 4)
    meets = (box[..., :2] <= high + margin) & (box[..., 2:] >= low - margin)
    return np.asarray(meets.all(axis=-1).any(axis=-1))
