"""Cutting a grid into tiles: how large they are, what they share, what they are called."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["Piece", "Tiling"]


class Piece(NamedTuple):
    """One tile of a grid.

    Attributes
    ----------
    x, y : int
        Its numbers, as its name has them.
    left, top : int
        Its first column and row in the whole grid.
    columns, rows : int
        Vertices.
    """

    x: int
    y: int
    left: int
    top: int
    columns: int
    rows: int


@dataclass(frozen=True)
class Tiling:
    """How a grid is cut.

    Attributes
    ----------
    columns, rows : int
        Tiles.
    overlap : int
        Vertices that neighbours share: 1 is a shared edge, 0 none.
    pattern : str
        Names with ``{name}``, ``{x}`` and ``{y}``; ``{x:02}`` is allowed.
    first : int
        Number of the first tile each way.
    from_south : bool
        Whether y counts from the southern row on.
    """

    columns: int = 1
    rows: int = 1
    overlap: int = 1
    pattern: str = "{name}_x{x}_y{y}"
    first: int = 0
    from_south: bool = False

    def pieces(self, columns: int, rows: int) -> Iterator[Piece]:
        """Return the tiles of a grid of vertices, from the north-west, row by row.

        Raises
        ------
        InputError
            If the grid cannot be cut into tiles of one size; with the nearest sizes that can.
        """
        raise NotImplementedError

    def name(self, name: str, piece: Piece) -> str:
        """Return a tile's name without its ending; `name` itself where there is one tile."""
        raise NotImplementedError
