"""Forms of declared parameters: a row with title, control, help and reset button for each."""

from collections.abc import Iterable, Mapping
from functools import partial
from itertools import pairwise
from typing import Any

from PyQt6.QtCore import QSignalBlocker, pyqtSignal
from PyQt6.QtGui import QColor, QIcon
from PyQt6.QtWidgets import (
    QCheckBox,
    QColorDialog,
    QComboBox,
    QGridLayout,
    QLabel,
    QLineEdit,
    QToolButton,
    QWidget,
)

from sketchterrain.schema.parameters import LOOK, Parameter, Value
from sketchterrain.ui.look.layer_colours import colour_swatch
from sketchterrain.ui.look.theme import SPACING, clear, column, row, tool_button
from sketchterrain.ui.panels.controls import (
    SLIDER_STEPS,
    ClockBox,
    Gesture,
    NumberBox,
    Scale,
    faint_label,
    help_text,
    scroll_past,
    slider,
    slider_range,
    suffix_of,
    title_from_key,
    tool_tip,
    with_unit,
)


class ParameterRow(QWidget):
    """A parameter's title and help; subclasses add its control."""

    edited = pyqtSignal(object, object)  # the new value, None to reset it, and the merge key of the gesture
    number = 0.0  # that a row of a number displays

    def __init__(
        self, parameter: Parameter, *, title: str = "", has_reset: bool = True, decimals: int = 3
    ) -> None:
        super().__init__()
        self.parameter, self._decimals = parameter, decimals
        self.title = title or title_from_key(parameter.name)
        self._grid = QGridLayout(self)
        self._grid.setContentsMargins(0, 0, 0, 0)
        self._grid.setHorizontalSpacing(SPACING)
        self._grid.setVerticalSpacing(0)
        self._grid.setColumnStretch(0, 1)
        self._label = QLabel(self.title)
        self._label.setMinimumWidth(40)
        self._grid.addWidget(self._label, 0, 0)
        self.reset = self._reset_button() if has_reset else None
        if self.reset is not None:
            self._grid.addWidget(self.reset, 0, 2)
        if parameter.name != "name" and parameter.help:  # else the title says it all
            self._grid.addWidget(faint_label(help_text(parameter)), 2, 0, 1, -1)
        self.setToolTip(tool_tip(parameter))

    def show_value(self, value: Value) -> None:
        """Show a value without emitting a signal."""
        self.show_reset(value != self.parameter.default)

    def show_reset(self, visible: bool, tip: str = "") -> None:
        """Show or hide the reset button, and give it another tool tip."""
        if self.reset is not None:
            self.reset.setVisible(visible)
            self.reset.setToolTip(tip or self.reset.toolTip())

    def finish(self) -> None:
        """Accept the text being typed."""

    def _add(self, control: QWidget, *, below: bool = False, name: str = "") -> None:
        """Add a control beside or below the title, with accessible name, help and tool tip."""
        control.setAccessibleName(name or self.title)
        control.setAccessibleDescription(help_text(self.parameter))
        control.setToolTip(self.toolTip())
        if below:
            self._grid.addWidget(control, 1, 0, 1, -1)
        else:
            self._grid.addWidget(control, 0, 1)
            self._label.setBuddy(control)
        self._set_tab_order(control)

    def _set_tab_order(self, *controls: QWidget) -> None:
        for first, second in pairwise([*controls, *([self.reset] if self.reset else [])]):
            QWidget.setTabOrder(first, second)

    def _reset_button(self) -> QToolButton:
        tip = f"Back to {with_unit(self.parameter, self.parameter.default)}"
        button = tool_button("reset", f"{self.title}: back to the default", tip=tip, side=14)
        button.setFixedSize(22, 22)
        button.setAutoRaise(True)
        policy = button.sizePolicy()
        policy.setRetainSizeWhenHidden(True)
        button.setSizePolicy(policy)
        button.hide()
        button.clicked.connect(lambda: self.edited.emit(None, None))
        return button


class NumberRow(ParameterRow):
    """A number: a box, a slider, and a check box for a sentinel.

    All values of a slider's drag share one merge key, so that the drag is one undo step.
    """

    def __init__(self, parameter: Parameter, **options: Any) -> None:
        super().__init__(parameter, **options)
        self._gesture = Gesture()
        low, high = slider_range(parameter)
        self._scale = Scale.suited(parameter, low, high)
        self._sentinel = parameter.sentinel
        self.number = low if self._sentinel is None else self._sentinel.start  # displayed, not rounded
        self.box = self._number_box()
        self.slider = slider()
        self.check = None if self._sentinel is None else QCheckBox(self._sentinel.title)
        self._add(self.box)
        self._add(self.slider, below=True)
        if self.check is not None:
            self._add(self.check, below=True, name=f"{self.title}: {self.check.text().lower()}")
            self.check.toggled.connect(self._report_sentinel)
            line = QWidget()
            row(line, (self.slider, 1), self.check)
            self._grid.addWidget(line, 1, 0, 1, -1)
        self._set_tab_order(self.box, self.slider, *([self.check] if self.check else []))
        self._show_number(self.number)
        self.slider.sliderPressed.connect(self._gesture.begin)
        self.slider.sliderReleased.connect(self._gesture.end)
        self.slider.valueChanged.connect(lambda step: self._report(self._scale.value(step / SLIDER_STEPS)))
        self.box.valueChanged.connect(self._report)

    def finish(self) -> None:
        self.box.interpretText()

    def show_value(self, value: Value) -> None:
        super().show_value(value)
        is_sentinel = self._sentinel is not None and value == self._sentinel.value
        if self.check is not None:
            with QSignalBlocker(self.check):
                self.check.setChecked(is_sentinel)
            self.box.setDisabled(is_sentinel)
            self.slider.setDisabled(is_sentinel)
        if not is_sentinel:
            self._show_number(float(value))

    def _show_number(self, number: float) -> None:
        self.number = number
        if self.box.value() != number:
            with QSignalBlocker(self.box):
                self.box.setValue(number)
        # Values are rounded: a slider that already means this one stays, or keys could not move it.
        if self._scale.value(self.slider.value() / SLIDER_STEPS) != number:
            with QSignalBlocker(self.slider):
                self.slider.setValue(round(self._scale.fraction(number) * SLIDER_STEPS))

    def _report(self, number: float) -> None:
        if number != self.number or not self.box.isEnabled():
            self.number = number
            self.edited.emit(int(number) if self.parameter.kind is int else number, self._gesture.key)

    def _report_sentinel(self, checked: bool) -> None:
        if self._sentinel is not None:
            self.edited.emit(self._sentinel.value if checked else self.number, object())

    def _number_box(self) -> NumberBox:
        parameter, sentinel = self.parameter, self._sentinel
        decimals = 0 if parameter.kind is int else self._decimals
        low, high = parameter.low, parameter.high
        if sentinel is not None and sentinel.value == low:
            low = slider_range(parameter)[0]
        if parameter.unit == "h":
            return ClockBox(low, high, decimals=decimals)
        return NumberBox(low, high, suffix=suffix_of(parameter), decimals=decimals)


