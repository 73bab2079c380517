"""One layer's adherence as a bar: how much of the paint and the terrain overlap."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from PyQt6.QtCore import QPointF, QRectF, QSize, Qt
from PyQt6.QtGui import QPainter, QPaintEvent, QPalette
from PyQt6.QtWidgets import QSizePolicy, QWidget

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.look.layer_colours import label_colour, swatch
from sketchterrain.ui.look.theme import SPACING, tabular
from sketchterrain.ui.panels.text import small

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
        """Show a layer's summary of `sketchterrain.terrain.Adherence.as_dict`; None: it is not known."""
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
