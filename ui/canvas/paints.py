"""What the layers are painted with on the canvas, as the workspace shows them."""

from __future__ import annotations

from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.ui.canvas.flattening import Paint
from sketchterrain.ui.canvas.hatch_table import LayerHatch
from sketchterrain.ui.look.layer_colours import DRAW_ORDER, hatch_colour, label_colour, layer_pattern

if TYPE_CHECKING:
    from sketchterrain.ui.canvas.flattening import Floats
    from sketchterrain.ui.models.workspace import Workspace

__all__ = ["hatches_of", "paints_of", "visible_layers"]


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
