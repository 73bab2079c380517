"""Buttons over the view: how the eye moves, see everything, save a picture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QRectF, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QPainter
from PyQt6.QtWidgets import QButtonGroup, QFrame, QHBoxLayout, QToolButton, QWidget

from sketchterrain.ui.engine.orders import MODES
from sketchterrain.ui.look.icons import draw_icon

if TYPE_CHECKING:
    from PyQt6.QtGui import QPaintEvent

__all__ = ["Bar"]

_HELP: Final = {
    "orbit": "Turn around the terrain: drag turns, right drag or Shift moves, wheel zooms (1)",
    "fly": "Fly: W A S D, Q and E, drag looks around, Shift is faster (2)",
    "walk": "Walk on the ground: W A S D, drag looks around, Shift is faster (3)",
}
_PLATE = QColor(18, 21, 24, 165)
_SIGN = QColor(240, 243, 245)
_SIDE, _ICON = 28, 18


class _Button(QToolButton):
    """A light sign on the dark plate, in either theme."""

    def __init__(self, parent: QWidget, name: str) -> None:
        super().__init__(parent)
        self._name = name
        self.setFixedSize(_SIDE, _SIDE)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw it as it is: pressed, checked, under the mouse or with the focus."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        place = QRectF(self.rect())
        shine = 95 if self.isDown() else 70 if self.isChecked() else 38 if self.underMouse() else 0
        painter.setBrush(QColor(255, 255, 255, shine))
        painter.setPen(QColor(255, 255, 255, 170) if self.hasFocus() else Qt.PenStyle.NoPen)
        painter.drawRoundedRect(place.adjusted(0.5, 0.5, -0.5, -0.5), 5.0, 5.0)
        sign = QRectF(0.0, 0.0, _ICON, _ICON)
        sign.moveCenter(place.center())
        draw_icon(painter, self._name, sign, _SIGN)


class Bar(QFrame):
    """A row of buttons on a dark plate: pictures of ground are dark, whatever the theme."""

    mode_chosen = pyqtSignal(str)
    see_all = pyqtSignal()
    see_best = pyqtSignal()
    picture_wanted = pyqtSignal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        row = QHBoxLayout(self)
        row.setContentsMargins(3, 3, 3, 3)
        row.setSpacing(1)
        self._modes = QButtonGroup(self)
        for number, mode in enumerate(MODES):
            button = self._button(mode, _HELP[mode], mode.capitalize())
            button.setCheckable(True)
            self._modes.addButton(button, number)
            row.addWidget(button)
        self._modes.idClicked.connect(self._choose)
        row.addSpacing(7)
        for name, tip, what, signal in (
            ("fit", "See the whole sketch (R)", "See the whole sketch", self.see_all),
            ("camera", "Stand where the terrain looks best (C)", "Best view", self.see_best),
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

    def _choose(self, number: int) -> None:
        self.mode_chosen.emit(MODES[number])

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the plate."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(_PLATE)
        painter.drawRoundedRect(QRectF(self.rect()), 7.0, 7.0)

    def _button(self, name: str, tip: str, what: str) -> _Button:
        button = _Button(self, name)
        button.setToolTip(tip)
        button.setAccessibleName(what)
        return button
