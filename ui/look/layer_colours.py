"""How layers and labels look, on the canvas and in lists: colour, hatch, swatch."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from PyQt6.QtCore import QRectF, Qt
from PyQt6.QtGui import QBrush, QColor, QImage, QPainter, QPainterPath, QPen, QPixmap

from sketchterrain.sketch import LAYERS
from sketchterrain.sketch.label_colours import DRAW_ORDER, LIGHT_HATCH, label_rgb
from sketchterrain.ui.look.hatching import hatch, hatch_period

__all__ = ["DRAW_ORDER", "hatch_colour", "label_colour", "layer_pattern", "swatch"]

_PATTERNS = {
    "mountain": "peaks",
    "hill": "waves",
    "river": "falling",
    "dune": "dots",
    "forest": "trees",
    "lake": "level",
    "material": "crossed",
}
_HATCH_STRENGTH = 0.42


def label_colour(layer: str, label: int) -> QColor:
    """Return a label's colour; labels of one layer are shades that differ plainly.

    Parameters
    ----------
    layer : str
        A name in `sketchterrain.sketch.LAYERS`.
    label : int
        1 to 255.
    """
    return QColor(*label_rgb(layer, label))


def layer_pattern(layer: str) -> str:
    """Return the hatch of a layer, one of `sketchterrain.ui.look.hatching.HATCHES`."""
    return _PATTERNS[layer]


def hatch_colour(layer: str) -> QColor:
    """Return the colour, with alpha, of the lines of a layer's hatch."""
    if layer in LIGHT_HATCH:
        return QColor(255, 255, 255, round(255 * _HATCH_STRENGTH))
    red, green, blue = (round(0.3 * part) for part in LAYERS[layer].colour)
    return QColor(red, green, blue, round(255 * _HATCH_STRENGTH))


@lru_cache(maxsize=512)
def swatch(layer: str, label: int, size: int, dpr: float = 1.0) -> QPixmap:
    """Return a small picture of a label for lists: its colour and its layer's hatch.

    Parameters
    ----------
    layer : str
    label : int
        1 to 255.
    size : int
        Logical pixels along its side.
    dpr : float
        Device pixels a logical one.
    """
    pixmap = QPixmap(round(size * dpr), round(size * dpr))
    pixmap.setDevicePixelRatio(dpr)
    pixmap.fill(Qt.GlobalColor.transparent)
    painter = QPainter(pixmap)
    painter.setRenderHint(QPainter.RenderHint.Antialiasing)
    outline = QPainterPath()
    outline.addRoundedRect(QRectF(0.5, 0.5, size - 1.0, size - 1.0), 0.2 * size, 0.2 * size)
    colour = label_colour(layer, label)
    painter.fillPath(outline, colour)
    lines = QBrush(_hatch_image(layer, dpr))
    painter.fillPath(outline, lines)
    painter.setPen(QPen(colour.darker(160), 1.0))
    painter.drawPath(outline)
    painter.end()
    return pixmap


def _hatch_image(layer: str, dpr: float) -> QImage:
    covered = hatch(layer_pattern(layer), hatch_period(dpr))
    colour = hatch_colour(layer)
    pixels = np.empty((*covered.shape, 4), np.uint8)
    pixels[..., :3] = colour.red(), colour.green(), colour.blue()
    pixels[..., 3] = np.rint(covered * colour.alpha())
    side = len(covered)
    image = QImage(pixels.tobytes(), side, side, 4 * side, QImage.Format.Format_RGBA8888).copy()
    image.setDevicePixelRatio(dpr)
    return image
