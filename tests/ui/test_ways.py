"""Roads, railways, paths, pads and walls: drawing, junctions, shared nodes, classes, widths, lists."""

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features.edits import set_value, shared_nodes
from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable
from sketchterrain.ui import commands
from sketchterrain.ui.engine.placer import place_of_finding
from sketchterrain.ui.engine.protocol import Placement
from sketchterrain.ui.models import features
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.panels.layers import LayersPanel
from sketchterrain.ui.panels.lists import ContradictionsPanel
from sketchterrain.ui.panels.properties import FeaturePage

from .test_vectors import SIDE, at, click, drag, draw, line, places, steps


@pytest.fixture
def blank(qapp):
    return Document(Sketch(layers={"river": np.zeros((SIDE, SIDE), np.uint8)}, extent=1280.0))


@pytest.fixture
def ways(blank):
    """A straight road from west to east, and a railway and a path that start at its middle vertex."""
    added = {
        "road": line((200, 600), (600, 600), (1000, 600)),
        "railway": line((600, 600), (600, 900)),
        "path": line((600, 600), (700, 300)),
    }
    layers = {name: FeatureTable(name).edited(add=[each]) for name, each in added.items()}
    blank.open(blank.sketch.replace(vectors=layers))
    return blank


@pytest.fixture
def canvas(blank, open_canvas):
    return open_canvas(blank)


def test_a_layer_without_an_image_takes_the_line_tool_and_says_why_it_is_not_painted(
    canvas, workspace, blank
):
    workspace.use_label("road", 1)
    assert workspace.tool == "line"
    workspace.use_label("hill", 1)
    assert workspace.tool == "brush"
    workspace.use_label("pad", 1)
    workspace.tool = "select"
    workspace.use_label("hill", 1)
    assert workspace.tool == "select"
    workspace.use_label("road", 1)
    for tool in ("brush", "eraser", "fill"):
        workspace.tool = tool
        click(canvas, 300, 300)
    assert canvas.lines == ["Roads are drawn, not painted: use the line tool (L), or select one (V)."] * 3
    assert steps(blank) == ()


def test_roads_that_cross_get_a_junction_unless_they_are_at_different_levels(canvas, workspace, blank, qtbot):
    workspace.use_label("road", 1)
    draw(canvas, qtbot, (200, 600), (1000, 600))
    workspace.use_label("railway", 1)
    draw(canvas, qtbot, (600, 200), (600, 1000))
    road, rail = blank.sketch.vectors["road"], blank.sketch.vectors["railway"]
    assert steps(blank) == ("Draw a line of roads", "Draw a line of railways")
    assert (len(road.vertices), len(rail.vertices)) == (3, 3)
    assert road.vertices[1].tolist() == rail.vertices[1].tolist()
    blank.undo()
    assert len(blank.sketch.vectors["road"].vertices) == 2
    blank.do("Raise", commands.set_property(blank.sketch, "railway", 1, "level", 1))
    draw(canvas, qtbot, (600, 200), (600, 1000))
    assert (len(blank.sketch.vectors["road"].vertices), len(blank.sketch.vectors["railway"].vertices)) == (
        2,
        2,
    )


def test_an_end_on_a_way_of_another_layer_is_a_junction(canvas, workspace, ways, qtbot):
    near = 6.0 / canvas._context.px_per_metre
    workspace.use_label("path", 1)
    draw(canvas, qtbot, (400, 300), (400, 600 - near))
    end = ways.sketch.vectors["path"].feature(2).rings[0][-1]
    assert end[1] == 600.0
    assert ways.sketch.vectors["road"].feature(1).rings[0][1].tolist() == end.tolist()
    draw(canvas, qtbot, (300, 900), (600, 900 - near))  # at the railway's end
    assert places(ways, 3, layer="path")[-1] == [600, 900]
    assert len(ways.sketch.vectors["railway"].vertices) == 2
    workspace.set_look("railway", locked=True)
    draw(canvas, qtbot, (300, 800), (900, 800))
    assert "Railways are locked" in canvas.lines[-1]


def test_freehand_crossings_are_vertices_of_both_smooth_lines(ways):
    bent = Feature(
        LINE, (np.array([(250, 400), (400, 800), (800, 450), (950, 800)], float),), 1, {"smooth": 1}
    )
    road, rail, _ = features.with_feature(ways.sketch, "road", bent)
    new = road.feature(2).rings[0]
    assert len(road.feature(1).rings[0]) == 3 + 3
    assert len(rail.feature(1).rings[0]) == 2 + 1
    assert shared_nodes([road, rail], new).sum() == 4
    assert shared_nodes([road, rail], new[[0, -1]]).sum() == 0


def test_a_node_moves_in_all_layers_of_ways_in_one_step(canvas, workspace, ways):
    workspace.tool = "select"
    click(canvas, 600, 750)
    assert workspace.selection == Selection("railway", 1)
    drag(canvas, (600, 600), (650, 560), (700, 500))
    assert steps(ways) == ("Move a vertex of railways",)
    moved = places(ways, 1, layer="railway")[0]
    assert moved == pytest.approx([700, 500], abs=3.0)
    assert places(ways, 1, layer="road")[1] == moved
    assert places(ways, 1, layer="path")[0] == moved
    ways.undo()
    workspace.set_look("path", locked=True)
    drag(canvas, (600, 600), (650, 560), (700, 500))
    assert "Paths are locked" in canvas.lines[-1]
    assert steps(ways) == ()


