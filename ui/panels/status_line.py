"""Status line: work in progress, pointer position, timings, memory and device."""

import math
from typing import Final

from PyQt6.QtWidgets import QProgressBar, QSizePolicy, QWidget
from superqt import QElidingLabel

from sketchterrain.document.parameters import LAYERS
from sketchterrain.io.system import memory_in_use
from sketchterrain.ui.application import single_shot
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.look.theme import MARGIN, SMALL, described, row
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.numbers import label_title, number, size_text
from sketchterrain.ui.panels.parts import status_label

_INTERVAL: Final = 250  # ms between updates of the timings
_LONGEST_PLACE: Final = "88888 E  88888 N   −8888 m high"
_SHARING: Final = {
    "extension": "shared memory",
    "mapped": "mapped memory",
    "copy": "copied",
    "none": "not shared",
}


class StatusLine(QWidget):
    """Status labels of fixed positions."""

    def __init__(self, document: Document, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._document, self._workspace, self._link = document, workspace, link
        self.busy = described(QProgressBar(), "Busy", "The engine is working")
        self.busy.setRange(0, 0)
        self.busy.setFixedWidth(28)
        self.busy.setTextVisible(False)
        policy = self.busy.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        self.busy.setSizePolicy(policy)
        self.work = status_label("Work in progress")
        self.place = status_label("Pointer: metres east and north, and elevation", _LONGEST_PLACE)
        self.paint = status_label("Paint under the pointer", "Mountains 1, forests 1")
        self.placing = status_label("Duration of placing features", "Placing 8888 ms")
        self.tiles = status_label("Duration of the last frame's tiles", "Tiles 8888 ms")
        self.frame = status_label("Duration of the last frame, and frames a second", "Frame 8888 ms, 888/s")
        self.memory = status_label("Memory of all processes of the program", "8888 MB")
        self.device = status_label("Device that computes the terrain, and how heights reach the picture")
        timings = (self.placing, self.tiles, self.frame, self.memory)
        items = (self.busy, (self.work, 2), self.place, self.paint, *timings, (self.device, 3))
        row(self, *items, margins=(SMALL, 0, SMALL, 0), spacing=MARGIN)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self._timer = single_shot(self, _INTERVAL, self._show_timings)
        link.activity_changed.connect(self._show_work)
        link.facts_changed.connect(self._show_device)
        link.frame_shown.connect(self._show_timings_later)
        link.placed_changed.connect(self._show_timings_later)
        self._show_work()
        self._show_device()
        self._show_timings()

    def show_position(self, position: object) -> None:
        """Show the pointer's position (east, north, elevation or None; m); clear it for None."""
        if not isinstance(position, tuple):
            _show(self.place, "")
            _show(self.paint, "")
            return
        x, y, elevation = position
        up = "" if elevation is None else f"   {number(elevation, decimals=0)} m high"
        _show(self.place, f"{number(x, decimals=0)} E  {number(y, decimals=0)} N{up}")
        _show(self.paint, ", ".join(self._labels_at(x, y)).capitalize())

    def _show_timings_later(self, *_: object) -> None:
        if not self._timer.isActive():
            self._timer.start()

    def _show_work(self, *_: object) -> None:
        _show(self.work, self._link.activity or "Ready")
        self.busy.setVisible(bool(self._link.activity))

    def _labels_at(self, x: float, y: float) -> list[str]:
        """Return the visible labels at a place (m), the active layer first."""
        sketch = self._document.sketch
        column = math.floor(x / sketch.pixel_size)
        row = math.floor(sketch.height_px - y / sketch.pixel_size)
        if not (0 <= row < sketch.height_px and 0 <= column < sketch.width_px):
            return []
        titles = []
        for name in sorted(LAYERS, key=lambda each: each != self._workspace.layer):
            label = int(self._document.layer(name)[row, column])
            if label and self._workspace.look(name).visible:
                titles.append(label_title(name, label).lower())
        return titles

    def _show_device(self, *_: object) -> None:
        facts = self._link.facts
        sharing = _SHARING.get(facts.sharing, facts.sharing)
        device = f"{facts.device} · {sharing}" if facts.device else ""
        _show(self.device, "no device" if facts.device_error else device)
        lines = [f"Terrain: {facts.device or facts.device_error or 'not known yet'}"]
        lines += [facts.platform] if facts.platform else []
        lines += [f"Picture: {facts.renderer or facts.opengl_error or 'not known yet'}"]
        lines += [f"Heights reach the picture: {sharing}"]
        self.device.setToolTip("\n".join(lines))

    def _show_timings(self) -> None:
        placed, frame = self._link.placed, self._link.frame
        _show(self.placing, "" if placed is None else f"Placing {_milliseconds(placed.seconds)}")
        _show(self.tiles, "" if frame is None else f"Tiles {_milliseconds(frame.generation_seconds)}")
        rate = "" if frame is None or frame.seconds <= 0 else f", {number(1 / frame.seconds, decimals=0)}/s"
        _show(self.frame, "" if frame is None else f"Frame {_milliseconds(frame.seconds)}{rate}")
        _show(self.memory, size_text(memory_in_use() + (0 if frame is None else frame.memory)))


def _milliseconds(seconds: float) -> str:
    return f"{round(1000 * seconds)} ms"


def _show(label: QElidingLabel, text: str) -> None:
    if label.text() != text:
        label.setText(text)
        label.setAccessibleName(text)
