"""Draped layers in the window: list, style, classes, pictures, choice and edits of features, files."""

import json
from dataclasses import replace

import numpy as np
import pytest
import rasterio
from affine import Affine
from PyQt6.QtCore import Qt
from PyQt6.QtGui import QColor
from PyQt6.QtWidgets import QFileDialog

from sketchterrain.document.drapes import MAX_CLASSES, draped_layer
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features.table import KINDS
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.models import drapes as model
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import (
    FEATURE_COMMANDS,
    SelectedFeature,
    delete_feature,
    paste,
    selected_text,
)
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.panels.drapes import DrapeList, DrapePage
from sketchterrain.ui.panels.properties import FeaturePage
from sketchterrain.ui.view3d.view import View3D

from . import events
from .test_view3d import answer, marks, show_picture

FRAME = {"crs": "EPSG:25832", "east": 600000.0, "north": 5269000.0}
SIDE = 1000.0  # m


def geojson(path, *features):
    """Write features of kind, coordinates (m of the sketch) and properties."""

    def shifted(places):
        if isinstance(places[0], float):
            return [places[0] + FRAME["east"], places[1] + FRAME["north"]]
        return [shifted(each) for each in places]

    table = {
        "type": "FeatureCollection",
        "crs": {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}},
        "features": [
            {
                "type": "Feature",
                "geometry": {"type": kind, "coordinates": shifted(places)},
                "properties": properties,
            }
            for kind, places, properties in features
        ],
    }
    path.write_text(json.dumps(table))
    return path


def square(west, south, side):
    east, north = west + side, south + side
    return [[[west, south], [east, south], [east, north], [west, north], [west, south]]]


@pytest.fixture
def fields(tmp_path):
    """Two squares that overlap, 300 m and 200 m, and a line, in a file."""
    return geojson(
        tmp_path / "fields.geojson",
        ("Polygon", square(100.0, 100.0, 300.0), {"use": "meadow", "rank": 1}),
        ("Polygon", square(300.0, 300.0, 200.0), {"use": "wood", "rank": 2}),
        ("LineString", [[600.0, 600.0], [900.0, 600.0]], {"use": "path", "rank": 3}),
    )


@pytest.fixture
def blank(document):
    document.open(Sketch(frame=FRAME, extent=SIDE, layers={"hill": np.zeros((50, 50), np.uint8)}))
    return document


def settle(qtbot, canvas):
    sources = canvas._context.document.drapes
    qtbot.waitUntil(lambda: not (sources.is_busy or canvas.drapes.is_busy))


@pytest.fixture
def draped(blank, fields, open_canvas, qtbot):
    """The canvas of a sketch with the fields."""
    blank.do(
        "Add",
        blank.sketch.replace(drapes=(draped_layer(fields, fill="#00ff00", colour="#ff0000", width=6.0),)),
    )
    canvas = open_canvas(blank)
    settle(qtbot, canvas)
    return canvas


def colour_at(canvas, x, y):
    image, place = canvas.grab().toImage(), canvas._context.screen_from_world(x, y)
    return image.pixelColor(place.toPoint())


def test_layers_are_drawn_beneath_and_above_the_paint_by_their_order(draped, blank, tmp_path, qtbot):
    paper, green = colour_at(draped, 800.0, 300.0), colour_at(draped, 200.0, 200.0)
    assert green.green() > green.red() + 50
    assert colour_at(draped, 750.0, 600.0) == QColor("#ff0000")
    pixels = np.zeros((3, 10, 10), np.uint8)
    pixels[2] = 255
    at = Affine(SIDE / 10, 0.0, FRAME["east"], 0.0, -SIDE / 10, FRAME["north"] + SIDE)
    profile = {"count": 3, "height": 10, "width": 10, "dtype": "uint8", "photometric": "RGB"}
    with rasterio.open(tmp_path / "blue.tif", "w", crs=FRAME["crs"], transform=at, **profile) as file:
        file.write(pixels)
    raster, layers = draped_layer(tmp_path / "blue.tif"), blank.sketch.drapes
    for order, seen in (((raster, *layers), True), ((*layers, raster), False)):
        blank.do("Order", blank.sketch.replace(drapes=order))
        settle(qtbot, draped)
        assert colour_at(draped, 800.0, 300.0) == QColor("#0000ff")
        assert (colour_at(draped, 750.0, 600.0) == QColor("#ff0000")) == seen
    model.change_drape(blank, 1, "Hide", visible=0)
    settle(qtbot, draped)
    assert colour_at(draped, 750.0, 600.0) == QColor("#ff0000")
    assert paper not in (green, QColor("#0000ff"))


