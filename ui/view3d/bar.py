"""Buttons over the view: how the eye moves, see everything, save a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QRectF, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QPainter, QPalette
from PyQt6.QtWidgets import QButtonGroup, QFrame, QHBoxLayout, QToolButton, QWidget

from sketchterrain.ui.engine.messages import MODES
from sketchterrain.ui.look.icons import icon

if TYPE_CHECKING:
    from PyQt6.QtGui import QPaintEvent

__all__ = ["Bar"]

_HELP: Final = {
    "orbit": "Turn around the terrain: drag turns, right drag or Shift moves, wheel zooms (1)",
    "fly": "Fly: W A S D, Q and E, drag looks around, Shift is faster (2)",
    "walk": "Walk on the ground: W A S D, drag looks around, Shift is faster (3)",
}
_PLATE = QColor(18, 21, 24, 165)
_SHEET = """
QToolButton { border: 1px solid transparent; border-radius: 5px; padding: 3px; background: transparent; }
QToolButton:hover { background: rgba(255, 255, 255, 40); }
QToolButton:checked { background: rgba(255, 255, 255, 70); }
QToolButton:focus { border-color: rgba(255, 255, 255, 160); }
"""


class Bar(QFrame):
    """A row of buttons on a dark plate: pictures of ground are dark, whatever the theme."""

    mode_chosen = pyqtSignal(str)
    see_all = pyqtSignal()
    picture_wanted = pyqtSignal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setStyleSheet(_SHEET)
        palette = self.palette()
        for role in (QPalette.ColorRole.ButtonText, QPalette.ColorRole.WindowText, QPalette.ColorRole.Text):
            palette.setColor(role, QColor(240, 243, 245))
        self.setPalette(palette)
        row = QHBoxLayout(self)
        row.setContentsMargins(3, 3, 3, 3)
        row.setSpacing(1)
        self._modes = QButtonGroup(self)
        for number, mode in enumerate(MODES):
            button = self._button(mode, _HELP[mode], mode.capitalize())
            button.setCheckable(True)
            self._modes.addButton(button, number)
            row.addWidget(button)
        self._modes.idClicked.connect(lambda number: self.mode_chosen.emit(MODES[number]))
        row.addSpacing(7)
        for name, tip, what, signal in (
            ("fit", "See the whole terrain (R)", "See the whole terrain", self.see_all),
            ("screenshot", "Save a picture…", "Save a picture", self.picture_wanted),
        ):
            button = self._button(name, tip, what)
            button.clicked.connect(signal)
            row.addWidget(button)
        self.adjustSize()

    def show_mode(self, mode: str) -> None:
        """Mark how the eye moves."""
        button = self._modes.button(MODES.index(mode))
        if button is not None:
            button.setChecked(True)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the plate."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(_PLATE)
        painter.drawRoundedRect(QRectF(self.rect()), 7.0, 7.0)

    def _button(self, name: str, tip: str, what: str) -> QToolButton:
        button = QToolButton(self)
        button.setIcon(icon(name))
        button.setIconSize(QSize(18, 18))
        button.setToolTip(tip)
        button.setAccessibleName(what)
        button.setAutoRaise(True)
        return button
