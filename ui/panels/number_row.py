"""A row for a number: a box to type in, a slider, and a box to check for a value that is no number."""

from __future__ import annotations

from PyQt6.QtCore import QSignalBlocker
from PyQt6.QtWidgets import QCheckBox, QHBoxLayout, QWidget

from sketchterrain.sketch import Parameter
from sketchterrain.sketch.parameter import Value
from sketchterrain.ui.look.theme import SPACING
from sketchterrain.ui.panels.clock_box import ClockBox
from sketchterrain.ui.panels.gesture import Gesture
from sketchterrain.ui.panels.number_box import WAY, NumberBox, PatientSlider
from sketchterrain.ui.panels.parameter_row import ParameterRow
from sketchterrain.ui.panels.scale import Scale, scale_of
from sketchterrain.ui.panels.wording import comfortable_range, special_of, suffix_of


class NumberRow(ParameterRow):
    """A parameter that is a number.

    While its slider is dragged it tells each value with one key, so that the drag is one step to undo.
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
        self._scale: Scale = scale_of(parameter, low, high)
        self._number = low if self._special is None else self._special.start
        self.box = self._make_box(0 if parameter.kind is int else decimals)
        self.slider = PatientSlider(self)
        self.check: QCheckBox | None = None
        self._put(self.box)
        self._put(self._make_line(), below=True)
        self._visit(self.box, self.slider, *([] if self.check is None else [self.check]))
        self._show_number(self._number)
        self.slider.sliderPressed.connect(self._gesture.begin)
        self.slider.sliderReleased.connect(self._gesture.end)
        self.slider.valueChanged.connect(lambda _: self._tell(self._scale.at(self.slider.share)))
        self.box.valueChanged.connect(self._tell)

    @property
    def number(self) -> float:
        """The number that is shown, as exactly as it is known."""
        return self._number

    def finish(self) -> None:
        """Take what is being typed as it stands, as when the keyboard goes elsewhere."""
        self.box.interpretText()

    def set_span(self, low: float, high: float) -> None:
        """Let the slider go from one value to another."""
        self._scale = scale_of(self.parameter, low, high)

    def show_value(self, value: Value) -> None:
        """Show a number, or that it is none."""
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
        if self._scale.at(self.slider.share) != number:
            with QSignalBlocker(self.slider):
                self.slider.setValue(round(self._scale.share(number) * WAY))

    def _tell(self, number: float) -> None:
        if number != self._number or not self.box.isEnabled():
            self._number = number
            whole = self.parameter.kind is int
            self.edited.emit(int(number) if whole else number, self._gesture.key)

    def _tell_special(self, checked: bool) -> None:
        special = self._special
        if special is not None:
            self.edited.emit(special.value if checked else self._number, object())

    def _make_box(self, decimals: int) -> NumberBox:
        parameter, special = self.parameter, self._special
        low, high = parameter.low, parameter.high
        if special is not None:
            low = special.low if special.value == low else low
            high = high if special.value == parameter.low else min(high, special.value)
        even = self._scale.kind == "even"
        is_clock = parameter.unit == "h"
        return (ClockBox if is_clock else NumberBox)(
            low,
            high,
            suffix="" if is_clock else suffix_of(parameter),
            step=self._scale.step if even else 0.0,
            decimals=decimals,
            parent=self,
        )

    def _make_line(self) -> QWidget:
        """Return the slider, beside the box to check if there is one."""
        special = self._special
        if special is None:
            return self.slider
        line = QWidget(self)
        across = QHBoxLayout(line)
        across.setContentsMargins(0, 0, 0, 0)
        across.setSpacing(SPACING)
        self.check = QCheckBox(special.title, line)
        self.check.setAccessibleName(f"{self.title}: {special.title.lower()}")
        self.check.setToolTip(self.toolTip())
        self.check.toggled.connect(self._tell_special)
        self.slider.setAccessibleName(self.title)
        self.slider.setToolTip(self.toolTip())
        across.addWidget(self.slider, 1)
        across.addWidget(self.check)
        return line
