"""Forms made from declared parameters: one row each, with its title, unit, help and a way to the default."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import pairwise

from PyQt6.QtCore import QSignalBlocker, pyqtSignal
from PyQt6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.document.parameter_types import Parameter, Value
from sketchterrain.ui.look.theme import SPACING, tool_button
from sketchterrain.ui.panels.numbers import (
    WAY,
    ClockBox,
    Gesture,
    NumberBox,
    Scale,
    comfortable_range,
    help_of,
    scroll_past,
    setting_title,
    slider,
    special_of,
    suffix_of,
    tool_tip,
    with_unit,
)
from sketchterrain.ui.panels.parts import faint_label


class ParameterRow(QWidget):
    """A parameter's title and help about a control that a subclass adds."""

    edited = pyqtSignal(object, object)
    """Another value was entered; and the merge key of the gesture."""
    reset_asked = pyqtSignal()
    """The default is asked for."""

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
        self.title = title or setting_title(parameter.name)
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(SPACING)
        self._grid.setVerticalSpacing(0)
        self._grid.setColumnStretch(0, 1)
        self._label = QLabel(self.title, self)
        self._label.setMinimumWidth(40)
        self._grid.addWidget(self._label, 0, 0)
        self.reset = self._reset_button() if resets else None
        if self.reset is not None:
            self._grid.addWidget(self.reset, 0, 2)
        if explains:
            self._grid.addWidget(faint_label(help_of(parameter), self), 2, 0, 1, -1)
        self.setToolTip(tool_tip(parameter))

    def show_value(self, value: Value) -> None:
        """Show a value without emitting anything."""
        if self.reset is not None:
            self.reset.setVisible(value != self.parameter.default)

    def finish(self) -> None:
        """Take what is being typed as it stands, as when the focus leaves."""

    def _add(self, control: QWidget, *, below: bool = False, name: str = "") -> None:
        """Add a control behind the title or below it, with its accessible name, help and tool tip."""
        control.setAccessibleName(name or self.title)
        control.setAccessibleDescription(help_of(self.parameter))
        control.setToolTip(self.toolTip())
        if below:
            self._grid.addWidget(control, 1, 0, 1, -1)
        else:
            self._grid.addWidget(control, 0, 1)
            self._label.setBuddy(control)
        self._set_tab_order(control)

    def _set_tab_order(self, *controls: QWidget) -> None:
        for one, next_one in pairwise([*controls, *([self.reset] if self.reset else [])]):
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


class NumberRow(ParameterRow):
    """A number: a box, a slider, and a check box for a value that stands for something else.

    While the slider is dragged every value has one key, so that the drag is one undo step.
    """

    def __init__(
        self,
        parameter: Parameter,
        *,
        title: str = "",
        explains: bool = True,
        resets: bool = True,
        decimals: int = 3,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parameter, title=title, explains=explains, resets=resets, parent=parent)
        self._special = special_of(parameter)
        self._gesture = Gesture()
        low, high = comfortable_range(parameter)
        self._scale = Scale.of(parameter, low, high)
        self._number = low if self._special is None else self._special.start
        self.box = self._number_box(0 if parameter.kind is int else decimals)
        self.slider = slider(self)
        self.check: QCheckBox | None = None
        self._add(self.box)
        if self._special is None:
            self._add(self.slider, below=True)
        else:
            self._add_special(self._special.title)
        self._set_tab_order(self.box, self.slider, *([self.check] if self.check else []))
        self._show_number(self._number)
        self.slider.sliderPressed.connect(self._gesture.begin)
        self.slider.sliderReleased.connect(self._gesture.end)
        self.slider.valueChanged.connect(lambda at: self._report(self._scale.at(at / WAY)))
        self.box.valueChanged.connect(self._report)

    @property
    def number(self) -> float:
        """The number that is shown, not rounded."""
        return self._number

    def finish(self) -> None:
        """Take what is being typed as it stands."""
        self.box.interpretText()

    def set_span(self, low: float, high: float) -> None:
        """Let the slider go from one value to another."""
        self._scale = Scale.of(self.parameter, low, high)

    def show_value(self, value: Value) -> None:
        """Show a number, or the special value."""
        super().show_value(value)
        is_special = self._special is not None and value == self._special.value
        if self.check is not None:
            with QSignalBlocker(self.check):
                self.check.setChecked(is_special)
            self.box.setDisabled(is_special)
            self.slider.setDisabled(is_special)
        if not is_special:
            self._show_number(float(value))

    def _show_number(self, number: float) -> None:
        self._number = number
        if self.box.value() != number:
            with QSignalBlocker(self.box):
                self.box.setValue(number)
        # Values are rounded: a slider that already means this one stays, or keys could not move it.
        if self._scale.at(self.slider.value() / WAY) != number:
            with QSignalBlocker(self.slider):
                self.slider.setValue(round(self._scale.share(number) * WAY))

    def _report(self, number: float) -> None:
        if number != self._number or not self.box.isEnabled():
            self._number = number
            self.edited.emit(int(number) if self.parameter.kind is int else number, self._gesture.key)

    def _report_special(self, checked: bool) -> None:
        if self._special is not None:
            self.edited.emit(self._special.value if checked else self._number, object())

    def _number_box(self, decimals: int) -> NumberBox:
        parameter, special = self.parameter, self._special
        low, high = parameter.low, parameter.high
        if special is not None:
            low = special.low if special.value == low else low
            high = high if special.value == parameter.low else min(high, special.value)
        if parameter.unit == "h":
            return ClockBox(low, high, decimals=decimals, parent=self)
        return NumberBox(low, high, suffix=suffix_of(parameter), decimals=decimals, parent=self)

    def _add_special(self, title: str) -> None:
        line = QWidget(self)
        across = QHBoxLayout(line)
        across.setContentsMargins(0, 0, 0, 0)
        across.setSpacing(SPACING)
        self.check = QCheckBox(title, line)
        self.check.toggled.connect(self._report_special)
        self._add(self.check, below=True, name=f"{self.title}: {title.lower()}")
        self._add(self.slider, below=True)
        self._grid.addWidget(line, 1, 0, 1, -1)
        across.addWidget(self.slider, 1)
        across.addWidget(self.check)


