"""A small mark that turns while something is worked on."""

from __future__ import annotations

from PyQt6.QtCore import QRectF, QSize, Qt, QTimer
from PyQt6.QtGui import QPainter, QPaintEvent, QPalette, QPen
from PyQt6.QtWidgets import QSizePolicy, QWidget

_SIDE = 14
_STEP = 30  # degrees
_EVERY = 80  # ms


class BusyMark(QWidget):
    """An arc that turns while it is busy; else nothing, in the same room."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._angle = 0
        self._timer = QTimer(self)
        self._timer.setInterval(_EVERY)
        self._timer.timeout.connect(self._turn)
        self.setSizePolicy(QSizePolicy.Policy.Fixed, QSizePolicy.Policy.Fixed)
        self.setAccessibleName("Busy")
        self.setToolTip("The engine is at work")

    @property
    def busy(self) -> bool:
        """Whether it turns."""
        return self._timer.isActive()

    @busy.setter
    def busy(self, busy: bool) -> None:
        if busy and not self.busy:
            self._timer.start()
        elif not busy:
            self._timer.stop()
        self.update()

    def sizeHint(self) -> QSize:
        """Return its room."""
        return QSize(_SIDE, _SIDE)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the arc."""
        if not self.busy:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        pen = QPen(self.palette().color(QPalette.ColorRole.Highlight), 2)
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        painter.setPen(pen)
        place = QRectF(2, 2, _SIDE - 4, _SIDE - 4)
        painter.drawArc(place, -16 * self._angle, 16 * 270)
        painter.end()

    def _turn(self) -> None:
        self._angle = (self._angle + _STEP) % 360
        self.update()
