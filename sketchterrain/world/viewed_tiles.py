"""Tiles as OpenGL draws them, out of a stored pyramid: their vertices are its samples."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.vertex_writer import geometric_error
from sketchterrain.terrain.vertices import VERTEX
from sketchterrain.world.viewed_levels import BARE, ViewedLevels

if TYPE_CHECKING:
    import numpy.typing as npt

__all__ = ["Facts", "ViewedTiles"]

_LENGTH: Final = 32767
"""Of a unit normal's part, as a slope."""
_HALF_STEP: Final = 1.0 / 255
"""A stored normal's parts are known to so much."""


class Facts(NamedTuple):
    """What is known of a tile besides: its lowest and highest height, own and parent's, and its error (m)."""

    low: float
    high: float
    error: float


class _Own(NamedTuple):
    """What a level holds at vertices."""

    height: npt.NDArray[np.float32]
    slope: npt.NDArray[np.int16]
    weights: npt.NDArray[np.uint8]


class ViewedTiles:
    """Makes tiles of a stored world.

    Vertex (0, 0) of every level lies at one place; a tile of `quads` quads in column c and row −1 − r, rows
    northward, begins at the level's vertex (r·quads, c·quads). A parent's values between its vertices are
    half the sum along its edges, or its diagonals from north-west to south-east, as in a terrain's own tiles
    (kernels/vertices.clh).

    Parameters
    ----------
    levels : ViewedLevels
    """

    def __init__(self, levels: ViewedLevels) -> None:
        self._levels = levels
        world = levels.world
        self._bands = [MATERIALS.index(name) for name in world.material_names]
        self._has = {layer: layer in world.layers for layer in ("normal", "materials")}

    def tile(
        self, number: int, column: int, row: int, *, quads: int, root: bool
    ) -> tuple[npt.NDArray[np.void], Facts]:
        """Return a tile's vertices and what is known of it.

        Parameters
        ----------
        number
            Of the level whose vertices it has.
        column, row
            Eastward and northward.
        quads
            Along its side: even.
        root
            Whether it is its own parent.

        Returns
        -------
        tile : structured ndarray, shape (quads + 1, quads + 1)
            Of `~sketchterrain.terrain.vertices.VERTEX`.
        facts : Facts

        Raises
        ------
        InputError
            If some of it cannot be read.
        """
        side = quads + 1
        top, left = -(row + 1) * quads, column * quads
        own = self._own(number, top, left, side)
        tile = np.empty((side, side), VERTEX)
        tile["height"], tile["slope"], tile["weights"] = own
        above = own if root else _between(self._own(number + 1, top // 2, left // 2, quads // 2 + 1))
        tile["parent_height"], tile["parent_slope"], tile["parent_weights"] = above
        low = min(float(own.height.min()), float(above.height.min()))
        high = max(float(own.height.max()), float(above.height.max()))
        return tile, Facts(low, high, self._error(number, top, left, own.height))

    def _own(self, number: int, top: int, left: int, side: int) -> _Own:
        levels = self._levels
        around = {"top": top - 1, "left": left - 1, "rows": side + 2, "columns": side + 2}
        height = levels.window("height", number, **around)
        level = levels.level(number)
        south, east = _apart(top, side, level.rows), _apart(left, side, level.columns)
        cell = np.float32(level.cell)
        dx = (height[1:-1, 2:] - height[1:-1, :-2]) / (cell * east)
        dy = (height[:-2, 1:-1] - height[2:, 1:-1]) / (cell * south)[:, None]
        length = 1.0 / np.sqrt(1.0 + (dx * dx + dy * dy))
        normal = np.stack([-dx * length, -dy * length], axis=-1)
        inside = {"top": top, "left": left, "rows": side, "columns": side}
        if self._has["normal"]:
            # Heights tell slopes more finely than eight bits, but for heights that are rounded.
            stored = (
                levels.window("normal", number, **inside)[:2].transpose(1, 2, 0) * np.float32(1 / 127.5) - 1
            )
            normal = np.clip(normal, stored - np.float32(_HALF_STEP), stored + np.float32(_HALF_STEP))
        slope = np.rint(np.clip(normal, -1, 1) * np.float32(_LENGTH)).astype(np.int16)
        weights = np.zeros((side, side, len(MATERIALS)), np.uint8)
        if self._has["materials"]:
            weights[..., self._bands] = levels.window("materials", number, **inside).transpose(1, 2, 0)
        else:
            weights[..., MATERIALS.index(BARE)] = 255
        return _Own(np.ascontiguousarray(height[1:-1, 1:-1]), slope, weights)

    def _error(self, number: int, top: int, left: int, height: npt.NDArray[np.float32]) -> float:
        """Return δ of a tile (m): how far the finest level is from its triangles.

        Only the next finer level is looked at. From level to level the steps become smaller, by half where
        the ground is as rough as most is: all together they come to no more than twice the first.
        """
        if number == 0:
            return 0.0
        quads = len(height) - 1
        finer = self._levels.window(
            "height",
            number - 1,
            top=2 * top + 1,
            left=2 * left + 1,
            rows=2 * quads - 1,
            columns=2 * quads - 1,
        )[::2, ::2]
        apart = np.abs(finer - 0.5 * (height[:-1, :-1] + height[1:, 1:]))
        there = self._levels.level(number - 1)
        inside = apart[: max((there.rows - 2 * top) // 2, 0), : max((there.columns - 2 * left) // 2, 0)]
        if not inside.size:
            return 0.0
        steps = 2.0 * (1.0 - 0.5**number)
        return steps * float(geometric_error(inside.reshape(1, -1))[0])


def _apart(first: int, count: int, whole: int) -> npt.NDArray[np.float32]:
    """Return how many cells the two neighbours of each vertex are apart: fewer at an end, never none."""
    at = np.arange(first - 1, first + count + 1).clip(0, whole - 1)
    return np.asarray(np.maximum(at[2:] - at[:-2], 1), np.float32)


def _between(parent: _Own) -> _Own:
    """Return what a parent's vertices make of it twice as densely."""
    first, second = _shared(2 * len(parent.height) - 1)

    def both(values: npt.NDArray[Any]) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]:
        return values[first].astype(np.int32), values[second].astype(np.int32)

    a, b = both(parent.slope)
    slope = ((a + b + 1) >> 1).astype(np.int16)
    a, b = both(parent.weights)
    weights = ((a + b + 1) >> 1).astype(np.uint8)
    height: npt.NDArray[np.float32] = np.float32(0.5) * (parent.height[first] + parent.height[second])
    return _Own(height, slope, weights)


@cache
def _shared(side: int) -> tuple[tuple[npt.NDArray[np.intp], ...], tuple[npt.NDArray[np.intp], ...]]:
    """Return rows and columns of the two of a parent's vertices that make each of a tile's."""
    row, column = np.indices((side, side))
    return (row >> 1, column >> 1), ((row >> 1) + (row & 1), (column >> 1) + (column & 1))
