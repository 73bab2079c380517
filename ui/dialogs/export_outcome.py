"""How far an export is, and what came of it: files, and what to type in where they are imported."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

from PyQt6.QtCore import Qt, QTimer
from PyQt6.QtGui import QAction, QGuiApplication, QKeySequence
from PyQt6.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.export.sidecar import setting_rows
from sketchterrain.ui.dialogs.form import heading, note, part, progress_bar

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
            for column, text in enumerate((_INDENT * depth + name, value)):
                self.table.setItem(row, column, QTableWidgetItem(text))
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
