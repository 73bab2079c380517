"""How far the terrain does what the sketch says, layer by layer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from PyQt6.QtCore import QSignalBlocker, QTimer
from PyQt6.QtWidgets import QCheckBox, QHBoxLayout, QPushButton, QVBoxLayout, QWidget

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import MeasureAdherence
from sketchterrain.ui.look.theme import SPACING
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.adherence_bar import AdherenceBar
from sketchterrain.ui.panels.group import ScrollingPanel
from sketchterrain.ui.panels.text import faint_label, heading

_PAUSE = 600  # ms without a change before it is measured anew


class AdherencePanel(ScrollingPanel):
    """The overlap of paint and terrain for each layer; measured on demand, and anew while it is shown."""

    def __init__(self, workspace: Workspace, link: EngineLink, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._workspace = workspace
        self._link = link
        self._waiting = False
        self.measure = QPushButton("&Measure", self)
        self.measure.setAccessibleName("Measure")
        self.measure.setToolTip("Compare what the terrain shows with what is painted")
        self.overlay = QCheckBox("&Show in the sketch", self)
        self.overlay.setAccessibleName("Show in the sketch")
        self.overlay.setToolTip(
            "Shows where the layer that is painted on is missing, and where it spills over"
        )
        self._head = heading("", self)
        self._state = faint_label("", self)
        self.bars = {name: AdherenceBar(name, self) for name in LAYERS if name != "material"}
        self._peaks = faint_label("", self)
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.setInterval(_PAUSE)
        self._lay_out()
        self._connect()
        self._fill_overlay()
        self._fill()

    def _lay_out(self) -> None:
        page = QWidget(self)
        down = QVBoxLayout(page)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SPACING)
        controls = QHBoxLayout()
        controls.setSpacing(SPACING)
        controls.addWidget(self.measure)
        controls.addWidget(self.overlay, 1)
        down.addLayout(controls)
        summary = QVBoxLayout()
        summary.setSpacing(0)
        summary.addWidget(self._head)
        summary.addWidget(self._state)
        down.addLayout(summary)
        for bar in self.bars.values():
            down.addWidget(bar)
        down.addWidget(self._peaks)
        self.add(page)

    def _connect(self) -> None:
        self.measure.clicked.connect(self._ask)
        self.overlay.toggled.connect(lambda on: self._workspace.show_overlay("adherence", on))
        self._workspace.overlays_changed.connect(self._fill_overlay)
        self._timer.timeout.connect(self._ask)
        self._link.placed_changed.connect(self._follow)
        self._link.adherence_changed.connect(self._take)
        self._link.trouble.connect(self._give_up)

    def _ask(self) -> None:
        self._waiting = True
        self._link.tell(MeasureAdherence())
        self._fill()

    def _take(self) -> None:
        self._waiting = False
        self._fill()

    def _give_up(self) -> None:
        self._waiting = False
        self._fill()

    def _follow(self) -> None:
        # A measure that was under way is given up by the engine when there is a newer sketch.
        if self._waiting or self.overlay.isChecked():
            self._timer.start()
        self._fill()

    def _fill_overlay(self) -> None:
        shown = "adherence" in self._workspace.overlays
        with QSignalBlocker(self.overlay):
            self.overlay.setChecked(shown)
        if shown and not self._is_fresh():
            self._timer.start()

    def _is_fresh(self) -> bool:
        found, placed = self._link.adherence, self._link.placed
        return found is not None and (placed is None or found.version >= placed.version)

    def _fill(self) -> None:
        found = self._link.adherence
        self._state.setText(self._state_text())
        self._head.setHidden(found is None)
        figures: Mapping[str, Any] = {} if found is None else found.figures
        mean = figures.get("mean_iou")
        self._head.setText(
            "Nothing to measure" if mean is None else f"{round(100 * mean)} % of the paint is met"
        )
        layers = figures.get("layers", {})
        for name, bar in self.bars.items():
            bar.show_figures(layers.get(name))
        self._peaks.setText(_peaks_text(figures.get("peaks")))
        self._peaks.setHidden(not self._peaks.text())

    def _state_text(self) -> str:
        if self._waiting:
            return "Measuring …"
        if self._link.adherence is None:
            return "Compares the painted shapes with what the terrain shows of them."
        return "Mean overlap of all shapes." if self._is_fresh() else "The sketch has changed since."


def _peaks_text(peaks: Mapping[str, Any] | None) -> str:
    if not peaks or not peaks.get("measured"):
        return ""
    least, most = round(100 * peaks["least"]), round(100 * peaks["most"])
    text = f"Mountains reach {least} to {most} % of the height that is asked for."
    if peaks.get("capped"):
        count = peaks["capped"]
        text += f" {count} {'is' if count == 1 else 'are'} too small for it."
    return text
