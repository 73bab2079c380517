"""Editing state that is not part of the sketch: tool, layer, label, brush, selection, overlays."""

from dataclasses import dataclass, replace
from typing import Final

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.document.parameters import LAYERS

TOOLS: Final = ("select", "brush", "eraser", "line", "fill", "pick", "pan")
OVERLAYS: Final = {
    "relief": "the terrain's relief beneath the paint",
    "features": "placed features and rivers",
    "contradictions": "where layers contradict each other, and how it was resolved",
    "adherence": "where the terrain agrees with the sketch",
    "eye": "position and direction of the 3-D camera",
}
"""Overlays of the canvas and their descriptions."""
BRUSHES: Final = (0.5, 512.0)
"""Range of the brush radius, px of the sketch."""


@dataclass(frozen=True)
class LayerLook:
    """Visibility, lock and opacity (0 … 1) of a layer."""

    visible: bool = True
    locked: bool = False
    opacity: float = 0.75


@dataclass(frozen=True)
class Selection:
    """A selected feature, river or lake, by its id in `features.json`."""

    kind: str  # feature, river or lake
    id: int
    index: int | None = None  # of a river's control point


class Workspace(QObject):
    """Editing state with change signals; setting an equal value emits nothing."""

    tool_changed = pyqtSignal(str)
    label_changed = pyqtSignal(str, int)  # layer, label
    brush_changed = pyqtSignal(float)
    look_changed = pyqtSignal(str)  # layer
    selection_changed = pyqtSignal(object)  # Selection or None
    overlays_changed = pyqtSignal()

    def __init__(self) -> None:
        super().__init__()
        self._tool = "brush"
        self._layer, self._label = "mountain", 1
        self._brush = 16.0
        self._looks = {name: LayerLook() for name in LAYERS}
        self._selection: Selection | None = None
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
        """The active layer."""
        return self._layer

    @property
    def label(self) -> int:
        """The active label, 1 to 255."""
        return self._label

    def use_label(self, layer: str, label: int) -> None:
        """Activate a layer and a label."""
        if (layer, label) != (self._layer, self._label):
            self._layer, self._label = LAYERS[layer].name, label
            self.label_changed.emit(layer, label)

    @property
    def brush(self) -> float:
        """Brush radius, px of the sketch."""
        return self._brush

    @brush.setter
    def brush(self, radius: float) -> None:
        radius = min(max(radius, BRUSHES[0]), BRUSHES[1])
        if radius != self._brush:
            self._brush = radius
            self.brush_changed.emit(radius)

    def look(self, layer: str) -> LayerLook:
        """Return a layer's look."""
        return self._looks[layer]

    def set_look(self, layer: str, **changes: object) -> None:
        """Change fields of a layer's `LayerLook`."""
        look = replace(self._looks[layer], **changes)  # type: ignore[arg-type] # names are LayerLook's
        if look != self._looks[layer]:
            self._looks[layer] = look
            self.look_changed.emit(layer)

    @property
    def selection(self) -> Selection | None:
        """The selected object."""
        return self._selection

    @selection.setter
    def selection(self, selection: Selection | None) -> None:
        if selection != self._selection:
            self._selection = selection
            self.selection_changed.emit(selection)

    @property
    def overlays(self) -> frozenset[str]:
        """Names of the visible `OVERLAYS`."""
        return self._overlays

    def show_overlay(self, name: str, visible: bool) -> None:
        """Show or hide an overlay."""
        if name not in OVERLAYS:
            raise ValueError(f"expected an overlay, one of {', '.join(OVERLAYS)}, got {name!r}")
        overlays = self._overlays | {name} if visible else self._overlays - {name}
        if overlays != self._overlays:
            self._overlays = overlays
            self.overlays_changed.emit()
