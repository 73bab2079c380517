"""Tops of patches: the errors from which greater patches cover them (Rocca et al. 2012, §3.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from sketchterrain.elevation.mips import in_threads
from sketchterrain.elevation.patches import GridPatches, Patches, concatenated, subset
from sketchterrain.elevation.surface import BoxIndex

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

    def rows(self, which: Int64Array) -> tuple[Patches, Float64Array]:
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


def _tops_among(patches: Patches, grid: Int32Array, corners: Float64Array, which: Int64Array) -> Tops:
    """Return the tops of some patches among those given."""
    grown = patches.kernel + patches.growth[:, None] * np.array([-1.0, -1.0, 1.0, 1.0])
    kernels, index = kernels_of(patches, corners), BoxIndex.from_boxes(grown)
    order = patches.rank, patches.error, patches.finest, grid
    tops = Tops(np.empty(len(which)), np.empty(len(which), bool))
    in_threads(
        lambda start, end: _compute_tops(which, order, kernels, index, tops, start, end), len(which), 256
    )
    return tops


class Kernels(NamedTuple):
    """Kernels of patches for compiled functions."""

    boxes: Float64Array  # (n, 4)
    growth: Float64Array
    first: Int64Array  # (n + 1): number of the first rectangle
    corners: Float64Array


def kernels_of(patches: Patches, corners: Float64Array) -> Kernels:
    """Return the kernels of patches, and the corners of their rectangles."""
    first = np.concatenate([[0], np.cumsum(patches.rectangles)])
    return Kernels(patches.kernel, patches.growth, first, corners)


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
def edges_of(corners, grow):  # type: ignore[no-untyped-def]
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
    lines = edges_of(corners, grow)
    sliver = 1e-6 * grow
    rest = np.empty((_MAX_CORNERS, 2))
    for k in range(left):
        size, apart = sizes[side, k], False
        for i in range(4):
            apart = True
            for j in range(size):
                if distance_to(lines[i], pieces[side, k, j]) < -sliver:
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
                d, e = distance_to(lines[i], here), distance_to(lines[i], there)
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
def distance_to(line, point):  # type: ignore[no-untyped-def]
    """Return the distance (m) outward from an edge."""
    return line[0] * point[0] + line[1] * point[1] + line[2]
