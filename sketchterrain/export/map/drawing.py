"""Shapes on a map sheet, written as SVG, and as PNG rendered from it by resvg."""

import base64
import io
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final, TypeAlias, cast
from xml.sax.saxutils import escape

import numpy as np
import numpy.typing as npt
import resvg_py
import shapely
from PIL import Image, ImageFont
from shapely.affinity import rotate

from sketchterrain.schema.parameters import Properties
from sketchterrain.schema.styles import rgb_from_hex

Colour: TypeAlias = tuple[int, int, int]
Box: TypeAlias = tuple[float, float, float, float]  # left, top, width, height (mm)
Points: TypeAlias = npt.NDArray[np.float64]  # (n, 2): x to the right, y down (mm)

UNITS: Final = 100  # of SVG coordinates per mm, in integers
TOLERANCE: Final = 0.02  # mm, of simplified lines
PAPER: Final = (253, 252, 248)
FONTS: Final = "Aileron, 'Helvetica Neue', Helvetica, Arial, sans-serif"
CENTRE: Final = 0.36  # from the centre of digits to the baseline, in font sizes
HALO, BOLD = 0.28, 0.044  # stroke widths of halos and bold letters, in font sizes


@dataclass(frozen=True, eq=False)
class Polylines:
    """Lines of one pen (mm), with round caps and joins; dashes are lengths drawn and left out in turn."""

    paths: Sequence[Points]
    colour: Colour
    width: float
    opacity: float = 1.0
    dashes: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class Polygons:
    """Areas of one colour by the even-odd rule; rings close themselves."""

    paths: Sequence[Points]
    colour: Colour
    opacity: float = 1.0


@dataclass(frozen=True)
class MapText:
    """A line of text, anchored at half its height and turned by degrees clockwise."""

    text: str
    x: float
    y: float
    size: float
    colour: Colour
    anchor: str = "start"
    turn: float = 0.0
    bold: bool = False
    halo: Colour | None = None

    @property
    def width(self) -> float:
        """Width of the text (mm)."""
        return float(_font().getlength(self.text)) * self.size / _font().size

    def outline(self, *, margin: float) -> shapely.Polygon:
        """Return the turned box around the text with a margin (mm)."""
        left = self.x - {"start": 0.0, "middle": 0.5, "end": 1.0}[self.anchor] * self.width
        top, bottom = self.y - CENTRE * self.size, self.y + CENTRE * self.size
        box = shapely.box(left - margin, top - margin, left + self.width + margin, bottom + margin)
        return rotate(box, self.turn, (self.x, self.y))


@dataclass(frozen=True, eq=False)
class RasterImage:
    """(rows, columns, 3) uint8 pixels, row 0 on top."""

    pixels: npt.NDArray[np.uint8]
    box: Box


Shape: TypeAlias = Polylines | Polygons | MapText | RasterImage


@dataclass(frozen=True, eq=False)
class MapSheet:
    """A sheet of paper (mm) and its layers of shapes, the lowest first."""

    title: str
    width: float
    height: float
    layers: dict[str, list[Shape]]


def styled(
    style: Properties,
    unit: float,
    *,
    lines: Sequence[Points] = (),
    rings: Sequence[Points] = (),
    points: Sequence[Points] = (),
    width: float = 0.0,
    opacity: float = 1.0,
) -> tuple[list[Shape], list[Shape]]:
    """Return casings, and what lies above them, of closed rings of areas, lines and points (n, 2; mm).

    A unit of the style is `unit` mm, and lines are at least `width` mm wide. Hatches are filled.
    """
    wide, edge = max(unit * float(style["width"]), width), 2.0 * unit * float(style["casing_width"])
    casings, above, outlines = list[Shape](), list[Shape](), [*lines, *rings]
    if style["fill"] and rings:
        above.append(Polygons(rings, rgb_from_hex(style["fill"]), opacity * float(style["fill_opacity"])))
    if not style["colour"] or wide <= 0.0:
        return casings, above
    if outlines:
        dashes = tuple(unit * float(each) for each in str(style["dash"]).split())
        above.append(Polylines(outlines, rgb_from_hex(style["colour"]), wide, opacity, dashes))
        if style["casing"] and edge > 0.0:
            casings.append(Polylines(outlines, rgb_from_hex(style["casing"]), wide + edge, opacity))
    if points:
        circle = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        disc = 0.5 * wide * np.stack([np.cos(circle), np.sin(circle)], axis=-1)
        above.append(Polygons([at + disc for at in points], rgb_from_hex(style["colour"]), opacity))
    return casings, above


class LabelSpace:
    """Space of a map for labels and symbols without overlap."""

    def __init__(self, box: Box) -> None:
        left, top, width, height = box
        self._frame = shapely.box(left, top, left + width, top + height)
        self._occupied: list[shapely.Geometry] = []

    def reserve(self, area: shapely.Geometry) -> bool:
        """Occupy an area within the map unless occupied; return whether it succeeded."""
        free = bool(self._frame.contains(area) and not shapely.intersects(area, self._occupied).any())
        if free:
            self._occupied.append(area)
        return free


