"""Mouse, pen and keyboard input of the canvas and its tools."""

from dataclasses import replace

import numpy as np
import pytest
from PyQt6.QtCore import QEvent, QPoint, QPointF, Qt

from sketchterrain.document.sketch import Sketch
from sketchterrain.landforms.placement.heights import built_height, shape_height
from sketchterrain.landforms.placement.shapes import label_shapes
from sketchterrain.ui.canvas.canvas import Canvas
from sketchterrain.ui.canvas.paint_tools import height_text
from sketchterrain.ui.engine.protocol import GoTo, Placement, Relief
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection

from . import events
from .events import LEFT, MIDDLE, RIGHT

SIDE = 128


@pytest.fixture
def blank(qapp):
    return Document(Sketch(layers={"mountain": np.zeros((SIDE, SIDE), np.uint8)}, extent=1280.0))


@pytest.fixture
def canvas(blank, workspace, link, show_widget):
    widget = show_widget(Canvas(blank, workspace, link), 500, 500)
    widget.setFocus()
    workspace.brush = 5.0
    return widget


def at(canvas: Canvas, x: float, y: float) -> QPoint:
    """Return the widget position of a sketch position (px)."""
    place = canvas._context.screen_from_sketch(x, y)
    return QPoint(round(place.x()), round(place.y()))


def drag(canvas: Canvas, *points, button=LEFT):
    places = [at(canvas, *point) for point in points]
    events.drag(canvas, *((place.x(), place.y()) for place in places), button=button)


def move(canvas, place, buttons=events.NO_BUTTON):
    events.mouse(canvas, events.MOVE, place.x(), place.y(), buttons)


def drag_by(canvas, qtbot, start, *offsets, button=LEFT):
    qtbot.mousePress(canvas, button, pos=start)
    for offset in offsets:
        move(canvas, start + QPoint(*offset), button)
    canvas.grab()
    qtbot.mouseRelease(canvas, button, pos=start + QPoint(*offsets[-1]))


def steps(document: Document) -> tuple[str, ...]:
    return document.history.titles[1 : document.history.position + 1]


def test_a_stroke_is_one_step_and_a_click_a_disc(canvas, blank, workspace):
    drag(canvas, (30.0, 30.0), (50.0, 34.0), (70.0, 30.0), (90.0, 60.0))
    assert steps(blank) == ("Paint mountains",)
    image = blank.sketch.layers["mountain"]
    for x, y in ((30, 30), (70, 30), (90, 60)):
        assert image[y, x] == 1
    assert image[100, 100] == 0
    assert 5 * 80 < (image > 0).sum() < 12 * 110
    blank.undo()
    assert not blank.sketch.layers["mountain"].any()

    workspace.brush = 8.0
    drag(canvas, (60.0, 60.0))
    assert (blank.sketch.layers["mountain"] > 0).sum() == pytest.approx(np.pi * 64, rel=0.08)


def test_a_stroke_of_mountains_shows_the_height_asked_for_and_the_one_built(canvas, blank, workspace, qtbot):
    # 10 m a pixel; 300 m are too high for 5 px to either side, not for 34.
    blank.do("Set a height", blank.sketch.replace(labels={("mountain", 1): {"height": 300.0}}))
    tool, radii = canvas._input.tool, (5.0, 34.0)
    texts = []
    for number, radius in enumerate(radii):
        workspace.brush = radius
        qtbot.mousePress(canvas, LEFT, pos=at(canvas, 32.0 + 60.0 * number, 40.0))
        texts.append(height_text(tool._height))
        canvas.grab()
        qtbot.mouseRelease(canvas, LEFT, pos=at(canvas, 32.0 + 60.0 * number, 40.0))
        assert tool._height is None
    built = built_height(300.0, 50.0, 0.8)
    assert texts == [f"300 m asked, {built:.0f} m built", "300 m high"]
    # Beside other paint it is the height of the whole shape.
    workspace.brush = 5.0
    qtbot.mousePress(canvas, LEFT, pos=at(canvas, 92.0, 40.0))
    assert height_text(tool._height) == "300 m high"
    canvas._input._finish()
    workspace.tool = "line"
    drag(canvas, (20.0, 100.0))
    assert height_text(canvas._input.tool._height()) == f"300 m asked, {built:.0f} m built"
    workspace.use_label("river", 1)
    assert canvas._input.tool._height() is None


