"""Label images as PNG files: one channel, 8 bits, the value of a pixel is its label."""

from __future__ import annotations

import io
import struct
import zlib
from dataclasses import dataclass

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngImageFile

from sketchterrain.errors import InputError
from sketchterrain.sketch.document import MAX_LABELS, MAX_SIDE, LabelImage, labels_in

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE = 0, 3
_COLOUR_TYPES = {2: "RGB", 4: "grey with alpha", 6: "RGBA"}
_PAPER = (0, 0, 0)  # so that empty stays 0 in a paint program that turns colours into greys


@dataclass(frozen=True)
class _Header:
    width: int
    height: int
    depth: int
    colour_type: int


def decode_layer(data: bytes) -> LabelImage:
    """Return the label image in a PNG file.

    A palette's index is the label. A black and white image of one bit is taken as labels 0 and 1.
    """
    _check_header(_read_chunks(data))
    try:
        # The class itself: Image.open refuses large images by a limit that is the whole process's.
        with PngImageFile(io.BytesIO(data)) as image:
            image.load()
            array = np.asarray(image).astype(np.uint8)
    except (OSError, SyntaxError, ValueError, EOFError, zlib.error, struct.error) as error:
        raise InputError(f"expected a whole PNG file, this one is damaged ({error})") from None
    labels = labels_in(array)
    if len(labels) > MAX_LABELS:
        raise InputError(
            f"looks antialiased: it has {len(labels)} labels, expected at most {MAX_LABELS}; "
            "paint with a hard brush, without smoothing"
        )
    array.flags.writeable = False
    return array


def encode_layer(image: LabelImage, colour: tuple[int, int, int]) -> bytes:
    """Return a label image as a palette PNG of 8 bits."""
    picture = Image.fromarray(image)
    picture.putpalette([channel for label in range(256) for channel in _shade(label, colour)])
    stream = io.BytesIO()
    picture.save(stream, format="PNG")
    return stream.getvalue()


def _shade(label: int, colour: tuple[int, int, int]) -> tuple[int, ...]:
    if label == 0:
        return _PAPER
    # Steps of the golden ratio keep labels that follow each other apart.
    light = 1.0 - 0.6 * ((label - 1) * 0.618034 % 1.0)
    return tuple(round(channel * light) for channel in colour)


def _read_chunks(data: bytes) -> _Header:
    """Return the header of a PNG file in which every chunk is whole, from the first to the last."""
    if not data.startswith(_SIGNATURE):
        raise InputError("expected a PNG file, this is none")
    header, position, kind = None, len(_SIGNATURE), b""
    while kind != b"IEND":
        start = data[position : position + 8]
        length = int.from_bytes(start[:4], "big")
        kind, end = start[4:], position + 8 + length
        crc = data[end : end + 4]
        if len(start) < 8 or len(crc) < 4:
            raise InputError("expected a whole PNG file, this one is truncated")
        if zlib.crc32(memoryview(data)[position + 4 : end]) != int.from_bytes(crc, "big"):
            raise InputError("expected a whole PNG file, this one is damaged (wrong check sum)")
        if header is None:
            header = _header(kind, data[position + 8 : end])
        position = end + 4
    if header is None:
        raise InputError("expected a PNG file, this one has no header")
    return header


def _header(kind: bytes, content: bytes) -> _Header:
    if kind != b"IHDR" or len(content) != 13:
        raise InputError("expected a PNG file, this one has no header")
    return _Header(*struct.unpack(">IIBB", content[:10]))


def _check_header(header: _Header) -> None:
    if not (1 <= header.width <= MAX_SIDE and 1 <= header.height <= MAX_SIDE):
        raise InputError(f"{header.width}×{header.height} px: expected sides of 1 to {MAX_SIDE} px")
    if header.colour_type not in (_GREY, _PALETTE):
        given = _COLOUR_TYPES.get(header.colour_type, f"colour type {header.colour_type}")
        raise InputError(
            f"{given}: expected a single-channel PNG of 8 bits, greyscale or palette, whose values are labels"
        )
    # Grey of 2 or 4 bits would be read as shades spread over 0 to 255, not as labels.
    if header.colour_type == _GREY and header.depth not in (1, 8):
        raise InputError(f"{header.depth} bits a pixel: expected an 8-bit single-channel PNG")
