"""Forms of dialogs, built from declared fields; layout, buttons and export jobs that dialogs share."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PyQt6.QtCore import QSignalBlocker, Qt, QUrl, pyqtSignal
from PyQt6.QtGui import QCloseEvent, QDesktopServices, QFont, QPalette
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

from sketchterrain.document.sketch import Sketch
from sketchterrain.schema.parameters import SKETCH
from sketchterrain.ui.engine.protocol import Request
from sketchterrain.ui.export_job import ExportJob
from sketchterrain.ui.look.theme import MARGIN, SPACING, LayoutItem, column, heading, row
from sketchterrain.ui.models.workspace import Preferences
from sketchterrain.ui.panels.controls import NumberBox


@dataclass(frozen=True)
class Field:
    """One control, by its default: a choice (with `choices`), a text, a switch, an integer or a number."""

    name: str
    title: str  # With ``&`` before its key; of a part of a line: its accessible name
    default: Any
    tip: str = ""
    choices: Mapping[Any, str] | None = None
    range: tuple[float, float] = (0.0, 0.0)
    unit: str = ""
    text: str = ""  # Beside a switch; placeholder of a text; in place of a number's least value
    width: int = 88

    def control(self) -> Control:
        if self.choices is not None:
            control: Control = _choice(self)
        elif isinstance(self.default, bool):
            check = QCheckBox(self.text)
            control = Control(check, check.toggled, check.isChecked, check.setChecked, (bool,))
        elif isinstance(self.default, str):
            line = QLineEdit()
            line.setPlaceholderText(self.text)
            control = Control(line, line.textChanged, line.text, line.setText, (str,))
        else:
            decimals = 0 if isinstance(self.default, int) else 3
            box = NumberBox(*self.range, suffix=f" {self.unit}" if self.unit else "", decimals=decimals)
            box.setSpecialValueText(self.text)
            box.setFixedWidth(self.width)
            value = box.value if decimals else lambda: int(box.value())
            control = Control(box, box.valueChanged, value, box.setValue, (int, float))
        control.set(self.default)
        control.widget.setAccessibleName(self.title.replace("&", "") or self.text)
        control.widget.setToolTip(self.tip)
        return control


@dataclass(frozen=True)
class Control:
    """A widget with access to its value."""

    widget: QWidget
    changed: Any  # Its bound signal
    value: Callable[[], Any]
    assign: Callable[[Any], object]
    types: tuple[type, ...]  # Accepted by `assign`

    def set(self, value: object) -> None:
        """Set the value; one that the control does not accept is ignored."""
        is_finite = not isinstance(value, float) or math.isfinite(value)
        if isinstance(value, self.types) and isinstance(value, bool) <= (bool in self.types) and is_finite:
            self.assign(value)


def _choice(field: Field) -> Control:
    box = QComboBox()
    for data, title in (field.choices or {}).items():
        box.addItem(title, data)

    def assign(value: Any) -> None:
        if box.isEditable() and isinstance(value, str):
            box.setEditText(value)
        elif box.findData(value) >= 0:
            box.setCurrentIndex(box.findData(value))

    def value() -> Any:
        return box.currentText() if box.isEditable() else box.currentData()

    return Control(box, box.currentTextChanged, value, assign, (bool, int, float, str))


@dataclass(frozen=True)
class Line:
    """Several controls in a row, with words between them."""

    name: str
    title: str
    tip: str
    parts: tuple[Field | str, ...]

    @property
    def fields(self) -> list[Field]:
        return [part for part in self.parts if isinstance(part, Field)]


_MAX_NOTES = 4  # that a running job shows
_EXTENT = SKETCH["extent"]
NAME = Field("name", "&Name", "My terrain", "Name of the sketch")
EXTENT = Field(
    *("extent", "&Extent", int(_EXTENT.default), _EXTENT.help[:1].upper() + _EXTENT.help[1:]),
    range=(_EXTENT.low, _EXTENT.high),
    unit="m",
)


class Form(QWidget):
    """Titled rows of controls; ``form[name]`` is a control, `note` a line of text below them."""

    changed = pyqtSignal()

    def __init__(self, *lines: Field | Line) -> None:
        super().__init__()
        self._controls: dict[str, Control] = {}
        self._lines: dict[str, QWidget] = {}
        self._rows = form_layout()
        self.note = note()
        self._column = column(self, self._rows, self.note, spacing=MARGIN)
        for line in lines:
            widget = self._add(line) if isinstance(line, Field) else self._add_line(line)
            self._lines[line.name] = widget
            self._rows.addRow(line.title, widget)
            label = self.title_label(line.name)
            if label is not None and isinstance(line, Line):
                label.setBuddy(self[line.fields[0].name])

    def __getitem__(self, name: str) -> Any:
        return self._controls[name].widget

    @property
    def values(self) -> dict[str, Any]:
        """Values by name: the data of a choice, a text, a number, or whether a switch is on."""
        return {name: control.value() for name, control in self._controls.items()}

    def set_values(self, *values: Mapping[str, object]) -> None:
        """Set values, later ones over earlier; a value that its control does not accept is ignored."""
        with QSignalBlocker(self):
            for each in values:
                for name, control in self._controls.items():
                    control.set(each.get(name))
        self.changed.emit()

    def show_lines(self, visible: Mapping[str, bool]) -> None:
        for name, is_visible in visible.items():
            self._rows.setRowVisible(self._lines[name], is_visible)

    def enable(self, enabled: bool, *names: str) -> None:
        for name in names:
            self._controls[name].widget.setEnabled(enabled)

    def title_label(self, name: str) -> QLabel | None:
        label = self._rows.labelForField(self._lines[name])
        return label if isinstance(label, QLabel) else None

    def _add(self, field: Field) -> QWidget:
        control = self._controls[field.name] = field.control()
        control.changed.connect(self.changed)
        return control.widget

    def _add_line(self, line: Line) -> QWidget:
        widget = QWidget()
        row(widget, *(QLabel(each) if isinstance(each, str) else self._add(each) for each in line.parts), 1)
        widget.setToolTip(line.tip)
        widget.setAccessibleName(line.title.replace("&", ""))
        return widget


def dialog_column(dialog: QDialog, title: str, *items: LayoutItem) -> QVBoxLayout:
    """Set a dialog's title and return its column of items."""
    dialog.setWindowTitle(title)
    margins = (2 * MARGIN, 2 * MARGIN, 2 * MARGIN, MARGIN + SPACING)
    return column(dialog, *items, margins=margins, spacing=MARGIN)


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
    """Return a row of a title, a control with an accessible name, and a button to browse for a path."""
    label = QLabel(title)
    label.setBuddy(control)
    control.setAccessibleName(name)
    line = row(None, label, (control, 1))
    if browse is not None:
        button = QPushButton("Browse…")
        button.setAutoDefault(False)
        button.clicked.connect(browse)
        line.addWidget(button)
    return line


