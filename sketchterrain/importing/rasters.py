"""Raster sources: their place in a metric coordinate system, and pictures resampled to a sketch."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio import CRS, DatasetReader, Env, MemoryFile
from rasterio._err import CPLE_BaseError
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import RasterioError
from rasterio.transform import from_bounds
from rasterio.vrt import WarpedVRT
from rasterio.warp import transform_bounds

from sketchterrain.document.rasters import RasterSource, raster_problem
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, one_line
from sketchterrain.importing.vector_files import metric_crs_at
from sketchterrain.io.crs import crs_text, parse_crs

_SIDE = 2048  # px of a picture along the sketch's longer side
_RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)


class RasterArea(NamedTuple):
    """The bounds of a georeferenced raster."""

    crs: str  # metric
    west: float  # m
    south: float
    east: float
    north: float

    @property
    def size(self) -> tuple[float, float]:
        """Metres eastward and northward."""
        return self.east - self.west, self.north - self.south

    @property
    def frame(self) -> dict[str, Any]:
        """Values by the names in `FRAME` of a sketch with the same south-west corner."""
        return {"crs": self.crs, "east": self.west, "north": self.south}


class RasterPicture(NamedTuple):
    """A picture in a sketch."""

    pixels: npt.NDArray[np.uint8]  # (rows, columns, 4): sRGB and opacity, not premultiplied
    box: tuple[float, float, float, float]  # west, south, east, north, m from the sketch's south-west corner


def raster_area(source: RasterSource) -> RasterArea | None:
    """Return the area of a raster, in a UTM zone unless its own CRS is metric; None without a CRS.

    Raise InputError if it cannot be read.
    """
    with _open(source) as file:
        if file.crs is None:
            return None
        west, south, east, north = _bounds(file)
        target = metric_crs_at(file.crs, (0.5 * (west + east), 0.5 * (south + north)))
        return RasterArea(crs_text(target), *transform_bounds(file.crs, target, west, south, east, north))


def read_picture(source: RasterSource, sketch: Sketch) -> RasterPicture:
    """Return the part of a picture inside a sketch, at the resolution of a canvas.

    Without a georeference it covers the sketch; without a CRS its coordinates are those of the sketch's
    frame. Raise InputError if it cannot be read or has no place in the sketch.
    """
    frame = sketch.frame
    with _open(source) as file, ExitStack() as stack:
        if file.crs is None and file.transform.is_identity:
            box = (0.0, 0.0, *sketch.size)
            rows, columns = _shape(box, sketch)
            bands, mask = _read(file, source.band, {"out_shape": (rows, columns)})
            return RasterPicture(_colours(file, source.band, bands, mask), box)
        if file.crs is not None and not frame["crs"]:
            raise InputError(f"{_place(source)}: expected a sketch with a CRS, [frame] has none")
        crs = parse_crs(frame["crs"]) if frame["crs"] else None
        bounds = _bounds(file)
        is_aligned = file.crs is None or file.crs == crs
        if not is_aligned:
            bounds = transform_bounds(file.crs, crs, *bounds)
        east, north = frame["east"], frame["north"]
        left, right = max(bounds[0] - east, 0.0), min(bounds[2] - east, sketch.size[0])
        bottom, top = max(bounds[1] - north, 0.0), min(bounds[3] - north, sketch.size[1])
        if left >= right or bottom >= top:
            raise InputError(f"{_place(source)}: expected a picture inside the sketch, it lies outside of it")
        box = left, bottom, right, top
        rows, columns = _shape(box, sketch)
        place = east + left, north + bottom, east + right, north + top
        at = file.transform
        if is_aligned and at.a > 0 and at.e < 0 and at.b == at.d == 0:
            window = file.window(*place)
            bands, mask = _read(file, source.band, {"window": window, "out_shape": (rows, columns)})
        else:
            warped = WarpedVRT(
                file,
                src_crs=file.crs or crs or _LOCAL,
                crs=crs or _LOCAL,
                transform=from_bounds(*place, columns, rows),
                width=columns,
                height=rows,
                add_alpha=ColorInterp.alpha not in file.colorinterp,
                resampling=_resampling(file, source.band),
            )
            bands, mask = _read(stack.enter_context(warped), source.band, {})
        return RasterPicture(_colours(file, source.band, bands, mask), box)


_LOCAL = CRS.from_wkt('LOCAL_CS["local",UNIT["metre",1]]')


def _place(source: RasterSource) -> str:
    return f"raster {one_line(source.path)}"


@contextmanager
def _open(source: RasterSource) -> Iterator[DatasetReader]:
    """Open a source's file; raise InputError if it, or what is read from it, is unreadable."""
    # GDAL would take names of files that do not exist for addresses.
    if source.content is None and not Path(source.path).is_file():
        raise InputError(raster_problem(source))
    try:
        with ExitStack() as stack, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a picture without a georeference
            stack.enter_context(Env())
            if source.content is None:
                file = stack.enter_context(rasterio.open(Path(source.path)))
            else:
                file = stack.enter_context(stack.enter_context(MemoryFile(source.content)).open())
            if source.band > file.count:
                raise InputError(f"{_place(source)}: band = {source.band}: expected 1 to {file.count}")
            yield file
    except (RasterioError, CPLE_BaseError, OSError, ValueError, MemoryError) as error:
        raise InputError(f"{_place(source)}: cannot be read as a raster ({one_line(error)[:160]})") from None


