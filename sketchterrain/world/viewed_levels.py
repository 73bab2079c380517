"""Samples of a stored pyramid for whoever draws it: any window of any level, beyond its ends too."""

from __future__ import annotations

from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.errors import InputError
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.world.grid import CHUNK, Level

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.world.opening import StoredWorld

__all__ = ["BARE", "ViewedLevels"]

BARE: Final = "rock"
"""What ground is drawn as whose materials are not stored."""
_MOST_KEPT: Final = 2049
"""Vertices along a side of the coarsest level that may be kept in memory: others are thinned out of it."""


class ViewedLevels:
    """Windows of a stored world's levels; beyond its ends their outermost vertices go on.

    Levels that are coarser than the coarsest stored one have every second, fourth … vertex of it.

    Parameters
    ----------
    world : StoredWorld
    told : callable or None
        Given a line for each part that cannot be read; the next coarser level then stands in for it. None:
        that is an error.

    Raises
    ------
    InputError
        If it has a large grid without coarser ones, or materials of other names.
    """

    def __init__(self, world: StoredWorld, *, told: Callable[[str], None] | None = None) -> None:
        self.world = world
        self.told = told
        self._lines: set[str] = set()
        coarsest = world.levels[-1]
        if max(coarsest.rows, coarsest.columns) > _MOST_KEPT:
            raise InputError(
                f"expected coarser levels down to {_MOST_KEPT} vertices a side to view a world, "
                f"got none below {coarsest.columns}×{coarsest.rows}"
            )
        unknown = [name for name in world.material_names if name not in MATERIALS]
        if "materials" in world.layers and unknown:
            raise InputError(f"expected materials among {', '.join(MATERIALS)}, got {', '.join(unknown)}")
        self._kept: dict[str, npt.NDArray[Any]] = {}

    @property
    def finest(self) -> Level:
        """The level that knows most."""
        return self.world.levels[0]

    def level(self, number: int) -> Level:
        """Return a level, also one that is coarser than any stored one."""
        levels = self.world.levels
        if number < len(levels):
            return levels[number]
        last, step = levels[-1], 1 << (number - len(levels) + 1)
        return Level(
            number, last.cell * step, *(-(-(side - 1) // step) + 1 for side in (last.columns, last.rows))
        )

    def window(
        self, layer: str, number: int, *, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        """Return a window of a layer that may go beyond the level's ends.

        Parameters
        ----------
        layer
            One that is stored.
        number
            Of the level, ≥ 0.
        top, left, rows, columns
            The window, vertices.

        Returns
        -------
        ndarray
            As `StoredWorld.read` returns it.

        Raises
        ------
        InputError
            If some of it is missing or broken, and nobody is told.
        """
        level = self.level(number)
        down = np.clip(np.arange(top, top + rows), 0, level.rows - 1)
        across = np.clip(np.arange(left, left + columns), 0, level.columns - 1)
        first_row, first_column = int(down[0]), int(across[0])
        size = int(down[-1]) - first_row + 1, int(across[-1]) - first_column + 1
        if number >= len(self.world.levels):
            found, (down, across) = self._thinned(layer, number, down, across)
        else:
            found = self._read(layer, number, first_row, first_column, *size)
            down, across = down - first_row, across - first_column
        if found.shape[-2:] == (rows, columns) and size == (rows, columns):
            return found
        return np.asarray(found[..., down[:, None], across[None, :]])

    def _thinned(
        self, layer: str, number: int, down: npt.NDArray[np.intp], across: npt.NDArray[np.intp]
    ) -> tuple[npt.NDArray[Any], tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]]:
        """Return the coarsest stored level, and which of its vertices some of a coarser one's are."""
        last = self.world.levels[-1]
        if layer not in self._kept:
            self._kept[layer] = self._read(layer, last.number, 0, 0, last.rows, last.columns)
        step = 1 << (number - last.number)
        places = np.minimum(down * step, last.rows - 1), np.minimum(across * step, last.columns - 1)
        return self._kept[layer], places

    def _read(
        self, layer: str, number: int, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        """Read a window that lies inside; where nothing can be read, what is known more coarsely."""
        try:
            return self.world.read(layer, number, top=top, left=left, rows=rows, columns=columns)
        except InputError as error:
            if self.told is None:
                raise
            self._tell(str(error))
        whole = (rows, columns) if layer == "height" else (_bands(self.world, layer), rows, columns)
        found = np.zeros(whole, np.float32 if layer == "height" else np.uint8)
        # By chunks, so that a vertex is the same in whatever window it comes: else the ground would tear.
        for low, high in _parts(top, top + rows):
            for west, east in _parts(left, left + columns):
                found[..., low - top : high - top, west - left : east - left] = self._part(
                    layer, number, low, west, high - low, east - west
                )
        return found

    def _part(
        self, layer: str, number: int, top: int, left: int, rows: int, columns: int
    ) -> npt.NDArray[Any]:
        try:
            return self.world.read(layer, number, top=top, left=left, rows=rows, columns=columns)
        except InputError as error:
            self._tell(str(error))
        if number + 1 >= len(self.world.levels):
            whole = (rows, columns) if layer == "height" else (_bands(self.world, layer), rows, columns)
            return np.zeros(whole, np.float32 if layer == "height" else np.uint8)
        above = self._read(
            layer,
            number + 1,
            top // 2,
            left // 2,
            (top + rows) // 2 - top // 2 + 1,
            (left + columns) // 2 - left // 2 + 1,
        ).astype(np.float32)
        down, across = np.arange(top, top + rows), np.arange(left, left + columns)
        low, west = down // 2 - top // 2, across // 2 - left // 2
        high, east = low + (down & 1), west + (across & 1)
        middle = 0.5 * (above[..., low[:, None], west] + above[..., high[:, None], east])
        return middle if layer == "height" else middle.astype(np.uint8)

    def _tell(self, line: str) -> None:
        if line not in self._lines and self.told is not None:
            self._lines.add(line)
            self.told(line)


def _parts(first: int, last: int) -> list[tuple[int, int]]:
    """Return where chunks cut a run of vertices."""
    cuts = [first, *range((first // CHUNK + 1) * CHUNK, last, CHUNK), last]
    return list(pairwise(cuts))


def _bands(world: StoredWorld, layer: str) -> int:
    return 3 if layer == "normal" else len(world.material_names)
