"""Sample grids, and a terrain sampled at their vertices in the precision of the files."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.export.weights import quantise_weights

if TYPE_CHECKING:  # loads OpenCL
    from sketchterrain.terrain import Terrain
    from sketchterrain.terrain.answers import Band

BYTES_PER_VERTEX = 15  # height, normal and eight material weights


@dataclass(frozen=True)
class SampleGrid:
    """A grid of vertices, the outermost ones on the rectangle's edges; row 0 is the north edge."""

    west: float  # m
    south: float
    east: float
    north: float
    columns: int  # vertices, ≥ 2
    rows: int

    @property
    def spacing(self) -> tuple[float, float]:
        """Metres between columns and between rows."""
        return (self.east - self.west) / (self.columns - 1), (self.north - self.south) / (self.rows - 1)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """West, south, east, north (m)."""
        return self.west, self.south, self.east, self.north

    def window(self, left: int, top: int, columns: int, rows: int) -> SampleGrid:
        """Return a part of the grid."""
        dx, dy = self.spacing
        west, north = self.west + left * dx, self.north - top * dy
        return SampleGrid(west, north - (rows - 1) * dy, west + (columns - 1) * dx, north, columns, rows)


@dataclass(frozen=True, eq=False)
class TerrainSamples:
    """Heights, normals and materials at the vertices of a grid."""

    grid: SampleGrid
    height: npt.NDArray[np.float32]  # (rows, columns), m
    normal: npt.NDArray[np.uint8]  # (rows, columns, 3): east, north, up; 0 is −1, 255 is 1
    weights: npt.NDArray[np.uint8]  # (rows, columns, materials), sum 255

    def window(self, left: int, top: int, columns: int, rows: int) -> TerrainSamples:
        """Return a part of the samples as views."""
        at = slice(top, top + rows), slice(left, left + columns)
        grid = self.grid.window(left, top, columns, rows)
        return TerrainSamples(grid, self.height[at], self.normal[at], self.weights[at])


def sample_terrain(
    terrain: Terrain, grid: SampleGrid, *, progress: Callable[[float], None] | None = None
) -> TerrainSamples:
    """Evaluate a terrain at a grid's vertices, in bands that are quantised at once."""
    shape = (grid.rows, grid.columns)
    samples = TerrainSamples(
        grid,
        np.empty(shape, np.float32),
        np.empty((*shape, 3), np.uint8),
        np.empty((*shape, len(terrain.material_names)), np.uint8),
    )
    with ThreadPoolExecutor(1, "quantise") as thread:  # meanwhile the device computes the next band
        last: Future[None] | None = None
        for band in terrain.grid(*grid.bounds, columns=grid.columns, rows=grid.rows, progress=progress):
            if last is not None:
                last.result()
            last = thread.submit(_store, samples, band)
        if last is not None:
            last.result()
    return samples


def _store(samples: TerrainSamples, band: Band) -> None:
    rows = slice(band.top, band.top + len(band.height))
    samples.height[rows] = band.height
    samples.normal[rows] = quantise_normals(band.normal)
    samples.weights[rows] = quantise_weights(band.materials)


def quantise_normals(normal: npt.NDArray[np.floating]) -> npt.NDArray[np.uint8]:
    """Return unit vectors as bytes: −1 is 0, 1 is 255."""
    whole: npt.NDArray[np.uint8] = np.rint(normal * np.float32(127.5) + np.float32(127.5)).astype(np.uint8)
    return whole


def interpolate_heights(samples: TerrainSamples, east: Float64Array, north: Float64Array) -> Float64Array:
    """Return heights between the vertices of a grid by bilinear interpolation.

    A program's two triangles in a quad differ from it by at most a quarter of the quad's twist
    |h00 + h11 − h01 − h10|.
    """
    grid = samples.grid
    dx, dy = grid.spacing
    left, across = _quad((east - grid.west) / dx, grid.columns)
    top, down = _quad((grid.north - north) / dy, grid.rows)
    height = samples.height
    upper = _mix(height[top, left], height[top, left + 1], across)
    lower = _mix(height[top + 1, left], height[top + 1, left + 1], across)
    return _mix(upper, lower, down)


def _quad(position: Float64Array, vertices: int) -> tuple[npt.NDArray[np.intp], Float64Array]:
    """Return the index of the quad along one axis, and the position within it, 0 … 1."""
    inside = np.clip(position, 0.0, vertices - 1.0)
    first = np.minimum(inside.astype(np.intp), vertices - 2)
    return first, inside - first


def _mix(a: npt.NDArray[np.floating], b: npt.NDArray[np.floating], share: Float64Array) -> Float64Array:
    return np.asarray(a * (1.0 - share) + b * share, np.float64)
