"""Rasters as Cloud-Optimised GeoTIFF: tiled, with overviews, read in parts over a network."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from rasterio import Affine, Env
from rasterio.enums import ColorInterp
from rasterio.io import MemoryFile

from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    import numpy as np
    import numpy.typing as npt
    from rasterio.crs import CRS

    from sketchterrain.export.grid import Grid

__all__ = ["NO_DATA", "Place", "write_cloud_tiff"]

NO_DATA = -9999.0
"""What a height would be where there is none, m; there is one everywhere."""

_BLOCK = 256  # samples along the side of a TIFF tile
_RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)


class Place(NamedTuple):
    """Where the world's (0, 0), the sketch's south-west corner, lies in a coordinate reference system."""

    crs: CRS
    east: float
    north: float

    def transform(self, grid: Grid) -> Affine:
        """Return GDAL's transform for samples at a grid's vertices.

        It speaks of the corners of pixels, so it begins half a spacing north-west of the first vertex.
        """
        dx, dy = grid.spacing
        west, north = self.east + grid.west - 0.5 * dx, self.north + grid.north + 0.5 * dy
        return Affine(dx, 0.0, west, 0.0, -dy, north)


def write_cloud_tiff(
    path: Path,
    bands: Sequence[npt.NDArray[np.generic]],
    names: Sequence[str],
    *,
    grid: Grid,
    place: Place,
    unit: str | None = None,
    no_data: float | None = None,
    picture: bool = False,
) -> Path:
    """Write bands of one size and dtype as a Cloud-Optimised GeoTIFF.

    By the driver COG of GDAL (its documentation: "COG -- Cloud Optimized GeoTIFF generator"): deflated in
    blocks of 256 × 256, each overview the mean of what it covers. Samples are vertices
    (AREA_OR_POINT=Point). The same input gives the same bytes. What the bands take of memory is needed
    two more times at most, for GDAL's copy and for the file, which comes to the disk when it is whole.

    Parameters
    ----------
    path
    bands
        (rows, columns) each, float32 or uint8; row 0 is the north edge.
    names
        Of the bands.
    grid
        The vertices.
    place
    unit
        Of the values.
    no_data
        The value that means none.
    picture
        Whether three bands are red, green and blue.

    Raises
    ------
    SketchterrainError
        If the system cannot write the file.
    """
    rows, columns = bands[0].shape
    with Env(), MemoryFile() as memory:
        with memory.open(
            driver="COG",
            width=columns,
            height=rows,
            count=len(bands),
            dtype=bands[0].dtype.name,
            crs=place.crs,
            transform=place.transform(grid),
            nodata=no_data,
            compress="deflate",
            predictor="yes",  # the one for its dtype: differences of floats or of integers
            overview_resampling="average",
            blocksize=_BLOCK,
            num_threads="all_cpus",
            statistics="yes",
        ) as file:
            file.update_tags(AREA_OR_POINT="Point")
            if picture:
                file.colorinterp = _RGB
            for index, (band, name) in enumerate(zip(bands, names, strict=True), start=1):
                file.set_band_description(index, name)
                if unit is not None:
                    file.set_band_unit(index, unit)
                file.write(band, index)
        return write_whole(path, memory.getbuffer())
