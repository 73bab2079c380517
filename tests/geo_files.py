"""Rasters and vector maps, written as other programs do."""

import io
from pathlib import Path
from typing import Any

import numpy as np
import pyogrio
import rasterio
import shapely

DRIVERS = {
    ".fgb": "FlatGeobuf",
    ".gpkg": "GPKG",
    ".geojson": "GeoJSON",
    ".shp": "ESRI Shapefile",
    ".dxf": "DXF",
}


def write_raster(
    path: Path,
    bands: np.ndarray,
    transform: rasterio.Affine | None,
    crs: str | None = "EPSG:25832",
    **options: Any,
) -> Path:
    """Write a band (rows, columns) or several (n, rows, columns) as a GeoTIFF."""
    bands = bands.reshape(-1, *bands.shape[-2:])
    shape = dict(zip(("count", "height", "width"), bands.shape, strict=True))
    profile = {"driver": "GTiff", "dtype": bands.dtype, "crs": crs, "transform": transform}
    with rasterio.open(path, "w", **profile, **shape, **options) as file:
        file.write(bands)
    return path


def write_vectors(
    path: Path | io.BytesIO, shapes: Any, fields: dict[str, Any] | None = None, **options: Any
) -> Any:
    """Write shapes and columns of texts or numbers in the format of the name, or of memory: FlatGeobuf."""
    suffix = path.suffix if isinstance(path, Path) else ".fgb"
    kind = "LineString" if suffix in (".shp", ".dxf") else "Unknown"
    given = {"driver": DRIVERS[suffix], "geometry_type": kind, "crs": "EPSG:25832", **options}
    columns = [
        np.array(each, object if isinstance(each[0], str | None) else None)
        for each in (fields or {}).values()
    ]
    pyogrio.raw.write(path, shapely.to_wkb(np.array(shapes, object)), columns, list(fields or {}), **given)
    return path
