"""Display colours of labels, and sRGB to Oklab conversion.

Oklab: Björn Ottosson, "A perceptual color space for image processing", 2020.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array
from sketchterrain.sketch.parameters import LAYERS

DRAW_ORDER: Final = ("material", "mountain", "hill", "dune", "forest", "lake", "river")
"""Layers from bottom to top; thin shapes are drawn last."""

LIGHT_HATCH: Final = ("forest", "river")
"""Dark layers, which have a light hatch."""

_SHADES = 16  # distinct labels; later ones repeat

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


def label_rgb(layer: str, label: int) -> tuple[int, int, int]:
    """Return the sRGB colour, 0 to 255, of a label, 1 to 255: a distinct shade of its layer's colour."""
    return _shades(layer)[(label - 1) % _SHADES]


def to_oklab(colours: npt.ArrayLike) -> Float64Array:
    """Return sRGB colours in 0 … 1, (…, 3), in Oklab: lightness 0 to 1, and two hue axes, about ±0.4."""
    encoded = np.asarray(colours, dtype=np.float64)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return np.asarray(np.cbrt(linear @ _TO_LMS.T) @ _TO_LAB.T)


@lru_cache(maxsize=16)
def _shades(layer: str) -> tuple[tuple[int, int, int], ...]:
    """Return the colours of labels 1, 2, …: each as far from those before it as the layer's hues allow."""
    light, *_ = base = to_oklab(np.array(LAYERS[layer].colour) / 255.0)
    chroma, hue = np.hypot(base[1], base[2]), np.arctan2(base[2], base[1])
    lights = np.linspace(0.34, 0.66, 5) if layer in LIGHT_HATCH else np.linspace(0.52, 0.88, 6)
    hues = hue + np.deg2rad([0.0, 15.0, -15.0, 30.0, -30.0])
    chromas = max(chroma, 0.03) * np.array([0.8, 1.25])
    grid = np.stack(np.meshgrid(lights, chromas, hues, indexing="ij"), axis=-1).reshape(-1, 3)
    lab = np.stack([grid[:, 0], grid[:, 1] * np.cos(grid[:, 2]), grid[:, 1] * np.sin(grid[:, 2])], axis=-1)
    chosen = [np.array([light, base[1], base[2]])]
    # Hue weighs less than lightness, which colour-blind users see.
    weight = np.array([1.0, 0.6, 0.6])
    nearest = np.full(len(lab), np.inf)
    for _ in range(_SHADES - 1):
        nearest = np.minimum(nearest, np.sqrt((((lab - chosen[-1]) * weight) ** 2).sum(axis=1)))
        score = nearest - 0.12 * np.abs(grid[:, 2] - hue) / np.pi
        chosen.append(lab[int(np.argmax(score))])
    colours = [LAYERS[layer].colour, *(_rgb(each) for each in chosen[1:])]
    return tuple((int(r), int(g), int(b)) for r, g, b in colours)


def _rgb(lab: Float64Array) -> tuple[int, int, int]:
    linear = np.clip(np.linalg.solve(_TO_LMS, np.linalg.solve(_TO_LAB, lab) ** 3), 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1.0 / 2.4) - 0.055)
    red, green, blue = np.rint(255.0 * np.clip(encoded, 0.0, 1.0)).astype(int)
    return int(red), int(green), int(blue)
