"""Export dialog: options, plans, files."""

import json
from dataclasses import fields
from pathlib import Path
from types import SimpleNamespace

import pytest
from PyQt6.QtWidgets import QAbstractButton, QLabel

from sketchterrain.export.planning import checked_plan, option_names
from sketchterrain.export.target import ExportOptions
from sketchterrain.export.targets import TARGET_NAMES, target_named
from sketchterrain.ui.dialogs import export as export_module
from sketchterrain.ui.dialogs.export import ExportDialog
from sketchterrain.ui.models.workspace import Preferences

from .events import repeated_mnemonics


@pytest.fixture
def opened(qtbot, tmp_path, small):
    """Return a function that opens the dialog with the stored preferences."""
    path = tmp_path / "desktop.ini"
    Preferences(path).export_folder = tmp_path / "out"
    dialogs = []  # qtbot holds no reference

    def open_(target: str | None = None) -> ExportDialog:
        preferences = Preferences(path)
        dialog = ExportDialog(small, preferences)
        dialog.preferences = preferences  # keeps them alive
        qtbot.addWidget(dialog)
        dialogs.append(dialog)
        dialog.show()
        if target is not None:
            choose(dialog, target)
        return dialog

    return open_


def choose(dialog, target: str) -> None:
    dialog.targets.setCurrentIndex(dialog.targets.findData(target))


def visible(controls) -> set[str]:
    return {option for option, row in controls._lines.items() if row.isVisible()}


def test_every_target_has_its_options_and_unique_mnemonics(opened, small):
    dialog = opened()
    assert [dialog.targets.itemData(row) for row in range(dialog.targets.count())] == ["", *TARGET_NAMES]
    assert dialog.everything.isVisible()
    for name in TARGET_NAMES:
        choose(dialog, name)
        target, controls = target_named(name), dialog.target
        tiles = {"overlap", "tile_name", "tile_first", "tiles_from_south"}
        assert visible(controls) == set(option_names(target)) - tiles, name
        assert not dialog.everything.isVisible()
        if "tiles" in visible(controls):
            controls["columns"].setValue(2)
            assert visible(controls) == set(option_names(target)), name
            controls["columns"].setValue(1)
        assert dialog.target.problem == "", name
        assert dialog.accept_button.isEnabled()
        default = checked_plan(small, name, ExportOptions())
        selected = checked_plan(small, name, controls.options())
        assert (selected.grid, selected.tiling) == (default.grid, default.tiling), name
        assert selected.options == default.options, name

    assert set(opened().target._lines) == {each.name for each in fields(ExportOptions)}

    for name in ("", *TARGET_NAMES):
        choose(dialog, name)
        dialog.target["columns"].setValue(2)
        assert not repeated_mnemonics(dialog.findChildren((QLabel, QAbstractButton))), name


def test_invalid_sizes_ranges_and_folders_are_refused(opened, tmp_path):
    dialog = opened("raw")
    controls = dialog.target
    controls["columns"].setValue(2)
    for size, problem in (("1024", "1023 or 1025"), ("", "expected a number of vertices"), ("1025", "")):
        controls["size"].setEditText(size)
        assert problem in dialog.hint.text()
        assert dialog.accept_button.isEnabled() == (problem == "")
    controls["tile_name"].setText("{name}")
    assert not dialog.accept_button.isEnabled()
    choose(dialog, "geotiff")
    assert dialog.accept_button.isEnabled()
    controls["crs"].setText("EPSG:4326")
    assert "EPSG:4326" in dialog.hint.text()
    assert not dialog.accept_button.isEnabled()

    choose(dialog, "png16")
    assert controls.options().heights is None
    assert not controls["low"].isEnabled()
    controls["ranged"].setChecked(True)
    controls["low"].setValue(3000.0)
    assert "expected the lowest and the highest" in dialog.hint.text()
    controls["low"].setValue(-100.0)
    assert controls.options().heights == (-100.0, 2000.0)
    (tmp_path / "file").write_text("")
    for folder, problem in ((str(tmp_path / "file"), "is a file: expected a folder"), ("", "")):
        dialog.path_field.setText(folder)
        assert not dialog.accept_button.isEnabled()
        assert problem in dialog.hint.text()


def test_offered_sizes_divide_into_the_tiles(opened):
    dialog = opened("raw")
    controls = dialog.target
    assert controls["size"].currentText() == "1025"
    for tiles, overlap in ((3, 1), (3, 0), (7, 5), (1, 5)):
        controls["columns"].setValue(tiles)
        controls["overlap"].setValue(overlap)
        for row in range(controls["size"].count()):
            controls["size"].setCurrentIndex(row)
            assert dialog.target.problem == "", (tiles, overlap, controls["size"].currentText())
    controls["size"].setEditText("1000")
    controls["columns"].setValue(3)
    assert controls["size"].currentText() == "1000", "a typed size is not replaced"


