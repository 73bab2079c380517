"""What is drawn on a sheet of paper: shapes in millimetres, which writers turn into pixels or vectors."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cache
from typing import TYPE_CHECKING, Final, TypeAlias

from PIL import ImageFont

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    import numpy.typing as npt

    Path = npt.NDArray[np.float64]

__all__ = ["Areas", "Box", "Colour", "Layer", "Lines", "Picture", "Shape", "Sheet", "Words", "text_width"]

Colour: TypeAlias = tuple[int, int, int]
Box: TypeAlias = tuple[float, float, float, float]
"""Left, top, width, height (mm)."""

_MEASURED_AT: Final = 100  # px


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines of one pen, with round ends.

    Attributes
    ----------
    paths : sequence of (n, 2) float64
        x to the right, y down (mm).
    colour : Colour
    width : float
        mm.
    opacity : float
        0 … 1.
    """

    paths: Sequence[Path]
    colour: Colour
    width: float
    opacity: float = 1.0


@dataclass(frozen=True, eq=False)
class Areas:
    """Areas of one colour: inside an odd number of rings.

    Attributes
    ----------
    rings : sequence of (n, 2) float64
        x to the right, y down (mm); closed by themselves, not crossing each other.
    colour : Colour
    opacity : float
        0 … 1.
    """

    rings: Sequence[Path]
    colour: Colour
    opacity: float = 1.0


@dataclass(frozen=True)
class Words:
    """A line of text.

    Attributes
    ----------
    text : str
    x, y : float
        Where its anchor lies (mm): the middle of its height.
    size : float
        Of the font (mm).
    colour : Colour
    anchor : str
        ``start``, ``middle`` or ``end`` of the text.
    turn : float
        Degrees clockwise about the anchor.
    bold : bool
    halo : Colour or None
        Drawn around the letters, so that they stand out from what lies below.
    """

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
        """Of the text (mm)."""
        return text_width(self.text, self.size)


@dataclass(frozen=True, eq=False)
class Picture:
    """Pixels laid on the sheet.

    Attributes
    ----------
    pixels : (rows, columns, 3) uint8
        Row 0 on top.
    box : Box
    """

    pixels: npt.NDArray[np.uint8]
    box: Box


Shape: TypeAlias = Lines | Areas | Words | Picture


@dataclass(frozen=True, eq=False)
class Layer:
    """Shapes that belong together, drawn one over the other.

    Attributes
    ----------
    name : str
        Letters, digits and hyphens.
    shapes : list of Shape
    clip : Box or None
        Nothing outside is drawn.
    """

    name: str
    shapes: list[Shape] = field(default_factory=list)
    clip: Box | None = None


@dataclass(frozen=True, eq=False)
class Sheet:
    """A sheet of paper.

    Attributes
    ----------
    title : str
    width, height : float
        mm.
    layers : list of Layer
        The first lies below.
    paper : Colour
    """

    title: str
    width: float
    height: float
    layers: list[Layer]
    paper: Colour = (255, 255, 255)


def text_width(text: str, size: float) -> float:
    """Return how wide a text of a font size is, both in mm."""
    return float(_font().getlength(text)) * size / _MEASURED_AT


@cache
def _font() -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    return ImageFont.load_default(_MEASURED_AT)
