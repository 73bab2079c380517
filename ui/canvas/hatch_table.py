"""The hatches of any mixture of layers, and the lines around what is painted, for pixels of the screen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.ui.canvas.flattening import MASK
from sketchterrain.ui.look.hatching import hatch, hatch_period

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.ui.canvas.flattening import Codes, Colours

__all__ = ["HatchTable", "LayerHatch"]

_BENEATH = 0.35  # share of its strength that a hatch keeps below another layer
_OUTLINE = (30, 26, 22)  # red, green, blue
_OUTLINE_STRENGTH = 0.5


@dataclass(frozen=True)
class LayerHatch:
    """A layer's hatch.

    Attributes
    ----------
    kind : str
        One of `sketchterrain.ui.look.hatching.HATCHES`.
    colour : (int, int, int)
        Red, green, blue, 0 to 255.
    strength : float
        0 … 1.
    """

    kind: str
    colour: tuple[int, int, int]
    strength: float


class HatchTable:
    """Draws hatches and outlines from codes.

    Parameters
    ----------
    hatches : sequence of LayerHatch
        By bit of `MASK`.
    ratio : float
        Device pixels a logical one.
    """

    def __init__(self, hatches: Sequence[LayerHatch], ratio: float) -> None:
        self._period = hatch_period(ratio)
        self._table = _table(hatches, self._period)
        self._line = max(round(ratio), 1)
        red, green, blue = (round(part * _OUTLINE_STRENGTH) for part in _OUTLINE)
        self._outline = np.uint32(round(255 * _OUTLINE_STRENGTH) << 24 | red << 16 | green << 8 | blue)

    @property
    def halo(self) -> int:
        """Pixels around the wanted ones whose codes are needed."""
        return self._line

    def drawn(self, codes: Codes, x: int, y: int) -> Colours:
        """Return hatches and outlines.

        Parameters
        ----------
        codes : (height + 2·halo, width + 2·halo) uint16
            Of each pixel of the screen, and of those around them.
        x, y : int
            Of the first pixel, from the sheet's corner, so that hatches move with the sheet.

        Returns
        -------
        (height, width) uint32, 0xAARRGGBB, premultiplied.
        """
        halo, period = self._line, self._period
        inner = codes[halo:-halo, halo:-halo]
        height, width = inner.shape
        across = (np.arange(x, x + width) % period).astype(np.uint32)
        down = (np.arange(y, y + height) % period).astype(np.uint32) * np.uint32(period)
        index = (inner & np.uint16(MASK)).astype(np.uint32)
        index *= np.uint32(period * period)
        index += across
        index += down[:, None]
        pixels: Colours = np.take(self._table, index)
        changed = np.zeros(inner.shape, bool)
        for step in range(halo):
            first = codes[halo:-halo, halo - step : width + halo - step]
            changed |= first != codes[halo:-halo, halo - step + 1 : width + halo - step + 1]
            first = codes[halo - step : height + halo - step, halo:-halo]
            changed |= first != codes[halo - step + 1 : height + halo - step + 1, halo:-halo]
        pixels[changed] = self._outline
        return pixels


def _table(hatches: Sequence[LayerHatch], period: int) -> Colours:
    """Pixels by mask, row and column, flattened."""
    colour = np.zeros((MASK + 1, period, period, 3), np.float32)
    alpha = np.zeros((MASK + 1, period, period, 1), np.float32)
    masks = np.arange(MASK + 1)
    for bit, layer in enumerate(hatches):
        painted = (masks >> bit & 1) == 1
        cover = hatch(layer.kind, period)[None, :, :, None] * np.float32(layer.strength)
        kept = (1.0 - cover) * np.float32(_BENEATH)
        colour[painted] = colour[painted] * kept + np.array(layer.colour, np.float32) * cover
        alpha[painted] = alpha[painted] * kept + cover
    red, green, blue = np.moveaxis(np.rint(colour).astype(np.uint32), -1, 0)
    packed = np.rint(255.0 * alpha[..., 0]).astype(np.uint32) << np.uint32(24)
    table: npt.NDArray[np.uint32] = packed | red << np.uint32(16) | green << np.uint32(8) | blue
    return table.ravel()
