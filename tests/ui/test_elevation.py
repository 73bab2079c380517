"""Real elevation in the window: new sketches, the Base panel, the hillshade beneath the paint."""

from functools import wraps
from pathlib import Path

import numpy as np
import pytest
import rasterio
from affine import Affine
from PyQt6.QtWidgets import QFileDialog, QMessageBox

from sketchterrain.document.rasters import raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.elevation.base import load_base
from sketchterrain.importing.elevation import sketch_on_elevation
from sketchterrain.stages.runner import Runner
from sketchterrain.ui.canvas.canvas import Canvas
from sketchterrain.ui.models.elevation import SketchElevation, hillshade
from sketchterrain.ui.panels.base import BasePanel
from tests.geo_files import write_raster

CELL = 20.0  # m
SIDE = 96  # samples of a grid
WEST, NORTH = 600_000.0, 5_270_000.0
NODATA = -9999.0


def write_dem(path: Path, *, west: float = WEST, height: float = 0.0, void: bool = False) -> Path:
    """Write a ridge from the south-west to the north-east on a plane that rises eastward."""
    row, column = np.indices((SIDE, SIDE), np.float32)
    heights = height + 2.0 * column + 300.0 * np.exp(-(((row + column - SIDE) / 10.0) ** 2))
    if void:
        heights[40:43, 60:62] = NODATA
    place = Affine(CELL, 0.0, west, 0.0, -CELL, NORTH)
    return write_raster(path, heights.astype(np.float32), place, nodata=NODATA)


@pytest.fixture(scope="module")
def dem(tmp_path_factory) -> Path:
    return write_dem(tmp_path_factory.mktemp("dem") / "ridge.tif", void=True)


@pytest.fixture
def on_dem(document, dem):
    """The document with an empty sketch on elevation."""
    document.open(sketch_on_elevation([raster_source(dem, "elevation")])[0])
    return document


@pytest.fixture
def chosen(monkeypatch) -> list[Path]:
    """Files that dialogs return."""
    paths: list[Path] = []
    monkeypatch.setattr(QFileDialog, "getOpenFileNames", lambda *_: ([str(each) for each in paths], ""))
    return paths


def settle(qtbot, elevation):
    qtbot.waitUntil(lambda: not elevation.is_busy)


@pytest.fixture
def panel(on_dem, show_widget, qtbot):
    elevation = SketchElevation(on_dem)
    shown = show_widget(BasePanel(on_dem, elevation))
    shown.elevation = elevation
    settle(qtbot, elevation)
    return shown


def test_new_from_elevation_is_what_the_command_makes(window, document, dem, chosen, qtbot, tmp_path):
    chosen.append(dem)
    window.actions_by_name["elevation"].trigger()
    qtbot.waitUntil(lambda: document.sketch.name == "ridge")
    expected = sketch_on_elevation([raster_source(dem, "elevation")])[0]
    places = [tmp_path / name for name in ("made", "expected")]
    for sketch, place in zip((document.sketch, expected), places, strict=True):
        save_sketch(sketch, place)
    assert (places[0] / "sketch.toml").read_text() == (places[1] / "sketch.toml").read_text()
    assert document.is_modified
    line = window.banner.message.line
    assert line == "A sketch of 1.8 × 1.8 km on elevation data; findings in the data: 2"
    window.banner.message.buttons[0][1]()
    settle(qtbot, window.canvas.underlay)
    qtbot.waitUntil(lambda: not window.panel_layout.docks["base"].visibleRegion().isEmpty())


