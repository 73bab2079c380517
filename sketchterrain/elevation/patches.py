"""Patches: square pieces of a DEM grid and of its mip levels, with their errors and kernels.

A patch spans 32 steps of its level, its kernel the inner 28; kernels of a level tile the grid (Rocca, Panozzo
& Puppo 2012, "Patchwork terrains", §3.1 and §4.1). All patches of a level read coefficients of one cubic
B-spline, so that they agree where they overlap, and those of level 0 interpolate the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, Final, NamedTuple

import numpy as np
from numba import njit
from scipy import ndimage

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, Int64Array, UInt8Array
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.mips import (
    in_threads,
    mip_levels,
    spline_coefficients,
    valid_levels,
    without_voids,
)
from sketchterrain.errors import InputError

KERNEL: Final = 28
"""Steps along a kernel."""

MARGIN: Final = 2
"""Steps of a patch on each side of its kernel."""

COEFFICIENTS: Final = KERNEL + 2 * MARGIN + 3
"""Coefficients along a patch."""

WHOLE: Final = 225
"""Masks are in parts of it."""

_FADE = 15  # samples along which the weight of a grid rises from its rim and from voids
_MAX_STEP = 8000.0  # m: a quadratic map of a patch of 256 km is off by 0.01 steps, and 8 times for twice that
_BLOCK = 4  # steps along the blocks of which kernels beside voids consist
_BEFORE = MARGIN + 1
_GROWTH = 0.15  # steps by which kernels reach further, as maps of neighbours differ by less
_RANKS = 8.0  # a factor of two in area: patches nearer in size are compared by error


@dataclass(frozen=True, eq=False)
class Patches:
    """Columns of n patches; lengths in sketch metres."""

    level: Int64Array
    row: Int64Array  # of the kernel, in kernels of its level
    column: Int64Array
    centre: Float64Array  # (n, 2)
    to_steps: Float64Array  # (n, 2, 6): steps from the centre, of 1, x, y, x², xy, y² from it
    step_area: Float64Array  # m²
    error: Float64Array  # m: accuracy, and the largest distance from samples
    rank: Int64Array  # by area
    reach: Float64Array  # (n, 4): west, south, east, north
    kernel: Float64Array  # (n, 4)
    growth: Float64Array  # of the kernel where it is compared with others
    has_mask: BoolArray
    rim: Float64Array  # (n, 4): west, east, north and south side of the grid, in steps from the centre
    rectangles: Int64Array  # number of those that the kernel consists of
    finest: BoolArray  # of level 0

    def __len__(self) -> int:
        return len(self.level)


class GridPatches(NamedTuple):
    """The patches of one grid, by level, row and column."""

    id: bytes  # of the grid
    accuracy: float
    step: float  # m, of level 0
    base: float  # m: coefficients are relative to it
    coefficients: tuple[Float32Array, ...]  # by level
    masks: tuple[UInt8Array, ...]  # B-spline coefficients of the weight of data, in parts of WHOLE
    patches: Patches
    corners: Float64Array  # (rectangles, 4, 2), counter-clockwise


def concatenated(tables: Sequence[Patches]) -> Patches:
    """Return patches one after another."""
    return Patches(*(np.concatenate([getattr(each, name) for each in tables]) for name in _COLUMNS))


def subset(patches: Patches, which: Any) -> Patches:
    """Return some patches."""
    return Patches(*(getattr(patches, name)[which] for name in _COLUMNS))


_COLUMNS = tuple(each.name for each in fields(Patches))


def build_patches(grid: ElevationGrid) -> GridPatches:
    """Return the patches of a grid, at every mip level."""
    samples, valid = grid.samples, np.isfinite(grid.samples)
    levels = mip_levels(without_voids(samples))
    base = float(np.round(np.nanmean(samples, dtype=np.float64)))
    coefficients, masks, tables, corners = [], [], [], []
    step = 0.0
    for level, (heights, known) in enumerate(
        zip(levels, valid_levels(valid, [each.shape for each in levels]), strict=True)
    ):
        if step * (1 << level) > _MAX_STEP and not grid.is_affine:
            break
        counts = [max(-(-(n - 1) // (KERNEL << level)), 1) for n in samples.shape]
        shape = (KERNEL * counts[0] + 2 * _BEFORE + 1, KERNEL * counts[1] + 2 * _BEFORE + 1)
        spline = spline_coefficients(heights, base, _BEFORE, shape)
        mask = _mask(known, level, shape)
        error, least = _facts(spline, mask, samples, base, level, (counts[0], counts[1]))
        boxes, owners = _kernel_boxes(known, level, (counts[0], counts[1]), samples.shape)
        centre, to_steps = _maps(grid, level, (counts[0], counts[1]))
        which, rectangles = np.unique(owners, return_counts=True)
        if not level and not len(which):
            raise InputError(f"{grid.name}: too full of voids, no 5 × 5 samples are whole")
        row, column = np.divmod(which, counts[1])
        a, b = to_steps[which, 0, 1:3], to_steps[which, 1, 1:3]
        area = 1.0 / np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
        if level == 0:
            step = float(np.sqrt(np.median(area)))
        outline = _outlines(grid, boxes)
        first = np.cumsum(rectangles) - rectangles
        low, high = outline.min(axis=1), outline.max(axis=1)
        count = len(which)
        tables.append(
            Patches(
                level=np.full(count, level),
                row=row,
                column=column,
                centre=centre[which],
                to_steps=to_steps[which],
                step_area=area,
                error=grid.accuracy + error.ravel()[which],
                rank=np.full(count, int(np.round(2.0 * _RANKS * (np.log2(step) + level)))),
                reach=_reach(centre[which], a, b),
                kernel=np.hstack([np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)]),
                growth=_GROWTH * np.sqrt(area),
                has_mask=least.ravel()[which] < WHOLE,
                rim=_rims(row, column, level, samples.shape),
                rectangles=rectangles,
                finest=np.full(count, level == 0),
            )
        )
        coefficients.append(spline)
        masks.append(mask)
        corners.append(outline)
    return GridPatches(
        grid.id,
        grid.accuracy,
        step,
        base,
        tuple(coefficients),
        tuple(masks),
        concatenated(tables),
        np.concatenate(corners),
    )


def _rims(row: Int64Array, column: Int64Array, level: int, shape: tuple[int, ...]) -> Float64Array:
    """Return the sides (n, 4) of the grid, in steps from the centres of patches: see `Patches.rim`."""
    ends = [(n - 1) / (1 << level) for n in shape]
    middle = [KERNEL * each + KERNEL / 2 for each in (row, column)]
    return np.stack([-middle[1], ends[1] - middle[1], -middle[0], ends[0] - middle[0]], axis=1)


def _mask(known: BoolArray, level: int, shape: tuple[int, int]) -> UInt8Array:
    """Return coefficients of the weight of a level's data: 0 at voids, 1 at its rim, `WHOLE` inside."""
    width = min(max(_FADE >> level, 1), (min(known.shape) + 1) // 2)  # the latter of a narrow grid
    rim = [np.minimum(np.minimum(np.arange(n) + 1, n - np.arange(n)), width) for n in known.shape]
    distance = np.minimum.outer(*(each.astype(np.uint8) for each in rim))
    if not known.all():
        inside = ndimage.distance_transform_cdt(known, "chessboard") - 1
        distance = np.minimum(distance, np.clip(inside, 0, width).astype(np.uint8))
    part = ((np.arange(width + 1) * _FADE // width) ** 2).astype(np.uint8)[distance]
    part = part[: shape[0] - _BEFORE, : shape[1] - _BEFORE]
    return np.pad(part, [(_BEFORE, n - _BEFORE - m) for n, m in zip(shape, part.shape, strict=True)])


def _facts(
    spline: Float32Array,
    mask: UInt8Array,
    samples: Float32Array,
    base: float,
    level: int,
    counts: tuple[int, int],
) -> tuple[Float64Array, UInt8Array]:
    """Return the largest distance (m) of each patch from the samples of the grid, and its lowest mask."""
    error, least = np.zeros(counts), np.full(counts, WHOLE, np.uint8)
    t = np.arange(1 << level) / (1 << level)
    weights = (
        np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, -3 * t**3 + 3 * t**2 + 3 * t + 1, t**3], axis=1)
        / 6.0
    )
    in_threads(
        lambda first, last: _measure(spline, mask, samples, base, weights, first, last, error, least),
        counts[0],
    )
    return error, least


@njit(cache=True, nogil=True)
def _measure(spline, mask, samples, base, weights, first, last, error, least):  # type: ignore[no-untyped-def]
    """Measure patches of rows first … last - 1 against the samples, and their lowest mask."""
    scale = len(weights)
    size = KERNEL + 2 * MARGIN
    rows, columns = samples.shape
    line = np.empty(COEFFICIENTS)
    for a in range(first, last):
        for b in range(error.shape[1]):
            lowest = np.uint8(WHOLE)
            for i in range(KERNEL * a, KERNEL * a + COEFFICIENTS):
                for j in range(KERNEL * b, KERNEL * b + COEFFICIENTS):
                    lowest = min(lowest, mask[i, j])
            least[a, b] = lowest
            if scale == 1:
                continue  # interpolates
            most = 0.0
            north, west = (KERNEL * a - MARGIN) * scale, (KERNEL * b - MARGIN) * scale
            for r in range(max(north, 0), min(north + size * scale, rows)):
                k, p = (r - north) // scale, (r - north) % scale
                w0, w1, w2, w3 = weights[p, 0], weights[p, 1], weights[p, 2], weights[p, 3]
                i = KERNEL * a + k
                for j in range(COEFFICIENTS):
                    c = KERNEL * b + j
                    line[j] = (
                        w0 * spline[i, c]
                        + w1 * spline[i + 1, c]
                        + w2 * spline[i + 2, c]
                        + w3 * spline[i + 3, c]
                    )
                for k in range(size):
                    start = west + k * scale
                    for q in range(max(-start, 0), min(scale, columns - start)):
                        value = (
                            weights[q, 0] * line[k]
                            + weights[q, 1] * line[k + 1]
                            + weights[q, 2] * line[k + 2]
                            + weights[q, 3] * line[k + 3]
                        )
                        most = max(
                            most, abs(value + base - samples[r, start + q])
                        )  # NaN, of a void, is not more
            error[a, b] = most


def _kernel_boxes(
    known: BoolArray, level: int, counts: tuple[int, int], shape: tuple[int, ...]
) -> tuple[Float64Array, Int64Array]:
    """Return boxes (first and last row and column, in samples of the grid) of the kernels, and their patches.

    A kernel beside voids consists of the blocks of 4 × 4 steps without a void.
    """
    row, column = (each.ravel() for each in np.indices(counts))
    boxes = np.stack([row, row + 1, column, column + 1], axis=1) * KERNEL
    owners = np.arange(len(boxes))
    if not known.all():
        every = np.ones([KERNEL * n + 1 for n in counts], bool)
        part = known[: every.shape[0], : every.shape[1]]
        every[: part.shape[0], : part.shape[1]] = part
        for _ in range(2):  # along rows, then along columns
            last = every[_BLOCK::_BLOCK]
            every = (every[:-1].reshape(len(last), _BLOCK, -1).all(axis=1) & last).T
        side = KERNEL // _BLOCK
        blocks = every.reshape(counts[0], side, counts[1], side).swapaxes(1, 2).reshape(-1, side, side)
        whole = blocks.all(axis=(1, 2))
        parts, owned = [boxes[whole]], [owners[whole]]
        for patch in np.flatnonzero(~whole & blocks.any(axis=(1, 2))):
            found = _BLOCK * np.array(_rectangles(blocks[patch]))
            parts.append(found + boxes[patch][[0, 0, 2, 2]])
            owned.append(np.full(len(found), patch))
        boxes, owners = np.concatenate(parts), np.concatenate(owned)
        order = np.argsort(owners, kind="stable")
        boxes, owners = boxes[order], owners[order]
    limits = np.array([shape[0] - 1, shape[0] - 1, shape[1] - 1, shape[1] - 1])
    boxes = np.minimum(boxes << level, limits)
    # At the rim half a sample more: tiles side by side may end a sample apart.
    boxes = boxes + 0.5 * ((boxes == limits).astype(np.float64) - (boxes == 0))
    full = (boxes[:, 1] > boxes[:, 0]) & (boxes[:, 3] > boxes[:, 2])
    return boxes[full], owners[full]


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


def _outlines(grid: ElevationGrid, boxes: Float64Array) -> Float64Array:
    """Return the corners (n, 4, 2), m, of boxes in a grid, counter-clockwise."""
    row, column = boxes[:, [0, 0, 1, 1]], boxes[:, [2, 3, 3, 2]]
    outline = np.stack(grid.to_metres(column, row), axis=-1)
    across = outline[:, 2] - outline[:, 0], outline[:, 3] - outline[:, 1]
    clockwise = across[0][:, 0] * across[1][:, 1] < across[0][:, 1] * across[1][:, 0]
    outline[clockwise] = outline[clockwise, ::-1]
    return outline


def _maps(grid: ElevationGrid, level: int, counts: tuple[int, int]) -> tuple[Float64Array, Float64Array]:
    """Return the centres (n, 2) of patches, and their maps (n, 2, 6) from metres to steps.

    A grid in another CRS is not resampled: each patch has a quadratic map, fitted to nine points.
    """
    half = KERNEL // 2
    nodes = [half * np.arange(2 * n + 1.0) * (1 << level) for n in counts]
    row, column = np.meshgrid(*nodes, indexing="ij")
    if grid.is_affine:
        row, column = row[1::2, 1::2], column[1::2, 1::2]
        centre = np.stack(grid.to_metres(column, row), axis=-1).reshape(-1, 2)
        a, b, _, d, e, _ = grid.place
        to_steps = np.zeros((len(centre), 2, 6))
        to_steps[:, :, 1:3] = np.linalg.inv(np.array([[a, b], [d, e]])) / (1 << level)
        return centre, to_steps
    at = np.stack(grid.to_metres(column, row), axis=-1)
    nine = np.stack(
        [
            at[i : i + 2 * n - 1 : 2, j : j + 2 * m - 1 : 2]
            for (n, m) in [counts]
            for i in range(3)
            for j in range(3)
        ],
        axis=2,
    ).reshape(-1, 9, 2)
    centre = nine[:, 4].copy()
    offset = nine - centre[:, None]
    size = np.abs(offset).max(axis=(1, 2))
    x, y = np.moveaxis(offset / size[:, None, None], 2, 0)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    steps = half * np.array([(j, i) for i in (-1.0, 0.0, 1.0) for j in (-1.0, 0.0, 1.0)])
    transposed = terms.transpose(0, 2, 1)
    fitted = np.linalg.solve(transposed @ terms, transposed @ np.broadcast_to(steps, nine.shape))
    powers = size[:, None] ** np.array([0, 1, 1, 2, 2, 2])
    return centre, fitted.transpose(0, 2, 1) / powers[:, None]


def _reach(centre: Float64Array, a: Float64Array, b: Float64Array) -> Float64Array:
    """Return the boxes of patches whose steps have the gradients a and b (n, 2)."""
    half = (KERNEL // 2 + MARGIN) * 1.01  # maps are slightly curved
    determinant = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    wide = half * (np.abs(a[:, 1]) + np.abs(b[:, 1])) / determinant
    deep = half * (np.abs(a[:, 0]) + np.abs(b[:, 0])) / determinant
    size = np.stack([wide, deep], axis=1)
    return np.hstack([centre - size, centre + size])
