"""Each dialog: what it asks, what it says, what comes of it."""

from __future__ import annotations

import json
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PyQt6.QtCore import Qt
from PyQt6.QtWidgets import QAbstractButton, QAbstractSpinBox, QComboBox, QLabel, QLineEdit, QMainWindow

from sketchterrain.resources import preset_names
from sketchterrain.sketch import Sketch
from sketchterrain.ui.action_list import COMMANDS
from sketchterrain.ui.actions import Actions
from sketchterrain.ui.dialogs.about import AboutDialog
from sketchterrain.ui.dialogs.export import ExportDialog
from sketchterrain.ui.dialogs.find import FindDialog
from sketchterrain.ui.dialogs.first_steps import FirstStepsDialog
from sketchterrain.ui.dialogs.keys import KeysDialog
from sketchterrain.ui.dialogs.new_sketch import NewSketchDialog
from sketchterrain.ui.dialogs.picture import PictureDialog
from sketchterrain.ui.dialogs.preferences import PreferencesDialog
from sketchterrain.ui.dialogs.presets import PresetsDialog
from sketchterrain.ui.dialogs.recovery import RecoveryDialog
from sketchterrain.ui.engine.messages import EngineFacts
from sketchterrain.ui.models.preferences import Preferences
from sketchterrain.ui.models.recovery import Recovery


@pytest.fixture
def small() -> Sketch:
    mountain = np.zeros((48, 64), np.uint8)
    mountain[10:30, 10:40] = 1
    return Sketch(name="Small", extent=512.0, layers={"mountain": mountain})


def preferring(folder: Path) -> Preferences:
    """Return the preferences of someone who exported into a folder."""
    preferences = Preferences(folder.parent / "desktop.ini")
    preferences.export_folder = folder
    return preferences


@pytest.fixture
def made(qtbot, tmp_path, small):
    """One of each."""
    window = QMainWindow()
    kept = Recovery(tmp_path / "a.sketch", "Mine", datetime.now(UTC), None)
    dialogs = {
        "new": NewSketchDialog(),
        "presets": PresetsDialog(),
        "export": ExportDialog(small, preferring(tmp_path / "out")),
        "picture": PictureDialog((640, 480), tmp_path, "mine"),
        "keys": KeysDialog(),
        "first": FirstStepsDialog(),
        "about": AboutDialog(EngineFacts(device="A device", platform="A platform", renderer="GL")),
        "recovery": RecoveryDialog([kept]),
        "find": FindDialog(Actions(window)),
    }
    for each in (window, *dialogs.values()):
        qtbot.addWidget(each)
    yield dialogs
    assert window is not None  # it holds the actions that are found


def test_every_dialog_has_a_title_and_every_control_a_name(made) -> None:
    for name, dialog in made.items():
        assert dialog.windowTitle(), name
        for control in dialog.findChildren((QComboBox, QAbstractSpinBox, QLineEdit, QAbstractButton)):
            inner = control.objectName().startswith("qt_")
            words = control.accessibleName() or (isinstance(control, QAbstractButton) and control.text())
            assert words or inner, f"{name}: {type(control).__name__}"


def test_every_dialog_goes_away_by_escape(made, qtbot) -> None:
    for dialog in made.values():
        dialog.show()
        qtbot.keyClick(dialog, Qt.Key.Key_Escape)
        assert dialog.isHidden()


def test_a_new_sketch_is_as_it_was_asked_for(made) -> None:
    dialog = made["new"]
    dialog.name.setText("Far north")
    dialog.sheet.setCurrentText("768 × 512")
    dialog.extent.setValue(9000.0)
    sketch = dialog.sketch()
    assert (sketch.name, sketch.extent) == ("Far north", 9000.0)
    assert (sketch.width_px, sketch.height_px) == (768, 512)
    assert not any(image.any() for image in sketch.layers.values())
    dialog.sheet.setCurrentText("Other")
    dialog.columns.setValue(100)
    dialog.rows.setValue(300)
    assert dialog.sketch().layers["hill"].shape == (300, 100)
    dialog.sheet.setCurrentText("512 × 512")
    dialog.starter.setChecked(True)
    assert dialog.sketch().layers["river"].any()
    assert dialog.sketch().name == "Far north"


def test_the_gallery_shows_every_preset_with_its_picture(made) -> None:
    gallery = made["presets"].list
    assert [gallery.item(row).data(Qt.ItemDataRole.UserRole) for row in range(gallery.count())] == list(
        preset_names()
    )
    for row in range(gallery.count()):
        gallery.setCurrentRow(row)
        assert made["presets"].name == preset_names()[row]
        assert gallery.item(row).icon().pixmap(320, 180).toImage().pixelColor(160, 90).alpha() == 255
        assert gallery.item(row).toolTip()


def test_all_keys_are_told(made) -> None:
    from PyQt6.QtWidgets import QTextBrowser

    text = made["keys"].findChild(QTextBrowser).toPlainText()
    for command in COMMANDS.values():
        for key in command.keys:
            assert key.replace("Ctrl+/", "/") in text


def test_about_tells_licences_and_device(made) -> None:
    said = " ".join(label.text() for label in made["about"].findChildren(QLabel))
    for word in ("A device", "GNU General Public License", "PyQt (GPL 3)", "Zaaijer", "Bruneton"):
        assert word in said


