"""Selection of patches: the fewest that cover the data at an accuracy, or for a cell size.

Patches are ordered by area, then by error, then by id. A patch is used from its error up to its top: the
least error at which greater patches cover its kernel (Rocca, Panozzo & Puppo 2012, §3.3). Tops are a function
of the set of patches alone, so that grids can be added and removed in any order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from scipy import ndimage

from sketchterrain.array_types import (
    BoolArray,
    Bounds,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
    UInt8Array,
)
from sketchterrain.caching import LRUCache
from sketchterrain.elevation.mips import in_threads
from sketchterrain.elevation.patches import (
    COEFFICIENTS,
    DemPatches,
    GridPatches,
    concatenated,
    outward,
    subset,
)
from sketchterrain.elevation.surface import BoxClasses, PatchSlots, PatchSurface
from sketchterrain.errors import InputError
from sketchterrain.host.library import host_function

_MAX_PIECES, _MAX_CORNERS = 512, 20
_AT_ONCE, _NEAR = 1 << 15, 1 << 18  # patches whose tops are computed at once, and others beside them


class Tops(NamedTuple):
    """Errors (m) from which patches are left out."""

    top: Float64Array
    is_best: BoolArray  # of a finest level that no more accurate grid covers: used whatever accuracy is asked


class PatchNumbers:
    """Patches of some grids as one list: by grid, then by level, row and column."""

    def __init__(self, parts: Sequence[GridPatches]) -> None:
        self.parts = list(parts)
        counts = [len(each) for each in parts]
        self.starts = np.cumsum([0, *counts])
        self.grid = np.repeat(np.arange(len(counts), dtype=np.int32), counts)  # of each patch
        tables = [each.table for each in parts]
        # West, south, east and north (m) of what each patch reaches, rounded outward; and its error (m).
        self.reach: Float32Array = _joined([each.reach for each in tables], (0, 4))
        self.error: Float64Array = _joined(
            [each.accuracy + each.table.error.astype(np.float64) for each in parts], (0,)
        )
        # Grid, level and rank of each level, its first patch and the end.
        levels = [(n, level) for n, each in enumerate(parts) for level in range(each.levels)]
        self.levels = np.array(levels, np.int64).reshape(-1, 2)
        self.ranks = np.array([parts[n].rank(level) for n, level in levels], np.int64)
        ends = [(self.starts[n] + tables[n].starts[[level, level + 1]]) for n, level in levels]
        self.ends = np.array(ends, np.int64).reshape(-1, 2)

    def __len__(self) -> int:
        return int(self.starts[-1])

    def rows(self, which: Int64Array) -> tuple[DemPatches, Float64Array]:
        """Return columns of some patches, and corners of their rectangles if `which` ascends."""
        grid = self.grid[which]
        if (np.diff(grid) < 0).any():
            order = np.argsort(grid, kind="stable")
            patches, corners = self.rows(which[order])
            return subset(patches, np.argsort(order)), corners
        found = np.unique(grid) if len(grid) else [0]
        parts = [self.parts[n].rows(which[grid == n] - self.starts[n]) for n in found]
        return concatenated([each for each, _ in parts]), np.concatenate([each for _, each in parts])

    def touching(self, box: Float32Array, levels: BoolArray) -> Int64Array:
        """Return the patches of some levels that reach into a box."""
        found = [
            first + np.flatnonzero(overlapping(self.reach[first:last], box))
            for first, last in self.ends[levels].tolist()
        ]
        return np.concatenate([np.zeros(0, np.int64), *found])


def overlapping(boxes: Float32Array, box: Float32Array) -> BoolArray:
    """Return which boxes (n, 4) touch another one."""
    found: BoolArray = (boxes[:, 0] <= box[2]) & (boxes[:, 2] >= box[0])
    found &= (boxes[:, 1] <= box[3]) & (boxes[:, 3] >= box[1])
    return found


def _joined(arrays: Sequence[Any], empty: tuple[int, ...]) -> Any:
    """Return arrays one after another; one alone is not copied."""
    return np.concatenate([np.zeros(empty, np.float32), *arrays]) if len(arrays) != 1 else arrays[0]


def box_around(boxes: Float32Array | Float64Array) -> Any:
    """Return the box around boxes."""
    if not len(boxes):
        return np.array([np.inf, np.inf, -np.inf, -np.inf], np.float32)
    return np.concatenate([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])


def find_tops(numbers: PatchNumbers, which: Int64Array, lowest: Int64Array | None = None) -> Tops:
    """Return the tops of some patches, in ascending order, among those from each grid's lowest level on.

    The lowest levels count as accurate as their grid. Patches are taken in groups with those that touch them,
    so that memory is bounded.
    """
    if lowest is None:
        lowest = np.zeros(len(numbers.parts), np.int64)
    tops = Tops(np.empty(len(which)), np.empty(len(which), bool))
    allowed = numbers.levels[:, 1] >= lowest[numbers.levels[:, 0]]
    for n in np.flatnonzero(allowed):
        first, last = np.searchsorted(which, numbers.ends[n])
        is_finest = numbers.levels[:, 1] == lowest[numbers.levels[:, 0]]
        # Those that may cover them: greater ones, and the finest of other grids.
        others = allowed & (numbers.ranks >= numbers.ranks[n])
        if is_finest[n]:
            others |= is_finest & (numbers.levels[:, 0] != numbers.levels[n, 0])
        groups = [(start, min(start + _AT_ONCE, last)) for start in range(first, last, _AT_ONCE)]
        while groups:
            start, end = groups.pop()
            near = numbers.touching(box_around(numbers.reach[which[start:end]]), others)
            if len(near) > _NEAR and end - start > 1:
                middle = (start + end) // 2
                groups += [(start, middle), (middle, end)]
                continue
            near = np.union1d(near, which[start:end])
            patches, corners = numbers.rows(near)
            grid = numbers.grid[near]
            patches.finest[:] = patches.level == lowest[grid]
            accuracy = np.array([each.accuracy for each in numbers.parts])[grid]
            patches.error[:] = np.where(patches.finest, accuracy, patches.error)
            asked = np.searchsorted(near, which[start:end])
            part = _tops_among(patches, grid, corners, asked)
            tops.top[start:end], tops.is_best[start:end] = part
    return tops


def _tops_among(patches: DemPatches, grid: Int32Array, corners: Float64Array, which: Int64Array) -> Tops:
    """Return the tops of some patches among those given."""
    grown = patches.kernel + patches.growth[:, None] * np.array([-1.0, -1.0, 1.0, 1.0])
    kernels, index = kernels_of(patches, corners), BoxClasses.from_boxes(grown)
    order = patches.rank, patches.error, patches.finest, grid
    tops, count = Tops(np.empty(len(which)), np.empty(len(which), bool)), len(patches)

    def compute(start: int, end: int) -> None:
        scratch = *np.empty((2, count), np.int64), *np.empty((2, 2 * count))
        pieces = np.empty((2, _MAX_PIECES, _MAX_CORNERS, 2)), np.empty((2, _MAX_PIECES), np.int64)
        host_function("compute_tops")(which, *order, *kernels, *index, start, end, *tops, *scratch, *pieces)

    in_threads(compute, len(which), 256)
    return tops


class Kernels(NamedTuple):
    """Kernels of patches for compiled functions."""

    boxes: Float64Array  # (n, 4)
    growth: Float64Array
    first: Int64Array  # (n + 1): number of the first rectangle
    corners: Float64Array


def kernels_of(patches: DemPatches, corners: Float64Array) -> Kernels:
    """Return the kernels of patches, and the corners of their rectangles."""
    first = np.concatenate([[0], np.cumsum(patches.rectangles)])
    return Kernels(*map(np.ascontiguousarray, (patches.kernel, patches.growth, first, corners)))


CELL_ERRORS: Final = 64.0
"""Errors of a cell size: heights for cells of h m are within h / 64."""

_RIM_NODES, _MAX_NODES = 8.0, 1 << 24  # along the margin of a rim, and of a whole raster
_HALF_STEP = 4.0  # growths, and a little more: tiles of areas end a step apart
_CACHED, _CACHED_BYTES = 32, 1 << 27  # selections for cell sizes


class Patchwork(PatchNumbers):
    """The patches of any number of overlapping grids, numbered by the ids of their grids; a value."""

    def __init__(self, grids: Mapping[bytes, GridPatches] | None = None) -> None:
        self.grids: dict[bytes, GridPatches] = dict(sorted((grids or {}).items()))
        super().__init__(list(self.grids.values()))
        self._tops: Tops | None = None
        self._for_cells = LRUCache(_CACHED, max_bytes=_CACHED_BYTES)

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the grids: the rest follows from them."""
        return Patchwork, (self.grids,)

    def digest_parts(self) -> tuple[bytes, ...]:
        """Return what its digest is of."""
        return tuple(self.grids)

    @property
    def middle(self) -> float:
        """Mean height (m) of the grids."""
        return float(np.mean([each.base for each in self.parts]))

    @property
    def accuracy(self) -> float:
        """The largest error (m) of samples of any grid."""
        return max(each.accuracy for each in self.parts)

    def rows(self, which: Int64Array) -> tuple[DemPatches, Float64Array]:
        """Return columns of some patches, and the corners of their rectangles if `which` ascends."""
        self._check()
        return super().rows(which)

    @property
    def tops(self) -> Tops:
        """Tops of all patches."""
        if self._tops is None:
            self._tops = self._tops_from(np.zeros(len(self.parts), np.int64))
        return self._tops

    def _tops_from(self, lowest: Int64Array) -> Tops:
        """Return tops among patches from each grid's lowest level on; those of finer ones are undefined.

        Grids have their own tops: only those of patches that touch another grid are computed. A grid's finer
        levels change no top.
        """
        tops = Tops(np.empty(len(self)), np.zeros(len(self), bool))
        boxes = np.array([box_around(each.table.reach) for each in self.parts]).reshape(-1, 4)
        stale = np.zeros(len(self), bool)
        for n, (part, level) in enumerate(zip(self.parts, lowest, strict=True)):
            here = slice(self.starts[n], self.starts[n + 1])
            tops.top[here] = part.table.top
            tops.is_best[here][slice(*part.table.starts[[level, level + 1]])] = True
            for other in np.flatnonzero(overlapping(boxes, boxes[n])):
                if other != n:
                    stale[here] |= overlapping(self.reach[here], boxes[other])
            stale[here][: part.table.starts[level]] = False
        which = np.flatnonzero(stale)
        tops.top[which], tops.is_best[which] = find_tops(self, which, lowest)
        return tops

    def _check(self) -> None:
        if not self.parts:
            raise InputError("expected at least one elevation grid")

    def cover(self, error: float) -> Int64Array:
        """Return the patches of the minimal cover within an error (m).

        Where no grid is so accurate, the most accurate ones there are.
        """
        if not error >= 0.0:
            raise InputError(f"error {error}: expected metres, 0 or more")
        self._check()
        top, is_best = self.tops
        return np.flatnonzero(((self.error <= error) | is_best) & (error < top))

    def cover_for_cells(self, cell_size: float) -> Int64Array:
        """Return the patches for samples `cell_size` (m) apart: a minimal cover within 1/64 of it.

        Their steps are at least half of it, except where grids end. The finest levels of grids that are left
        count as accurate as the grid, as what they lack is finer than the cells.
        """
        which, errors, (top, is_best) = self._selection(self._lowest(cell_size))
        error = cell_size / CELL_ERRORS
        kept = np.flatnonzero(((errors <= error) | is_best) & (error < top))
        return kept if which is None else which[kept]

    def _lowest(self, cell_size: float) -> tuple[int, ...]:
        """Return the lowest level of each grid whose steps are at least half a cell."""
        if not cell_size > 0.0:
            raise InputError(f"cell size {cell_size}: expected metres above 0")
        self._check()
        return tuple(
            int(np.clip(np.ceil(np.log2(0.5 * cell_size / each.step) - 1e-9), 0, each.levels - 1))
            for each in self.parts
        )

    def _selection(self, lowest: tuple[int, ...]) -> tuple[Int64Array | None, Float64Array, Tops]:
        """Return the patches from each grid's lowest level on, None for all; their errors and tops."""
        if not any(lowest):
            return None, self.error, self.tops
        return self._for_cells.get_or_compute(lowest, lambda: self._without_fine_levels(np.array(lowest)))

    def _without_fine_levels(self, lowest: Int64Array) -> tuple[Int64Array, Float64Array, Tops]:
        errors, kept = self.error.copy(), [np.zeros(0, np.int64)]
        for n, (each, level) in enumerate(zip(self.parts, lowest, strict=True)):
            first, last = self.starts[n] + each.table.starts[[level, level + 1]]
            errors[first:last] = each.accuracy
            kept.append(np.arange(first, self.starts[n + 1]))
        which = np.concatenate(kept)
        top, is_best = self._tops_from(lowest)
        return which, errors[which], Tops(top[which], is_best[which])

    @property
    def box(self) -> Float64Array:
        """West, south, east and north of all data, m."""
        self._check()
        found: Float64Array = box_around(np.array([each.box for each in self.parts]))
        return found

    def rim_fade(self, margin: float, start: float = 0.0) -> RimFade:
        """Return a weight that blends all data into other ground over a margin (m) inside of their rim.

        It is 0 up to `start` (m) inside, at most 0.4 margins. It does not see where one grid ends beside
        another; gaps narrower than a step are none.
        """
        spacing, low, high = margin / _RIM_NODES, self.box[:2], self.box[2:]
        shape = np.ceil((high - low) / max(spacing, 1e-9)) + 5
        if not margin > 0.0 or shape.prod() > _MAX_NODES:
            raise InputError(
                f"margin {margin:g}: expected more metres, of an extent of {max(high - low):.0f} m"
            )
        west, south = low - 2.0 * spacing
        inside = np.zeros((int(shape[1]), int(shape[0])), bool)
        for patches, corners in (group for each in self.parts for group in each.finest()):
            boxes, growth, *rectangles = kernels_of(patches, corners)
            place = west, south, spacing
            host_function("mark_kernels")(boxes, _HALF_STEP * growth, *rectangles, *place, inside)
        # Coefficients two nodes from the rim are 0, as each reaches two nodes.
        # The raster's border is outside: kernels of few samples, grown by half a step, reach over it.
        depth = ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1]
        zero = 2.0 + min(start / spacing, 0.4 * _RIM_NODES)
        part = np.clip((depth - zero) / (_RIM_NODES - 2.0 - zero), 0.0, 1.0)
        return RimFade(float(west), float(south), spacing, part)

    def within(self, which: Int64Array, area: Bounds) -> Int64Array:
        """Return those of some patches that reach into an area (m); the others change no bit there."""
        return which[overlapping(self.reach[which], outward(np.asarray(area)))]

    def surface(self, which: Int64Array) -> PatchSurface:
        """Return the surface of some patches, as of `cover`."""
        return PatchSurface(self.slots(which), self.reach[which].astype(np.float64))

    def slots(self, which: Int64Array) -> PatchSlots:
        """Return what evaluating some patches reads."""
        patches, _ = self.rows(which)
        coefficients, mask_of, masks = self.patch_data(which)
        return PatchSlots(
            centre=patches.centre,
            to_steps=patches.to_steps,
            density=1.0 / patches.step_area**2,
            base=np.array([each.base for each in self.parts])[self.grid[which]],
            grid=self.grid[which],
            coefficients=coefficients,
            mask_of=mask_of,
            masks=masks,
            rims=np.column_stack([patches.rim, 2.0**patches.level])[patches.has_mask],
        )

    def patch_data(self, which: Int64Array) -> tuple[Float32Array, Int64Array, UInt8Array]:
        """Return coefficients (n, 35, 35) of patches, m above the base of their grid, and masks.

        Then follow the number of the mask of each, -1 where data are all around, and masks (m, 35, 35). Of a
        grid on disk, what is not in memory is read.
        """
        coefficients = np.empty((len(which), COEFFICIENTS, COEFFICIENTS), np.float32)
        mask_of = np.full(len(which), -1)
        for n in np.unique(self.grid[which]):
            slots = np.flatnonzero(self.grid[which] == n)
            part, own = self.parts[n], which[slots] - self.starts[n]
            part.copy_coefficients(own, coefficients, slots)
            mask_of[slots] = part.table.mask[own]
        masked = np.flatnonzero(mask_of >= 0)
        masks = np.empty((len(masked), COEFFICIENTS, COEFFICIENTS), np.uint8)
        for slot, number in enumerate(masked):
            at = mask_of[number]
            masks[slot] = self.parts[self.grid[which[number]]].masks[at : at + 1]
        mask_of[masked] = np.arange(len(masked))
        return coefficients, mask_of, masks


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