def place(canvas, x, y):
    at = canvas._context.screen_from_world(x, y)
    return at.x(), at.y()


def click(canvas, x, y):
    events.click(canvas, *place(canvas, x, y))


def double(canvas, x, y):
    at = place(canvas, x, y)
    click(canvas, x, y)
    events.mouse(canvas, events.DOUBLE, *at)
    events.mouse(canvas, events.RELEASE, *at)


def drag(canvas, start, end):
    """Drag from a position (m) to another one in steps, as a mouse does."""
    (x, y), (to_x, to_y) = place(canvas, *start), place(canvas, *end)
    steps = [(x + (to_x - x) * t, y + (to_y - y) * t) for t in (0.25, 0.5, 0.75, 1.0)]
    events.drag(canvas, (x, y), *steps)


def shape(document, number):
    return document.drapes.table(0).geometry(number)


def near(places, expected):
    """Return whether positions are equal to about a pixel of the canvas."""
    return np.abs(np.asarray(places) - expected).max() < 3.0


def test_clicks_choose_the_highest_feature_then_those_below(draped, blank, workspace):
    workspace.tool = "select"
    click(draped, 350.0, 350.0)
    assert workspace.selection == Selection("drape", 1, layer=0)
    click(draped, 350.0, 350.0)
    assert workspace.selection == Selection("drape", 0, layer=0)
    click(draped, 350.0, 350.0)
    assert workspace.selection == Selection("drape", 1, layer=0)
    click(draped, 700.0, 601.0)
    assert workspace.selection == Selection("drape", 2, layer=0)
    events.key(draped, Qt.Key.Key_Escape)
    assert workspace.selection is None
    model.change_drape(blank, 0, "Hide", visible=0)
    click(draped, 350.0, 350.0)
    assert workspace.selection is None


def test_edits_on_the_canvas_are_one_step_each_and_undone_to_the_bit(draped, blank, workspace):
    workspace.tool, line = "select", Selection("drape", 2, layer=0)
    workspace.selection, before = line, shape(blank, 2).wkb
    vertex = replace(line, index=0)
    changes = (
        (
            lambda: drag(draped, (600.0, 600.0), (600.0, 700.0)),
            "Move a vertex",
            [(600, 700), (900, 600)],
            vertex,
        ),
        (
            lambda: drag(draped, (700.0, 600.0), (700.0, 650.0)),
            "Move a feature",
            [(600, 650), (900, 650)],
            line,
        ),
        (lambda: double(draped, 660.0, 600.0), "Insert a vertex", [(600, 600), (660, 600), (900, 600)], None),
    )
    for change, title, expected, selection in changes:
        workspace.selection, position = line, blank.history.position
        change()
        assert blank.history.position == position + 1
        assert blank.history.titles[-1].startswith(title)
        assert near(shape(blank, 2).coords, expected)
        assert workspace.selection == (selection or replace(line, index=1))
        assert blank.drapes.held is None
        blank.undo()
        assert shape(blank, 2).wkb == before
        assert not blank.sketch.drapes[0].edits
    workspace.selection = Selection("drape", 1, layer=0)
    offset = 12.0 * 0.5**0.5 / draped._context.px_per_metre  # of corners, off the box
    drag(draped, (500.0 + offset, 500.0 + offset), (600.0 + offset, 700.0 + offset))
    assert near(shape(blank, 1).bounds, (300.0, 300.0, 600.0, 700.0))
    blank.undo()
    offset = 12.0 / draped._context.px_per_metre
    drag(draped, (400.0, 500.0 + offset), (500.0 + offset, 400.0))
    assert shape(blank, 1).area == pytest.approx(200.0**2)
    assert near(shape(blank, 1).exterior.coords[0], (300.0, 500.0))


