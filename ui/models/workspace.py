"""What a person works with, beside the document: the tool, the layer, what is chosen and what is shown."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.document.parameters import LAYERS

TOOLS: Final = ("select", "brush", "eraser", "line", "fill", "pick", "pan")
OVERLAYS: Final = {
    "relief": "the terrain's relief beneath the paint",
    "features": "placed features and rivers",
    "contradictions": "where layers contradict each other, and what was decided",
    "adherence": "where the terrain does what the sketch says",
    "eye": "where the 3-D view looks from",
}
"""What can be laid over the sketch."""
BRUSHES: Final = (0.5, 512.0)
"""Least and greatest radius of the brush, px of the sketch."""


@dataclass(frozen=True)
class LayerLook:
    """How a layer is shown.

    Attributes
    ----------
    visible, locked : bool
        Whether it is shown; whether it is kept from being painted on.
    opacity : float
        0 … 1.
    """

    visible: bool = True
    locked: bool = False
    opacity: float = 0.75


@dataclass(frozen=True)
class Selection:
    """What is selected of what was generated.

    Attributes
    ----------
    kind : {'feature', 'river', 'lake'}
    id : int
        As in `features.json`.
    index : int or None
        Of a river's control point.
    """

    kind: str
    id: int
    index: int | None = None


class Workspace(QObject):
    """The state of the program that is no part of the sketch. Setting what is already so tells nobody."""

    tool_changed = pyqtSignal(str)
    label_changed = pyqtSignal(str, int)
    """The layer and the label that one paints with."""
    brush_changed = pyqtSignal(float)
    look_changed = pyqtSignal(str)
    """A layer's `LayerLook`."""
    selection_changed = pyqtSignal(object)
    """`Selection` or None."""
    overlays_changed = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self._tool = "brush"
        self._layer, self._label = "mountain", 1
        self._brush = 16.0
        self._looks = {name: LayerLook() for name in LAYERS}
        self._chosen: Selection | None = None
        self._overlays = frozenset({"relief", "features", "eye"})

    @property
    def tool(self) -> str:
        """One of `TOOLS`."""
        return self._tool

    @tool.setter
    def tool(self, tool: str) -> None:
        if tool not in TOOLS:
            raise ValueError(f"expected a tool, one of {', '.join(TOOLS)}, got {tool!r}")
        if tool != self._tool:
            self._tool = tool
            self.tool_changed.emit(tool)

    @property
    def layer(self) -> str:
        """The layer that one paints on."""
        return self._layer

    @property
    def label(self) -> int:
        """The label that one paints with, 1 to 255."""
        return self._label

    def use_label(self, layer: str, label: int) -> None:
        """Paint on a layer with a label from now on."""
        if (layer, label) != (self._layer, self._label):
            self._layer, self._label = LAYERS[layer].name, label
            self.label_changed.emit(layer, label)

    @property
    def brush(self) -> float:
        """Radius of the brush, px of the sketch."""
        return self._brush

    @brush.setter
    def brush(self, radius: float) -> None:
        radius = min(max(radius, BRUSHES[0]), BRUSHES[1])
        if radius != self._brush:
            self._brush = radius
            self.brush_changed.emit(radius)

    def look(self, layer: str) -> LayerLook:
        """Return how a layer is shown."""
        return self._looks[layer]

    def set_look(self, layer: str, **changes: object) -> None:
        """Change how a layer is shown, by the names of `LayerLook`."""
        look = replace(self._looks[layer], **changes)  # type: ignore[arg-type] # names are LayerLook's
        if look != self._looks[layer]:
            self._looks[layer] = look
            self.look_changed.emit(layer)

    @property
    def selection(self) -> Selection | None:
        """What is selected of what was generated."""
        return self._chosen

    @selection.setter
    def selection(self, selection: Selection | None) -> None:
        if selection != self._chosen:
            self._chosen = selection
            self.selection_changed.emit(selection)

    @property
    def overlays(self) -> frozenset[str]:
        """Names of `OVERLAYS` that are shown."""
        return self._overlays

    def show_overlay(self, name: str, shown: bool) -> None:
        """Show an overlay or hide it."""
        if name not in OVERLAYS:
            raise ValueError(f"expected an overlay, one of {', '.join(OVERLAYS)}, got {name!r}")
        wanted = self._overlays | {name} if shown else self._overlays - {name}
        if wanted != self._overlays:
            self._overlays = wanted
            self.overlays_changed.emit()
