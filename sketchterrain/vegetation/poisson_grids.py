"""Grids of Poisson-disk sampling: cells, rounds of darts, windows and counts of points."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sketchterrain.array_types import LatticeArray
from sketchterrain.geometry.hashing import hash_keys

if TYPE_CHECKING:
    from sketchterrain.compute.buffers import BufferSet
    from sketchterrain.compute.context import ComputeContext

MAX_POINTS: Final = 40_000_000
"""Most points returned at once."""
ROUNDING: Final = math.sqrt(2.0)
"""Greatest decrease (lattice units) of a distance by rounding two points."""
SIDE: Final = 4096
"""Positions along a cell's side; as in the kernels."""
GROUP: Final = 64
"""Work items of a group."""
_PIECE: Final = 256  # cells of a row that one work item collects

Area = tuple[int, int, int, int]
"""West, south, east, north in lattice units; west and south inclusive, east and north exclusive."""

GREATEST_DENSITY = 0.6966
"""Points per square unit of a maximal set at distance 1, by dart throwing (Wei 2008)."""


class Cells(NamedTuple):
    """A rectangle of cells, by columns and rows from the world's origin; the last ones are exclusive."""

    west: int
    south: int
    east: int
    north: int

    @classmethod
    def covering(cls, area: Area, side: int) -> Cells:
        """Return the cells of a side (lattice units) that an area touches."""
        west, south, east, north = area
        return cls(west // side, south // side, (east - 1) // side + 1, (north - 1) // side + 1)

    @property
    def width(self) -> int:
        """Columns."""
        return self.east - self.west

    @property
    def height(self) -> int:
        """Rows."""
        return self.north - self.south

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return self.height, self.width

    def wider(self, rim: int) -> Cells:
        """Return it with ``rim`` more cells on each side."""
        return Cells(self.west - rim, self.south - rim, self.east + rim, self.north + rim)

    def coarser(self) -> Cells:
        """Return the cells twice as wide that it touches."""
        return Cells(self.west // 2, self.south // 2, (self.east + 1) // 2, (self.north + 1) // 2)


@dataclass(frozen=True)
class Grid:
    """A window's cells on the device, whose points are valid except in a rim."""

    cells: Cells
    side: int  # of a cell, lattice units
    rim: int  # cells at its border that are not sampled to the end
    x: Any  # buffers, see kernels/graded_poisson.cl
    y: Any

    @property
    def width(self) -> np.int32:
        """Columns, as a kernel argument."""
        return np.int32(self.cells.width)

    @property
    def corner(self) -> tuple[np.int64, np.int64]:
        """First column and row, as kernel arguments."""
        return np.int64(self.cells.west), np.int64(self.cells.south)


class Round(NamedTuple):
    """Darts that every empty cell throws before candidates are compared."""

    start: int
    tries: int


def schedule(trials: int) -> tuple[Round, ...]:
    """Return the rounds of so many darts a cell: each throws about as many as all before it.

    The denser the set, the more darts are needed to add a point; a round needs a halo, a dart does not.
    """
    rounds: list[Round] = []
    thrown = 0
    while thrown < trials:
        tries = min(max(thrown, 1), trials - thrown)
        tries -= tries % 4 if tries > 4 else tries % 2 if tries > 2 else 0
        rounds.append(Round(thrown, tries))
        thrown += tries
    return tuple(rounds)


def throw_kernel(tries: int) -> str:
    """Return the kernel that throws the most darts at once that divide a number of tries."""
    return "throw_one" if tries == 1 else "throw_two" if tries % 4 else "throw_four"


def hash_salt(seed: int, stream: str, level: int) -> np.uint32:
    """Return the hash salt of a level's darts."""
    return np.uint32(hash_keys(seed, stream, level) & np.uint64(0xFFFFFFFF))


def rounded_up(count: int) -> int:
    """Return the number of work items in whole groups."""
    return -(-count // GROUP) * GROUP


def bands(area: Area, side: int, *, window: int) -> Iterator[list[Area]]:
    """Cut an area along cell borders into bands from south to north, each a list of windows from the west."""
    west, south, east, north = area
    if west >= east or south >= north:
        return
    cells = Cells.covering(area, side)
    for bottom in range(cells.south, cells.north, window):
        low, high = max(south, bottom * side), min(north, (bottom + window) * side)
        yield [
            (max(west, left * side), low, min(east, (left + window) * side), high)
            for left in range(cells.west, cells.east, window)
        ]


def count_points(
    context: ComputeContext, buffers: BufferSet, file: str, grid: Grid, area: Area
) -> tuple[tuple[int, int], tuple[Any, ...], Any, LatticeArray]:
    """Count the points of a grid, inside its rim, in an area (lattice units).

    Returns the launch size of the kernel that writes them, its arguments for window, area and pieces, a
    buffer of each piece's start, and the points (rows,) in each row of cells.
    """
    inner = grid.cells.wider(-grid.rim)
    size = (-(-inner.width // _PIECE), inner.height)
    bounds = (np.int64(grid.side), np.array(area, np.int64), np.int32(_PIECE))
    where = (grid.width, np.int32(grid.rim), *grid.corner, *bounds)
    count = buffers.buffer("count", size, np.int32)
    context.launch(file, "count_points", size, grid.x, grid.y, *where, count)
    many = context.download(count, size[::-1], np.int32)
    start = np.cumsum(many, dtype=np.int32) - many.ravel()
    return size, where, context.upload(start), many.sum(axis=1, dtype=np.int64)
