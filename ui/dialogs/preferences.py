"""Preferences dialog: theme and device."""

import json
import sys

from PyQt6.QtCore import QProcess
from PyQt6.QtWidgets import QDialog, QWidget

from sketchterrain.ui.dialogs.form import Field, Form, button_row, dialog_column
from sketchterrain.ui.look.theme import CHOICES
from sketchterrain.ui.models.preferences import Preferences

# In a process of its own, for drivers can crash.
_LIST_DEVICES = (
    "import json\n"
    "from sketchterrain.compute.device import list_devices\n"
    "print(json.dumps([[each.name, each.platform] for each in list_devices()]))"
)


class PreferencesDialog(QDialog):
    """Shows the preferences and sets them when accepted."""

    def __init__(self, preferences: Preferences, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._preferences = preferences
        rows = dialog_column(self, "Preferences")
        devices = {"": "Automatic"}
        if preferences.device:
            devices[preferences.device] = preferences.device
        tip = "Which OpenCL device computes the terrain"
        self.form = Form(
            Field("theme", "&Theme", preferences.theme, choices=CHOICES),
            Field("device", "&Device", preferences.device or "", tip, choices=devices),
        )
        self.form.note.setText("Searching for devices …")
        rows.addWidget(self.form)
        rows.addStretch(1)
        rows.addWidget(button_row(self, "Apply")[0])
        self.setMinimumWidth(440)
        self._process = QProcess(self)
        self._process.finished.connect(self._show_devices)
        self._process.start(sys.executable, ["-P", "-c", _LIST_DEVICES])
        self.finished.connect(self._stop_search)

    def accept(self) -> None:
        self._preferences.theme = self.form.values["theme"]
        self._preferences.device = self.form.values["device"] or None
        super().accept()

    def _show_devices(self, code: int) -> None:
        text = self._process.readAllStandardOutput().data().decode(errors="replace")
        lines = text.strip().splitlines()
        try:
            found = json.loads(lines[-1]) if code == 0 and lines else []
        except ValueError:
            found = []
        devices = self.form["device"]
        for name, platform in found:
            if devices.findData(name) < 0:
                devices.addItem("", name)
            devices.setItemText(devices.findData(name), f"{name} ({platform})")
        self.form.note.setText(
            "Every device computes the same terrain; another one restarts the engine."
            if found
            else "No OpenCL device was found: pip install 'sketchterrain[cpu]' brings drivers."
        )

    def _stop_search(self, *_: object) -> None:
        if self._process.state() != QProcess.ProcessState.NotRunning:
            self._process.finished.disconnect(self._show_devices)
            self._process.kill()
            self._process.waitForFinished(1000)
