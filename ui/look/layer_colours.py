"""Colours, hatches, swatches and glyphs of layers and labels."""

import math
import operator
from collections.abc import Callable
from functools import cache, lru_cache, partial
from itertools import product
from typing import Any, Final, cast

import numpy as np
from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QBrush, QColor, QImage, QPainter, QPainterPath, QPen, QPixmap, QPolygonF

from sketchterrain.array_types import Float32Array
from sketchterrain.document.label_layers import label_rgb
from sketchterrain.schema.layers import LAYERS

_HATCH_STRENGTH = 0.42


def label_colour(layer: str, label: int) -> QColor:
    """Return a label's colour, a distinct shade of its layer's."""
    return QColor(*label_rgb(layer, label))


def hatch_colour(layer: str) -> QColor:
    """Return the line colour, with alpha, of a layer's hatch."""
    if LAYERS[layer].light_hatch:
        return QColor(255, 255, 255, round(255 * _HATCH_STRENGTH))
    red, green, blue = (round(0.3 * part) for part in LAYERS[layer].colour)
    return QColor(red, green, blue, round(255 * _HATCH_STRENGTH))


@lru_cache(maxsize=512)
def swatch(layer: str, label: int, size: int, dpr: float = 1.0) -> QPixmap:
    """Return a label's swatch (logical px): its colour and its layer's hatch."""
    if not LAYERS[layer].is_painted:
        return colour_swatch(*LAYERS[layer].classes[0].colours, size, dpr)
    colour = label_colour(layer, label)
    brushes = QBrush(colour), QBrush(_hatch_image(layer, dpr))
    return _filled_square(brushes, QPen(colour.darker(160), 1.0), size, dpr)


@lru_cache(maxsize=512)
def colour_swatch(line: str, fill: str, size: int, dpr: float = 1.0) -> QPixmap:
    """Return the swatch (logical px) of colours of lines and areas, each ``#rrggbb`` or empty."""
    brushes = (QBrush(QColor(fill)),) if fill else ()
    return _filled_square(brushes, QPen(QColor(line or fill or "#808080"), 3.0), size, dpr)


def _filled_square(brushes: tuple[QBrush, ...], pen: QPen, size: int, dpr: float) -> QPixmap:
    pixmap = QPixmap(round(size * dpr), round(size * dpr))
    pixmap.setDevicePixelRatio(dpr)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    outline, inset = QPainterPath(), 0.5 * pen.widthF()
    side = size - 2.0 * inset
    outline.addRoundedRect(QRectF(inset, inset, side, side), 0.2 * size, 0.2 * size)
    for brush in brushes:
        painter.fillPath(outline, brush)
    painter.setPen(pen)
    painter.drawPath(outline)
    painter.end()
    return pixmap


def _hatch_image(layer: str, dpr: float) -> QImage:
    covered = hatch(LAYERS[layer].hatch, hatch_period(dpr))
    colour = hatch_colour(layer)
    pixels = np.empty((*covered.shape, 4), np.uint8)
    pixels[..., :3] = colour.red(), colour.green(), colour.blue()
    pixels[..., 3] = np.rint(covered * colour.alpha())
    side = len(covered)
    image = QImage(pixels.tobytes(), side, side, 4 * side, QImage.Format.Format_RGBA8888).copy()
    image.setDevicePixelRatio(dpr)
    return image


PERIOD: Final = 16  # period of every hatch, px at a device pixel ratio of 1


def hatch_period(ratio: float) -> int:
    """Return the period of hatches in device pixels at a device pixel ratio."""
    return max(round(PERIOD * ratio), 4)


@lru_cache(maxsize=64)
def hatch(kind: str, period: int) -> Float32Array:
    """Return the coverage of one period of a hatch, float32, (period, period)."""
    width, lines = HATCHES[kind]
    image, path = QImage(period, period, QImage.Format.Format_Grayscale8), QPainterPath()
    image.fill(0)
    for down, line in product((-PERIOD, 0, PERIOD), lines):
        points = zip(line[::2], line[1::2], strict=True)
        path.addPolygon(QPolygonF([QPointF(x, y + down) for x, y in points]))
    painter, cap, join = QPainter(image), Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    painter.scale(period / PERIOD, period / PERIOD)
    painter.strokePath(path, QPen(QColor(255, 255, 255), width, cap=cap, join=join))
    painter.end()
    pixels = np.frombuffer(cast(Any, image.constBits()).asstring(image.sizeInBytes()), np.uint8)
    covered = np.asarray(pixels.reshape(period, -1)[:, :period] / np.float32(255.0), np.float32)
    covered.flags.writeable = False
    return covered


_THIRDS: Final = (0.0, PERIOD / 3.0, PERIOD / 1.5)
_LEFT, _RIGHT = -PERIOD, 2 * PERIOD  # lines run through three periods from left to right
_GRID: Final = [
    (x, y) for x, y in product(range(_LEFT + 2, _RIGHT, 4), range(2, PERIOD, 4)) if (x - y) % 8 == 0
]


def _curve(y: float, step: int, height: Callable[[float], float]) -> tuple[float, ...]:
    return tuple(each for x in range(_LEFT, _RIGHT + 1, step) for each in (x, y - height(x)))


HATCHES: Final[dict[str, tuple[float, list[tuple[float, ...]]]]] = {
    "peaks": (1.15, [_curve(y, 4, lambda x: 0.9 * (x % 8)) for y in (4, 12)]),
    "waves": (1.15, [_curve(y, 1, lambda x: 1.9 * math.sin(math.tau * x / PERIOD)) for y in (4, 12)]),
    "falling": (1.04, [_curve(y, PERIOD, lambda x: -x) for y in _THIRDS]),
    "level": (1.15, [_curve(y, PERIOD, lambda _: 0.0) for y in _THIRDS]),
    "crossed": (0.97, [_curve(y, PERIOD, partial(operator.mul, sign)) for y in (0, 8) for sign in (1, -1)]),
    "dots": (2.3, [(x, y, x + 0.01, y) for x, y in _GRID]),
    "trees": (1.15, [line for x, y in _GRID for line in ((x - 2, y, x + 2, y), (x, y - 2, x, y + 2))]),
}
"""Width and lines of a period of each hatch, px at a device pixel ratio of 1."""


GLYPHS: Final[dict[str, tuple[tuple[float, ...], ...]]] = {
    "triangle": ((-5.0, 4.0), (0.0, -5.0), (5.0, 4.0), (-5.0, 4.0)),
    "arch": ((-5.5, 3.0), (-3.5, -5.0, 3.5, -5.0, 5.5, 3.0)),
    "crescent": ((-6.0, 2.5), (-3.0, 1.5, -1.5, -1.0, 0.5, -3.5), (0.5, -0.5, 2.5, 2.0, 6.0, 2.5)),
    "tree": ((0.0, 5.0), (0.0, 0.9), (-4.3, 0.9, -4.3, -5.5, 0.0, -5.5), (4.3, -5.5, 4.3, 0.9, 0.0, 0.9)),
}
"""Symbols of point features around the origin (px), distinct without colour: points and cubic curves."""

FILLED_GLYPHS: Final = ("triangle", "tree")  # those that are filled in the sketch


@cache
def layer_glyph(layer: str) -> QPainterPath:
    """Return the symbol of a layer's point features."""
    start, *parts = GLYPHS[LAYERS[layer].glyph]
    path = QPainterPath(QPointF(*start))
    for part in parts:
        (path.lineTo if len(part) == 2 else path.cubicTo)(*part)
    return path
