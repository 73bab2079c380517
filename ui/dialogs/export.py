"""The export dialog: which files, where, what it takes; then how far it is, and what came of it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from PyQt6.QtCore import QTimer, QUrl
from PyQt6.QtGui import QDesktopServices
from PyQt6.QtWidgets import (
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QProgressBar,
    QPushButton,
    QStackedWidget,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.errors import InputError
from sketchterrain.sizes import check_size
from sketchterrain.ui.dialogs.export_wishes import ExportWishes
from sketchterrain.ui.dialogs.sheet import column, heading, note
from sketchterrain.ui.export_job import ExportJob
from sketchterrain.ui.look.theme import MARGIN, SPACING

if TYPE_CHECKING:
    from PyQt6.QtGui import QCloseEvent

    from sketchterrain.sketch import Sketch

__all__ = ["ExportDialog"]

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
"""Stages of an export and about what share of it each is, in hundredths."""
_UNITS = 1000


class ExportDialog(QDialog):
    """Exports the terrain of a sketch as it is now.

    Parameters
    ----------
    sketch
    folder
        Where the files go unless another one is chosen.
    device
        Selector of the device; None: the program chooses.
    """

    def __init__(
        self, sketch: Sketch, folder: Path, *, device: str | None = None, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._sketch = sketch
        self._device = device
        self.job: ExportJob | None = None
        self._files: list[str] = []
        self._stage, self._began = "Starting", 0.0
        rows = column(self, "Export terrain")
        self.pages = QStackedWidget()
        self.wishes = ExportWishes(sketch)
        self.folder = QLineEdit(str(folder))
        self.pages.addWidget(self._ask_page())
        self.pages.addWidget(self._work_page())
        rows.addWidget(self.pages, 1)
        self._buttons = QDialogButtonBox()
        self._go = self._button("Export", QDialogButtonBox.ButtonRole.AcceptRole, self._begin)
        self._show_folder = self._button(
            "Open folder", QDialogButtonBox.ButtonRole.ActionRole, self._open_folder
        )
        self._close = self._button("Cancel", QDialogButtonBox.ButtonRole.RejectRole, self.reject)
        self._go.setDefault(True)
        self._show_folder.hide()
        rows.addWidget(self._buttons)
        self._clock = QTimer(self)
        self._clock.setInterval(500)
        self._clock.timeout.connect(self._show_time)
        self.wishes.changed.connect(self._check)
        self.folder.textChanged.connect(self._check)
        self.setMinimumWidth(480)
        self._check()

    @property
    def target(self) -> Path:
        """The folder that is chosen."""
        return Path(self.folder.text().strip()).expanduser()

    def reject(self) -> None:
        """Cancel what runs; else close."""
        if self.job is not None and self.job.is_running:
            self._close.setEnabled(False)
            self._doing.setText("Cancelling …")
            self.job.cancel()
            return
        super().reject()

    def closeEvent(self, event: QCloseEvent | None) -> None:
        """Cancel what runs."""
        if self.job is not None and self.job.is_running:
            self.job.cancel()
            self.job.wait()
        self._clock.stop()
        super().closeEvent(event)

    def _ask_page(self) -> QWidget:
        page = QWidget()
        rows = QVBoxLayout(page)
        rows.setContentsMargins(0, 0, 0, 0)
        rows.setSpacing(MARGIN)
        rows.addWidget(self.wishes)
        browse = QPushButton("Browse…")
        browse.setAutoDefault(False)
        browse.clicked.connect(self._browse)
        title = QLabel("&Folder")
        title.setBuddy(self.folder)
        self.folder.setAccessibleName("Folder for the files")
        row = QHBoxLayout()
        row.setSpacing(SPACING)
        for widget in (title, self.folder, browse):
            row.addWidget(widget)
        rows.addLayout(row)
        self._refused = note()
        rows.addWidget(self._refused)
        rows.addStretch(1)
        return page

    def _work_page(self) -> QWidget:
        page = QWidget()
        rows = QVBoxLayout(page)
        rows.setContentsMargins(0, 0, 0, 0)
        rows.setSpacing(MARGIN)
        self._head = heading("Exporting")
        self._doing = QLabel("Starting")
        self._bar = QProgressBar()
        self._bar.setRange(0, _UNITS)
        self._bar.setTextVisible(False)
        self._bar.setAccessibleName("How far the export is")
        self._told = note()
        for widget in (self._head, self._doing, self._bar, self._told):
            rows.addWidget(widget)
        rows.addStretch(1)
        return page

    def _button(self, title: str, role: QDialogButtonBox.ButtonRole, do: Any) -> QPushButton:
        button = self._buttons.addButton(title, role)
        if button is None:
            raise RuntimeError("expected a button")
        button.clicked.connect(do)
        return button

    def _check(self, *_: object) -> None:
        line = ""
        try:
            check_size(self._sketch, self.wishes.samples)
        except InputError as error:
            line = str(error)
        if not self.folder.text().strip():
            line = "Choose a folder."
        elif self.target.is_file():
            line = f"{self.target} is a file: expected a folder."
        elif (self.target / "report.json").is_file():
            self._refused.setText("Files of an earlier export there are replaced.")
            self._go.setEnabled(not line)
            return
        self._refused.setText(line)
        self._go.setEnabled(not line)

    def _browse(self) -> None:
        start = self.target if self.target.is_dir() else self.target.parent
        name = QFileDialog.getExistingDirectory(self, "Export into a folder", str(start))
        if name:
            self.folder.setText(name)

    def _begin(self) -> None:
        self.job = ExportJob(self.wishes.wish(self.target, self._device), self._sketch, self)
        self.job.stage_changed.connect(self._show_stage)
        self.job.share_changed.connect(self._show_share)
        self.job.finished.connect(self._show_done)
        self.job.failed.connect(self._show_failed)
        self._began = time.monotonic()
        self.pages.setCurrentIndex(1)
        self._go.hide()
        self._clock.start()
        self.job.start()

    def _show_stage(self, title: str) -> None:
        self._stage = title
        self._doing.setText(f"{title} …")
        self._show_share(0.0)

    def _show_share(self, share: float) -> None:
        before = 0
        for title, part in _STAGES.items():
            if title == self._stage:
                done = (before + part * share) / sum(_STAGES.values())
                self._bar.setValue(max(self._bar.value(), round(_UNITS * done)))
                return
            before += part

    def _show_time(self) -> None:
        self._told.setText(f"{time.monotonic() - self._began:.0f} s")

    def _show_done(self, told: dict[str, Any]) -> None:
        self._files = told["files"]
        self._finish("Exported")
        self._bar.setValue(_UNITS)
        heights = told["heights"]
        self._doing.setText(f"{len(self._files)} files in {told['seconds']:.0f} s, into\n{self.target}")
        lines = [f"Heights {heights['minimum']:.0f} m to {heights['maximum']:.0f} m."]
        if told["plants"]:
            lines.append(f"{told['plants']:,} plants.".replace(",", "\u202f"))
        if told["problem"]:
            lines.append(f"No preview: {told['problem']}")
        self._told.setText(" ".join(lines))
        self._show_folder.show()

    def _show_failed(self, line: str) -> None:
        self._finish("Not exported" if line else "Cancelled")
        self._doing.setText("No file was written.")
        self._told.setText(line)

    def _finish(self, title: str) -> None:
        self._clock.stop()
        self._head.setText(title)
        self._close.setText("Close")
        self._close.setEnabled(True)
        self._close.setDefault(True)
        self._close.setFocus()

    def _open_folder(self) -> None:
        QDesktopServices.openUrl(QUrl.fromLocalFile(str(self.target)))
