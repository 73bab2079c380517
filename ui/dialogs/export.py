"""Export dialog: files and folder, then progress and outcome with the values to enter on import."""

import time
from pathlib import Path
from typing import Any

from PyQt6.QtCore import Qt, QTimer
from PyQt6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PyQt6.QtWidgets import (
    QComboBox,
    QFileDialog,
    QLabel,
    QPushButton,
    QStackedWidget,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from sketchterrain.document.sketch import Sketch
from sketchterrain.export.target import setting_rows
from sketchterrain.export.targets import TARGET_NAMES, target_named
from sketchterrain.jobs.estimates import time_left
from sketchterrain.ui.actions import clipboard
from sketchterrain.ui.dialogs.export_options import EverythingForm, TargetForm
from sketchterrain.ui.dialogs.form import JobDialog, JobProgress, show_note, titled
from sketchterrain.ui.look.theme import MARGIN, column, described, row
from sketchterrain.ui.models.workspace import Preferences

_STAGES = {
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
"""Stages of an export of everything and their approximate shares, in hundredths."""
_TARGET_STAGES = {
    "Starting": 1,
    "Loading the program": 3,
    "Opening the device": 1,
    "Placing features": 8,
    "Heights and materials": 37,
    "": 50,
}
"""Stages of an export to a target, whose own stages share the last."""
_TABLE_HEIGHT = 190  # px
_INDENT = "    "


class ExportOutcome(JobProgress):
    """Progress of an export, and the table of import settings."""

    def __init__(self) -> None:
        super().__init__("Exporting", "Progress of the export")
        self._stages, self._rows = _STAGES, list[tuple[QTreeWidgetItem, str]]()
        self._stage, self._start = "Starting", 0.0
        self._stage_start = 0  # value of the bar when the stage began
        self._clock = QTimer(self)
        self._clock.setInterval(500)
        self._clock.timeout.connect(self._show_time)
        self.table, copy = QTreeWidget(), QPushButton("&Copy")
        described(self.table, "Import settings", "Ctrl+C copies the selected value")
        self.table.setHeaderLabels(["Setting", "Value"])
        self.table.setSelectionMode(QTreeWidget.SelectionMode.ExtendedSelection)
        self.table.setRootIsDecorated(False)
        self.table.setWordWrap(True)
        self.table.setMinimumHeight(_TABLE_HEIGHT)
        copy.setToolTip("Copy all of it as text")
        copy.setAutoDefault(False)
        copy.clicked.connect(lambda: self._copy(all_rows=True))
        title = QLabel("&To type in where the files are imported")
        title.setBuddy(self.table)
        self._settings = QWidget()
        column(self._settings, row(None, (title, 1), copy, spacing=-1), (self.table, 1), spacing=-1)
        self._settings.hide()
        keys, context = QKeySequence.StandardKey.Copy, Qt.ShortcutContext.WidgetShortcut
        QShortcut(keys, self.table, lambda: self._copy(all_rows=False), context=context)
        self._column.addWidget(self._settings, 1)
        self._column.addStretch(0)

    def begin(self, *, is_target: bool) -> None:
        self._stages = _TARGET_STAGES if is_target else _STAGES
        self._start = time.monotonic()
        self._clock.start()

    def end(self) -> None:
        self._clock.stop()

    def show_stage(self, title: str) -> None:
        self._stage = title
        self._stage_start = self.bar.value()
        self.doing.setText(f"{title} …")
        self.show_share(0.0)

    def show_share(self, share: float) -> None:
        """Show the progress of the stage, 0 … 1."""
        if self._stage in self._stages:
            titles = list(self._stages)
            before = sum(self._stages[each] for each in titles[: titles.index(self._stage)])
            done = self.UNITS * (before + self._stages[self._stage] * share) / sum(self._stages.values())
        else:  # half of the rest
            done = self._stage_start + 0.5 * (self.UNITS - self._stage_start) * share
        self.bar.setValue(max(self.bar.value(), round(done)))

    def show_done(self, summary: dict[str, Any], folder: Path) -> None:
        """Show the summary of written files, see `export_process`."""
        self.end()
        self.heading.setText("Exported")
        self.bar.setValue(self.UNITS)
        self.doing.setText(f"{len(summary['files'])} files in {summary['seconds']:.0f} s, into\n{folder}")
        heights = summary["heights"]
        lines = [f"Heights {heights['minimum']:.0f} m to {heights['maximum']:.0f} m."]
        if summary.get("plants"):
            lines.append(f"{summary['plants']:,} plants.".replace(",", "\u202f"))
        if summary.get("problem"):
            lines.append(f"No preview: {summary['problem']}")
        lines += [f"Restarted: {line}." for line in summary.get("restarts", ())]
        self.notes.setText(" ".join(lines))
        self._show_settings(summary.get("settings", {}))

    def show_failed(self, line: str) -> None:
        """Show an error; an empty line means cancelled."""
        self.end()
        self.heading.setText("Not exported" if line else "Cancelled")
        self.doing.setText("No file was written.")
        self.notes.setText(line)

    def _show_time(self) -> None:
        seconds = time.monotonic() - self._start
        left = time_left(self.bar.value() / self.UNITS, seconds)
        self.notes.setText(f"{seconds:.0f} s{left and ', '}{left}")

    def _show_settings(self, settings: dict[str, Any]) -> None:
        rows, parents = setting_rows(settings), [self.table.invisibleRootItem()]
        self._rows.clear()
        for depth, name, value in rows:
            item = QTreeWidgetItem(parents[depth], [name, value])
            parents[depth + 1 :] = [item]
            self._rows.append((item, f"{_INDENT * depth}{name}\t{value}"))
        self.table.expandAll()
        self.table.resizeColumnToContents(0)
        self._settings.setVisible(bool(rows))

    def _copy(self, *, all_rows: bool) -> None:
        """Copy all rows with their names, or the selected ones, of one only the value."""
        rows = [(item, line) for item, line in self._rows if all_rows or item.isSelected()]
        is_value = len(rows) == 1 and not all_rows
        clipboard().setText(rows[0][0].text(1) if is_value else "\n".join(line for _, line in rows))


class ExportDialog(JobDialog):
    """Exports the terrain of a sketch as it is when the dialog opens."""

    def __init__(self, sketch: Sketch, preferences: Preferences, parent: QWidget | None = None) -> None:
        self.outcome = ExportOutcome()
        super().__init__("Export terrain", self.outcome, sketch, preferences, parent)
        self._values: dict[str, dict[str, Any]] = {}  # entered for targets
        self._shown = ""  # target whose form is visible
        self.targets = QComboBox()
        self.targets.addItem("Everything, as “generate” writes it", "")
        for name in TARGET_NAMES:
            self.targets.addItem(target_named(name).title, name)
        self.targets.setCurrentIndex(max(self.targets.findData(preferences.export_target), 0))
        self.everything = EverythingForm(sketch, preferences.export_options(""))
        self.target = TargetForm(sketch)
        folder = preferences.export_folder or preferences.last_folder / "terrain"
        self.path_field.setText(str(folder))
        self.pages, page = QStackedWidget(), QWidget()
        targets = titled("E&xport for", self.targets, "Program or format")
        path = titled("&Folder", self.path_field, "Folder for the files", self._browse)
        column(page, targets, self.everything, self.target, path, self.hint, 1, spacing=MARGIN)
        self.pages.addWidget(page)
        self._column.addWidget(self.pages, 1)
        self.add_buttons("Export", self._export)
        for form in (self.everything, self.target):
            form.changed.connect(self._check)
        self.path_field.textChanged.connect(self._check)
        self.targets.currentIndexChanged.connect(self._use_target)
        self.setMinimumWidth(540)
        self._use_target()

    @property
    def options(self) -> EverythingForm | TargetForm:
        return self.target if self.targets.currentData() else self.everything

    def closeEvent(self, event: QCloseEvent | None) -> None:
        super().closeEvent(event)
        self.outcome.end()

    def _use_target(self, *_: object) -> None:
        """Show the selected target's form with its previous values."""
        if self._shown:
            self._values[self._shown] = self.target.values
        self._shown = str(self.targets.currentData())
        self.everything.setVisible(not self._shown)
        self.target.setVisible(bool(self._shown))
        if self._shown:
            stored = self._values.get(self._shown) or self._preferences.export_options(self._shown)
            self.target.use(target_named(self._shown), stored)
        self._check()
        QTimer.singleShot(0, self._fit_height)

    def _fit_height(self) -> None:
        if self.job is None:
            self.resize(self.width(), self.minimumSizeHint().height())

    def _check(self, *_: object) -> None:
        error = self.options.problem
        if not self.path_field.text().strip():
            error = "Choose a folder."
        elif self.path.is_file():
            error = f"{self.path} is a file: expected a folder."
        self.accept_button.setEnabled(not error)
        line = error
        if not error and (self.path / self.options.mark).is_file():
            line = "Files of a previous export there are replaced."
        show_note(self.hint, line, is_error=bool(error))

    def _browse(self) -> None:
        start = self.path if self.path.is_dir() else self.path.parent
        name = QFileDialog.getExistingDirectory(self, "Export into a folder", str(start))
        if name:
            self.path_field.setText(name)

    def _remember(self) -> None:
        self._preferences.export_folder = self.path
        self._preferences.export_target = self._shown
        self._preferences.set_export_options(self._shown, self.options.values)

    def _export(self) -> None:
        self._remember()
        self.pages.addWidget(self.outcome)
        self.pages.setCurrentWidget(self.outcome)
        self.outcome.begin(is_target=bool(self._shown))
        self.run(self.options.request(self.path, self._preferences.device))

    def show_done(self, summary: dict[str, Any]) -> None:
        self.outcome.show_done(summary, self.path)
        self.folder_button.show()
        self.finish()

    def show_failed(self, line: str) -> None:
        self.outcome.show_failed(line)
        self.finish()
