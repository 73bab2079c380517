"""Adherence panel: how well the terrain follows the sketch, layer by layer."""

from collections.abc import Mapping
from typing import Any

from PyQt6.QtCore import QPointF, QRectF, QSignalBlocker, QSize, Qt
from PyQt6.QtGui import QPainter, QPaintEvent, QPalette
from PyQt6.QtWidgets import QCheckBox, QPushButton, QSizePolicy, QWidget

from sketchterrain.document.parameters import LAYERS
from sketchterrain.ui.application import single_shot
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import MeasureAdherence
from sketchterrain.ui.look.layer_colours import label_colour, swatch
from sketchterrain.ui.look.theme import SPACING, column, described, row, tabular
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.panels.parts import ScrollingPanel, faint_label, heading, small

_SWATCH = 22
_THICKNESS = 5.0
_DELAY = 600  # ms without a change until adherence is measured again


class AdherenceBar(QWidget):
    """A layer's swatch and title, a bar, a percentage, and a line about lost and spilling shapes."""

    def __init__(self, layer: str) -> None:
        super().__init__()
        self._layer = layer
        self._overlap: float | None = None
        self._detail = ""
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.show_figures(None)

    def show_figures(self, figures: Mapping[str, Any] | None) -> None:
        """Show a layer's summary of `sketchterrain.terrain.Adherence.as_dict`, None if unknown."""
        self._overlap = None if figures is None else figures["iou_mean"]
        self._detail = "" if figures is None else _detail(figures)
        percent = "" if self._overlap is None else f", {round(100 * self._overlap)} % overlap"
        self.setAccessibleName(f"{LAYERS[self._layer].title}{percent}. {self._detail}".strip())
        self.setToolTip(f"{self.accessibleName()}\nOverlap: intersection over union of paint and terrain")
        self.setHidden(figures is None or not figures["shapes"])
        self.update()

    def sizeHint(self) -> QSize:
        return QSize(220, 2 * self.fontMetrics().height() + 4)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        role = QPalette.ColorRole
        painter.drawPixmap(QPointF(0, 2), swatch(self._layer, 1, _SWATCH, self.devicePixelRatioF()))
        line = self.fontMetrics().height()
        left = _SWATCH + SPACING + 2.0
        painter.setPen(self.palette().color(role.WindowText))
        painter.setFont(tabular(self.font()))
        upper = QRectF(left, 0, self.width() - left, line)
        painter.drawText(upper, Qt.AlignmentFlag.AlignVCenter, LAYERS[self._layer].title)
        if self._overlap is not None:
            right = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignRight
            painter.drawText(upper, right, f"{round(100 * self._overlap)} %")
            bar = QRectF(left + 96, line / 2 - _THICKNESS / 2, self.width() - left - 150, _THICKNESS)
            if bar.width() >= 20:
                painter.save()
                painter.setPen(Qt.PenStyle.NoPen)
                for share, colour in (
                    (1.0, self.palette().color(role.Mid)),
                    (self._overlap, label_colour(self._layer, 1)),
                ):
                    bar.setWidth(bar.width() * share)
                    painter.setBrush(colour)
                    painter.drawRoundedRect(bar, _THICKNESS / 2, _THICKNESS / 2)
                painter.restore()
        painter.setFont(small(self.font()))
        painter.setPen(self.palette().color(role.PlaceholderText))
        painter.drawText(QRectF(left, line, self.width() - left, line + 2), 0, self._detail)
        painter.end()


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


class AdherencePanel(ScrollingPanel):
    """Overlap of paint and terrain; measured on request, and after each change while its overlay is on."""

    def __init__(self, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._workspace, self._link = workspace, link
        self._is_measuring = False
        self.measure = described(QPushButton("&Measure"), "Measure", "Compare the terrain with the paint")
        self.overlay = described(
            QCheckBox("&Show in the sketch"),
            "Show in the sketch",
            "Show where the active layer is missing and where it spills over",
        )
        self._head, self._state, self._peaks = heading(), faint_label(), faint_label()
        self.bars = {name: AdherenceBar(name) for name in LAYERS if name != "material"}
        self._timer = single_shot(self, _DELAY, self._measure)
        page = QWidget()
        controls = row(None, self.measure, (self.overlay, 1))
        summary = column(None, self._head, self._state, spacing=0)
        column(page, controls, summary, *self.bars.values(), self._peaks)
        self.add(page)
        self.measure.clicked.connect(self._measure)
        self.overlay.toggled.connect(lambda on: workspace.show_overlay("adherence", on))
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
        if self._is_measuring or self.overlay.isChecked():
            self._timer.start()
        self._refresh()

    def _show_overlay(self) -> None:
        is_visible = "adherence" in self._workspace.overlays
        with QSignalBlocker(self.overlay):
            self.overlay.setChecked(is_visible)
        if is_visible and not self._is_current():
            self._timer.start()

    def _is_current(self) -> bool:
        result, placed = self._link.adherence, self._link.placed
        return result is not None and (placed is None or result.version >= placed.version)

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
        self._peaks.setText(_peaks_text(figures.get("peaks")))
        self._peaks.setHidden(not self._peaks.text())


def _peaks_text(peaks: Mapping[str, Any] | None) -> str:
    if not peaks or not peaks.get("measured"):
        return ""
    least, most = round(100 * peaks["least"]), round(100 * peaks["most"])
    text = f"Mountains reach {least} to {most} % of their target height."
    if peaks.get("capped"):
        count = peaks["capped"]
        text += f" {count} {'is' if count == 1 else 'are'} too small for it."
    return text
