"""Raster pictures in a CRS: what the child process of `raster_reader` reads of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
import rasterio
import rasterio.shutil
from rasterio import Affine, DatasetReader, Env
from rasterio.crs import CRS
from rasterio.enums import ColorInterp, Resampling
from rasterio.vrt import WarpedVRT

from sketchterrain.array_types import UInt8Array
from sketchterrain.io.crs import crs_text, parse_crs

_LOCAL: Final = CRS.from_wkt('LOCAL_CS["local",UNIT["metre",1]]')  # of rasters and sketches without a CRS
_RGB = (ColorInterp.red, ColorInterp.green, ColorInterp.blue)
_SAMPLE, _SHARE = 512, (0.5, 99.5)  # px along the longer side; percentiles that are black and white


def answer(file: DatasetReader, request: dict[str, Any]) -> tuple[Any, ...]:
    """Return facts of a picture, the range of its values, pixels in a window, or build its overviews."""
    band, task = request["band"], request["picture"]
    if task == "facts":
        west, south, width, height = request["covers"]
        box, step = (west, south, west + width, south + height), min(width / file.width, height / file.height)
        if _has_place(file):
            with _warped(file, request) as warped:
                box, step = tuple(warped.bounds), min(warped.res)
        if not np.isfinite([*box, step]).all():
            raise ValueError("expected a place of finite numbers")
        facts = crs_text(file.crs), box, step, _is_indexed(file, band), file.overviews(band)
        return ((*file.shape, file.count, file.dtypes[band - 1], *facts),)
    if task in ("range", "overviews"):
        return (_range(file, band) if task == "range" else _build_overviews(file, request),)
    method = Resampling.average if request["coarse"] else Resampling.bilinear
    method = Resampling.nearest if _is_indexed(file, band) else method
    rows, columns = request["shape"]
    options = {"transform": Affine(*request["place"]), "width": columns, "height": rows}
    with _warped(file, request, resampling=method, **options) as warped:
        return {}, _pixels(warped, band, request["span"])


def _has_place(file: DatasetReader) -> bool:
    return file.crs is not None or not file.transform.is_identity


def _is_indexed(file: DatasetReader, band: int) -> bool:
    return bool(file.colorinterp[band - 1] == ColorInterp.palette)


def _colour_bands(file: DatasetReader, band: int) -> list[int]:
    """Return the bands of a picture from a band on: three in colour, one of indices or in grey."""
    is_rgb = file.colorinterp[band - 1 : band + 2] == _RGB
    return [band, band + 1, band + 2] if is_rgb else [band]


def _warped(file: DatasetReader, request: dict[str, Any], **options: Any) -> WarpedVRT:
    """Return a file in the CRS ``crs``; one without a place covers a box there."""
    given = file.crs or (parse_crs(request["given"]) if request["given"] else None)
    target = parse_crs(request["crs"]) if request["crs"] else (request["crs"] is None and given) or _LOCAL
    if given and request["crs"] == "":
        raise ValueError("expected a sketch with a CRS, [frame] has none")
    west, south, width, height = request["covers"]
    whole = Affine(width / file.width, 0.0, west, 0.0, -height / file.height, south + height)
    nodata = file.nodata
    if nodata is None and file.dtypes[request["band"] - 1].startswith("float"):
        nodata = np.nan
    has_mask = nodata is not None or ColorInterp.alpha in file.colorinterp
    return WarpedVRT(
        file,
        src_crs=(_has_place(file) and given) or target,
        src_transform=file.transform if _has_place(file) else whole,
        src_nodata=nodata,
        nodata=nodata,
        crs=target,
        add_alpha=not has_mask,
        warp_mem_limit=16,  # MB
        tolerance=0.05,
        **options,
    )


def _pixels(file: DatasetReader, band: int, span: list[float] | None) -> UInt8Array:
    """Return sRGB and opacity, (rows, columns, 4); values of other types than bytes fill a range (`span`)."""
    indexes = _colour_bands(file, band)
    bands = file.read(indexes)
    mask = file.read_masks(indexes).max(axis=0)
    if _is_indexed(file, band):
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


def _range(file: DatasetReader, band: int) -> tuple[float, float]:
    """Return the values that are black and white."""
    step = max(1.0, max(file.shape) / _SAMPLE)
    shape = tuple(max(1, int(side / step)) for side in file.shape)
    indexes = _colour_bands(file, band)
    found = np.ma.masked_invalid(file.read(indexes, out_shape=(len(indexes), *shape), masked=True))
    values = found.compressed().astype(np.float64)
    if not len(values):
        return 0.0, 1.0
    low, high = np.percentile(values, _SHARE)
    return float(low), float(high)


def _build_overviews(file: DatasetReader, request: dict[str, Any]) -> list[int]:
    """Write a virtual copy to a path, with means of the file's pixels beside it."""
    path = Path(request["copy"])
    factors = [2**k for k in range(2, 16) if max(file.shape) >> k >= 128]
    method = Resampling.nearest if _is_indexed(file, request["band"]) else Resampling.average
    rasterio.shutil.copy(file, path, driver="VRT")
    with Env(COMPRESS_OVERVIEW="DEFLATE"), rasterio.open(path, "r+", driver="VRT") as copy:
        copy.build_overviews(factors, method)
    return factors
