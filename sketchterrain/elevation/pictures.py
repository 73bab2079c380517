"""Raster sources as pictures in a sketch."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
import rasterio
from rasterio import CRS, DatasetReader, Env, MemoryFile
from rasterio._err import CPLE_BaseError
from rasterio.enums import ColorInterp, Resampling
from rasterio.errors import RasterioError
from rasterio.vrt import WarpedVRT
from rasterio.windows import Window

from sketchterrain.document.rasters import RasterSource, raster_problem
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError, one_line
from sketchterrain.io.crs import parse_crs

CANVAS: Final = 2048  # px of a picture along the sketch's longer side
LOCAL_CRS: Final = CRS.from_wkt('LOCAL_CS["local",UNIT["metre",1]]')
"""That of rasters and sketches without one."""
_RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)


class RasterPicture(NamedTuple):
    """A picture in a sketch."""

    pixels: npt.NDArray[np.uint8]  # (rows, columns, 4): sRGB and opacity, not premultiplied
    box: tuple[float, float, float, float]  # west, south, east, north, m from the sketch's south-west corner


def read_picture(source: RasterSource, sketch: Sketch, *, side: int = CANVAS) -> RasterPicture:
    """Return the part of a picture inside a sketch, with `side` px along the sketch's longer side.

    Without a georeference it covers the sketch; without a CRS its coordinates are those of the sketch's
    frame. Raise InputError if it cannot be read or has no place in the sketch.
    """
    frame, (width, height) = sketch.frame, sketch.size
    with open_raster(source) as file:
        if file.crs is None and file.transform.is_identity:
            box = 0.0, 0.0, width, height
            return RasterPicture(read_pixels(file, source.band, _shape(box, sketch, side)), box)
        if file.crs is not None and not frame["crs"]:
            raise InputError(f"{_place(source)}: expected a sketch with a CRS, [frame] has none")
        target = parse_crs(frame["crs"]) if frame["crs"] else LOCAL_CRS
        has_mask = file.nodata is not None or ColorInterp.alpha in file.colorinterp
        options = {"resampling": _resampling(file, source.band), "add_alpha": not has_mask}
        with WarpedVRT(file, src_crs=file.crs or target, crs=target, **options) as warped:
            east, north, bounds = frame["east"], frame["north"], warped.bounds
            left, right = max(bounds.left - east, 0.0), min(bounds.right - east, width)
            bottom, top = max(bounds.bottom - north, 0.0), min(bounds.top - north, height)
            if left >= right or bottom >= top:
                raise InputError(
                    f"{_place(source)}: expected a picture inside the sketch, it lies outside of it"
                )
            box = left, bottom, right, top
            window = warped.window(east + left, north + bottom, east + right, north + top)
            return RasterPicture(read_pixels(warped, source.band, _shape(box, sketch, side), window), box)


def _place(source: RasterSource) -> str:
    return f"raster {one_line(source.path)}"


@contextmanager
def open_raster(source: RasterSource, what: str = "raster", **options: Any) -> Iterator[DatasetReader]:
    """Open a source's file; raise InputError if it, or what is read from it, is unreadable."""
    place = f"{what} {one_line(source.path)}"
    # GDAL would take names of files that do not exist for addresses.
    if source.content is None and not Path(source.path).is_file():
        raise InputError(raster_problem(source))
    try:
        with ExitStack() as stack, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of a picture without a georeference
            stack.enter_context(Env())
            if source.content is None:
                file = stack.enter_context(rasterio.open(Path(source.path), **options))
            else:
                file = stack.enter_context(stack.enter_context(MemoryFile(source.content)).open())
            if source.band > file.count:
                raise InputError(f"{place}: band = {source.band}: expected 1 to {file.count}")
            yield file
    except (RasterioError, CPLE_BaseError, OSError, ValueError, MemoryError) as error:
        raise InputError(f"{place}: cannot be read as a raster ({one_line(error)[:160]})") from None


def _shape(box: tuple[float, float, float, float], sketch: Sketch, side: int) -> tuple[int, int]:
    """Return the rows and columns of a picture in a box (m) of a sketch."""
    west, south, east, north = box
    rows, columns = (max(round(side * length / sketch.extent), 1) for length in (north - south, east - west))
    return rows, columns


def is_indexed(file: DatasetReader, band: int) -> bool:
    """Return whether a band's values are numbers of colours."""
    return bool(file.colorinterp[band - 1] == ColorInterp.palette)


def colour_bands(file: DatasetReader, band: int) -> list[int]:
    """Return the bands of a picture from a band on: three in colour, one of indices or in grey."""
    is_rgb = file.colorinterp[band - 1 : band + 2] == _RGB
    return [band, band + 1, band + 2] if is_rgb else [band]


def _resampling(file: DatasetReader, band: int) -> Resampling:
    return Resampling.nearest if is_indexed(file, band) else Resampling.average


def read_pixels(
    file: DatasetReader,
    band: int,
    shape: tuple[int, int],
    window: Window | None = None,
    span: tuple[float, float] | None = None,
) -> npt.NDArray[np.uint8]:
    """Return sRGB and opacity, (rows, columns, 4), of bands in colour, of indices, or in grey.

    Other values than bytes are stretched over a range, by default that of what is read.
    """
    indexes = colour_bands(file, band)
    bands = file.read(indexes, window=window, out_shape=shape, resampling=_resampling(file, band))
    mask = file.read_masks(indexes, window=window, out_shape=shape).max(axis=0)
    if is_indexed(file, band):
        table = np.zeros((256, 3), np.uint8)
        for index, colour in file.colormap(band).items():
            table[index] = colour[:3]
        bands = table[bands[0].astype(np.uint8)].transpose(2, 0, 1)
    elif bands.dtype != np.uint8:
        values = np.ma.masked_invalid(bands.astype(np.float64))
        values = np.ma.masked_where(np.broadcast_to(mask == 0, values.shape), values)
        low, high = span or ((values.min(), values.max()) if values.count() else (0.0, 1.0))
        scaled = np.clip(255.0 * (values - low) / max(high - low, 1e-30), 0.0, 255.0)
        bands = np.ma.filled(scaled, 0.0).astype(np.uint8)
        mask = np.where(np.ma.getmaskarray(values).all(axis=0), np.uint8(0), mask)
    return np.stack([*np.broadcast_to(bands, (3, *mask.shape)), mask], axis=-1)
