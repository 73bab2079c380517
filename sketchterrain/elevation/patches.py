"""Patches: square pieces of a DEM grid and of its mip levels, with their errors and kernels.

A patch spans 32 steps of its level, its kernel the inner 28; kernels of a level tile the grid (Rocca, Panozzo
& Puppo 2012, "Patchwork terrains", §3.1 and §4.1). All patches of a level read coefficients of one cubic
B-spline, so that they agree where they overlap, and those of level 0 interpolate the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from hashlib import blake2b
from typing import Any, Final, NamedTuple, Self

import numpy as np

from sketchterrain.array_types import (
    BoolArray,
    Bounds,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
    UInt8Array,
)
from sketchterrain.elevation.detail_law import DetailLaw
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.planes import ArrayFile, CoefficientPlanes

KERNEL: Final = 28
"""Steps along a kernel."""

MARGIN: Final = 2
"""Steps of a patch on each side of its kernel."""

COEFFICIENTS: Final = KERNEL + 2 * MARGIN + 3
"""Coefficients along a patch."""

WHOLE: Final = 225
"""Masks are in parts of it."""

_GROWTH = 0.15  # steps by which kernels reach further, as maps of neighbours differ by less
_GROUP = 1 << 16  # patches whose columns are computed at once
_RANKS = 8.0  # a factor of two in area: patches nearer in size are compared by error


@dataclass(frozen=True, eq=False)
class DemPatches:
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


class PatchTable(NamedTuple):
    """What the patches of a grid don't have in common, by level, row and column."""

    starts: Int64Array  # (levels + 1): number of each level's first patch
    place: Int32Array  # row and column of the kernel as one number
    error: Float32Array  # m: the largest distance from samples
    mask: Int32Array  # number of the mask, -1 where data are all around
    reach: Float32Array  # (n, 4), of `DemPatches`, rounded outward
    top: Float64Array  # m, of the grid alone
    cut: Int32Array  # patches whose kernel is not whole
    cut_starts: Int64Array  # number of the first rectangle of each, and the end
    boxes: Int32Array  # (rectangles, 4): first and last row and column, in steps of the level