def test_bad_files_are_one_line_and_lose_nothing(window, document, chosen, dem, qtbot, tmp_path, monkeypatch):
    sketch, bad = document.sketch, tmp_path / "bad.tif"
    bad.write_bytes(b"no elevation")
    chosen += [dem, bad]
    for command in (window.elevation_files.ask_new, window.elevation_files.ask_add):
        command()
        qtbot.waitUntil(lambda: getattr(window.banner.message, "kind", "") == "error")
        assert "bad.tif" in window.banner.message.line
        assert "\n" not in window.banner.message.line
        assert document.sketch is sketch
        window.banner.dismiss()
    document.do("Name", sketch.replace(name="unsaved"))
    chosen.pop()
    asked = []
    answer = QMessageBox.StandardButton.Cancel
    monkeypatch.setattr(QMessageBox, "exec", lambda box: asked.append(box.text()) or answer)
    window.elevation_files.ask_new()
    qtbot.waitUntil(lambda: bool(asked))
    assert document.sketch.name == "unsaved"


def test_adding_elevation_is_one_step_and_gives_the_sketch_its_place(
    window, document, dem, chosen, qtbot, tmp_path
):
    document.open(Sketch(extent=800.0))
    chosen += [dem, write_dem(tmp_path / "east.tif", west=WEST + CELL * (SIDE - 20))]
    window._base.add_button.click()
    qtbot.waitUntil(lambda: document.history.position == 1)
    assert document.history.titles[1] == "Add 2 elevation grids"
    frame = document.sketch.frame
    assert frame["crs"] == "EPSG:25832"
    base = load_base(document.sketch, Runner())
    assert base.weight(*np.array([[0.0, 800.0], [0.0, 800.0]])) == pytest.approx(1.0)
    settle(qtbot, window.canvas.underlay)
    assert [page.text.text().splitlines()[0] for page in window._base.pages] == [
        "96 × 96 samples, 20 m apart"
    ] * 2
    document.undo()
    assert document.sketch.rasters == ()
    assert document.sketch.frame["crs"] == ""
    assert window._base.pages == []


def test_the_panel_shows_and_edits_each_grid(panel, on_dem, dem, tmp_path, qtbot):
    (page,) = panel.pages
    size, *findings = page.text.text().splitlines()
    assert size == "96 × 96 samples, 20 m apart"
    assert any("small void" in line for line in findings)
    field = page.form.rows["vertical"].field
    qtbot.waitUntil(lambda: field.height() >= field.sizeHint().height())  # not squeezed by the text above
    first = on_dem.sketch
    page.form.rows["offset"].box.setValue(12.5)
    page.form.rows["accuracy"].check.setChecked(False)
    page.form.edited.emit("vertical", "EPSG:5773", object())
    (source,) = on_dem.sketch.rasters
    assert (source.offset, source.accuracy, source.vertical) == (12.5, 1.0, "EPSG:5773")
    titles = [f"Set {name} of ridge.tif" for name in ("offset", "accuracy", "vertical datum")]
    assert list(on_dem.history.titles[1:]) == titles
    refused = []
    on_dem.message.connect(refused.append)
    page.form.edited.emit("vertical", "sea", object())
    assert len(refused) == 1
    assert on_dem.sketch.rasters == (source,)
    panel.form.rows["margin"].check.setChecked(False)
    assert on_dem.sketch.base["margin"] == 1000.0
    page.form.rows["offset"].reset.click()
    assert on_dem.sketch.rasters[0].offset == 0.0
    assert panel.pages == [page], "pages are kept while their values change"
    page.remove.click()
    assert (on_dem.sketch.rasters, panel.pages) == ((), [])
    assert panel.text.text().startswith("The ground is generated.")
    assert not panel.form.isVisible()
    on_dem.go_to(0)
    assert on_dem.sketch.rasters == first.rasters
    settle(qtbot, panel.elevation)
    assert panel.pages[0].text.text().splitlines()[0] == size


def test_the_panel_says_why_data_cannot_be_read(panel, on_dem, tmp_path, qtbot):
    gone = write_dem(tmp_path / "gone.tif")
    source = raster_source(gone, "elevation")
    gone.unlink()
    on_dem.do("Add", on_dem.sketch.replace(rasters=(*on_dem.sketch.rasters, source)))
    settle(qtbot, panel.elevation)
    assert panel.text.text() == f"raster {gone}: the file is missing"
    assert [page.text.text() for page in panel.pages] == ["Not read"] * 2
    on_dem.undo()
    settle(qtbot, panel.elevation)
    assert panel.text.text() == ""


