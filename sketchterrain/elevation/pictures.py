"""Raster sources as pictures in a sketch."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, UInt8Array
from sketchterrain.document.rasters import RasterSource, raster_file, raster_problem
from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.raster_reader import PICTURES
from sketchterrain.errors import InputError

CANVAS: Final = 2048  # px of a picture along the sketch's longer side


class RasterPicture(NamedTuple):
    """A picture in a sketch."""

    pixels: npt.NDArray[np.uint8]  # (rows, columns, 4): sRGB and opacity, not premultiplied
    box: Bounds  # west, south, east, north, m from the sketch's south-west corner


class WarpedPicture:
    """A raster file in a CRS, which the child process of `raster_reader` reads.

    Its own CRS for None, local metres for an empty one. `given` is that of a file without one; a file
    without a place covers a box, west, south, width and height. Raise InputError if it cannot be read.
    """

    def __init__(
        self, path: Path, band: int, crs: str | None, given: str = "", covers: Bounds = (0.0, 0.0, 1.0, 1.0)
    ) -> None:
        self.path, self._request = path, {"band": band, "crs": crs, "given": given, "covers": covers}
        facts = self._ask("facts", 0)[0]
        rows, columns, bands, self._dtype, self.crs, self.box, self.step, *facts = facts
        self.shape, self._samples = (rows, columns), rows * columns * bands
        self.is_indexed, self.overviews = facts  # whether values are numbers of colours; steps of means

    def _ask(self, task: str, samples: int, size: int = 0, **more: Any) -> tuple[Any, bytearray]:
        return PICTURES.ask(self.path, {**self._request, "picture": task, **more}, samples, size)

    def value_range(self) -> tuple[float, float] | None:
        """Return the values that are black and white; None for bytes."""
        return None if self._dtype == "uint8" else tuple(self._ask("range", self._samples)[0])

    def write_overviews(self, path: Path) -> None:
        """Write a virtual copy of the file, with means of its pixels beside it."""
        self._ask("overviews", 4 * self._samples, copy=str(path))

    def pixels(
        self,
        box: Bounds,
        shape: tuple[int, int],
        *,
        span: tuple[float, float] | None = None,
        overview: int | None = None,
        coarse: bool = True,
    ) -> UInt8Array:
        """Return sRGB and opacity, (rows, columns, 4), in a box of the CRS: west, south, east, north.

        They are means of the pixels in them, of an overview if it is given; bilinear unless `coarse`. Other
        values than bytes are stretched over `span`, by default their range.
        """
        (west, south, east, north), (rows, columns) = box, shape
        place = (east - west) / columns, 0.0, west, 0.0, (south - north) / rows, north
        request = {"place": place, "shape": shape, "span": span, "overview": overview, "coarse": coarse}
        _, data = self._ask("pixels", self._samples, 4 * rows * columns, **request)
        return np.frombuffer(data, np.uint8).reshape(rows, columns, 4)


@contextmanager
def picture_file(source: RasterSource, what: str = "raster") -> Iterator[Path]:
    """Yield a source's file as `raster_file` does; raise InputError if it is missing."""
    if source.content is None and not Path(source.path).is_file():
        raise InputError(raster_problem(source, what))
    with raster_file(source, what) as path:
        yield path


def read_picture(source: RasterSource, sketch: Sketch, *, side: int = CANVAS) -> RasterPicture:
    """Return the part of a picture inside a sketch, with `side` px along the sketch's longer side.

    Without a georeference it covers the sketch; without a CRS its coordinates are those of the sketch's
    frame. Raise InputError if it cannot be read or has no place in the sketch.
    """
    frame, (width, height) = sketch.frame, sketch.size
    east, north = frame["east"], frame["north"]
    with picture_file(source) as path:
        picture = WarpedPicture(path, source.band, frame["crs"], covers=(east, north, width, height))
        low = np.maximum(np.subtract(picture.box[:2], (east, north)), 0.0)
        high = np.minimum(np.subtract(picture.box[2:], (east, north)), (width, height))
        if (low >= high).any():
            raise InputError("expected a picture inside the sketch, it lies outside of it")
        (left, bottom), (right, top) = low.tolist(), high.tolist()
        rows, columns = (max(round(side * each / sketch.extent), 1) for each in (top - bottom, right - left))
        box = east + left, north + bottom, east + right, north + top
        return RasterPicture(picture.pixels(box, (rows, columns)), (left, bottom, right, top))
