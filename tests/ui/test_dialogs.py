"""Dialogs, themes, icons and contrast."""

from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from PyQt6.QtCore import QSize, Qt
from PyQt6.QtGui import QColor, QIcon, QImage, QPalette
from PyQt6.QtWidgets import QAbstractButton, QAbstractSpinBox, QComboBox, QLineEdit, QMainWindow

from sketchterrain.io.resources import preset_names
from sketchterrain.ui.actions import COMMANDS, Actions
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
from sketchterrain.ui.look.theme import DARK, ICONS, LIGHT, active_theme, apply_theme, icon, theme
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


@pytest.fixture
def light_after(qapp):
    yield
    apply_theme(qapp, "system")


def coverage(image: QImage) -> np.ndarray:
    """Alpha of a picture, 0 … 1."""
    plain = image.convertToFormat(QImage.Format.Format_RGBA8888)
    pixels = np.frombuffer(plain.constBits().asstring(plain.sizeInBytes()), np.uint8)
    return pixels.reshape(plain.height(), plain.bytesPerLine() // 4, 4)[:, : plain.width(), 3] / 255.0


def test_all_named_icons_exist_and_fit_their_square(qapp):
    named = {command.icon for command in COMMANDS.values()} - {""}
    assert named <= {file.stem for file in ICONS.glob("*.svg")}
    for file in ICONS.glob("*.svg"):
        cover = coverage(icon(file.stem).pixmap(QSize(80, 80), 1.0).toImage())
        rows, columns = np.nonzero(cover > 0.05)
        assert max(np.ptp(rows), np.ptp(columns)) >= 40, file
        assert min(rows.min(), columns.min()) >= 1, file
        assert max(rows.max(), columns.max()) <= 78, file
    with pytest.raises(FileNotFoundError):
        icon("nonsense")


def test_icons_render_at_device_pixels_in_the_palette_colour(qapp, light_after):
    for size, dpr in [(16, 1.0), (20, 1.25), (20, 2.0), (32, 1.5)]:
        picture = icon("brush").pixmap(QSize(size, size), dpr)
        assert (picture.width(), picture.height()) == (round(size * dpr), round(size * dpr)), (size, dpr)
        cover = coverage(picture.toImage())
        assert cover.max() > 0.95, (size, dpr)
        assert 0.05 < cover.mean() < 0.6, (size, dpr)

    add = icon("add")
    for choice in ("light", "dark"):
        apply_theme(qapp, choice)
        image = add.pixmap(QSize(20, 20)).toImage()
        assert image.pixelColor(10, 10).rgb() == theme().text.rgb()
        off = add.pixmap(QSize(20, 20), QIcon.Mode.Disabled).toImage().pixelColor(10, 10)
        assert off.rgb() == theme().disabled.rgb()


def luminance(colour: QColor) -> float:
    parts = np.array([colour.redF(), colour.greenF(), colour.blueF()])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def contrast(one: QColor, other: QColor) -> float:
    """Return the contrast ratio of WCAG 2: 1 … 21."""
    dark, light = sorted((luminance(one), luminance(other)))
    return (light + 0.05) / (dark + 0.05)


def test_text_contrast_meets_wcag():
    for each in [LIGHT, DARK]:
        for behind in (each.window, each.base, each.raised):
            floors = {"text": 7.0, "faint": 4.5, "warning": 4.5, "error": 4.5, "accent": 3.0}
            for name, floor in floors.items():
                assert contrast(getattr(each, name), behind) >= floor, (each, name)
        assert contrast(each.on_accent, each.accent) >= 4.5, each


def test_themes_set_the_palette_and_unknown_themes_raise(qapp, qtbot, light_after):
    for choice, expected in (("light", LIGHT), ("dark", DARK)):
        with qtbot.waitSignal(active_theme.changed):
            apply_theme(qapp, choice)
        assert theme() is expected
        assert qapp.palette().color(QPalette.ColorRole.Window) == expected.window

    with pytest.raises(ValueError, match="expected a theme, one of system, light, dark, got 'pink'"):
        apply_theme(qapp, "pink")
