"""The export dialog: which files, where, what it takes; then how far it is, and what came of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PyQt6.QtCore import QTimer, QUrl
from PyQt6.QtGui import QCloseEvent, QDesktopServices
from PyQt6.QtWidgets import (
    QComboBox,
    QDialog,
    QDialogButtonBox,
    QFileDialog,
    QLineEdit,
    QStackedWidget,
    QWidget,
)

from sketchterrain.export.targets import TARGET_NAMES, target_named
from sketchterrain.sketch import Sketch
from sketchterrain.ui.dialogs.export_options import EverythingForm, TargetForm
from sketchterrain.ui.dialogs.export_outcome import STAGES, TARGET_STAGES, ExportOutcome
from sketchterrain.ui.dialogs.form import (
    add_button,
    column,
    note,
    only_close,
    part,
    show_note,
    titled,
)
from sketchterrain.ui.export_job import ExportJob
from sketchterrain.ui.models.preferences import Preferences

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
        self.everything = EverythingForm(sketch, preferences.exported(""))
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
            kept = self._set.get(self._shown) or self._preferences.exported(self._shown)
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
