"""Selection of patches: the fewest that cover the data at an accuracy, or for a cell size.

Patches are ordered by area, then by error, then by id. A patch is used from its error up to its top: the
least error at which greater patches cover its kernel (Rocca, Panozzo & Puppo 2012, §3.3). Tops are a function
of the set of patches alone, so that grids can be added and removed in any order.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array
from sketchterrain.caching import LRUCache
from sketchterrain.elevation.mips import in_threads
from sketchterrain.elevation.patches import (
    COEFFICIENTS,
    KERNEL,
    GridPatches,
    Patches,
    concatenated,
    subset,
)
from sketchterrain.elevation.surface import BoxIndex, PatchSlots, PatchSurface
from sketchterrain.errors import InputError

CELL_ERRORS: Final = 64.0
"""Errors of a cell size: heights for cells of h m are within h / 64."""

_MAX_PIECES, _MAX_CORNERS = 512, 20
_RIM_NODES, _MAX_NODES = 8.0, 1 << 24  # along the margin of a rim, and of a whole raster
_HALF_STEP = 4.0  # growths, and a little more: tiles of areas end a step apart
_CACHED = 16  # selections for cell sizes


class _Tops(NamedTuple):
    top: Float64Array  # m: the patch is left out from this error on
    is_best: BoolArray  # of a finest level that no more accurate grid covers: used whatever accuracy is asked


class Patchwork:
    """The patches of any number of overlapping grids; a value.

    Patches are numbered by the ids of their grids, then by level, row and column.
    """

    def __init__(self, grids: Mapping[bytes, GridPatches] | None = None) -> None:
        self.grids: dict[bytes, GridPatches] = dict(sorted((grids or {}).items()))
        parts = list(self.grids.values())
        self.patches = concatenated([each.patches for each in parts]) if parts else None
        counts = [len(each.patches) for each in parts]
        self.grid = np.repeat(np.arange(len(parts)), counts)
        self._starts = np.cumsum([0, *counts])
        self._corners = np.concatenate([each.corners for each in parts]) if parts else np.zeros((0, 4, 2))
        self._tops: _Tops | None = None
        self._for_cells = LRUCache(_CACHED)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the grids and the tops."""
        return _restored, (self.grids, self._tops)

    @property
    def tops(self) -> _Tops:
        """Tops of all patches."""
        if self._tops is None:
            patches = self._table()
            self._tops = _find_tops(patches, self.grid, self._corners, np.arange(len(patches)))
        return self._tops

    def with_grid(self, grid: GridPatches) -> Patchwork:
        """Return the patchwork with one more grid; only tops of patches that touch it are computed."""
        return self if grid.id in self.grids else self._changed({**self.grids, grid.id: grid}, grid)

    def without_grid(self, grid_id: bytes) -> Patchwork:
        """Return the patchwork without a grid; patches that it made redundant are used again."""
        if grid_id not in self.grids:
            return self
        rest = {key: each for key, each in self.grids.items() if key != grid_id}
        return self._changed(rest, self.grids[grid_id])

    def _changed(self, grids: dict[bytes, GridPatches], grid: GridPatches) -> Patchwork:
        changed = Patchwork(grids)
        if self.patches is None or changed.patches is None:
            return changed
        old, kernel = self.tops, changed.patches.kernel
        top, is_best = np.empty(len(kernel)), np.zeros(len(kernel), bool)
        growth = 2.0 * max(float(self.patches.growth.max()), float(changed.patches.growth.max()))
        low = grid.patches.kernel[:, :2].min(axis=0) - growth
        high = grid.patches.kernel[:, 2:].max(axis=0) + growth
        stale = (kernel[:, :2] <= high).all(axis=1) & (kernel[:, 2:] >= low).all(axis=1)
        for number, key in enumerate(changed.grids):
            here = slice(changed._starts[number], changed._starts[number + 1])
            if key in self.grids:
                there = list(self.grids).index(key)
                before = slice(self._starts[there], self._starts[there + 1])
                top[here], is_best[here] = old.top[before], old.is_best[before]
        which = np.flatnonzero(stale)
        top[which], is_best[which] = _find_tops(changed.patches, changed.grid, changed._corners, which)
        changed._tops = _Tops(top, is_best)
        return changed

    def cover(self, error: float) -> Int64Array:
        """Return the patches of the minimal cover within an error (m).

        Where no grid is so accurate, the most accurate ones there are.
        """
        if not error >= 0.0:
            raise InputError(f"error {error}: expected metres, 0 or more")
        top, is_best = self.tops
        return np.flatnonzero(((self._table().error <= error) | is_best) & (error < top))

    def cover_for_cells(self, cell_size: float) -> Int64Array:
        """Return the patches for samples `cell_size` (m) apart: a minimal cover within 1/64 of it.

        Their steps are at least half of it, except where grids end. The finest levels of grids that are left
        count as accurate as the grid, as what they lack is finer than the cells.
        """
        if not cell_size > 0.0:
            raise InputError(f"cell size {cell_size}: expected metres above 0")
        lowest = tuple(
            int(np.clip(np.ceil(np.log2(0.5 * cell_size / each.step) - 1e-9), 0, len(each.coefficients) - 1))
            for each in self.grids.values()
        )
        which, patches, (top, is_best) = self._for_cells.get_or_compute(
            lowest, lambda: self._without_fine_levels(np.array(lowest))
        )
        error = cell_size / CELL_ERRORS
        kept: Int64Array = which[((patches.error <= error) | is_best) & (error < top)]
        return kept

    def _without_fine_levels(self, lowest: Int64Array) -> tuple[Int64Array, Patches, _Tops]:
        """Return the patches from each grid's lowest level on, and their tops."""
        patches, accuracy = self._table(), np.array([each.accuracy for each in self.grids.values()])
        which = np.flatnonzero(patches.level >= lowest[self.grid])
        if len(which) == len(patches):
            return which, patches, self.tops
        owner = np.repeat(np.arange(len(patches)), patches.rectangles)
        corners = self._corners[np.isin(owner, which)]
        patches = subset(patches, which)
        grid = self.grid[which]
        patches.finest[:] = patches.level == lowest[grid]
        patches.error[:] = np.where(patches.finest, accuracy[grid], patches.error)
        return which, patches, _find_tops(patches, grid, corners, np.arange(len(which)))

    def rim_fade(self, margin: float, start: float = 0.0) -> RimFade:
        """Return a weight that blends all data into other ground over a margin (m) inside of their rim.

        It is 0 up to `start` (m) inside, at most 0.4 margins. It does not see where one grid ends beside
        another; gaps narrower than a step are none.
        """
        patches, spacing = self._table(), margin / _RIM_NODES
        low, high = patches.kernel[:, :2].min(axis=0), patches.kernel[:, 2:].max(axis=0)
        shape = np.ceil((high - low) / max(spacing, 1e-9)) + 5
        if not margin > 0.0 or shape.prod() > _MAX_NODES:
            raise InputError(
                f"margin {margin:g}: expected more metres, of an extent of {max(high - low):.0f} m"
            )
        west, south = low - 2.0 * spacing
        inside = np.zeros((int(shape[1]), int(shape[0])), bool)
        finest, kernels = np.flatnonzero(patches.finest), _kernels(patches, self._corners)
        _mark(finest, kernels, west, south, spacing, inside)
        # Coefficients two nodes from the rim are 0, as each reaches two nodes.
        depth = ndimage.distance_transform_edt(inside)
        zero = 2.0 + min(start / spacing, 0.4 * _RIM_NODES)
        part = np.clip((depth - zero) / (_RIM_NODES - 2.0 - zero), 0.0, 1.0)
        return RimFade(float(west), float(south), spacing, part)

    def _table(self) -> Patches:
        if self.patches is None:
            raise InputError("expected at least one elevation grid")
        return self.patches

    def within(self, which: Int64Array, area: Bounds) -> Int64Array:
        """Return those of some patches that reach into an area (m); the others change no bit there."""
        west, south, east, north = area
        reach = self._table().reach[which]
        near = (reach[:, 0] <= east) & (reach[:, 2] >= west) & (reach[:, 1] <= north) & (reach[:, 3] >= south)
        return which[near]

    def surface(self, which: Int64Array, *, wendland: bool = False) -> PatchSurface:
        """Return the surface of some patches, as of `cover`; by the paper's weights if `wendland`."""
        return PatchSurface(self.slots(which), self.reach[which], wendland=wendland)

    @property
    def reach(self) -> Float64Array:
        """West, south, east and north (n, 4) of what each patch reaches, m."""
        return self._table().reach

    @property
    def error(self) -> Float64Array:
        """Error (m) of each patch."""
        return self._table().error

    @property
    def middle(self) -> float:
        """Mean height (m) of the grids."""
        return float(np.mean([each.base for each in self.grids.values()]))

    @property
    def accuracy(self) -> float:
        """The largest error (m) of samples of any grid."""
        return max(each.accuracy for each in self.grids.values())

    def slots(self, which: Int64Array) -> PatchSlots:
        """Return what evaluating some patches reads."""
        patches, parts = subset(self._table(), which), list(self.grids.values())
        coefficients = np.empty((len(which), COEFFICIENTS, COEFFICIENTS), np.float32)
        mask_of = np.where(patches.has_mask, np.cumsum(patches.has_mask) - 1, -1)
        masks = np.empty((int(patches.has_mask.sum()), COEFFICIENTS, COEFFICIENTS), np.uint8)
        for slot, number in enumerate(which):
            part, level = parts[self.grid[number]], patches.level[slot]
            row, column = KERNEL * patches.row[slot], KERNEL * patches.column[slot]
            window = np.s_[row : row + COEFFICIENTS, column : column + COEFFICIENTS]
            coefficients[slot] = part.coefficients[level][window]
            if mask_of[slot] >= 0:
                masks[mask_of[slot]] = part.masks[level][window]
        grid = self.grid[which]
        return PatchSlots(
            centre=patches.centre,
            to_steps=patches.to_steps,
            density=1.0 / patches.step_area,
            base=np.array([each.base for each in parts])[grid],
            grid=grid,
            coefficients=coefficients,
            mask_of=mask_of,
            masks=masks,
            rims=np.column_stack([patches.rim, 2.0**patches.level])[patches.has_mask],
        )


