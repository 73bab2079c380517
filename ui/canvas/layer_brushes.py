"""Colours, opacities and hatches of the visible layers, and hatches of any mixture of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from sketchterrain.sketch.label_colours import DRAW_ORDER
from sketchterrain.ui.canvas.flattening import MASK, Codes, Colours, Floats, Paint
from sketchterrain.ui.look.layer_colours import (
    hatch,
    hatch_colour,
    hatch_period,
    label_colour,
    layer_pattern,
)
from sketchterrain.ui.models.workspace import Workspace

_BENEATH = 0.35  # share of its strength that a hatch keeps below another layer
_OUTLINE = (30, 26, 22)  # red, green, blue
_OUTLINE_STRENGTH = 0.5


@dataclass(frozen=True)
class LayerHatch:
    """A layer's hatch."""

    kind: str  # One of `sketchterrain.ui.look.hatching.HATCHES`
    colour: tuple[int, int, int]  # Red, green, blue, 0 to 255
    strength: float  # 0 … 1


class HatchTable:
    """Draws hatches and outlines from codes."""

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
        """Return hatches and outlines."""
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


def visible_layers(workspace: Workspace) -> tuple[str, ...]:
    """Return the layers that are shown, the lowest first."""
    looks = {name: workspace.look(name) for name in DRAW_ORDER}
    return tuple(name for name, look in looks.items() if look.visible and look.opacity > 0.0)


def paints_of(workspace: Workspace) -> tuple[Paint, ...]:
    """Return the paints of the layers that are shown, the lowest first."""
    return tuple(
        Paint(name, _colours(name), workspace.look(name).opacity) for name in visible_layers(workspace)
    )


def hatches_of(workspace: Workspace) -> tuple[LayerHatch, ...]:
    """Return the hatches of the layers that are shown, in the order of `paints_of`."""
    hatches = []
    for name in visible_layers(workspace):
        colour, opacity = hatch_colour(name), workspace.look(name).opacity
        # A hatch stays readable where its paint is thin.
        strength = colour.alphaF() * (0.4 + 0.6 * opacity)
        hatches.append(
            LayerHatch(layer_pattern(name), (colour.red(), colour.green(), colour.blue()), strength)
        )
    return tuple(hatches)


@lru_cache(maxsize=16)
def _colours(layer: str) -> Floats:
    colours = np.zeros((256, 3), np.float32)
    for label in range(1, 256):
        colour = label_colour(layer, label)
        colours[label] = colour.redF(), colour.greenF(), colour.blueF()
    colours.flags.writeable = False
    return colours
