"""Tool options in the top bar: the active label and the size of the brush."""

from __future__ import annotations

import math

from PyQt6.QtCore import QEvent, QSignalBlocker, Qt
from PyQt6.QtWidgets import QLabel, QSizePolicy, QSlider, QWidget

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import SMALL, SPACING, looks, row, tabular
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import BRUSHES, Workspace

_STEPS = 400
_LOG_MIN, _LOG_MAX = (math.log(radius) for radius in BRUSHES)
_SWATCH = 20
_LABEL_TOOLS = ("brush", "line", "fill", "pick")
_SIZE_TOOLS = ("brush", "eraser", "line")


class ToolOptions(QWidget):
    """Shows the active label and sets the brush's radius."""

    def __init__(self, document: Document, workspace: Workspace) -> None:
        super().__init__()
        self._document, self._workspace = document, workspace
        self._swatch, self._label, self._size_title = QLabel(), QLabel(), QLabel("Brush")
        self._swatch.setFixedSize(_SWATCH, _SWATCH)
        self._label.setMinimumWidth(self.fontMetrics().horizontalAdvance("Mountains 16 ") + SMALL)
        self._slider = QSlider(Qt.Orientation.Horizontal)
        self._slider.setRange(0, _STEPS)
        self._slider.setFixedWidth(140)
        self._slider.setAccessibleName("Radius of the brush")
        self._slider.setToolTip("Radius of the brush: [ and ] on the sketch")
        self._size = QLabel()
        self._size.setFont(tabular(self.font()))
        self._size.setMinimumWidth(self.fontMetrics().horizontalAdvance("512 px · 88888 m "))
        self._size_parts = (self._size_title, self._slider, self._size)
        row(self, self._swatch, self._label, *self._size_parts, margins=(SPACING, 0, SPACING, 0))
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
        with QSignalBlocker(self._slider):
            fraction = (math.log(radius) - _LOG_MIN) / (_LOG_MAX - _LOG_MIN)
            self._slider.setValue(round(fraction * _STEPS))
        pixels = f"{radius:.1f}" if radius < 10 else f"{radius:.0f}"
        self._size.setText(f"{pixels} px · {metres:,.0f} m".replace(",", "\u202f"))

    def _show_tool(self, *_: object) -> None:
        tool = self._workspace.tool
        for widgets, tools in (((self._swatch, self._label), _LABEL_TOOLS), (self._size_parts, _SIZE_TOOLS)):
            for widget in widgets:
                widget.setEnabled(tool in tools)

    def _set_brush(self, step: int) -> None:
        self._workspace.brush = math.exp(_LOG_MIN + step / _STEPS * (_LOG_MAX - _LOG_MIN))
