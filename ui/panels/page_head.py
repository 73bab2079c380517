"""What a page of properties is about: a small picture, a title and a line beneath it."""

from __future__ import annotations

from PyQt6.QtCore import Qt
from PyQt6.QtGui import QPixmap
from PyQt6.QtWidgets import QGridLayout, QLabel, QWidget

from sketchterrain.ui.look.layer_colours import swatch
from sketchterrain.ui.look.theme import SPACING
from sketchterrain.ui.panels.text import faint_label, heading

_SIDE = 28


class PageHead(QWidget):
    """The head of a page."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._picture = QLabel(self)
        self._picture.setFixedSize(_SIDE, _SIDE)
        self._title = heading("", self)
        self._line = faint_label("", self)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(SPACING + 2)
        grid.setVerticalSpacing(0)
        grid.addWidget(self._picture, 0, 0, 2, 1, Qt.AlignmentFlag.AlignTop)
        grid.addWidget(self._title, 0, 1)
        grid.addWidget(self._line, 1, 1)
        grid.setColumnStretch(1, 1)

    @property
    def title(self) -> str:
        """What it says in its first line."""
        return self._title.text()

    def show_label(self, title: str, line: str, layer: str, label: int) -> None:
        """Say what the page is about, with a label's picture."""
        self._picture.setPixmap(swatch(layer, label, _SIDE, self.devicePixelRatioF()))
        self._say(title, line)

    def show_text(self, title: str, line: str) -> None:
        """Say what the page is about, without a picture."""
        self._picture.setPixmap(QPixmap())
        self._say(title, line)

    def _say(self, title: str, line: str) -> None:
        self._title.setText(title)
        self._line.setText(line[:1].upper() + line[1:])
