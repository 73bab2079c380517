"""Poisson-disk points of the whole world whose spacing varies with position; see docs/kernels/poisson.md."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float32Array, LatticeArray, StructuredArray
from sketchterrain.errors import InputError
from sketchterrain.vegetation.poisson_grids import (
    GROUP,
    MAX_POINTS,
    ROUNDING,
    SIDE,
    Area,
    Cells,
    Grid,
    bands,
    count_points,
    hash_salt,
    rounded_up,
    schedule,
    throw_kernel,
)

if TYPE_CHECKING:
    from sketchterrain.compute.buffers import BufferSet
    from sketchterrain.compute.context import ComputeContext

_Result = TypeVar("_Result")

_POOLED: Final = 4  # quads of the raster along the squares whose ranges are stored

GRADED: Final = np.dtype([("x", "i8"), ("y", "i8"), ("spacing", "f4"), ("level", "u1")])
"""A point: lattice position, minimum distance (lattice units), level."""

_FILE = "graded_poisson.cl"
_STREAM = "graded poisson disk"
_REACH = 3  # cells of a conflict, as in the kernels
_LISTED = 24  # as in the kernels
_COARSE_TRIALS = 8  # darts a cell, in all grids but the finest
_FINE_TRIALS = 16
_BLOCK = (8, 32)  # rows and columns of cells, as in the kernels
_SLACK = 1.0001  # of distances, in the test of which blocks a grid is active in
_KINDS: Final = {
    "x": np.int16,
    "y": np.int16,
    "half": np.float32,
    "times": np.float32,
    "candidate x": np.int16,
    "candidate y": np.int16,
    "candidate half": np.float32,
    "candidate times": np.float32,
    "time": np.uint32,
}
_WINDOW = 768  # cells: lists need 96 bytes for each
_MAX_GRIDS = 16


def run_to_completion(steps: Generator[None, None, _Result]) -> _Result:
    """Run all steps and return the generator's result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: _Result = end.value
            return result


class SpacingRaster(NamedTuple):
    """Distance between points, bilinear between the vertices of a raster of the world."""

    west: int  # of the first vertex, lattice units; multiples of ``step``
    south: int
    step: int  # lattice units between vertices, a power of two
    # (rows, columns), lattice units, row 0 southernmost; over the greatest distance if there are no points.
    spacing: Float32Array


