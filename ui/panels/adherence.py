"""How far the terrain does what the sketch says, layer by layer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from PyQt6.QtCore import QPointF, QRectF, QSignalBlocker, QSize, Qt, QTimer
from PyQt6.QtGui import QPainter, QPaintEvent, QPalette
from PyQt6.QtWidgets import QCheckBox, QHBoxLayout, QPushButton, QSizePolicy, QVBoxLayout, QWidget

from sketchterrain.document.parameters import LAYERS
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import MeasureAdherence
from sketchterrain.ui.look.layer_colours import label_colour, swatch
from sketchterrain.ui.look.theme import SPACING, tabular
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.parts import ScrollingPanel, faint_label, heading, small

_PICTURE = 22
_THICK = 5.0


class AdherenceBar(QWidget):
    """A layer's picture and title, a bar, a percentage, and a line on what was lost or spills over."""

    def __init__(self, layer: str, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._layer = layer
        self._overlap: float | None = None
        self._detail = ""
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.show_figures(None)

    @property
    def text(self) -> str:
        """All that it says."""
        return self.accessibleName()

    def show_figures(self, figures: Mapping[str, Any] | None) -> None:
        """Show a layer's summary of `Adherence.as_dict`; None: it is not known."""
        title = LAYERS[self._layer].title
        self._overlap = None if figures is None else figures["iou_mean"]
        self._detail = "" if figures is None else _detail(figures)
        percent = "" if self._overlap is None else f", {round(100 * self._overlap)} % overlap"
        self.setAccessibleName(f"{title}{percent}. {self._detail}".strip())
        self.setToolTip(
            self.accessibleName() + "\nOverlap: what is both painted and shown, over what is either"
        )
        self.setHidden(figures is None or not figures["shapes"])
        self.update()

    def sizeHint(self) -> QSize:
        """Return room for two lines."""
        return QSize(220, 2 * self.fontMetrics().height() + 4)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw it."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        role = QPalette.ColorRole
        painter.drawPixmap(QPointF(0, 2), swatch(self._layer, 1, _PICTURE, self.devicePixelRatioF()))
        line = self.fontMetrics().height()
        left = _PICTURE + SPACING + 2.0
        painter.setPen(self.palette().color(role.WindowText))
        painter.setFont(tabular(self.font()))
        upper = QRectF(left, 0, self.width() - left, line)
        painter.drawText(upper, Qt.AlignmentFlag.AlignVCenter, LAYERS[self._layer].title)
        if self._overlap is not None:
            right = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignRight
            painter.drawText(upper, right, f"{round(100 * self._overlap)} %")
            self._draw_bar(
                painter, QRectF(left + 96, line / 2 - _THICK / 2, self.width() - left - 150, _THICK)
            )
        painter.setFont(small(self.font()))
        painter.setPen(self.palette().color(role.PlaceholderText))
        painter.drawText(QRectF(left, line, self.width() - left, line + 2), 0, self._detail)
        painter.end()

    def _draw_bar(self, painter: QPainter, place: QRectF) -> None:
        if place.width() < 20 or self._overlap is None:
            return
        painter.save()
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(self.palette().color(QPalette.ColorRole.Mid))
        painter.drawRoundedRect(place, _THICK / 2, _THICK / 2)
        place.setWidth(place.width() * self._overlap)
        painter.setBrush(label_colour(self._layer, 1))
        painter.drawRoundedRect(place, _THICK / 2, _THICK / 2)
        painter.restore()


def _detail(figures: Mapping[str, Any]) -> str:
    count = figures["shapes"]
    parts = [f"{count} shape{'' if count == 1 else 's'}"]
    if figures["lost"]:
        parts.append(f"{figures['lost']} lost")
    if figures["spill"] is not None:
        parts.append(f"spills over by {round(100 * figures['spill'])} %")
    if not figures["measured"]:
        parts.append("too thin to measure")
    return " · ".join(parts)


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
        self._link.error_reported.connect(self._give_up)

    def _ask(self) -> None:
        self._waiting = True
        self._link.send(MeasureAdherence())
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
