"""Vectors: drawing with the line tool, editing in the canvas, commands, panel."""

import numpy as np
import pytest
from PyQt6.QtCore import QPoint, Qt
from PyQt6.QtGui import QGuiApplication

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable
from sketchterrain.ui import commands
from sketchterrain.ui.engine.link import NOT_PLACED
from sketchterrain.ui.models import features
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import selections_at
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.panels.layers import LayersPanel, label_detail
from sketchterrain.ui.panels.properties import FeaturePage

from . import events

SIDE = 128  # px of 10 m


def line(*points, **properties):
    return Feature(LINE, (np.array(points, float),), 1, properties)


@pytest.fixture
def blank(qapp):
    return Document(Sketch(layers={"river": np.zeros((SIDE, SIDE), np.uint8)}, extent=1280.0))


@pytest.fixture
def rivers(blank):
    """Two rivers that meet at (600, 600)."""
    layer = FeatureTable("river").edited(
        add=[line((200, 600), (400, 640), (600, 600), smooth=1), line((600, 1000), (600, 600))]
    )
    blank.open(blank.sketch.replace(vectors={"river": layer}))
    return blank


@pytest.fixture
def canvas(blank, workspace, open_canvas):
    workspace.tool = "line"
    workspace.use_label("river", 1)
    return open_canvas(blank)


def at(canvas, x, y):
    """Return the widget position of a place (m)."""
    place = canvas._context.screen_from_world(x, y)
    return QPoint(round(place.x()), round(place.y()))


def click(canvas, x, y, **keys):
    place = at(canvas, x, y)
    events.mouse(canvas, events.MOVE, place.x(), place.y(), events.NO_BUTTON)
    events.click(canvas, place.x(), place.y(), **keys)


def draw(canvas, qtbot, *points):
    for place in points:
        click(canvas, *place)
    qtbot.keyClick(canvas, Qt.Key.Key_Return)


def drag(canvas, *places):
    events.drag(canvas, *((at(canvas, *place).x(), at(canvas, *place).y()) for place in places))


def double(canvas, x, y):
    place = at(canvas, x, y)
    click(canvas, x, y)
    for kind in (events.DOUBLE, events.RELEASE):
        events.mouse(canvas, kind, place.x(), place.y())


def steps(document):
    return document.history.titles[1 : document.history.position + 1]


def layer_of(document, name="river"):
    return document.sketch.vectors[name]


def places(document, name, *, layer="river"):
    return layer_of(document, layer).feature(name).rings[0].round().tolist()


def test_the_line_tool_draws_a_river_as_a_vector(canvas, blank, workspace, qtbot):
    workspace.use_label("river", 2)
    for place in ((200, 600), (400, 700), (700, 600), (900, 900)):
        click(canvas, *place)
    qtbot.keyClick(canvas, Qt.Key.Key_Backspace)
    canvas.grab()
    assert steps(blank) == ()
    qtbot.keyClick(canvas, Qt.Key.Key_Return)
    assert steps(blank) == ("Draw a line of rivers",)
    river = layer_of(blank).feature(1)
    assert (river.kind, river.label, river.properties) == (LINE, 2, {"smooth": 1})
    np.testing.assert_allclose(river.rings[0], [(200, 600), (400, 700), (700, 600)], atol=3.0)
    assert not blank.sketch.layers["river"].any()
    blank.undo()
    assert len(layer_of(blank)) == 0
    # One point is no line, and stays to be continued.
    click(canvas, 300, 300)
    qtbot.keyClick(canvas, Qt.Key.Key_Return)
    assert canvas.lines == ["Rivers: expected 2 points or more"]
    click(canvas, 500, 500)
    qtbot.keyClick(canvas, Qt.Key.Key_Return)
    assert len(places(blank, 1)) == 2


def test_a_freehand_river_has_few_vertices(canvas, blank):
    x = np.linspace(150.0, 1100.0, 60)
    drag(canvas, *zip(x, 640.0 + 150.0 * np.sin(x / 150.0), strict=True))
    assert steps(blank) == ("Draw a line of rivers",)
    drawn = np.array(places(blank, 1))
    assert 6 <= len(drawn) <= 30
    assert np.abs(drawn[:, 1] - (640.0 + 150.0 * np.sin(drawn[:, 0] / 150.0))).max() < 12.0