def test_undone_layers_are_neither_shown_nor_held(blank, fields, qtbot):
    seen = []
    blank.do("Add", blank.sketch.replace(drapes=(draped_layer(fields),)))
    blank.undo()  # while it is read
    events.finish_reading()
    assert blank.drapes.current is None
    blank.redo()
    qtbot.waitUntil(lambda: blank.drapes.current is not None)
    blank.drapes.changed.connect(lambda: seen.append((blank.drapes.current is None, blank.drapes.held)))
    blank.drapes.hold(Selection("drape", 2, layer=0))
    blank.undo()
    assert seen == [(False, (0, 2)), (False, None), (True, None)]


def test_vertices_and_features_are_deleted_and_drawn(draped, blank, workspace):
    workspace.tool, workspace.selection = "select", Selection("drape", 1, 0, layer=0)
    events.key(draped, Qt.Key.Key_Delete)
    assert len(shape(blank, 1).exterior.coords) == 4
    workspace.selection = Selection("drape", 1, layer=0)
    events.key(draped, Qt.Key.Key_Delete)
    assert workspace.selection is None
    assert 1 not in blank.drapes.table(0)
    assert blank.sketch.drapes[0].edits[1] is None
    places = [(100.0, 800.0), (200.0, 800.0), (200.0, 900.0)]
    for kind, count in (("point", 1), ("line", 3), ("area", 3)):
        workspace.drape_kind, workspace.selection = kind, Selection("drape", -1, layer=0)
        workspace.tool = "line"
        for each in places[:count]:
            click(draped, *each)
        if kind != "point":
            events.key(draped, Qt.Key.Key_Return)
        feature = SelectedFeature.find(blank, workspace.selection).feature
        assert KINDS[feature.kind] == kind
        assert near(feature.rings[0], places[:count])
        assert set(feature.properties) <= {"use", "rank"}
        assert blank.history.titles[-1] == f"Draw {'an' if kind == 'area' else 'a'} {kind} of fields"


def test_lines_of_a_draped_layer_are_split_joined_reversed_and_snap(draped, blank, workspace):
    def run(name):
        FEATURE_COMMANDS[name](blank, workspace)

    def ends(number):
        return [list(each) for each in np.round(shape(blank, number).coords)]

    workspace.tool, workspace.selection = "select", Selection("drape", 2, layer=0)
    double(draped, 700.0, 600.0)
    run("split-line")
    middle = ends(2)[-1]
    assert (ends(2)[0], ends(3)) == ([600, 600], [middle, [900, 600]])
    assert SelectedFeature.find(blank, Selection("drape", 3, layer=0)).feature.properties == {
        "use": "path",
        "rank": 3,
    }
    run("reverse-line")
    assert ends(2) == [middle, [600, 600]]
    workspace.selection = Selection("drape", 2, layer=0)
    drag(draped, (600.0, 600.0), (503.0, 502.0))  # to a corner of a square
    assert shape(blank, 2).coords[-1] == shape(blank, 1).exterior.coords[2]
    assert ends(2)[-1] == [500, 500]
    workspace.selection = Selection("drape", 2, layer=0)
    run("join-lines")
    assert ends(2) == [[900, 600], middle, [500, 500]]
    assert 3 not in blank.drapes.table(0)
    titles = (
        "Insert a vertex in",
        "Split a line of",
        "Reverse a line of",
        "Move a vertex of",
        "Join lines of",
    )
    assert blank.history.titles[-5:] == tuple(f"{title} fields" for title in titles)
    for _ in titles:
        blank.undo()
    assert ends(2) == [[600, 600], [900, 600]]
    text = selected_text(blank, workspace)
    paste(blank, workspace, text)
    assert workspace.selection == Selection("drape", 3, layer=0)
    assert SelectedFeature.find(blank, workspace.selection).feature.properties == {"use": "path", "rank": 3}
    assert np.allclose(shape(blank, 3).coords[0], (620.0, 580.0))
    workspace.selection = None
    with pytest.raises(InputError, match="choose a draped layer"):
        paste(blank, workspace, text)


