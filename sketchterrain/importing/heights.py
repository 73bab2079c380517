"""Height rasters from GeoTIFFs and NumPy files, with square cells."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.errors import InputError, one_line

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
    if path.suffix.lower() == ".npy":
        try:
            height = np.load(path, allow_pickle=False)
        except (OSError, ValueError) as error:
            raise InputError(f"{one_line(path)}: expected a NumPy array ({one_line(error)})") from None
        if height.ndim != 2 or height.dtype.kind not in "fiu":
            raise InputError(f"{one_line(path)}: expected numbers (rows, columns), got {height.shape}")
        if cell is None:
            raise InputError(f"{one_line(path)}: a .npy file has no cell size, expected --cell")
        return height.astype(np.float64), cell
    import rasterio
    from rasterio.errors import RasterioError

    try:
        with rasterio.open(path) as file:
            height = file.read(1, masked=True).astype(np.float64).filled(np.nan)
            width, depth = file.res
            geographic = file.crs is not None and file.crs.is_geographic
            latitude = (file.bounds.top + file.bounds.bottom) / 2.0
    except (RasterioError, OSError) as error:
        raise InputError(f"{one_line(path)}: cannot be read ({one_line(error)})") from None
    if geographic:
        width, depth = (
            width * _METRES_PER_DEGREE * math.cos(math.radians(latitude)),
            depth * _METRES_PER_DEGREE,
        )
    if abs(width / depth - 1.0) > 1e-3:
        at = np.arange(int((height.shape[1] - 1) * width / depth) + 1) * depth / width
        known = np.arange(height.shape[1])
        height = np.stack([np.interp(at, known, row) for row in height])
    return height, float(cell or depth)