class SpacingRanges(NamedTuple):
    """Range of the distance in squares of a raster, ``_POOLED`` of its steps wide."""

    west: int  # of the first square, lattice units
    south: int
    side: int  # of a square, lattice units
    low: Float32Array  # (rows, columns), row 0 southernmost; bounds of the interpolated values
    high: Float32Array

    @classmethod
    def from_raster(cls, raster: SpacingRaster) -> SpacingRanges:
        """Return the ranges of a raster."""
        low, high = (_pooled(best, raster.spacing) for best in (np.minimum, np.maximum))
        return cls(raster.west, raster.south, raster.step * _POOLED, low, high)

    def over(self, start: list[LatticeArray], sides: list[int]) -> tuple[Float32Array, Float32Array]:
        """Return the ranges (n, m) over rectangles of one size, from first rows (n,) and columns (m,)."""
        spans = []
        for origin, from_, side, many in zip(
            (self.south, self.west), start, sides, self.low.shape, strict=True
        ):
            first = ((from_ - origin) // self.side).clip(0, many - 1)
            last = ((from_ + side - 1 - origin) // self.side + 1).clip(first + 1, many)
            spans.append(np.stack([first, last], axis=-1).ravel())
        return _reduced(np.minimum, self.low, spans), _reduced(np.maximum, self.high, spans)


def _pooled(best: np.ufunc, values: Float32Array) -> Float32Array:
    """Reduce squares of a raster's quads to one value each."""
    for axis in (0, 1):
        squares = -(-(values.shape[axis] - 1) // _POOLED)
        missing = squares * _POOLED + 1 - values.shape[axis]
        values = np.concatenate([values, *[values.take([-1], axis)] * missing], axis).swapaxes(0, axis)
        parts = [values[k : len(values) - _POOLED + k : _POOLED] for k in range(_POOLED)]
        result = values[_POOLED::_POOLED].copy()
        for part in parts:
            best(result, part, out=result)
        values = result.swapaxes(0, axis)
    return values


def _reduced(best: np.ufunc, values: Float32Array, spans: list[LatticeArray]) -> Float32Array:
    """Reduce the values in spans of rows and of columns, given as alternating starts and ends."""
    for axis, span in enumerate(spans):
        values = np.concatenate([values, values.take([-1], axis)], axis)  # a span may end after the last
        values = best.reduceat(values, span, axis).take(range(0, len(span), 2), axis)
    return values


@dataclass(frozen=True)
class _GradedGrid(Grid):
    """A grid whose points have half a distance and 2^level."""

    points: tuple[Any, ...]  # buffers: x, y, half the distance, 2^level
    candidate: tuple[Any, ...]  # the same, and the time
    lists: tuple[Any, ...]  # of points of coarser grids, and the window they cover
    finer: tuple[Any, ...]  # lists for the next finer grid: points, counts

    @property
    def size(self) -> tuple[np.int32, np.int32]:
        """Columns and rows, as kernel arguments."""
        return np.int32(self.cells.width), np.int32(self.cells.height)


class GradedPoisson:
    """The world's Poisson-disk set of a minimum distance that varies over it.

    Any device gives the same points.

    Two points p, q are no nearer than 2^min(level_p, level_q) · (spacing_p + spacing_q) / 2. ``raster_of``
    returns the distance over a rectangle (west, south, east, north, lattice units), with vertices around all
    of it; its values must not depend on the rectangle. Distances are ``least`` … ``most`` lattice units, and
    there are no points where it is more. ``levels`` coarser subsets are nested in it, fewer where points are
    far apart.
    """

    def __init__(
        self,
        context: ComputeContext,
        raster_of: Callable[[int, int, int, int], SpacingRaster],
        *,
        least: int,
        most: int,
        levels: int,
        seed: int,
    ) -> None:
        if not 2 <= least <= most < math.inf:
            raise InputError(f"expected 2 ≤ least ≤ most < ∞ lattice units, got {least} … {most}")
        self._side = math.floor((least + ROUNDING) / math.sqrt(2.0))
        doubled = math.log2(_SLACK * (most + ROUNDING) / (math.sqrt(2.0) * self._side))
        grids = max(math.floor(doubled), levels) + 1
        if not (levels >= 0 and grids <= _MAX_GRIDS):
            raise InputError(f"expected distances and levels that double at most {_MAX_GRIDS - 1} times")
        self._context = context
        self._raster_of = raster_of
        self._most, self._levels = most, levels
        self._salts = [hash_salt(seed, _STREAM, grid) for grid in range(grids)]
        self._rounds = [schedule(_COARSE_TRIALS if grid else _FINE_TRIALS) for grid in range(grids)]
        from sketchterrain.compute.buffers import BufferPool

        self._scratch = BufferPool(context)

    @property
    def halo(self) -> int:
        """Greatest distance beyond a rectangle at which the raster is read, lattice units."""
        rim = self._rim(0)
        for number in range(1, len(self._salts)):
            rim = -(-rim // 2) + 1 + _REACH + self._rim(number)
        return (rim + 1) * self._side << (len(self._salts) - 1)

    def within(self, area: Area) -> StructuredArray:
        """Return the points (n,) of GRADED of a rectangle, lattice units, by y, then x.

        East and north are excluded.

        A point in two rectangles is the same in both. InputError is raised for more than forty million.
        """
        return run_to_completion(self.steps(area))

    def steps(self, area: Area) -> Generator[None, None, StructuredArray]:
        """Do the same in steps between which the device computes; the generator returns the points."""
        collected = [np.zeros(0, GRADED)]
        for band in bands(area, self._side, window=_WINDOW):
            for part in band:
                with self._scratch.borrow() as buffers:
                    collected += yield from self._window_steps(buffers, part)
                if sum(map(len, collected)) > MAX_POINTS:
                    raise InputError(f"expected at most {MAX_POINTS} points in the rectangle, got more")
        points = np.concatenate(collected)
        return points[np.lexsort((points["x"], points["y"]))]

    def _window_steps(self, buffers: BufferSet, area: Area) -> Generator[None, None, list[StructuredArray]]:
        """Sample the grids over an area, the coarsest first, and collect the points of each."""
        windows = [Cells.covering(area, self._side).wider(self._rim(0))]
        for number in range(1, len(self._salts)):
            windows.append(windows[-1].coarser().wider(_REACH + self._rim(number)))
        coarsest = self._side << len(windows) - 1
        raster = self._raster_of(*(each * coarsest for each in windows[-1]))
        if raster.step & (raster.step - 1):
            raise InputError(f"expected a raster's step that is a power of two, got {raster.step}")
        raster_arguments, ranges = self._upload(raster), SpacingRanges.from_raster(raster)
        yield
        # The coarsest grid has no lists: any buffer, and a width of 0.
        lists = (*raster_arguments[:1] * 2, np.int32(0), np.int32(0), np.int64(0), np.int64(0))
        collected = []
        for number in reversed(range(len(windows))):
            grid = self._create_grid(buffers, windows[number], number, lists)
            blocks = self._blocks(ranges, grid, number)
            if len(blocks):
                self._enqueue_rounds(grid, number, raster_arguments, blocks)
                yield
                collected.append(self._collect(buffers, grid, area, raster_arguments))
            if number:
                lists = self._list_for_finer(grid, self._blocks(ranges, grid, number - 1, finer=True))
        return collected

    def _rim(self, grid: int) -> int:
        return 2 * _REACH * len(self._rounds[grid])

    def _upload(self, raster: SpacingRaster) -> tuple[Any, ...]:
        """Return the distances over an area, as kernel arguments."""
        corner = (np.int64(raster.west), np.int64(raster.south))
        shape = (np.int32(raster.spacing.shape[1]), np.int32(raster.step.bit_length() - 1))
        spacing = self._context.upload(np.asarray(raster.spacing, np.float32))
        return spacing, *shape, *corner, np.float32(self._most)

    def _blocks(
        self, ranges: SpacingRanges, grid: Grid, number: int, *, finer: bool = False
    ) -> npt.NDArray[np.int32]:
        """Return the first cells (n, 2) of blocks where a grid (`finer`: or a finer one) is active."""
        first = [np.arange(0, many, size) for many, size in zip(grid.cells.shape, _BLOCK, strict=True)]
        start = [
            (at + cell) * grid.side
            for at, cell in zip(first, (grid.cells.south, grid.cells.west), strict=True)
        ]
        low, high = ranges.over(start, [size * grid.side for size in _BLOCK])
        # Interpolated values lie between those of the vertices; rounding is far below the slack.
        diagonal = math.sqrt(2.0) * (self._side << number)
        active = (low + ROUNDING < 2.0 * _SLACK * diagonal) & (low <= self._most)
        if not finer:
            active &= (high + ROUNDING) * _SLACK * 2**self._levels > diagonal
        row, column = np.nonzero(active)
        return np.stack([first[1][column], first[0][row]], axis=-1).astype(np.int32)

    def _create_grid(
        self, buffers: BufferSet, cells: Cells, number: int, lists: tuple[Any, ...]
    ) -> _GradedGrid:
        own = [buffers.buffer(name, cells.shape, kind) for name, kind in _KINDS.items()]
        # Two sets of lists are enough: each is computed from the previous one.
        near = buffers.buffer(f"near {number % 2}", (*cells.shape, _LISTED, 4) if number else 1, np.float32)
        listed = buffers.buffer(f"listed {number % 2}", cells.shape, np.uint8)
        grid = _GradedGrid(
            cells,
            self._side << number,
            self._rim(number),
            own[0],
            own[1],
            points=tuple(own[:4]),
            candidate=tuple(own[4:]),
            lists=lists,
            finer=(near, listed),
        )
        size = (rounded_up(cells.width), cells.height)
        self._launch("clear", size, own[0], *own[2:5], *own[6:8], listed, grid.width)
        return grid

    def _list_for_finer(self, grid: _GradedGrid, blocks: npt.NDArray[np.int32]) -> tuple[Any, ...]:
        """Enqueue the lists of the points of a grid and of coarser ones, for the next finer one."""
        if len(blocks):
            given = (np.int32(_REACH), *grid.points, *grid.lists, *grid.finer, *grid.corner)
            self._launch(
                "list_for_finer", _work_size(blocks), self._context.upload(blocks), *grid.size, *given
            )
        return *grid.finer, *grid.size, *grid.corner

    def _enqueue_rounds(
        self, grid: _GradedGrid, number: int, raster_arguments: tuple[Any, ...], blocks: npt.NDArray[np.int32]
    ) -> None:
        """Enqueue a grid's rounds; each widens the invalid rim."""
        where, size = self._context.upload(blocks), _work_size(blocks)
        scale = np.float32(SIDE / grid.side)
        darts = (*grid.corner, self._salts[number], np.int64(grid.side), scale, np.int32(self._levels))
        for turn, (start, tries) in enumerate(self._rounds[number]):
            rim = (2 * turn + 1) * _REACH
            window = (where, *grid.size, np.int32(rim))
            thrown = (np.int32(start), np.int32(tries))
            given = (*grid.points, *grid.candidate, *grid.lists, *raster_arguments)
            self._launch(f"{throw_kernel(tries)}_graded", size, *given, *window, *darts, *thrown)
            window = (where, *grid.size, np.int32(rim + _REACH))
            self._launch("accept_graded", size, *window, *grid.points, *grid.candidate)

    def _collect(
        self, buffers: BufferSet, grid: _GradedGrid, area: Area, raster: tuple[Any, ...]
    ) -> StructuredArray:
        size, where, start, per_row = count_points(self._context, buffers, _FILE, grid, area)
        total = int(per_row.sum())
        result = np.zeros(total, GRADED)
        if total:
            point = buffers.buffer("point", (total, 2), np.int64)
            of = buffers.buffer("of", (total, 2), np.float32)
            collected = (start, point, of)
            self._context.launch(_FILE, "write_graded", size, *grid.points, *where, *raster, *collected)
            result["x"], result["y"] = self._context.download(point, (total, 2), np.int64).T
            spacing, times = self._context.download(of, (total, 2), np.float32).T
            result["spacing"], result["level"] = spacing, np.rint(np.log2(times))
        return result

    def _launch(self, kernel: str, size: tuple[int, int], *arguments: Any) -> None:
        across = min(size[0], GROUP)
        self._context.launch(_FILE, kernel, size, *arguments, group=(across, GROUP // across))


def _work_size(blocks: npt.NDArray[np.int32]) -> tuple[int, int]:
    return _BLOCK[1], _BLOCK[0] * len(blocks)
