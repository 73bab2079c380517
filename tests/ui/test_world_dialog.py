"""Dialog that writes a world."""

from dataclasses import fields, replace

import pytest
from PyQt6.QtWidgets import QAbstractButton, QLabel

from sketchterrain.ui.dialogs.form import ExportJob
from sketchterrain.ui.dialogs.world import WorldDialog
from sketchterrain.ui.models.workspace import Preferences
from sketchterrain.world.options import WorldOptions
from sketchterrain.world.stored_world import open_world

from .events import repeated_mnemonics


@pytest.fixture
def opened(qtbot, tmp_path, small):
    """Return a function that opens the dialog with the stored preferences."""
    path = tmp_path / "desktop.ini"
    dialogs = []  # qtbot holds no reference

    def open_() -> WorldDialog:
        preferences = Preferences(path)
        viewed = []
        dialog = WorldDialog(small, preferences, view=viewed.append)
        dialog.viewed = viewed
        dialog.preferences = preferences  # keeps them alive
        dialog.path_field.setText(str(tmp_path / "world.zarr"))
        qtbot.addWidget(dialog)
        dialogs.append(dialog)
        dialog.show()
        return dialog

    return open_


def choose(box, data):
    assert box.findData(data) >= 0, data
    box.setCurrentIndex(box.findData(data))


def run_job(qtbot, dialog):
    """Press the button, wait for the end, and return the result."""
    dialog.accept_button.click()
    with qtbot.waitSignal(dialog.job.finished) as done:
        pass
    qtbot.waitUntil(lambda: not dialog.job.is_running)
    return done.args[0]


def test_every_option_is_available_and_defaults_match_the_command_line(opened):
    dialog = opened()
    assert dialog.form.options() == WorldOptions()
    assert dialog.accept_button.isEnabled()
    assert dialog.accept_button.text() == "Estimate"

    form = dialog.form
    choose(form["place"], "other")
    form["west"].setValue(-100.0)
    form["east"].setValue(900.5)
    form["cell"].setValue(2.5)
    form["normals"].setChecked(False)
    choose(form["plants"], "flatgeobuf")
    form["grass"].setChecked(True)
    form["crs"].setText("EPSG:25832")
    form["easting"].setValue(400_000.0)
    choose(form["steps"], 2.0**-7)
    form["workers"].setValue(2)
    assert form.problem == ""
    options = WorldOptions(
        bounds=(-100.0, 0.0, 900.5, 384.0),
        cell=2.5,
        layers=("height", "materials"),
        plants="flatgeobuf",
        grass=True,
        crs="EPSG:25832",
        origin=(400_000.0, 0.0),
        step=2.0**-7,
        workers=True,
    )
    assert form.options() == options
    untested = {each.name for each in fields(WorldOptions) if getattr(options, each.name) == each.default}
    assert untested == {"fast"}  # not offered: other bits than the view


def test_size_and_errors_are_displayed_immediately(opened):
    dialog = opened()
    assert dialog.form.note.text() == "513 × 385 vertices, 0.2596 million on all 3 levels."
    dialog.form["crs"].setText("EPSG:4326")
    assert "EPSG:4326" in dialog.hint.text()
    assert not dialog.accept_button.isEnabled()
    dialog.form["crs"].clear()
    choose(dialog.form["place"], "other")
    dialog.form["east"].setValue(-1.0)
    assert "west < east" in dialog.hint.text()
    assert not dialog.accept_button.isEnabled()
    choose(dialog.form["place"], "sketch")
    assert dialog.accept_button.isEnabled()
    dialog.path_field.setText("world.png")
    assert "ends in .zarr or .tif" in dialog.hint.text()
    assert not dialog.accept_button.isEnabled()


