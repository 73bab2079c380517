"""Tops of patches: the errors from which greater patches cover them (Rocca et al. 2012, §3.3)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from sketchterrain.elevation.mips import in_threads
from sketchterrain.elevation.patches import DemPatches, GridPatches, concatenated, subset
from sketchterrain.elevation.surface import BoxClasses
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
