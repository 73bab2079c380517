"""The picture that lies under a map: the ground's colours, lit softly from several sides."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import numpy as np
from scipy.ndimage import gaussian_filter

from sketchterrain.terrain import MATERIALS

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.export.map_ground import MapGround
    from sketchterrain.export.map_sheet import Colour

    Floats = npt.NDArray[np.float32]

__all__ = ["TINTS", "relief_picture"]

TINTS: Final[dict[str, Colour]] = {
    "grass": (223, 230, 194),
    "soil": (228, 220, 190),
    "rock": (209, 204, 199),
    "scree": (226, 218, 204),
    "sand": (252, 236, 200),
    "snow": (240, 246, 252),
    "river_bed": (226, 226, 203),
    "forest_floor": (212, 224, 182),
}
"""Of each material on paper."""
SUNS: Final = ((315.0, 0.46), (270.0, 0.2), (0.0, 0.2), (225.0, 0.14))
"""Compass bearing of each light, and its share: after Mark (1992), but the north-west leads."""
ELEVATION: Final = 45.0
"""Degrees above the horizon of all of them."""
SIZES: Final = ((0.0, 0.5), (3.0, 0.3), (12.0, 0.2))
"""How far the relief is evened out (samples) and its share in the shade: small forms and large ones."""
STEEP: Final = 0.9
"""Slope to which the steep tenth of the ground is raised or lowered before it is lit."""
EXAGGERATION: Final = (0.8, 6.0)
SHADOW: Final = (0.55, 0.55, 0.66)
"""What a full shadow leaves of red, green and blue."""
LIGHT: Final = (255.0, 252.0, 236.0)
LIGHT_SHARE: Final = 0.55
"""How much of that light a slope takes on that faces it."""
HOLLOW: Final = 0.16
"""How much darker the deepest hollows are."""
HOLLOW_SIZE: Final = 9.0
"""Samples over which they are hollow."""
LOW: Final = (0.93, 0.965, 0.935)
HIGH: Final = (1.05, 1.02, 0.99)
"""Factors of colour at the lowest and the highest ground."""
FAINT: Final = 0.78
"""Contrast of the lowest ground over that of the highest: what is high is near to the eye (Imhof 1965)."""


def relief_picture(ground: MapGround) -> npt.NDArray[np.uint8]:
    """Return a pixel for each sample of the ground, (rows, columns, 3), row 0 north."""
    tints = np.array([TINTS[name] for name in MATERIALS], np.float32)
    colour = ground.cover @ tints / np.maximum(ground.cover.sum(axis=-1, keepdims=True), 1e-6)
    height = ground.fine
    low, high, shadow, light = (np.array(factor, np.float32) for factor in (LOW, HIGH, SHADOW, LIGHT))
    rise = _rise(height)[..., None]
    colour *= low + rise * (high - low)
    lit = _light(ground)
    flat = np.float32(np.sin(np.radians(ELEVATION)))
    contrast = FAINT + (1.0 - FAINT) * rise[..., 0]
    dark = np.clip((flat - lit) / flat * contrast, 0.0, 1.0)[..., None]
    bright = np.clip((lit - flat) / (1.0 - flat) * contrast, 0.0, 1.0)[..., None]
    colour *= 1.0 - dark * (1.0 - shadow)
    colour += LIGHT_SHARE * bright * (light - colour)
    colour *= 1.0 - HOLLOW * _hollows(height)[..., None]
    return np.asarray(np.clip(np.rint(colour), 0, 255), np.uint8)


def _rise(height: Floats) -> Floats:
    """Return 0 … 1 from the lowest to the highest ground: half by height, half by how much lies lower."""
    share = np.linspace(0.0, 100.0, 65)
    steps = np.percentile(height, share)
    rank = np.interp(height, steps, share / 100.0)
    part = (height - steps[0]) / max(float(steps[-1] - steps[0]), 1e-6)
    return np.asarray(0.5 * rank + 0.5 * part, np.float32)


def _light(ground: MapGround) -> Floats:
    """Return the mean cosine of incidence of all lights, over the forms of all sizes."""
    total = np.zeros(ground.fine.shape, np.float32)
    for sigma, share in SIZES:
        height = gaussian_filter(ground.fine, sigma) if sigma else ground.fine
        east, north = _slopes(height, ground.spacing)
        steep = float(np.percentile(np.hypot(east, north), 90.0))
        times = np.float32(np.clip(STEEP / max(steep, 1e-6), *EXAGGERATION))
        east, north = east * times, north * times
        length = np.sqrt(1.0 + east**2 + north**2)
        up, level = np.sin(np.radians(ELEVATION)), np.cos(np.radians(ELEVATION))
        for bearing, part in SUNS:
            x, y = np.sin(np.radians(bearing)) * level, np.cos(np.radians(bearing)) * level
            lit = (np.float32(up) - east * np.float32(x) - north * np.float32(y)) / length
            total += np.float32(share * part) * np.maximum(lit, 0.0)
    return total


def _slopes(height: Floats, spacing: tuple[float, float]) -> tuple[Floats, Floats]:
    """Return the rise over run eastward and northward."""
    south, east = np.gradient(height, spacing[1], spacing[0])
    return np.asarray(east, np.float32), np.asarray(-south, np.float32)


def _hollows(height: Floats) -> Floats:
    """Return 0 … 1: how far the ground lies under what surrounds it."""
    under = np.maximum(gaussian_filter(height, HOLLOW_SIZE) - height, 0.0)
    deep = float(np.percentile(under, 99.0))
    return np.asarray(np.clip(under / max(deep, 1e-6), 0.0, 1.0), np.float32)