def test_a_new_river_shares_nodes_with_the_lines_that_it_touches(canvas, rivers, qtbot):
    near = 6.0 / canvas._context.px_per_metre  # 6 px
    for place in ((600 + near, 600), (800, 400), (600 - near, 800)):
        click(canvas, *place)
    qtbot.keyClick(canvas, Qt.Key.Key_Return)
    layer = layer_of(rivers)
    ends = layer.feature(3).rings[0][[0, -1]]
    assert ends[0].tolist() == [600, 600]
    assert len([*layer.features_at(600.0, 600.0)]) == 3
    assert ends[1][0] == 600.0
    assert len([*layer.features_at(*ends[1])]) == 2  # a vertex was inserted in the other river
    assert len(layer.feature(2).rings[0]) == 3
    assert steps(rivers) == ("Draw a line of rivers",)
    rivers.undo()
    assert len(layer_of(rivers).vertices) == 5
    # On the curve of a smooth river, not on its chord.
    curve = layer_of(rivers).feature(1).rings[0]
    click(canvas, 500, 900)
    click(canvas, 300, 625)
    qtbot.keyClick(canvas, Qt.Key.Key_Return)
    assert len(layer_of(rivers).feature(1).rings[0]) == len(curve) + 1
    assert (
        layer_of(rivers).feature(1).rings[0][1].tolist() == layer_of(rivers).feature(3).rings[0][1].tolist()
    )


def test_the_outline_of_a_lake_is_closed_and_may_not_touch_itself(canvas, blank, workspace, qtbot):
    workspace.use_label("lake", 1)
    for place in ((300, 300), (700, 300), (300, 700), (700, 700)):
        click(canvas, *place)
    canvas.grab()
    qtbot.keyClick(canvas, Qt.Key.Key_Return)
    assert "does not touch itself" in canvas.lines[-1]
    assert steps(blank) == ()
    qtbot.keyClick(canvas, Qt.Key.Key_Backspace)
    qtbot.keyClick(canvas, Qt.Key.Key_Backspace)
    click(canvas, 700, 700)
    click(canvas, 300, 300)  # closes it
    assert steps(blank) == ("Draw an area of lakes",)
    lake = layer_of(blank, "lake").feature(1)
    assert (lake.kind, lake.properties, len(lake.rings[0])) == (AREA, {}, 3)


def test_vectors_are_drawn_in_their_colour_and_width(canvas, rivers, workspace):
    def is_blue(x, y):
        pixel = canvas.grab().toImage().pixelColor(at(canvas, x, y))
        return pixel.blue() > pixel.red() + 60

    workspace.tool = "brush"
    assert is_blue(600, 800)
    assert not is_blue(640, 800)
    wide = rivers.sketch.replace(labels={("river", 1): {"width": 120.0}})
    rivers.do("Widen", wide)
    assert is_blue(640, 800)
    workspace.set_look("river", visible=False)
    assert not is_blue(600, 800)


def test_dragging_a_node_moves_both_lines_in_one_step(canvas, rivers, workspace):
    workspace.tool = "select"
    click(canvas, 600, 800)
    assert workspace.selection == Selection("river", 2)
    drag(canvas, (600, 600), (650, 560), (700, 500))
    assert workspace.selection == Selection("river", 2, 1)
    assert steps(rivers) == ("Move a vertex of rivers",)
    np.testing.assert_allclose(places(rivers, 2)[1], (700, 500), atol=3.0)
    assert places(rivers, 1)[-1] == places(rivers, 2)[-1]
    rivers.undo()
    assert places(rivers, 1)[-1] == [600, 600]
    # Another vertex within 10 px is snapped to; Escape cancels.
    drag(canvas, (600, 1000), (500, 800), (406, 644))
    assert places(rivers, 2)[0] == [400, 640]
    place = at(canvas, 400, 640)
    events.mouse(canvas, events.PRESS, place.x(), place.y())
    events.mouse(canvas, events.MOVE, place.x() + 90, place.y())
    canvas.grab()
    events.key(canvas, Qt.Key.Key_Escape)
    events.mouse(canvas, events.RELEASE, place.x() + 90, place.y())
    assert places(rivers, 2)[0] == [400, 640]
    events.key(canvas, Qt.Key.Key_Escape)
    assert workspace.selection is None


def test_a_lake_follows_the_drag_of_its_vertex_where_it_is_possible(canvas, blank, workspace):
    corners = [(300, 300), (900, 300), (900, 900), (300, 900)]
    lakes = FeatureTable("lake").edited(add=[Feature(AREA, (np.array(corners, float),))])
    blank.open(blank.sketch.replace(vectors={"lake": lakes}))
    workspace.tool, workspace.selection = "select", Selection("lake", 1)
    drag(canvas, (300, 300), (500, 350), (1000, 700))
    assert "touch itself" in canvas.lines[-1]
    assert steps(blank) == ("Move a vertex of lakes",)
    assert places(blank, 1, layer="lake")[0] == pytest.approx([500, 350], abs=3.0)