def _bounds(file: DatasetReader) -> tuple[float, float, float, float]:
    """Return west, south, east and north of a raster, which may be rotated."""
    at = file.transform
    corners = [(column, row) for column in (0, file.width) for row in (0, file.height)]
    x = [at.c + at.a * column + at.b * row for column, row in corners]
    y = [at.f + at.d * column + at.e * row for column, row in corners]
    return min(x), min(y), max(x), max(y)


def _shape(box: tuple[float, float, float, float], sketch: Sketch) -> tuple[int, int]:
    """Return the rows and columns of a picture in a box (m) of a sketch."""
    west, south, east, north = box
    rows, columns = (max(round(_SIDE * side / sketch.extent), 1) for side in (north - south, east - west))
    return rows, columns


def _is_rgb(file: DatasetReader, band: int) -> bool:
    return bool(file.dtypes[band - 1] == "uint8" and file.colorinterp[band - 1 : band + 2] == _RGB)


def _resampling(file: DatasetReader, band: int) -> Resampling:
    is_indexed = file.colorinterp[band - 1] == ColorInterp.palette
    return Resampling.nearest if is_indexed else Resampling.average


def _read(
    file: DatasetReader, band: int, where: dict[str, Any]
) -> tuple[npt.NDArray[Any], npt.NDArray[np.uint8]]:
    """Return the bands of a picture, (bands, rows, columns), and its opacity."""
    indexes = [band, band + 1, band + 2] if _is_rgb(file, band) else [band]
    bands = file.read(indexes, resampling=_resampling(file, band), **where)
    return bands, file.read_masks(indexes, **where).max(axis=0)


def _colours(
    file: DatasetReader, band: int, bands: npt.NDArray[Any], mask: npt.NDArray[np.uint8]
) -> npt.NDArray[np.uint8]:
    """Return sRGB and opacity, (rows, columns, 4), of bands in colour, of indices, or in grey."""
    if file.colorinterp[band - 1] == ColorInterp.palette:
        table = np.zeros((256, 4), np.uint8)
        for index, colour in file.colormap(band).items():
            table[index] = colour
        pixels: npt.NDArray[np.uint8] = table[bands[0].astype(np.uint8)]
        pixels[..., 3] = np.minimum(pixels[..., 3], mask)
        return pixels
    if bands.dtype != np.uint8:  # stretched over its range
        values = np.where((mask > 0) & np.isfinite(bands[0]), bands[0], np.nan).astype(np.float64)
        low, high = (np.nanmin(values), np.nanmax(values)) if np.isfinite(values).any() else (0.0, 1.0)
        grey = np.nan_to_num(255.0 * (values - low) / max(high - low, 1e-30))
        bands, mask = grey.astype(np.uint8)[None], np.where(np.isnan(values), np.uint8(0), mask)
    return np.concatenate([np.broadcast_to(bands, (3, *mask.shape)), mask[None]]).transpose(1, 2, 0).copy()