def _restored(grids: Mapping[bytes, GridPatches], tops: _Tops | None) -> Patchwork:
    work = Patchwork(grids)
    work._tops = tops
    return work


class RimFade(NamedTuple):
    """Weight of all data from 0 along their outermost rim to 1 some metres inside: a cubic B-spline."""

    west: float  # place of the first coefficient, m
    south: float
    spacing: float
    coefficients: Float64Array  # by rows northward

    def weight(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return weights at points (m) of one shape, C²."""
        places = [(y - self.south) / self.spacing, (x - self.west) / self.spacing]
        found: Float64Array = ndimage.map_coordinates(
            self.coefficients, places, order=3, prefilter=False, mode="constant"
        )
        return found


class _Kernels(NamedTuple):
    """Kernels for compiled functions."""

    boxes: Float64Array  # (n, 4)
    growth: Float64Array
    first: Int64Array  # (n + 1): number of the first rectangle
    corners: Float64Array


def _kernels(patches: Patches, corners: Float64Array) -> _Kernels:
    first = np.concatenate([[0], np.cumsum(patches.rectangles)])
    return _Kernels(patches.kernel, patches.growth, first, corners)


def _find_tops(patches: Patches, grid: Int64Array, corners: Float64Array, which: Int64Array) -> _Tops:
    """Return the tops of some patches."""
    grown = patches.kernel + patches.growth[:, None] * np.array([-1.0, -1.0, 1.0, 1.0])
    kernels, index = _kernels(patches, corners), BoxIndex.from_boxes(grown)
    order = patches.rank, patches.error, patches.finest, grid
    tops = _Tops(np.empty(len(which)), np.empty(len(which), bool))
    in_threads(
        lambda start, end: _compute_tops(which, order, kernels, index, tops, start, end), len(which), 256
    )
    return tops


@njit(cache=True, nogil=True)
def _compute_tops(which, order, kernels, index, tops, start, end):  # type: ignore[no-untyped-def]
    """Compute the tops of the patches which[start:end]: algorithm 1 of the paper, `cutter`."""
    rank, error, finest, grid = order
    seen = np.full(len(rank), -1, np.int64)
    near = np.empty(len(rank), np.int64)
    pieces = np.empty((2, _MAX_PIECES, _MAX_CORNERS, 2))
    sizes = np.empty((2, _MAX_PIECES), np.int64)
    for n in range(start, end):
        p = which[n]
        count = _touching(p, kernels, index, seen, near)
        greater, better = np.empty(count, np.int64), np.empty(count, np.int64)
        found = known = 0
        for q in np.sort(near[:count]):
            if (-rank[q], error[q], q) < (-rank[p], error[p], p):
                greater[found] = q
                found += 1
            if finest[q] and grid[q] != grid[p] and (error[q], -rank[q], q) < (error[p], -rank[p], p):
                better[known] = q
                known += 1
        # Greater patches, by error, until they cover the kernel.
        greater = greater[:found]
        by_error = greater[np.argsort(error[greater], kind="mergesort")]
        last = _covering(p, by_error, kernels, pieces, sizes)
        tops.top[n] = np.inf if last < 0 else error[last]
        # What no other grid knows better is used whatever accuracy is asked.
        tops.is_best[n] = finest[p] and _covering(p, better[:known], kernels, pieces, sizes) < 0


@njit(cache=True, nogil=True)
def _touching(p, kernels, index, seen, near):  # type: ignore[no-untyped-def]
    """Write the patches whose grown kernels touch that of p, each once; return how many."""
    box, count = kernels.boxes[p], 0
    for c in range(len(index.places)):
        west, south, cell = index.places[c]
        wide, deep, first = index.shapes[c]
        x0, x1 = max(int((box[0] - west) // cell), 0), min(int((box[2] - west) // cell), wide - 1)
        y0, y1 = max(int((box[1] - south) // cell), 0), min(int((box[3] - south) // cell), deep - 1)
        for row in range(y0, y1 + 1):
            for key in range(first + row * wide + x0, first + row * wide + x1 + 1):
                for k in range(index.starts[key], index.starts[key + 1]):
                    q = index.items[k]
                    other, g = kernels.boxes[q], kernels.growth[q]
                    across = other[0] - g < box[2] and other[2] + g > box[0]
                    if q != p and seen[q] != p and across and other[1] - g < box[3] and other[3] + g > box[1]:
                        seen[q] = p
                        near[count] = q
                        count += 1
    return count


@njit(cache=True, nogil=True)
def _covering(p, others, kernels, pieces, sizes):  # type: ignore[no-untyped-def]
    """Return the patch with which others, in this order, cover the kernel of p; -1 if they don't."""
    side, left = 0, kernels.first[p + 1] - kernels.first[p]
    for k in range(left):
        sizes[0, k] = 4
        pieces[0, k, :4] = kernels.corners[kernels.first[p] + k]
    for q in others:
        for k in range(kernels.first[q], kernels.first[q + 1]):
            left = _without(kernels.corners[k], kernels.growth[q], pieces, sizes, side, left)
            side = 1 - side
            if left <= 0:
                return q if left == 0 else -1
    return -1


@njit(cache=True, nogil=True)
def _edges(corners, grow):  # type: ignore[no-untyped-def]
    """Return a, b, c of the edges of a rectangle, grown by some metres: distance outward = a·x + b·y + c."""
    lines = np.empty((4, 3))
    for i in range(4):
        x, y = corners[i, 0], corners[i, 1]
        dx, dy = corners[(i + 1) % 4, 0] - x, corners[(i + 1) % 4, 1] - y
        length = math.hypot(dx, dy)
        lines[i, 0], lines[i, 1] = dy / length, -dx / length
        lines[i, 2] = -(lines[i, 0] * x + lines[i, 1] * y) - grow
    return lines


@njit(cache=True, nogil=True)
def _without(corners, grow, pieces, sizes, side, left):  # type: ignore[no-untyped-def]
    """Write the pieces outside of a rectangle, grown by some metres, to the other buffer; return how many."""
    other, count = 1 - side, 0
    lines = _edges(corners, grow)
    sliver = 1e-6 * grow
    rest = np.empty((_MAX_CORNERS, 2))
    for k in range(left):
        size, apart = sizes[side, k], False
        for i in range(4):
            apart = True
            for j in range(size):
                if _distance(lines[i], pieces[side, k, j]) < -sliver:
                    apart = False
                    break
            if apart:
                break
        if apart:
            if count == _MAX_PIECES:
                return -1
            sizes[other, count] = size
            pieces[other, count, :size] = pieces[side, k, :size]
            count += 1
            continue
        rest[:size] = pieces[side, k, :size]
        for i in range(4):
            if count == _MAX_PIECES or size + 1 > _MAX_CORNERS:
                return -1
            # The part beyond this edge is left, the other one goes on to the next edge.
            beyond, inside, most = 0, 0, 0.0
            kept = np.empty((_MAX_CORNERS, 2))
            for j in range(size):
                here, there = rest[j], rest[(j + 1) % size]
                d, e = _distance(lines[i], here), _distance(lines[i], there)
                most = max(most, d)
                if d >= 0.0:
                    pieces[other, count, beyond] = here
                    beyond += 1
                if d <= 0.0:
                    kept[inside] = here
                    inside += 1
                if (d < 0.0 and e > 0.0) or (d > 0.0 and e < 0.0):
                    t = d / (d - e)
                    for axis in range(2):
                        at = here[axis] + t * (there[axis] - here[axis])
                        pieces[other, count, beyond, axis] = at
                        kept[inside, axis] = at
                    beyond, inside = beyond + 1, inside + 1
            if most > sliver:
                sizes[other, count] = beyond
                count += 1
                rest, size = kept, inside
            if size < 3:
                break
    return count


@njit(cache=True, nogil=True, inline="always")
def _distance(line, point):  # type: ignore[no-untyped-def]
    return line[0] * point[0] + line[1] * point[1] + line[2]


@njit(cache=True, nogil=True)
def _mark(which, kernels, west, south, spacing, inside):  # type: ignore[no-untyped-def]
    """Mark the nodes of a raster in kernels, grown by half a step."""
    for p in which:
        grow = _HALF_STEP * kernels.growth[p]
        x0, y0 = (kernels.boxes[p, 0] - grow - west) / spacing, (kernels.boxes[p, 1] - grow - south) / spacing
        x1, y1 = (kernels.boxes[p, 2] + grow - west) / spacing, (kernels.boxes[p, 3] + grow - south) / spacing
        for k in range(kernels.first[p], kernels.first[p + 1]):
            lines = _edges(kernels.corners[k], grow)
            for row in range(max(math.ceil(y0), 0), min(math.floor(y1) + 1, inside.shape[0])):
                for column in range(max(math.ceil(x0), 0), min(math.floor(x1) + 1, inside.shape[1])):
                    point = (west + column * spacing, south + row * spacing)
                    if max([_distance(lines[i], point) for i in range(4)]) <= 0.0:
                        inside[row, column] = True
