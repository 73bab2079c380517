"""A small compass over the view: which way one looks; a press turns north."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from PyQt6.QtCore import QPointF, QRectF, QSize, Qt
from PyQt6.QtGui import QColor, QPainter, QPen, QPolygonF
from PyQt6.QtWidgets import QAbstractButton, QWidget

if TYPE_CHECKING:
    from PyQt6.QtGui import QPaintEvent

__all__ = ["Compass", "heading_of"]

_NORTH = QColor("#ff7a66")
_SOUTH = QColor(235, 238, 240, 210)
_PLATE = QColor(18, 21, 24, 165)
_SIDE = 40
_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def heading_of(eye: tuple[float, float, float], target: tuple[float, float, float]) -> float:
    """Return the compass bearing (degrees, 0 … 360) of a look from one place (m) to another."""
    return math.degrees(math.atan2(target[0] - eye[0], target[1] - eye[1])) % 360.0


class Compass(QAbstractButton):
    """Shows a heading in degrees."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._heading = 0.0
        self.setFixedSize(_SIDE, _SIDE)
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.setAccessibleName("Compass")
        self._describe()

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees."""
        return self._heading

    @heading.setter
    def heading(self, heading: float) -> None:
        if round(heading, 1) != round(self._heading, 1):
            self._heading = heading
            self._describe()
            self.update()

    def sizeHint(self) -> QSize:
        """Return its one size."""
        return QSize(_SIDE, _SIDE)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw a needle on a round plate."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        rim = QPen(QColor(255, 255, 255, 210 if self.underMouse() or self.hasFocus() else 60), 1.2)
        painter.setPen(rim)
        painter.setBrush(_PLATE)
        painter.drawEllipse(QRectF(self.rect()).adjusted(1.0, 1.0, -1.0, -1.0))
        painter.translate(0.5 * _SIDE, 0.5 * _SIDE)
        painter.rotate(-self._heading)
        painter.setPen(Qt.PenStyle.NoPen)
        for colour, sign in ((_NORTH, -1.0), (_SOUTH, 1.0)):
            painter.setBrush(colour)
            corners = [QPointF(-3.4, 1.0), QPointF(0.0, 1.0 + 10.0 * sign), QPointF(3.4, 1.0)]
            painter.drawPolygon(QPolygonF(corners))
        font = painter.font()
        font.setPixelSize(8)
        font.setBold(True)
        painter.setFont(font)
        painter.setPen(_SOUTH)
        painter.translate(0.0, -13.0)
        painter.rotate(self._heading)
        painter.drawText(QRectF(-7.0, -6.0, 14.0, 12.0), Qt.AlignmentFlag.AlignCenter, "N")

    def _describe(self) -> None:
        point = _POINTS[round(self._heading / 45.0) % 8]
        self.setToolTip(f"Looking {point} ({self._heading:.0f}°); press to look north")
        self.setAccessibleDescription(f"Looking {point}")
