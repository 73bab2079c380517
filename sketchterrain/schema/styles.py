"""Styles of features: how they look on the canvas, the terrain, maps, and in GIS projects."""

from __future__ import annotations

from dataclasses import replace
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from sketchterrain.schema.materials import Colour
from sketchterrain.schema.parameters import LOOK, Parameter, Properties, defaults, parameter_table

_COLOUR: Final = LOOK["colour"]

STYLE: Final = parameter_table(
    replace(_COLOUR, default="#e03131", help="colour of lines, outlines and points; empty draws none"),
    replace(_COLOUR, name="fill", help="colour inside of areas; empty leaves them open"),
    Parameter("fill_opacity", float, 0.5, 0.0, 1.0, "", "of the inside of areas"),
    Parameter(
        *("width", float, 2.0, 0.0, 10000.0, ""),
        "of lines and outlines, diameter of points, in its unit",
        soft_range=(0.0, 20.0),
    ),
    Parameter("unit", str, "px", 0, 2, "", "of width and dashes", choices=("m", "px")),
    Parameter(
        *("dash", str, "", 0, 80, ""),
        "lengths of dashes and gaps in turn, as 6 3; empty is a solid line",
        form=(r"\d+(\.\d+)?( \d+(\.\d+)?){1,7}", 'lengths as "6 3"'),
    ),
    Parameter("cap", str, "round", 0, 6, "", "ends of lines", choices=("butt", "round", "square")),
    Parameter("join", str, "round", 0, 5, "", "corners of lines", choices=("bevel", "mitre", "round")),
    replace(_COLOUR, name="casing", help="colour along both sides of lines; empty draws none"),
    Parameter(
        *("casing_width", float, 1.0, 0.0, 1000.0, ""),
        "of the casing on each side, in the unit of width",
        soft_range=(0.0, 10.0),
    ),
    Parameter("hatch", str, "none", 0, 5, "", "of the inside of areas", choices=("cross", "lines", "none")),
    Parameter("hatch_angle", float, 45.0, -360.0, 360.0, "°", "of its lines, counterclockwise from east"),
    Parameter(
        *("hatch_spacing", float, 10.0, 0.1, 10000.0, ""),
        "from one of its lines to the next, in the unit of width",
        soft_range=(2.0, 50.0),
    ),
    Parameter("unlit", int, 0, 0, 1, "", "whether light and haze leave the colours, in painted tiles"),
    Parameter("label", str, "", 0, 80, "", "property that labels features; empty labels none"),
    Parameter("label_size", float, 13.0, 6.0, 72.0, "px", "height of labels", soft_range=(8.0, 32.0)),
    replace(_COLOUR, name="label_colour", default="#202020", help="of labels; they have a pale outline"),
)
"""Keys of the style of a draped layer, of its classes, and of the classes of a sketch's vectors."""

PIXEL: Final = 0.2
"""Millimetres on a map of a pixel."""


class StyleClass(NamedTuple):
    """Features of a layer of vectors that look alike: those with a value of a property, or at least that."""

    title: str  # in legends
    style: Properties  # by the names in `STYLE`; features that are wider than it are drawn as they are
    value: float | str = 0.0

    @property
    def casing_width(self) -> float:
        """Width of the casing on each side, 0 without one."""
        return float(self.style["casing_width"]) if self.style["casing"] else 0.0

    @property
    def colours(self) -> tuple[str, str]:
        """Colours of borders and insides."""
        border = self.style["casing"] or self.style["colour"]
        return border, self.style["fill"] or self.style["colour"]


def style_class(title: str, value: float | str = 0.0, **style: Any) -> StyleClass:
    """Return a class with a style of which other keys than the given ones have their defaults."""
    return StyleClass(title, MappingProxyType({**defaults(STYLE), **style}), value)


def rgb_from_hex(colour: str) -> Colour:
    """Return sRGB of a colour such as #e03131."""
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue
