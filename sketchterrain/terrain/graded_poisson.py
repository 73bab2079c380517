"""Poisson-disk points whose distance varies over the ground, as a function of the world.

``kernels/graded_poisson.cl`` says how.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.compute.scratch import BufferPool
from sketchterrain.errors import InputError
from sketchterrain.terrain.poisson_cells import (
    GROUP,
    MOST_POINTS,
    ROUNDING,
    SIDE,
    Area,
    Cells,
    Grid,
    bands,
    counted,
    rounded_up,
    salt_of,
    schedule,
    thrown_by,
)
from sketchterrain.terrain.spacing_raster import SpacingRanges
from sketchterrain.terrain.stepped import finished

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.compute.scratch import BufferSet
    from sketchterrain.terrain.spacing_raster import SpacingRaster

GRADED: Final = np.dtype([("x", "i8"), ("y", "i8"), ("spacing", "f4"), ("level", "u1")])
"""A point: lattice position, distance to others (lattice units), level."""

_FILE = "graded_poisson.cl"
_STREAM = "graded poisson disk"
_REACH = 3  # cells, as in the kernels
_LISTED = 24  # as in the kernels
_COARSE_TRIALS = 8  # darts a cell of all grids but the finest throws
_FINE_TRIALS = 16
_BLOCK = (16, 64)  # rows and columns of cells, as in the kernels
_SPARE = 1.0001  # of distances, when it is asked where there is something to do
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
_WINDOW = 768  # cells: lists take 96 bytes for each
_MOST_GRIDS = 16


@dataclass(frozen=True)
class _Graded(Grid):
    """A grid whose points have half a distance and 2^level.

    Attributes
    ----------
    points, candidate : tuple of Buffer
        x, y, half the distance and 2^level; of candidates the time too.
    lists : tuple
        Of points of coarser grids, and the window that they are for.
    finer : tuple of Buffer
        Lists for the next finer grid: points, how many.
    """

    points: tuple[Any, ...]
    candidate: tuple[Any, ...]
    lists: tuple[Any, ...]
    finer: tuple[Any, ...]

    @property
    def size(self) -> tuple[np.int32, np.int32]:
        """Columns and rows, as kernels want them."""
        return np.int32(self.cells.width), np.int32(self.cells.height)


class GradedPoisson:
    """The world's Poisson-disk set of a distance that varies over it.

    Two points p, q are no nearer than 2^min(level_p, level_q) · (spacing_p + spacing_q) / 2.

    Parameters
    ----------
    context
        Where it is sampled; any device gives the same points.
    raster_of
        Returns the distance between points over a rectangle (west, south, east, north, lattice units), with
        vertices around all of it. What it says of a place must not depend on the rectangle.
    least, most
        Range of the distance, lattice units; nothing stands where it is more.
    levels
        Coarser sets within it; fewer where points are far apart, as far as the coarsest grid reaches.
    seed

    Raises
    ------
    InputError
        If the distances or levels are out of range.
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
            raise InputError(f"distances must be 2 … ∞ lattice units, least to most, not {least} … {most}")
        self._side = math.floor((least + ROUNDING) / math.sqrt(2.0))
        doubled = math.log2(_SPARE * (most + ROUNDING) / (math.sqrt(2.0) * self._side))
        grids = max(math.floor(doubled), levels) + 1
        if not (levels >= 0 and grids <= _MOST_GRIDS):
            raise InputError(f"distances and levels may double {_MOST_GRIDS - 1} times at most")
        self._context = context
        self._raster_of = raster_of
        self._most, self._levels = most, levels
        self._salts = [salt_of(seed, _STREAM, grid) for grid in range(grids)]
        self._rounds = [schedule(_COARSE_TRIALS if grid else _FINE_TRIALS) for grid in range(grids)]
        self._scratch = BufferPool(context)

    @property
    def reach(self) -> int:
        """How far beyond a rectangle the distance is asked for at most, lattice units."""
        rim = self._rim(0)
        for number in range(1, len(self._salts)):
            rim = -(-rim // 2) + 1 + _REACH + self._rim(number)
        return (rim + 1) * self._side << (len(self._salts) - 1)

    def within(self, area: Area) -> npt.NDArray[np.void]:
        """Return the points of a rectangle (lattice units; its east and north are not in it).

        Returns
        -------
        ndarray of GRADED, shape (n,)
            By y, then x. A point that lies in two rectangles is the same in both.

        Raises
        ------
        InputError
            If there are over forty million.
        """
        return finished(self.steps(area))

    def steps(self, area: Area) -> Generator[None, None, npt.NDArray[np.void]]:
        """Do the same in steps: the device works while others go on; the last one returns the points."""
        found = [np.zeros(0, GRADED)]
        for band in bands(area, self._side, window=_WINDOW):
            for part in band:
                with self._scratch.borrow() as room:
                    found += yield from self._window_steps(room, part)
                if sum(map(len, found)) > MOST_POINTS:
                    raise InputError(f"the rectangle holds over {MOST_POINTS} points; ask for parts of it")
        points = np.concatenate(found)
        return points[np.lexsort((points["x"], points["y"]))]

    def _window_steps(self, room: BufferSet, area: Area) -> Generator[None, None, list[npt.NDArray[np.void]]]:
        """Sample the grids over an area, the coarsest first, and collect the points of each."""
        windows = [Cells.over(area, self._side).wider(self._rim(0))]
        for number in range(1, len(self._salts)):
            windows.append(windows[-1].coarser().wider(_REACH + self._rim(number)))
        raster = self._raster(_ground(windows[-1], self._side << len(windows) - 1))
        ground, ranges = self._uploaded(raster), SpacingRanges.of(raster)
        yield
        lists = (ground[0], ground[0], np.int32(0), np.int32(0), np.int64(0), np.int64(0))  # none
        found = []
        for number in reversed(range(len(windows))):
            grid = self._begun(room, windows[number], number, lists)
            blocks = self._blocks(ranges, grid, number)
            if len(blocks):
                self._fill(grid, number, ground, blocks)
                yield
                found.append(self._collected(room, grid, area, ground))
            if number:
                lists = self._listed(grid, self._blocks(ranges, grid, number - 1, finer=True))
        return found

    def _rim(self, grid: int) -> int:
        return 2 * _REACH * len(self._rounds[grid])

    def _raster(self, area: Area) -> SpacingRaster:
        raster = self._raster_of(*area)
        if raster.step & (raster.step - 1):
            raise InputError(f"a raster's step must be a power of two, not {raster.step}")
        return raster

    def _uploaded(self, raster: SpacingRaster) -> tuple[Any, ...]:
        """Return the distances over an area, as kernels want them."""
        corner = (np.int64(raster.west), np.int64(raster.south))
        shape = (np.int32(raster.spacing.shape[1]), np.int32(raster.step.bit_length() - 1))
        spacing = self._context.upload(np.asarray(raster.spacing, np.float32))
        return spacing, *shape, *corner, np.float32(self._most)

    def _blocks(
        self, ranges: SpacingRanges, grid: Grid, number: int, *, finer: bool = False
    ) -> npt.NDArray[np.int32]:
        """Return the first cells (n, 2) of a window's blocks where a grid has something to do.

        With `finer`, where it or any finer one has: lists are made of lists.
        """
        first = [np.arange(0, many, size) for many, size in zip(grid.cells.shape, _BLOCK, strict=True)]
        start = [
            (at + cell) * grid.side
            for at, cell in zip(first, (grid.cells.south, grid.cells.west), strict=True)
        ]
        low, high = ranges.over(start, [size * grid.side for size in _BLOCK])
        # What is between vertices is between their values; rounding is far below the margin.
        reach = math.sqrt(2.0) * (self._side << number)
        busy = (low + ROUNDING < 2.0 * _SPARE * reach) & (low <= self._most)
        if not finer:
            busy &= (high + ROUNDING) * _SPARE * 2**self._levels > reach
        row, column = np.nonzero(busy)
        return np.stack([first[1][column], first[0][row]], axis=-1).astype(np.int32)

    def _begun(self, room: BufferSet, cells: Cells, number: int, lists: tuple[Any, ...]) -> _Graded:
        """Start a grid's window: empty."""
        own = [room.buffer(name, cells.shape, kind) for name, kind in _KINDS.items()]
        # Two sets of lists are enough: they are made of but those before them.
        near = room.buffer(f"near {number % 2}", (*cells.shape, _LISTED, 4) if number else 1, np.float32)
        listed = room.buffer(f"listed {number % 2}", cells.shape, np.uint8)
        grid = _Graded(
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

    def _listed(self, grid: _Graded, blocks: npt.NDArray[np.int32]) -> tuple[Any, ...]:
        """Enqueue the lists of what a grid and those before it hold, for the next finer one."""
        if len(blocks):
            given = (np.int32(_REACH), *grid.points, *grid.lists, *grid.finer, *grid.corner)
            self._launch("list_for_finer", _items(blocks), self._context.upload(blocks), *grid.size, *given)
        return *grid.finer, *grid.size, *grid.corner

    def _fill(
        self, grid: _Graded, number: int, ground: tuple[Any, ...], blocks: npt.NDArray[np.int32]
    ) -> None:
        """Enqueue a grid's rounds; each leaves a wider rim that is not right."""
        where, size = self._context.upload(blocks), _items(blocks)
        scale = np.float32(SIDE / grid.side)
        darts = (*grid.corner, self._salts[number], np.int64(grid.side), scale, np.int32(self._levels))
        for turn, (start, tries) in enumerate(self._rounds[number]):
            rim = (2 * turn + 1) * _REACH
            window = (where, *grid.size, np.int32(rim))
            thrown = (np.int32(start), np.int32(tries))
            given = (*grid.points, *grid.candidate, *grid.lists, *ground)
            self._launch(f"{thrown_by(tries)}_graded", size, *given, *window, *darts, *thrown)
            window = (where, *grid.size, np.int32(rim + _REACH))
            self._launch("accept_graded", size, *window, *grid.points, *grid.candidate)

    def _collected(
        self, room: BufferSet, grid: _Graded, area: Area, raster: tuple[Any, ...]
    ) -> npt.NDArray[np.void]:
        size, where, start, a_row = counted(self._context, room, _FILE, grid, area)
        total = int(a_row.sum())
        result = np.zeros(total, GRADED)
        if total:
            point = room.buffer("point", (total, 2), np.int64)
            of = room.buffer("of", (total, 2), np.float32)
            found = (start, point, of)
            self._context.launch(_FILE, "write_graded", size, *grid.points, *where, *raster, *found)
            result["x"], result["y"] = self._context.download(point, (total, 2), np.int64).T
            spacing, times = self._context.download(of, (total, 2), np.float32).T
            result["spacing"], result["level"] = spacing, np.rint(np.log2(times))
        return result

    def _launch(self, kernel: str, size: tuple[int, int], *arguments: Any) -> None:
        self._context.launch(_FILE, kernel, size, *arguments, group=(GROUP, 1))


def _items(blocks: npt.NDArray[np.int32]) -> tuple[int, int]:
    return _BLOCK[1], _BLOCK[0] * len(blocks)


def _ground(cells: Cells, side: int) -> Area:
    """Return the lattice units that cells of a side cover."""
    west, south, east, north = (each * side for each in cells)
    return west, south, east, north
