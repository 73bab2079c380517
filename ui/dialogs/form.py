"""Forms of dialogs, built from declared fields, and the layout that all dialogs share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from PyQt6.QtCore import Qt, pyqtSignal
from PyQt6.QtGui import QPalette
from PyQt6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.document.parameters import SKETCH
from sketchterrain.ui.look.theme import MARGIN, SPACING
from sketchterrain.ui.panels.numbers import NumberBox


@dataclass(frozen=True)
class Field:
    """One control, by its default: a choice (with `choices`), a text, a switch or a number.

    Attributes
    ----------
    title
        With ``&`` before its key; of a part of a line: its accessible name.
    words
        Beside a switch; in an empty text; in place of a number's least value.
    """

    name: str
    title: str
    default: Any
    tip: str = ""
    choices: Mapping[Any, str] | None = None
    range: tuple[float, float] = (0.0, 0.0)
    unit: str = ""
    decimals: int = 3
    words: str = ""
    width: int = 88

    def control(self) -> QWidget:
        """Return a new control at its default."""
        control: QWidget
        if self.choices is not None:
            control = QComboBox()
            for value, title in self.choices.items():
                control.addItem(title, value)
            control.setCurrentIndex(control.findData(self.default))
        elif isinstance(self.default, bool):
            control = QCheckBox(self.words)
            control.setChecked(self.default)
        elif isinstance(self.default, str):
            control = QLineEdit(self.default)
            control.setPlaceholderText(self.words)
        else:
            suffix = f" {self.unit}" if self.unit else ""
            control = NumberBox(*self.range, suffix=suffix, decimals=self.decimals)
            control.setSpecialValueText(self.words)
            control.setFixedWidth(self.width)
            control.setValue(self.default)
        control.setAccessibleName(self.title.replace("&", "") or self.words)
        control.setToolTip(self.tip)
        return control


@dataclass(frozen=True)
class Line:
    """Several controls in a row, and words between them."""

    name: str
    title: str
    tip: str
    parts: tuple[Field | str, ...]


NAME = Field("name", "&Name", "My terrain", "What the sketch is called")
EXTENT = Field(
    "extent",
    "&Extent",
    float(SKETCH["extent"].default),
    SKETCH["extent"].help[:1].upper() + SKETCH["extent"].help[1:],
    range=(SKETCH["extent"].low, SKETCH["extent"].high),
    unit="m",
    decimals=0,
)


class Form(QWidget):
    """Titled rows of controls; ``form[name]`` is a control, `note` a line of text below them."""

    changed = pyqtSignal()
    """A value was changed, by a person or by `set_values`."""

    def __init__(self, *lines: Field | Line, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._controls: dict[str, QWidget] = {}
        self._lines: dict[str, QWidget] = {}
        self._rows = form_layout()
        self._is_filling = False
        self.note = note()
        self._down = part(self)
        self._down.addLayout(self._rows)
        self._down.addWidget(self.note)
        for line in lines:
            row = self._add(line) if isinstance(line, Field) else self._add_line(line)
            self._lines[line.name] = row
            self._rows.addRow(line.title, row)
            label = self.title_label(line.name)
            if label is not None and isinstance(line, Line):
                first = next(each for each in line.parts if isinstance(each, Field))
                label.setBuddy(self._controls[first.name])

    def __getitem__(self, name: str) -> Any:
        return self._controls[name]

    @property
    def values(self) -> dict[str, Any]:
        """What is set, by name: the data of a choice, a text, a number, whether something is on."""
        return {name: _value(control) for name, control in self._controls.items()}

    def set_values(self, *values: Mapping[str, object]) -> None:
        """Set values, later ones over earlier; values that a control does not take are ignored."""
        self._is_filling = True
        for each in values:
            for name, control in self._controls.items():
                _set(control, each.get(name))
        self._is_filling = False
        self._report()

    def show_lines(self, shown: Mapping[str, bool]) -> None:
        """Show or hide lines with their titles."""
        for name, visible in shown.items():
            self._rows.setRowVisible(self._lines[name], visible)

    def enable(self, enabled: bool, *names: str) -> None:
        """Enable or disable controls."""
        for name in names:
            self._controls[name].setEnabled(enabled)

    def title_label(self, name: str) -> QLabel | None:
        """Return the label before a line."""
        label = self._rows.labelForField(self._lines[name])
        return label if isinstance(label, QLabel) else None

    def _add(self, field: Field) -> QWidget:
        control = self._controls[field.name] = field.control()
        _changes_of(control).connect(self._report)
        return control

    def _add_line(self, line: Line) -> QWidget:
        row = QWidget()
        across = QHBoxLayout(row)
        across.setContentsMargins(0, 0, 0, 0)
        across.setSpacing(SPACING)
        for each in line.parts:
            across.addWidget(QLabel(each) if isinstance(each, str) else self._add(each))
        across.addStretch(1)
        row.setToolTip(line.tip)
        row.setAccessibleName(line.title.replace("&", ""))
        return row

    def _report(self, *_: object) -> None:
        if not self._is_filling:
            self.changed.emit()


def _changes_of(control: QWidget) -> Any:
    if isinstance(control, QComboBox):
        return control.currentTextChanged
    if isinstance(control, QCheckBox):
        return control.toggled
    return control.textChanged if isinstance(control, QLineEdit) else control.valueChanged  # type: ignore[attr-defined]


def _value(control: QWidget) -> Any:
    if isinstance(control, QComboBox):
        return control.currentText() if control.isEditable() else control.currentData()
    if isinstance(control, QCheckBox):
        return control.isChecked()
    if isinstance(control, NumberBox):
        return control.value() if control.decimals() else int(control.value())
    return control.text() if isinstance(control, QLineEdit) else None


def _set(control: QWidget, value: object) -> None:
    is_number = isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)
    if isinstance(control, QComboBox):
        if control.isEditable() and isinstance(value, str):
            control.setEditText(value)
        elif (is_number or isinstance(value, (str, bool))) and control.findData(value) >= 0:
            control.setCurrentIndex(control.findData(value))
    elif isinstance(control, QCheckBox):
        if isinstance(value, bool):
            control.setChecked(value)
    elif isinstance(control, NumberBox):
        if is_number:
            control.setValue(float(value))  # type: ignore[arg-type] # a number
    elif isinstance(control, QLineEdit) and isinstance(value, str):
        control.setText(value)


def column(dialog: QDialog, title: str) -> QVBoxLayout:
    """Give a dialog its title and its column of parts."""
    dialog.setWindowTitle(title)
    rows = QVBoxLayout(dialog)
    rows.setContentsMargins(2 * MARGIN, 2 * MARGIN, 2 * MARGIN, MARGIN + SPACING)
    rows.setSpacing(MARGIN)
    return rows


def part(widget: QWidget) -> QVBoxLayout:
    """Return the column of a part of a dialog, without margins."""
    rows = QVBoxLayout(widget)
    rows.setContentsMargins(0, 0, 0, 0)
    rows.setSpacing(MARGIN)
    return rows


def form_layout() -> QFormLayout:
    """Return a layout for rows of a title and a control."""
    rows = QFormLayout()
    rows.setContentsMargins(0, 0, 0, 0)
    rows.setHorizontalSpacing(MARGIN)
    rows.setVerticalSpacing(SPACING)
    rows.setLabelAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
    rows.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    return rows


def titled(
    title: str, control: QWidget, name: str, browse: Callable[[], object] | None = None
) -> QHBoxLayout:
    """Return a row of a title and a control with an accessible name, and a button to browse for a path."""
    label = QLabel(title)
    label.setBuddy(control)
    control.setAccessibleName(name)
    row = QHBoxLayout()
    row.setSpacing(SPACING)
    row.addWidget(label)
    row.addWidget(control, 1)
    if browse is not None:
        button = QPushButton("Browse…")
        button.setAutoDefault(False)
        button.clicked.connect(browse)
        row.addWidget(button)
    return row


def progress_bar(name: str, units: int) -> QProgressBar:
    """Return a bar without text, full at a number of units."""
    bar = QProgressBar()
    bar.setRange(0, units)
    bar.setTextVisible(False)
    bar.setAccessibleName(name)
    return bar


def heading(text: str) -> QLabel:
    """Return the headline of a dialog."""
    label = QLabel(text)
    font = label.font()
    font.setPointSizeF(font.pointSizeF() * 1.25)
    font.setBold(True)
    label.setFont(font)
    return label


def note(text: str = "", *, selectable: bool = False) -> QLabel:
    """Return secondary text; messages are selectable, to be looked up elsewhere."""
    label = QLabel(text)
    label.setWordWrap(True)
    label.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Minimum)
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    if selectable:
        label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label


def show_note(label: QLabel, text: str, *, is_wrong: bool = False) -> None:
    """Show a note; an error in the colour of primary text."""
    role = QPalette.ColorRole.WindowText if is_wrong else QPalette.ColorRole.PlaceholderText
    label.setForegroundRole(role)
    label.setText(text)


def add_button(
    box: QDialogButtonBox,
    title: str,
    role: QDialogButtonBox.ButtonRole,
    do: Callable[[], object] | None = None,
) -> QPushButton:
    """Add a button to those of a dialog, and what it does besides its role."""
    button = QPushButton(title)
    box.addButton(button, role)
    if do is not None:
        button.clicked.connect(do)
    return button


def only_close(button: QPushButton) -> None:
    """Make a button the one that closes a finished dialog."""
    button.setText("Close")
    button.setEnabled(True)
    button.setDefault(True)
    button.setFocus()


def button_row(
    dialog: QDialog, accept: str, *, cancel: str = "Cancel", on_accept: Callable[[], object] | None = None
) -> tuple[QDialogButtonBox, QPushButton]:
    """Return the buttons of a dialog and its default one; without `accept` there is one, which closes."""
    box = QDialogButtonBox(dialog)
    agree = add_button(box, accept or cancel, QDialogButtonBox.ButtonRole.AcceptRole)
    agree.setDefault(True)
    if accept:
        add_button(box, cancel, QDialogButtonBox.ButtonRole.RejectRole)
    box.accepted.connect(on_accept or dialog.accept)
    box.rejected.connect(dialog.reject)
    return box, agree


def fix_width(dialog: QDialog, width: int) -> None:
    """Give a dialog of text a width, px, and the height that its text needs then."""
    rows = dialog.layout()
    if rows is not None:
        dialog.setFixedSize(width, rows.totalHeightForWidth(width))
