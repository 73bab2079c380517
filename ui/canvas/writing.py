"""Text on small plates, readable on any paint."""

from __future__ import annotations

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QFontMetricsF, QPainter

from sketchterrain.ui.look.theme import tabular, theme

__all__ = ["plate", "write_beside"]

_PAD = 5.0


def write_beside(painter: QPainter, at: QPointF, text: str) -> QRectF:
    """Write a line on a plate whose lower left corner is at a place; return the plate's rectangle."""
    painter.save()
    painter.setFont(tabular(painter.font()))
    metrics = QFontMetricsF(painter.font())
    size = (metrics.horizontalAdvance(text) + 2.0 * _PAD, metrics.height() + _PAD)
    place = QRectF(at.x(), at.y() - size[1], *size)
    plate(painter, place)
    painter.setPen(theme().text)
    painter.drawText(place, Qt.AlignmentFlag.AlignCenter, text)
    painter.restore()
    return place


def plate(painter: QPainter, place: QRectF) -> None:
    """Draw a plate to write on, in the colours of the theme."""
    ground, line = QColor(theme().window), QColor(theme().line)
    ground.setAlpha(228)
    painter.setPen(line)
    painter.setBrush(ground)
    painter.drawRoundedRect(place.adjusted(0.5, 0.5, -0.5, -0.5), 4.0, 4.0)
