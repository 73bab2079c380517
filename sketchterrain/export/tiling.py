"""Cutting a grid into tiles: how large they are, what they share, what they are called."""

from __future__ import annotations

import re
import string
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

from sketchterrain.errors import InputError, one_line

_FIELDS = ("name", "x", "y")
_LONGEST = 120  # letters of a name: what file systems allow, less an ending
_MOST = 1 << 16  # tiles
# What Windows allows in no file's name; folders would be another thing than names.
_FORBIDDEN = re.compile(r'[<>:"/\\|?*]|\.\.|^\.|[. ]$')


class Piece(NamedTuple):
    """One tile of a grid."""

    x: int  # its numbers, as in its name
    y: int
    left: int  # its first column and row in the whole grid
    top: int
    columns: int  # vertices
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

    def __post_init__(self) -> None:
        if self.columns < 1 or self.rows < 1 or self.columns * self.rows > _MOST:
            raise InputError(f"expected 1 to {_MOST} tiles, got {self.columns} × {self.rows}")
        if self.overlap < 0:
            raise InputError(f"expected an overlap of 0 or more vertices, got {self.overlap}")
        if self.first < 0:
            raise InputError(f"expected 0 or more as the first tile's number, got {self.first}")
        self._check_pattern()

    @property
    def count(self) -> int:
        """How many tiles there are."""
        return self.columns * self.rows

    def pieces(self, columns: int, rows: int) -> Iterator[Piece]:
        """Return the tiles of a grid of vertices, from the north-west, row by row."""
        width, height = self.side(columns, self.columns), self.side(rows, self.rows)
        return (
            Piece(
                x=self.first + column,
                y=self.first + (self.rows - 1 - row if self.from_south else row),
                left=column * (width - self.overlap),
                top=row * (height - self.overlap),
                columns=width,
                rows=height,
            )
            for row in range(self.rows)
            for column in range(self.columns)
        )

    def side(self, vertices: int, tiles: int) -> int:
        """Return how many vertices of a side each of its tiles has."""
        if tiles == 1:
            return vertices
        step, rest = divmod(vertices - self.overlap, tiles)
        if rest == 0 and step >= 1 and step + self.overlap >= 2:
            return step + self.overlap
        shared = {0: "nothing", 1: "an edge"}.get(self.overlap, f"{self.overlap} vertices")
        near = " or ".join(str(each) for each in self.nearest(vertices, tiles))
        raise InputError(
            f"{vertices} vertices cannot be cut into {tiles} equal tiles that share {shared}; nearest: {near}"
        )

    def whole(self, side: int, tiles: int) -> int:
        """Return how many vertices tiles with so many along a side have together."""
        return tiles * (side - self.overlap) + self.overlap if tiles > 1 else side

    def nearest(self, vertices: int, tiles: int) -> tuple[int, ...]:
        """Return the nearest numbers of vertices below and above (or itself) that can be cut into tiles."""
        if tiles == 1:
            return (vertices,)
        least = max(1, 2 - self.overlap)
        step = (vertices - self.overlap) // tiles
        below, above = (tiles * max(each, least) + self.overlap for each in (step, step + 1))
        return (vertices,) if below == vertices else tuple(sorted({below, above}))

    def name(self, name: str, piece: Piece) -> str:
        """Return a tile's name without its ending; `name` itself where there is one tile."""
        return name if self.count == 1 else self._named(name, piece.x, piece.y)

    def _named(self, name: str, x: int, y: int) -> str:
        return self.pattern.format(name=name, x=x, y=y)

    def _check_pattern(self) -> None:
        shown = one_line(self.pattern)
        try:
            parts = list(string.Formatter().parse(self.pattern))
        except ValueError as error:
            raise InputError(f"tile names {shown!r}: no pattern ({error})") from error
        for _, field, width, conversion in parts:
            if field is None:
                continue
            plain = not width or (field != "name" and re.fullmatch(r"0?[1-9]", width))
            if field not in _FIELDS or conversion or not plain:
                raise InputError(
                    f"tile names {shown!r}: expected only {{name}}, {{x}} and {{y}}, or with digits {{x:02}}"
                )
        fields = {field for _, field, _, _ in parts}
        if (self.columns > 1 and "x" not in fields) or (self.rows > 1 and "y" not in fields):
            raise InputError(f"tile names {shown!r}: expected {{x}} and {{y}}, else tiles have the same name")
        # Digits grow: both ends of the counting, so that no name in between is longer.
        last = self.first + max(self.columns, self.rows) - 1
        name = self._named("terrain", last, last)
        if _FORBIDDEN.search(name) or not name.isprintable() or len(name) > _LONGEST:
            raise InputError(
                f"tile names {shown!r}: expected what can be a file's name, got {one_line(name)!r}"
            )
        self._check_different(shown)

    def _check_different(self, shown: str) -> None:
        """{x}{y} calls tile 1, 11 and tile 11, 1 alike."""
        x, y = (range(self.first, self.first + count) for count in (self.columns, self.rows))
        names = {self._named("terrain", column, row).casefold() for column in x for row in y}
        if len(names) < self.count:
            raise InputError(f"tile names {shown!r}: two tiles would have the same name")
