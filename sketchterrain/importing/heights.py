"""Height rasters of elevation files, with square cells."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.document.rasters import RasterSource
from sketchterrain.elevation.grids import SketchFrame, read_grid
from sketchterrain.io.crs import parse_crs

_METRES_PER_DEGREE = 111_320.0


def read_heights(path: Path, cell: float | None = None) -> tuple[Float64Array, float]:
    """Return heights (rows, columns), m, north up, NaN where unknown, and the side of a cell, m.

    A raster in degrees is resampled along its rows to square cells. ``cell`` replaces the file's own cell
    size; a ``.npy`` file needs it.

    Raises
    ------
    InputError
        If the file cannot be read, has no heights, or no cell size is known.
    """
    grid = read_grid(path, SketchFrame("EPSG:4326"), RasterSource("file", cell=cell or 0.0)).held()
    a, b, _, d, e, f = grid.place
    height = grid.samples.astype(np.float64)[:: 1 if e < 0.0 else -1]
    width, depth = math.hypot(a, d), math.hypot(b, e)
    if grid.crs and parse_crs(grid.crs).is_geographic:
        latitude = f + 0.5 * e * (len(height) - 1)
        width *= _METRES_PER_DEGREE * math.cos(math.radians(latitude))
        depth *= _METRES_PER_DEGREE
    if abs(width / depth - 1.0) > 1e-3:
        at = np.arange(int((height.shape[1] - 1) * width / depth) + 1) * depth / width
        known = np.arange(height.shape[1])
        height = np.stack([np.interp(at, known, row) for row in height])
    return height, float(cell or depth)
