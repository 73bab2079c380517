"""Raster sources in a sketch's frame: windows of pixels at any resolution."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import rasterio
import rasterio.shutil
from rasterio import DatasetReader, Env
from rasterio.enums import ColorInterp, Resampling
from rasterio.transform import Affine
from rasterio.vrt import WarpedVRT

from sketchterrain.array_types import Bounds, UInt8Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import DrapedLayer, drape_problem
from sketchterrain.drape.levels import touch
from sketchterrain.drape.vector_source import file_stamp, source_problem
from sketchterrain.elevation.pictures import LOCAL_CRS, colour_bands, is_indexed, open_raster, read_pixels
from sketchterrain.errors import InputError, one_line
from sketchterrain.io.crs import parse_crs
from sketchterrain.io.disk_cache import stored_folder

_PLAIN: Final = 4096 * 4096  # px of a raster that needs no overviews
_SAMPLE: Final = 512  # px along the longer side of what a range of values is taken from
_SHARE: Final = (0.5, 99.5)  # percentiles of values that are black and white
_ENV: Final = {"GDAL_CACHEMAX": 32 << 20}
_MOST_KEPT: Final = 1 << 19  # px of a window that is kept
_WARP_MB: Final = 16
_VIRTUAL: Final = "raster.vrt"


class RasterSource:
    """A raster file by windows in metres of a sketch."""

    def __init__(
        self, layer: DrapedLayer, frame: Mapping[str, Any], size: tuple[float, float], memory: LRUCache
    ) -> None:
        """Open a file; raise InputError if it cannot be read or has no place in the sketch."""
        place, self._band, self._memory = f"draped layer {one_line(layer.path)}", layer["band"], memory
        self._corner, self._covered = (frame["east"], frame["north"]), size
        self._target = parse_crs(frame["crs"]) if frame["crs"] else LOCAL_CRS
        self._path, self._stamp = Path(layer.path), file_stamp(layer.path)
        self._layer = layer.replace(sha256="") if drape_problem(layer) else layer
        self._failure = ""
        with self._opened(None) as file:
            given = file.crs or (parse_crs(layer["crs"]) if layer["crs"] else None)
            if given is not None and not frame["crs"]:
                raise InputError(f"{place}: expected a sketch with a CRS, [frame] has none")
            self._has_place = file.crs is not None or not file.transform.is_identity
            self._crs = (self._has_place and given) or self._target
            with self._warped(file) as warped:
                self.pixel = float(min(warped.res))
                self.box = np.array([*warped.bounds]) - [*self._corner, *self._corner]
            if not self._has_place:  # it covers the sketch
                self.pixel = min(size[0] / file.width, size[1] / file.height)
                self.box = np.array([0.0, 0.0, *size])
            if file.width * file.height > _PLAIN and not file.overviews(self._band):
                self._path = self._with_overviews(layer, file)
            self._span = self._range(file)
        with self._opened(None) as file:
            self._overviews = [1, *file.overviews(self._band)]

    def updated(self, layer: DrapedLayer) -> RasterSource:
        """Return the same source: layers do not edit pixels."""
        return self

    def problem(self, layer: DrapedLayer) -> str:
        """Return in one line that the file is missing, has changed or cannot be read; empty if neither."""
        return source_problem(layer, self._stamp) or self._failure

    def occupies(self, box: Bounds) -> bool:
        """Return whether it has pixels in a box (m)."""
        return bool(touch(self.box[None], box)[0])

    def pixels(self, west: float, north: float, texel: float, columns: int, rows: int) -> UInt8Array:
        """Return sRGB and opacity, (rows, columns, 4), of texels (m) from a north-west corner (m).

        They are means of the pixels in them, clear where the file can no longer be read, as `problem` says.
        """
        east, south = west + columns * texel, north - rows * texel
        if west >= self.box[2] or east <= self.box[0] or south >= self.box[3] or north <= self.box[1]:
            return np.zeros((rows, columns, 4), np.uint8)
        key = self, west, north, texel, columns, rows
        try:
            if rows * columns > _MOST_KEPT:
                return self._read(west, north, texel, (rows, columns))
            return self._memory.get_or_compute(key, lambda: self._read(west, north, texel, (rows, columns)))
        except InputError as error:
            self._failure = str(error)
            return np.zeros((rows, columns, 4), np.uint8)

    def _read(self, west: float, north: float, texel: float, shape: tuple[int, int]) -> UInt8Array:
        level = max(k for k, each in enumerate(self._overviews) if k == 0 or each * self.pixel <= texel)
        with self._opened(level - 1 if level else None) as file:
            finer = 2 if is_indexed(file, self._band) else 1
            rows, columns = shape[0] * finer, shape[1] * finer
            step = texel / finer
            window = Affine(step, 0.0, west + self._corner[0], 0.0, -step, north + self._corner[1])
            coarse = texel > self.pixel * self._overviews[level]
            method = Resampling.average if coarse else Resampling.bilinear
            method = Resampling.nearest if finer > 1 else method
            options = {"transform": window, "width": columns, "height": rows, "resampling": method}
            with self._warped(file, **options) as warped:
                found = read_pixels(warped, self._band, (rows, columns), span=self._span)
        return _halved(found) if finer > 1 else found

    @contextmanager
    def _opened(self, overview: int | None) -> Iterator[DatasetReader]:
        """Open the file or one of its overviews."""
        if problem := source_problem(self._layer, self._stamp):  # GDAL would take other names for addresses
            raise InputError(problem)
        options = {} if overview is None else {"OVERVIEW_LEVEL": overview}
        source = replace(self._layer.file, path=str(self._path), band=self._band)
        with Env(**_ENV), open_raster(source, "draped layer", **options) as file:
            yield file

    def _warped(self, file: DatasetReader, **options: Any) -> WarpedVRT:
        """Return a file in the frame's CRS."""
        (west, south), (width, height) = self._corner, self._covered
        whole = Affine(width / file.width, 0.0, west, 0.0, -height / file.height, south + height)
        nodata = file.nodata
        if nodata is None and file.dtypes[self._band - 1].startswith("float"):
            nodata = np.nan
        has_mask = nodata is not None or ColorInterp.alpha in file.colorinterp
        return WarpedVRT(
            file,
            src_crs=self._crs,
            src_transform=file.transform if self._has_place else whole,
            src_nodata=nodata,
            nodata=nodata,
            crs=self._target,
            add_alpha=not has_mask,
            warp_mem_limit=_WARP_MB,
            tolerance=0.05,
            **options,
        )

    def _range(self, file: DatasetReader) -> tuple[float, float] | None:
        """Return the values that are black and white; None for bytes."""
        if file.dtypes[self._band - 1] == "uint8":
            return None
        step = max(1.0, max(file.shape) / _SAMPLE)
        shape = tuple(max(1, int(side / step)) for side in file.shape)
        indexes = colour_bands(file, self._band)
        found = np.ma.masked_invalid(file.read(indexes, out_shape=(len(indexes), *shape), masked=True))
        values = found.compressed().astype(np.float64)
        if not len(values):
            return 0.0, 1.0
        low, high = np.percentile(values, _SHARE)
        return float(low), float(high)

    def _with_overviews(self, layer: DrapedLayer, file: DatasetReader) -> Path:
        """Return a virtual copy in the cache folder, with means of the file's pixels beside it."""
        facts = self._path.stat()
        key = f"{self._path.absolute()}\n{facts.st_size} {facts.st_mtime_ns} {layer['sha256']}"
        factors = [2**k for k in range(2, 16) if max(file.shape) >> k >= 128]
        method = Resampling.nearest if is_indexed(file, self._band) else Resampling.average

        def build(folder: Path) -> None:
            rasterio.shutil.copy(file, folder / _VIRTUAL, driver="VRT")
            with Env(**_ENV, COMPRESS_OVERVIEW="DEFLATE"), rasterio.open(folder / _VIRTUAL, "r+") as copy:
                copy.build_overviews(factors, method)

        return stored_folder("overviews", key, build) / _VIRTUAL


def _halved(pixels: UInt8Array) -> UInt8Array:
    """Return means of 2 × 2 pixels, weighted by their opacity."""
    quads = pixels.reshape(pixels.shape[0] // 2, 2, pixels.shape[1] // 2, 2, 4).astype(np.float32)
    share = quads[..., 3:].sum(axis=(1, 3))
    colour = (quads[..., :3] * quads[..., 3:]).sum(axis=(1, 3)) / np.maximum(share, 1.0)
    return np.asarray(np.rint(np.concatenate([colour, 0.25 * share], axis=-1)), np.uint8)
