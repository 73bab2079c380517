"""Feedback of the engine: the status line and the adherence panel."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, Final

from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QLabel, QProgressBar, QPushButton, QSizePolicy, QWidget
from superqt import QElidingLabel

from sketchterrain.io.console import pluralize
from sketchterrain.io.system import resident_memory
from sketchterrain.measure.lines import limited_lines
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS
from sketchterrain.ui.engine.link import NOT_PLACED, EngineLink
from sketchterrain.ui.engine.protocol import MeasureAdherence
from sketchterrain.ui.look.layer_colours import label_colour, swatch
from sketchterrain.ui.look.theme import MARGIN, SMALL, column, described, heading, row, tabular
from sketchterrain.ui.models.background import single_shot
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.controls import (
    ScrollingPanel,
    check_box,
    faint_label,
    label_title,
    number,
    size_text,
    status_label,
)

_SWATCH = 22
_AT_SEA = 0.05  # m from its level at which a place is on its surface
_DELAY = 600  # ms without a change until adherence is measured again


class AdherenceBar(QWidget):
    """A layer's swatch and title, a bar, a percentage, and a line about lost and spilling shapes."""

    def __init__(self, layer: str) -> None:
        super().__init__()
        self._layer = layer
        picture, self._percent, self._detail = QLabel(), QLabel(), faint_label()
        picture.setPixmap(swatch(layer, 1, _SWATCH, self.devicePixelRatioF()))
        self._percent.setFont(tabular(self.font()))
        self._bar = QProgressBar()
        self._bar.setTextVisible(False)
        self._bar.setStyleSheet(f"QProgressBar::chunk {{ background: {label_colour(layer, 1).name()}; }}")
        line = row(None, (QLabel(LAYERS[layer].title), 1), (self._bar, 2), self._percent)
        row(self, picture, column(None, line, self._detail, spacing=0))
        self.show_figures(None)

    def show_figures(self, figures: Mapping[str, Any] | None) -> None:
        """Show a layer's summary of `sketchterrain.terrain.Adherence.as_dict`, None if unknown."""
        overlap = None if figures is None else figures["iou_mean"]
        self._detail.setText("" if figures is None else _detail(figures))
        self._percent.setText("" if overlap is None else f"{round(100 * overlap)} %")
        self._bar.setValue(round(100 * (overlap or 0.0)))
        self._bar.setHidden(overlap is None)
        percent = "" if overlap is None else f", {self._percent.text()} overlap"
        self.setAccessibleName(f"{LAYERS[self._layer].title}{percent}. {self._detail.text()}".strip())
        self.setToolTip(f"{self.accessibleName()}\nOverlap: intersection over union of paint and terrain")
        self.setHidden(figures is None or not figures["shapes"])


def _detail(figures: Mapping[str, Any]) -> str:
    parts = [pluralize(figures["shapes"], "shape")]
    if figures["lost"]:
        parts.append(f"{figures['lost']} lost")
    if figures["spill"] is not None:
        parts.append(f"spills over by {round(100 * figures['spill'])} %")
    if not figures["measured"]:
        parts.append("too thin to measure")
    return " · ".join(parts)