@dataclass(frozen=True, eq=False)
class GridPatches:
    """The patches of one grid, by level, row and column: its place, a table, and coefficients."""

    id: bytes  # of the grid
    grid: ElevationGrid  # without samples
    base: float  # m: coefficients are relative to it
    table: PatchTable
    planes: CoefficientPlanes
    masks: UInt8Array | ArrayFile  # (n, 35, 35): B-spline coefficients of the weight of data, parts of WHOLE
    box: Bounds  # around all kernels, m
    law: DetailLaw  # of what the samples lost
    corner: tuple[float, float] = (0.0, 0.0)  # m, by which they were moved

    def digest_parts(self) -> bytes:
        """Return what its digest is of."""
        return self.id

    def __len__(self) -> int:
        return len(self.table.place)

    @property
    def accuracy(self) -> float:
        """Largest error (m) of the grid's samples."""
        return self.grid.accuracy

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of samples."""
        return self.grid.shape

    @property
    def levels(self) -> int:
        """Number of levels."""
        return len(self.table.starts) - 1

    @cached_property
    def step(self) -> float:
        """Distance (m) of samples, in the middle of the grid."""
        return step_of(self.grid)

    def moved(self, east: float, north: float) -> Self:
        """Return the patches in a sketch whose corner lies some metres further east and north."""
        if (east, north) == (0.0, 0.0):
            return self
        shift = np.array([east, north, east, north])
        digest = blake2b(self.id + shift.tobytes(), digest_size=16).digest()
        west, south, right, top = (float(each) for each in self.box - shift)
        return replace(
            self,
            id=digest,
            grid=self.grid.moved(east, north),
            table=self.table._replace(reach=outward(self.table.reach - shift)),
            box=(west, south, right, top),
            corner=(self.corner[0] + east, self.corner[1] + north),
        )

    def finest(self) -> Iterator[tuple[DemPatches, Float64Array]]:
        """Yield groups of the patches of level 0, and the corners of their rectangles."""
        for first in range(0, int(self.table.starts[1]), _GROUP):
            yield self.rows(np.arange(first, min(first + _GROUP, self.table.starts[1])))

    def rank(self, level: int) -> int:
        """Return the rank by area of a level's patches."""
        return int(np.round(2.0 * _RANKS * (np.log2(self.step) + level)))

    def rows(self, which: Int64Array) -> tuple[DemPatches, Float64Array]:
        """Return columns of patches, and the corners (n, 4, 2) of their rectangles, counter-clockwise."""
        table, shape = self.table, self.grid.shape
        level = np.searchsorted(table.starts, which, "right") - 1
        across = np.array([kernel_counts(shape, each)[1] for each in range(self.levels)])
        row, column = np.divmod(table.place[which].astype(np.int64), across[level])
        # Kernels are whole, but for those in the list.
        boxes = np.stack([row, row + 1, column, column + 1], axis=1) * KERNEL
        rectangles = np.ones(len(which), np.int64)
        at = np.searchsorted(table.cut, which)
        is_cut = table.cut[np.minimum(at, len(table.cut) - 1)] == which if len(table.cut) else at < 0
        at = at[is_cut]
        rectangles[is_cut] = table.cut_starts[at + 1] - table.cut_starts[at]
        first = np.cumsum(rectangles) - rectangles
        owner = np.repeat(np.arange(len(which)), rectangles)
        boxes = boxes[owner]
        parts = np.flatnonzero(is_cut[owner])
        nth = parts - first[owner[parts]]
        boxes[parts] = table.boxes[np.repeat(table.cut_starts[at], rectangles[is_cut]) + nth]
        corners = _outlines(self.grid, kernel_boxes(boxes, level[owner], shape))
        centre, to_steps, _ = patch_maps(self.grid, level, row, column)
        area = step_areas(to_steps)
        low, high = corners.min(axis=1), corners.max(axis=1)
        patches = DemPatches(
            level=level,
            row=row,
            column=column,
            centre=centre,
            to_steps=to_steps,
            step_area=area,
            error=self.accuracy + table.error[which].astype(np.float64),
            rank=np.array([self.rank(each) for each in range(self.levels)])[level],
            reach=table.reach[which].astype(np.float64),
            kernel=np.hstack([np.minimum.reduceat(low, first), np.maximum.reduceat(high, first)])
            if len(which)
            else np.zeros((0, 4)),
            growth=_GROWTH * np.sqrt(area),
            has_mask=table.mask[which] >= 0,
            rim=_rims(row, column, level, shape),
            rectangles=rectangles,
            finest=level == 0,
        )
        return patches, corners

    def copy_coefficients(self, which: Int64Array, target: Float32Array, slots: Int64Array) -> None:
        """Copy the coefficients (35, 35) of patches to slots."""
        shape = self.grid.shape
        level = (np.searchsorted(self.table.starts, which, "right") - 1).tolist()
        across = [kernel_counts(shape, each)[1] for each in range(self.levels)]
        place = self.table.place[which].tolist()
        # Ascending, so that neighbours follow each other.
        for n in np.argsort(which, kind="stable").tolist():
            row, column = divmod(place[n], across[level[n]])
            self.planes.copy_window(level[n], KERNEL * row, KERNEL * column, target[slots[n]])


