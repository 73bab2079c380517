"""How every dialog is laid out: a column, rows of a form, buttons at the end."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from PyQt6.QtCore import Qt
from PyQt6.QtGui import QPalette
from PyQt6.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QDoubleSpinBox,
    QFormLayout,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QSizePolicy,
    QSpinBox,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.sketch import SKETCH
from sketchterrain.ui.look.theme import MARGIN, SPACING

_SIDES = (32, 16384)  # px


def column(dialog: QDialog, title: str) -> QVBoxLayout:
    """Give a dialog its title and the column in which everything stands."""
    dialog.setWindowTitle(title)
    rows = QVBoxLayout(dialog)
    rows.setContentsMargins(2 * MARGIN, 2 * MARGIN, 2 * MARGIN, MARGIN + SPACING)
    rows.setSpacing(MARGIN)
    return rows


def part(widget: QWidget) -> QVBoxLayout:
    """Return the column of a part of a dialog: its edge is the dialog's own."""
    rows = QVBoxLayout(widget)
    rows.setContentsMargins(0, 0, 0, 0)
    rows.setSpacing(MARGIN)
    return rows


def form() -> QFormLayout:
    """Return a layout for rows of a name and a control."""
    rows = QFormLayout()
    rows.setContentsMargins(0, 0, 0, 0)
    rows.setHorizontalSpacing(MARGIN)
    rows.setVerticalSpacing(SPACING)
    rows.setLabelAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
    rows.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    return rows


def add_rows(rows: QFormLayout, controls: Iterable[tuple[str, QWidget, str]]) -> None:
    """Add controls with their titles, an `&` before the key of each, and what they are for as tips."""
    for title, control, tip in controls:
        rows.addRow(title, control)
        control.setToolTip(tip)
        control.setAccessibleName(title.replace("&", ""))


def name_line(name: str) -> QLineEdit:
    """Return a line for a sketch's name."""
    line = QLineEdit(name)
    line.setMaxLength(int(SKETCH["name"].high))
    return line


def extent_box() -> QDoubleSpinBox:
    """Return a box for a sketch's extent, m, at its default."""
    box = QDoubleSpinBox()
    box.setDecimals(0)
    box.setRange(SKETCH["extent"].low, SKETCH["extent"].high)
    box.setSingleStep(1024)
    box.setSuffix(" m")
    box.setGroupSeparatorShown(True)
    box.setValue(float(SKETCH["extent"].default))
    return box


def pixel_box(value: int, low: int = _SIDES[0], high: int = _SIDES[1]) -> QSpinBox:
    """Return a box for a count of pixels; by default within what a sketch's side can be."""
    box = QSpinBox()
    box.setRange(low, high)
    box.setSuffix(" px")
    box.setValue(value)
    return box


def choice_box(titles: Mapping[Any, str]) -> QComboBox:
    """Return a box of choices: what each means, as its data, and its title."""
    box = QComboBox()
    for data, title in titles.items():
        box.addItem(title, data)
    return box


def beside(*parts: QWidget | str) -> QWidget:
    """Return controls, and words between them, in a row."""
    row = QWidget()
    across = QHBoxLayout(row)
    across.setContentsMargins(0, 0, 0, 0)
    across.setSpacing(SPACING)
    for part in parts:
        across.addWidget(QLabel(part) if isinstance(part, str) else part)
    across.addStretch(1)
    return row


def titled(title: str, control: QWidget, name: str, *after: QWidget) -> QHBoxLayout:
    """Return a row of a title, with an `&` before its key, and a control with its name, and what follows."""
    label = QLabel(title)
    label.setBuddy(control)
    control.setAccessibleName(name)
    row = QHBoxLayout()
    row.setSpacing(SPACING)
    row.addWidget(label)
    row.addWidget(control, 1)
    for each in after:
        row.addWidget(each)
    return row


def with_browse(title: str, line: QLineEdit, name: str, browse: Callable[[], object]) -> QHBoxLayout:
    """Return a row for a path: its title, its line with its name, and a button that looks for one."""
    button = QPushButton("Browse…")
    button.setAutoDefault(False)
    button.clicked.connect(browse)
    return titled(title, line, name, button)


def share_bar(name: str, units: int) -> QProgressBar:
    """Return a bar without words, full at a number of units."""
    bar = QProgressBar()
    bar.setRange(0, units)
    bar.setTextVisible(False)
    bar.setAccessibleName(name)
    return bar


def heading(text: str) -> QLabel:
    """Return a line that says what a dialog is for."""
    label = QLabel(text)
    font = label.font()
    font.setPointSizeF(font.pointSizeF() * 1.25)
    font.setBold(True)
    label.setFont(font)
    return label


def note(text: str = "") -> QLabel:
    """Return text that is read second."""
    label = QLabel(text)
    label.setWordWrap(True)
    label.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Minimum)
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    return label


def note_to_copy() -> QLabel:
    """Return a note whose text can be selected: messages are looked up elsewhere."""
    label = note()
    label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label


def tell(label: QLabel, text: str, *, is_wrong: bool = False) -> None:
    """Let a note say something; what is wrong is as dark as what is read first."""
    role = QPalette.ColorRole.WindowText if is_wrong else QPalette.ColorRole.PlaceholderText
    label.setForegroundRole(role)
    label.setText(text)


def add_button(
    box: QDialogButtonBox,
    title: str,
    role: QDialogButtonBox.ButtonRole,
    do: Callable[[], object] | None = None,
) -> QPushButton:
    """Add a button to those of a dialog, and what it does; None: what its role says."""
    button = box.addButton(title, role)
    if button is None:
        raise RuntimeError("expected a button")
    if do is not None:
        button.clicked.connect(do)
    return button


def only_close(button: QPushButton) -> None:
    """Make closing all that is left to do."""
    button.setText("Close")
    button.setEnabled(True)
    button.setDefault(True)
    button.setFocus()


def button_row(
    dialog: QDialog, accept: str, *, cancel: str = "Cancel", on_accept: Callable[[], object] | None = None
) -> tuple[QDialogButtonBox, QPushButton]:
    """Return the buttons at the end of a dialog, and the one that agrees."""
    box = QDialogButtonBox(dialog)
    agree = add_button(box, accept or cancel, QDialogButtonBox.ButtonRole.AcceptRole)
    agree.setDefault(True)
    if accept:
        box.addButton(cancel, QDialogButtonBox.ButtonRole.RejectRole)
    box.accepted.connect(on_accept or dialog.accept)
    box.rejected.connect(dialog.reject)
    return box, agree


def fix_width(dialog: QDialog, width: int) -> None:
    """Give a dialog of text a width, px, and the height that its text needs then."""
    rows = dialog.layout()
    if rows is not None:
        dialog.setFixedSize(width, rows.totalHeightForWidth(width))
