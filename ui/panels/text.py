"""Labels of a panel: what is read second, headings, and text that is cut where there is no room."""

from __future__ import annotations

from PyQt6.QtCore import QSize, Qt
from PyQt6.QtGui import QFont, QPainter, QPaintEvent, QPalette
from PyQt6.QtWidgets import QLabel, QSizePolicy, QWidget

from sketchterrain.ui.look.theme import tabular

_SMALLER = 0.88


def small(font: QFont) -> QFont:
    """Return a font a little smaller."""
    smaller = QFont(font)
    if font.pointSizeF() > 0:
        smaller.setPointSizeF(font.pointSizeF() * _SMALLER)
    else:
        smaller.setPixelSize(max(1, round(font.pixelSize() * _SMALLER)))
    return smaller


def weighted(font: QFont) -> QFont:
    """Return a font a little heavier."""
    heavier = QFont(font)
    heavier.setWeight(QFont.Weight.DemiBold)
    return heavier


def faint_label(text: str = "", parent: QWidget | None = None) -> QLabel:
    """Return a label for what is read second: small, pale, in as many lines as it takes."""
    label = QLabel(text, parent)
    label.setFont(small(label.font()))
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    label.setWordWrap(True)
    return label


def heading(text: str, parent: QWidget | None = None) -> QLabel:
    """Return a label for what a part of a panel is about."""
    label = QLabel(text, parent)
    label.setFont(weighted(label.font()))
    return label


class ElidedLabel(QWidget):
    """One line of text; where there is no room its end is cut, and the whole is told to a resting pointer."""

    def __init__(
        self, text: str = "", *, faint: bool = False, sample: str | None = None, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._text = ""
        self._role = QPalette.ColorRole.PlaceholderText if faint else QPalette.ColorRole.WindowText
        self._sample = sample
        self.setFont(tabular(self.font()))
        policy = QSizePolicy.Policy.Expanding if sample is None else QSizePolicy.Policy.Fixed
        self.setSizePolicy(policy, QSizePolicy.Policy.Fixed)
        self.text = text

    @property
    def text(self) -> str:
        """What it says, all of it."""
        return self._text

    @text.setter
    def text(self, text: str) -> None:
        if text != self._text:
            self._text = text
            self.setAccessibleName(text)
            self.update()

    def sizeHint(self) -> QSize:
        """Return room for the sample, or for the text."""
        metrics = self.fontMetrics()
        return QSize(metrics.horizontalAdvance(self._sample or self._text) + 2, metrics.height() + 2)

    def minimumSizeHint(self) -> QSize:
        """Return room for the sample, or for next to nothing."""
        return self.sizeHint() if self._sample is not None else QSize(12, self.sizeHint().height())

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw as much of the text as there is room for."""
        painter = QPainter(self)
        painter.setPen(self.palette().color(self._role))
        shown = self.fontMetrics().elidedText(self._text, Qt.TextElideMode.ElideRight, self.width())
        painter.drawText(self.rect(), Qt.AlignmentFlag.AlignVCenter | Qt.AlignmentFlag.AlignLeft, shown)
        painter.end()