class ChoiceRow(ParameterRow):
    """A parameter with a few values to choose from."""

    def __init__(
        self, parameter: Parameter, *, title: str = "", explains: bool = True, parent: QWidget | None = None
    ) -> None:
        super().__init__(parameter, title=title, explains=explains, parent=parent)
        self.box = scroll_past(QComboBox(self))
        for choice in parameter.choices:
            self.box.addItem(str(choice).replace("_", " ").capitalize(), choice)
        self.box.activated.connect(lambda _: self.edited.emit(self.box.currentData(), object()))
        self._add(self.box)

    def show_value(self, value: Value) -> None:
        """Show which value is chosen."""
        super().show_value(value)
        self.box.setCurrentIndex(self.box.findData(value))  # emits only `currentIndexChanged`


class TextRow(ParameterRow):
    """A parameter that is a text."""

    def __init__(
        self, parameter: Parameter, *, title: str = "", explains: bool = True, parent: QWidget | None = None
    ) -> None:
        super().__init__(parameter, title=title, explains=explains, parent=parent)
        self.field = QLineEdit(self)
        self.field.setMaxLength(int(parameter.high))
        self.field.editingFinished.connect(self._report)
        self._add(self.field, below=True)
        self._grid.setVerticalSpacing(4)
        self._shown = ""

    def show_value(self, value: Value) -> None:
        """Show the text."""
        super().show_value(value)
        self._shown = str(value)
        if self.field.text() != self._shown:
            self.field.setText(self._shown)  # emits only `textChanged`

    def _report(self) -> None:
        if self.field.text() != self._shown:
            self.edited.emit(self.field.text(), object())


def row_of(parameter: Parameter, *, title: str = "", explains: bool = True) -> ParameterRow:
    """Return the row that suits a parameter."""
    kind = ChoiceRow if parameter.choices else TextRow if parameter.kind is str else NumberRow
    return kind(parameter, title=title, explains=explains)


class ParameterForm(QWidget):
    """Parameters below one another; `titles` replaces titles by name."""

    edited = pyqtSignal(str, object, object)
    """Another value was entered: the parameter's name, the value, the merge key of the gesture."""
    reset_asked = pyqtSignal(str)

    def __init__(
        self,
        parameters: Iterable[Parameter],
        *,
        titles: Mapping[str, str] | None = None,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.rows: dict[str, ParameterRow] = {}
        down = QVBoxLayout(self)
        down.setContentsMargins(0, 0, 0, 0)
        down.setSpacing(SPACING)
        for parameter in parameters:
            name = parameter.name
            row = row_of(parameter, title=(titles or {}).get(name, ""), explains=name != "name")
            row.edited.connect(lambda value, key, name=name: self.edited.emit(name, value, key))
            row.reset_asked.connect(lambda name=name: self.reset_asked.emit(name))
            self.rows[name] = row
            down.addWidget(row)

    def show_values(self, values: Mapping[str, Value]) -> None:
        """Show values by name without emitting anything."""
        for name, row in self.rows.items():
            row.show_value(values[name])

    def finish(self) -> None:
        """Take what is being typed as it stands."""
        for row in self.rows.values():
            row.finish()
