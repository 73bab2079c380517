"""Target quadtree of a view, balanced so that touching tiles differ by at most one level."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.errors import InputError
from sketchterrain.tiles.lod import CameraView, ScreenError, horizontal_distances, occluded
from sketchterrain.tiles.quadtree import (
    FARTHEST_TILE,
    UNBOUNDED,
    around,
    boxes_of,
    children_of,
    code_of,
    contains,
    decode,
    index_in,
    intersects_bounds,
    neighbours_of,
    parent_of,
    parents_around,
    tile_range,
)
from sketchterrain.tiles.tile_pool import TilePool

if TYPE_CHECKING:
    Range = tuple[int, int, int, int]

ROOT_LEVEL: Final = -4
"""Roots are 16 extents wide: as wide as the farthest draw distance."""
UNSEEN_URGENCY: Final = 0.5
"""Upper bound of the urgency of tiles that are not visible."""
_BALANCED, _ROOTS_AHEAD = 1.25, 1.5
"""Ranges, in draw distances, within which tiles are balanced, and roots exist."""
_MAX_ROOTS: Final = 2.0
"""Greatest range of roots, in their widths."""

_UNSEEN_WEIGHT: Final = 0.25
"""Weight of errors outside the frustum, so that a turning camera finds tiles."""
_MARGIN: Final = 0.15
"""Margin around the frustum, in distances."""


@dataclass(frozen=True, eq=False)
class TileExcess:
    """Level-of-detail excess of cached tiles."""

    codes: Int64Array  # sorted
    of_all: (
        Float64Array  # (n,) by the metric, 1 is the limit; reduced if not visible, 0 beyond the draw distance
    )
    seen: npt.NDArray[np.bool_]  # (n,) in the frustum, and not behind nearer terrain

    def lookup(self, codes: Int64Array) -> Float64Array:
        """Return the excess of some tiles, 0 if unknown."""
        at = index_in(self.codes, codes)
        values = np.zeros(len(codes))
        values[at >= 0] = self.of_all[at[at >= 0]]
        return values


@dataclass(frozen=True, eq=False)
class TargetTree:
    """Tree that a view requires."""

    splits: Int64Array  # sorted; tiles whose children are required
    missing: Int64Array  # not cached although their parents are; most visible first
    # (missing,) excess of the tile each replaces; infinite for roots, at most UNSEEN_URGENCY if not visible
    urgency: Float64Array
    excess: TileExcess  # of all cached tiles
    spared: Int64Array  # sorted; other tiles that are not cached, which a still does without


@dataclass(frozen=True)
class TileSelector:
    """Tile selection: pure functions of a view and of the pool."""

    extent: float  # width of a tile of level 0, m
    quads: int  # along a tile's side
    metric: ScreenError
    finest: int  # level at which splitting ends
    hide: bool = True  # treat tiles behind nearer terrain as not visible
    # west, south, east, north, m; tiles outside are never split, nor roots
    bounds: tuple[float, float, float, float] = UNBOUNDED
    still: bool = False  # tiles that are not in the picture are not needed

    def roots(self, view: CameraView) -> Int64Array:
        """Return the coarsest tiles around the eye; InputError if it is too far from the origin."""
        farthest = FARTHEST_TILE * self.extent * 2.0**-self.finest
        if not max(abs(view.eye[0]), abs(view.eye[1])) < farthest:
            x, y, _ = view.eye
            raise InputError(f"expected an eye within ±{farthest:.3g} m of the origin, got {x:g} and {y:g}")
        west, east, south, north = self._range(view, ROOT_LEVEL, _ROOTS_AHEAD)
        cols, rows = np.meshgrid(np.arange(west, east + 1), np.arange(south, north + 1))
        return np.sort(code_of(ROOT_LEVEL, cols.ravel(), rows.ravel()))

    def excess(self, view: CameraView, pool: TilePool) -> TileExcess:
        """Return the excess of all cached tiles, including those hidden by nearer terrain."""
        codes, slots = pool.tiles()
        boxes = pool.boxes(codes, slots, self.extent)
        cells = self.extent * np.exp2(-decode(codes)[0].astype(np.float64)) / self.quads
        excess = self.metric.excess(view, boxes, pool.error[slots], cells)
        distance, _ = horizontal_distances(view, boxes)
        in_bounds = intersects_bounds(codes, self.extent, self.bounds)
        excess = np.where(in_bounds & (distance <= view.draw_distance), excess, 0.0)
        seen = in_bounds & view.sees(boxes, margin=_MARGIN * distance)
        every = TileExcess(codes, np.where(seen, excess, _UNSEEN_WEIGHT * excess), seen)
        if self.hide:
            coarse = np.flatnonzero(seen & (excess > 1))
            leaves = self._leaves(every)
            hidden = occluded(view, boxes.subset(coarse), boxes.subset(leaves))
            seen[coarse[hidden]] = False
        return TileExcess(codes, np.where(seen, excess, _UNSEEN_WEIGHT * excess), seen)

    def target_tree(self, view: CameraView, pool: TilePool) -> TargetTree:
        """Return the tree that a view requires, as far as known from cached tiles."""
        roots, excess = self.roots(view), self.excess(view, pool)
        coarse = self._coarse_by_level(excess)
        splits, urgency = self._balanced(excess, coarse, view)
        needed = np.concatenate([roots, children_of(splits).ravel()])
        urgent = np.concatenate([np.full(len(roots), np.inf), np.repeat(urgency, 4)])
        ready = np.concatenate([np.ones(len(roots), np.bool_), np.repeat(contains(excess.codes, splits), 4)])
        missing = np.flatnonzero(ready & ~contains(excess.codes, needed))
        order = missing[np.lexsort((needed[missing], -urgent[missing]))]
        spared = ~self._in_picture(view, pool, excess, needed[order])
        rest = order[~spared]
        return TargetTree(splits, needed[rest], urgent[rest], excess, np.sort(needed[order[spared]]))

    def reachable(self, view: CameraView, target: TargetTree, pool: TilePool) -> Int64Array:
        """Return those splits of a tree that cached tiles can show, in balance; sorted."""
        roots, splits = self.roots(view), target.splits
        children = children_of(splits)
        exist = (pool.find(children) >= 0) | contains(target.spared, children)
        ready = splits[exist.all(axis=1) & (pool.find(splits) >= 0)]
        level = decode(ready)[0]
        displayable = roots[:0]
        for at in range(ROOT_LEVEL, self.finest):
            here = ready[level == at]
            if at > ROOT_LEVEL:
                beside = neighbours_of(here)
                relevant = _within(beside, self._range(view, at, _BALANCED))
                backed = (
                    ~relevant | contains(displayable, parent_of(beside)) | _within_any(target.spared, beside)
                )
                here = here[contains(displayable, parent_of(here)) & backed.all(axis=1)]
            displayable = np.sort(np.concatenate([displayable, here]))
        return displayable

    def _in_picture(
        self, view: CameraView, pool: TilePool, excess: TileExcess, codes: Int64Array
    ) -> BoolArray:
        """Return which missing tiles may be in a still, by the heights of their parents; otherwise all."""
        result = np.ones(len(codes), np.bool_)
        if not self.still:
            return result
        child = np.flatnonzero(decode(codes)[0] > ROOT_LEVEL)
        above = parent_of(codes[child])
        heights = pool.conservative_boxes(above, pool.find(above), self.extent)
        boxes = boxes_of(codes[child], self.extent, heights.low[:, 2], heights.high[:, 2])
        distance, _ = horizontal_distances(view, boxes)
        result[child] = view.sees(boxes) & (distance <= view.draw_distance)
        if self.hide:
            leaves = excess.codes[self._leaves(excess)]
            ground = pool.boxes(leaves, pool.find(leaves), self.extent)
            result[child] &= ~occluded(view, boxes, ground)
        return result

    def _coarse_by_level(self, excess: TileExcess) -> list[npt.NDArray[np.intp]]:
        """Return the tiles of each level, from the roots, that are too coarse like all their ancestors."""
        coarse = np.flatnonzero(excess.of_all > 1)
        codes = excess.codes[coarse]
        starts = np.searchsorted(
            codes, [code_of(level, -FARTHEST_TILE, -FARTHEST_TILE) for level in self._levels]
        )
        by_level: list[npt.NDArray[np.intp]] = []
        for first, last in zip(starts, [*starts[1:], None], strict=True):
            here = coarse[first:last]
            if by_level:
                here = here[contains(excess.codes[by_level[-1]], parent_of(excess.codes[here]))]
            by_level.append(here)
        return by_level[:-1]

    def _leaves(self, excess: TileExcess) -> npt.NDArray[np.intp]:
        """Return the leaves after splitting all tiles that are too coarse, unbalanced."""
        splits = np.sort(np.concatenate(self._coarse_by_level(excess)))
        codes = excess.codes
        level, _, _ = decode(codes)
        left = contains(codes[splits], parent_of(codes)) | (level == ROOT_LEVEL)
        left[splits] = False
        return np.flatnonzero(left & intersects_bounds(codes, self.extent, self.bounds))

    def _range(self, view: CameraView, level: int, share: float) -> Range:
        """Return first and last column and row of a level within bounds and a share of the draw distance."""
        width = self.extent * 2.0**-level
        distance = min(share * view.draw_distance, _MAX_ROOTS * self.extent * 2.0**-ROOT_LEVEL)
        ends = [int(np.floor((at + sign * distance) / width)) for at in view.eye[:2] for sign in (-1, 1)]
        most = tile_range(self.bounds, width)
        west, east, south, north = (
            int(limit(end, there)) for limit, end, there in zip((max, min, max, min), ends, most, strict=True)
        )
        return west, east, south, north

    @property
    def _levels(self) -> range:
        return range(ROOT_LEVEL, self.finest + 1)

    def _balanced(
        self, excess: TileExcess, coarse: list[npt.NDArray[np.intp]], view: CameraView
    ) -> tuple[Int64Array, Float64Array]:
        """Return all tiles to split so that touching tiles differ by at most a level, with urgencies.

        The urgency is the greatest excess that forces the split; those not visible come last. Tiles beyond
        the drawn area need no balance. Few tiles on many levels: dictionaries of plain integers are quicker
        here than arrays.
        """
        urgency = np.where(excess.seen, excess.of_all, UNSEEN_URGENCY * np.minimum(excess.of_all, 1e6) / 1e6)
        forced: dict[int, float] = {}
        parts = []
        for level in range(self.finest - 1, ROOT_LEVEL - 1, -1):
            own = coarse[level - ROOT_LEVEL]
            splits = dict(zip(excess.codes[own].tolist(), urgency[own].tolist(), strict=True))
            far_too_coarse = own[excess.of_all[own] > self.metric.neighbour_limit]
            steep = [(code, splits[code]) for code in excess.codes[far_too_coarse].tolist()]
            _raise(splits, forced.items())
            inside = self._range(view, level, _BALANCED)
            _raise(splits, ((n, by) for code, by in steep for n in around(code, inside)))
            parts.append(splits)
            inside = self._range(view, level - 1, _BALANCED)
            forced = {}
            _raise(forced, ((p, by) for code, by in splits.items() for p in parents_around(code, inside)))
        splits = {code: by for part in parts for code, by in part.items()}
        codes = np.array(sorted(splits), np.int64)
        return codes, np.array([splits[code] for code in codes.tolist()])


def _raise(values: dict[int, float], others: Iterable[tuple[int, float]]) -> None:
    """Merge values, retaining the greater one."""
    for code, value in others:
        if values.get(code, 0.0) < value:
            values[code] = value


def _within_any(tiles: Int64Array, codes: Int64Array) -> BoolArray:
    """Return which of some codes are among sorted tiles, or below them; any shape."""
    result = contains(tiles, codes)
    for _ in range(int(decode(codes)[0].max(initial=ROOT_LEVEL)) - ROOT_LEVEL if tiles.size else 0):
        codes = parent_of(codes)
        result |= contains(tiles, codes)
    return result


def _within(codes: Int64Array, inside: Range) -> npt.NDArray[np.bool_]:
    """Return which tiles are in a range of columns and rows."""
    _, col, row = decode(codes)
    west, east, south, north = inside
    return np.asarray((col >= west) & (col <= east) & (row >= south) & (row <= north))
