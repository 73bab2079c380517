"""Grids of vertices, and a terrain sampled at them as compactly as files hold it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.export.weights import quantised_weights

if TYPE_CHECKING:  # loads OpenCL
    from sketchterrain.terrain import Terrain
    from sketchterrain.terrain.answers import Band

Reals = npt.NDArray[np.float64]
BYTES_PER_VERTEX = 15
"""Of heights, normals and the weights of eight materials."""


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


@dataclass(frozen=True, eq=False)
class Sampled:
    """What is known at each vertex of a grid; row 0 is the north edge, column 0 the west one.

    Attributes
    ----------
    grid : Grid
    height : (rows, columns) float32
        m.
    normal : (rows, columns, 3) uint8
        East, north, up; 0 is −1, 255 is 1.
    weights : (rows, columns, materials) uint8
        Of the materials, in the terrain's order; they sum to 255 at each vertex.
    """

    grid: Grid
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.uint8]
    weights: npt.NDArray[np.uint8]

    def part(self, left: int, top: int, columns: int, rows: int) -> Sampled:
        """Return some of its vertices, from a column and a row on: views, no copies."""
        at = slice(top, top + rows), slice(left, left + columns)
        return Sampled(
            self.grid.part(left, top, columns, rows), self.height[at], self.normal[at], self.weights[at]
        )


def sample(terrain: Terrain, grid: Grid, *, progress: Callable[[float], None] | None = None) -> Sampled:
    """Evaluate a terrain at a grid's vertices, in bands: what is kept is 15 bytes a vertex.

    Parameters
    ----------
    terrain
    grid
    progress
        Called with the share that is done, 0 … 1.
    """
    shape = (grid.rows, grid.columns)
    sampled = Sampled(
        grid,
        np.empty(shape, np.float32),
        np.empty((*shape, 3), np.uint8),
        np.empty((*shape, len(terrain.material_names)), np.uint8),
    )
    with ThreadPoolExecutor(1, "sampled") as aside:  # the device goes on with the next band
        last: Future[None] | None = None
        for band in terrain.grid(*grid.area, columns=grid.columns, rows=grid.rows, progress=progress):
            if last is not None:
                last.result()
            last = aside.submit(_keep, sampled, band)
        if last is not None:
            last.result()
    return sampled


def _keep(sampled: Sampled, band: Band) -> None:
    rows = slice(band.top, band.top + len(band.height))
    sampled.height[rows] = band.height
    sampled.normal[rows] = normal_bytes(band.normal)
    sampled.weights[rows] = quantised_weights(band.materials)


def normal_bytes(normal: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return unit vectors as bytes: −1 is 0, 1 is 255."""
    whole: npt.NDArray[np.uint8] = np.rint(normal * np.float32(127.5) + np.float32(127.5)).astype(np.uint8)
    return whole


def ground_at(sampled: Sampled, east: Reals, north: Reals) -> Reals:
    """Return the ground between the vertices of a grid, by bilinear interpolation.

    A program's two triangles in a quad differ from that by a quarter of the quad's twist
    |h00 + h11 − h01 − h10| at most.
    """
    grid = sampled.grid
    dx, dy = grid.spacing
    left, across = _quad((east - grid.west) / dx, grid.columns)
    top, down = _quad((grid.north - north) / dy, grid.rows)
    height = sampled.height
    upper = _between(height[top, left], height[top, left + 1], across)
    lower = _between(height[top + 1, left], height[top + 1, left + 1], across)
    return _between(upper, lower, down)


def _quad(place: Reals, vertices: int) -> tuple[npt.NDArray[np.intp], Reals]:
    """Return the quad along one axis in which places lie, and how far in it, 0 … 1."""
    inside = np.clip(place, 0.0, vertices - 1.0)
    first = np.minimum(inside.astype(np.intp), vertices - 2)
    return first, inside - first


def _between(
    a: npt.NDArray[np.floating], b: npt.NDArray[np.floating], share: Reals
) -> npt.NDArray[np.float64]:
    return np.asarray(a * (1.0 - share) + b * share, np.float64)
