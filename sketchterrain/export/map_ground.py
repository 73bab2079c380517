"""What a map shows of a terrain: its heights, where water stands, what covers it, on one grid."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import gaussian_filter

from sketchterrain.terrain import MATERIALS

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.map_frame import Frame
    from sketchterrain.terrain import Terrain

    Floats = npt.NDArray[np.float32]

__all__ = ["MapGround", "sample_ground"]

STEP: Final = 0.2
"""mm of the sheet between samples."""
SMOOTH: Final = 0.5
"""mm of the sheet: the cell size of the heights that contours are drawn from."""
COVER: Final = 0.45
"""mm: how far materials are evened out, so that no speckles are left."""


@dataclass(frozen=True, eq=False)
class MapGround:
    """Samples of the ground at the vertices of a grid over the whole sketch, row 0 north.

    Attributes
    ----------
    spacing : (float, float)
        Metres between columns and between rows.
    fine : (rows, columns) float32
        Heights (m) with all that samples so far apart can carry.
    even : (rows, columns) float32
        Heights (m) at `cell_size`: smooth lines run along them.
    cell_size : float
        m.
    depth : (rows, columns) float32
        How deep the water of a lake is (m), negative where there is none.
    cover : (rows, columns, len(MATERIALS)) float32
        Weights of the materials, evened out.
    """

    spacing: tuple[float, float]
    fine: Floats
    even: Floats
    cell_size: float
    depth: Floats
    cover: Floats

    def metres(self, index: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        """Return the places x, y (m) of (n, 2) rows and columns."""
        rows = len(self.fine)
        x = index[:, 1] * self.spacing[0]
        y = (rows - 1 - index[:, 0]) * self.spacing[1]
        return np.stack([x, y], axis=-1)

    def share(self, *names: str) -> Floats:
        """Return the weight of some materials together, (rows, columns)."""
        return np.asarray(sum(self.cover[..., MATERIALS.index(name)] for name in names), np.float32)


def sample_ground(terrain: Terrain, frame: Frame) -> MapGround:
    """Sample a terrain as finely as its map shows it."""
    longer = max(frame.box[2:])
    raster = terrain.raster(max(round(longer / STEP), 64) + 1)
    rows, columns = raster.height.shape
    cell = SMOOTH / frame.metre
    x = np.arange(columns, dtype=np.float64) * raster.spacing[0]
    y = np.arange(rows, dtype=np.float64)[::-1] * raster.spacing[1]
    even = terrain.heights(x[None, :], y[:, None], cell_size=cell)
    sigma = COVER / STEP
    cover = np.empty_like(raster.materials)
    for material in range(cover.shape[-1]):
        gaussian_filter(raster.materials[..., material], sigma, output=cover[..., material])
    depth = _depth(terrain, even, x, y)
    return MapGround(raster.spacing, raster.height, even, cell, depth, cover)


def _depth(
    terrain: Terrain, ground: Floats, x: npt.NDArray[np.float64], y: npt.NDArray[np.float64]
) -> Floats:
    """Return how deep lakes are (m); off their painted shapes it falls with the distance."""
    depth = np.full(ground.shape, -1e6, np.float32)
    for lake in terrain.features.lakes:
        field = lake.shape
        column = (x - field.west) / field.spacing
        row = (y - field.south) / field.spacing
        of_x = np.flatnonzero((column >= 0) & (column <= field.inside.shape[1] - 1))
        of_y = np.flatnonzero((row >= 0) & (row <= field.inside.shape[0] - 1))
        if not of_x.size or not of_y.size:
            continue
        there = np.ix_(of_y, of_x)
        # A lake's water reaches no farther than two samples over its painted border.
        inside = _between(field.inside, row[of_y], column[of_x]) + 2.0 * field.spacing
        depth[there] = np.maximum(depth[there], np.minimum(lake.level - ground[there], inside))
    return depth


def _between(
    field: Floats, row: npt.NDArray[np.float64], column: npt.NDArray[np.float64]
) -> npt.NDArray[np.float64]:
    """Interpolate a field at rows and columns, (len(row), len(column))."""
    i = np.minimum(row.astype(np.intp), len(field) - 2)
    j = np.minimum(column.astype(np.intp), field.shape[1] - 2)
    v, u = (row - i)[:, None], (column - j)[None, :]
    upper = field[np.ix_(i, j)] * (1 - u) + field[np.ix_(i, j + 1)] * u
    lower = field[np.ix_(i + 1, j)] * (1 - u) + field[np.ix_(i + 1, j + 1)] * u
    return np.asarray(upper * (1 - v) + lower * v)
