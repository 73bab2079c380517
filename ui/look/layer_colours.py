"""How layers and labels look, on the canvas and in lists: colour, hatch, swatch."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt
from PyQt6.QtCore import QRectF, Qt
from PyQt6.QtGui import QBrush, QColor, QImage, QPainter, QPainterPath, QPen, QPixmap

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.look.hatching import hatch, hatch_period

__all__ = ["DRAW_ORDER", "hatch_colour", "label_colour", "layer_pattern", "swatch"]

Floats = npt.NDArray[np.float64]

DRAW_ORDER: Final = ("material", "mountain", "hill", "dune", "forest", "lake", "river")
"""Layers as they lie over one another, the lowest first: what is thin is drawn last."""

_PATTERNS = {
    "mountain": "peaks",
    "hill": "waves",
    "river": "falling",
    "dune": "dots",
    "forest": "trees",
    "lake": "level",
    "material": "crossed",
}
_LIGHT_HATCH = ("forest", "river")
_SHADES = 16  # labels that differ; later ones begin again
_HATCH_STRENGTH = 0.42

# Björn Ottosson's Oklab, in which equal distances look equally far apart.
_TO_LMS = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)


def label_colour(layer: str, label: int) -> QColor:
    """Return a label's colour; labels of one layer are shades that differ plainly.

    Parameters
    ----------
    layer : str
        A name in `sketchterrain.sketch.LAYERS`.
    label : int
        1 to 255.
    """
    return QColor(*_shades(layer)[(label - 1) % _SHADES])


def layer_pattern(layer: str) -> str:
    """Return the hatch of a layer, one of `sketchterrain.ui.look.hatching.HATCHES`."""
    return _PATTERNS[layer]


def hatch_colour(layer: str) -> QColor:
    """Return the colour, with alpha, of the lines of a layer's hatch."""
    if layer in _LIGHT_HATCH:
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


@lru_cache(maxsize=16)
def _shades(layer: str) -> tuple[tuple[int, int, int], ...]:
    """Colours of the labels 1, 2, …: each as far from those before it as the layer's hues allow."""
    light, *_ = base = _lab(np.array(LAYERS[layer].colour) / 255.0)
    chroma, hue = np.hypot(base[1], base[2]), np.arctan2(base[2], base[1])
    lights = np.linspace(0.34, 0.66, 5) if layer in _LIGHT_HATCH else np.linspace(0.52, 0.88, 6)
    hues = hue + np.deg2rad([0.0, 15.0, -15.0, 30.0, -30.0])
    chromas = max(chroma, 0.03) * np.array([0.8, 1.25])
    grid = np.stack(np.meshgrid(lights, chromas, hues, indexing="ij"), axis=-1).reshape(-1, 3)
    lab = np.stack([grid[:, 0], grid[:, 1] * np.cos(grid[:, 2]), grid[:, 1] * np.sin(grid[:, 2])], axis=-1)
    kept = [np.array([light, base[1], base[2]])]
    # A hue of its own counts less than brightness: that is what colour-blind eyes see.
    weight = np.array([1.0, 0.6, 0.6])
    nearest = np.full(len(lab), np.inf)
    for _ in range(_SHADES - 1):
        nearest = np.minimum(nearest, np.sqrt((((lab - kept[-1]) * weight) ** 2).sum(axis=1)))
        score = nearest - 0.12 * np.abs(grid[:, 2] - hue) / np.pi
        kept.append(lab[int(np.argmax(score))])
    colours = [LAYERS[layer].colour, *(_rgb(each) for each in kept[1:])]
    return tuple((int(r), int(g), int(b)) for r, g, b in colours)


def _lab(colour: Floats) -> Floats:
    linear = np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
    return np.asarray(_TO_LAB @ np.cbrt(_TO_LMS @ linear))


def _rgb(lab: Floats) -> tuple[int, int, int]:
    linear = np.clip(np.linalg.solve(_TO_LMS, np.linalg.solve(_TO_LAB, lab) ** 3), 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    red, green, blue = np.rint(255.0 * np.clip(encoded, 0.0, 1.0)).astype(int)
    return int(red), int(green), int(blue)