def headline(text: str) -> QLabel:
    """Return the headline of a dialog."""
    return heading(text, weight=QFont.Weight.Bold, scale=1.25)


def note(text: str = "", *, selectable: bool = False) -> QLabel:
    """Return secondary text."""
    label = QLabel(text)
    label.setWordWrap(True)
    label.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Minimum)
    label.setForegroundRole(QPalette.ColorRole.PlaceholderText)
    if selectable:
        label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return label


def show_note(label: QLabel, text: str, *, is_error: bool = False) -> None:
    """Show a note; an error in the colour of primary text."""
    role = QPalette.ColorRole.WindowText if is_error else QPalette.ColorRole.PlaceholderText
    label.setForegroundRole(role)
    label.setText(text)


def add_button(
    box: QDialogButtonBox,
    title: str,
    role: QDialogButtonBox.ButtonRole,
    on_click: Callable[[], object] | None = None,
) -> QPushButton:
    """Add a button to a dialog's."""
    button = QPushButton(title)
    box.addButton(button, role)
    if on_click is not None:
        button.clicked.connect(on_click)
    return button


def button_row(
    dialog: QDialog, accept: str, *, cancel: str = "Cancel", on_accept: Callable[[], object] | None = None
) -> tuple[QDialogButtonBox, QPushButton]:
    """Return a dialog's buttons and the default one; without `accept` there is only one, to close."""
    box = QDialogButtonBox()  # comes last in the tab order, where the layout puts it
    default = add_button(box, accept or cancel, QDialogButtonBox.ButtonRole.AcceptRole)
    default.setDefault(True)
    if accept:
        add_button(box, cancel, QDialogButtonBox.ButtonRole.RejectRole)
    box.accepted.connect(on_accept or dialog.accept)
    box.rejected.connect(dialog.reject)
    return box, default


