"""Images as the source of a sketch: reading, and coloured maps."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps
from PIL.ImageFile import ImageFile
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile
from PIL.TiffImagePlugin import TiffImageFile
from PIL.WebPImagePlugin import WebPImageFile

from sketchterrain.document.parameters import LAYERS
from sketchterrain.errors import InputError, format_value, one_line
from sketchterrain.importing import image_colours as picture_colours
from sketchterrain.importing import traced_layers as label_image
from sketchterrain.importing.image_colours import CLEAR, UNKNOWN, FoundColour, find_colours, sort_pixels
from sketchterrain.importing.legend import INK, NOTHING, OWN_LEGEND, Legend, Meaning
from sketchterrain.importing.traced_layers import Sheet, Traced

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


SPECKS: Final = 16  # areas of fewer pixels of the sketch vanish unless it is asked otherwise

_INK_REACH = 24.0  # px of the sketch that lettering is filled from its sides; a wider area stays empty
_THIN = ("river",)
_GAP = 14  # px of the sketch; lettering and noise break a river so far
_NARROW = 8  # px of the sketch, of waters that may be meant as rivers
_TOLD = 12  # colours that notes name


@dataclass(frozen=True, eq=False)
class TracedMap(Traced):
    """A traced map: what each of its colours was taken for (None: the legend does not have it).

    `sure`, `taken` and `unknown` are shares of the picture, as in `SortedPixels`.
    """

    colours: tuple[tuple[FoundColour, Meaning | None], ...]
    sure: float
    taken: float
    unknown: float


@dataclass(frozen=True, eq=False)
class ColouredMap:
    """A coloured map that was read: a sketch can be made of it as often as meanings change.

    `rgba` is uint8, (height, width, 4); `meanings` is what the legend says of its colours, the most common
    first.
    """

    name: str
    rgba: npt.NDArray[np.uint8]
    colours: tuple[FoundColour, ...]
    meanings: tuple[Meaning | None, ...]
    pixels: picture_colours.SortedPixels

    def traced(
        self,
        sheet: Sheet,
        *,
        meanings: Sequence[Meaning | None] | None = None,
        specks: int = SPECKS,
        narrow: float = 0.0,
    ) -> TracedMap:
        """Return the sketch; raise `InputError` if no colour stands for a label."""
        meant = tuple(self.meanings if meanings is None else meanings)
        painted = {each for each in meant if each is not None and each.label}
        if not painted:
            named = ", ".join(each.code for each in self.colours[:_TOLD])
            raise InputError(
                f"no colour of the legend in it, but {named}: expected some to be named, "
                "as with --colour mountain=#8b5a2b"
            )
        order = sorted(painted, key=lambda each: (tuple(LAYERS).index(each.layer), each.label))
        value_of = {meaning: value for value, meaning in enumerate(order, start=1)}
        table = np.zeros(256, dtype=np.uint8)
        table[UNKNOWN] = label_image.NO_VOTE
        table[CLEAR] = 0
        for index, meaning in enumerate(meant):
            table[index] = label_image.NO_VOTE if meaning == INK else value_of.get(meaning or NOTHING, 0)
        height, width = self.pixels.index.shape
        thin = [value for meaning, value in value_of.items() if meaning.layer in _THIN]
        values = label_image.majority(table[self.pixels.index], sheet.size(width, height), thin=thin)
        if INK in meant:  # where lettering is, outlines are too
            values = label_image.without_threads(values, {0, *value_of.values()}.difference(thin))
        values = label_image.fill_gaps(values, reach=_INK_REACH, beyond=0)
        for value in thin:
            values[label_image.joined(values == value, _GAP)] = value
        values = label_image.without_specks(values, specks)
        layers = {name: np.zeros(values.shape, dtype=np.uint8) for name in LAYERS}
        for meaning, value in value_of.items():
            layers[meaning.layer][values == value] = meaning.label
        if narrow > 0.0:
            layers["river"], layers["lake"] = label_image.parted_waters(
                layers["river"], layers["lake"], narrow
            )
        sketch, told = sheet.sketch(layers, self.name)
        pairs = tuple(zip(self.colours, meant, strict=True))
        pixels = self.pixels
        notes = (
            f"{pixels.sure:.1%} of the picture is plainly one of its {len(self.colours)} colours, "
            f"{pixels.taken:.1%} took what is beside it, {pixels.unknown:.1%} is like nothing around it",
            *_colour_notes(pairs),
            *([] if narrow > 0.0 else _water_notes(layers["river"] > 0, layers["lake"] > 0)),
            *told,
        )
        return TracedMap(sketch, notes, pairs, pixels.sure, pixels.taken, pixels.unknown)


def read_map(path: Path, legend: Legend = OWN_LEGEND) -> ColouredMap:
    """Read a coloured map from a picture; raise `InputError` if it is none or has no colours."""
    return map_of(read_picture(path), path, legend)


def map_of(picture: Picture, path: Path, legend: Legend = OWN_LEGEND) -> ColouredMap:
    """Return the coloured map that a picture from a path is; raise `InputError` if it has no colours."""
    place = one_line(path)
    if picture.is_grey:
        raise InputError(
            f"{place}: it is black, white and grey: expected a coloured map, or the layer "
            "that is painted in it, as with --layer mountain"
        )
    # The program's own legend has more colours than any picture: they are no reason to tell two apart.
    sought = () if legend.colours is OWN_LEGEND.colours else legend.colours
    colours = find_colours(picture.rgba, sought=sought)
    if not colours:
        raise InputError(f"{place}: no area of it is of one colour: expected a coloured map")
    meanings = tuple(legend.meaning(each.rgb) for each in colours)
    return ColouredMap(path.stem, picture.rgba, colours, meanings, sort_pixels(picture.rgba, colours))


def _colour_notes(pairs: Sequence[tuple[FoundColour, Meaning | None]]) -> list[str]:
    known = [f"{each.code} is {meaning} ({each.share:.1%})" for each, meaning in pairs if meaning is not None]
    left = [f"{each.code} ({each.share:.1%})" for each, meaning in pairs if meaning is None]
    notes = [", ".join(known[:_TOLD]) + _more(known)] if known else []
    if left:
        notes.append(
            f"no colour of the legend, left empty: {', '.join(left[:_TOLD])}{_more(left)}; "
            "--colour LAYER=#rrggbb names one"
        )
    return notes


def _water_notes(river: npt.NDArray[np.bool_], lake: npt.NDArray[np.bool_]) -> list[str]:
    if river.any() or not lake.any() or not label_image.narrow_waters(lake, _NARROW).any():
        return []
    return [f"some lakes are narrow and long: --rivers-up-to {_NARROW} makes rivers of them"]


def _more(told: Sequence[str]) -> str:
    return f" and {len(told) - _TOLD} more" if len(told) > _TOLD else ""