def test_finding_a_command_by_words(made, qtbot) -> None:
    dialog = made["find"]
    qtbot.keyClicks(dialog.text, "export")
    assert dialog.chosen.objectName() == "export"
    dialog.text.setText("zoom")
    first = dialog.chosen.objectName()
    qtbot.keyClick(dialog.text, Qt.Key.Key_Down)
    assert {first, dialog.chosen.objectName()} == {"zoom-in", "zoom-out"}
    dialog.text.setText("no such thing")
    assert dialog.chosen is None


def test_recovering_or_deleting(made, qtbot) -> None:
    dialog = made["recovery"]
    assert dialog.chosen.name == "Mine"
    assert not dialog.discarded
    dialog._discard()
    assert dialog.discarded


def test_preferences_are_set_only_when_they_are_applied(qtbot, tmp_path) -> None:
    preferences = Preferences(tmp_path / "desktop.ini")
    dialog = PreferencesDialog(preferences)
    qtbot.addWidget(dialog)
    dialog.themes.setCurrentIndex(dialog.themes.findData("dark"))
    dialog.reject()
    assert preferences.theme == "system"
    dialog = PreferencesDialog(preferences)
    qtbot.addWidget(dialog)
    qtbot.waitUntil(lambda: dialog.devices.count() > 1, timeout=30_000)
    dialog.themes.setCurrentIndex(dialog.themes.findData("dark"))
    dialog.devices.setCurrentIndex(1)
    with qtbot.waitSignals([preferences.theme_changed, preferences.device_changed]):
        dialog.accept()
    again = Preferences(tmp_path / "desktop.ini")
    assert (again.theme, again.device) == ("dark", dialog.devices.itemData(1))


def test_preferences_that_make_no_sense_count_as_never_chosen(tmp_path, qapp) -> None:
    (tmp_path / "desktop.ini").write_text("theme=pink\nlast_folder=/nowhere/at/all\n[window]\nstate=5\n")
    preferences = Preferences(tmp_path / "desktop.ini")
    assert preferences.theme == "system"
    assert preferences.last_folder == Path.home()
    assert preferences.layout is None
    with pytest.raises(ValueError, match="expected a theme"):
        preferences.theme = "pink"


def test_export_refuses_what_cannot_be_before_it_begins(made, tmp_path) -> None:
    dialog = made["export"]
    (tmp_path / "file").write_text("")
    assert dialog._go.isEnabled()
    dialog.folder.setText(str(tmp_path / "file"))
    assert not dialog._go.isEnabled()
    assert "is a file: expected a folder" in dialog._refused.text()
    dialog.folder.setText("")
    assert not dialog._go.isEnabled()


def test_export_asks_for_what_the_command_line_can(made) -> None:
    wishes = made["export"].wishes
    kinds = [wishes.foliage.itemData(row) for row in range(wishes.foliage.count())]
    assert kinds == ["csv", "ply", "both", "none"]
    assert not wishes.grass.isEnabled()
    wishes.foliage.setCurrentIndex(1)
    wishes.grass.setChecked(True)
    wishes.maps.setCurrentIndex(2)
    wishes.views.setCurrentIndex(wishes.views.count() - 1)
    wish = wishes.wish(Path("x"), None)
    assert (wish.foliage, wish.grass, wish.map, wish.preview, wish.size) == ("ply", True, "svg", False, 1025)


@pytest.mark.slow
def test_an_export_writes_what_the_command_line_writes(qtbot, small, tmp_path) -> None:
    dialog = ExportDialog(small, preferring(tmp_path / "out"))
    qtbot.addWidget(dialog)
    dialog.show()
    dialog.wishes.sizes.setCurrentIndex(0)
    dialog.wishes.views.setCurrentIndex(dialog.wishes.views.count() - 1)
    seen = []
    dialog._begin()
    dialog.job.stage_changed.connect(seen.append)
    with qtbot.waitSignal(dialog.job.finished, timeout=120_000) as told:
        pass
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names >= {"height.tif", "height.png", "normal.png", "materials.png", "features.json"}
    assert {Path(path).name for path in told.args[0]["files"]} == names
    assert json.loads((tmp_path / "out" / "report.json").read_text())["sketch"] == "Small"
    assert "Heights and materials" in seen
    assert dialog.outcome.bar.value() == dialog.outcome.bar.maximum()
    qtbot.waitUntil(lambda: not dialog.job.is_running)


@pytest.mark.slow
def test_a_cancelled_export_leaves_nothing(qtbot, small, tmp_path) -> None:
    dialog = ExportDialog(small, preferring(tmp_path / "out"))
    qtbot.addWidget(dialog)
    dialog.show()
    dialog._begin()
    with qtbot.waitSignal(dialog.job.share_changed, timeout=60_000):
        pass
    with qtbot.waitSignal(dialog.job.failed, timeout=30_000) as told:
        dialog.reject()
    assert told.args == [""]
    assert not dialog.isHidden()
    assert list((tmp_path / "out").iterdir()) == []
    dialog.reject()
    assert dialog.isHidden()


@pytest.mark.slow
def test_an_export_that_cannot_be_written_says_why(qtbot, small, tmp_path) -> None:
    (tmp_path / "file").write_text("")
    dialog = ExportDialog(small, preferring(tmp_path / "file" / "out"))
    qtbot.addWidget(dialog)
    dialog._begin()
    with qtbot.waitSignal(dialog.job.failed, timeout=60_000) as told:
        pass
    assert "cannot be written" in told.args[0]
    qtbot.waitUntil(lambda: not dialog.job.is_running)
