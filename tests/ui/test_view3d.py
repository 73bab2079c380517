"""The 3-D view: input, pictures, selection and handles."""

from dataclasses import replace

import numpy as np
import pytest
from PyQt6.QtCore import QEvent, QRectF, Qt
from PyQt6.QtGui import QColor, QFocusEvent, QImage
from PyQt6.QtWidgets import QApplication, QLabel, QPushButton, QToolButton

from sketchterrain.features.table import LINE, Feature, FeatureTable
from sketchterrain.geometry.camera import Camera
from sketchterrain.ui.actions import ContextMenu
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.protocol import Fly, GoTo, Look, Pan, PickRequest, PickResult, Turn, Zoom
from sketchterrain.ui.models.workspace import Selection
from sketchterrain.ui.view3d import view as view_module
from sketchterrain.ui.view3d.camera import overview
from sketchterrain.ui.view3d.hud import Compass, ModeBar, Placeholder
from sketchterrain.ui.view3d.view import View3D

from . import events
from .events import DOUBLE, MOVE, PRESS, RELEASE, RIGHT, click, drag, key, mouse, overrides, wheel

WIDTH, HEIGHT = 640, 480
SHIFT = Qt.KeyboardModifier.ShiftModifier


def show_picture(link, document, placed, *, eye=None, target=None):
    """Set a picture of flat terrain, seen from the south, as the engine's newest."""
    east, north = document.sketch.size
    eye, target = eye or (east / 2, -0.3 * north, 0.6 * north), target or (east / 2, north / 2, 0.0)
    flat = np.zeros((document.sketch.height_px // 4, document.sketch.width_px // 4), np.float32)
    link.placed = placed
    link.relief = msg.Relief(1, 4, flat, np.zeros(flat.shape, np.uint8))
    link.picture = QImage(WIDTH, HEIGHT, QImage.Format.Format_RGB32)
    link.picture.fill(QColor(60, 90, 50))
    pose = Camera(eye, target, fov=50.0, near=1.0, far=1e5)
    link.frame = msg.FrameFacts(WIDTH, HEIGHT, 1, pose, 0.05, 0.01, 9, 900, True, 1 << 20)
    link.placed_changed.emit(placed)
    link.relief_changed.emit(link.relief)
    link.frame_shown.emit(link.frame)


@pytest.fixture
def bare(show_widget, document, workspace, link):
    """A view before the first picture."""
    return show_widget(View3D(document, workspace, link), WIDTH, HEIGHT)


@pytest.fixture
def view(qtbot, bare, document, link, placed):
    show_picture(link, document, placed)
    qtbot.waitUntil(lambda: link.view.width > 0)
    link.requests.clear()
    return bare


def motions(link):
    return [each for each in link.requests if not isinstance(each, PickRequest)]


def handle(view, role):
    return next(each for each in marks(view).handles if each.handle.role == role)


def answer(link, place):
    """Answer the newest pick as the engine does."""
    link.picked.emit(PickResult(link.requests[-1].token, place))


def place_of(point):
    return float(point["x"]), float(point["y"]), 0.0


def double_click(view, x, y):
    mouse(view, DOUBLE, x, y)
    mouse(view, RELEASE, x, y)


def marks(view):
    return view._scene.marks(view.width(), view.height())


def test_drags_orbit_pan_and_look_around(view, link):
    drag(view, (300, 200), (310, 200), (330, 230))
    assert motions(link) == [Turn(pytest.approx(-3.0), 0.0), Turn(pytest.approx(-6.0), pytest.approx(9.0))]
    for button, modifiers in [(RIGHT, events.NO_KEYS), (events.MIDDLE, events.NO_KEYS), (events.LEFT, SHIFT)]:
        link.requests.clear()
        drag(view, (300, 200), (348, 200), (348, 248), button=button, modifiers=modifiers)
        assert motions(link) == [Pan(-0.1, 0.0), Pan(0.0, 0.1)], (button, modifiers)
    link.requests.clear()
    link.view = replace(link.view, mode="fly")
    drag(view, (300, 200), (400, 200), (400, 160))
    assert motions(link) == [Turn(15.0, 0.0), Turn(0.0, 6.0)]


def test_clicks_pick_wheels_zoom_and_double_clicks_centre(view, link):
    wheel(view, 160, 120, 1)
    wheel(view, 480, 360, -2)
    expected = [Zoom(pytest.approx(0.85), 0.25, 0.25), Zoom(pytest.approx(0.85**-2), 0.75, 0.75)]
    assert link.requests == expected
    link.requests.clear()
    drag(view, (300, 200), (302, 201))
    assert [type(each) for each in link.requests] == [PickRequest]

    click(view, 320, 240)
    link.requests.clear()
    double_click(view, 320, 240)
    (pick,) = link.requests
    assert pick == PickRequest(pick.token, 0.5, 0.5)
    answer(link, (10.0, 20.0, 5.0))
    assert link.requests[-1] == GoTo(10.0, 20.0)
    double_click(view, 320, 10)
    answer(link, None)
    assert isinstance(link.requests[-1], PickRequest), "the sky is not centred"


def test_the_newest_click_selects_and_the_sky_clears(view, link, workspace, placed):
    point = placed.points[placed.points["painted"]][0]
    click(view, 320, 240)
    answer(link, place_of(point))
    assert workspace.selection == Selection("feature", int(point["id"]))
    click(view, 5, 5)
    answer(link, None)
    assert workspace.selection is None

    points = placed.points[placed.points["painted"]][:2]
    click(view, 320, 240)
    old = link.requests[-1].token
    click(view, 330, 240)
    new = link.requests[-1].token
    for token, point in ((new, points[1]), (old, points[0])):
        link.picked.emit(PickResult(token, place_of(point)))
    assert workspace.selection == Selection("feature", int(points[1]["id"]))


@pytest.fixture
def selection(view, workspace, placed):
    painted = placed.points[placed.points["painted"] & (placed.points["type"] == 0)]
    workspace.selection = Selection("feature", int(painted["id"][np.argmax(painted["radius"])]))
    return workspace.selection


def test_escape_cancels_a_drag_then_the_selection(view, document, workspace, selection):
    mark = handle(view, "move")
    mouse(view, PRESS, mark.x, mark.y)
    mouse(view, MOVE, mark.x + 50, mark.y)
    assert document.sketch.edits
    key(view, Qt.Key.Key_Escape)
    assert not document.is_modified
    mouse(view, MOVE, mark.x + 90, mark.y)
    assert document.sketch.edits == ()
    mouse(view, RELEASE, mark.x + 90, mark.y)
    key(view, Qt.Key.Key_Escape)
    assert workspace.selection is None
    assert not overrides(view, Qt.Key.Key_Escape)


def test_handles_follow_the_mouse_and_a_drag_is_one_undo_step(view, document, selection, link):
    mark = handle(view, "radius")
    drag(view, (mark.x, mark.y), (mark.x + 30, mark.y))
    assert document.history.titles == ("Open", "Resize mountain")
    before = np.hypot(mark.handle.x - mark.handle.base_x, mark.handle.y - mark.handle.base_y)
    assert document.sketch.edits[-1].radius > before
    document.undo()
    mark = handle(view, "move")
    drag(view, (mark.x + 3, mark.y), *[(mark.x + 3 + 8 * step, mark.y + 4 * step) for step in range(1, 11)])
    assert document.history.titles == ("Open", "Move mountain")
    assert motions(link) == [], "the camera does not move"
    edit = document.sketch.edits[-1]
    projection = view._scene.projection(view.width(), view.height())
    at = projection.project([[edit.x, edit.y, 0.0]]).pixels[0]
    assert at == pytest.approx([mark.x + 80, mark.y + 40], abs=1.5)
    document.undo()
    assert document.sketch.edits == ()


def test_a_dropped_handle_stays_until_it_is_placed(view, link, document, selection, placed):
    mark = handle(view, "move")
    drag(view, (mark.x, mark.y), (mark.x + 40, mark.y + 10))
    assert handle(view, "move").x == pytest.approx(mark.x + 40, abs=1.0)
    points = placed.points.copy()
    at = points["id"] == selection.id
    points["x"][at], points["y"][at] = document.sketch.edits[-1].x, document.sketch.edits[-1].y
    link.placed = replace(placed, points=points)
    link.placed_changed.emit(link.placed)
    assert view._scene.drag is None
    assert handle(view, "move").x == pytest.approx(mark.x + 40, abs=1.0)


def test_river_points_are_dragged_and_reset(view, document, workspace, placed):
    workspace.selection = Selection("course", placed.rivers[0].id)
    points = (each for each in marks(view).handles if each.handle.role == "point")
    mark = next(each for each in points if 100 < each.y < 400)
    drag(view, (mark.x, mark.y), (mark.x + 20, mark.y))
    assert workspace.selection == mark.handle.selection
    assert workspace.selection.index is not None
    assert [each.action for each in document.sketch.edits] == ["move_point"]
    key(view, Qt.Key.Key_Delete)
    assert document.sketch.edits == ()
    lines = []
    document.message.connect(lines.append)
    key(view, Qt.Key.Key_Delete)
    assert "cannot be deleted" in lines[0]
    workspace.selection = Selection("feature", int(placed.points["id"][0]))
    for _ in range(2):
        key(view, Qt.Key.Key_Delete)
        assert [each.action for each in document.sketch.edits] == ["delete"]
        assert workspace.selection is None


def test_right_click_opens_the_context_menu(view, link, document, workspace, placed):
    point = placed.points[placed.points["painted"] & (placed.points["type"] == 0)][0]
    for text, action in (("Lock mountain", "lock"), ("Hill", "add"), ("Delete mountain", "delete")):
        click(view, 320, 240, RIGHT)
        answer(link, place_of(point))
        assert workspace.selection == Selection("feature", int(point["id"]))
        (menu,) = (each for each in view.findChildren(ContextMenu) if each.isVisible())
        actions = [
            *menu.actions(),
            *(each for inner in menu.findChildren(ContextMenu) for each in inner.actions()),
        ]
        next(each for each in actions if each.text() == text).trigger()
        menu.close()
        assert document.sketch.edits[-1].action == action
    assert workspace.selection is None
    click(view, 320, 10, RIGHT)
    answer(link, None)
    assert not [each for each in view.findChildren(ContextMenu) if each.isVisible()]


def test_the_select_tool_selects_marks(view, link, workspace, placed):
    assert marks(view).dots == ()
    workspace.tool = "select"
    dot = next(each for each in marks(view).dots if 60 < each.y < 400)
    link.requests.clear()
    click(view, dot.x, dot.y)
    assert workspace.selection == dot.selection
    assert link.requests == []


def test_flight_keys_move_until_released_or_focus_is_lost(view, link):
    keys = Qt.Key
    key(view, keys.Key_W)
    key(view, keys.Key_W, repeat=True)
    for code, up in ((keys.Key_D, False), (keys.Key_Shift, False), (keys.Key_W, True), (keys.Key_D, True)):
        key(view, code, up=up)
    key(view, keys.Key_Shift, up=True)
    both, fast = Fly(forward=1.0, right=1.0), Fly(forward=1.0, right=1.0, boost=4.0)
    assert motions(link) == [Fly(forward=1.0), both, fast, replace(fast, forward=0.0), Fly()]
    link.requests.clear()
    for code in (keys.Key_Up, keys.Key_Q):
        key(view, code)
    QApplication.sendEvent(view, QFocusEvent(QEvent.Type.FocusOut))
    for code in (keys.Key_A, keys.Key_D):
        key(view, code)
    forward = Fly(forward=1.0)
    assert motions(link) == [forward, replace(forward, up=-1.0), Fly(), Fly(right=-1.0), Fly()]


def test_view_keys_override_shortcuts_without_control(view):
    keys = Qt.Key
    for code in (keys.Key_W, keys.Key_E, keys.Key_F, keys.Key_1, keys.Key_Delete, keys.Key_R):
        assert overrides(view, code)
        assert not overrides(view, code, Qt.KeyboardModifier.ControlModifier)
    assert overrides(view, keys.Key_W, SHIFT)
    assert not overrides(view, keys.Key_B)


def test_home_shows_everything_and_f_the_selection(view, link, document, workspace, selection, placed):
    for code in (Qt.Key.Key_Home, Qt.Key.Key_F):
        key(view, code)
    point = placed.points[placed.points["id"] == selection.id][0]
    assert link.requests[0] == Look(overview((0.0, 0.0, *document.sketch.size), 0.0, aspect=WIDTH / HEIGHT))
    assert (link.requests[1].x, link.requests[1].y) == (point["x"], point["y"])
    assert 2.0 * point["radius"] < link.requests[1].distance < 6.0 * point["radius"]
    workspace.selection = Selection("course", placed.rivers[0].id)
    key(view, Qt.Key.Key_F)
    assert 0.0 <= link.requests[2].x <= document.sketch.size[0]
    workspace.selection = None
    for code in (Qt.Key.Key_F, Qt.Key.Key_C):
        key(view, code)
    assert link.requests[3:] == [link.requests[0], Look(None)]


def test_compass_and_modes_follow_keys_and_buttons(view, link, document, placed):
    compass = view.findChildren(Compass)[0]
    show_picture(link, document, placed, eye=(0.0, 0.0, 100.0), target=(500.0, 500.0, 0.0))
    assert compass.heading == pytest.approx(45.0)
    for mode, turn in (("orbit", 45.0), ("walk", -45.0)):
        link.view = replace(link.view, mode=mode)
        compass.click()
        assert link.requests[-1] == Turn(pytest.approx(turn), 0.0)
    bar = view.findChildren(ModeBar)[0]
    buttons = {each.accessibleName(): each for each in bar.findChildren(QToolButton)}
    for code, mode in ((Qt.Key.Key_2, "fly"), (Qt.Key.Key_3, "walk"), (Qt.Key.Key_1, "orbit")):
        key(view, code)
        assert link.view.mode == mode
        assert buttons[mode.capitalize()].isChecked()
    buttons["Walk"].click()
    assert link.view.mode == "walk"


def test_pictures_are_requested_after_resizing_and_not_while_hidden(qtbot, view, link, monkeypatch):
    def sizes():
        return [(each.width, each.height) for each in link.requests if isinstance(each, msg.ViewState)]

    monkeypatch.setattr(view_module, "_RESIZE_DELAY", 600_000)
    for width in range(500, 590, 10):
        view.resize(width, 400)
        QApplication.processEvents()
    assert sizes() == []
    monkeypatch.undo()
    view.resize(590, 400)
    qtbot.waitUntil(lambda: link.view.width == 590)
    assert sizes() == [(590, 400)]
    key(view, Qt.Key.Key_W)
    view.hide()
    assert (link.view.width, link.view.height) == (0, 0)
    assert Fly() in link.requests
    view.show()
    qtbot.waitUntil(lambda: link.view.width == 590)


def test_pictures_fill_the_view_sharp_and_undistorted(view, link):
    pixels = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    pixels[::2, ::2, :3] = 255
    link.picture = QImage(pixels.tobytes(), WIDTH, HEIGHT, QImage.Format.Format_RGB32).copy()
    link.frame_shown.emit(link.frame)
    image = view.grab().toImage()
    assert image.devicePixelRatio() == 1.0
    assert [image.pixelColor(x, 240).lightness() for x in range(300, 308)] == [255, 0] * 4
    view.resize(800, 480)
    place = view._scene.picture_rectangle(800, 480)
    assert place.width() / place.height() == pytest.approx(WIDTH / HEIGHT)
    assert place.contains(QRectF(0, 0, 800, 480))
    assert view._scene.projection(800, 480).picture_fraction(400, 240) == pytest.approx((0.5, 0.5))


def texts(view) -> str:
    card = view.findChildren(Placeholder)[0]
    return "" if card.isHidden() else "\n".join(each.text() for each in card.findChildren(QLabel))


def test_the_placeholder_shows_driver_errors_and_fits(bare, link, document, placed):
    def reported(**facts: str) -> str:
        link.facts = msg.EngineFacts(**facts)
        link.facts_changed.emit(link.facts)
        return texts(bare)

    placeholder = bare.findChildren(Placeholder)[0]
    assert "install mesa" in reported(device="cpu", opengl_error="no OpenGL 4.3: install mesa's drivers")
    assert bare.findChildren(ModeBar)[0].isHidden()
    placeholder.findChildren(QPushButton)[0].click()
    assert link.running
    assert "install pocl" in reported(device_error="no OpenCL device: install pocl")
    reported(opengl_error="a rather long reason that needs some lines in such a small view " * 2)
    for size in ((160, 120), (300, 200), (900, 700)):
        bare.resize(*size)
        assert bare.rect().contains(placeholder.geometry())

    reported(device="cpu")
    show_picture(link, document, placed)
    assert texts(bare) == ""
    assert not placeholder._clock.isActive()


def test_a_stopped_engine_can_be_restarted(view, link, document, placed):
    link.error_reported.emit(msg.ErrorReport("engine", "it crashed (signal 11)"))
    assert "signal 11" in texts(view)
    view.grab()
    view.findChildren(Placeholder)[0].findChildren(QPushButton)[0].click()
    assert link.running
    assert texts(view) == ""
    link.error_reported.emit(msg.ErrorReport("engine", "again"))
    show_picture(link, document, placed)
    assert texts(view) == ""
    link.error_reported.emit(msg.ErrorReport("sketch", "a river has no end"))
    assert texts(view) == ""


def test_every_selection_and_viewpoint_can_be_painted(view, link, document, workspace, placed):
    workspace.tool = "select"
    workspace.selection = Selection("course", placed.rivers[0].id)
    x, y, z = placed.rivers[0].centreline[40]
    for eye, target in (
        ((x, y, z + 2.0), (x + 10.0, y, z)),
        ((x, y, z - 50.0), (x, y + 500.0, z + 10)),
        ((-9e4, 0.0, 10.0), (-1e5, 0.0, 10.0)),
        ((x, y, 5000.0), (x, y + 0.1, 0.0)),
    ):
        show_picture(link, document, placed, eye=eye, target=target)
        assert not view.grab().isNull()
    lake, unknown = Selection("water", placed.lakes[0].id), Selection("feature", 1)
    for selection in (None, lake, replace(workspace.selection, index=3), unknown):
        workspace.selection = selection
        assert not view.grab().isNull()
    for name in ("relief", "placed"):
        setattr(link, name, None)
        assert not view.grab().isNull()


def test_ways_follow_the_drag_of_their_node_and_get_vertices_in_the_view(
    view, link, document, workspace, placed
):
    lines = {"road": [(800, 900), (1000, 1000), (1200, 900)], "path": [(1000, 1000), (1000, 1400)]}
    layers = {
        name: FeatureTable(name).edited(add=[Feature(LINE, (np.array(points, float),))])
        for name, points in lines.items()
    }
    document.open(document.sketch.replace(vectors=layers), modified=True)
    workspace.selection = Selection("road", 1)
    mark = marks(view).handles[1]
    mouse(view, PRESS, mark.x, mark.y)
    for step in (15, 30):
        mouse(view, MOVE, mark.x + step, mark.y)
        road, path = (document.sketch.vectors[name].vertices for name in lines)
        assert road[1].tolist() == path[0].tolist()
        assert marks(view).handles[1].x == pytest.approx(mark.x + step, abs=1.0)
        assert marks(view).outline
    mouse(view, RELEASE, mark.x + 30, mark.y)
    assert document.history.titles == ("Open", "Move a vertex of roads")
    document.undo()
    mouse(view, DOUBLE, 320, 240)
    mouse(view, RELEASE, 320, 240)
    answer(link, (1000.0, 1200.0, 0.0))
    assert isinstance(link.requests[-1], GoTo), "no part of the selected road"
    mouse(view, DOUBLE, 320, 240)
    mouse(view, RELEASE, 320, 240)
    answer(link, (900.0, 950.0, 0.0))
    assert len(document.sketch.vectors["road"].vertices) == 4
    assert workspace.selection == Selection("road", 1, 1)


def test_what_is_drawn_under_a_pixel_is_picked_before_what_is_near(view, link, document, workspace):
    texel = view._scene.projection(view.width(), view.height()).metres_per_px((800.0, 600.0, 0.0))
    added = {"river": (600.0, {"width": 4.0 * texel}), "road": (600.0 + 6.0 * texel, {"width": texel})}
    layers = {
        name: FeatureTable(name).edited(
            add=[Feature(LINE, (np.array([(200.0, y), (1400.0, y)]),), 1, properties)]
        )
        for name, (y, properties) in added.items()
    }
    document.open(document.sketch.replace(vectors=layers), modified=True)
    for off, expected in ((1.5, "river"), (3.0, "river"), (5.0, "road"), (6.0, "road")):
        workspace.selection = None
        click(view, 320, 240)
        answer(link, (800.0, 600.0 + off * texel, 0.0))
        assert workspace.selection == Selection(expected, 1), off


def test_vertices_of_a_vector_are_dragged_in_one_step(view, link, document, workspace, placed):
    places = np.array([(800.0, 900.0), (1000.0, 1000.0), (1200.0, 900.0)])
    lines = [Feature(LINE, (part,)) for part in (places, places[[2, 0]] - (0.0, 300.0))]
    document.open(
        document.sketch.replace(vectors={"river": FeatureTable("river").edited(add=lines)}), modified=True
    )
    click(view, 320, 240)
    answer(link, (900.0, 950.0, 0.0))
    assert workspace.selection == Selection("river", 1)
    roles = [each.handle.role for each in marks(view).handles]
    assert roles == [*["point"] * 3, *["corner"] * 4, "rotate", "move", "width"]
    mark = marks(view).handles[1]
    mouse(view, PRESS, mark.x, mark.y)
    mouse(view, MOVE, mark.x + 30, mark.y)
    dragged = marks(view)
    assert dragged.handles[1].x == pytest.approx(mark.x + 30, abs=1.0)
    assert np.abs(dragged.outline[0].pixels[:, 2] - mark.x - 30).min() < 1.0
    assert len(document.history.titles) == 1
    mouse(view, RELEASE, mark.x + 30, mark.y)
    assert document.history.titles == ("Open", "Move a vertex of rivers")
    assert document.sketch.vectors["river"].feature(1).rings[0][1, 0] > 1000.0
    assert workspace.selection == Selection("river", 1, 1)
    view.grab()
    key(view, Qt.Key.Key_F)
    assert isinstance(link.requests[-1], GoTo)
    key(view, Qt.Key.Key_Delete)
    assert len(document.sketch.vectors["river"].feature(1).rings[0]) == 2
    click(view, 320, 240, RIGHT)
    answer(link, (1000.0, 600.0, 0.0))
    (menu,) = (each for each in view.findChildren(ContextMenu) if each.isVisible())
    next(each for each in menu.actions() if each.text() == "Reverse line").trigger()
    menu.close()
    assert document.sketch.vectors["river"].feature(2).rings[0][0].tolist() == [800.0, 600.0]
