"""Camera controller: continuous mode changes, damped motion, no camera below terrain."""

import numpy as np
import pytest

from sketchterrain.geometry.camera import Camera
from sketchterrain.ui.engine.camera_controller import CameraController
from sketchterrain.ui.engine.protocol import Fly, GoTo, Pan, Turn, Zoom

ASPECT = 1.6
EXTENT = 4000.0


class Hills:
    """An analytic terrain."""

    sea_level = None
    extent = EXTENT
    size = (EXTENT, 3000.0)

    lift = 0.0

    def heights(self, x, y, *, cell_size=0.0):
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        return (self.lift + 80.0 * np.sin(x / 300.0) * np.cos(y / 400.0)).astype(np.float32)


@pytest.fixture
def terrain():
    return Hills()


def create(terrain, aspect=ASPECT):
    controller = CameraController(terrain, aspect=aspect)
    controller.advance(0.016)
    return controller


@pytest.fixture
def controller(terrain):
    return create(terrain)


def advance(controller, steps):
    for _ in range(steps):
        controller.advance(0.016)


def rest(controller, seconds=20.0):
    """Advance until the camera rests."""
    for _ in range(round(seconds / 0.016)):
        controller.advance(0.016)
        if not controller.restless:
            return
    raise AssertionError("still moving")


def distance(controller):
    camera = controller.camera()
    return float(np.linalg.norm(np.subtract(camera.target, camera.eye)))


def test_the_first_view_shows_most_of_the_sketch_and_the_horizon(terrain):
    for aspect in [0.7, 1.0, 1.6, 2.4]:
        controller = create(terrain, aspect)
        camera = controller.camera()
        to_clip = camera.to_clip(aspect)
        assert controller.pick(0.5, 0.01, aspect=aspect) is None, aspect
        for place in ((200, 1500), (3800, 1500), (2000, 600), (2000, 3000), (2000, 1500)):
            clip = to_clip @ [*np.subtract((*place, 0.0), camera.eye), 1.0]
            assert abs(clip[0]) < clip[3], aspect
            assert abs(clip[1]) < clip[3], aspect


def test_a_turn_keeps_the_distance_and_comes_to_rest(controller):
    rest(controller)
    camera = controller.camera()
    assert not controller.advance(1.0)
    assert controller.camera() is camera

    before = distance(controller)
    controller.handle(Turn(90.0, 5.0), aspect=ASPECT)
    assert controller.restless
    assert controller.advance(0.05)
    rest(controller)
    assert distance(controller) == pytest.approx(before, rel=1e-3)
    assert controller.camera().eye[0] > 3500.0  # east of the target


def test_a_zoom_keeps_the_position_under_the_mouse(controller):
    place = controller.pick(0.3, 0.7, aspect=ASPECT)
    before = distance(controller)
    controller.handle(Zoom(0.4, 0.3, 0.7), aspect=ASPECT)
    rest(controller)
    assert distance(controller) == pytest.approx(0.4 * before, rel=1e-3)
    assert np.allclose(controller.pick(0.3, 0.7, aspect=ASPECT), place, atol=5.0)


def test_pan_and_keys_move_the_pivot_over_the_ground(controller):
    before = np.array(controller.camera().target)
    controller.handle(Pan(0.0, 0.2), aspect=ASPECT)
    rest(controller)
    north = np.array(controller.camera().target)
    assert north[1] > before[1] + 100.0
    controller.handle(Fly(right=1.0), aspect=ASPECT)
    advance(controller, 30)
    assert controller.restless  # as long as the key is down
    assert controller.camera().target[0] > north[0] + 100.0
    controller.handle(Fly(), aspect=ASPECT)
    rest(controller)


