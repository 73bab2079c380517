"""What was set in a dialog as plain values, so that it is set again the next time."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from PyQt6.QtWidgets import QCheckBox, QComboBox, QDoubleSpinBox, QLineEdit, QWidget

Kept = dict[str, str | float | bool]
"""A value for each control, by name."""


def values_of(controls: Mapping[str, QWidget]) -> Kept:
    """Return what is set: the data of a choice, a text, a number, whether something is checked."""
    values: Kept = {}
    for name, control in controls.items():
        if isinstance(control, QComboBox):
            values[name] = control.currentText() if control.isEditable() else control.currentData()
        elif isinstance(control, QCheckBox):
            values[name] = control.isChecked()
        elif isinstance(control, QDoubleSpinBox):
            values[name] = control.value()
        elif isinstance(control, QLineEdit):
            values[name] = control.text()
    return values


def set_values(controls: Mapping[str, QWidget], values: Mapping[str, object]) -> None:
    """Set what was kept; what no control takes counts as never chosen."""
    for name, control in controls.items():
        value = values.get(name)
        if isinstance(control, QComboBox):
            _choose(control, value)
        elif isinstance(control, QCheckBox):
            if isinstance(value, bool):
                control.setChecked(value)
        elif isinstance(control, QDoubleSpinBox):
            if isinstance(value, (int, float)) and math.isfinite(value):
                control.setValue(value)
        elif isinstance(control, QLineEdit) and isinstance(value, str):
            control.setText(value)


def call_on_change(controls: Mapping[str, QWidget], do: Callable[..., object]) -> None:
    """Do something whenever another value is set, with the new one as it is told."""
    for control in controls.values():
        if isinstance(control, QComboBox):
            control.currentIndexChanged.connect(do)
        elif isinstance(control, QCheckBox):
            control.toggled.connect(do)
        elif isinstance(control, QDoubleSpinBox):
            control.valueChanged.connect(do)
        elif isinstance(control, QLineEdit):
            control.textChanged.connect(do)


def _choose(box: QComboBox, value: object) -> None:
    if box.isEditable():
        if isinstance(value, str):
            box.setEditText(value)
    elif isinstance(value, (str, int)) and box.findData(value) >= 0:
        box.setCurrentIndex(box.findData(value))