def test_vertices_are_inserted_and_deleted_then_the_line(canvas, rivers, workspace):
    workspace.tool = "select"
    double(canvas, 600, 800)
    assert workspace.selection == Selection("river", 2, 1)
    assert places(rivers, 2)[1] == pytest.approx([600, 800], abs=3.0)
    assert steps(rivers) == ("Insert a vertex in rivers",)
    events.key(canvas, Qt.Key.Key_Delete)
    assert places(rivers, 2) == [[600, 1000], [600, 600]]
    assert workspace.selection == Selection("river", 2, 0)
    click(canvas, 600, 850)  # the line, no vertex of it
    events.key(canvas, Qt.Key.Key_Delete)
    assert layer_of(rivers).ids.tolist() == [1]
    assert workspace.selection is None
    assert steps(rivers)[1:] == ("Delete a vertex of rivers", "Delete a feature of rivers")


def test_copied_vectors_are_pasted_beside(rivers, workspace):
    workspace.selection = Selection("river", 1, 2)
    text = features.selected_text(rivers, workspace)
    for count in (1, 2):
        features.paste(rivers, workspace, text)
        assert workspace.selection == Selection("river", 2 + count)
        offset = 25.6 * count
        np.testing.assert_allclose(
            layer_of(rivers).feature(2 + count).rings[0] - layer_of(rivers).feature(1).rings[0],
            [(offset, -offset)] * 3,
            atol=0.001,
        )
    assert steps(rivers) == ("Paste rivers",) * 2
    for other in ("", "no vectors", '{"type": "FeatureCollection", "features": []}'):
        with pytest.raises(InputError, match="copied from a sketch"):
            features.paste(rivers, workspace, other)


def test_lines_are_hit_on_their_curve_and_within_their_width_and_areas_inside(blank, workspace):
    def hit(x, y):
        return next(iter(selections_at(blank, workspace, NOT_PLACED, x, y, 1.0)), None)

    border, hole = ((np.array([(a, a), (b, a), (b, b), (a, b)], float)) for a, b in ((0, 1200), (900, 1100)))
    rivers = FeatureTable("river").edited(
        add=[line((100, 300), (300, 700), (500, 300), smooth=1), line((600, 100), (600, 800), width=80.0)]
    )
    lakes = FeatureTable("lake").edited(add=[Feature(AREA, (border, hole))])
    blank.open(blank.sketch.replace(vectors={"river": rivers, "lake": lakes}))
    ((x, y), *_) = [each for each in rivers.curves.shapes[0].coords if 345 < each[0] < 365]
    assert abs(y - (700 - 2 * (x - 300))) > 20.0  # off the chord
    assert hit(x, y) == Selection("river", 1)
    assert hit(635, 400) == Selection("river", 2)
    assert hit(650, 400) == hit(903, 1000) == hit(1203, 50) == Selection("lake", 1)
    assert hit(1000, 1000) is None
    workspace.set_look("river", visible=False)
    assert hit(x, y) == Selection("lake", 1)


def test_what_is_drawn_under_the_cursor_is_picked_before_what_is_near(canvas, blank, workspace):
    """A road beside a river, two roads 3 px apart with the later one below it, a road over a path."""
    blank.do("Narrow", blank.sketch.replace(labels={(name, 1): {"width": 2.0} for name in ("road", "path")}))
    px = 1.0 / canvas._context.px_per_metre
    added = {
        "river": [line((100, 300), (900, 300), width=12.0)],
        "road": [
            line((100, 306 + 4 * px), (900, 306 + 4 * px)),
            line((100, 600), (900, 600)),
            line((100, 600 - 4 * px), (900, 600 - 4 * px)),
        ],
        "path": [line((500, 500), (500, 700))],
    }
    layers = {name: FeatureTable(name).edited(add=each) for name, each in added.items()}
    blank.do("Draw", blank.sketch.replace(vectors=layers))
    workspace.tool = "select"
    for x, y, expected in (
        (300, 305, ("river", 1)),
        (300, 306 + 3.5 * px, ("road", 1)),
        (300, 600, ("road", 2)),
        (300, 600 - 4 * px, ("road", 3)),
        (300, 600 + 3 * px, ("road", 2)),
        (500, 600, ("road", 2)),
        (500, 650, ("path", 1)),
    ):
        workspace.selection = None
        found = selections_at(blank, workspace, NOT_PLACED, x, y, px)
        assert found[0] == Selection(*expected), (x, y, found)
    assert not selections_at(blank, workspace, NOT_PLACED, 300.0, 600 + 7 * px, px)