def test_offsets_are_removed_and_lakes_added_in_a_step_each(window, document, tmp_path, qtbot):
    paths = [write_dem(tmp_path / f"{height:g}.tif", height=height) for height in (0.0, 25.0)]
    with rasterio.open(paths[0], "r+") as file:
        heights = file.read(1)
        heights[60:75, 60:75] = heights[60:75, 60:75].min() - 5.0
        file.write(heights, 1)
    sources = [raster_source(path, "elevation") for path in paths]
    document.open(sketch_on_elevation(sources)[0])
    window._base.offsets.click()
    qtbot.waitUntil(lambda: document.history.position == 1)
    low, high = (each.offset for each in document.sketch.rasters)
    assert low - high == pytest.approx(25.0, abs=0.1)
    window._base.lakes.click()
    qtbot.waitUntil(lambda: document.history.position == 2)
    assert len(document.sketch.vectors["lake"].ids) == 1
    window._base.lakes.click()
    qtbot.waitUntil(lambda: window.banner.message is not None)
    assert window.banner.message.line == "Add lakes: there are none"
    assert list(document.history.titles[1:]) == ["Remove offsets", "Add lakes"]
    document.undo()
    assert not len(document.sketch.vectors["lake"].ids)


def test_the_hillshade_is_lit_from_the_north_west_and_ends_with_the_data(dem):
    sketch = sketch_on_elevation([raster_source(dem, "elevation")])[0]
    wider = sketch.replace(
        frame={**sketch.frame, "east": WEST - 1000.0, "north": NORTH - 3000.0}, extent=4000.0
    )
    pixels, (west, south, east, north) = hillshade(load_base(wider, Runner()), wider)
    assert (west, south, east, north) == pytest.approx((1000.0, 3000.0 - CELL * SIDE, 2920.0, 3000.0))
    assert pixels.shape == (SIDE * 2, SIDE * 2, 4)
    inner = pixels[8:-8, 8:-8].astype(int)
    assert (inner[..., 3] == 255).all()
    grey = inner[..., 0]
    half = len(grey) // 2
    across = [grey[half + shift, half + shift] for shift in (-14, 14)]
    assert across[0] > across[1] + 50, "the ridge's north-western side is bright, the other one dark"
    assert hillshade(load_base(wider, Runner()), wider.replace(extent=900.0)) is None


def test_the_hillshade_lies_beneath_the_paint_and_can_be_hidden(
    on_dem, workspace, link, show_widget, qtbot, monkeypatch
):
    canvas = show_widget(Canvas(on_dem, workspace, link), 400, 400)
    qtbot.waitUntil(canvas.hasFocus)  # its frame is in all pictures
    paper = canvas.grab().toImage()
    workspace.show_overlay("elevation", True)
    settle(qtbot, canvas.underlay)
    shaded = canvas.grab().toImage()
    assert shaded != paper
    workspace.show_overlay("elevation", False)
    assert canvas.grab().toImage() == paper
    workspace.show_overlay("elevation", True)
    assert canvas.grab().toImage() == shaded

    made = []
    counted = wraps(hillshade)(lambda *_: made.append(1))
    monkeypatch.setattr("sketchterrain.ui.models.elevation.hillshade", counted)
    source = on_dem.sketch.rasters[0]
    on_dem.do("Remove", on_dem.sketch.replace(rasters=()))
    assert canvas.underlay.hillshade == ()
    on_dem.do("Add", on_dem.sketch.replace(rasters=(source,)))
    settle(qtbot, canvas.underlay)
    assert canvas.underlay.hillshade
    assert made == [], "cached by the id of the base"


def test_a_saved_sketch_reopens_with_its_elevation(on_dem, tmp_path, dem):
    save_sketch(on_dem.sketch, tmp_path / "ridge.sketch")
    assert load_sketch(tmp_path / "ridge.sketch").rasters == (raster_source(dem, "elevation"),)
