"""Poisson-disk points of one minimum distance: the constant case of graded_poisson, with its own kernel."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from sketchterrain.array_types import LatticeArray, UInt8Array
from sketchterrain.compute.buffers import BufferPool, BufferSet
from sketchterrain.compute.context import ComputeContext
from sketchterrain.errors import InputError
from sketchterrain.vegetation.graded_poisson import run_to_completion
from sketchterrain.vegetation.poisson_grids import (
    GREATEST_DENSITY,
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

WINDOW: Final = 2048
"""Most cells along a window's side."""
TRIALS = 24
"""Darts per cell: enough for over nine tenths of the points of a maximal set."""
_FILE = "baselines/poisson.cl"
_STREAM = "poisson disk"
_REACH = 2  # cells of a conflict, as in the kernels
_MAX_RADIUS = 1 << 44  # a cell's side times SIDE stays below 2^63
_MAX_TRIALS = 255
_MAX_LEVELS = 12
_BYTES_PER_POINT = 2 * 17  # of windows, and join_bands


class Points(NamedTuple):
    """Points in the order of their cells, row after row from the south, each from the west."""

    position: LatticeArray  # (n, 2), lattice units
    level: UInt8Array  # (n,), 0 is the finest
    per_row: LatticeArray  # (rows,) points in each row of cells


def merge_windows(parts: list[Points]) -> Points:
    """Return the points of adjacent windows in the order of their cells."""
    if len(parts) == 1:
        return parts[0]
    rows = np.concatenate([np.repeat(np.arange(len(part.per_row)), part.per_row) for part in parts])
    order = np.argsort(rows, kind="stable")
    position, level = (np.concatenate(each)[order] for each in list(zip(*parts, strict=True))[:2])
    return Points(position, level, np.sum([part.per_row for part in parts], axis=0))


def join_bands(parts: list[Points]) -> Points:
    """Return the points of bands, concatenated."""
    if not parts:
        return Points(np.zeros((0, 2), np.int64), np.zeros(0, np.uint8), np.zeros(0, np.int64))
    return Points(*(np.concatenate(each) for each in zip(*parts, strict=True)))


@dataclass(frozen=True)
class _LevelGrid(Grid):
    """A grid whose points have levels, a byte per cell."""

    level: Any