def fix_width(dialog: QDialog, width: int) -> None:
    """Fix a dialog's width (px) and the height that its text needs then."""
    rows = dialog.layout()
    if rows is not None:
        dialog.setFixedSize(width, rows.totalHeightForWidth(width))


def run_dialog(dialog: QDialog) -> bool:
    """Show a modal dialog and delete it; return whether it was accepted."""
    accepted = bool(dialog.exec())
    dialog.deleteLater()
    return accepted


class JobProgress(QWidget):
    """Progress and outcome of an export job."""

    UNITS = 1000  # steps of the bar

    def __init__(self, title: str, name: str) -> None:
        super().__init__()
        self.heading, self.doing, self.notes = headline(title), QLabel("Starting"), note(selectable=True)
        self.doing.setWordWrap(True)
        self.lines: list[str] = []
        self.bar = QProgressBar()
        self.bar.setRange(0, self.UNITS)
        self.bar.setTextVisible(False)
        self.bar.setAccessibleName(name)
        self._column = column(self, self.heading, self.doing, self.bar, self.notes, spacing=MARGIN)

    def show_stage(self, title: str) -> None:
        self.doing.setText(title)

    def show_share(self, share: float) -> None:
        """Show the progress, 0 … 1."""
        self.bar.setValue(round(self.UNITS * share))

    def show_note(self, line: str) -> None:
        self.lines.append(line)
        self.notes.setText("\n".join(self.lines[-_MAX_NOTES:]))


class JobDialog(QDialog):
    """Asks for options and a path, then runs an export job; subclasses call `add_buttons` and `run`."""

    cancelling = "Cancelling …"

    def __init__(
        self,
        title: str,
        progress: JobProgress,
        sketch: Sketch,
        preferences: Preferences,
        parent: QWidget | None,
    ) -> None:
        super().__init__(parent)
        self._progress, self._sketch, self._preferences = progress, sketch, preferences
        self.job: ExportJob | None = None
        self.path_field, self.hint = QLineEdit(), note(selectable=True)
        self._column = dialog_column(self, title)

    def add_buttons(self, accept: str, on_accept: Callable[[], object], *others: QPushButton) -> None:
        """Add the row of buttons; `others` are hidden until the job has finished."""
        box, roles = QDialogButtonBox(), QDialogButtonBox.ButtonRole
        self.accept_button = add_button(box, accept, roles.AcceptRole, on_accept)
        for button in others:
            box.addButton(button, roles.ActionRole)
        self.folder_button = add_button(box, "Open folder", roles.ActionRole, self._open_folder)
        self.close_button = add_button(box, "Cancel", roles.RejectRole, self.reject)
        self.accept_button.setDefault(True)
        for button in (*others, self.folder_button):
            button.hide()
        self._column.addWidget(box)

    @property
    def path(self) -> Path:
        return Path(self.path_field.text().strip()).expanduser()

    def run(self, request: Request) -> None:
        self.job = ExportJob(request, self._sketch, self)
        self.job.stage_changed.connect(self._progress.show_stage)
        self.job.share_changed.connect(self._progress.show_share)
        self.job.noted.connect(self._progress.show_note)
        self.job.finished.connect(self.show_done)
        self.job.failed.connect(self.show_failed)
        self.accept_button.hide()
        self.job.start()

    def show_done(self, summary: dict[str, Any]) -> None:
        """Show the summary of a finished job, see `export_process`."""
        raise NotImplementedError

    def show_failed(self, line: str) -> None:
        """Show why a job failed; an empty line means cancelled."""
        raise NotImplementedError

    def finish(self) -> None:
        """Make the close button the default of a finished dialog."""
        self.close_button.setText("Close")
        self.close_button.setEnabled(True)
        self.close_button.setDefault(True)
        self.close_button.setFocus()

    def reject(self) -> None:
        if self.job is not None and self.job.is_running:
            self.close_button.setEnabled(False)
            self._progress.doing.setText(self.cancelling)
            self.job.cancel()
        else:
            super().reject()

    def closeEvent(self, event: QCloseEvent | None) -> None:
        if self.job is not None:
            self.job.stop()
        super().closeEvent(event)

    def _open_folder(self) -> None:
        folder = self.path if self.path.is_dir() else self.path.parent
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(folder)))
