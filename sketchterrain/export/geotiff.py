"""Heights as a GeoTIFF for GIS."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rasterio import Affine
from rasterio.crs import CRS
from rasterio.io import MemoryFile

from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from pathlib import Path

    from sketchterrain.terrain import Raster

__all__ = ["local_metres", "write_height_tif"]

_FLOAT_PREDICTOR = 3
_BLOCK = 256  # samples along the side of a TIFF tile
# Metres that lie nowhere on Earth: GIS programs then know the unit and ask for no place.
_LOCAL_METRES = (
    'LOCAL_CS["sketch, metres from its south-west corner",UNIT["metre",1],'
    'AXIS["Easting",EAST],AXIS["Northing",NORTH]]'
)


def local_metres() -> CRS:
    """Return the coordinate reference system of a sketch that lies nowhere on Earth."""
    return CRS.from_wkt(_LOCAL_METRES)


def write_height_tif(folder: Path, raster: Raster) -> tuple[Path, ...]:
    """Write ``height.tif``: float32 metres, north up, in a local system of metres.

    Samples are vertices (AREA_OR_POINT=Point): the file's tie point puts sample (0, 0) on the north-west
    vertex, x = 0, y = the sketch's length northward. GDAL's transform always speaks of pixel corners, so
    what a reader gets from it begins half a spacing further north-west.
    """
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
            # GDAL writes the tie point when the file is closed: by then the samples are points.
            file.update_tags(AREA_OR_POINT="Point")
            file.set_band_description(1, "height")
            file.set_band_unit(1, "m")
            file.write(raster.height, 1)
        content = memory.read()
    return (write_whole(folder / "height.tif", content),)
