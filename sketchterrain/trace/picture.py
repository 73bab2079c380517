"""Kinds of files that can be traced, by their first bytes; pictures (PNG, JPEG, TIFF, WebP)."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps
from PIL.ImageFile import ImageFile
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.TiffImagePlugin import TiffImageFile
from PIL.WebPImagePlugin import WebPImageFile

from sketchterrain.errors import InputError, one_line
from sketchterrain.sketch.wording import format_value

Kind = Literal["folder", "picture", "open raster", "vectors"]

_LARGEST_SIDE = 32768
_LARGEST_PIXELS = 1 << 27

_READERS: dict[str, type[ImageFile]] = {
    "PNG": PngImageFile,
    "JPEG": JpegImageFile,
    "TIFF": TiffImageFile,
    "WebP": WebPImageFile,
}
_COLOURLESS = 8  # levels of sRGB that JPEG makes a grey's channels differ by
_ROWS = 512  # looked at together
_DEEP = ("I;16", "I;16L", "I;16B", "I;16N")
_BROKEN = (
    *(OSError, SyntaxError, ValueError, EOFError, LookupError, TypeError, OverflowError, RuntimeError),
    *(zlib.error, struct.error, Image.DecompressionBombError),
)
_EXPECTED = (
    "expected a PNG, JPEG, TIFF or WebP picture, an OpenRaster file (.ora), a folder of pictures, "
    "or vectors (GeoJSON, GeoPackage, FlatGeobuf, Shapefile, OSM PBF)"
)
_REFUSED = (
    (b"gimp xcf", "a GIMP file", "in GIMP, File ▸ Export As, name.ora"),
    (b"8BPS", "a Photoshop file", "save its layers as OpenRaster (.ora), in Krita or GIMP"),
)
# First bytes of vector formats and GDAL's driver that reads them.
_VECTORS = {b"SQLite format 3\0": "GPKG", b"fgb\x03": "FlatGeobuf", b"\0\0\x27\x0a": "ESRI Shapefile"}
_BLANK = b"\xef\xbb\xbf \t\r\n"  # may precede JSON
_STARTS = 4096  # bytes


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture: sRGB and opacity, uint8 (height, width, 4), row 0 at the top.

    `see_through`: some of it is more than half transparent; `is_grey`: it has no colours but greys.
    """

    rgba: npt.NDArray[np.uint8]
    see_through: bool
    is_grey: bool


def kind_of(path: Path) -> Kind:
    """Return the kind of file at a path; raise `InputError` if it cannot be traced."""
    place = one_line(path)
    try:
        if path.is_dir():
            return "folder"
        if not path.exists():
            raise InputError(f"{place} is not there: {_EXPECTED}")
        if not path.is_file():
            raise InputError(f"{place} is no file: {_EXPECTED}")
        with path.open("rb") as stream:
            start = stream.read(_STARTS)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None
    if kind_of_picture(start):
        return "picture"
    if start.startswith(b"PK"):
        return "open raster"
    for magic, what, instead in _REFUSED:
        if start.startswith(magic):
            raise InputError(f"{place} is {what}: {instead}")
    if vector_driver(start) is not None:
        return "vectors"
    begins = f"begins with {format_value(start[:12])}" if start else "is empty"
    raise InputError(f"{place} {begins}: {_EXPECTED}")


def vector_driver(start: bytes) -> str | None:
    """Return GDAL's driver for a vector file that begins with these bytes, or None."""
    if start.lstrip(_BLANK).startswith(b"{"):
        return "GeoJSON"
    if start[4:15] == b"\n\tOSMHeader":
        return "OSM"
    return next((driver for magic, driver in _VECTORS.items() if start.startswith(magic)), None)


def kind_of_picture(start: bytes) -> str | None:
    """Return which kind of picture begins with these bytes (16 of them), or None."""
    if start.startswith(b"\x89PNG\r\n\x1a\n"):
        return "PNG"
    if start.startswith(b"\xff\xd8\xff"):
        return "JPEG"
    if start[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return "TIFF"
    return "WebP" if start[:4] == b"RIFF" and start[8:12] == b"WEBP" else None


def read_picture(path: Path) -> Picture:
    """Read a PNG, JPEG, TIFF or WebP picture; raise `InputError` if it is none, damaged or too large."""
    place = one_line(path)
    try:
        with path.open("rb") as stream:
            return _read(stream, place)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None


def picture_from(data: bytes, place: str) -> Picture:
    """Read a picture from a file's content; `place` is how errors name it."""
    return _read(io.BytesIO(data), place)


def _read(stream: BinaryIO, place: str) -> Picture:
    kind = kind_of_picture(stream.read(16))
    if kind is None:
        raise InputError(f"{place}: expected a PNG, JPEG, TIFF or WebP picture by its first bytes")
    stream.seek(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about metadata; what matters is an error
            # The class itself: Image.open guesses by other names and has a limit that is the process's.
            with _READERS[kind](stream) as image:
                check_size(image.size, place)
                return _seen(image, place)
    except _BROKEN as error:
        raise InputError(f"{place}: expected a whole {kind} picture ({one_line(error)})") from None


def check_size(size: tuple[int, int], place: str) -> None:
    """Raise `InputError` for a picture (width, height) that is too large, or empty."""
    sides = f"{place}: {size[0]}×{size[1]} px: expected"
    if not all(0 < side <= _LARGEST_SIDE for side in size):
        raise InputError(f"{sides} sides of 1 to {_LARGEST_SIDE} px")
    if size[0] * size[1] > _LARGEST_PIXELS:
        raise InputError(f"{sides} at most {_LARGEST_PIXELS // 10**6} million pixels")


def _seen(image: ImageFile, place: str) -> Picture:
    image.load()
    turned: Image.Image = ImageOps.exif_transpose(image)
    if turned.mode in ("F", "I"):
        raise InputError(
            f"{place}: its values are no colours ({turned.mode}): expected a picture of 8 or 16 bits"
        )
    if turned.mode in _DEEP:
        turned = Image.fromarray((np.asarray(turned) >> 8).astype(np.uint8))
    rgba = np.asarray(
        turned.convert("RGB").convert("RGBA") if turned.mode == "CMYK" else turned.convert("RGBA")
    )
    return Picture(rgba, bool((rgba[..., 3] < 128).any()), _is_grey(rgba))


def _is_grey(rgba: npt.NDArray[np.uint8]) -> bool:
    for top in range(0, len(rgba), _ROWS):
        colour = rgba[top : top + _ROWS, :, :3][rgba[top : top + _ROWS, :, 3] >= 128]
        if len(colour) and int((colour.max(axis=1) - colour.min(axis=1)).max()) > _COLOURLESS:
            return False
    return True