def test_suffix_follows_the_form_and_mnemonics_are_unique(opened, tmp_path):
    dialog = opened()
    for form, name in (("tif", "world.tif"), ("tiles", "world"), ("zarr", "world.zarr")):
        choose(dialog.form["form"], form)
        assert dialog.path_field.text() == str(tmp_path / name)
        assert dialog.accept_button.isEnabled()
    dialog.path_field.setText(str(tmp_path / "other.tif"))
    assert "expected another name, or another form" in dialog.hint.text()
    assert not dialog.accept_button.isEnabled()
    dialog.path_field.setText(str(tmp_path / "v1.5"))
    choose(dialog.form["form"], "tif")
    assert dialog.path_field.text() == str(tmp_path / "v1.5.tif")

    assert not repeated_mnemonics(dialog.findChildren((QLabel, QAbstractButton)))


def test_options_are_remembered(opened):
    dialog = opened()
    choose(dialog.form["form"], "tiles")
    dialog.form["cell"].setValue(8.0)
    dialog.form["materials"].setChecked(False)
    dialog.preferences.set_export_options("world", dialog.form.values)
    dialog.preferences.save()
    again = opened()
    assert again.form.options() == replace(WorldOptions(), cell=8.0, layers=("height", "normal"))
    assert again.form.values["form"] == "tiles"


@pytest.mark.slow
def test_a_world_is_estimated_started_cancelled_and_resumed(qtbot, opened, tmp_path):
    dialog = opened()
    result = run_job(qtbot, dialog)
    assert not (tmp_path / "world.zarr").exists()
    assert (result["done"], result["problem"]) == (0, "")
    assert dialog.accept_button.text() == "Start"
    assert "Memory: about" in dialog.hint.text()
    dialog.form["normals"].setChecked(False)  # other options have no estimate
    assert dialog.accept_button.text() == "Estimate"
    assert "Memory" not in dialog.hint.text()
    dialog.form["normals"].setChecked(True)
    dialog._is_estimated = True
    dialog.accept_button.click()
    qtbot.waitUntil((tmp_path / "world.zarr").exists)  # features are placed
    with qtbot.waitSignal(dialog.job.share_changed, check_params_cb=lambda share: share > 0):
        pass
    with qtbot.waitSignal(dialog.job.failed) as why:
        dialog.reject()
    assert why.args == [""]
    assert "resumes" in dialog.progress.doing.text()
    qtbot.waitUntil(lambda: not dialog.job.is_running)
    assert not list((tmp_path / "world.zarr").rglob("*.tmp"))
    again = opened()
    finished = run_job(qtbot, again)["done"]
    assert finished > 0
    assert again.accept_button.text() in ("Resume", "Verify")
    done = run_job(qtbot, again)
    assert (done["made"], done["tasks"]) == (3 - finished, 3)
    assert open_world(tmp_path / "world.zarr").levels[0].columns == 513
    assert "3 shards" in again.progress.doing.text()
    again.view_button.click()
    assert again.viewed == [tmp_path / "world.zarr"]


def test_a_failure_is_shown_and_the_dialog_can_be_used_again(opened, monkeypatch):
    monkeypatch.setattr(ExportJob, "start", lambda _: None)
    dialog = opened()
    dialog.accept_button.click()
    assert not dialog.accept_button.isVisible()
    dialog.job.failed.emit("it holds other files")
    assert dialog.hint.text() == "it holds other files"
    assert dialog.accept_button.isVisible()
    assert dialog.accept_button.text() == "Estimate"


@pytest.mark.slow
def test_foreign_files_at_the_output_are_refused_and_unchanged(qtbot, opened, tmp_path):
    (tmp_path / "world.zarr").mkdir()
    (tmp_path / "world.zarr" / "mine.txt").write_text("mine")
    dialog = opened()
    dialog.accept_button.click()
    with qtbot.waitSignal(dialog.job.failed) as result:
        pass
    assert "holds other files" in result.args[0]
    assert dialog.hint.text() == result.args[0]
    assert dialog.accept_button.text() == "Estimate"
    qtbot.waitUntil(lambda: not dialog.job.is_running)
    assert [each.name for each in (tmp_path / "world.zarr").iterdir()] == ["mine.txt"]
