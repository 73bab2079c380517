"""Where a map of light lies: a square of texels of the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from sketchterrain.array_types import Bounds

BLOCK: Final = 64
"""Squares lie on whole blocks of so many texels, so that mipmaps of two squares agree where both lie."""

Rectangle = tuple[int, int, int, int]
"""The same in texels from the world's origin, east and north beyond the last."""
_WASTE: Final = 1.25
"""Rectangles become one where that is no more than so many times their texels."""


@dataclass(frozen=True)
class Square:
    """A square of texels, counted from the world's origin.

    Attributes
    ----------
    col, row : int
        Of its south-west texel.
    texels : int
        Along a side.
    texel : float
        Width of one (m).
    """

    col: int
    row: int
    texels: int
    texel: float

    @classmethod
    def around(cls, x: float, y: float, *, width: float, texels: int) -> Square:
        """Return the square of a width (m) whose middle is nearest to a place (m), on whole blocks."""
        block = BLOCK * width / texels
        col, row = (round((middle - 0.5 * width) / block) * BLOCK for middle in (x, y))
        return cls(col, row, texels, width / texels)

    @property
    def whole(self) -> Rectangle:
        """All its texels."""
        return self.col, self.row, self.col + self.texels, self.row + self.texels

    def texels_in(self, areas: Sequence[Bounds]) -> list[Rectangle]:
        """Return those of its texels that areas (m) meet."""
        found = []
        limits = np.array(self.whole, np.float64)
        beyond = np.array([0.0, 0.0, 1.0, 1.0])
        for area in areas:
            sides = np.floor(np.array(area) / self.texel) + beyond
            sides = np.clip(sides, limits[[0, 1, 0, 1]], limits[[2, 3, 2, 3]])
            west, south, east, north = (int(side) for side in sides)
            if west < east and south < north:
                found.append((west, south, east, north))
        return found

    @property
    def west(self) -> float:
        """Its corner (m)."""
        return self.col * self.texel

    @property
    def south(self) -> float:
        """Its corner (m)."""
        return self.row * self.texel

    @property
    def width(self) -> float:
        """Its side (m)."""
        return self.texels * self.texel


def place_in(square: Square, wider: Square) -> tuple[float, float, float, float]:
    """Return a square's corner and width in widths of a wider one, and its width (m)."""
    west, south = square.west - wider.west, square.south - wider.south
    return west / wider.width, south / wider.width, square.width / wider.width, square.width


def overlap(one: Rectangle, other: Rectangle) -> Rectangle | None:
    """Return what two rectangles have in common, None if that is nothing."""
    west, south, east, north = (
        max(one[0], other[0]),
        max(one[1], other[1]),
        min(one[2], other[2]),
        min(one[3], other[3]),
    )
    return (west, south, east, north) if west < east and south < north else None


def joined(rectangles: Sequence[Rectangle]) -> list[Rectangle]:
    """Return fewer rectangles that cover the same: those that overlap far enough are one."""
    found: list[Rectangle] = []
    for each in rectangles:
        both, again = each, True
        while again:
            again = False
            for other in found:
                around = _around(both, other)
                if _count(around) <= _WASTE * (_count(both) + _count(other)):
                    found.remove(other)
                    both, again = around, True
                    break
        found.append(both)
    return found


def _around(one: Rectangle, other: Rectangle) -> Rectangle:
    return min(one[0], other[0]), min(one[1], other[1]), max(one[2], other[2]), max(one[3], other[3])


def _count(rectangle: Rectangle) -> int:
    west, south, east, north = rectangle
    return (east - west) * (north - south)
