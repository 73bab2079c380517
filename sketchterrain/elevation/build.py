"""Building of patches from a DEM grid of any size, strip by strip."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import ndimage

from sketchterrain.array_types import (
    BoolArray,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
    UInt8Array,
)
from sketchterrain.elevation.detail_law import measure_detail
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.mips import (
    FILLED,
    PADDING,
    SETTLED,
    halved,
    in_threads,
    level_shapes,
    padded,
    spline_coefficients,
)
from sketchterrain.elevation.patches import (
    COEFFICIENTS,
    KERNEL,
    MARGIN,
    WHOLE,
    GridPatches,
    PatchTable,
    kernel_boxes,
    kernel_counts,
    patch_maps,
    patch_reach,
    step_of,
)
from sketchterrain.elevation.planes import CHUNK, ArrayFile, CoefficientPlanes
from sketchterrain.elevation.selection import PatchNumbers, box_around, find_tops
from sketchterrain.errors import InputError
from sketchterrain.host.library import host_function

_FADE = 15  # samples along which the weight of a grid rises from its rim and from voids
_MAX_STEP = 8000.0  # m: a quadratic map of a patch of 256 km is off by 0.01 steps, and 8 times for twice that
_MAX_OFF = 0.02  # steps by which maps of patches may be off
_BLOCK = 4  # steps along the blocks of which kernels beside voids consist
_COLUMNS = 896  # of splines that are fitted at once
_KERNELS = CHUNK[0] // KERNEL  # rows of them in a row of chunks
_PATCHES = 1 << 16  # whose places are computed at once
_BESIDE = SETTLED + FILLED  # rows around a row of chunks that it depends on


def build_patches(
    grid: ElevationGrid,
    *,
    values: ArrayFile | None = None,
    masks: ArrayFile | None = None,
    strip: int | None = None,
) -> GridPatches:
    """Return the patches of a grid, at every mip level.

    The samples are read three times by strips of so many rows, which make no difference: for the grid's id,
    for splines, and for errors. `values` and `masks` are files for coefficients and masks, written by rows;
    without them they are held in memory. Raise InputError for cells too uneven in the sketch, and for voids
    everywhere.
    """
    shape = grid.shape
    sizes = _level_shapes(grid)
    counts = [kernel_counts(shape, level) for level in range(len(sizes))]
    side = COEFFICIENTS - KERNEL
    planes = CoefficientPlanes([(KERNEL * r + side, KERNEL * c + side) for r, c in counts], values)
    shared = _Masks(masks)
    levels = [
        _Level(n, size, count, shape, grid.base, planes, shared)
        for n, (size, count) in enumerate(zip(sizes, counts, strict=True))
    ]
    for _, rows in grid.strips(strip):
        for each in levels:
            rows = each.push(rows)  # those of the next level
        del rows  # before the next ones are read
    for each in levels:
        each.forget_rows()
    if not any(map(len, levels[0].place)):
        raise InputError(f"{grid.name}: has voids everywhere, expected blocks of 5 × 5 samples without")
    table = _table(grid, levels, _errors(grid, planes, counts, strip))
    del levels, each
    masked, place, law = shared.windows, grid.without_samples(), measure_detail(grid)
    part = GridPatches(grid.id, place, grid.base, table, planes, masked, (0.0, 0.0, 0.0, 0.0), law)
    west, south, east, north = box_around(np.array([box_around(each.kernel) for each, _ in part.finest()]))
    top, _ = find_tops(PatchNumbers([part]), np.arange(len(part)))
    box = float(west), float(south), float(east), float(north)
    return replace(part, table=table._replace(top=top), box=box)


def _level_shapes(grid: ElevationGrid) -> list[tuple[int, int]]:
    """Return the shapes of the levels whose patches have maps to metres, by those along the rim."""
    sizes = level_shapes(grid.shape)
    if grid.is_affine:
        return sizes
    step = step_of(grid)
    for level in range(len(sizes)):
        rows, columns = kernel_counts(grid.shape, level)
        at = np.concatenate([np.arange(columns), (rows - 1) * columns + np.arange(columns)])
        at = np.concatenate([at, columns * np.arange(rows), columns * np.arange(rows) + columns - 1])
        off = patch_maps(grid, np.full(len(at), level), *np.divmod(at, columns))[2]
        if level == 0:
            _check_maps(grid, off)
        elif step * 2.0**level > _MAX_STEP or not off <= _MAX_OFF:
            return sizes[:level]
    return sizes


def _check_maps(grid: ElevationGrid, off: float) -> None:
    if not off <= _MAX_OFF:
        raise InputError(f"{grid.name}: its cells are too uneven in the sketch's CRS, too near to a pole")


class _Masks:
    """Masks one after another."""

    def __init__(self, file: ArrayFile | None) -> None:
        self._file, self._parts, self.count = file, [np.zeros((0, COEFFICIENTS, COEFFICIENTS), np.uint8)], 0

    def add(self, masks: UInt8Array) -> Int64Array:
        """Append masks, and return their numbers."""
        first, self.count = self.count, self.count + len(masks)
        if self._file is None:
            self._parts.append(masks)
        elif len(masks):
            self._file[first : self.count] = masks
        return np.arange(first, self.count)

    @property
    def windows(self) -> Any:
        return np.concatenate(self._parts) if self._file is None else self._file


@dataclass
class _Level:
    """One level of a grid, of which rows come from the north; it keeps those that it still needs."""

    level: int
    shape: tuple[int, int]
    counts: tuple[int, int]  # of kernels
    grid_shape: tuple[int, int]
    base: float
    planes: CoefficientPlanes
    masks: _Masks
    place: list[Int32Array] = field(default_factory=list)
    mask: list[Int32Array] = field(default_factory=list)
    rectangles: list[Int32Array] = field(default_factory=list)  # of each patch, 0 of whole kernels
    boxes: list[Int64Array] = field(default_factory=lambda: [np.zeros((0, 4), np.int64)])

    def __post_init__(self) -> None:
        self._rows = np.zeros((0, self.shape[1] + 2 * PADDING), np.float32)  # with their padding
        self._first = self._received = self._done = self._halved = 0
        self._is_begun = False

    def push(self, samples: Float32Array) -> Float32Array:
        """Take the next rows, and return rows of the next level."""
        rows, columns = self.shape
        self._received += len(samples)
        parts = [self._rows, padded(samples, 1)] if len(samples) else [self._rows]
        self._rows = np.concatenate(parts)
        if not self._is_begun and len(self._rows) > PADDING:
            self._rows, self._is_begun = padded(self._rows, 0, after=False), True
            if self._received == rows:
                self._rows = padded(self._rows, 0, before=False)
        elif len(samples) and self._received == rows:
            self._rows = padded(self._rows, 0, before=False)
        if not self._is_begun:
            return np.zeros((0, columns // 2 + 1), np.float32)
        end, limit = self._first + len(self._rows), rows + 2 * PADDING
        while CHUNK[0] * self._done < self.planes.shapes[self.level][0]:
            if end < min(CHUNK[0] * (self._done + 1) + _BESIDE, limit):
                break
            self._write_chunks(self._done)
            self._done += 1
        last = min((end - PADDING) // 2, rows // 2 + 1)
        low = 2 * self._halved + PADDING - 1 - self._first
        found = np.zeros((0, columns // 2 + 1), np.float32)
        if last > self._halved:
            found = halved(self._rows[low : low + 2 * (last - self._halved) + 1], columns)
            self._halved = last
        kept = min(CHUNK[0] * self._done - _BESIDE, 2 * self._halved + PADDING - 1)
        kept = min(max(kept, self._first), end - PADDING - 1)
        self._rows, self._first = self._rows[kept - self._first :].copy(), kept
        return found

    def forget_rows(self) -> None:
        """Release the rows."""
        self._rows = self._rows[:0].copy()

    def _write_chunks(self, number: int) -> None:
        """Fit the splines of a row of chunks, and find the patches that begin there."""
        height, width = self.planes.shapes[self.level]
        values = np.empty((min(CHUNK[0], height - CHUNK[0] * number), width), np.float32)
        rows = _SplinePart(CHUNK[0] * number, len(values), self.shape[0])

        def fit(first: int, last: int) -> None:
            for left in range(_COLUMNS * first, min(_COLUMNS * last, width), _COLUMNS):
                columns = _SplinePart(left, min(_COLUMNS, width - left), self.shape[1])
                wide = self._rows[
                    rows.low - self._first : rows.high - self._first, columns.low : columns.high
                ]
                solved = spline_coefficients(wide, self.base, (rows.core, columns.core))
                values[:, left : left + _COLUMNS] = solved[np.ix_(rows.index, columns.index)]

        in_threads(fit, -(-width // _COLUMNS))
        self.planes.write(self.level, number, values)
        first = _KERNELS * number
        if first < self.counts[0]:
            self._find_patches(first, min(_KERNELS, self.counts[0] - first))

    def _known(self, first: int, last: int) -> BoolArray:
        """Return which samples of some rows are known."""
        start = PADDING - self._first
        return np.isfinite(self._rows[first + start : last + start, PADDING:-PADDING])

    def _find_patches(self, first: int, count: int) -> None:
        """Find the patches of some rows of kernels, their masks, and what their kernels consist of."""
        north, across = KERNEL * first, self.counts[1]
        known = self._known(north, min(north + KERNEL * count + 1, self.shape[0]))
        cut = _Kernels(known, (count, across), self.level, first, self.grid_shape)
        mask = self._mask(north - PADDING, KERNEL * count + COEFFICIENTS - KERNEL)
        lowest = np.stack([mask[KERNEL * n :][:COEFFICIENTS].min(axis=0) for n in range(count)])
        lowest = sliding_window_view(lowest, COEFFICIENTS, axis=1)[:, ::KERNEL].min(axis=-1)
        row, column = np.divmod(cut.which, across)
        numbers, masked = np.full(len(row), -1), lowest[row, column] < WHOLE
        windows = sliding_window_view(mask, (COEFFICIENTS, COEFFICIENTS))[::KERNEL, ::KERNEL]
        numbers[masked] = self.masks.add(windows[row[masked], column[masked]])
        self.place.append((cut.which + first * across).astype(np.int32))
        self.mask.append(numbers.astype(np.int32))
        self.rectangles.append(cut.rectangles.astype(np.int32))
        self.boxes.append(cut.boxes)

    def _mask(self, start: int, count: int) -> UInt8Array:
        """Return coefficients of the weight of data from a row of samples on: 0 at voids, `WHOLE` inside."""
        width = min(max(_FADE >> self.level, 1), (min(self.shape) + 1) // 2)  # the latter of a narrow grid
        at = np.arange(start, start + count), np.arange(self.planes.shapes[self.level][1]) - PADDING
        rim = [np.clip(np.minimum(i + 1, n - i), 0, width) for i, n in zip(at, self.shape, strict=True)]
        distance = np.minimum.outer(*(each.astype(np.uint8) for each in rim))
        low, high = max(start - _FADE - 1, 0), min(start + count + _FADE + 1, self.shape[0])
        known = self._known(low, high)
        if not known.all():
            inside = np.clip(ndimage.distance_transform_cdt(known, "chessboard") - 1, 0, width)
            top, columns = max(start, 0), min(self.shape[1], distance.shape[1] - PADDING)
            part = distance[top - start :, PADDING : PADDING + columns]
            inside = inside[top - low :][: len(part), :columns].astype(np.uint8)
            np.minimum(part[: len(inside)], inside, out=part[: len(inside)])
        weights: UInt8Array = ((np.arange(width + 1) * _FADE // width) ** 2).astype(np.uint8)[distance]
        return weights


class _SplinePart:
    """A part of a side of `size` coefficients, and what its spline is fitted to, of a level of n samples."""

    def __init__(self, start: int, size: int, n: int) -> None:
        # The last ones may lie beyond what is fitted, where no surface is evaluated: they are repeated.
        end = n + 2 * PADDING
        first, last = min(start, end - 1), min(start + size, end)
        settled = max(first - SETTLED, 0), min(last + SETTLED, end)
        self.low, self.high = max(settled[0] - FILLED, 0), min(settled[1] + FILLED, end)
        self.core = slice(settled[0] - self.low, settled[1] - self.low)
        self.index = np.clip(np.arange(start, start + size), first, last - 1) - settled[0]


class _Kernels:
    """Patches of some rows of kernels that have data: beside voids a kernel is blocks without one."""

    def __init__(
        self, known: BoolArray, counts: tuple[int, int], level: int, first: int, shape: tuple[int, int]
    ) -> None:
        self.which = np.arange(counts[0] * counts[1])
        self.rectangles, self.boxes = np.zeros(len(self.which), np.int64), np.zeros((0, 4), np.int64)
        if known.all():
            return
        every = np.ones([KERNEL * n + 1 for n in counts], bool)
        part = known[: every.shape[0], : every.shape[1]]
        every[: part.shape[0], : part.shape[1]] = part
        for _ in range(2):  # along rows, then along columns
            last = every[_BLOCK::_BLOCK]
            every = (every[:-1].reshape(len(last), _BLOCK, -1).all(axis=1) & last).T
        side = KERNEL // _BLOCK
        blocks = every.reshape(counts[0], side, counts[1], side).swapaxes(1, 2).reshape(-1, side, side)
        exists = np.asarray(blocks.all(axis=(1, 2)))
        boxes = [self.boxes]
        for patch in np.flatnonzero(~exists & blocks.any(axis=(1, 2))):
            row, column = divmod(int(patch), counts[1])
            corner = KERNEL * np.array([first + row, first + row, column, column])
            found = _BLOCK * np.array(_rectangles(blocks[patch])) + corner
            placed = kernel_boxes(found, level, shape)
            found = found[(placed[:, 1] > placed[:, 0]) & (placed[:, 3] > placed[:, 2])]
            self.rectangles[patch], exists[patch] = len(found), len(found) > 0
            boxes.append(found)
        self.boxes = np.concatenate(boxes)
        self.which, self.rectangles = self.which[exists], self.rectangles[exists]


def _table(grid: ElevationGrid, levels: list[_Level], errors: list[Float64Array]) -> PatchTable:
    """Return the table of all patches."""
    starts = np.cumsum([0, *(sum(map(len, each.place)) for each in levels)])
    place = np.concatenate([part for each in levels for part in each.place])
    reach, error = np.empty((len(place), 4), np.float32), np.empty(len(place), np.float32)
    for n, each in enumerate(levels):
        for first in range(starts[n], starts[n + 1], _PATCHES):
            part = slice(first, min(first + _PATCHES, starts[n + 1]))
            row, column = np.divmod(place[part], each.counts[1])
            centre, to_steps, off = patch_maps(grid, np.full(len(row), each.level), row, column)
            _check_maps(grid, off)
            reach[part] = patch_reach(centre, to_steps)
            most = errors[n][row, column]
            near = most.astype(np.float32)
            error[part] = np.where(near < most, np.nextafter(near, np.float32(np.inf)), near)
    rectangles = np.concatenate([part for each in levels for part in each.rectangles])
    cut = np.flatnonzero(rectangles)
    return PatchTable(
        starts=starts,
        place=place,
        error=error,
        mask=np.concatenate([part for each in levels for part in each.mask]),
        reach=reach,
        top=np.zeros(0),  # follows from the others
        cut=cut.astype(np.int32),
        cut_starts=np.cumsum([0, *rectangles[cut]]),
        boxes=np.concatenate([part for each in levels for part in each.boxes]).astype(np.int32),
    )


def _errors(
    grid: ElevationGrid, planes: CoefficientPlanes, counts: list[tuple[int, int]], strip: int | None
) -> list[Float64Array]:
    """Return the largest distance (m) of patches from samples, by level; 0 where they interpolate."""
    errors = [np.zeros(each) for each in counts]
    for start, rows_read in grid.strips(strip):
        samples = np.ascontiguousarray(rows_read, np.float32)

        def measure(first: int, last: int, start: int = start, samples: Float32Array = samples) -> None:
            for level in range(first + 1, last + 1):
                scale, end = 1 << level, start + len(samples) - 1
                low = start // scale + MARGIN
                spline = planes.rows(level, low, end // scale + MARGIN + 4)
                size = KERNEL + MARGIN
                rows = max((start // scale - size) // KERNEL, 0), (end // scale + MARGIN) // KERNEL + 1
                rows = rows[0], min(rows[1], counts[level][0])
                fixed = spline, low, samples, start, grid.base, *_weights(scale)
                host_function("measure_patches")(*fixed, *rows, errors[level])

        in_threads(measure, len(counts) - 1)
    return errors


def _weights(scale: int) -> Float64Array:
    """Return the weights (4, scale) of a cubic B-spline's coefficients at samples along a step."""
    t = np.arange(scale) / scale
    parts = [(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3]
    return np.stack(parts) / 6.0


def _rectangles(blocks: BoolArray) -> list[tuple[int, int, int, int]]:
    """Return rectangles (first and last row, first and last column) that tile the set blocks."""
    found: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    for row in range(len(blocks) + 1):  # all runs end after the last row
        here = np.pad(blocks[row].astype(np.int8), 1) if row < len(blocks) else np.zeros(2, np.int8)
        edges = np.flatnonzero(np.diff(here)).tolist()
        runs = list(zip(edges[::2], edges[1::2], strict=True))
        found += [(growing.pop(run), row, *run) for run in set(growing) - set(runs)]
        for run in runs:
            growing.setdefault(run, row)
    return found
