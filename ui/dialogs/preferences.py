"""The dialog for choices that are a person's, not a sketch's: theme and device."""

from __future__ import annotations

import json
import sys

from PyQt6.QtCore import QProcess
from PyQt6.QtWidgets import QComboBox, QDialog, QWidget

from sketchterrain.ui.dialogs.sheet import button_row, column, form, note
from sketchterrain.ui.look.theme import CHOICES
from sketchterrain.ui.models.preferences import Preferences

# Drivers are asked in a process of their own: one that crashes takes nothing along.
_ASK = (
    "import json\n"
    "from sketchterrain.compute import list_devices\n"
    "print(json.dumps([[each.name, each.platform] for each in list_devices()]))"
)


class PreferencesDialog(QDialog):
    """Shows and, when it is accepted, sets a person's choices."""

    def __init__(self, preferences: Preferences, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._preferences = preferences
        rows = column(self, "Preferences")
        self.themes, self.devices = QComboBox(), QComboBox()
        for key, title in CHOICES.items():
            self.themes.addItem(title, key)
        self.themes.setCurrentIndex(self.themes.findData(preferences.theme))
        self.themes.setAccessibleName("Theme")
        self.devices.addItem("The program chooses", "")
        self.devices.setAccessibleName("Device")
        self.devices.setToolTip("Which OpenCL device works out the terrain")
        if preferences.device:
            self.devices.addItem(preferences.device, preferences.device)
            self.devices.setCurrentIndex(1)
        fields = form()
        fields.addRow("&Theme", self.themes)
        fields.addRow("&Device", self.devices)
        rows.addLayout(fields)
        self._told = note("Looking for devices …")
        rows.addWidget(self._told)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "Apply")[0])
        self.setMinimumWidth(440)
        self._process = QProcess(self)
        self._process.finished.connect(self._show_devices)
        self._process.start(sys.executable, ["-P", "-c", _ASK])
        self.finished.connect(self._stop_asking)

    def accept(self) -> None:
        """Set what was chosen."""
        self._preferences.theme = str(self.themes.currentData())
        self._preferences.device = str(self.devices.currentData()) or None
        super().accept()

    def _show_devices(self, code: int) -> None:
        text = self._process.readAllStandardOutput().data().decode(errors="replace")
        lines = text.strip().splitlines()
        try:
            found = json.loads(lines[-1]) if code == 0 and lines else []
        except ValueError:
            found = []
        for name, platform in found:
            if self.devices.findData(name) < 0:
                self.devices.addItem(f"{name} ({platform})", name)
            else:
                self.devices.setItemText(self.devices.findData(name), f"{name} ({platform})")
        if found:
            self._told.setText("Every device computes the same terrain; another one starts the engine again.")
        else:
            self._told.setText("No OpenCL device was found: pip install 'sketchterrain[cpu]' brings drivers.")

    def _stop_asking(self, *_: object) -> None:
        if self._process.state() != QProcess.ProcessState.NotRunning:
            self._process.finished.disconnect(self._show_devices)
            self._process.kill()
            self._process.waitForFinished(1000)