def test_locked_hidden_and_raster_layers_refuse_with_one_line(draped, blank, workspace):
    workspace.tool, workspace.selection = "select", Selection("drape", 2, layer=0)
    workspace.set_look(model.look_key(blank.sketch.drapes[0]), locked=True)
    drag(draped, (600.0, 600.0), (600.0, 700.0))
    events.key(draped, Qt.Key.Key_Delete)
    assert draped.lines == 2 * ["fields is locked. Unlock the layer to edit it."]
    assert not blank.sketch.drapes[0].edits


def test_properties_keep_their_types(draped, blank, workspace, show_widget):
    page, lines = show_widget(FeaturePage(blank, workspace)), []
    blank.message.connect(lines.append)
    workspace.selection = Selection("drape", 1, layer=0)
    assert {name: row.field.text() for name, row in page.form.rows.items()} == {"use": "wood", "rank": "2"}
    for name, text in (("rank", "7"), ("use", "12"), ("rank", "many")):
        page.form.rows[name].field.setText(text)
        page.form.rows[name].field.editingFinished.emit()
    assert SelectedFeature.find(blank, workspace.selection).feature.properties == {"use": "12", "rank": 7}
    assert lines == ["rank: expected a whole number, got 'many'"]
    assert page.form.rows["rank"].field.text() == "7"
    assert blank.history.titles[-1] == "Set use of fields"


def test_the_list_shows_hides_locks_moves_and_removes_layers(blank, workspace, fields, show_widget, qtbot):
    panel = show_widget(DrapeList(blank, workspace))
    assert panel.list.isHidden()
    names = [geojson(fields.with_name(f"{name}.geojson"), ("Point", [1.0, 1.0], {})) for name in "abc"]
    model.add_drapes(blank, workspace, [model.new_drape(path, at) for at, path in enumerate(names)])
    qtbot.waitUntil(lambda: not blank.drapes.is_busy)
    rows = panel.list.rows
    assert [(each.title, each.detail) for each in rows] == [(n, f"{n}.geojson") for n in "cba"]
    assert len({each.colours for each in rows}) == 3
    assert workspace.selection == Selection("drape", -1, layer=2)
    panel.buttons["lower"].click()
    assert [each.title for each in blank.sketch.drapes] == ["a", "c", "b"]
    panel.list.moved.emit(2, 0)
    assert [each.title for each in blank.sketch.drapes] == ["c", "b", "a"]
    panel.list.eye_clicked.emit("2")
    panel.list.lock_clicked.emit("2")
    assert (panel.list.rows[0].visible, panel.list.rows[0].locked) == (False, True)
    panel.buttons["remove"].click()
    assert [each.title for each in blank.sketch.drapes] == ["c", "b"]
    assert list(blank.history.titles[1:]) == ["Add 3 draped layers", "Move c", "Move a", "Hide a", "Remove a"]