def test_options_are_remembered_and_invalid_ones_ignored(opened, tmp_path):
    default = opened("unity").target.options()
    dialog = opened("unity")
    controls = dialog.target
    controls["size"].setCurrentIndex(controls["size"].findData(129))
    controls["rows"].setValue(3)
    choose(dialog, "raw")
    assert controls["rows"].value() == 1
    choose(dialog, "unity")
    assert controls["rows"].value() == 3
    dialog._remember()
    dialog.preferences.save()
    again = opened()
    assert again.targets.currentData() == "unity"
    assert again.target.options() == controls.options() != default
    assert again.path_field.text() == str(tmp_path / "out")
    for bad in (
        {"columns": "many", "size": 17, "low": float("nan"), "plants": 3, "tile_name": None, "format": []},
        {"size": {}, "grass": "yes"},
    ):
        dialog.preferences.set_export_options("unity", bad)
        assert opened("unity").target.options() == default
    dialog.preferences._settings.setValue("export/unity", "no JSON")
    assert dialog.preferences.export_options("unity") == {}


@pytest.mark.slow
def test_an_export_to_a_target_writes_the_listed_files(qtbot, opened, tmp_path):
    dialog = opened("raw")
    controls = dialog.target
    controls["size"].setEditText("65")
    controls["rows"].setValue(2)
    controls["plants"].setChecked(False)
    dialog._export()
    with qtbot.waitSignal(dialog.job.finished) as done:
        pass
    sidecar = json.loads((tmp_path / "out" / "terrain.json").read_text())
    assert sidecar["target"] == "raw"
    written = {each.name for each in (tmp_path / "out").iterdir()}
    assert {entry["file"] for entry in sidecar["files"]} == written
    assert len(done.args[0]["files"]) == len(sidecar["files"])
    assert dialog.outcome.table.topLevelItem(0).text(0) == next(iter(sidecar["import"]))
    assert dialog.outcome.bar.value() == dialog.outcome.bar.maximum()
    assert dialog.preferences.export_target == "raw"
    qtbot.waitUntil(lambda: not dialog.job.is_running)


@pytest.mark.slow
def test_an_export_of_everything_writes_the_listed_files(qtbot, opened, tmp_path):
    dialog = opened()
    dialog.everything["size"].setCurrentIndex(0)
    dialog.everything["view"].setCurrentIndex(dialog.everything["view"].count() - 1)
    stages = []
    dialog._export()
    dialog.job.stage_changed.connect(stages.append)
    with qtbot.waitSignal(dialog.job.finished) as signal:
        pass
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names >= {"height.tif", "height.png", "normal.png", "materials.png", "features.json"}
    assert {Path(path).name for path in signal.args[0]["files"]} == names
    assert json.loads((tmp_path / "out" / "report.json").read_text())["sketch"] == "Small"
    assert "Heights and materials" in stages
    assert dialog.outcome.bar.value() == dialog.outcome.bar.maximum()
    qtbot.waitUntil(lambda: not dialog.job.is_running)


def test_the_remaining_time_of_an_export_is_shown(opened, monkeypatch):
    clock = SimpleNamespace(monotonic=lambda: 100.0)
    monkeypatch.setattr(export_module, "time", clock)
    outcome = opened().outcome
    outcome.begin(is_target=False)
    outcome.show_stage("Plants")
    outcome.show_share(0.68)  # half of all, by the stages' shares
    clock.monotonic = lambda: 110.0
    outcome._show_time()
    outcome.end()
    assert outcome.notes.text() == "10 s, about 10 s left"


@pytest.mark.slow
def test_a_cancelled_export_leaves_nothing(qtbot, opened, tmp_path):
    dialog = opened()
    dialog._export()
    with qtbot.waitSignal(dialog.job.share_changed):
        pass
    with qtbot.waitSignal(dialog.job.failed) as signal:
        dialog.reject()
    assert signal.args == [""]
    assert not dialog.isHidden()
    assert list((tmp_path / "out").iterdir()) == []
    dialog.reject()
    assert dialog.isHidden()


@pytest.mark.slow
def test_an_unwritable_folder_is_reported(qtbot, opened, tmp_path):
    (tmp_path / "file").write_text("")
    dialog = opened()
    dialog.path_field.setText(str(tmp_path / "file" / "out"))
    dialog._export()
    with qtbot.waitSignal(dialog.job.failed) as signal:
        pass
    assert "cannot be written" in signal.args[0]
    qtbot.waitUntil(lambda: not dialog.job.is_running)
