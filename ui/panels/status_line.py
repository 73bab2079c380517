"""The line at the foot of the window: what is worked on, where the pointer is, how long things take."""

from __future__ import annotations

import math
from typing import Final

from PyQt6.QtCore import QTimer
from PyQt6.QtWidgets import QHBoxLayout, QProgressBar, QSizePolicy, QWidget
from superqt import QElidingLabel

from sketchterrain.document.parameters import LAYERS
from sketchterrain.io.system import memory_in_use
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import EngineFacts
from sketchterrain.ui.look.theme import MARGIN, SMALL
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.numbers import label_title, number, size_text
from sketchterrain.ui.panels.parts import figure

_EVERY: Final = 250  # ms between two figures: faster ones are not read
_SHARING: Final = {
    "extension": "shared memory",
    "mapped": "mapped memory",
    "copy": "copied",
    "none": "not shared",
}


class StatusLine(QWidget):
    """Figures that keep their places while they change."""

    def __init__(
        self, document: Document, workspace: Workspace, link: EngineLink, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._document = document
        self._workspace = workspace
        self._link = link
        self.busy = QProgressBar(self)
        self.busy.setRange(0, 0)
        self.busy.setFixedWidth(28)
        self.busy.setTextVisible(False)
        self.busy.setAccessibleName("Busy")
        self.busy.setToolTip("The engine is at work")
        policy = self.busy.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.busy.setSizePolicy(policy)
        self.work = figure("What the engine works on")
        self.place = figure("Where the pointer is: metres east and north, and the height there", _PLACE)
        self.paint = figure("What is painted where the pointer is", "Mountains 1, forests 1")
        self.placing = figure("How long placing features took", "Placing 8888 ms")
        self.tiles = figure("How long the last frame's tiles took", "Tiles 8888 ms")
        self.frame = figure(
            "How long the last frame took, and how many that are in a second", "Frame 8888 ms, 888/s"
        )
        self.memory = figure("What the program's processes hold in memory", "8888 MB")
        self.device = figure("What the terrain is computed on, and how it reaches the picture")
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(_EVERY)
        self._lay_out()
        self._connect()
        for fill in (self._fill_work, self._fill_device, self._fill_figures):
            fill()

    def show_position(self, place: object) -> None:
        """Show where the pointer is: metres east, north, and up or None; None: it is nowhere."""
        if not isinstance(place, tuple):
            _show(self.place, "")
            _show(self.paint, "")
            return
        x, y, height = place
        up = "" if height is None else f"   {number(height, decimals=0)} m high"
        _show(self.place, f"{number(x, decimals=0)} E  {number(y, decimals=0)} N{up}")
        _show(self.paint, ", ".join(self._painted_at(x, y)).capitalize())

    def _connect(self) -> None:
        link = self._link
        link.activity_changed.connect(self._fill_work)
        link.facts_changed.connect(self._fill_device)
        link.frame_shown.connect(self._wait)
        link.placed_changed.connect(self._wait)
        self._timer.timeout.connect(self._fill_figures)

    def _wait(self) -> None:
        if not self._timer.isActive():
            self._timer.start()

    def _fill_work(self) -> None:
        _show(self.work, self._link.activity or "Ready")
        self.busy.setVisible(bool(self._link.activity))

    def _painted_at(self, x: float, y: float) -> list[str]:
        """Return the labels that are seen at a place (m), the layer in use first."""
        sketch = self._document.sketch
        column = math.floor(x / sketch.pixel_size)
        row = math.floor(sketch.height_px - y / sketch.pixel_size)
        if not (0 <= row < sketch.height_px and 0 <= column < sketch.width_px):
            return []
        found = []
        for name in sorted(LAYERS, key=lambda each: each != self._workspace.layer):
            label = int(self._document.layer(name)[row, column])
            if label and self._workspace.look(name).visible:
                found.append(label_title(name, label).lower())
        return found

    def _fill_device(self) -> None:
        facts = self._link.facts
        _show(self.device, _device_text(facts))
        lines = [f"Terrain: {facts.device or facts.device_error or 'not known yet'}"]
        lines += [facts.platform] if facts.platform else []
        lines += [f"Picture: {facts.renderer or facts.opengl_error or 'not known yet'}"]
        lines += [f"Heights reach the picture: {_SHARING.get(facts.sharing, facts.sharing)}"]
        self.device.setToolTip("\n".join(lines))

    def _fill_figures(self) -> None:
        placed, frame = self._link.placed, self._link.frame
        _show(self.placing, "" if placed is None else f"Placing {_milliseconds(placed.seconds)}")
        _show(self.tiles, "" if frame is None else f"Tiles {_milliseconds(frame.generation_seconds)}")
        rate = "" if frame is None or frame.seconds <= 0 else f", {number(1 / frame.seconds, decimals=0)}/s"
        _show(self.frame, "" if frame is None else f"Frame {_milliseconds(frame.seconds)}{rate}")
        _show(self.memory, size_text(memory_in_use() + (0 if frame is None else frame.memory)))

    def _lay_out(self) -> None:
        across = QHBoxLayout(self)
        across.setContentsMargins(SMALL, 0, SMALL, 0)
        across.setSpacing(MARGIN)
        across.addWidget(self.busy)
        across.addWidget(self.work, 2)
        for each in (self.place, self.paint, self.placing, self.tiles, self.frame, self.memory):
            across.addWidget(each)
        across.addWidget(self.device, 3)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)


_PLACE: Final = "88888 E  88888 N   −8888 m high"


def _milliseconds(seconds: float) -> str:
    return f"{round(1000 * seconds)} ms"


def _device_text(facts: EngineFacts) -> str:
    if facts.device_error:
        return "no device"
    if not facts.device:
        return ""
    return f"{facts.device} · {_SHARING.get(facts.sharing, facts.sharing)}"


def _show(label: QElidingLabel, text: str) -> None:
    if label.text() != text:
        label.setText(text)
        label.setAccessibleName(text)