def kernel_counts(shape: tuple[int, int], level: int) -> tuple[int, int]:
    """Return how many rows and columns of kernels a level has."""
    rows, columns = (max(-(-(n - 1) // (KERNEL << level)), 1) for n in shape)
    return rows, columns


def kernel_boxes(boxes: Int64Array, level: Any, shape: tuple[int, int]) -> Float64Array:
    """Return boxes, in steps of their levels, in samples of the grid."""
    limits = np.array([shape[0] - 1, shape[0] - 1, shape[1] - 1, shape[1] - 1])
    scaled = np.minimum(boxes << np.reshape(level, (-1, 1)), limits)
    # At the rim half a sample more: tiles side by side may end a sample apart.
    found: Float64Array = scaled + 0.5 * ((scaled == limits).astype(np.float64) - (scaled == 0))
    return found


def step_areas(to_steps: Float64Array) -> Float64Array:
    """Return the areas (m²) of steps at the centres of maps (n, 2, 6)."""
    a, b = to_steps[:, 0, 1:3], to_steps[:, 1, 1:3]
    return np.asarray(1.0 / np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]))


def step_of(grid: ElevationGrid) -> float:
    """Return the distance (m) of samples in the middle of a grid."""
    row, column = (np.array([n // (2 * KERNEL)]) for n in grid.shape)
    return float(np.sqrt(step_areas(patch_maps(grid, np.zeros(1, np.int64), row, column)[1])[0]))


def concatenated(tables: Sequence[DemPatches]) -> DemPatches:
    """Return patches one after another."""
    return DemPatches(*(np.concatenate([getattr(each, name) for each in tables]) for name in _COLUMNS))


def subset(patches: DemPatches, which: Any) -> DemPatches:
    """Return some patches."""
    return DemPatches(*(getattr(patches, name)[which] for name in _COLUMNS))


_COLUMNS = tuple(each.name for each in fields(DemPatches))


def _rims(row: Int64Array, column: Int64Array, level: Int64Array, shape: tuple[int, ...]) -> Float64Array:
    """Return the sides (n, 4) of the grid, in steps from the centres of patches: see `DemPatches.rim`."""
    ends = [(n - 1) / 2.0**level for n in shape]
    middle = [KERNEL * each + KERNEL / 2 for each in (row, column)]
    return np.stack([-middle[1], ends[1] - middle[1], -middle[0], ends[0] - middle[0]], axis=1)


def _outlines(grid: ElevationGrid, boxes: Float64Array) -> Float64Array:
    """Return the corners (n, 4, 2), m, of boxes in a grid, counter-clockwise."""
    row, column = boxes[:, [0, 0, 1, 1]], boxes[:, [2, 3, 3, 2]]
    outline = np.stack(grid.to_metres(column, row), axis=-1)
    across = outline[:, 2] - outline[:, 0], outline[:, 3] - outline[:, 1]
    clockwise = across[0][:, 0] * across[1][:, 1] < across[0][:, 1] * across[1][:, 0]
    outline[clockwise] = outline[clockwise, ::-1]
    return outline


def patch_maps(
    grid: ElevationGrid, level: Int64Array, row: Int64Array, column: Int64Array
) -> tuple[Float64Array, Float64Array, float]:
    """Return the centres (n, 2) of patches, their maps (n, 2, 6) from metres to steps, and the largest error.

    A grid in another CRS is not resampled: each patch has a quadratic map, fitted to nine points, where it
    may be off by some steps.
    """
    half, scale = KERNEL // 2, 2.0**level
    if grid.is_affine:
        at = [half * (2.0 * each + 1.0) * scale for each in (column, row)]
        centre = np.stack(grid.to_metres(*at), axis=-1)
        a, b, _, d, e, _ = grid.place
        to_steps = np.zeros((len(centre), 2, 6))
        to_steps[:, :, 1:3] = np.linalg.inv(np.array([[a, b], [d, e]])) / scale[:, None, None]
        return centre, to_steps, 0.0
    down, right = (each.ravel() for each in np.mgrid[0:3, 0:3])
    at = [
        half * (2.0 * each[:, None] + offset) * scale[:, None]
        for each, offset in ((column, right), (row, down))
    ]
    nine = np.stack(grid.to_metres(*at), axis=-1)
    centre = nine[:, 4].copy()
    offset = nine - centre[:, None]
    size = np.abs(offset).max(axis=(1, 2))
    x, y = np.moveaxis(offset / size[:, None, None], 2, 0)
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1)
    steps = half * np.stack([right - 1.0, down - 1.0], axis=-1)
    transposed = terms.transpose(0, 2, 1)
    fitted = np.linalg.solve(transposed @ terms, transposed @ np.broadcast_to(steps, nine.shape))
    off = float(np.abs(terms @ fitted - steps).max(initial=0.0))
    powers = size[:, None] ** np.array([0, 1, 1, 2, 2, 2])
    return centre, fitted.transpose(0, 2, 1) / powers[:, None], off


def patch_reach(centre: Float64Array, to_steps: Float64Array) -> Float32Array:
    """Return boxes (n, 4) around patches, m."""
    a, b = to_steps[:, 0, 1:3], to_steps[:, 1, 1:3]
    half = (KERNEL // 2 + MARGIN) * 1.01  # maps are slightly curved
    determinant = np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])
    wide = half * (np.abs(a[:, 1]) + np.abs(b[:, 1])) / determinant
    deep = half * (np.abs(a[:, 0]) + np.abs(b[:, 0])) / determinant
    size = np.stack([wide, deep], axis=1)
    return outward(np.hstack([centre - size, centre + size]))


def outward(boxes: Float64Array) -> Float32Array:
    """Return boxes (n, 4) rounded outward."""
    return np.nextafter(boxes.astype(np.float32), np.array([-np.inf, -np.inf, np.inf, np.inf], np.float32))