def test_styles_and_classes_are_steps_and_drags_merge(draped, blank, workspace, show_widget, fields):
    page, lines = show_widget(DrapePage(blank, workspace)), []
    blank.message.connect(lines.append)
    workspace.selection = Selection("drape", -1, layer=0)
    count = len(blank.history.titles)
    slider = page.style_form.rows["width"].slider
    slider.sliderPressed.emit()
    for step in (100, 200, 400):
        slider.setValue(step)
    slider.sliderReleased.emit()
    assert len(blank.history.titles) == count + 1
    page.layer_form.edited.emit("opacity", 0.5, object())
    page.layer_form.edited.emit("opacity", 2.0, object())
    page.layer_form.edited.emit("title", "Land use", object())
    assert (blank.sketch.drapes[0]["opacity"], blank.sketch.drapes[0].title) == (0.5, "Land use")
    assert len(lines) == 1
    page.by.setCurrentText("use")
    page.by.activated.emit(page.by.currentIndex())
    page.classify.click()
    classes = blank.sketch.drapes[0].classes
    assert [each.value for each in classes] == ["meadow", "path", "wood"]
    assert len({each.style["colour"] for each in classes}) == 3
    page.classes.activated.emit(3)
    page.style_form.edited.emit("width", 9.0, object())
    assert blank.sketch.drapes[0].style_of(2)["width"] == 9.0 != blank.sketch.drapes[0].style["width"]
    page.style_form.edited.emit("width", None, None)
    assert "width" not in blank.sketch.drapes[0].classes[2].style
    page.remove.click()
    page.add.click()
    assert [each.value for each in blank.sketch.drapes[0].classes] == ["meadow", "path", "new"]
    many = (("Point", [1.0, 1.0], {"n": each}) for each in range(MAX_CLASSES + 1))
    path = geojson(fields.with_name("many.geojson"), *many)
    blank.do("Many", blank.sketch.replace(drapes=(draped_layer(path),)))
    events.wait(lambda: not blank.drapes.is_busy)
    with pytest.raises(
        InputError, match=rf"many: n has {MAX_CLASSES + 1} values; expected at most {MAX_CLASSES}"
    ):
        model.classify(blank, 0, "n")


def test_problems_are_in_the_banner_and_update_takes_the_changed_file(window, blank, fields, qtbot):
    blank.do("Add", blank.sketch.replace(drapes=(draped_layer(fields),)))
    qtbot.waitUntil(lambda: not blank.drapes.is_busy)
    assert window.banner.message is None
    geojson(fields, ("Point", [5.0, 5.0], {}))
    blank.do("Again", blank.sketch.replace(name="again"))
    model.change_drape(blank, 0, "Hide", visible=0)
    message = window.banner.message
    assert "fields.geojson" in message.line
    assert [title for title, _ in message.buttons] == ["Update"]
    message.buttons[0][1]()
    qtbot.waitUntil(lambda: not blank.drapes.is_busy)
    assert window.banner.message is None
    assert shape(blank, 0).geom_type == "Point"
    fields.unlink()
    model.change_drape(blank, 0, "Show", visible=1)
    assert "missing" in window.banner.message.line


def test_files_are_added_by_dialog_and_drop_and_layers_saved(
    window, blank, fields, monkeypatch, qtbot, workspace
):
    monkeypatch.setattr(QFileDialog, "getOpenFileNames", lambda *_: ([str(fields)], ""))
    window.actions_by_name["add-drapes"].trigger()
    qtbot.waitUntil(lambda: blank.history.position == 1 and not blank.drapes.is_busy)
    window.files.open_dropped([fields], "hill")
    qtbot.waitUntil(lambda: blank.history.position == 2 and not blank.drapes.is_busy)
    assert len(blank.sketch.drapes) == 2
    workspace.selection = Selection("drape", 2, layer=0)
    delete_feature(blank, workspace)
    other = fields.with_name("other.fgb")
    monkeypatch.setattr(QFileDialog, "getSaveFileName", lambda *_: (str(other), ""))
    window.files.save_drape(0, True)
    qtbot.waitUntil(lambda: not blank.drapes.is_busy)
    saved = blank.sketch.drapes[0]
    assert (saved.path, dict(saved.edits), blank.history.titles[-1]) == (str(other), {}, "Save other")
    assert blank.drapes.current.table(0).count == 2
    assert blank.drapes.current.table(1).count == 3


