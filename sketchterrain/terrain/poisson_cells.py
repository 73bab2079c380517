"""Cells of Poisson-disk sampling: windows of them on the device, rounds of darts, points in order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sketchterrain.features.hashing import hash_keys

if TYPE_CHECKING:
    from collections.abc import Iterator

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.compute.scratch import BufferSet

MOST_POINTS: Final = 40_000_000
"""Points that are given back at once at most."""
ROUNDING: Final = math.sqrt(2.0)
"""Lattice units that two points may come nearer by rounding them."""
SIDE: Final = 4096
"""Places along a cell's side; as in the kernels."""
GROUP: Final = 64
"""Work items of a group."""
WINDOW: Final = 2048
"""Cells along a window's side at most."""
_PIECE: Final = 256  # cells of a row that one work item collects

Area = tuple[int, int, int, int]
"""West, south, east, north in lattice units; west and south inclusive, east and north exclusive."""


class Cells(NamedTuple):
    """A rectangle of cells, by columns and rows from the world's origin; the last ones are exclusive."""

    west: int
    south: int
    east: int
    north: int

    @classmethod
    def over(cls, area: Area, side: int) -> Cells:
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
        """Return it with so many more cells on each side."""
        return Cells(self.west - rim, self.south - rim, self.east + rim, self.north + rim)

    def coarser(self) -> Cells:
        """Return the cells twice as wide that it touches."""
        return Cells(self.west // 2, self.south // 2, (self.east + 1) // 2, (self.north + 1) // 2)


@dataclass(frozen=True)
class Grid:
    """A window's cells on the device, whose points are right but for a rim.

    Attributes
    ----------
    cells : Cells
    side : int
        Of a cell, lattice units.
    rim : int
        Cells at its border that are not sampled to the end.
    x, y : Buffer
        See kernels/poisson.cl.
    """

    cells: Cells
    side: int
    rim: int
    x: Any
    y: Any

    @property
    def width(self) -> np.int32:
        """Columns, as kernels want them."""
        return np.int32(self.cells.width)

    @property
    def corner(self) -> tuple[np.int64, np.int64]:
        """First column and row, as kernels want them."""
        return np.int64(self.cells.west), np.int64(self.cells.south)


class Round(NamedTuple):
    """Darts that every empty cell throws before candidates are compared."""

    start: int
    tries: int


class Points(NamedTuple):
    """Points in the order of their cells, row after row from the south, each from the west.

    Attributes
    ----------
    position : (n, 2) int64
        Lattice units.
    level : (n,) uint8
        The finest level's is 0.
    a_row : (rows,) int64
        How many of them lie in each row of cells.
    """

    position: npt.NDArray[np.int64]
    level: npt.NDArray[np.uint8]
    a_row: npt.NDArray[np.int64]


def schedule(trials: int) -> tuple[Round, ...]:
    """Return the rounds of so many darts a cell: each throws about as many as all before it.

    The fuller the ground, the longer until a dart finds room; and a round costs halo, a dart does not.
    """
    rounds: list[Round] = []
    thrown = 0
    while thrown < trials:
        tries = min(max(thrown, 1), trials - thrown)
        tries -= tries % 4 if tries > 4 else tries % 2 if tries > 2 else 0
        rounds.append(Round(thrown, tries))
        thrown += tries
    return tuple(rounds)


def thrown_by(tries: int) -> str:
    """Return the kernel that throws as many darts at once as go into so many."""
    return "throw_one" if tries == 1 else "throw_two" if tries % 4 else "throw_four"


def salt_of(seed: int, stream: str, level: int) -> np.uint32:
    """Return what sets the darts of a level apart."""
    return np.uint32(hash_keys(seed, stream, level) & np.uint64(0xFFFFFFFF))


def rounded_up(count: int) -> int:
    """Return how many work items cover a count in whole groups."""
    return -(-count // GROUP) * GROUP


def bands(area: Area, side: int, *, window: int) -> Iterator[list[Area]]:
    """Cut an area along lines between cells: into bands from south to north, of windows from the west."""
    west, south, east, north = area
    if west >= east or south >= north:
        return
    cells = Cells.over(area, side)
    for bottom in range(cells.south, cells.north, window):
        low, high = max(south, bottom * side), min(north, (bottom + window) * side)
        yield [
            (max(west, left * side), low, min(east, (left + window) * side), high)
            for left in range(cells.west, cells.east, window)
        ]


def counted(
    context: ComputeContext, room: BufferSet, file: str, grid: Grid, area: Area
) -> tuple[tuple[int, int], tuple[Any, ...], Any, npt.NDArray[np.int64]]:
    """Count the points of a grid, from its rim on, that lie within an area (lattice units).

    Returns
    -------
    size
        Of the launch that writes them.
    where : tuple
        What that wants to know of the window, the area and the pieces.
    start : Buffer
        Where each piece starts.
    a_row : (rows,) int64
        Points in each row of cells.
    """
    inner = grid.cells.wider(-grid.rim)
    size = (-(-inner.width // _PIECE), inner.height)
    bounds = (np.int64(grid.side), np.array(area, np.int64), np.int32(_PIECE))
    where = (grid.width, np.int32(grid.rim), *grid.corner, *bounds)
    count = room.buffer("count", size, np.int32)
    context.launch(file, "count_points", size, grid.x, grid.y, *where, count)
    many = context.download(count, size[::-1], np.int32)
    start = np.cumsum(many, dtype=np.int32) - many.ravel()
    return size, where, context.upload(start), many.sum(axis=1, dtype=np.int64)


def merged(parts: list[Points]) -> Points:
    """Put the points of windows side by side into the order of their cells."""
    if len(parts) == 1:
        return parts[0]
    rows = np.concatenate([np.repeat(np.arange(len(part.a_row)), part.a_row) for part in parts])
    order = np.argsort(rows, kind="stable")
    position, level = (np.concatenate(each)[order] for each in list(zip(*parts, strict=True))[:2])
    return Points(position, level, np.sum([part.a_row for part in parts], axis=0))


def joined(parts: list[Points]) -> Points:
    """Put the points of bands one after the other."""
    if not parts:
        return Points(np.zeros((0, 2), np.int64), np.zeros(0, np.uint8), np.zeros(0, np.int64))
    return Points(*(np.concatenate(each) for each in zip(*parts, strict=True)))