def test_default_brush_paints_mountains_without_a_warning(canvas, blank, workspace, qtbot):
    blank.open(Sketch())
    workspace.open_brushes(blank.sketch.width_px)
    assert 2.0 * workspace.brush == pytest.approx(0.1 * blank.sketch.width_px)
    drag(canvas, (256.0, 256.0))
    (shape,) = label_shapes("mountain", blank.sketch.layers["mountain"])
    inradius = shape.depth.max() * blank.sketch.pixel_size
    height = shape_height(blank.sketch.properties("mountain", 1), inradius, blank.sketch.fidelity)
    assert height.asked == height.built == pytest.approx(0.7 * 0.05 * blank.sketch.extent, rel=0.05)


def test_each_layer_has_a_brush_of_its_own(workspace):
    workspace.open_brushes(1024)
    assert workspace.brush == 51.2
    workspace.brush = 20.0
    sizes = []
    workspace.brush_changed.connect(sizes.append)
    workspace.use_label("river", 1)
    workspace.use_label("mountain", 2)
    workspace.open_brushes(256)
    assert sizes == [32.0, 20.0, 12.8]


def test_eraser_and_right_button_erase(canvas, blank, workspace):
    drag(canvas, (30.0, 60.0), (100.0, 60.0))
    drag(canvas, (50.0, 40.0), (50.0, 90.0), button=RIGHT)
    assert blank.sketch.layers["mountain"][60, 50] == 0
    assert blank.sketch.layers["mountain"][60, 80] == 1
    workspace.tool = "eraser"
    drag(canvas, (80.0, 40.0), (80.0, 90.0))
    assert blank.sketch.layers["mountain"][60, 80] == 0
    assert steps(blank) == ("Paint mountains", "Erase mountains", "Erase mountains")


def test_strokes_end_by_escape_undo_tool_focus_and_another_document(canvas, blank, qtbot, workspace):
    def press(x, y):
        qtbot.mousePress(canvas, LEFT, pos=at(canvas, x, y))

    def finish(x, y):
        move(canvas, at(canvas, x, y), LEFT)
        qtbot.mouseRelease(canvas, LEFT, pos=at(canvas, x, y))

    press(30.0, 30.0)
    move(canvas, at(canvas, 60.0, 60.0), LEFT)
    assert blank.draft is not None
    qtbot.keyClick(canvas, Qt.Key.Key_Escape)
    assert blank.draft is None
    finish(90.0, 60.0)
    assert steps(blank) == ()
    assert not blank.layer("mountain").any()

    drag(canvas, (30.0, 30.0), (60.0, 30.0))
    press(30.0, 80.0)
    blank.undo()
    finish(60.0, 80.0)
    assert not blank.layer("mountain").any()

    ends = (lambda: setattr(workspace, "tool", "line"), canvas._input._finish, canvas.hide)
    for number, end in enumerate(ends, start=1):
        press(20.0 * number, 30.0)
        end()
        assert steps(blank) == ("Paint mountains",) * number
        workspace.tool = "brush"
        canvas.show()
    press(60.0, 60.0)
    blank.open(Sketch())
    finish(90.0, 60.0)
    assert steps(blank) == ()


def test_painting_on_a_locked_or_hidden_layer_is_refused(canvas, blank, workspace):
    lines: list[str] = []
    blank.message.connect(lines.append)
    for change in ({"locked": True}, {"locked": False, "visible": False}):
        workspace.set_look("mountain", **change)
        for tool in ("brush", "eraser", "line", "fill"):
            workspace.tool = tool
            drag(canvas, (30.0, 30.0), (60.0, 60.0))
    assert steps(blank) == ()
    assert len(lines) == 8
    assert "Mountains are locked" in lines[0]
    assert "Mountains are hidden" in lines[-1]