@pytest.fixture
def page(rivers, workspace, show_widget):
    widget = show_widget(FeaturePage(rivers, workspace))
    workspace.selection = Selection("river", 1)
    return widget


def test_the_panel_sets_properties_in_one_step_each(page, rivers, workspace, qtbot):
    rows = page.form.rows
    rows["name"].field.setText("Inn")
    rows["name"].field.editingFinished.emit()
    rows["smooth"].box.click()
    rows["directed"].box.click()
    with qtbot.waitSignal(rivers.sketch_changed):
        rows["width"].slider.sliderPressed.emit()
        for step in (300, 400, 500):
            rows["width"].slider.setValue(step)
        rows["width"].slider.sliderReleased.emit()
    titles = ("Set name of rivers", "Set smooth of rivers", "Set directed of rivers", "Set width of rivers")
    assert steps(rivers) == titles
    own = layer_of(rivers).feature(1).properties
    assert (own["name"], own["smooth"], own["directed"], own["width"]) == ("Inn", 0, 1, rows["width"].number)
    assert rows["width"].reset.isVisible()
    rows["width"].reset.click()
    assert "width" not in layer_of(rivers).feature(1).properties
    assert rows["width"].number == 12.0  # its label's
    assert rows["depth"].isVisible()
    workspace.selection = Selection("river", 2)
    assert rows["name"].field.text() == ""
    workspace.set_look("river", locked=True)
    assert not page.isEnabled()
    rivers.do("Clear", commands.clear_layer(rivers.sketch, "river"))
    assert not page.isEnabled()


def test_a_vector_has_the_properties_of_its_label(page, rivers):
    rivers.do("Declare", commands.new_label(rivers.sketch, "river", 4))
    labels = [page.label.itemData(i) for i in range(page.label.count())]
    assert labels == [("river", 1), ("river", 4)]
    page.label.setCurrentIndex(1)
    page.label.activated.emit(1)
    assert layer_of(rivers).feature(1).label == 4
    assert commands.labels_of(rivers.sketch, "river") == (1, 4)
    gone = commands.delete_label(rivers.sketch, "river", 4)
    assert gone.vectors["river"].ids.tolist() == [2]


def test_actions_and_menus_edit_vectors(window, document, workspace, link, qtbot):
    layer = FeatureTable("river").edited(add=[line((200, 600), (400, 640), (600, 600)), line((0, 0), (5, 5))])
    document.open(document.sketch.replace(vectors={"river": layer}))
    actions = window.actions_by_name
    names = ("copy", "split-line", "join-lines", "reverse-line", "delete-selection")
    assert not any(actions[name].isEnabled() for name in names)
    workspace.selection = Selection("river", 1, 1)
    assert all(actions[name].isEnabled() for name in names)
    assert window.findChild(FeaturePage).isVisibleTo(window)
    for name in ("copy", "split-line", "join-lines", "reverse-line", "paste", "delete-selection"):
        actions[name].trigger()
    assert steps(document) == (
        *("Split a line of rivers", "Join lines of rivers", "Reverse a line of rivers", "Paste rivers"),
        "Delete a feature of rivers",
    )
    QGuiApplication.clipboard().setText("other text")
    actions["paste"].trigger()
    assert "copied from a sketch" in window.banner.message.line
    assert len(steps(document)) == 5


def test_the_list_of_layers_counts_vectors(rivers, workspace, show_widget):
    panel = show_widget(LayersPanel(rivers, workspace))
    workspace.use_label("river", 1)
    assert label_detail(rivers.sketch, "river", 1, 0) == "12 m · 2 drawn"
    assert label_detail(rivers.sketch, "lake", 1, 0) == "6 m · not painted"
    assert panel.clear.isEnabled()
    panel.clear_layer()
    assert len(layer_of(rivers)) == 0
    assert not panel.clear.isEnabled()


def test_split_join_and_reverse_are_one_step_each(rivers, workspace):
    def run(name):
        features.FEATURE_COMMANDS[name](rivers, workspace)

    workspace.selection = Selection("river", 1, 1)
    run("split-line")
    assert len(layer_of(rivers)) == 3
    assert workspace.selection == Selection("river", 1)
    run("join-lines")
    assert places(rivers, 1) == [[200, 600], [400, 640], [600, 600]]
    run("reverse-line")
    assert places(rivers, 1)[0] == [600, 600]
    assert steps(rivers) == ("Split a line of rivers", "Join lines of rivers", "Reverse a line of rivers")
    with pytest.raises(InputError, match="between its ends"):
        run("split-line")
    workspace.set_look("river", locked=True)
    with pytest.raises(InputError, match="locked"):
        run("delete-selection")
