"""A terrain at the vertices of a grid, as small as files hold it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.export.weights import quantised_weights

if TYPE_CHECKING:
    from collections.abc import Callable
    from concurrent.futures import Future

    import numpy.typing as npt

    from sketchterrain.export.grid import Grid
    from sketchterrain.terrain import Terrain
    from sketchterrain.terrain.answers import Band

__all__ = ["BYTES_PER_VERTEX", "Sampled", "normal_bytes", "sample"]

BYTES_PER_VERTEX = 15
"""Of heights, normals and the weights of eight materials."""


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