def test_the_engine_gets_changes_at_once_and_the_placer_none(draped, blank, link, workspace):
    sent = [each for each in link.requests if isinstance(each, msg.SetDrapes)]
    assert sent[-1].layers == blank.sketch.drapes
    link._updates.next()
    model.change_drape(blank, 0, "Set", opacity=0.25)
    assert link.requests[-1].layers[0]["opacity"] == 0.25
    assert link._updates.is_empty
    workspace.tool, workspace.selection = "select", Selection("drape", 2, layer=0)
    (x, y), (to_x, to_y) = place(draped, 600.0, 600.0), place(draped, 650.0, 700.0)
    events.mouse(draped, events.PRESS, x, y)
    events.mouse(draped, events.MOVE, to_x, to_y)
    assert (link.requests[-1].held, link.requests[-1].layers) == ((0, 2), blank.sketch.drapes)
    events.mouse(draped, events.RELEASE, to_x, to_y)
    assert link.requests[-1].held is None
    blank.do("Name", blank.sketch.replace(name="other"))
    assert link._updates.is_empty is False


def test_features_are_chosen_and_dragged_in_the_view(
    blank, fields, workspace, link, placed, show_widget, qtbot
):
    blank.do("Add", blank.sketch.replace(drapes=(draped_layer(fields, fill="#00ff00"),)))
    view = show_widget(View3D(blank, workspace, link), 640, 480)
    show_picture(link, blank, replace(placed, points=placed.points[:0], rivers=(), lakes=()))
    qtbot.waitUntil(lambda: link.view.width > 0 and not blank.drapes.is_busy)
    for expected in (1, 0, 1):
        events.click(view, 20, 300)
        answer(link, (350.0, 350.0, 0.0))
        assert workspace.selection == Selection("drape", expected, layer=0)
    workspace.selection = Selection("drape", 2, layer=0)
    assert [len(each.pixels) for each in marks(view).outline] == [8]
    assert [each.handle.role for each in marks(view).handles].count("point") == 2
    mark = next(each for each in marks(view).handles if each.handle.role == "point")
    position, link.requests[:] = blank.history.position, []
    events.mouse(view, events.PRESS, mark.x, mark.y)
    for step in (10, 20, 30):
        events.mouse(view, events.MOVE, mark.x + step, mark.y)
        assert (link.requests[-1].held, link.requests[-1].layers) == ((0, 2), blank.sketch.drapes)
    events.mouse(view, events.RELEASE, mark.x + 30, mark.y)
    assert blank.drapes.held is None
    assert blank.history.position == position + 1
    assert shape(blank, 2).coords[0][0] > 620.0
    assert shape(blank, 2).coords[1] == (900.0, 600.0)
    view.see_selection()
    assert isinstance(link.requests[-1], msg.GoTo)
    events.key(view, Qt.Key.Key_Escape)
    assert workspace.selection is None


@pytest.mark.gl
@pytest.mark.slow
def test_the_real_view_follows_layers_and_places_nothing(qapp, tmp_path):
    path = geojson(tmp_path / "all.geojson", ("Polygon", square(-9e3, -9e3, 22e3), {"n": 1}))
    layers = {"mountain": np.pad(np.ones((20, 20), np.uint8), 38)}
    document = Document(Sketch(frame=FRAME, extent=4000.0, layers=layers))
    link, versions, errors = EngineLink(document), [], []
    link.terrain_updated.connect(versions.append)
    link.error_reported.connect(errors.append)
    link.set_view(msg.ViewState(width=160, height=100, quality=0.0, plays=False, refines=False))

    def red():
        """Return the share of the picture that is clearly red."""
        image = link.picture
        colours = [image.pixelColor(x, y) for x in range(0, 160, 8) for y in range(0, 100, 8)]
        return np.mean([each.red() > each.green() + 60 for each in colours])

    link.start()
    try:
        events.wait(lambda: errors or (link.frame is not None and link.frame.converged))
        known, style = len(versions), {"fill": "#ff0000", "fill_opacity": 1.0}
        assert red() < 0.05
        document.do("Add", document.sketch.replace(drapes=(draped_layer(path, **style),)))
        events.wait(lambda: errors or (red() > 0.3 and link.frame.converged))
        model.change_drape(document, 0, "Hide", visible=0)
        events.wait(lambda: errors or red() < 0.05)
        document.undo()
        events.wait(lambda: errors or red() > 0.3)
        assert not errors
        assert len(versions) == known
    finally:
        link.stop()