class AdherencePanel(ScrollingPanel):
    """Overlap of paint and terrain, and realism; measured on request, and while an overlay of them is on."""

    def __init__(self, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._workspace, self._link = workspace, link
        self._is_measuring = False
        self.measure = described(QPushButton("&Measure"), "Measure", "Compare the terrain with the paint")
        tip = "Show where the active layer is missing and where it spills over"
        self.overlay = check_box("&Show in the sketch", tip)
        self._head, self._state, self._peaks = heading(), faint_label(), faint_label()
        self.bars = {name: AdherenceBar(name) for name in PAINTED_LAYERS if LAYERS[name].kind != "cover"}
        tip = "Show hollows, channels that rise, and ground steeper than that of real land"
        self.faults = check_box("Show &faults of landforms", tip)
        self._realism_head, self._realism = heading(), faint_label()
        self._timer = single_shot(self, _DELAY, self._measure)
        page = QWidget()
        controls = row(None, self.measure, (self.overlay, 1))
        summary = column(None, self._head, self._state, spacing=0)
        realism = column(None, self._realism_head, self._realism, self.faults, spacing=0)
        column(page, controls, summary, *self.bars.values(), self._peaks, realism)
        self.add(page)
        self.measure.clicked.connect(self._measure)
        self.overlay.toggled.connect(lambda on: workspace.show_overlay("adherence", on))
        self.faults.toggled.connect(lambda on: workspace.show_overlay("realism", on))
        workspace.overlays_changed.connect(self._show_overlay)
        link.placed_changed.connect(self._measure_later)
        link.adherence_changed.connect(self._finish)
        link.error_reported.connect(self._finish)
        self._show_overlay()
        self._refresh()

    def _measure(self, *_: object) -> None:
        self._is_measuring = True
        self._link.send(MeasureAdherence())
        self._refresh()

    def _finish(self, *_: object) -> None:
        self._is_measuring = False
        self._refresh()

    def _measure_later(self, *_: object) -> None:
        # The engine abandons a measurement of an older sketch.
        if self._is_measuring or self.overlay.isChecked() or self.faults.isChecked():
            self._timer.start()
        self._refresh()

    def _show_overlay(self) -> None:
        visible = self._workspace.overlays
        for box, name in ((self.overlay, "adherence"), (self.faults, "realism")):
            with QSignalBlocker(box):
                box.setChecked(name in visible)
        if {"adherence", "realism"} & visible and not self._is_current():
            self._timer.start()

    def _is_current(self) -> bool:
        result = self._link.adherence
        return result is not None and result.version >= self._link.placed.version

    def _refresh(self) -> None:
        result = self._link.adherence
        if self._is_measuring:
            state = "Measuring …"
        elif result is None:
            state = "Compares the painted shapes with the terrain."
        else:
            state = "Mean overlap of all shapes." if self._is_current() else "The sketch has changed since."
        self._state.setText(state)
        self._head.setHidden(result is None)
        figures: Mapping[str, Any] = {} if result is None else result.figures
        mean = figures.get("mean_iou")
        self._head.setText("Nothing to measure" if mean is None else f"{round(100 * mean)} % overlap")
        layers = figures.get("layers", {})
        for name, bar in self.bars.items():
            bar.show_figures(layers.get(name))
        self._peaks.setText(_heights_text(figures.get("peaks"), figures.get("shapes", ())))
        self._peaks.setHidden(not self._peaks.text())
        realism = None if result is None else result.realism
        self._realism_head.setHidden(realism is None)
        self._realism.setHidden(realism is None)
        if realism is not None:
            self._realism_head.setText(f"Realism: {realism['distance']:.2f} from {realism['kind']}")
            self._realism.setText(_realism_text(realism))


def _realism_text(realism: Mapping[str, Any]) -> str:
    lines = ["Distance to the nearest kind of real land, whose own windows have up to 1.63."]
    for found in realism["out_of_range"].values():
        value = "not measurable" if found["value"] is None else f"{found['value']:.3g}"
        low, _, high = found["real"]
        lines.append(f"{found['title']}: {value}, real land {low:.3g} to {high:.3g}")
    return "\n".join(lines)


def _heights_text(peaks: Mapping[str, Any] | None, shapes: Iterable[Mapping[str, Any]]) -> str:
    if not peaks or not peaks.get("measured"):
        return ""
    least, most = round(100 * peaks["least"]), round(100 * peaks["most"])
    reached = f"Mountains and hills reach {least} to {most} % of the height built for them."
    return "\n".join([reached, *(f"{line[:1].upper()}{line[1:]}" for line in limited_lines(shapes))])


_INTERVAL: Final = 250  # ms between updates of the timings
_LONGEST_PLACE: Final = "88888 E  88888 N   sea 888 m deep"
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
        up = "" if elevation is None else f"   {self._height_text(elevation)}"
        _show(self.place, f"{number(x, decimals=0)} E  {number(y, decimals=0)} N{up}")
        _show(self.paint, ", ".join(self._labels_at(x, y)).capitalize())

    def _height_text(self, elevation: float) -> str:
        """Return an elevation (m) as text, or what the sea is there; the 3-D view finds its surface."""
        relief = self._link.relief
        depth = -math.inf if relief is None or relief.sea_level is None else relief.sea_level - elevation
        if depth < -_AT_SEA:
            return f"{number(elevation, decimals=0)} m high"
        return "sea" if depth < _AT_SEA else f"sea {number(depth, decimals=0)} m deep"

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
        for name in sorted(PAINTED_LAYERS, key=lambda each: each != self._workspace.layer):
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
        _show(self.placing, "" if placed is NOT_PLACED else f"Placing {_milliseconds(placed.seconds)}")
        _show(self.tiles, "" if frame is None else f"Tiles {_milliseconds(frame.generation_seconds)}")
        rate = "" if frame is None or frame.seconds <= 0 else f", {number(1 / frame.seconds, decimals=0)}/s"
        _show(self.frame, "" if frame is None else f"Frame {_milliseconds(frame.seconds)}{rate}")
        _show(self.memory, size_text(resident_memory() + (0 if frame is None else frame.memory)))


def _milliseconds(seconds: float) -> str:
    return f"{round(1000 * seconds)} ms" if seconds < 9.9995 else f"{seconds:.0f} s"


def _show(label: QElidingLabel, text: str) -> None:
    if label.text() != text:
        label.setText(text)
        label.setAccessibleName(text)