def test_a_node_dragged_onto_a_line_joins_it(canvas, workspace, ways):
    near = 6.0 / canvas._context.px_per_metre
    workspace.tool = "select"
    workspace.selection = Selection("path", 1)
    drag(canvas, (700, 300), (750, 500), (800, 600 - near))
    end = ways.sketch.vectors["path"].feature(1).rings[0][-1]
    assert end[1] == 600.0
    assert end.tolist() in ways.sketch.vectors["road"].feature(1).rings[0].tolist()
    assert steps(ways) == ("Move a vertex of paths",)


def test_a_width_is_dragged_in_one_step_and_follows_from_lanes_before(canvas, workspace, ways):
    assert features.widths_of(ways.sketch, ways.sketch.vectors["road"]).tolist() == [6.0]
    workspace.tool = "select"
    workspace.selection = Selection("road", 1)
    handle = features.SelectedFeature.find(ways, workspace.selection).box_handles[-1]
    assert (handle.x, handle.y, handle.base_x, handle.base_y) == pytest.approx((600, 603, 600, 600))
    place = canvas._input._select._handle_place(handle)
    start = canvas._context.world_from_sketch(*canvas._context.sketch_from_screen(place))
    drag(canvas, start, (start[0], start[1] + 8), (start[0], start[1] + 17))
    assert steps(ways) == ("Set the width of roads",)
    assert features.widths_of(ways.sketch, ways.sketch.vectors["road"])[0] == pytest.approx(40.0, abs=6.0)
    canvas.grab()
    ways.undo()
    assert "width" not in ways.sketch.vectors["road"].feature(1).properties


def test_a_road_becomes_a_path_with_its_vertices_and_values_in_one_step(workspace, ways, show_widget):
    layer = set_value(set_value(ways.sketch.vectors["road"], 1, "grade", 0.2), 1, "surface", "gravel")
    ways.do("Grade", commands.with_vectors(ways.sketch, layer))
    page = show_widget(FeaturePage(ways, workspace))
    workspace.selection = Selection("road", 1)
    rows = page.form.rows
    assert rows["grade"].number == 0.2
    assert rows["surface"].box.currentData() == "gravel"
    assert rows["width"].check.isChecked()
    assert "directed" not in rows
    titles = [page.label.itemText(i) for i in range(page.label.count())]
    assert titles == ["Roads 1", "Paths 1", "Railways 1"]
    page.label.setCurrentIndex(1)
    page.label.activated.emit(1)
    assert workspace.selection == Selection("path", 2)
    assert steps(ways)[1:] == ("Make paths 1 of roads",)
    assert places(ways, 2, layer="path") == [[200, 600], [600, 600], [1000, 600]]
    assert ways.sketch.vectors["path"].feature(2).properties == {"grade": 0.2, "surface": "gravel"}
    assert len(ways.sketch.vectors["road"]) == 0
    ways.undo()
    assert (len(ways.sketch.vectors["road"]), len(ways.sketch.vectors["path"])) == (1, 1)


def test_pads_are_outlined_and_walls_have_corners(canvas, workspace, blank, qtbot):
    workspace.use_label("pad", 1)
    draw(canvas, qtbot, (300, 300), (500, 300), (500, 500))
    workspace.use_label("wall", 1)
    draw(canvas, qtbot, (600, 300), (900, 300), (900, 500))
    pad, wall = (blank.sketch.vectors[name].feature(1) for name in ("pad", "wall"))
    assert (pad.kind, len(pad.rings[0])) == (AREA, 3)
    assert (wall.kind, wall.properties) == (LINE, {})


def test_ways_are_drawn_with_a_casing_in_their_width(canvas, workspace, ways):
    wide = ways.sketch.replace(labels={("road", 1): {"width": 60.0}})
    ways.do("Widen", wide)
    workspace.tool = "brush"
    picture = canvas.grab().toImage()
    middle, edge = (picture.pixelColor(at(canvas, 400, y)) for y in (620.0, 631.5))
    assert middle.red() > edge.red() + 60


def test_a_layer_without_an_image_is_listed_cleared_and_picked(canvas, workspace, ways, show_widget):
    panel = show_widget(LayersPanel(ways, workspace))
    details = {row.layer: row.detail for row in panel.list.rows}
    assert (details["road"], details["wall"]) == ("width by lanes · 1 drawn", "1.2 m · not drawn")
    workspace.tool = "pick"
    click(canvas, 300, 600)
    assert (workspace.layer, canvas.lines[-1]) == ("road", "Draws roads, label 1.")
    assert not panel.opacity.isEnabled()
    panel.clear_layer()
    assert len(ways.sketch.vectors["road"]) == 0
    changed = commands.delete_label(ways.sketch, "path", 1)
    assert len(changed.vectors["path"]) == 0
    workspace.set_look("railway", locked=True)
    with pytest.raises(InputError, match="locked"):
        features.change_features(ways, workspace, "Clear", Selection("railway", 1), FeatureTable("railway"))


def test_findings_about_roads_are_listed_with_their_place(ways, workspace, link, placed, show_widget):
    line = "road 1: 85 m steeper than 10 %"
    assert place_of_finding(ways.sketch, line) == (600.0, 600.0)
    for other in ("road 7: none", "3 more bends are tight", "road", "", "moat 1: wet"):
        assert place_of_finding(ways.sketch, other) is None
    panel = show_widget(ContradictionsPanel(workspace, link))
    link.placed = Placement(1, placed.points, (), (), findings=((line, (600.0, 600.0)), ("more", None)))
    link.placed_changed.emit(link.placed)
    went = []
    panel.place_activated.connect(lambda x, y: went.append((x, y)))
    for row in range(2):
        panel.list.clicked.emit(panel.list.model().index(row, 0))
    assert panel.list.model().index(0, 0).data() == "Road 1: 85 m steeper than 10 %"
    assert went == [(600.0, 600.0)]
