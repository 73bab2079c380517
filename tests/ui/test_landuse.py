"""Land use in the window: fields with shared borders, their crops, a step each; saved and opened again."""

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.features.table import AREA, Feature, FeatureTable
from sketchterrain.landuse.areas import land_use
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.styles import rgb_from_hex
from sketchterrain.ui.models import features
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.panels.layers import LayersPanel
from sketchterrain.ui.panels.properties import FeaturePage
from tests.document.random_documents import content_of

from .test_vectors import SIDE, at, click, drag, draw, steps


@pytest.fixture
def blank(qapp):
    return Document(Sketch(layers={"river": np.zeros((SIDE, SIDE), np.uint8)}, extent=1280.0))


@pytest.fixture
def canvas(blank, open_canvas):
    return open_canvas(blank)


def over(use, paper):
    """Return the colour of an area of a use on paper."""
    style = LAYERS["landuse"].class_of(use).style
    share = 0.625 * style["fill_opacity"]
    return share * np.array(rgb_from_hex(style["fill"])) + (1.0 - share) * paper


def ring(document, name):
    return document.sketch.vectors["landuse"].feature(name).rings[0].tolist()


def choose(page, name, value):
    """Choose a value in a property's box as a person does."""
    box = page.form.rows[name].box
    index = box.findData(value)
    box.setCurrentIndex(index)
    box.activated.emit(index)


def test_two_fields_share_a_border_get_crops_and_are_saved(
    canvas, workspace, blank, qtbot, show_widget, tmp_path
):
    page = show_widget(FeaturePage(blank, workspace))
    near = 6.0 / canvas._context.px_per_metre
    workspace.use_label("landuse", 1)
    assert workspace.tool == "line"
    draw(canvas, qtbot, (200, 200), (600, 200), (650, 600), (600, 1000), (200, 1000))
    # The second one snaps to the first, at vertices and within its northern border.
    east = [(600 + near, 200), (1000, 200), (1000, 1100), (400, 1000 + near), (600, 1000), (650, 600)]
    draw(canvas, qtbot, *east)
    assert steps(blank) == 2 * ("Draw an area of land use",)
    one, other = ring(blank, 1), ring(blank, 2)
    shared = [place for place in one if place in other]
    assert len(shared) == 4
    assert len(one) == 6  # a vertex was inserted where the other one begins
    shapes = blank.sketch.vectors["landuse"].shapes()
    assert shapes[0].intersection(shapes[1]).area == 0.0
    assert shapes[0].union(shapes[1]).area == shapes[0].area + shapes[1].area

    workspace.tool = "select"
    click(canvas, 400, 400)
    assert workspace.selection == Selection("landuse", 1)
    choose(page, "crop", "maize")
    click(canvas, 800, 400)
    choose(page, "use", "meadow")
    assert blank.sketch.vectors["landuse"].feature(1).properties == {"crop": "maize"}
    assert blank.sketch.vectors["landuse"].feature(2).properties == {"use": "meadow"}
    assert steps(blank)[2:] == ("Set crop of land use", "Set use of land use")
    areas = land_use(blank.sketch)
    assert (areas.use.tolist(), areas.crop.tolist()) == ([0, 1], [2, 0])

    start = ring(blank, 1)[ring(blank, 1).index(shared[0])]
    drag(canvas, start, (start[0] + 40, start[1] + 20), (start[0] + 80, start[1] + 40))
    assert steps(blank)[-1] == "Move a vertex of land use"
    assert len([place for place in ring(blank, 1) if place in ring(blank, 2)]) == 4
    save_sketch(blank.sketch, tmp_path / "fields.sketch")
    opened = Document(load_sketch(tmp_path / "fields.sketch"))
    assert content_of(opened.sketch.vectors["landuse"]) == content_of(blank.sketch.vectors["landuse"])
    moved = blank.sketch
    for _ in range(5):
        blank.undo()
    assert not len(blank.sketch.vectors["landuse"])
    for _ in range(5):
        blank.redo()
    assert blank.sketch.vectors["landuse"] is moved.vectors["landuse"]