def test_a_line_by_clicks_double_click_or_freehand(canvas, blank, workspace, qtbot):
    workspace.tool = "line"
    workspace.use_label("hill", 1)
    workspace.brush = 0.6
    for x, y in ((20.0, 20.0), (60.0, 40.0), (110.0, 110.0), (100.0, 30.0)):
        qtbot.mouseClick(canvas, LEFT, pos=at(canvas, x, y))
    assert steps(blank) == ()
    qtbot.keyClick(canvas, Qt.Key.Key_Backspace)
    move(canvas, at(canvas, 90.0, 90.0))
    canvas.grab()
    qtbot.keyClick(canvas, Qt.Key.Key_Return)
    image = blank.sketch.layers["hill"]
    assert steps(blank) == ("Draw a line of hills",)
    for x, y in ((20, 20), (60, 40), (110, 110)):
        assert image[y - 1 : y + 2, x - 1 : x + 2].any()
    assert not image[28:33, 97:104].any()
    assert (image > 0).sum() < 400  # 1.2 px wide
    blank.undo()
    qtbot.mouseClick(canvas, LEFT, pos=at(canvas, 20.0, 20.0))
    qtbot.keyClick(canvas, Qt.Key.Key_Escape)
    assert not canvas._input.tool.is_busy
    qtbot.mouseClick(canvas, LEFT, pos=at(canvas, 20.0, 60.0))
    qtbot.mouseClick(canvas, LEFT, pos=at(canvas, 90.0, 60.0))
    qtbot.mouseDClick(canvas, LEFT, pos=at(canvas, 90.0, 60.0))
    assert steps(blank) == ("Draw a line of hills",)
    assert blank.sketch.layers["hill"][60, 22:88].all()
    blank.undo()
    drag(canvas, (20.0, 20.0), (40.0, 30.0), (60.0, 28.0), (90.0, 50.0))
    assert steps(blank) == ("Draw a line of hills",)
    assert blank.sketch.layers["hill"][48:53, 87:93].any()


def test_fill_and_clear(canvas, blank, workspace, qtbot):
    workspace.tool = "fill"
    qtbot.mouseClick(canvas, LEFT, pos=at(canvas, 64.0, 64.0))
    assert (blank.sketch.layers["mountain"] == 1).all()
    qtbot.mouseClick(canvas, RIGHT, pos=at(canvas, 64.0, 64.0))
    assert not blank.sketch.layers["mountain"].any()
    assert steps(blank) == ("Fill mountains", "Clear a shape of mountains")
    qtbot.mouseClick(canvas, LEFT, pos=QPoint(1, 1))  # outside the sketch
    assert len(steps(blank)) == 2


def test_pick_activates_the_topmost_visible_label(canvas, blank, workspace, qtbot):
    layers = dict(blank.sketch.layers)
    layers["mountain"] = np.full((SIDE, SIDE), 3, np.uint8)
    layers["forest"] = np.full((SIDE, SIDE), 2, np.uint8)
    blank.open(Sketch(layers=layers))
    lines: list[str] = []
    blank.message.connect(lines.append)
    workspace.tool = "pick"
    qtbot.mouseClick(canvas, LEFT, pos=at(canvas, 64.0, 64.0))
    assert (workspace.layer, workspace.label) == ("forest", 2)
    workspace.set_look("forest", visible=False)
    workspace.tool = "brush"
    qtbot.mouseClick(canvas, LEFT, Qt.KeyboardModifier.AltModifier, at(canvas, 64.0, 64.0))
    assert (workspace.layer, workspace.label) == ("mountain", 3)
    assert steps(blank) == ()
    qtbot.mouseClick(canvas, LEFT, Qt.KeyboardModifier.AltModifier, QPoint(1, 1))
    assert lines[-1] == "Nothing is painted or drawn here."


def test_wheel_and_keys_zoom_scroll_and_size_the_brush(canvas, workspace, qtbot):
    place = at(canvas, 40.0, 90.0)
    before, scale = canvas._context.sketch_from_screen(QPointF(place)), canvas.viewport.scale
    events.wheel(canvas, place.x(), place.y(), 1)
    assert canvas.viewport.scale == pytest.approx(1.2 * scale)
    assert canvas._context.sketch_from_screen(QPointF(place)) == pytest.approx(before, abs=0.6 / scale)
    for notches, modifier, brush in (
        (1, Qt.KeyboardModifier.ControlModifier, 5.0 * 1.15),
        (-1, Qt.KeyboardModifier.ShiftModifier, 5.0),
    ):
        events.wheel(canvas, place.x(), place.y(), notches, modifier)
        assert workspace.brush == pytest.approx(brush)
    canvas.fit()
    for key, brush in ((Qt.Key.Key_BracketRight, 6.0), (Qt.Key.Key_BracketLeft, 5.0)):
        qtbot.keyClick(canvas, key)
        assert workspace.brush == pytest.approx(brush)
    left, scale = canvas.viewport.left, canvas.viewport.scale
    qtbot.keyClick(canvas, Qt.Key.Key_Right)
    assert canvas.viewport.left == left - 64
    qtbot.keyClick(canvas, Qt.Key.Key_Plus)
    assert canvas.viewport.scale > scale
    qtbot.keyClick(canvas, Qt.Key.Key_Home)
    assert canvas.viewport.scale == pytest.approx(scale)


