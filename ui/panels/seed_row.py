"""The seed: typed, thrown with dice, or one that was used before."""

from __future__ import annotations

import random
from typing import Final

from PyQt6.QtCore import QRegularExpression, pyqtSignal
from PyQt6.QtGui import QRegularExpressionValidator
from PyQt6.QtWidgets import QHBoxLayout, QLabel, QLineEdit, QMenu, QToolButton, QVBoxLayout, QWidget

from sketchterrain.errors import InputError
from sketchterrain.sketch import SKETCH, Parameter
from sketchterrain.ui.look.icons import tool_button
from sketchterrain.ui.look.theme import SMALL, SPACING, tabular
from sketchterrain.ui.panels.text import faint_label
from sketchterrain.ui.panels.wording import help_of, tool_tip

_SEED: Final[Parameter] = SKETCH["seed"]
_REMEMBERED: Final = 20
_FACES: Final = 1_000_000
"""Dice show fewer seeds than there are: numbers that one can tell another person."""


class SeedRow(QWidget):
    """The seed of a sketch, and those that it had before."""

    edited = pyqtSignal(object)
    """A person wants another seed."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._seed = 0
        self._used: list[int] = []
        self.field = self._make_field()
        self.dice = tool_button(
            "dice", "Throw a seed", tip="Another seed: another terrain of the same sketch", parent=self
        )
        self.dice.clicked.connect(lambda: self.edited.emit(_other_than(self._seed)))
        self.earlier = tool_button(
            "undo", "Seeds used before", tip="Go back to a seed that was used before", parent=self
        )
        self.earlier.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
        self._menu = QMenu(self.earlier)
        self.earlier.setMenu(self._menu)
        self._lay_out()

    @property
    def used(self) -> tuple[int, ...]:
        """Seeds that the sketch had, the newest first."""
        return tuple(self._used)

    def show_seed(self, seed: int) -> None:
        """Show the seed and remember it."""
        self._seed = seed
        if self.field.text() != str(seed):
            self.field.setText(str(seed))
        if not self._used or self._used[0] != seed:
            self._used = [seed, *(each for each in self._used if each != seed)][:_REMEMBERED]
            self._fill_menu()

    def forget(self) -> None:
        """Forget which seeds were used: it is another sketch."""
        self._used = []

    def _finish(self) -> None:
        text = self.field.text()
        try:
            seed = int(_SEED.check(int(text or "0")))
        except InputError:
            seed = int(_SEED.high)  # nineteen digits can say more than a seed holds
        self.field.setText(str(seed))
        if seed != self._seed:
            self.edited.emit(seed)

    def _fill_menu(self) -> None:
        self._menu.clear()
        for seed in self._used[1:]:
            action = self._menu.addAction(f"Seed {seed}")
            if action is not None:
                action.triggered.connect(lambda _, seed=seed: self.edited.emit(seed))
        self.earlier.setEnabled(len(self._used) > 1)

    def _make_field(self) -> QLineEdit:
        field = QLineEdit(self)
        field.setFont(tabular(field.font()))
        field.setValidator(QRegularExpressionValidator(QRegularExpression("[0-9]{0,19}"), field))
        field.setAccessibleName("Seed")
        field.setToolTip(tool_tip(_SEED))
        field.editingFinished.connect(self._finish)
        return field

    def _lay_out(self) -> None:
        title = QLabel("&Seed", self)
        title.setBuddy(self.field)
        across = QHBoxLayout()
        across.setSpacing(SMALL)
        across.addWidget(title)
        across.addSpacing(SPACING)
        across.addWidget(self.field, 1)
        across.addWidget(self.dice)
        across.addWidget(self.earlier)
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SMALL)
        down.addLayout(across)
        down.addWidget(faint_label(help_of(_SEED), self))


def _other_than(seed: int) -> int:
    thrown = random.randrange(_FACES - 1)  # noqa: S311 # a terrain, no secret
    return thrown + (thrown >= seed)