def test_a_new_area_has_a_vertex_where_others_meet_on_its_border():
    squares = [np.array([(x, 0), (x + 8, 0), (x + 8, 8), (x, 8)], float) for x in (0, 8)]
    layer = FeatureTable("landuse").edited(add=[Feature(AREA, (each,)) for each in squares])
    below = Feature(AREA, (np.array([(0.0, 8.0), (16.0, 8.0), (8.0, 20.0)]),))
    (added,) = features.with_feature(Sketch(extent=1280.0, vectors={"landuse": layer}), "landuse", below)
    assert added.feature(3).rings[0].tolist() == [[0, 8], [8, 8], [16, 8], [8, 20]]


def test_areas_are_drawn_below_lines_in_the_colour_of_their_use(canvas, workspace, blank):
    places = ((200, "field"), (400, "meadow"), (600, "forest"), (800, "built_up"))
    square = np.array([(0, 300), (150, 300), (150, 600), (0, 600)], float)
    areas = [Feature(AREA, (np.add(square, (x, 0)),), 1, {"use": use}) for x, use in places]
    lake = Feature(AREA, (np.add(square, (250, 60)),))
    layers = {
        "landuse": FeatureTable("landuse").edited(add=areas),
        "lake": FeatureTable("lake").edited(add=[lake]),
    }
    blank.do("Draw", blank.sketch.replace(vectors=layers))
    workspace.tool = "brush"
    picture = canvas.grab().toImage()
    for x, use in places:
        found, paper = (picture.pixelColor(at(canvas, x + 75, y)) for y in (330, 200))
        assert found.getRgb()[:3] == pytest.approx(over(use, np.array(paper.getRgb()[:3])), abs=3), use
    both, lake_alone = (picture.pixelColor(at(canvas, x, 500)) for x in (280, 380))
    assert both != lake_alone
    assert both.red() < picture.pixelColor(at(canvas, 220, 500)).red()  # the lake is on top
    workspace.tool = "select"
    click(canvas, 300, 500)
    assert workspace.selection == Selection("lake", 1)


def test_the_panel_lists_uses_and_the_page_has_all_properties(workspace, blank, show_widget):
    area = Feature(AREA, (np.array([(0, 0), (100, 0), (100, 100)], float),))
    blank.do("Draw", blank.sketch.replace(vectors={"landuse": FeatureTable("landuse").edited(add=[area])}))
    panel = show_widget(LayersPanel(blank, workspace))
    assert {row.layer: row.detail for row in panel.list.rows}["landuse"] == "use field · 1 drawn"
    page = show_widget(FeaturePage(blank, workspace))
    workspace.selection = Selection("landuse", 1)
    assert list(page.form.rows) == [*("name", "use", "crop", "direction", "parcels", "density", "conifers")]
    assert page.form.rows["direction"].check.isChecked()  # along the contours


def test_many_small_areas_are_drawn_as_squares_and_large_ones_as_they_are(canvas, workspace, blank):
    corner = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), axis=-1).reshape(-1, 1, 2) * 10.0
    squares = corner + (200.0, 200.0) + 10.0 * np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    large = np.array([(700, 700), (1000, 700), (700, 1000)], float)
    areas = [Feature(AREA, (each,), 1, {"use": "forest"}) for each in squares]
    areas.append(Feature(AREA, (large,), 1, {"use": "built_up"}))
    blank.do("Draw", blank.sketch.replace(vectors={"landuse": FeatureTable("landuse").edited(add=areas)}))
    workspace.tool = "brush"
    picture = canvas.grab().toImage()

    def red(x, y):
        return picture.pixelColor(at(canvas, x, y)).red()

    paper = red(100, 100)
    inside = np.array([[red(x, y) for x in range(210, 590, 7)] for y in range(210, 590, 7)])
    expected = over("forest", paper)[0]
    assert np.mean(np.abs(inside - expected) < 3) > 0.75  # squares of whole pixels leave gaps
    assert [red(x, y) for x, y in ((190, 400), (610, 400), (400, 190), (400, 610), (950, 950))] == 5 * [paper]
    assert red(780, 780) == pytest.approx(over("built_up", paper)[0], abs=3)
