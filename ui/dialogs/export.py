"""Export dialog."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from PyQt6.QtCore import Qt, QTimer, QUrl
from PyQt6.QtGui import QAction, QCloseEvent, QDesktopServices, QGuiApplication, QKeySequence
from PyQt6.QtWidgets import (
    QAbstractItemView,
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLineEdit,
    QPushButton,
    QStackedWidget,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.document.sketch import Sketch
from sketchterrain.export.sidecar import setting_rows
from sketchterrain.export.targets import TARGET_NAMES, target_named
from sketchterrain.ui.dialogs.export_options import EverythingForm, TargetForm
from sketchterrain.ui.dialogs.form import (
    add_button,
    column,
    heading,
    note,
    only_close,
    part,
    progress_bar,
    show_note,
    titled,
)
from sketchterrain.ui.export_job import ExportJob
from sketchterrain.ui.models.preferences import Preferences

STAGES = {
    "Starting": 1,
    "Loading the program": 3,
    "Opening the device": 1,
    "Placing features": 8,
    "Heights and materials": 20,
    "Plants": 25,
    "Comparing with the sketch": 8,
    "Drawing the map": 10,
    "Preview": 20,
    "Writing files": 4,
}
"""Stages of an export of everything and about what share of it each is, in hundredths."""
TARGET_STAGES = {
    "Starting": 1,
    "Loading the program": 3,
    "Opening the device": 1,
    "Placing features": 8,
    "Heights and materials": 37,
    "": 50,
}
"""Those of an export to a target; its own, which are not known beforehand, share the last."""
_UNITS = 1000
_TABLE_HEIGHT = 190  # px
_INDENT = "    "


class ExportOutcome(QWidget):
    """Follows one export."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._stages = STAGES
        self._stage, self._began = "Starting", 0.0
        self._done_before = 0  # of the bar, when the stage began
        self._head = heading("Exporting")
        self.doing = QLabel("Starting")
        self.doing.setWordWrap(True)
        self.bar = progress_bar("How far the export is", _UNITS)
        self.told = note(selectable=True)
        self._clock = QTimer(self)
        self._clock.setInterval(500)
        self._clock.timeout.connect(self._show_time)
        self._settings = QWidget()
        self.table, copy = _table(), QPushButton("&Copy")
        copy.setToolTip("Copy all of it as text")
        copy.setAutoDefault(False)
        copy.clicked.connect(self._copy)
        title = QLabel("&To type in where the files are imported")
        title.setBuddy(self.table)
        above = QHBoxLayout()
        above.addWidget(title, 1)
        above.addWidget(copy)
        inner = QVBoxLayout(self._settings)
        inner.setContentsMargins(0, 0, 0, 0)
        inner.addLayout(above)
        inner.addWidget(self.table, 1)
        self._settings.hide()
        self._copy_key = QAction(self.table)
        self._copy_key.setShortcut(QKeySequence(QKeySequence.StandardKey.Copy))
        self._copy_key.setShortcutContext(Qt.ShortcutContext.WidgetShortcut)
        self._copy_key.triggered.connect(self._copy_chosen)
        self.table.addAction(self._copy_key)
        rows = part(self)
        for widget in (self._head, self.doing, self.bar, self.told):
            rows.addWidget(widget)
        rows.addWidget(self._settings, 1)
        rows.addStretch(0)

    def begin(self, stages: dict[str, int]) -> None:
        """Count the time from now on, of an export with such stages."""
        self._stages = stages
        self._began = time.monotonic()
        self._clock.start()

    def end(self) -> None:
        """Count no more."""
        self._clock.stop()

    def show_stage(self, title: str) -> None:
        """Tell what is being done."""
        self._stage = title
        self._done_before = self.bar.value()
        self.doing.setText(f"{title} …")
        self.show_share(0.0)

    def show_share(self, share: float) -> None:
        """Tell how much of the stage is done, 0 … 1."""
        if self._stage in self._stages:
            titles = list(self._stages)
            before = sum(self._stages[each] for each in titles[: titles.index(self._stage)])
            done = _UNITS * (before + self._stages[self._stage] * share) / sum(self._stages.values())
        else:  # half of what is left
            done = self._done_before + 0.5 * (_UNITS - self._done_before) * share
        self.bar.setValue(max(self.bar.value(), round(done)))

    def show_done(self, told: dict[str, Any], folder: Path) -> None:
        """Tell what was written, see `export_process`."""
        self.end()
        self._head.setText("Exported")
        self.bar.setValue(_UNITS)
        count = len(told["files"])
        self.doing.setText(f"{count} files in {told['seconds']:.0f} s, into\n{folder}")
        heights = told["heights"]
        lines = [f"Heights {heights['minimum']:.0f} m to {heights['maximum']:.0f} m."]
        if told.get("plants"):
            lines.append(f"{told['plants']:,} plants.".replace(",", "\u202f"))
        if told.get("problem"):
            lines.append(f"No preview: {told['problem']}")
        lines += [f"Begun again: {line}." for line in told.get("restarts", ())]
        self.told.setText(" ".join(lines))
        self._show_settings(told.get("settings", {}))

    def show_failed(self, line: str) -> None:
        """Tell why there are no files; empty: it was cancelled."""
        self.end()
        self._head.setText("Not exported" if line else "Cancelled")
        self.doing.setText("No file was written.")
        self.told.setText(line)

    def _show_time(self) -> None:
        self.told.setText(f"{time.monotonic() - self._began:.0f} s")

    def _show_settings(self, settings: dict[str, Any]) -> None:
        rows = setting_rows(settings)
        self.table.setRowCount(len(rows))
        for row, (depth, name, value) in enumerate(rows):
            for index, text in enumerate((_INDENT * depth + name, value)):
                self.table.setItem(row, index, QTableWidgetItem(text))
            if not value:
                self.table.setSpan(row, 0, 1, 2)
        self._settings.setVisible(bool(rows))

    def _copy(self) -> None:
        self._copy_rows(range(self.table.rowCount()))

    def _copy_chosen(self) -> None:
        """Copy the value of one row as it is typed in, else rows with their names."""
        rows = sorted({index.row() for index in self.table.selectedIndexes()})
        if len(rows) == 1:
            _to_clipboard(_text(self.table, rows[0], 1))
        else:
            self._copy_rows(rows)

    def _copy_rows(self, rows: range | list[int]) -> None:
        _to_clipboard(
            "\n".join("\t".join(_text(self.table, row, column) for column in (0, 1)) for row in rows)
        )


