"""Raster sources: their place in a metric coordinate system."""

from __future__ import annotations

from typing import Any, NamedTuple

from rasterio.warp import transform_bounds

from sketchterrain.document.rasters import RasterSource
from sketchterrain.elevation.pictures import WarpedPicture, picture_file
from sketchterrain.importing.vector_files import metric_crs_at
from sketchterrain.io.crs import crs_text, parse_crs


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
