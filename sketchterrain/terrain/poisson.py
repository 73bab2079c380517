"""Poisson-disk points with one distance, as a function of the world (``kernels/poisson.cl``)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.compute.scratch import BufferPool
from sketchterrain.errors import InputError
from sketchterrain.terrain.poisson_cells import (
    GROUP,
    MOST_POINTS,
    ROUNDING,
    SIDE,
    WINDOW,
    Area,
    Cells,
    Grid,
    Points,
    bands,
    counted,
    joined,
    merged,
    rounded_up,
    salt_of,
    schedule,
    thrown_by,
)
from sketchterrain.terrain.stepped import finished

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.compute.scratch import BufferSet

TRIALS = 24
"""Darts a cell throws: over nine tenths of the points a maximal set would have."""
GREATEST_DENSITY = 0.6966
"""Points a square unit of a maximal set at distance 1, by dart throwing (Wei 2008)."""

_FILE = "poisson.cl"
_STREAM = "poisson disk"
_REACH = 2  # cells, as in the kernels
_MOST_RADIUS = 1 << 44  # a cell's side times SIDE stays below 2^63
_MOST_TRIALS = 255
_MOST_LEVELS = 12
_BYTES_A_POINT = 2 * 17  # windows' points and, joined, all


@dataclass(frozen=True)
class _Levelled(Grid):
    """A grid whose points have levels, a byte a cell."""

    level: Any


class PoissonDisk:
    """The world's Poisson-disk set at one distance.

    Parameters
    ----------
    context
        Where it is sampled; any device gives the same points.
    radius
        No two points are nearer than so many lattice units, ≥ 2; from about 1000 on, rounding costs nothing.
    seed
    trials
        Darts a cell of side radius/√2 throws, 1 … 255: the more, the fuller, see docs/kernels/poisson.md.
    levels
        Coarser sets that it holds, 0 … 12: the points of level j and above are no nearer than radius · 2^j.

    Raises
    ------
    InputError
        If one of them is out of its range.
    """

    def __init__(
        self, context: ComputeContext, radius: int, *, seed: int, trials: int = TRIALS, levels: int = 0
    ) -> None:
        if not 2 <= radius <= _MOST_RADIUS:
            raise InputError(
                f"the distance between points must be 2 … {_MOST_RADIUS} lattice units, not {radius}"
            )
        if not 1 <= trials <= _MOST_TRIALS:
            raise InputError(f"trials must be 1 … {_MOST_TRIALS}, not {trials}")
        if not 0 <= levels <= _MOST_LEVELS:
            raise InputError(f"levels must be 0 … {_MOST_LEVELS}, not {levels}")
        self.context = context
        self.radius = radius
        self._salts = [salt_of(seed, _STREAM, level) for level in range(levels + 1)]
        self._rounds = schedule(trials)
        self._rim = 2 * _REACH * len(self._rounds)
        # A cell's side, lattice units, and the distance in shares of it: no two points fit into one cell.
        self._side = math.ceil((radius + ROUNDING) / math.sqrt(2.0))
        r2 = math.ceil(((radius + ROUNDING) * SIDE / self._side) ** 2)
        self._r2 = np.int32(min(r2, 2 * SIDE**2))
        self._scratch = BufferPool(context)

    def within(self, area: Area) -> Points:
        """Return the points of a rectangle, as far as they fit into memory.

        Raises
        ------
        InputError
            If it would hold over forty million points; :meth:`pieces` has no such bound.
        """
        return finished(self.steps(area))

    def steps(self, area: Area) -> Generator[None, None, Points]:
        """Do the same in steps: the device works while others go on; the last one returns the points."""
        most = self.expected(area)
        if most > MOST_POINTS:
            needed = most * _BYTES_A_POINT / 2**30
            raise InputError(
                f"the rectangle would hold about {most:.3g} points ({needed:.1f} GiB); "
                f"at most {MOST_POINTS} fit"
            )
        found = []
        for band in bands(area, self._side, window=WINDOW):
            points = yield from self._band_steps(band)
            found.append(points)
        return joined(found)

    def pieces(self, area: Area) -> Iterator[Points]:
        """Return the points of a rectangle of any size band by band, from south to north.

        Joined, they are what :meth:`within` returns. A band is 2048 cells high and as wide as the rectangle.
        """
        for band in bands(area, self._side, window=WINDOW):
            yield finished(self._band_steps(band))

    def expected(self, area: Area) -> float:
        """Return how many points a rectangle holds, a little too many."""
        west, south, east, north = area
        return GREATEST_DENSITY * max(east - west, 0) * max(north - south, 0) / self.radius**2

    def _band_steps(self, band: list[Area]) -> Generator[None, None, Points]:
        """Sample and collect the points of windows side by side."""
        parts = []
        for part in band:
            with self._scratch.borrow() as room:
                sampled = self._sampled(room, part)
                yield
                parts.append(self._collected(room, sampled, part))
        return merged(parts)

    def _sampled(self, room: BufferSet, area: Area) -> _Levelled:
        """Enqueue the sampling of an area's cells, the coarsest level first."""
        windows = [Cells.over(area, self._side).wider(self._rim)]
        for _ in self._salts[1:]:
            windows.append(windows[-1].coarser().wider(self._rim))
        coarsest = len(windows) - 1
        grid = self._begun(room, windows[coarsest], coarsest, None)
        self._fill(room, grid, coarsest)
        for level in reversed(range(coarsest)):
            grid = self._begun(room, windows[level], level, grid)
            self._fill(room, grid, level)
        return grid

    def _begun(self, room: BufferSet, cells: Cells, level: int, coarse: _Levelled | None) -> _Levelled:
        """Start a window: empty, or with the points of a coarser one that covers it."""
        # Two sets of buffers are enough: a level reads but the one before it.
        kinds = (("x", np.int16), ("y", np.int16), ("level", np.uint8))
        x, y, of = (room.buffer(f"{name} {level % 2}", cells.shape, kind) for name, kind in kinds)
        grid = _Levelled(cells, self._side << level, self._rim, x, y, of)
        parent = coarse or grid
        width = parent.width if coarse else np.int32(0)
        given = (parent.x, parent.y, parent.level, width, *parent.corner)
        size = (rounded_up(cells.width), cells.height)
        self._launch("inherit", size, x, y, of, grid.width, *grid.corner, *given)
        return grid

    def _fill(self, room: BufferSet, grid: _Levelled, level: int) -> None:
        """Enqueue a level's rounds; each leaves a wider rim that is not right."""
        kinds = (("candidate x", np.int16), ("candidate y", np.int16), ("time", np.uint32))
        candidate = [room.buffer(name, grid.cells.shape, kind) for name, kind in kinds]
        darts = (*grid.corner, self._salts[level], self._r2)
        for number, (start, tries) in enumerate(self._rounds):
            rim = (2 * number + 1) * _REACH
            bare = not start and level == len(self._salts) - 1
            kernel = "throw_first" if bare else thrown_by(tries)
            window = (grid.width, np.int32(rim))
            thrown = (np.int32(start), np.int32(tries))
            self._launch(kernel, _inner(grid, rim), grid.x, grid.y, *candidate, *window, *darts, *thrown)
            rim += _REACH
            window = (grid.width, np.int32(rim))
            kept = (grid.x, grid.y, grid.level)
            self._launch("accept", _inner(grid, rim), *kept, *candidate, *window, self._r2, np.int32(level))

    def _collected(self, room: BufferSet, grid: _Levelled, area: Area) -> Points:
        size, where, start, a_row = counted(self.context, room, _FILE, grid, area)
        total = int(a_row.sum())
        point, of = room.buffer("point", (total, 2), np.int64), room.buffer("of", total, np.uint8)
        found = (start, point, of)
        self.context.launch(_FILE, "write_points", size, grid.x, grid.y, grid.level, *where, *found)
        position = self.context.download(point, (total, 2), np.int64)
        return Points(position, self.context.download(of, total, np.uint8), a_row)

    def _launch(self, kernel: str, size: tuple[int, int], *arguments: Any) -> None:
        self.context.launch(_FILE, kernel, size, *arguments, group=(GROUP, 1))


def poisson_disk(
    context: ComputeContext, area: Area, radius: int, *, seed: int, trials: int = TRIALS, levels: int = 0
) -> npt.NDArray[np.int64]:
    """Return the points of the world's Poisson-disk set that lie in a rectangle.

    Parameters
    ----------
    context, radius, seed, trials, levels
        See :class:`PoissonDisk`.
    area
        West, south, east, north in lattice units; west and south inclusive, east and north exclusive.

    Returns
    -------
    ndarray of int64, shape (n, 2)
        Lattice positions in rows of cells from south to north, in each from west to east. A point that
        lies in two rectangles is the same in both.

    Raises
    ------
    InputError
        See :class:`PoissonDisk` and :meth:`PoissonDisk.within`.
    """
    return PoissonDisk(context, radius, seed=seed, trials=trials, levels=levels).within(area).position


def _inner(grid: Grid, rim: int) -> tuple[int, int]:
    return rounded_up(grid.cells.width - 2 * rim), grid.cells.height - 2 * rim