def test_changing_the_mode_keeps_the_camera(terrain):
    for modes in [("fly",), ("fly", "orbit"), ("fly", "orbit", "fly"), ("orbit", "fly", "orbit")]:
        controller = create(terrain)
        controller.handle(Turn(35.0, -10.0), aspect=ASPECT)
        rest(controller)
        before = controller.camera()
        for mode in modes:
            controller.set_mode(mode)
            controller.advance(0.016)
            camera = controller.camera()
            assert np.allclose(camera.eye, before.eye, atol=0.5), modes
            assert np.allclose(camera.forward, before.forward, atol=1e-3), modes


def test_walking_descends_to_eye_height_and_stays_above_terrain(controller, terrain):
    controller.set_mode("walk")
    rest(controller)
    x, y, z = controller.camera().eye
    assert z - terrain.heights(x, y) == pytest.approx(1.7, abs=0.3)
    controller.handle(Fly(forward=1.0, boost=20.0), aspect=ASPECT)
    for _ in range(200):
        controller.advance(0.016)
        x, y, z = controller.camera().eye
        assert z > terrain.heights(x, y) + 0.5


def test_go_to_glides_to_a_distance_and_looks_at_the_target(terrain):
    for mode in ["orbit", "fly"]:
        controller = create(terrain)
        controller.set_mode(mode)
        controller.advance(0.016)
        controller.handle(GoTo(1200.0, 2000.0, 900.0), aspect=ASPECT)
        controller.advance(0.05)
        halfway = np.array(controller.camera().eye)
        rest(controller)
        camera = controller.camera()
        place = np.array([1200.0, 2000.0, float(terrain.heights(1200.0, 2000.0))])
        assert np.linalg.norm(np.subtract(camera.eye, place)) == pytest.approx(900.0, rel=0.01), mode
        assert camera.forward @ (place - camera.eye) / np.linalg.norm(place - camera.eye) > 0.9999, mode
        assert np.linalg.norm(halfway - camera.eye) > 10.0, mode


def test_flying_moves_forward_and_zooms_towards_the_mouse(controller):
    controller.set_mode("fly")
    start, forward = np.array(controller.camera().eye), controller.camera().forward
    controller.handle(Fly(forward=1.0), aspect=ASPECT)
    advance(controller, 20)
    motion = np.array(controller.camera().eye) - start
    assert motion @ forward > 0.99 * np.linalg.norm(motion) > 1.0
    controller.handle(Fly(), aspect=ASPECT)
    rest(controller)
    place = np.array(controller.pick(0.3, 0.7, aspect=ASPECT))
    before = np.linalg.norm(place - controller.camera().eye)
    controller.handle(Zoom(0.5, 0.3, 0.7), aspect=ASPECT)
    rest(controller)
    assert np.linalg.norm(place - controller.camera().eye) == pytest.approx(0.5 * before, rel=0.02)


def test_set_camera_jumps_in_every_mode(terrain):
    for mode in ["orbit", "fly"]:
        controller = create(terrain)
        controller.set_mode(mode)
        requested = Camera((500.0, 300.0, 700.0), (2000.0, 1500.0, 0.0), fov=50.0)
        controller.set_camera(requested)
        controller.advance(0.0)
        assert np.allclose(controller.camera().eye, requested.eye, atol=0.5), mode
        assert np.allclose(controller.camera().forward, requested.forward, atol=1e-3), mode


def test_rising_terrain_lifts_the_camera(terrain):
    for mode in ["orbit", "fly", "walk"]:
        controller = create(terrain)
        controller.set_mode(mode)
        rest(controller)
        z = controller.camera().eye[2]
        higher = Hills()
        higher.lift = z + 500.0
        controller.set_terrain(higher)
        rest(controller)
        x, y, z = controller.camera().eye
        assert z > higher.heights(x, y), mode


def test_the_sky_cannot_be_picked(controller):
    controller.set_mode("fly")
    controller.handle(Turn(0.0, 80.0), aspect=ASPECT)
    rest(controller)
    assert controller.pick(0.5, 0.1, aspect=ASPECT) is None
    controller.set_mode("orbit")  # needs a pivot although no terrain is hit
    rest(controller)
    assert np.isfinite(controller.camera().eye).all()
