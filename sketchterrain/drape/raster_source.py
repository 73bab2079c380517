"""Raster sources in a sketch's frame: windows of pixels at any resolution."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from sketchterrain.array_types import Bounds, UInt8Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.drapes import DrapedLayer, drape_problem
from sketchterrain.drape.vector_source import file_stamp, source_problem
from sketchterrain.elevation.pictures import WarpedPicture, picture_file
from sketchterrain.errors import InputError
from sketchterrain.features.levels import touch
from sketchterrain.io.disk_cache import stored_folder

_PLAIN: Final = 4096 * 4096  # px of a raster that needs no overviews
_MOST_KEPT: Final = 1 << 19  # px of a window that is kept
_VIRTUAL: Final = "raster.vrt"


class DrapedRaster:
    """A raster file by windows in metres of a sketch."""

    def __init__(
        self, layer: DrapedLayer, frame: Mapping[str, Any], size: tuple[float, float], memory: LRUCache
    ) -> None:
        """Open a file; raise InputError if it cannot be read or has no place in the sketch."""
        self._memory, self._corner = memory, (frame["east"], frame["north"])
        self._stamp, self._failure = file_stamp(layer.path), ""
        self._layer = layer.replace(sha256="") if drape_problem(layer) else layer
        options = frame["crs"], layer["crs"], (*self._corner, *size)
        with picture_file(layer.file, "draped layer") as path:
            self._picture = WarpedPicture(path, layer["band"], *options)
            self.pixel = self._picture.step
            self.box = np.array(self._picture.box) - [*self._corner, *self._corner]
            if math.prod(self._picture.shape) > _PLAIN and not self._picture.overviews:
                self._picture = WarpedPicture(self._with_overviews(layer), layer["band"], *options)
            self._span = self._picture.value_range()
        self._overviews = [1, *self._picture.overviews]

    def updated(self, layer: DrapedLayer) -> DrapedRaster:
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
        is_indexed = self._picture.is_indexed
        rows, columns = (side * (2 if is_indexed else 1) for side in shape)
        west, north = west + self._corner[0], north + self._corner[1]
        box = west, north - shape[0] * texel, west + shape[1] * texel, north
        coarse = texel > self.pixel * self._overviews[level]
        if problem := source_problem(self._layer, self._stamp):
            raise InputError(problem)
        with picture_file(self._layer.file, "draped layer"):
            found = self._picture.pixels(
                box, (rows, columns), span=self._span, overview=level - 1 if level else None, coarse=coarse
            )
        return _halved(found) if is_indexed else found

    def _with_overviews(self, layer: DrapedLayer) -> Path:
        """Return a virtual copy in the cache folder, with means of the file's pixels beside it."""
        path = Path(layer.path)
        facts = path.stat()
        key = f"{path.absolute()}\n{facts.st_size} {facts.st_mtime_ns} {layer['sha256']}"
        write = self._picture.write_overviews
        return stored_folder("overviews", key, lambda folder: write(folder / _VIRTUAL)) / _VIRTUAL


def _halved(pixels: UInt8Array) -> UInt8Array:
    """Return means of 2 × 2 pixels, weighted by their opacity."""
    quads = pixels.reshape(pixels.shape[0] // 2, 2, pixels.shape[1] // 2, 2, 4).astype(np.float32)
    share = quads[..., 3:].sum(axis=(1, 3))
    colour = (quads[..., :3] * quads[..., 3:]).sum(axis=(1, 3)) / np.maximum(share, 1.0)
    return np.asarray(np.rint(np.concatenate([colour, 0.25 * share], axis=-1)), np.uint8)
