"""A sheet as SVG: lines and letters as vectors, pictures embedded as PNG."""

from __future__ import annotations

import base64
import io
from typing import TYPE_CHECKING, Final
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from PIL import Image

from sketchterrain.export.map_sheet import Lines, Picture, Words

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.map_sheet import Box, Colour, Layer, Shape, Sheet

__all__ = ["svg_of"]

UNITS: Final = 100
"""Of the drawing in a millimetre; all coordinates are whole."""
FONTS: Final = "Aileron, 'Helvetica Neue', Helvetica, Arial, sans-serif"
MIDDLE: Final = 0.36
"""From the middle of a capital's height to the base line, in font sizes."""
HALO: Final = 0.28
"""Width of the line around letters that have a halo, in font sizes."""


def svg_of(sheet: Sheet) -> str:
    """Return a sheet as the text of an SVG file; the same sheet always gives the same text."""
    width, height = _whole(sheet.width), _whole(sheet.height)
    parts = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{_short(sheet.width)}mm" '
        f'height="{_short(sheet.height)}mm" viewBox="0 0 {width} {height}" '
        f'font-family="{FONTS}" stroke-linecap="round" stroke-linejoin="round">',
        f"<title>{escape(sheet.title)}</title>",
        f'<rect width="{width}" height="{height}" fill="{_hex(sheet.paper)}"/>',
    ]
    for layer in sheet.layers:
        parts += _layer(layer)
    parts.append("</svg>")
    return "\n".join(parts) + "\n"


def _layer(layer: Layer) -> list[str]:
    shapes = [text for shape in layer.shapes if (text := _shape(shape))]
    if layer.clip is None:
        return [f'<g id="{layer.name}">', *shapes, "</g>"]
    clip = f"{layer.name}-frame"
    return [
        f'<clipPath id="{clip}"><rect {_box(layer.clip)}/></clipPath>',
        f'<g id="{layer.name}" clip-path="url(#{clip})">',
        *shapes,
        "</g>",
    ]


def _shape(shape: Shape) -> str:
    if isinstance(shape, Words):
        return _words(shape)
    if isinstance(shape, Picture):
        return _picture(shape)
    if isinstance(shape, Lines):
        path = "".join(_path(points) for points in shape.paths)
        pen = f'fill="none" stroke="{_hex(shape.colour)}" stroke-width="{_short(shape.width * UNITS)}"'
        pen += f' stroke-opacity="{_short(shape.opacity)}"' if shape.opacity < 1.0 else ""
    else:
        path = "".join(f"{_path(ring)}z" for ring in shape.rings)
        pen = f'fill="{_hex(shape.colour)}" fill-rule="evenodd"'
        pen += f' fill-opacity="{_short(shape.opacity)}"' if shape.opacity < 1.0 else ""
    return f'<path {pen} d="{path}"/>' if path else ""


def _path(points: npt.NDArray[np.float64]) -> str:
    """Return a polyline in steps from point to point, without those that are no step."""
    whole = np.rint(points * UNITS).astype(np.int64)
    steps = np.diff(whole, axis=0)
    steps = steps[steps.any(axis=1)]
    start = f"M{whole[0, 0]} {whole[0, 1]}"
    if not len(steps):
        return f"{start}h0"
    # A minus separates as well as a space does.
    return f"{start}l" + " ".join(f"{x} {y}" for x, y in steps.tolist()).replace(" -", "-")


def _words(words: Words) -> str:
    x, y = _whole(words.x), _whole(words.y)
    look = f'font-size="{_short(words.size * UNITS)}" fill="{_hex(words.colour)}"'
    if words.anchor != "start":
        look += f' text-anchor="{words.anchor}"'
    if words.bold:
        look += ' font-weight="bold"'
    if words.halo is not None:
        width = _short(words.size * HALO * UNITS)
        look += f' paint-order="stroke" stroke="{_hex(words.halo)}" stroke-width="{width}"'
    if words.turn:
        look += f' transform="rotate({_short(words.turn)} {x} {y})"'
    # Whatever font there is, the text keeps the room that was left for it.
    length = _whole(words.width)
    y += _whole(words.size * MIDDLE)
    return (
        f'<text x="{x}" y="{y}" {look} textLength="{length}" lengthAdjust="spacingAndGlyphs">'
        f"{escape(words.text)}</text>"
    )


def _picture(picture: Picture) -> str:
    stream = io.BytesIO()
    Image.fromarray(picture.pixels).save(stream, format="PNG", compress_level=7)
    data = base64.b64encode(stream.getvalue()).decode("ascii")
    source = quoteattr(f"data:image/png;base64,{data}")
    return f'<image {_box(picture.box)} preserveAspectRatio="none" href={source}/>'


def _box(box: Box) -> str:
    left, top, width, height = (_whole(number) for number in box)
    return f'x="{left}" y="{top}" width="{width}" height="{height}"'


def _whole(number: float) -> int:
    return round(number * UNITS)


def _short(number: float) -> str:
    return f"{number:.2f}".rstrip("0").rstrip(".")


def _hex(colour: Colour) -> str:
    return f"#{bytes(colour).hex()}"
