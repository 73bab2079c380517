"""Where an exported terrain is sampled: vertices of a grid over a rectangle of the world."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["Grid"]


@dataclass(frozen=True)
class Grid:
    """Vertices of a grid, its outermost ones on the rectangle's edges; row 0 is the north edge.

    Attributes
    ----------
    west, south, east, north : float
        m of the world.
    columns, rows : int
        Vertices, ≥ 2 each.
    """

    west: float
    south: float
    east: float
    north: float
    columns: int
    rows: int

    @property
    def spacing(self) -> tuple[float, float]:
        """Metres between columns and between rows."""
        return (self.east - self.west) / (self.columns - 1), (self.north - self.south) / (self.rows - 1)

    @property
    def area(self) -> tuple[float, float, float, float]:
        """West, south, east, north, m."""
        return self.west, self.south, self.east, self.north

    def part(self, left: int, top: int, columns: int, rows: int) -> Grid:
        """Return the grid of some of its vertices, from a column and a row on."""
        dx, dy = self.spacing
        west, north = self.west + left * dx, self.north - top * dy
        return Grid(west, north - (rows - 1) * dy, west + (columns - 1) * dx, north, columns, rows)
