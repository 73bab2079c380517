"""Map of where landforms differ from real land: hollows, rising channels, walls."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont
from scipy import ndimage

from sketchterrain.export.files import write_png

if TYPE_CHECKING:
    from sketchterrain.terrain.realism import Realism

COLOURS: Final = {"hollow": (40, 110, 220), "rising": (204, 40, 120), "wall": (230, 130, 0)}
"""Colours of the faults, distinct for colour-blind readers."""

_MEANINGS = {
    "hollow": "closed hollow",
    "rising": "channel that rises",
    "wall": "steeper than real land's 95 %",
}
_TINT = 0.7
_SHORTER_SIDE = 768  # px
_LEGEND_HEIGHT = 34  # px
_SUN = np.array([-0.5, 0.5, 0.7]) / np.linalg.norm([-0.5, 0.5, 0.7])


def write_realism_map(path: Path, realism: Realism) -> Path:
    """Write a hillshade with the faults of :meth:`Realism.fault_maps` and a legend, as a PNG."""
    image = Image.fromarray(realism_pixels(realism))
    scale = max(_SHORTER_SIDE / min(image.size), 1.0)
    size = (round(image.width * scale), round(image.height * scale))
    sheet = Image.new("RGB", (size[0], size[1] + _LEGEND_HEIGHT), (255, 255, 255))
    sheet.paste(image.resize(size, Image.Resampling.NEAREST))
    draw, font, left = ImageDraw.Draw(sheet), ImageFont.load_default(14), 10.0
    for name, colour in COLOURS.items():
        draw.rectangle((left, size[1] + 9, left + 16, size[1] + 25), fill=colour)
        draw.text((left + 24, size[1] + 8), _MEANINGS[name], fill=(40, 40, 40), font=font)
        left += 24 + draw.textlength(_MEANINGS[name], font=font) + 24
    return write_png(path, np.asarray(sheet, np.uint8))


def realism_pixels(realism: Realism) -> npt.NDArray[np.uint8]:
    """Return a hillshade with coloured faults, (rows, columns, 3)."""
    south, east = np.gradient(np.where(np.isfinite(realism.height), realism.height, 0.0), realism.cell)
    light = (_SUN[2] - east * _SUN[0] + south * _SUN[1]) / np.sqrt(1.0 + east**2 + south**2)
    pixels = np.repeat(60.0 + 185.0 * np.clip(light, 0.0, 1.0)[..., None], 3, axis=-1)
    faults = realism.fault_maps()
    faults["rising"] = ndimage.binary_dilation(faults["rising"], np.ones((2, 2), np.bool_))
    for name in ("wall", "hollow", "rising"):
        colour = np.array(COLOURS[name])
        pixels[faults[name]] = (1.0 - _TINT) * pixels[faults[name]] + _TINT * colour
    return np.asarray(np.clip(pixels, 0, 255), np.uint8)
