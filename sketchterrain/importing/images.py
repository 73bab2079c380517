"""Images as the source of a sketch: reading, and coloured maps."""

import io
import struct
import warnings
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO, Final, Literal

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageOps
from PIL.ImageFile import ImageFile

from sketchterrain.document.label_layers import LabelImage
from sketchterrain.errors import InputError, first_few, format_value, one_line
from sketchterrain.features.files import find_driver
from sketchterrain.importing.image_colours import (
    CLEAR,
    UNKNOWN,
    ClassifiedPixels,
    DetectedColour,
    classify_pixels,
    detect_colours,
)
from sketchterrain.importing.legend import INK, NOTHING, OWN_LEGEND, Legend, Meaning
from sketchterrain.importing.traced_layers import (
    UNASSIGNED,
    TraceOptions,
    TraceResult,
    fill_gaps,
    join_line_ends,
    narrow_water,
    remove_specks,
    scale_labels,
    split_water,
    unassign_thin_parts,
)
from sketchterrain.io.files import wrap_read_errors
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS

Kind = Literal["folder", "picture", "open raster", "vectors"]

_MAX_SIDE = 32768
_MAX_PIXELS = 1 << 27

_GREY_TOLERANCE = 8  # levels of sRGB by which JPEG separates the channels of a grey
_ROWS = 512  # at once: bounds the memory
_MODES_16_BIT = ("I;16", "I;16L", "I;16B", "I;16N")
_DECODE_ERRORS = (
    *(OSError, SyntaxError, ValueError, EOFError, LookupError, TypeError, OverflowError, RuntimeError),
    *(zlib.error, struct.error, Image.DecompressionBombError),
)
_EXPECTED = (
    "expected a PNG, JPEG, TIFF or WebP picture, an OpenRaster file (.ora), a folder of pictures, "
    "or vectors (GeoJSON, GeoPackage, FlatGeobuf, Shapefile, GPX, KML, DXF, OpenStreetMap)"
)
_UNSUPPORTED = (
    (b"gimp xcf", "a GIMP file", "in GIMP, File ▸ Export As, name.ora"),
    (b"8BPS", "a Photoshop file", "save its layers as OpenRaster (.ora), in Krita or GIMP"),
)
_HEAD_BYTES = 4096


@dataclass(frozen=True, eq=False)
class Picture:
    """A decoded image."""

    rgba: npt.NDArray[np.uint8]  # (height, width, 4): sRGB and opacity, row 0 at the top
    has_transparency: bool  # whether some pixels are more than half transparent
    is_grey: bool


def detect_kind(path: Path) -> Kind:
    """Return the kind of a file by its first bytes; raise `InputError` if it cannot be traced."""
    location = one_line(path)
    with wrap_read_errors(path):
        if path.is_dir():
            return "folder"
        if not path.exists():
            raise InputError(f"{location} does not exist: {_EXPECTED}")
        if not path.is_file():
            raise InputError(f"{location} is not a file: {_EXPECTED}")
        with path.open("rb") as stream:
            start = stream.read(_HEAD_BYTES)
    if detect_format(start):
        return "picture"
    if start.startswith(b"PK"):
        return "open raster"
    for magic, what, instead in _UNSUPPORTED:
        if start.startswith(magic):
            raise InputError(f"{location} is {what}: {instead}")
    if find_driver(path, location):
        return "vectors"
    begins = f"begins with {format_value(start[:12])}" if start else "is empty"
    raise InputError(f"{location} {begins}: {_EXPECTED}")


