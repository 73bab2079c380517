"""Appearance tiles: which a view needs, which are in memory, and a table of their pages.

Bruneton & Neyret 2008, sections 4.2 and 7: a tile is needed where its texels, seen head on, may be the
coarsest of at most `PIXELS` pixels. Its parent is then needed too: something coarser shows meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array
from sketchterrain.tiles.lod import CameraView, eye_distances
from sketchterrain.tiles.quadtree import Boxes, code_of, contains, decode, index_in, touches_areas
from sketchterrain.tiles.refinement import ROOT_LEVEL
from sketchterrain.tiles.tile_pool import TilePool

TEXELS: Final = 192  # along the side of a tile; the outermost are those of its neighbours
PAGES: Final = 64  # tiles along the side of a level's page table, around the eye
PIXELS: Final = 1.1  # px, greatest width of a texel seen head on
FINEST_TEXEL: Final = 0.008  # m, about
_REACH: Final = 1.05  # of the computed distance: the drawn ground is off by some pixels
_MARGIN: Final = 0.05  # of the distance, about the frustum
_FARTHEST: Final = 16.0  # extents
_ANY_HEIGHT: Final = 1e5  # m
_RECORDS: Final = 8  # per slot: tiles of one colour need no slot
_MOST_KNOWN: Final = 1 << 16  # tiles of which it is known whether anything shows there

_RECORD: Final = np.dtype(  # of a drawn tile, sorted by codes; slot -1: it has one colour
    [("code", "i8"), ("slot", "i8"), ("colour", "u4"), ("used", "i8"), ("is_stale", "?")]
)

_KNOWN: Final = np.dtype([("code", "i8"), ("is_full", "?")])  # sorted by codes

Occupied = Callable[[Int64Array], BoolArray]
"""Whether anything may show in tiles (n, 3) of level, column and row, (n,)."""


@dataclass(frozen=True, eq=False)
class NeededTiles:
    """Tiles that a view needs, the most urgent first: parents come before children."""

    codes: Int64Array
    empty: Int64Array  # further ones, in which nothing shows


class AppearanceTiles:
    """Tiles of `TEXELS`² texels for a moving camera, cached in `slots`; does neither drawing nor I/O.

    `extent` is the width (m) of a tile of level 0, `finest` the last level. Each frame: `select`, then
    `store` what `pending` returns; `page_table` is where shaders find tiles.
    """

    def __init__(self, extent: float, *, slots: int) -> None:
        self.extent, self.slots = extent, slots
        self.finest = max(round(np.log2(extent / (TEXELS - 2) / FINEST_TEXEL)), 0)
        self.changes = 0  # of anything that page tables depend on, except for the eye
        self._records, self._known = np.zeros(0, _RECORD), np.zeros(0, _KNOWN)
        self._needed = NeededTiles(self._records["code"], self._records["code"])
        self._time = 0

    @property
    def converged(self) -> bool:
        """Whether all tiles of the last selection are in memory and up to date."""
        return not self.pending().size

    def reach(self, view: CameraView, level: int) -> float:
        """Return the distance (m) beyond which no pixel needs a level, as its parent's texels suffice."""
        texel = self.extent * 2.0**-level / (TEXELS - 2)
        return np.inf if level == 0 else _REACH * 2.0 * texel * view.pixels_per_radian / PIXELS

    def needed(self, view: CameraView, pool: TilePool, occupied: Occupied) -> NeededTiles:
        """Return the tiles that a view needs, on the ground of a pool of terrain tiles, at most `slots`."""
        far = min(view.draw_distance, _FARTHEST * self.extent)
        edges = np.floor((np.array(view.eye[:2])[:, None] + [-far, far]) / self.extent).astype(np.int64)
        columns, rows = np.meshgrid(*(np.arange(first, last + 1) for first, last in edges))
        column, row = columns.ravel(), rows.ravel()
        low, high = np.full(column.size, -_ANY_HEIGHT), np.full(column.size, _ANY_HEIGHT)
        bottom, top = pool.bottom - pool.error, pool.top + pool.error
        found, urgency, empty = [column[:0]], [low[:0]], [column[:0]]
        for level in range(ROOT_LEVEL, self.finest + 1):
            above, width = max(-level, 0), self.extent * 2.0**-level
            codes = code_of(level, column >> above, row >> above)
            at = pool.find(codes)
            known = at >= 0  # others lie between the heights of their parents
            low[known], high[known] = bottom[at[known]], top[at[known]]
            if level < 0:
                continue
            corner = np.stack([column * width, row * width, low], axis=-1)
            boxes = Boxes(corner, np.stack([corner[:, 0] + width, corner[:, 1] + width, high], axis=-1))
            distance, _ = eye_distances(view, boxes)
            reach = self.reach(view, level)
            here = np.flatnonzero((distance < reach) & view.sees(boxes, margin=_MARGIN * distance))
            if not here.size:
                break
            keys = np.stack([np.full(here.size, level), column[here], row[here]], axis=-1)
            is_full = self._occupied(codes[here], keys, occupied)
            empty.append(codes[here[~is_full]])
            here = here[is_full]
            found.append(codes[here])
            urgency.append(distance[here] / min(reach, 1e12))
            here = here[distance[here] < self.reach(view, level + 1)]
            column = (2 * column[here, None] + [0, 1, 0, 1]).ravel()
            row = (2 * row[here, None] + [0, 0, 1, 1]).ravel()
            low, high = np.repeat(low[here], 4), np.repeat(high[here], 4)
        codes = np.concatenate(found)[np.argsort(np.concatenate(urgency), kind="stable")]
        at = index_in(self._records["code"], codes)
        takes_slot = np.ones(len(codes), np.bool_)
        takes_slot[at >= 0] = self._records["slot"][at[at >= 0]] >= 0
        return NeededTiles(codes[np.cumsum(takes_slot) <= self.slots], np.sort(np.concatenate(empty)))

    def _occupied(self, codes: Int64Array, keys: Int64Array, occupied: Occupied) -> BoolArray:
        """Return whether anything may show in tiles; a view asks for the same ones in each frame."""
        if len(self._known) > _MOST_KNOWN:
            self._known = self._known[:0]
        new = ~contains(self._known["code"], codes)
        if new.any():
            rows = np.zeros(np.count_nonzero(new), _KNOWN)
            rows["code"], rows["is_full"] = codes[new], occupied(keys[new])
            known = np.concatenate([self._known, rows])
            self._known = known[np.argsort(known["code"])]
        return np.asarray(self._known["is_full"][index_in(self._known["code"], codes)])

    def select(self, view: CameraView, pool: TilePool, occupied: Occupied) -> None:
        """Select the tiles of a view; the others may be replaced."""
        before, self._needed = self._needed, self.needed(view, pool, occupied)
        self._touch()
        if not all(
            np.array_equal(*each)
            for each in ((before.codes, self._needed.codes), (before.empty, self._needed.empty))
        ):
            self.changes += 1

    def pending(self, needed: NeededTiles | None = None) -> Int64Array:
        """Return the tiles to draw, of the selection or of others, the most urgent first.

        Stale ones follow in the order in which they show: those of the finest levels first.
        """
        codes = (needed or self._needed).codes
        at = index_in(self._records["code"], codes)
        is_missing = at < 0
        is_stale = np.zeros(len(codes), np.bool_)
        is_stale[~is_missing] = self._records["is_stale"][at[~is_missing]]
        stale = codes[is_stale]
        if len(stale):
            level, column, row = decode(codes)
            is_parent = contains(np.sort(code_of(level - 1, column >> 1, row >> 1)), stale)
            stale = stale[np.argsort(is_parent, kind="stable")]
        room = None if needed is None else len(self._free) + int(np.count_nonzero(self._replaceable))
        return np.asarray(np.concatenate([codes[is_missing], stale])[:room], np.int64)

    def store(self, codes: Int64Array, is_uniform: BoolArray, colours: npt.NDArray[np.uint32]) -> Int64Array:
        """Record drawn tiles in place of the least recently used; return their slots, -1 for uniform ones."""
        self._keep(~contains(np.sort(codes), self._records["code"]))
        by_age = np.argsort(self._records["used"], kind="stable")
        oldest = by_age[self._replaceable[by_age]]
        keep = np.ones(len(by_age), np.bool_)
        keep[oldest[: max(int(np.count_nonzero(~is_uniform)) - len(self._free), 0)]] = False
        spare = by_age[keep[by_age] & (self._records["used"] < self._time)[by_age]]
        keep[spare[: max(len(by_age) + len(codes) - _RECORDS * self.slots, 0)]] = False
        self._keep(keep)
        fits = np.cumsum(~is_uniform) <= len(self._free)  # more were uniform when they were selected
        slots = np.full(len(codes), -1, np.int64)
        slots[~is_uniform & fits] = self._free[: np.count_nonzero(~is_uniform & fits)]
        new = np.zeros(len(codes), _RECORD)
        new["code"], new["slot"], new["colour"], new["used"] = codes, slots, colours, self._time
        records = np.concatenate([self._records, new[fits]])
        self._records = records[np.argsort(records["code"])]
        self.changes += 1
        return slots

    def invalidate(self, areas: Sequence[Bounds], *, texels: float = 1.0) -> None:
        """Mark tiles in areas (west, south, east, north; m), and so many texels around, stale.

        Those needed stay until redrawn.
        """
        margin = texels / (TEXELS - 2)
        self._records["is_stale"] |= touches_areas(self._records["code"], self.extent, areas, margin)
        self._keep(~self._records["is_stale"] | (self._records["used"] == self._time))
        self._known = self._known[~touches_areas(self._known["code"], self.extent, areas, margin)]

    def page_table(self, eye: Sequence[float]) -> tuple[npt.NDArray[np.uint32], Int64Array]:
        """Return pages, and by level the tile (column, row) that they are around.

        Pages are (levels, `PAGES`, `PAGES`, 2), a tile's at its row and column modulo `PAGES`: the slot + 1
        of the finest tile that covers it, + 2¹⁶ times its level, or 0 and its one colour (red, green, blue,
        share).
        """
        centre = self.tiles_at(eye)[0]
        at = index_in(self._records["code"], self._needed.codes)
        codes, records = self._needed.codes[at >= 0], self._records[at[at >= 0]]
        level, column, row = decode(np.concatenate([codes, self._needed.empty]))
        value = np.zeros((len(level), 2), np.uint32)
        own = level[: len(codes)] << 16
        value[: len(codes), 0] = np.where(records["slot"] < 0, 0, records["slot"] + 1 + own)
        value[: len(codes), 1] = records["colour"]
        table = np.zeros((len(centre), PAGES, PAGES), np.uint64)
        away = np.abs(np.stack([column, row], axis=-1) - centre[level]).max(axis=1, initial=0)
        inside = np.flatnonzero(away < PAGES // 2)
        inside = inside[np.argsort(level[inside], kind="stable")]
        first = np.searchsorted(level[inside], np.arange(len(centre) + 1))
        column, row, words = column[inside] % PAGES, row[inside] % PAGES, value[inside].view(np.uint64)[:, 0]
        west_south = centre[:, :, None] - PAGES // 2
        above = ((west_south + (np.arange(PAGES) - west_south) % PAGES) >> 1) % PAGES
        for each, (start, end) in enumerate(pairwise(first.tolist())):
            if each:
                table[each] = table[each - 1].take(above[each, 1], axis=0).take(above[each, 0], axis=1)
            table[each, row[start:end], column[start:end]] = words[start:end]
        return table.view(np.uint32).reshape(*table.shape, 2), centre

    def tiles_at(self, eye: Sequence[float]) -> tuple[Int64Array, Float64Array]:
        """Return by level the tile (column, row) that an eye is over, and where in it (0 … 1)."""
        levels = np.arange(self.finest + 1, dtype=np.float64)
        place = np.array(eye[:2]) / (self.extent * np.exp2(-levels))[:, None]
        tiles = np.floor(place)
        return tiles.astype(np.int64), place - tiles

    def shows(self, centre: Int64Array, eye: Sequence[float]) -> bool:
        """Return whether the pages around tiles serve an eye: it is near, at levels that are needed."""
        used = int(decode(self._needed.codes)[0].max(initial=0)) + 1
        return bool(np.abs(self.tiles_at(eye)[0] - centre)[:used].max() <= PAGES // 8)

    @property
    def _free(self) -> Int64Array:
        """Slots that no tile is in."""
        return np.setdiff1d(np.arange(self.slots), self._records["slot"])

    @property
    def _replaceable(self) -> BoolArray:
        """Which tiles have a slot and are not needed."""
        return np.asarray((self._records["slot"] >= 0) & (self._records["used"] < self._time))

    def _keep(self, which: BoolArray) -> None:
        if not which.all():
            self._records = self._records[which]
            self.changes += 1

    def _touch(self) -> None:
        self._time += 1
        at = index_in(self._records["code"], self._needed.codes)
        self._records["used"][at[at >= 0]] = self._time
