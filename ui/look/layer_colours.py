"""Colours, hatches, swatches and glyphs of layers and labels."""

from collections.abc import Callable
from functools import cache, lru_cache
from typing import Final

import numpy as np
from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QBrush, QColor, QImage, QPainter, QPainterPath, QPen, QPixmap

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

_LINE = 1.15  # px, width of a hatch's lines


def hatch_period(ratio: float) -> int:
    """Return the period of hatches in device pixels at a device pixel ratio."""
    return max(round(PERIOD * ratio), 4)


@lru_cache(maxsize=64)
def hatch(kind: str, period: int) -> Float32Array:
    """Return the coverage of one period of a hatch, float32, (period, period)."""
    middles = ((np.arange(period) + 0.5) * (PERIOD / period)).astype(np.float32)
    x, y = np.meshgrid(middles, middles)
    distance, half_width = HATCHES[kind](x, y)
    covered: Float32Array = np.clip((half_width - distance) * (period / PERIOD) + 0.5, 0.0, 1.0).astype(
        np.float32
    )
    covered.flags.writeable = False
    return covered


def _from_line(across: Float32Array, spacing: float) -> Float32Array:
    """Return the distance from the nearest of parallel lines, given a coordinate across them."""
    return np.asarray(np.abs((across + 0.5 * spacing) % spacing - 0.5 * spacing), np.float32)


def _peaks(x: Float32Array, y: Float32Array) -> tuple[Float32Array, float]:
    tooth: Float32Array = np.abs((x % np.float32(8.0)) - np.float32(4.0))
    return _from_line(y + np.float32(0.9) * tooth, 8.0) * np.float32(0.743), 0.5 * _LINE


def _waves(x: Float32Array, y: Float32Array) -> tuple[Float32Array, float]:
    swing = np.float32(1.9) * np.sin(np.float32(2.0 * np.pi / PERIOD) * x)
    return _from_line(y + swing, 8.0) * np.float32(0.88), 0.5 * _LINE


def _crossed(x: Float32Array, y: Float32Array) -> tuple[Float32Array, float]:
    slope = np.float32(np.sqrt(0.5))
    return np.minimum(_from_line(x - y, 8.0), _from_line(x + y, 8.0)) * slope, 0.42 * _LINE


def _nearest(x: Float32Array, y: Float32Array) -> tuple[Float32Array, Float32Array]:
    """Return the offsets from the nearest point of a staggered 8 px grid."""
    best = np.full(x.shape, np.inf, np.float32)
    east, south = np.zeros_like(x), np.zeros_like(y)
    for shift_x, shift_y in ((2.0, 2.0), (6.0, 6.0)):
        dx = (x - shift_x + 4.0) % 8.0 - 4.0
        dy = (y - shift_y + 4.0) % 8.0 - 4.0
        nearer = np.hypot(dx, dy) < best
        best = np.where(nearer, np.hypot(dx, dy), best)
        east, south = np.where(nearer, dx, east), np.where(nearer, dy, south)
    return east, south


def _trees(x: Float32Array, y: Float32Array) -> tuple[Float32Array, float]:
    dx, dy = _nearest(x, y)
    upright = np.maximum(np.abs(dx), np.abs(dy) - 2.0)
    across = np.maximum(np.abs(dy), np.abs(dx) - 2.0)
    return np.minimum(upright, across), 0.5 * _LINE


HATCHES: Final[dict[str, Callable[[Float32Array, Float32Array], tuple[Float32Array, float]]]] = {
    "peaks": _peaks,
    "waves": _waves,
    "falling": lambda x, y: (_from_line(x - y, 5.0 + 1.0 / 3.0) * np.float32(np.sqrt(0.5)), 0.45 * _LINE),
    "level": lambda x, y: (_from_line(y + 0.0 * x, 5.0 + 1.0 / 3.0), 0.5 * _LINE),
    "crossed": _crossed,
    "dots": lambda x, y: (np.hypot(*_nearest(x, y)), 1.15),
    "trees": _trees,
}
"""Distance from a hatch's lines and half their width, px at a device pixel ratio of 1."""


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