def detect_format(start: bytes) -> str | None:
    """Return the image format of 16 first bytes, or None."""
    if start.startswith(b"\x89PNG\r\n\x1a\n"):
        return "PNG"
    if start.startswith(b"\xff\xd8\xff"):
        return "JPEG"
    if start[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
        return "TIFF"
    return "WebP" if start[:4] == b"RIFF" and start[8:12] == b"WEBP" else None


def read_picture(path: Path) -> Picture:
    """Read a PNG, JPEG, TIFF or WebP image; raise `InputError` if it is invalid or too large."""
    with wrap_read_errors(path), path.open("rb") as stream:
        return _read(stream, one_line(path))


def decode_picture(data: bytes, location: str) -> Picture:
    """Decode an image file's content; errors name it as `location`."""
    return _read(io.BytesIO(data), location)


def _read(stream: BinaryIO, location: str) -> Picture:
    kind = detect_format(stream.read(16))
    if kind is None:
        raise InputError(f"{location}: expected a PNG, JPEG, TIFF or WebP picture by its first bytes")
    stream.seek(0)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # about metadata
            with Image.open(stream, formats=[kind]) as image:
                check_size(image.size, location)
                return _decode(image, location)
    except _DECODE_ERRORS as error:
        raise InputError(f"{location}: expected a whole {kind} picture ({one_line(error)})") from None


def check_size(size: tuple[int, int], location: str) -> None:
    """Raise `InputError` for an image (width, height) that is too large or empty."""
    sides = f"{location}: {size[0]}×{size[1]} px: expected"
    if not all(0 < side <= _MAX_SIDE for side in size):
        raise InputError(f"{sides} sides of 1 to {_MAX_SIDE} px")
    if size[0] * size[1] > _MAX_PIXELS:
        raise InputError(f"{sides} at most {_MAX_PIXELS // 10**6} million pixels")


def _decode(image: ImageFile, location: str) -> Picture:
    image.load()
    upright: Image.Image = ImageOps.exif_transpose(image)
    if upright.mode in ("F", "I"):
        raise InputError(
            f"{location}: its values are not colours ({upright.mode}): expected a picture of 8 or 16 bits"
        )
    if upright.mode in _MODES_16_BIT:
        upright = Image.fromarray((np.asarray(upright) >> 8).astype(np.uint8))
    rgba = np.asarray(
        upright.convert("RGB").convert("RGBA") if upright.mode == "CMYK" else upright.convert("RGBA")
    )
    return Picture(rgba, bool((rgba[..., 3] < 128).any()), _is_grey(rgba))


def _is_grey(rgba: npt.NDArray[np.uint8]) -> bool:
    for top in range(0, len(rgba), _ROWS):
        colour = rgba[top : top + _ROWS, :, :3][rgba[top : top + _ROWS, :, 3] >= 128]
        if len(colour) and int((colour.max(axis=1) - colour.min(axis=1)).max()) > _GREY_TOLERANCE:
            return False
    return True


SPECKS: Final = 16  # px of the sketch; smaller areas are removed by default

_INK_RADIUS = 24.0  # px of the sketch by which lettering is filled from its sides; the rest stays empty
_RIVER_GAP = 14  # px of the sketch, of rivers broken by lettering and noise
_NARROW = 8  # px of the sketch, of lakes that may be rivers
_MAX_NAMES = 12  # colours in a note


@dataclass(frozen=True, eq=False)
class TracedMap(TraceResult):
    """A traced map, with the meaning of each colour (None: not in the legend) and shares of the picture."""

    colours: tuple[tuple[DetectedColour, Meaning | None], ...]
    certain: float
    inferred: float
    unknown: float


@dataclass(frozen=True, eq=False)
class ColouredMap:
    """A coloured map with its classified pixels, to be traced with any meanings of its colours."""

    name: str
    rgba: npt.NDArray[np.uint8]  # (height, width, 4)
    colours: tuple[DetectedColour, ...]  # the most common first
    meanings: tuple[Meaning | None, ...]  # by the legend
    pixels: ClassifiedPixels

    def traced(
        self,
        options: TraceOptions,
        *,
        meanings: Sequence[Meaning | None] | None = None,
        specks: int = SPECKS,
        narrow: float = 0.0,
    ) -> TracedMap:
        """Return the sketch; raise `InputError` if no colour means a label.

        `meanings` replace the legend's; areas of fewer than `specks` px of the sketch are removed; water is a
        river if narrower than `narrow` px, otherwise a lake (0: by its colour).
        """
        used = tuple(self.meanings if meanings is None else meanings)
        painted = {meaning for meaning in used if meaning is not None and meaning.label}
        if not painted:
            codes = ", ".join(colour.code for colour in self.colours[:_MAX_NAMES])
            raise InputError(
                f"no colour of the legend in it, but {codes}: expected meanings for some, "
                "as with --colour mountain=#8b5a2b"
            )
        order = sorted(painted, key=lambda meaning: (tuple(LAYERS).index(meaning.layer), meaning.label))
        value_of = {meaning: value for value, meaning in enumerate(order, start=1)}
        table = np.zeros(256, dtype=np.uint8)
        table[UNKNOWN] = UNASSIGNED
        table[CLEAR] = 0
        for index, meaning in enumerate(used):
            table[index] = UNASSIGNED if meaning == INK else value_of.get(meaning or NOTHING, 0)
        height, width = self.pixels.index.shape
        thin = [value for meaning, value in value_of.items() if LAYERS[meaning.layer].kind == "course"]
        values = scale_labels(table[self.pixels.index], options.size(width, height), thin=thin)
        if INK in used:  # lettering comes with outlines
            values = unassign_thin_parts(values, {0, *value_of.values()}.difference(thin))
        values = fill_gaps(values, radius=_INK_RADIUS, default=0)
        for value in thin:
            values[join_line_ends(values == value, _RIVER_GAP)] = value
        values = remove_specks(values, specks)
        layers = {name: np.zeros(values.shape, dtype=np.uint8) for name in PAINTED_LAYERS}
        for meaning, value in value_of.items():
            layers[meaning.layer][values == value] = meaning.label
        waters = [(layer.narrow, name) for name, layer in LAYERS.items() if layer.narrow]
        for thin_name, name in waters if narrow > 0.0 else ():
            layers[thin_name], layers[name] = split_water(layers[thin_name], layers[name], narrow)
        sketch, sketch_notes = options.sketch(layers, self.name)
        pairs = tuple(zip(self.colours, used, strict=True))
        pixels = self.pixels
        notes = (
            f"{pixels.certain:.1%} of the picture is clearly one of its {len(self.colours)} colours, "
            f"{pixels.inferred:.1%} is inferred from its neighbours, {pixels.unknown:.1%} is unknown",
            *_colour_notes(pairs),
            *([] if narrow > 0.0 else _water_notes(layers, waters)),
            *sketch_notes,
        )
        return TracedMap(sketch, notes, pairs, pixels.certain, pixels.inferred, pixels.unknown)


def read_map(path: Path, legend: Legend = OWN_LEGEND) -> ColouredMap:
    """Read a coloured map from an image; raise `InputError` if it is invalid or has no colours."""
    return coloured_map(read_picture(path), path, legend)


def coloured_map(picture: Picture, path: Path, legend: Legend = OWN_LEGEND) -> ColouredMap:
    """Return the coloured map of an image from a path; raise `InputError` if it has no colours."""
    location = one_line(path)
    if picture.is_grey:
        raise InputError(
            f"{location}: it is grey: expected a coloured map, or the layer that it shows, "
            "as with --layer mountain"
        )
    # The default legend has more colours than any picture: too many to look for.
    sought = () if legend.colours is OWN_LEGEND.colours else legend.colours
    colours = detect_colours(picture.rgba, sought=sought)
    if not colours:
        raise InputError(f"{location}: it has no areas of one colour: expected a coloured map")
    meanings = tuple(legend.meaning(colour.rgb) for colour in colours)
    return ColouredMap(path.stem, picture.rgba, colours, meanings, classify_pixels(picture.rgba, colours))


def _colour_notes(pairs: Sequence[tuple[DetectedColour, Meaning | None]]) -> list[str]:
    known = [
        f"{colour.code} is {meaning} ({colour.share:.1%})" for colour, meaning in pairs if meaning is not None
    ]
    unknown = [f"{colour.code} ({colour.share:.1%})" for colour, meaning in pairs if meaning is None]
    notes = [first_few(known, _MAX_NAMES)] if known else []
    if unknown:
        names = first_few(unknown, _MAX_NAMES)
        notes.append(f"not in the legend, left empty: {names}; --colour LAYER=#rrggbb adds one")
    return notes


def _water_notes(layers: Mapping[str, LabelImage], waters: Iterable[tuple[str, str]]) -> list[str]:
    candidates = [layers[wide] > 0 for thin, wide in waters if layers[wide].any() and not layers[thin].any()]
    if not any(narrow_water(each, _NARROW).any() for each in candidates):
        return []
    return [f"some lakes are narrow and long: --rivers-up-to {_NARROW} makes rivers of them"]
