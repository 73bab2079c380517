"""Pictures of a stranger's: PNG, JPEG, TIFF and WebP by their first bytes, of a bounded size."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.TiffImagePlugin import TiffImageFile
from PIL.WebPImagePlugin import WebPImageFile

from sketchterrain.errors import InputError, one_line

if TYPE_CHECKING:
    from pathlib import Path
    from typing import BinaryIO

    from PIL.ImageFile import ImageFile

__all__ = ["LARGEST_PIXELS", "LARGEST_SIDE", "Picture", "kind_of_picture", "picture_from", "read_picture"]

LARGEST_SIDE: Final = 32768
LARGEST_PIXELS: Final = 1 << 27
"""The most pixels of a picture: 134 million."""

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
    OSError,
    SyntaxError,
    ValueError,
    EOFError,
    KeyError,
    TypeError,
    IndexError,
    OverflowError,
    RuntimeError,
    zlib.error,
    struct.error,
    Image.DecompressionBombError,
)


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture as it is seen.

    Attributes
    ----------
    rgba : numpy.ndarray
        uint8, (height, width, 4): sRGB and how opaque, not multiplied; row 0 is at the top.
    see_through : bool
        Whether some of it is more than half transparent.
    is_grey : bool
        Whether it holds no colour but greys.
    """

    rgba: npt.NDArray[np.uint8]
    see_through: bool
    is_grey: bool


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
    """Read a picture.

    Raises
    ------
    InputError
        If it cannot be read, is no picture of these kinds by its first bytes, is damaged or too large.
    """
    place = one_line(path)
    try:
        with path.open("rb") as stream:
            return _read(stream, place)
    except OSError as error:
        raise InputError(f"{place}: cannot be read ({one_line(error.strerror or error)})") from None


def picture_from(data: bytes, place: str) -> Picture:
    """Read a picture from a file's content; `place` is how errors name it.

    Raises
    ------
    InputError
        As `read_picture` does.
    """
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
                width, height = image.size
                if not (0 < width <= LARGEST_SIDE and 0 < height <= LARGEST_SIDE):
                    raise InputError(
                        f"{place}: {width}×{height} px: expected sides of 1 to {LARGEST_SIDE} px"
                    )
                if width * height > LARGEST_PIXELS:
                    most = LARGEST_PIXELS // 10**6
                    raise InputError(f"{place}: {width}×{height} px: expected at most {most} million pixels")
                return _seen(image, place)
    except _BROKEN as error:
        raise InputError(f"{place}: expected a whole {kind} picture ({one_line(error)})") from None


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
