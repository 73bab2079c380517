"""Rows of a form: what a parameter is called, a control for its value, and a way back to the default."""

from __future__ import annotations

from itertools import pairwise

from PyQt6.QtCore import pyqtSignal
from PyQt6.QtGui import QWheelEvent
from PyQt6.QtWidgets import QComboBox, QGridLayout, QLabel, QLineEdit, QSizePolicy, QToolButton, QWidget

from sketchterrain.sketch import Parameter
from sketchterrain.sketch.parameter import Value
from sketchterrain.ui.look.icons import tool_button
from sketchterrain.ui.look.theme import SMALL, SPACING
from sketchterrain.ui.panels.text import faint_label
from sketchterrain.ui.panels.wording import help_of, title_of, tool_tip, with_unit


class ParameterRow(QWidget):
    """A parameter's title and help about a control that a subclass adds."""

    edited = pyqtSignal(object, object)
    """A person gave it another value; and the key of the gesture that did."""
    reset_asked = pyqtSignal()
    """A person wants the default back."""

    def __init__(
        self,
        parameter: Parameter,
        *,
        title: str = "",
        explains: bool = True,
        resets: bool = True,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.parameter = parameter
        self.title = title or title_of(parameter.name)
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(SPACING)
        self._grid.setVerticalSpacing(0)
        self._label = QLabel(self.title, self)
        self._label.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        self._label.setMinimumWidth(40)
        self.reset = self._reset_button() if resets else None
        self._grid.addWidget(self._label, 0, 0)
        if self.reset is not None:
            self._grid.addWidget(self.reset, 0, 2)
        self._grid.setColumnStretch(0, 1)
        self._across = 3 if resets else 2
        if explains:
            self._grid.addWidget(faint_label(help_of(parameter), self), 2, 0, 1, self._across)
        self.setToolTip(tool_tip(parameter))

    def show_value(self, value: Value) -> None:
        """Show what is set; tells nobody."""
        if self.reset is not None:
            self.reset.setVisible(value != self.parameter.default)

    def _put(self, control: QWidget, *, below: bool = False) -> None:
        """Put a control behind the title, or on a line of its own, and say what it is for."""
        control.setAccessibleName(self.title)
        control.setAccessibleDescription(help_of(self.parameter))
        control.setToolTip(self.toolTip())
        if below:
            self._grid.addWidget(control, 1, 0, 1, self._across)
        else:
            self._grid.addWidget(control, 0, 1)
            self._label.setBuddy(control)
        self._visit(control)

    def _visit(self, *controls: QWidget) -> None:
        """Let the tab key go through controls, and then to the way back."""
        order = [*controls, *([] if self.reset is None else [self.reset])]
        for one, next_one in pairwise(order):
            QWidget.setTabOrder(one, next_one)

    def _reset_button(self) -> QToolButton:
        tip = f"Back to {with_unit(self.parameter, self.parameter.default)}"
        button = tool_button("reset", f"{self.title}: back to the default", tip=tip, side=14, parent=self)
        button.setFixedSize(22, 22)
        button.setAutoRaise(True)
        policy = button.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        button.setSizePolicy(policy)
        button.hide()
        button.clicked.connect(self.reset_asked)
        return button


class ChoiceRow(ParameterRow):
    """A parameter with a few values to choose from."""

    def __init__(
        self, parameter: Parameter, *, title: str = "", explains: bool = True, parent: QWidget | None = None
    ) -> None:
        super().__init__(parameter, title=title, explains=explains, parent=parent)
        self.box = _PatientBox(self)
        for choice in parameter.choices:
            self.box.addItem(str(choice).replace("_", " ").capitalize(), choice)
        self.box.activated.connect(lambda _: self.edited.emit(self.box.currentData(), object()))
        self._put(self.box)

    def show_value(self, value: Value) -> None:
        """Show which is chosen."""
        super().show_value(value)
        self.box.setCurrentIndex(self.box.findData(value))  # tells only `currentIndexChanged`


class TextRow(ParameterRow):
    """A parameter that is a text."""

    def __init__(
        self, parameter: Parameter, *, title: str = "", explains: bool = True, parent: QWidget | None = None
    ) -> None:
        super().__init__(parameter, title=title, explains=explains, parent=parent)
        self.field = QLineEdit(self)
        self.field.setMaxLength(int(parameter.high))
        self.field.editingFinished.connect(self._finish)
        self._put(self.field, below=True)
        self._grid.setVerticalSpacing(SMALL)
        self._shown = ""

    def show_value(self, value: Value) -> None:
        """Show the text."""
        super().show_value(value)
        self._shown = str(value)
        if self.field.text() != self._shown:
            self.field.setText(self._shown)  # tells only `textChanged`

    def _finish(self) -> None:
        if self.field.text() != self._shown:
            self.edited.emit(self.field.text(), object())


class _PatientBox(QComboBox):
    """A choice that does not listen to a wheel that only scrolls past."""

    def wheelEvent(self, e: QWheelEvent | None) -> None:
        if e is not None:
            e.ignore()