def test_keys_of_the_canvas_override_shortcuts(canvas, workspace, qtbot):
    assert events.overrides(canvas, Qt.Key.Key_BracketLeft)
    assert not events.overrides(canvas, Qt.Key.Key_B)
    assert not events.overrides(canvas, Qt.Key.Key_Escape)
    assert not events.overrides(canvas, Qt.Key.Key_Plus, Qt.KeyboardModifier.ControlModifier)
    qtbot.mousePress(canvas, LEFT, pos=at(canvas, 60.0, 60.0))
    assert events.overrides(canvas, Qt.Key.Key_Escape)
    qtbot.mouseRelease(canvas, LEFT, pos=at(canvas, 60.0, 60.0))
    assert not events.overrides(canvas, Qt.Key.Key_Escape)


def test_middle_button_space_and_hand_tool_pan(canvas, blank, workspace, qtbot):
    def moved(button: Qt.MouseButton) -> tuple[int, int]:
        canvas.fit()
        left, top = canvas.viewport.left, canvas.viewport.top
        drag_by(canvas, qtbot, QPoint(200, 200), (30, -20), button=button)
        return canvas.viewport.left - left, canvas.viewport.top - top

    assert moved(MIDDLE) == (30, -20)
    qtbot.keyPress(canvas, Qt.Key.Key_Space)
    assert moved(LEFT) == (30, -20)
    qtbot.keyRelease(canvas, Qt.Key.Key_Space)
    assert moved(LEFT) == (0, 0)
    workspace.tool = "pan"
    assert moved(LEFT) == (30, -20)
    assert steps(blank) == ("Paint mountains",)


def test_pen_pressure_scales_the_brush_and_its_eraser_erases(canvas, blank, workspace):
    workspace.brush = 16.0

    def dab(x: float, y: float, pressure: float, *, erases: bool = False) -> int:
        place = at(canvas, x, y)
        for kind in (QEvent.Type.TabletPress, QEvent.Type.TabletRelease):
            assert events.pen(canvas, kind, place.x(), place.y(), pressure, erases=erases)
        return int((blank.sketch.layers["mountain"] > 0).sum())

    light = dab(30.0, 30.0, 0.0)
    assert dab(90.0, 90.0, 1.0) - light > 5 * light > 0
    dab(90.0, 90.0, 0.6, erases=True)
    assert blank.sketch.layers["mountain"][90, 90] == 0


def test_position_and_height_under_the_mouse_are_reported(canvas, link):
    places: list[object] = []
    canvas.hovered.connect(places.append)
    move(canvas, at(canvas, 64.0, 32.0))
    x, y, height = places[-1]
    assert (x, y) == pytest.approx((640.0, 960.0), abs=5.0)
    assert height is None
    rise = np.arange(SIDE * SIDE, dtype=np.float32).reshape(SIDE, SIDE)
    link.relief = Relief(1, 1, rise, np.zeros((SIDE, SIDE), np.uint8))
    move(canvas, at(canvas, 64.5, 32.5))
    assert places[-1][2] == pytest.approx(rise[32, 64])
    move(canvas, QPoint(2, 2))
    assert places[-1] is None


@pytest.fixture
def full(workspace, document, link, placed, show_widget):
    """A canvas of the preset valley_river with its placed features."""
    link.placed = replace(placed, resolutions=(("resolved", 3000.0, 3000.0),))
    widget = show_widget(Canvas(document, workspace, link), 600, 600)
    widget.setFocus()
    workspace.tool = "select"
    return widget


def mountain(placed: Placement) -> np.void:
    tall = placed.points[(placed.points["type"] == 0) & placed.points["painted"]]
    return tall[np.argmax(tall["strength"])]


def screen_position(canvas: Canvas, x: float, y: float) -> QPoint:
    place = canvas._context.screen_from_world(float(x), float(y))
    return QPoint(round(place.x()), round(place.y()))


