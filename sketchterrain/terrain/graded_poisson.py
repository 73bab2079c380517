"""Poisson-disk points whose distance varies over the ground, as a function of the world.

``kernels/graded_poisson.cl`` says how.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sketchterrain.compute.scratch import Scratch
from sketchterrain.errors import InputError
from sketchterrain.terrain.poisson_cells import (
    GROUP,
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

if TYPE_CHECKING:
    from collections.abc import Callable, Generator

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.compute.scratch import Room

__all__ = ["GRADED", "GradedPoisson", "SpacingRaster"]

GRADED: Final = np.dtype([("x", "i8"), ("y", "i8"), ("spacing", "f4"), ("level", "u1")])
"""A point: lattice position, distance to others (lattice units), level."""

_FILE = "graded_poisson.cl"
_STREAM = "graded poisson disk"
_REACH = 3  # cells, as in the kernels
_LISTED = 24  # as in the kernels
_COARSE_TRIALS = 8  # darts a cell of all grids but the finest throws
_FINE_TRIALS = 16
_WINDOW = 768  # cells: lists take 96 bytes for each
_ROUNDING = math.sqrt(2.0)  # lattice units that two points may come nearer by rounding them
_MOST_GRIDS = 16


class SpacingRaster(NamedTuple):
    """The distance between points, bilinear between the vertices of a raster of the world.

    Attributes
    ----------
    west, south : int
        Of the first vertex, lattice units; multiples of ``step``.
    step : int
        Lattice units between vertices, a power of two.
    spacing : float32 (rows, columns)
        Lattice units, row 0 southernmost; over the greatest distance where nothing stands.
    """

    west: int
    south: int
    step: int
    spacing: npt.NDArray[np.float32]


@dataclass(frozen=True)
class _Graded(Grid):
    """A grid whose points have half a distance and 2^level; and lists of coarser points, with their place."""

    half: Any
    times: Any
    lists: tuple[Any, ...]

    @property
    def points(self) -> tuple[Any, ...]:
        return self.x, self.y, self.half, self.times

    @property
    def height(self) -> np.int32:
        return np.int32(self.cells.height)


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
        grids = max(math.floor(math.log2((most + _ROUNDING) / (least + _ROUNDING))), levels) + 1
        if not (levels >= 0 and grids <= _MOST_GRIDS):
            raise InputError(f"distances and levels may double {_MOST_GRIDS - 1} times at most")
        self._context = context
        self._raster_of = raster_of
        self._least, self._most, self._levels = least, most, levels
        self._side = math.floor((least + _ROUNDING) / math.sqrt(2.0))
        self._salts = [salt_of(seed, _STREAM, grid) for grid in range(grids)]
        self._rounds = [schedule(_COARSE_TRIALS if grid else _FINE_TRIALS) for grid in range(grids)]
        self._scratch = Scratch(context)

    def within(self, area: Area) -> npt.NDArray[np.void]:
        """Return the points of a rectangle (lattice units; its east and north are not in it).

        Returns
        -------
        ndarray of GRADED, shape (n,)
            By y, then x. A point that lies in two rectangles is the same in both.
        """
        steps = self.steps(area)
        while True:
            try:
                next(steps)
            except StopIteration as end:
                points: npt.NDArray[np.void] = end.value
                return points

    def steps(self, area: Area) -> Generator[None, None, npt.NDArray[np.void]]:
        """Do the same in steps: the device works while others go on; the last one returns the points."""
        found = [np.zeros(0, GRADED)]
        for band in bands(area, self._side, window=_WINDOW):
            for part in band:
                with self._scratch.lent() as room:
                    found += yield from self._window_steps(room, part)
        points = np.concatenate(found)
        return points[np.lexsort((points["x"], points["y"]))]

    def _window_steps(self, room: Room, area: Area) -> Generator[None, None, list[npt.NDArray[np.void]]]:
        """Sample the grids over an area, the coarsest first, and collect the points of each."""
        windows = [Cells.over(area, self._side).wider(self._rim(0))]
        for number in range(1, len(self._salts)):
            windows.append(windows[-1].coarser().wider(_REACH + self._rim(number)))
        raster = self._uploaded(_ground(windows[-1], self._side << len(windows) - 1))
        yield
        lists = (raster[0], raster[0], np.int32(0), np.int32(0), np.int64(0), np.int64(0))  # none
        found = []
        for number in reversed(range(len(windows))):
            grid = self._begun(room, windows[number], number, lists)
            self._fill(room, grid, number, raster)
            yield
            found.append(self._collected(room, grid, area, raster))
            lists = self._listed(room, grid, number) if number else lists
        return found

    def _rim(self, grid: int) -> int:
        return 2 * _REACH * len(self._rounds[grid])

    def _uploaded(self, area: Area) -> tuple[Any, ...]:
        """Return the distances over an area, as kernels want them."""
        raster = self._raster_of(*area)
        bits = raster.step.bit_length() - 1
        if raster.step != 1 << bits:
            raise InputError(f"a raster's step must be a power of two, not {raster.step}")
        corner = (np.int64(raster.west), np.int64(raster.south))
        width = np.int32(raster.spacing.shape[1])
        spacing = self._context.upload(np.asarray(raster.spacing, np.float32))
        return spacing, width, np.int32(bits), *corner, np.float32(self._most)

    def _begun(self, room: Room, cells: Cells, number: int, lists: tuple[Any, ...]) -> _Graded:
        """Start a grid's window: empty."""
        kinds = (("x", np.int16), ("y", np.int16), ("half", np.float32), ("times", np.float32))
        points = [room.buffer(name, cells.shape, kind) for name, kind in kinds]
        side = self._side << number
        grid = _Graded(cells, side, self._rim(number), points[0], points[1], points[2], points[3], lists)
        self._launch("clear", (rounded_up(cells.width), cells.height), *points[:2], grid.width)
        return grid

    def _listed(self, room: Room, grid: _Graded, number: int) -> tuple[Any, ...]:
        """Enqueue the lists of what a grid and those before it hold, for the next finer one."""
        # Two sets of buffers are enough: lists are made of but those before them.
        turn = number % 2
        near = room.buffer(f"near {turn}", (*grid.cells.shape, _LISTED, 4), np.float32)
        listed = room.buffer(f"listed {turn}", grid.cells.shape, np.uint8)
        window = (grid.width, grid.height, *grid.corner)
        size = _inner(grid, _REACH)
        self._launch("list_for_finer", size, *grid.points, *grid.lists, near, listed, *window)
        return near, listed, *window

    def _fill(self, room: Room, grid: _Graded, number: int, raster: tuple[Any, ...]) -> None:
        """Enqueue a grid's rounds; each leaves a wider rim that is not right."""
        kinds = {"x": np.int16, "y": np.int16, "half": np.float32, "times": np.float32, "time": np.uint32}
        candidate = [room.buffer(f"candidate {name}", grid.cells.shape, kinds[name]) for name in kinds]
        scale = np.float32(SIDE / grid.side)
        darts = (*grid.corner, self._salts[number], np.int64(grid.side), scale, np.int32(self._levels))
        for turn, (start, tries) in enumerate(self._rounds[number]):
            rim = (2 * turn + 1) * _REACH
            window = (grid.width, np.int32(rim))
            thrown = (np.int32(start), np.int32(tries))
            ground = (*grid.lists, *raster)
            size = _inner(grid, rim)
            kernel = f"{thrown_by(tries)}_graded"
            self._launch(kernel, size, *grid.points, *candidate, *ground, *window, *darts, *thrown)
            rim += _REACH
            size = _inner(grid, rim)
            self._launch("accept_graded", size, *grid.points, *candidate, grid.width, np.int32(rim))

    def _collected(
        self, room: Room, grid: _Graded, area: Area, raster: tuple[Any, ...]
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
            result["spacing"], result["level"] = spacing, np.log2(times)
        return result

    def _launch(self, kernel: str, size: tuple[int, int], *arguments: Any) -> None:
        self._context.launch(_FILE, kernel, size, *arguments, group=(GROUP, 1))


def _inner(grid: Grid, rim: int) -> tuple[int, int]:
    return rounded_up(grid.cells.width - 2 * rim), grid.cells.height - 2 * rim


def _ground(cells: Cells, side: int) -> Area:
    """Return the lattice units that cells of a side cover."""
    west, south, east, north = (each * side for each in cells)
    return west, south, east, north


def graded_points_steps(
    context: ComputeContext,
    area: Area,
    raster_of: Callable[[int, int, int, int], SpacingRaster],
    *,
    least: int,
    most: int,
    levels: int,
    seed: int,
) -> Generator[None, None, npt.NDArray[np.void]]:
    """Do what :meth:`GradedPoisson.steps` does."""
    points = yield from GradedPoisson(
        context, raster_of, least=least, most=most, levels=levels, seed=seed
    ).steps(area)
    return points