def _table() -> QTableWidget:
    table = QTableWidget(0, 2)
    table.setHorizontalHeaderLabels(["Setting", "Value"])
    table.setAccessibleName("What to type in")
    table.setToolTip("Ctrl+C copies the value that is selected")
    table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
    table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
    table.setTabKeyNavigation(False)
    table.setShowGrid(False)
    table.setMinimumHeight(_TABLE_HEIGHT)
    across, down = table.horizontalHeader(), table.verticalHeader()
    if across is not None and down is not None:
        across.setSectionResizeMode(0, QHeaderView.ResizeMode.ResizeToContents)
        across.setStretchLastSection(True)
        across.setDefaultAlignment(Qt.AlignmentFlag.AlignLeft | Qt.AlignmentFlag.AlignVCenter)
        down.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        down.hide()
    return table


def _text(table: QTableWidget, row: int, column: int) -> str:
    item = table.item(row, column)
    return "" if item is None else item.text()


def _to_clipboard(text: str) -> None:
    clipboard = QGuiApplication.clipboard()
    if clipboard is not None:
        clipboard.setText(text)


_EVERYTHING = "Everything, as “generate” writes it"


class ExportDialog(QDialog):
    """Exports the terrain of a sketch as it is now."""

    def __init__(self, sketch: Sketch, preferences: Preferences, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._sketch = sketch
        self._preferences = preferences
        self.job: ExportJob | None = None
        self._set: dict[str, dict[str, Any]] = {}  # of targets that were looked at
        rows = column(self, "Export terrain")
        self.targets = QComboBox()
        self.targets.addItem(_EVERYTHING, "")
        for name in TARGET_NAMES:
            self.targets.addItem(target_named(name).title, name)
        self.targets.setCurrentIndex(max(self.targets.findData(preferences.export_target), 0))
        self.everything = EverythingForm(sketch, preferences.export_options(""))
        self.target = TargetForm(sketch)
        self._shown = ""  # the target whose controls are there
        folder = preferences.export_folder or preferences.last_folder / "terrain"
        self.folder = QLineEdit(str(folder))
        self.outcome = ExportOutcome()
        self.pages = QStackedWidget()
        self.pages.addWidget(self._ask_page())
        rows.addWidget(self.pages, 1)
        buttons, roles = QDialogButtonBox(), QDialogButtonBox.ButtonRole
        self._go = add_button(buttons, "Export", roles.AcceptRole, self._begin)
        self._show_folder = add_button(buttons, "Open folder", roles.ActionRole, self._open_folder)
        self._close = add_button(buttons, "Cancel", roles.RejectRole, self.reject)
        self._go.setDefault(True)
        self._show_folder.hide()
        rows.addWidget(buttons)
        for form in (self.everything, self.target):
            form.changed.connect(self._check)
        self.folder.textChanged.connect(self._check)
        self.targets.currentIndexChanged.connect(self._use_target)
        self.setMinimumWidth(540)
        self._use_target()

    @property
    def place(self) -> Path:
        """The folder that is chosen."""
        return Path(self.folder.text().strip()).expanduser()

    @property
    def options(self) -> EverythingForm | TargetForm:
        """The form that is shown."""
        return self.target if self.targets.currentData() else self.everything

    def reject(self) -> None:
        """Cancel what runs; else close."""
        if self.job is not None and self.job.is_running:
            self._close.setEnabled(False)
            self.outcome.doing.setText("Cancelling …")
            self.job.cancel()
            return
        super().reject()

    def closeEvent(self, event: QCloseEvent | None) -> None:
        """Cancel what runs."""
        if self.job is not None:
            self.job.stop()
        self.outcome.end()
        super().closeEvent(event)

    def _ask_page(self) -> QWidget:
        page = QWidget()
        rows = part(page)
        rows.addLayout(titled("E&xport for", self.targets, "Program or format"))
        rows.addWidget(self.everything)
        rows.addWidget(self.target)
        rows.addLayout(titled("&Folder", self.folder, "Folder for the files", self._browse))
        self._refused = note(selectable=True)
        rows.addWidget(self._refused)
        rows.addStretch(1)
        return page

    def _use_target(self, *_: object) -> None:
        """Ask for the target that is chosen, as it was asked for the last time."""
        if self._shown:
            self._set[self._shown] = self.target.values
        self._shown = str(self.targets.currentData())
        self.everything.setVisible(not self._shown)
        self.target.setVisible(bool(self._shown))
        if self._shown:
            kept = self._set.get(self._shown) or self._preferences.export_options(self._shown)
            self.target.use(target_named(self._shown), kept)
        self._check()
        QTimer.singleShot(0, self._fit)

    def _fit(self) -> None:
        """Be as high as the controls need."""
        if self.job is None:
            self.resize(self.width(), self.minimumSizeHint().height())

    def _check(self, *_: object) -> None:
        line = self.options.problem
        if not self.folder.text().strip():
            line = "Choose a folder."
        elif self.place.is_file():
            line = f"{self.place} is a file: expected a folder."
        self._go.setEnabled(not line)
        is_wrong = bool(line)
        if not line and (self.place / self.options.mark).is_file():
            line = "Files of an earlier export there are replaced."
        show_note(self._refused, line, is_wrong=is_wrong)

    def _browse(self) -> None:
        start = self.place if self.place.is_dir() else self.place.parent
        name = QFileDialog.getExistingDirectory(self, "Export into a folder", str(start))
        if name:
            self.folder.setText(name)

    def _begin(self) -> None:
        self._remember()
        self.job = ExportJob(self.options.request(self.place, self._preferences.device), self._sketch, self)
        self.job.stage_changed.connect(self.outcome.show_stage)
        self.job.share_changed.connect(self.outcome.show_share)
        self.job.finished.connect(self._show_done)
        self.job.failed.connect(self._show_failed)
        self.pages.addWidget(self.outcome)
        self.pages.setCurrentWidget(self.outcome)
        self._go.hide()
        self.outcome.begin(TARGET_STAGES if self._shown else STAGES)
        self.job.start()

    def _remember(self) -> None:
        self._preferences.export_folder = self.place
        self._preferences.export_target = self._shown
        self._preferences.set_export_options(self._shown, self.options.values)

    def _show_done(self, told: dict[str, Any]) -> None:
        self.outcome.show_done(told, self.place)
        self._show_folder.show()
        self._finish()

    def _show_failed(self, line: str) -> None:
        self.outcome.show_failed(line)
        self._finish()

    def _finish(self) -> None:
        only_close(self._close)

    def _open_folder(self) -> None:
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(self.place)))