def test_a_drag_moves_a_feature_in_one_step_and_escape_reverts_it(full, document, placed, qtbot, workspace):
    peak = mountain(placed)
    start = screen_position(full, peak["x"], peak["y"])
    qtbot.mousePress(full, LEFT, pos=start)
    move(full, start + QPoint(40, 20), LEFT)
    assert document.sketch.edits
    qtbot.keyClick(full, Qt.Key.Key_Escape)
    assert document.sketch.edits == ()
    qtbot.mouseRelease(full, LEFT, pos=start + QPoint(40, 20))
    assert document.sketch.edits == ()

    drag_by(full, qtbot, start, *((4 * k, 2 * k) for k in range(1, 11)))
    assert steps(document) == ("Move mountain",)
    (edit,) = document.sketch.edits
    pixel = 1.0 / full._context.px_per_metre
    expected = (peak["x"] + 40 * pixel, peak["y"] - 20 * pixel)
    assert (edit.x, edit.y) == pytest.approx(expected, abs=1.5 * pixel)
    document.undo()
    assert document.sketch.edits == ()


def test_handles_resize_widen_and_move_points(full, document, workspace, placed, qtbot):
    peak, river = mountain(placed), placed.rivers[0]
    workspace.selection = Selection("feature", int(peak["id"]))
    drag_handle(full, qtbot, placed, "radius", (20, 0))
    assert steps(document)[-1] == "Resize mountain"
    workspace.selection = Selection("course", river.id)
    full.grab()
    drag_handle(full, qtbot, placed, "width", (6, 6))
    assert steps(document)[-1].startswith("Set the width of river")
    workspace.selection = Selection("course", river.id)
    drag_handle(full, qtbot, placed, "point", (15, 9))
    assert steps(document)[-1].startswith("Move a point of river")
    assert workspace.selection.index is not None
    assert len(steps(document)) == 3


def drag_handle(canvas: Canvas, qtbot, placed, role, offset):
    handles = [each for each in canvas._input.tool._handles() if each.role == role]
    handle = handles[len(handles) // 2]
    place = canvas._input.tool._handle_place(handle)
    drag_by(canvas, qtbot, QPoint(round(place.x()), round(place.y())), offset)


def test_delete_deletes_and_escape_deselects(full, document, workspace, placed, qtbot):
    peak = mountain(placed)
    workspace.selection = Selection("feature", int(peak["id"]))
    qtbot.keyClick(full, Qt.Key.Key_Escape)
    assert workspace.selection is None
    workspace.selection = Selection("feature", int(peak["id"]))
    qtbot.keyClick(full, Qt.Key.Key_Delete)
    assert workspace.selection is None
    assert steps(document) == ("Delete mountain",)
    assert document.sketch.edits[0].action == "delete"


def test_hovering_highlights_clicks_select_and_double_clicks_move_the_view(
    full, placed, workspace, qtbot, link
):
    peak = mountain(placed)
    before = full.grab().toImage()
    move(full, screen_position(full, peak["x"], peak["y"]))
    assert full.cursor().shape() == Qt.CursorShape.PointingHandCursor
    assert full.grab().toImage() != before
    full._input._leave(None)
    assert full.grab().toImage() == before

    qtbot.mouseClick(full, LEFT, pos=screen_position(full, peak["x"], peak["y"]))
    assert workspace.selection == Selection("feature", int(peak["id"]))
    full.grab()
    qtbot.mouseClick(full, LEFT, pos=QPoint(1, 1))
    assert workspace.selection is None

    for tool in ("select", "pan"):
        full._context.workspace.tool = tool
        qtbot.mouseDClick(full, LEFT, pos=screen_position(full, 2000.0, 1500.0))
        qtbot.mouseRelease(full, LEFT, pos=screen_position(full, 2000.0, 1500.0))
        request = link.requests[-1]
        assert isinstance(request, GoTo)
        assert (request.x, request.y) == pytest.approx((2000.0, 1500.0), abs=12.0)


def test_a_drag_on_nothing_pans(full, document, qtbot):
    full.zoom(1.0, QPointF(300.0, 300.0))
    left = full.viewport.left
    drag_by(full, qtbot, QPoint(3, 3), (30, 0))
    assert full.viewport.left == left + 30
    assert steps(document) == ()