class CheckRow(ParameterRow):
    """A parameter that is 0 or 1."""

    def __init__(self, parameter: Parameter, **options: Any) -> None:
        super().__init__(parameter, **options)
        self.box = QCheckBox()
        self.box.clicked.connect(lambda on: self.edited.emit(int(on), object()))
        self._add(self.box)

    def show_value(self, value: Value) -> None:
        super().show_value(value)
        self.box.setChecked(value == 1)  # emits only `toggled`


class ChoiceRow(ParameterRow):
    """A parameter with a few allowed values."""

    def __init__(self, parameter: Parameter, **options: Any) -> None:
        super().__init__(parameter, **options)
        self.box = scroll_past(QComboBox())
        for choice in parameter.choices:
            self.box.addItem(str(choice).replace("_", " ").capitalize(), choice)
        self.box.activated.connect(lambda _: self.edited.emit(self.box.currentData(), object()))
        self._add(self.box)

    def show_value(self, value: Value) -> None:
        super().show_value(value)
        self.box.setCurrentIndex(self.box.findData(value))  # emits only `currentIndexChanged`


class TextRow(ParameterRow):
    """A text parameter."""

    def __init__(self, parameter: Parameter, **options: Any) -> None:
        super().__init__(parameter, **options)
        self.field = QLineEdit()
        self.field.setMaxLength(int(parameter.high))
        self.field.editingFinished.connect(self._report)
        self._add(self.field, below=True)
        self._grid.setVerticalSpacing(4)
        self._text = ""

    def show_value(self, value: Value) -> None:
        super().show_value(value)
        self._text = str(value)
        if self.field.text() != self._text:
            self.field.setText(self._text)  # emits only `textChanged`

    def _report(self) -> None:
        if self.field.text() != self._text:
            self.edited.emit(self.field.text(), object())


class ColourRow(TextRow):
    """A colour as text, or chosen in a dialog."""

    def __init__(self, parameter: Parameter, **options: Any) -> None:
        super().__init__(parameter, **options)
        self.button = tool_button("pick", f"Choose {self.title.lower()}", tip="Choose a colour")
        self.button.clicked.connect(self._choose)
        self._grid.addWidget(self.button, 0, 1)

    def show_value(self, value: Value) -> None:
        super().show_value(value)
        self.button.setIcon(QIcon(colour_swatch("", str(value), 16)))

    def _choose(self) -> None:
        colour = QColorDialog.getColor(QColor(self._text or "#808080"), self, self.title)
        if colour.isValid():
            self.edited.emit(colour.name(), object())


def _row_class(parameter: Parameter) -> type[CheckRow | ChoiceRow | TextRow | NumberRow]:
    if parameter.form == LOOK["colour"].form:
        return ColourRow
    if parameter.kind is int and (parameter.low, parameter.high) == (0, 1):
        return CheckRow
    return ChoiceRow if parameter.choices else TextRow if parameter.kind is str else NumberRow


class ParameterForm(QWidget):
    """Rows of parameters; `titles` replaces titles by name."""

    edited = pyqtSignal(str, object, object)
    """The parameter's name, its new value, None to reset it, and the merge key of the gesture."""

    def __init__(
        self, parameters: Iterable[Parameter] = (), *, titles: Mapping[str, str] | None = None
    ) -> None:
        super().__init__()
        self.rows: dict[str, ParameterRow] = {}
        self._declared: object = None
        self._column = column(self)
        self.declare(parameters, titles=titles)

    def declare(
        self, parameters: Iterable[Parameter], *, titles: Mapping[str, str] | None = None, **options: Any
    ) -> None:
        """Show rows of parameters, unless they are the present ones; see `ParameterRow` for options."""
        declared = tuple(parameters), titles, options
        if declared == self._declared:
            return
        self._declared, self.rows = declared, {}
        clear(self._column)
        for parameter in declared[0]:
            title = (titles or {}).get(parameter.name, "")
            field = self.rows[parameter.name] = _row_class(parameter)(parameter, title=title, **options)
            field.edited.connect(partial(self.edited.emit, parameter.name))
            self._column.addWidget(field)
            field.show()

    def show_values(self, values: Mapping[str, Value]) -> None:
        for name, field in self.rows.items():
            field.show_value(values[name])

    def finish(self) -> None:
        for field in self.rows.values():
            field.finish()
