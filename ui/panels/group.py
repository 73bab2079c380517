"""A part of a panel under a heading that folds it up, and the frame of a panel that scrolls."""

from __future__ import annotations

from PyQt6.QtCore import QPointF, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QPainter, QPaintEvent, QPalette, QPen
from PyQt6.QtWidgets import QAbstractButton, QFrame, QScrollArea, QSizePolicy, QVBoxLayout, QWidget

from sketchterrain.ui.look.theme import MARGIN, SMALL, SPACING
from sketchterrain.ui.panels.text import weighted


class Group(QWidget):
    """Controls under a heading; a click on it, or Space, folds them up."""

    folded = pyqtSignal(bool)

    def __init__(
        self, title: str, content: QWidget, *, is_open: bool = True, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self.content = content
        self.header = _Header(title, self)
        self.header.setChecked(is_open)
        self.header.toggled.connect(self._fold)
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SMALL)
        down.addWidget(self.header)
        down.addWidget(content)
        content.setVisible(is_open)

    def _fold(self, is_open: bool) -> None:
        self.content.setVisible(is_open)
        self.folded.emit(not is_open)


class _Header(QAbstractButton):
    """The heading of a group, with a chevron that says whether it is open."""

    def __init__(self, title: str, parent: QWidget) -> None:
        super().__init__(parent)
        self.setText(title)
        self.setFont(weighted(self.font()))
        self.setCheckable(True)
        self.setAccessibleName(title)
        self.setToolTip(f"Show or hide: {title.lower()}")
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAttribute(Qt.WidgetAttribute.WA_Hover)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setCursor(Qt.CursorShape.PointingHandCursor)

    def sizeHint(self) -> QSize:
        """Return room for the chevron and the title."""
        metrics = self.fontMetrics()
        return QSize(metrics.horizontalAdvance(self.text()) + 28, metrics.height() + 10)

    def paintEvent(self, e: QPaintEvent | None) -> None:
        """Draw chevron, title and the line that leads on from it."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        lit = self.hasFocus() or self.underMouse()
        role = QPalette.ColorRole
        middle = self.height() / 2
        pen = QPen(self.palette().color(role.Highlight if lit else role.PlaceholderText), 1.6)
        pen.setCapStyle(Qt.PenCapStyle.RoundCap)
        pen.setJoinStyle(Qt.PenJoinStyle.RoundJoin)
        painter.setPen(pen)
        if self.isChecked():
            painter.drawPolyline(QPointF(2, middle - 2), QPointF(6, middle + 2), QPointF(10, middle - 2))
        else:
            painter.drawPolyline(QPointF(4, middle - 4), QPointF(8, middle), QPointF(4, middle + 4))
        painter.setPen(self.palette().color(role.WindowText))
        flags = Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft
        painter.drawText(self.rect().adjusted(18, 0, 0, 0), flags, self.text())
        start = 18 + self.fontMetrics().horizontalAdvance(self.text()) + SPACING
        painter.setPen(self.palette().color(role.Highlight if self.hasFocus() else role.Mid))
        painter.drawLine(QPointF(start, middle + 0.5), QPointF(self.width(), middle + 0.5))
        painter.end()


class ScrollingPanel(QScrollArea):
    """A panel whose controls stand one beneath the other, and scroll where there is no room for all."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setWidgetResizable(True)
        self.setFrameShape(QFrame.Shape.NoFrame)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self._page = QWidget(self)
        self._down = QVBoxLayout(self._page)
        self._down.setContentsMargins(MARGIN, MARGIN, MARGIN, MARGIN)
        self._down.setSpacing(MARGIN)
        self._down.addStretch(1)
        self.setWidget(self._page)

    def add(self, widget: QWidget) -> None:
        """Add a control beneath the others."""
        self._down.insertWidget(self._down.count() - 1, widget)

    def sizeHint(self) -> QSize:
        """Return a width in which forms are read with ease."""
        return QSize(300, 420)

    def minimumSizeHint(self) -> QSize:
        """Return the least width at which nothing is cut."""
        return QSize(220, 80)


def rule(parent: QWidget | None = None) -> QFrame:
    """Return a thin line between parts."""
    line = QFrame(parent)
    line.setFixedHeight(1)
    line.setAutoFillBackground(True)
    line.setBackgroundRole(QPalette.ColorRole.Mid)
    return line
