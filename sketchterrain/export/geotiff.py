"""GeoTIFF of heights, and Cloud-Optimised GeoTIFF of any rasters: tiled, with overviews, for GIS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt
from rasterio import Affine, Env
from rasterio.crs import CRS
from rasterio.enums import ColorInterp
from rasterio.io import MemoryFile

from sketchterrain.export.sampled import SampleGrid
from sketchterrain.whole_files import write_atomic

if TYPE_CHECKING:  # loads OpenCL
    from sketchterrain.terrain import Raster


NO_DATA = -9999.0  # m, of a missing height; none is missing

_FLOAT_PREDICTOR = 3
_BLOCK = 256  # samples along the side of a TIFF tile
# GIS programs then know the unit and do not ask for a CRS.
_LOCAL_METRES = (
    'LOCAL_CS["sketch, metres from its south-west corner",UNIT["metre",1],'
    'AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)
_RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)


def local_metres() -> CRS:
    """Return the coordinate reference system of a sketch without georeference."""
    return CRS.from_wkt(_LOCAL_METRES)


class Georeference(NamedTuple):
    """Position of the sketch's south-west corner, (0, 0), in a coordinate reference system."""

    crs: CRS
    east: float
    north: float

    def transform(self, grid: SampleGrid) -> Affine:
        """Return GDAL's transform for samples at a grid's vertices.

        It refers to the corners of pixels, so it starts half a spacing north-west of the first vertex.
        """
        dx, dy = grid.spacing
        west, north = self.east + grid.west - 0.5 * dx, self.north + grid.north + 0.5 * dy
        return Affine(dx, 0.0, west, 0.0, -dy, north)


def write_height_tif(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``height.tif``: float32 metres, north up, in local metres, samples at vertices (Point)."""
    dx, dy = raster.spacing
    rows, columns = raster.height.shape
    corner = Affine(dx, 0.0, -0.5 * dx, 0.0, -dy, (rows - 1) * dy + 0.5 * dy)
    with MemoryFile() as memory:
        with memory.open(
            driver="GTiff",
            width=columns,
            height=rows,
            count=1,
            dtype="float32",
            crs=local_metres(),
            transform=corner,
            compress="deflate",
            predictor=_FLOAT_PREDICTOR,
            tiled=True,
            blockxsize=_BLOCK,
            blockysize=_BLOCK,
        ) as file:
            # GDAL writes the tie point on closing: for points it is the north-west vertex.
            file.update_tags(AREA_OR_POINT="Point")
            file.set_band_description(1, "height")
            file.set_band_unit(1, "m")
            file.write(raster.height, 1)
        content = memory.read()
    return (write_atomic(folder / "height.tif", content),)


def write_cloud_tiff(
    path: Path,
    bands: Sequence[npt.NDArray[np.generic]],
    names: Sequence[str],
    *,
    grid: SampleGrid,
    georeference: Georeference,
    unit: str | None = None,
    no_data: float | None = None,
    rgb: bool = False,
) -> Path:
    """Write bands of one size and dtype as a Cloud-Optimised GeoTIFF, samples at vertices (Point).

    By GDAL's driver COG: deflated blocks of 256 × 256, overviews by averaging. Deterministic. Needs twice the
    memory of the bands: for GDAL's copy and for the file.
    """
    rows, columns = bands[0].shape
    with Env(), MemoryFile() as memory:
        with memory.open(
            driver="COG",
            width=columns,
            height=rows,
            count=len(bands),
            dtype=bands[0].dtype.name,
            crs=georeference.crs,
            transform=georeference.transform(grid),
            nodata=no_data,
            compress="deflate",
            predictor="yes",  # the one for its dtype: differences of floats or of integers
            overview_resampling="average",
            blocksize=_BLOCK,
            num_threads="all_cpus",
            statistics="yes",
        ) as file:
            file.update_tags(AREA_OR_POINT="Point")
            if rgb:
                file.colorinterp = _RGB
            for index, (band, name) in enumerate(zip(bands, names, strict=True), start=1):
                file.set_band_description(index, name)
                if unit is not None:
                    file.set_band_unit(index, unit)
                file.write(band, index)
        return write_atomic(path, memory.getbuffer())
