"""Raster sources in the window: the picture beneath the paint, adding and removing, problems, recovery."""

from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from PyQt6.QtCore import QRectF
from PyQt6.QtGui import QColor
from PyQt6.QtWidgets import QFileDialog

from sketchterrain.document.rasters import raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.ui.canvas.canvas import Canvas
from sketchterrain.ui.canvas.underlay import RasterUnderlay
from sketchterrain.ui.models.background import Autosave, SketchSaver
from sketchterrain.ui.panels.settings import WorldPanel
from tests.geo_files import write_raster

UTM = {"crs": "EPSG:25832", "east": 600000.0, "north": 5269000.0}
SIDE = 60  # px


@pytest.fixture
def picture(tmp_path) -> Path:
    """A red picture of 1 × 1 km, in the south-west of `UTM`."""
    bands = np.zeros((3, 50, 50), np.uint8)
    bands[0] = 200
    at = Affine(20.0, 0.0, 600000.0, 0.0, -20.0, 5270000.0)
    return write_raster(tmp_path / "map.tif", bands, at, photometric="RGB")


@pytest.fixture
def blank(document):
    """The document with an empty sketch of 2 × 2 km."""
    sketch = Sketch(frame=UTM, extent=2000.0, layers={"hill": np.zeros((SIDE, SIDE), np.uint8)})
    document.open(sketch)
    return document


def with_rasters(document, *rasters):
    document.do("Rasters", document.sketch.replace(rasters=rasters))


def settle(qtbot, underlay):
    qtbot.waitUntil(lambda: not underlay.is_busy)


def colours(canvas) -> list[QColor]:
    """Return the colours in the middle of the sketch's north-west, north-east, south-west and south-east."""
    image, view = canvas.grab().toImage(), canvas.viewport
    places = [view.to_screen(x, y) for y in (15.0, 45.0) for x in (15.0, 45.0)]
    return [image.pixelColor(int(x), int(y)) for x, y in places]


def test_a_picture_lies_beneath_the_paint_in_its_place(blank, workspace, link, show_widget, picture, qtbot):
    canvas = show_widget(Canvas(blank, workspace, link), 400, 400)
    workspace.show_overlay("elevation", False)
    paper = colours(canvas)[0]
    with_rasters(blank, raster_source(picture, "elevation"), raster_source(picture, "picture"))
    settle(qtbot, canvas.underlay)
    ((_, place),) = canvas.underlay.pictures
    assert place == QRectF(0.0, 0.5, 0.5, 0.5)
    red = QColor(200, 0, 0)
    assert colours(canvas) == [paper, paper, red, paper]

    hill = np.zeros((SIDE, SIDE), np.uint8)
    hill[30:50, :30] = 1
    blank.do("Paint", blank.sketch.replace(layers={**blank.sketch.layers, "hill": hill}))
    assert colours(canvas)[2] not in (red, paper)
    blank.undo()
    assert colours(canvas)[2] == red
    workspace.show_overlay("pictures", False)
    assert colours(canvas)[2] == paper
    workspace.show_overlay("pictures", True)
    blank.do("Move", blank.sketch.replace(frame=UTM | {"east": 599000.0}))
    settle(qtbot, canvas.underlay)
    assert colours(canvas) == [paper, paper, paper, red]
    for _ in range(2):
        blank.undo()
        settle(qtbot, canvas.underlay)
    assert colours(canvas) == 4 * [paper]


def test_missing_changed_and_unreadable_sources_are_named_once(blank, picture, tmp_path, qtbot, window):
    (tmp_path / "notes.txt").write_text("no picture")
    changed, missing = raster_source(picture, "elevation"), raster_source(tmp_path / "notes.txt", "elevation")
    unreadable = raster_source(tmp_path / "notes.txt", "picture")
    with picture.open("ab") as stream:
        stream.write(b"more")
    with_rasters(blank, changed, unreadable)
    settle(qtbot, window.canvas.underlay)
    lines = window.canvas.underlay.problems
    assert [line.partition(": ")[2].split(" (")[0] for line in lines] == [
        "its content has changed since it was added",
        "cannot be read as a raster",
    ]
    assert window.banner.message.line == lines[1]
    (tmp_path / "notes.txt").unlink()
    with_rasters(blank, missing)
    settle(qtbot, window.canvas.underlay)
    assert window.banner.message.line == f"raster {tmp_path / 'notes.txt'}: the file is missing"
    with_rasters(blank)
    assert window.banner.message is None


