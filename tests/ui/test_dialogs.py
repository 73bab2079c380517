"""Dialogs for new sketches, presets, recovery, help and preferences."""

from datetime import UTC, datetime
from pathlib import Path

import pytest
from PIL import Image
from PyQt6.QtCore import Qt
from PyQt6.QtWidgets import QAbstractButton, QAbstractSpinBox, QComboBox, QLineEdit, QMainWindow

from sketchterrain.io.resources import preset_names
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.dialogs.export import ExportDialog
from sketchterrain.ui.dialogs.help import (
    AboutDialog,
    FindDialog,
    FirstStepsDialog,
    KeysDialog,
    PreferencesDialog,
)
from sketchterrain.ui.dialogs.start import NewSketchDialog, PictureDialog, PresetsDialog, RecoveryDialog
from sketchterrain.ui.dialogs.trace import TraceDialog
from sketchterrain.ui.dialogs.world import WorldDialog
from sketchterrain.ui.engine.protocol import EngineFacts
from sketchterrain.ui.models.background import Recovery
from sketchterrain.ui.models.workspace import Preferences


@pytest.fixture
def dialogs(qtbot, tmp_path, small):
    preferences = Preferences(tmp_path / "desktop.ini")
    Image.new("RGB", (20, 20)).save(tmp_path / "island.png")
    window = QMainWindow()
    recovery = Recovery(tmp_path / "a.sketch", "Mine", datetime.now(UTC), None, {})
    dialogs = {
        "new": NewSketchDialog(),
        "presets": PresetsDialog(),
        "export": ExportDialog(small, preferences),
        "world": WorldDialog(small, preferences),
        "trace": TraceDialog(tmp_path / "island.png"),
        "picture": PictureDialog((640, 480), tmp_path, "mine"),
        "keys": KeysDialog(),
        "first": FirstStepsDialog(),
        "about": AboutDialog(EngineFacts(device="A device", platform="A platform", renderer="GL")),
        "recovery": RecoveryDialog([recovery]),
        "find": FindDialog(Actions(window)),
    }
    for each in (window, *dialogs.values()):
        qtbot.addWidget(each)
    yield dialogs
    assert window is not None  # owner of the actions


def test_every_dialog_has_a_title_named_controls_and_closes_on_escape(dialogs, qtbot):
    for name, dialog in dialogs.items():
        assert dialog.windowTitle(), name
        for control in dialog.findChildren((QComboBox, QAbstractSpinBox, QLineEdit, QAbstractButton)):
            inner = control.objectName().startswith("qt_")
            words = control.accessibleName() or (isinstance(control, QAbstractButton) and control.text())
            assert words or inner, f"{name}: {type(control).__name__}"

    for dialog in dialogs.values():
        dialog.show()
        qtbot.keyClick(dialog, Qt.Key.Key_Escape)
        assert dialog.isHidden()


def test_new_sketch_has_the_requested_size_and_extent(dialogs):
    dialog = dialogs["new"]
    dialog.form["name"].setText("Far north")
    dialog.form["sheet"].setCurrentText("768 × 512")
    dialog.form["extent"].setValue(9000.0)
    sketch = dialog.sketch()
    assert (sketch.name, sketch.extent) == ("Far north", 9000.0)
    assert (sketch.width_px, sketch.height_px) == (768, 512)
    assert not any(image.any() for image in sketch.layers.values())
    dialog.form["sheet"].setCurrentText("Other")
    dialog.form["width"].setValue(100)
    dialog.form["height"].setValue(300)
    assert dialog.sketch().layers["hill"].shape == (300, 100)
    dialog.form["sheet"].setCurrentText("512 × 512")
    dialog.form["starter"].setChecked(True)
    assert dialog.sketch().layers["river"].any()
    assert dialog.sketch().name == "Far north"


def test_gallery_shows_all_presets(dialogs):
    gallery = dialogs["presets"].list
    assert gallery.count() == len(preset_names())
    for row, name in enumerate(preset_names()):
        gallery.setCurrentRow(row)
        assert dialogs["presets"].name == gallery.item(row).data(Qt.ItemDataRole.UserRole) == name
        assert gallery.item(row).icon().pixmap(320, 180).toImage().pixelColor(160, 90).alpha() == 255


def test_find_matches_words_and_recovery_discards(dialogs, qtbot):
    dialog = dialogs["find"]
    qtbot.keyClicks(dialog.text, "export")
    assert dialog.selected.objectName() == "export"
    dialog.text.setText("zoom")
    first = dialog.selected.objectName()
    qtbot.keyClick(dialog.text, Qt.Key.Key_Down)
    assert {first, dialog.selected.objectName()} == {"zoom-in", "zoom-out"}
    dialog.text.setText("no such thing")
    assert dialog.selected is None

    dialog = dialogs["recovery"]
    assert dialog.selected.name == "Mine"
    assert not dialog.discarded
    dialog._discard()
    assert dialog.discarded


def test_preferences_are_set_only_when_they_are_applied(qtbot, tmp_path):
    preferences = Preferences(tmp_path / "desktop.ini")
    dialog = PreferencesDialog(preferences)
    qtbot.addWidget(dialog)
    dialog.form["theme"].setCurrentIndex(dialog.form["theme"].findData("dark"))
    dialog.reject()
    assert preferences.theme == "system"
    dialog = PreferencesDialog(preferences)
    qtbot.addWidget(dialog)
    qtbot.waitUntil(lambda: dialog.form["device"].count() > 1)
    dialog.form["theme"].setCurrentIndex(dialog.form["theme"].findData("dark"))
    dialog.form["device"].setCurrentIndex(1)
    with qtbot.waitSignals([preferences.theme_changed, preferences.device_changed]):
        dialog.accept()
    again = Preferences(tmp_path / "desktop.ini")
    assert (again.theme, again.device) == ("dark", dialog.form["device"].itemData(1))


def test_invalid_preferences_fall_back_to_defaults(tmp_path, qapp):
    (tmp_path / "desktop.ini").write_text("theme=pink\nlast_folder=/nowhere/at/all\n[window]\nstate=5\n")
    preferences = Preferences(tmp_path / "desktop.ini")
    assert preferences.theme == "system"
    assert preferences.last_folder == Path.home()
    assert preferences.layout is None
    with pytest.raises(ValueError, match="expected a theme"):
        preferences.theme = "pink"