class PoissonDisk:
    """The world's Poisson-disk set of one minimum distance; any device gives the same points.

    ``radius`` is the minimum distance, lattice units ≥ 2; rounding is negligible from about 1000. ``trials``
    (1 … 255) are the darts per cell of side radius/√2: more give a denser set, see docs/kernels/poisson.md.
    Of the coarser ``levels`` (0 … 12) nested in it, points of level j and above are no nearer than radius ·
    2^j.
    """

    def __init__(
        self, context: ComputeContext, radius: int, *, seed: int, trials: int = TRIALS, levels: int = 0
    ) -> None:
        if not 2 <= radius <= _MAX_RADIUS:
            raise InputError(f"expected a distance of 2 … {_MAX_RADIUS} lattice units, got {radius}")
        if not 1 <= trials <= _MAX_TRIALS:
            raise InputError(f"expected 1 … {_MAX_TRIALS} trials, got {trials}")
        if not 0 <= levels <= _MAX_LEVELS:
            raise InputError(f"expected 0 … {_MAX_LEVELS} levels, got {levels}")
        self.context = context
        self.radius = radius
        self._salts = [hash_salt(seed, _STREAM, level) for level in range(levels + 1)]
        self._rounds = schedule(trials)
        self._rim = 2 * _REACH * len(self._rounds)
        # A cell's side, lattice units, and the distance relative to it: no two points fit into one cell.
        self._side = math.ceil((radius + ROUNDING) / math.sqrt(2.0))
        r2 = math.ceil(((radius + ROUNDING) * SIDE / self._side) ** 2)
        self._r2 = np.int32(min(r2, 2 * SIDE**2))
        self._scratch = BufferPool(context)

    def within(self, area: Area) -> Points:
        """Return the points of a rectangle; InputError for over forty million, see :meth:`pieces`."""
        return run_to_completion(self.steps(area))

    def steps(self, area: Area) -> Generator[None, None, Points]:
        """Do the same in steps between which the device computes; the generator returns the points."""
        most = self.expected(area)
        if most > MAX_POINTS:
            needed = most * _BYTES_PER_POINT / 2**30
            raise InputError(
                f"the rectangle would hold about {most:.3g} points ({needed:.1f} GiB); "
                f"at most {MAX_POINTS} fit"
            )
        parts = []
        for band in bands(area, self._side, window=WINDOW):
            points = yield from self._band_steps(band)
            parts.append(points)
        return join_bands(parts)

    def pieces(self, area: Area) -> Iterator[Points]:
        """Return the points of a rectangle of any size in bands of 2048 cells from south to north.

        Joined, they are those of :meth:`within`.
        """
        for band in bands(area, self._side, window=WINDOW):
            yield run_to_completion(self._band_steps(band))

    def expected(self, area: Area) -> float:
        """Return a slight overestimate of the number of points of a rectangle."""
        west, south, east, north = area
        return GREATEST_DENSITY * max(east - west, 0) * max(north - south, 0) / self.radius**2

    def _band_steps(self, band: list[Area]) -> Generator[None, None, Points]:
        """Sample and collect the points of windows side by side."""
        parts = []
        for part in band:
            with self._scratch.borrow() as buffers:
                sampled = self._sample(buffers, part)
                yield
                parts.append(self._collect(buffers, sampled, part))
        return merge_windows(parts)

    def _sample(self, buffers: BufferSet, area: Area) -> _LevelGrid:
        """Enqueue the sampling of an area's cells, the coarsest level first."""
        windows = [Cells.covering(area, self._side).wider(self._rim)]
        for _ in self._salts[1:]:
            windows.append(windows[-1].coarser().wider(self._rim))
        coarsest = len(windows) - 1
        grid = self._create_grid(buffers, windows[coarsest], coarsest, None)
        self._enqueue_rounds(buffers, grid, coarsest)
        for level in reversed(range(coarsest)):
            grid = self._create_grid(buffers, windows[level], level, grid)
            self._enqueue_rounds(buffers, grid, level)
        return grid

    def _create_grid(
        self, buffers: BufferSet, cells: Cells, level: int, coarse: _LevelGrid | None
    ) -> _LevelGrid:
        """Return a window's grid, empty or with the points of a coarser one that covers it."""
        # Two sets of buffers are enough: a level reads only the one before it.
        kinds = (("x", np.int16), ("y", np.int16), ("level", np.uint8))
        x, y, of = (buffers.buffer(f"{name} {level % 2}", cells.shape, kind) for name, kind in kinds)
        grid = _LevelGrid(cells, self._side << level, self._rim, x, y, of)
        parent = coarse or grid
        width = parent.width if coarse else np.int32(0)
        given = (parent.x, parent.y, parent.level, width, *parent.corner)
        size = (rounded_up(cells.width), cells.height)
        self._launch("inherit", size, x, y, of, grid.width, *grid.corner, *given)
        return grid

    def _enqueue_rounds(self, buffers: BufferSet, grid: _LevelGrid, level: int) -> None:
        """Enqueue a level's rounds; each widens the invalid rim."""
        kinds = (("candidate x", np.int16), ("candidate y", np.int16), ("time", np.uint32))
        candidate = [buffers.buffer(name, grid.cells.shape, kind) for name, kind in kinds]
        darts = (*grid.corner, self._salts[level], self._r2)
        for number, (start, tries) in enumerate(self._rounds):
            rim = (2 * number + 1) * _REACH
            empty = not start and level == len(self._salts) - 1
            kernel = "throw_first" if empty else throw_kernel(tries)
            window = (grid.width, np.int32(rim))
            thrown = (np.int32(start), np.int32(tries))
            self._launch(kernel, _inner(grid, rim), grid.x, grid.y, *candidate, *window, *darts, *thrown)
            rim += _REACH
            window = (grid.width, np.int32(rim))
            points = (grid.x, grid.y, grid.level)
            self._launch("accept", _inner(grid, rim), *points, *candidate, *window, self._r2, np.int32(level))

    def _collect(self, buffers: BufferSet, grid: _LevelGrid, area: Area) -> Points:
        size, where, start, per_row = count_points(self.context, buffers, _FILE, grid, area)
        total = int(per_row.sum())
        point, of = buffers.buffer("point", (total, 2), np.int64), buffers.buffer("of", total, np.uint8)
        parts = (start, point, of)
        self.context.launch(_FILE, "write_points", size, grid.x, grid.y, grid.level, *where, *parts)
        position = self.context.download(point, (total, 2), np.int64)
        return Points(position, self.context.download(of, total, np.uint8), per_row)

    def _launch(self, kernel: str, size: tuple[int, int], *arguments: Any) -> None:
        self.context.launch(_FILE, kernel, size, *arguments, group=(GROUP, 1))


def _inner(grid: Grid, rim: int) -> tuple[int, int]:
    return rounded_up(grid.cells.width - 2 * rim), grid.cells.height - 2 * rim