def rectangle(left: float, top: float, width: float, height: float) -> Points:
    """Return the closed ring around a box (mm)."""
    right, bottom = left + width, top + height
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom], [left, top]], np.float64)


def sheet_svg(sheet: MapSheet, *, embed_font: bool = True) -> str:
    """Return a sheet as SVG, deterministically."""
    parts = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{sheet.width:.2f}mm" height="{sheet.height:.2f}mm"',
        f'viewBox="0 0 {_units(sheet.width)} {_units(sheet.height)}" xml:space="preserve"',
        f'font-family="{FONTS}" stroke-linecap="round" stroke-linejoin="round">',
        f"<title>{escape(sheet.title)}</title>",
        f'<rect width="100%" height="100%" fill="{_hex(PAPER)}"/>',
    ]
    if embed_font:
        source = _data_uri("font/ttf", _font().font_bytes)
        parts.append(f"<style>@font-face{{font-family:Aileron;src:url({source})}}</style>")
    for name, shapes in sheet.layers.items():
        parts += [f'<g id="{name}">', *map(_element, shapes), "</g>"]
    return "\n".join([*parts, "</svg>\n"])


def sheet_png(sheet: MapSheet, *, width: int) -> bytes:
    """Return a sheet as a PNG of a width (px)."""
    svg = sheet_svg(sheet, embed_font=False)
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "aileron.ttf").write_bytes(_font().font_bytes)
        # Other fonts are only needed for letters of a sketch's name.
        own, paper = svg.replace("·", "").isascii(), _hex(PAPER)
        return resvg_py.svg_to_bytes(
            svg_string=svg, width=width, dpi=96.0, background=paper, font_dirs=[folder], skip_system_fonts=own
        )


def _element(shape: Shape) -> str:
    if isinstance(shape, MapText):
        return _text(shape)
    if isinstance(shape, RasterImage):
        stream = io.BytesIO()
        Image.fromarray(shape.pixels).save(stream, format="PNG", compress_level=7)
        left, top, width, height = map(_units, shape.box)
        box = f'x="{left}" y="{top}" width="{width}" height="{height}" preserveAspectRatio="none"'
        return f'<image {box} href="{_data_uri("image/png", stream.getvalue())}"/>'
    if isinstance(shape, Polygons):
        data = "".join(f"{_path(ring)}z" for ring in shape.paths)
        pen = f'fill="{_hex(shape.colour)}" fill-opacity="{shape.opacity:g}" fill-rule="evenodd"'
    else:
        data = "".join(map(_path, shape.paths))
        pen = f'fill="none" stroke="{_hex(shape.colour)}" stroke-opacity="{shape.opacity:g}"'
        pen += f' stroke-width="{_units(shape.width)}"'
        if shape.dashes:
            pen += f' stroke-dasharray="{" ".join(str(_units(length)) for length in shape.dashes)}"'
    return f'<path {pen} d="{data}"/>'


def _path(points: Points) -> str:
    """Return a simplified polyline as SVG path data in relative steps."""
    line = shapely.simplify(shapely.LineString(points), TOLERANCE, preserve_topology=False)
    whole = np.rint(shapely.get_coordinates(line) * UNITS).astype(np.int64)
    steps = np.diff(whole, axis=0).tolist()
    # A minus separates as well as a space does.
    return f"M{whole[0, 0]} {whole[0, 1]}l" + " ".join(f"{x} {y}" for x, y in steps).replace(" -", "-")


def _text(label: MapText) -> str:
    x, y = _units(label.x), _units(label.y)
    # In any font the text gets the measured width.
    look = f'text-anchor="{label.anchor}" textLength="{_units(label.width)}" lengthAdjust="spacingAndGlyphs"'
    look += f' font-size="{_units(label.size)}" fill="{_hex(label.colour)}"'
    if label.halo or label.bold:
        width = _units(label.size * (HALO if label.halo else BOLD))
        look += f' paint-order="stroke" stroke="{_hex(label.halo or label.colour)}" stroke-width="{width}"'
    if label.turn:
        look += f' transform="rotate({label.turn:.2f} {x} {y})"'
    return f'<text x="{x}" y="{y + _units(label.size * CENTRE)}" {look}>{escape(label.text)}</text>'


def _units(number: float) -> int:
    return round(number * UNITS)


def _hex(colour: Colour) -> str:
    return f"#{bytes(colour).hex()}"


def _data_uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode('ascii')}"


@cache
def _font() -> ImageFont.FreeTypeFont:
    """Return Aileron Regular (CC0), bundled with Pillow, at the size for measuring."""
    return cast("ImageFont.FreeTypeFont", ImageFont.load_default(100.0))
