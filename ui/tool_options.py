"""What one paints with, in the bar at the top: the label, and the size of the brush."""

from __future__ import annotations

import math

from PyQt6.QtCore import QEvent, Qt
from PyQt6.QtWidgets import QHBoxLayout, QLabel, QSizePolicy, QSlider, QWidget

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import SMALL, SPACING, looks, tabular
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import BRUSHES, Workspace

_STEPS = 400
_LEAST, _GREATEST = (math.log(radius) for radius in BRUSHES)
_SWATCH = 20
_PAINTS = ("brush", "line", "fill", "pick")
_SIZED = ("brush", "eraser", "line")


class ToolOptions(QWidget):
    """Shows the label that one paints with and sets the brush's radius."""

    def __init__(self, document: Document, workspace: Workspace, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._document = document
        self._workspace = workspace
        self._swatch = QLabel(self)
        self._swatch.setFixedSize(_SWATCH, _SWATCH)
        self._label = QLabel(self)
        self._label.setMinimumWidth(self.fontMetrics().horizontalAdvance("Mountains 16 ") + SMALL)
        self._size_title = QLabel("Brush", self)
        self._slider = QSlider(Qt.Orientation.Horizontal, self)
        self._slider.setRange(0, _STEPS)
        self._slider.setFixedWidth(140)
        self._slider.setAccessibleName("Radius of the brush")
        self._slider.setToolTip("Radius of the brush: [ and ] on the sketch")
        self._size = QLabel(self)
        self._size.setFont(tabular(self.font()))
        self._size.setMinimumWidth(self.fontMetrics().horizontalAdvance("512 px · 88888 m "))
        row = QHBoxLayout(self)
        row.setContentsMargins(SPACING, 0, SPACING, 0)
        row.setSpacing(SPACING)
        for widget in (self._swatch, self._label, self._size_title, self._slider, self._size):
            row.addWidget(widget)
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Preferred)
        self._slider.valueChanged.connect(self._set_brush)
        workspace.brush_changed.connect(self._show_brush)
        workspace.label_changed.connect(self._show_label)
        workspace.tool_changed.connect(self._show_tool)
        document.sketch_changed.connect(self._show_brush)
        looks.changed.connect(self._show_label)
        self._show_label()
        self._show_brush()
        self._show_tool()

    def changeEvent(self, event: QEvent | None) -> None:
        """Stay sharp on another screen."""
        super().changeEvent(event)
        if event is not None and event.type() == event.Type.DevicePixelRatioChange:
            self._show_label()

    def _show_label(self, *_: object) -> None:
        layer, label = self._workspace.layer, self._workspace.label
        self._swatch.setPixmap(swatch(layer, label, _SWATCH, self.devicePixelRatioF()))
        self._label.setText(f"{LAYERS[layer].title} {label}")
        self._label.setToolTip(f"Painting {LAYERS[layer].title.lower()}, label {label}")

    def _show_brush(self, *_: object) -> None:
        radius = self._workspace.brush
        metres = radius * self._document.sketch.pixel_size
        self._slider.blockSignals(True)
        self._slider.setValue(round((math.log(radius) - _LEAST) / (_GREATEST - _LEAST) * _STEPS))
        self._slider.blockSignals(False)
        pixels = f"{radius:.1f}" if radius < 10 else f"{radius:.0f}"
        self._size.setText(f"{pixels} px · {metres:,.0f} m".replace(",", "\u202f"))

    def _show_tool(self, *_: object) -> None:
        tool = self._workspace.tool
        self._swatch.setEnabled(tool in _PAINTS)
        self._label.setEnabled(tool in _PAINTS)
        self._size_title.setEnabled(tool in _SIZED)
        self._slider.setEnabled(tool in _SIZED)
        self._size.setEnabled(tool in _SIZED)

    def _set_brush(self, place: int) -> None:
        self._workspace.brush = math.exp(_LEAST + place / _STEPS * (_GREATEST - _LEAST))
