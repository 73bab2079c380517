"""Heights at any places of a stored world, out of the level that shows as much as is asked for."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.world.grid import CHUNK

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.world.viewed_levels import ViewedLevels

    Floats = npt.NDArray[np.float64]

__all__ = ["ViewedHeights"]

_AT_ONCE: Final = 1 << 16
_SPARSE: Final = 4
"""Vertices that are read at once whatever is asked for, and for each place that is."""


class ViewedHeights:
    """Heights of a stored world, 0, 0 being its north-west corner.

    Beyond its ends there is low ground, for nothing there may stand before the sun: no higher than the
    border, and than all but a twentieth of the world.

    Parameters
    ----------
    levels : ViewedLevels
    size : (float, float)
        East and south, m.
    """

    def __init__(self, levels: ViewedLevels, size: tuple[float, float]) -> None:
        self._levels = levels
        self._size = size

    def at(self, x: npt.ArrayLike, y: npt.ArrayLike, *, cell_size: float = 0.0) -> npt.NDArray[np.float32]:
        """Return heights (m).

        Parameters
        ----------
        x, y
            m east and north (negative) of the corner; shapes that broadcast together.
        cell_size
            Metres between the places: of the levels that are no coarser, the coarsest one is read.

        Raises
        ------
        InputError
            If some of it cannot be read.
        """
        east, south = np.broadcast_arrays(np.asarray(x, np.float64), -np.asarray(y, np.float64))
        inside_x, inside_y = np.clip(east, 0.0, self._size[0]), np.clip(south, 0.0, self._size[1])
        outside = (inside_x != east) | (inside_y != south)
        number = self._number(cell_size)
        cell = self._levels.level(number).cell
        found = self._between(number, inside_x.ravel() / cell, inside_y.ravel() / cell).reshape(east.shape)
        if outside.any():
            found[outside] = np.minimum(found[outside], self._low)
        return found.astype(np.float32)

    @cached_property
    def _low(self) -> float:
        coarsest = self._levels.world.levels[-1]
        size = {"rows": coarsest.rows, "columns": coarsest.columns}
        return float(np.percentile(self._levels.window("height", coarsest.number, top=0, left=0, **size), 5))

    def _number(self, cell_size: float) -> int:
        finest = self._levels.finest.cell
        finer = int(np.floor(np.log2(max(cell_size, finest) / finest) + 1e-9))
        return min(finer, len(self._levels.world.levels) - 1)

    def _between(self, number: int, column: Floats, row: Floats) -> Floats:
        """Return heights at places in cells of a level."""
        if not column.size:
            return np.zeros(0)
        left, top = int(column.min()), int(row.min())
        columns, rows = int(column.max()) - left + 2, int(row.max()) - top + 2
        if rows * columns <= max(_AT_ONCE, _SPARSE * column.size):
            return self._within(number, column, row)
        # Far apart: chunk by chunk.
        block = (row // CHUNK).astype(np.int64) * (1 << 32) + (column // CHUNK).astype(np.int64)
        order = np.argsort(block, kind="stable")
        cuts = np.flatnonzero(np.diff(block[order])) + 1
        found = np.empty(column.size)
        for some in np.split(order, cuts):
            found[some] = self._within(number, column[some], row[some])
        return found

    def _within(self, number: int, column: Floats, row: Floats) -> Floats:
        i, j = column.astype(np.int64), row.astype(np.int64)
        left, top = int(i.min()), int(j.min())
        size = {"rows": int(j.max()) - top + 2, "columns": int(i.max()) - left + 2}
        h = self._levels.window("height", number, top=top, left=left, **size).astype(np.float64)
        u, v = column - i, row - j
        i, j = i - left, j - top
        north = h[j, i] * (1 - u) + h[j, i + 1] * u
        south = h[j + 1, i] * (1 - u) + h[j + 1, i + 1] * u
        return np.asarray(north * (1 - v) + south * v)