def test_adding_a_raster_is_one_step_and_gives_the_sketch_its_place(
    window, document, picture, monkeypatch, qtbot
):
    document.open(Sketch())
    kind = "Picture beneath the paint (*)"
    monkeypatch.setattr(QFileDialog, "getOpenFileName", lambda *_: (str(picture), kind))
    window.actions_by_name["add-raster"].trigger()
    qtbot.waitUntil(lambda: document.history.position == 1)
    assert document.history.titles[1] == "Add map.tif"
    assert document.sketch.rasters == (raster_source(picture, "picture"),)
    assert {**document.sketch.frame} == UTM | {"vertical": ""}
    kind = "Elevation (*)"
    moved = document.sketch.replace(frame=UTM | {"east": 5.0})
    document.do("Move", moved)
    window.actions_by_name["add-raster"].trigger()
    qtbot.waitUntil(lambda: len(document.sketch.rasters) == 2)
    assert document.sketch.frame == moved.frame
    assert document.sketch.rasters[1].role == "elevation"
    for _ in range(3):
        document.undo()
    assert (document.sketch.rasters, document.sketch.frame["crs"]) == ((), "")

    kind = "Picture beneath the paint (*)"
    picture.write_bytes(b"no picture")
    window.actions_by_name["add-raster"].trigger()
    qtbot.waitUntil(lambda: window.banner.message is not None)
    assert "cannot be read as a raster" in window.banner.message.line
    assert document.sketch.rasters == ()


def test_the_world_panel_stores_and_removes_rasters(blank, picture, show_widget):
    rows = show_widget(WorldPanel(blank)).rasters
    assert rows.buttons == []
    linked = raster_source(picture, "picture")
    with_rasters(blank, linked, raster_source(picture, "elevation"))
    assert len(rows.buttons) == 2
    rows.buttons[1][0].click()
    stored = raster_source(picture, "elevation", embed=True)
    assert blank.sketch.rasters == (linked, stored)
    assert [store.isEnabled() for store, _ in rows.buttons] == [True, False]
    rows.buttons[0][1].click()
    assert blank.sketch.rasters == (stored,)
    assert blank.history.titles[-2:] == ("Store map.tif", "Remove map.tif")
    blank.undo()
    blank.undo()
    assert len(blank.sketch.rasters) == len(rows.buttons) == 2


def test_recovery_files_and_saves_have_the_rasters(blank, picture, tmp_path, qtbot):
    autosave, saver = Autosave(blank, tmp_path / "recovery", interval_s=0.05), SketchSaver(blank)
    linked = raster_source(picture, "picture")
    stored = raster_source(picture, "picture", embed=True)
    with_rasters(blank, linked, stored)
    autosave.save_now()
    autosave.wait()
    picture.unlink()
    assert load_sketch(autosave.path).rasters == (linked, stored)
    for place in (tmp_path / "valley", tmp_path / "valley.sketch"):
        saver.save(place)
        assert saver.wait()
        assert load_sketch(place).rasters == (linked, stored)
    autosave.close()


def test_nothing_is_read_while_the_extent_is_dragged(blank, picture, monkeypatch, qtbot):
    read = []
    underlay = RasterUnderlay(blank, blank)
    original = underlay._reader.read
    monkeypatch.setattr(underlay._reader, "read", lambda *work: read.append(1) or original(*work))
    with_rasters(blank, raster_source(picture, "picture"))
    for extent in range(2000, 2100, 5):
        blank.do("Extent", blank.sketch.replace(extent=float(extent)), merge="drag")
    settle(qtbot, underlay)
    assert read == [1]
    assert underlay.pictures[0][1].width() == pytest.approx(1000.0 / 2095.0)
