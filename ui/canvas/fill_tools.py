"""Fill a region with the label that one paints with; pick the label that is painted somewhere."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from PyQt6.QtCore import Qt

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.canvas.paints import visible_layers
from sketchterrain.ui.canvas.tool import Tool
from sketchterrain.ui.painting.flood import flood
from sketchterrain.ui.painting.pick import pick

if TYPE_CHECKING:
    from sketchterrain.ui.canvas.desk import Desk, Pointer

__all__ = ["FillTool", "PickTool", "pick_label"]


class FillTool(Tool):
    """Gives a connected region the label that one paints with, or clears it."""

    cursor = Qt.CursorShape.CrossCursor

    def press(self, pointer: Pointer) -> None:
        """Fill, or pick."""
        if not self.desk.may_paint():
            return
        workspace, document = self.desk.workspace, self.desk.document
        draft = document.begin_draft(workspace.layer)
        label = 0 if pointer.erases else workspace.label
        box = flood(draft.image, math.floor(pointer.y), math.floor(pointer.x), label)
        if box is None:
            draft.cancel()
            return
        draft.touch(box)
        verb = "Clear a shape of" if pointer.erases else "Fill"
        draft.commit(f"{verb} {LAYERS[workspace.layer].title.lower()}")


class PickTool(Tool):
    """Goes on with the layer and label that are painted where one clicks."""

    cursor = Qt.CursorShape.PointingHandCursor

    def press(self, pointer: Pointer) -> None:
        """Fill, or pick."""
        pick_label(self.desk, pointer)


def pick_label(desk: Desk, pointer: Pointer) -> None:
    """Paint with what is seen at a place from now on; tells a person if that is nothing."""
    layers = [(name, desk.document.layer(name)) for name in reversed(visible_layers(desk.workspace))]
    found = pick(layers, math.floor(pointer.y), math.floor(pointer.x))
    if found is None:
        desk.tells.message.emit("Nothing is painted here.")
    else:
        desk.workspace.use_label(*found)
        desk.tells.message.emit(f"Paints {LAYERS[found[0]].title.lower()}, label {found[1]}.")
