"""Label images as 8-bit single-channel PNG files; a pixel's value is its label."""

from __future__ import annotations

import io
import struct
import zlib

import numpy as np
from PIL import Image
from PIL.PngImagePlugin import PngImageFile

from sketchterrain.errors import InputError
from sketchterrain.sketch.label_image import MAX_LABELS, MAX_SIDE, LabelImage, labels_in

_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_GREY, _PALETTE = 0, 3
_COLOUR_TYPES = {2: "RGB", 4: "grey with alpha", 6: "RGBA"}
_EMPTY = (0, 0, 0)  # black, so that label 0 stays 0 where a paint program converts the palette to greys


def decode_layer(data: bytes) -> LabelImage:
    """Return the label image in a PNG file, uint8 (height, width), read-only.

    A palette's index is the label; black and white images of one bit have labels 0 and 1. Raise InputError if
    it is damaged, not single-channel, not of 8 bits, too large, or looks antialiased.
    """
    width, height, depth, colour_type = _read_header(data)
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE):
        raise InputError(f"{width}×{height} px: expected sides of 1 to {MAX_SIDE} px")
    if colour_type not in (_GREY, _PALETTE):
        given = _COLOUR_TYPES.get(colour_type, f"colour type {colour_type}")
        raise InputError(
            f"{given}: expected a single-channel PNG of 8 bits, greyscale or palette, whose values are labels"
        )
    # Grey of 2 or 4 bits would be decoded as shades spread over 0 to 255, not as labels.
    if colour_type == _GREY and depth not in (1, 8):
        raise InputError(f"{depth} bits a pixel: expected an 8-bit single-channel PNG")
    try:
        # Not Image.open: its limit on image size is global to the process.
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
    """Return a label image as an 8-bit palette PNG; label 1 has the sRGB `colour`, others shades of it."""
    picture = Image.fromarray(image)
    picture.putpalette([channel for label in range(256) for channel in _shade(label, colour)])
    stream = io.BytesIO()
    picture.save(stream, format="PNG")
    return stream.getvalue()


def _shade(label: int, colour: tuple[int, int, int]) -> tuple[int, ...]:
    if label == 0:
        return _EMPTY
    # Golden-ratio steps keep successive labels distinct.
    light = 1.0 - 0.6 * ((label - 1) * 0.618034 % 1.0)
    return tuple(round(channel * light) for channel in colour)


def _read_header(data: bytes) -> tuple[int, int, int, int]:
    """Return width, height, bits and colour type of a PNG file, after checking every chunk."""
    if not data.startswith(_SIGNATURE):
        raise InputError("expected a PNG file")
    header, position, kind = b"", len(_SIGNATURE), b""
    while kind != b"IEND":
        start = data[position : position + 8]
        length = int.from_bytes(start[:4], "big")
        kind, end = start[4:], position + 8 + length
        crc = data[end : end + 4]
        if len(start) < 8 or len(crc) < 4:
            raise InputError("expected a whole PNG file, this one is truncated")
        if zlib.crc32(memoryview(data)[position + 4 : end]) != int.from_bytes(crc, "big"):
            raise InputError("expected a whole PNG file, this one is damaged (wrong check sum)")
        if not header:
            header = data[position + 8 : end]
            if kind != b"IHDR" or len(header) != 13:
                raise InputError("expected a PNG file, this one has no header")
        position = end + 4
    width, height, depth, colour_type = struct.unpack(">IIBB", header[:10])
    return width, height, depth, colour_type
