"""Poisson-disk points as a function of the world (``kernels/foliage.cl``)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.features.hashing import hashed

if TYPE_CHECKING:
    from collections.abc import Generator

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext

__all__ = ["GREATEST_DENSITY", "ROUNDS", "poisson_disk", "poisson_disk_steps"]

ROUNDS = 14
"""Rounds of candidates: about nine tenths of the points a maximal set would have."""
GREATEST_DENSITY = 0.6966
"""Points a square unit of a maximal set at distance 1, by dart throwing (Wei 2008)."""

_REACH = 2  # cells, as in the kernels
_HALO = 2 * _REACH * ROUNDS + _REACH
_ROUND_SALT = 0x9E3779B9
_WINDOW = 1024
_GROUP = 64
_MOST_POINTS = 40_000_000
_EMPTY = -1


def poisson_disk(
    context: ComputeContext, area: tuple[int, int, int, int], radius: int, *, seed: int
) -> npt.NDArray[np.int64]:
    """Return the points of the world's Poisson-disk set that lie in a rectangle.

    Parameters
    ----------
    context
    area
        West, south, east, north in lattice units; west and south inclusive, east and north exclusive.
    radius
        No two points are nearer than so many lattice units, ≥ 2.
    seed

    Returns
    -------
    ndarray of int64, shape (n, 2)
        Lattice positions in rows of cells from south to north, in each from west to east. A point that
        lies in two rectangles is the same in both.

    Raises
    ------
    InputError
        If the radius is below 2 units, or the rectangle would hold over forty million points.
    """
    steps = poisson_disk_steps(context, area, radius, seed=seed)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            points: npt.NDArray[np.int64] = end.value
            return points


def poisson_disk_steps(
    context: ComputeContext, area: tuple[int, int, int, int], radius: int, *, seed: int
) -> Generator[None, None, npt.NDArray[np.int64]]:
    """Do what :func:`poisson_disk` does in steps: the device works while others go on."""
    west, south, east, north = area
    if radius < 2:
        raise InputError(f"the distance between plants must be at least 2 lattice units, not {radius}")
    if west >= east or south >= north:
        return np.zeros((0, 2), np.int64)
    expected = GREATEST_DENSITY * (east - west) * (north - south) / radius**2
    if expected > _MOST_POINTS:
        raise InputError(f"the rectangle would hold about {expected:.2g} plants; at most {_MOST_POINTS} fit")
    cell = int(radius / np.sqrt(2))
    salt = int(hashed(seed, "poisson disk") & np.uint64(0xFFFFFFFF))
    first, last = (west // cell, south // cell), ((east - 1) // cell + 1, (north - 1) // cell + 1)
    bands = []
    for bottom in range(first[1], last[1], _WINDOW):
        top = min(bottom + _WINDOW, last[1])
        found = []
        for left in range(first[0], last[0], _WINDOW):
            cells = (left, bottom, min(left + _WINDOW, last[0]), top)
            accepted = _accepted(context, cells, cell, radius, salt)
            yield
            found.append(_points(context, accepted, cells, cell))
        points = np.concatenate(found)
        bands.append(points[np.lexsort((points[:, 0] // cell, points[:, 1] // cell))])
    points = np.concatenate(bands)
    inside = (points >= (west, south)).all(axis=1) & (points < (east, north)).all(axis=1)
    return points[inside]


def _with_halo(cells: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    """Return a window's first cell, its width and its height."""
    left, bottom = cells[0] - _HALO, cells[1] - _HALO
    return left, bottom, cells[2] + _HALO - left, cells[3] + _HALO - bottom


def _accepted(
    context: ComputeContext, cells: tuple[int, int, int, int], cell: int, radius: int, salt: int
) -> Any:
    """Start to look for the points of the cells from (left, bottom) up to (right, top) with their halo."""
    left, bottom, width, height = _with_halo(cells)
    # The rim stays empty: it only spares the kernels a test for the window's end.
    nothing = np.full((height, width, 2), _EMPTY, np.int32)
    accepted, candidate = (context.upload(nothing, writable=True) for _ in range(2))
    priority = context.upload(np.zeros((height, width), np.uint32), writable=True)
    size = (-(-(width - 2 * _REACH) // _GROUP) * _GROUP, height - 2 * _REACH)
    r2 = np.int64(radius) ** 2
    for turn in range(ROUNDS):
        salted = np.uint32((salt + turn * _ROUND_SALT) & 0xFFFFFFFF)
        window = (accepted, candidate, priority, np.int32(width))
        place = (np.int64(left), np.int64(bottom), np.int32(cell), r2, salted)
        context.launch("foliage.cl", "propose", size, *window, *place, group=(_GROUP, 1))
        context.launch("foliage.cl", "resolve", size, *window, np.int32(cell), r2, group=(_GROUP, 1))
    return accepted


def _points(
    context: ComputeContext, accepted: Any, cells: tuple[int, int, int, int], cell: int
) -> npt.NDArray[np.int64]:
    """Return the points of the cells without their halo."""
    _, _, width, height = _with_halo(cells)
    offset = context.download(accepted, (height, width, 2), np.int32)[_HALO:-_HALO, _HALO:-_HALO]
    row, column = np.nonzero(offset[..., 0] != _EMPTY)
    corner = np.stack([(column + cells[0]) * cell, (row + cells[1]) * cell], axis=-1)
    return np.asarray(corner + offset[row, column], dtype=np.int64)
