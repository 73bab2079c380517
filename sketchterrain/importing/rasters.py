"""Rasters: their place in a metric coordinate system, and heights with square cells."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from rasterio.warp import transform_bounds

from sketchterrain.array_types import Float64Array
from sketchterrain.document.rasters import RasterSource
from sketchterrain.elevation.grids import SketchFrame, read_grid
from sketchterrain.elevation.pictures import WarpedPicture, picture_file
from sketchterrain.importing.vector_files import metric_crs_at
from sketchterrain.io.crs import crs_text, parse_crs

_METRES_PER_DEGREE = 111_320.0


class RasterArea(NamedTuple):
    """The area of a georeferenced raster."""

    frame: dict[str, Any]  # of a sketch with the same south-west corner, by the names in `FRAME`
    size: tuple[float, float]  # m eastward and northward


def raster_area(source: RasterSource) -> RasterArea | None:
    """Return the area of a raster, in a UTM zone unless its own CRS is metric; None without a CRS.

    Raise InputError if it cannot be read.
    """
    with picture_file(source) as path:
        picture = WarpedPicture(path, source.band, None)
    if not picture.crs:
        return None
    (west, south, east, north), crs = picture.box, parse_crs(picture.crs)
    target = metric_crs_at(crs, (0.5 * (west + east), 0.5 * (south + north)))
    west, south, east, north = transform_bounds(crs, target, west, south, east, north)
    frame = {"crs": crs_text(target), "east": west, "north": south}
    return RasterArea(frame, (east - west, north - south))


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
