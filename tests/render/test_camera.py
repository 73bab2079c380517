"""Cameras: projection, orbit and walk controllers, line of sight, terrain near the eye."""

import itertools
from unittest.mock import Mock

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.geometry.camera import Camera, clip_planes, direction
from sketchterrain.render.navigation import (
    CLEARANCE,
    EYE_HEIGHT,
    MIN_WIDTH,
    LocalHeights,
    OrbitController,
    WalkController,
    intersect_terrain,
)
from sketchterrain.render.navigation import CLEARANCE as ORBIT_CLEARANCE

ASPECT = 16 / 9


def project(camera, point):
    """Return the picture position of a point, −1 … 1, and its depth."""
    clip = camera.to_clip(ASPECT) @ np.append(np.subtract(point, camera.eye), 1.0)
    return clip[:3] / clip[3]


AHEAD = ((0.0, 90.0, 0.0), (40.0, -30.0, -12.0), (-1.0, 0.0, 3.0))


def test_projection_axes_depth_range_and_frustum():
    camera = Camera((0.0, 0.0, 0.0), (0.0, 100.0, 0.0), fov=90.0, near=2.0, far=500.0)
    assert np.allclose(project(camera, (10.0, 100.0, 0.0))[:2], [0.1 / ASPECT, 0.0])
    assert np.allclose(project(camera, (0.0, 100.0, 100.0))[:2], [0.0, 1.0])
    assert project(camera, (0.0, 2.0, 0.0))[2] == pytest.approx(-1.0)
    assert project(camera, (0.0, 500.0, 0.0))[2] == pytest.approx(1.0)
    down = Camera((0.0, 0.0, 50.0), (0.0, 0.0, 0.0))  # has an up, too
    assert np.isfinite(down.to_clip(1.0)).all()
    assert project(down, (0.0, 10.0, 0.0))[1] > 0

    camera = Camera((5000.0, -300.0, 70.0), (5400.0, 100.0, 40.0), near=1.0, far=2000.0)
    rng = np.random.default_rng(3)
    points = np.asarray(camera.eye) + rng.uniform(-900, 900, (500, 3))
    clip = (points - camera.eye) @ camera.to_clip(ASPECT)[:, :3].T + camera.to_clip(ASPECT)[:, 3]
    visible = (np.abs(clip[:, :3]) <= clip[:, 3:]).all(axis=1)
    planes = camera.frustum(ASPECT)
    assert visible.any()
    assert (((points @ planes[:, :3].T + planes[:, 3]) >= 0).all(axis=1) == visible).all()


def test_invalid_cameras_are_refused():
    for bad in (
        {"target": (0.0, 0.0, 0.0)},
        {"target": (0.0, np.nan, 0.0)},
        {"fov": 180.0},
        {"near": 0.0},
        {"near": 10.0, "far": 5.0},
    ):
        with pytest.raises(InputError, match="expected"):
            Camera(**({"eye": (0.0, 0.0, 0.0), "target": (0.0, 1.0, 0.0)} | bad))


def test_rays_pass_through_their_picture_position_and_heading_and_pitch_point_at_the_target():
    far_off = (1e7, -3e6, 250.0)
    for eye, ahead in itertools.product(((5.0, 6.0, 7.0), far_off), AHEAD):
        camera = Camera(eye, tuple(np.add(eye, ahead)))
        assert np.allclose(project(camera, camera.target)[:2], 0.0, atol=1e-7), (eye, ahead)
        for x, y in ((0.0, 0.0), (1.0, -1.0), (-0.3, 0.7)):
            along = camera.ray(x, y, ASPECT)
            assert np.linalg.norm(along) == pytest.approx(1.0)
            assert project(camera, camera.eye + 50.0 * along)[:2] == pytest.approx(
                [x, y], abs=1e-9 if eye == far_off else 1e-12
            )

    assert Camera((0.0, 0.0, 0.0), (1.0, 0.0, 0.0)).heading == pytest.approx(90.0)
    assert Camera((0.0, 0.0, 0.0), (-1.0, 1.0, 0.0)).heading == pytest.approx(315.0)
    for heading, pitch in ((0.0, 0.0), (75.0, -30.0), (300.0, 80.0)):
        camera = Camera((0.0, 0.0, 0.0), tuple(20.0 * direction(heading, pitch)))
        assert (camera.heading, camera.pitch) == pytest.approx((heading, pitch))


def test_clip_planes_follow_clearance_and_draw_distance():
    for clearance, near in ((0.0, 0.1), (1.7, 0.272), (80.0, 12.8), (625.0, 100.0), (2e4, 100.0)):
        assert clip_planes(clearance, 28_000.0) == pytest.approx((near, 30_800.0))
        near, far = clip_planes(clearance, 0.0)
        assert 0.0 < near < far


def test_cached_heights_near_the_eye_match_the_terrain(waves):
    for east, north in ((300.0, 200.0), (1e6, -4e5)):
        for spread in (0.0, 3.0, 200.0):
            x = east + np.linspace(-0.5, 0.5, 7) * spread
            y = north + np.linspace(0.5, -0.5, 7) * spread
            found = LocalHeights(waves)(x, y)
            assert found == pytest.approx(waves.heights(x, y), abs=0.02 + 2e-3 * spread), (east, spread)

    counted = Mock(wraps=waves, extent=waves.extent, sea_level=None)
    ground = LocalHeights(counted)
    calls = []
    for x in ([0.0], [10.0], [-0.45 * MIN_WIDTH], [40.0], [0.0, 500.0], [250.0], [250.0, 260.0]):
        ground(x, 0.0)
        calls.append(counted.heights.call_count)
    assert calls == [1, 1, 1, 2, 3, 4, 4]


def plain(x, y):
    return np.zeros(np.broadcast(x, y).shape)


def hills(x, y):
    return 60.0 * np.sin(np.asarray(x) / 90.0) * np.cos(np.asarray(y) / 70.0)


def camera(orbit):
    return orbit.camera(draw_distance=7000.0)


def test_an_orbit_keeps_its_distance_and_looks_at_the_pivot():
    for pivot in ((0.0, 0.0, 0.0), (1e6, -2e6, 0.0)):
        orbit = OrbitController(plain, pivot, distance=400.0)
        rng = np.random.default_rng(3)
        for _ in range(200):
            orbit.turn(rng.normal(0, 30), rng.normal(5, 20))
            orbit.advance(rng.uniform(0.0, 0.1))
            if 400.0 * np.sin(np.radians(orbit.elevation)) > 2.0:
                distance = np.linalg.norm(np.subtract(camera(orbit).eye, pivot))
                assert distance == pytest.approx(400.0, abs=1e-6), pivot
            assert project(camera(orbit), pivot)[:2] == pytest.approx([0.0, 0.0], abs=1e-6), pivot


def test_an_orbit_does_not_depend_on_the_frame_rate():
    ends = []
    for steps in ([0.5], [1 / 60] * 30, [1 / 240] * 120, np.diff([0.0, 0.01, 0.03, 0.2, 0.21, 0.5]).tolist()):
        orbit = OrbitController(hills, (0.0, 0.0, 0.0), distance=400.0)
        orbit.turn(80.0, 20.0)
        orbit.pan(0.3, 0.2)
        orbit.zoom(0.4, about=(50.0, 30.0, 10.0))
        for h in steps:
            orbit.advance(h)
        ends.append([*camera(orbit).eye, *orbit.pivot])
    assert np.ptp(ends, axis=0).max() < 1e-9


def test_a_zoom_keeps_its_point_fixed_up_to_the_distance_limits():
    orbit = OrbitController(plain, (0.0, 0.0, 0.0), distance=800.0, heading=30.0)
    point = (120.0, 60.0, 20.0)
    first = project(camera(orbit), point)[:2]
    for factor in (0.5, 0.5, 3.0, 0.1):
        orbit.zoom(factor, about=point)
        for _ in range(10):
            orbit.advance(1 / 60)
            assert project(camera(orbit), point)[:2] == pytest.approx(first, abs=1e-9)
    orbit.advance(10.0)
    assert orbit.distance == pytest.approx(60.0)
    orbit = OrbitController(plain, (0.0, 0.0, 0.0), distance=800.0, elevation=89.0)
    point = (50.0, 90.0, 0.0)
    first = project(camera(orbit), point)[:2]
    for factor in (1e-9, 1e12):
        orbit.zoom(factor, about=point)
        orbit.advance(100.0)
        assert project(camera(orbit), point)[:2] == pytest.approx(first, abs=1e-6)
    assert orbit.distance == pytest.approx(5e6)


def test_a_pan_moves_the_pivot_along_the_terrain():
    for heading in (0.0, 130.0):
        orbit = OrbitController(plain, (0.0, 0.0, 0.0), distance=500.0, heading=heading, elevation=89.0)
        orbit.pan(0.25, 0.125)  # the eye goes right and up: the pivot's old place, left and down
        orbit.advance(10.0)
        found = project(camera(orbit), (0.0, 0.0, 0.0))[:2]
        assert found == pytest.approx([-0.5 / ASPECT, -0.25], rel=0.02), heading

    orbit = OrbitController(hills, (10.0, 20.0, float(hills(10.0, 20.0)) + 5.0))
    for _ in range(20):
        orbit.pan(0.2, 0.3)
    orbit.advance(10.0)
    x, y, z = orbit.pivot
    assert z == pytest.approx(float(hills(x, y)) + 5.0)


def test_an_orbit_is_lifted_above_the_terrain_without_a_jump():
    """Around a valley among steep cones, at and below the horizon: steps of 0.05° move the eye smoothly."""

    def cones(x, y):
        x, y = np.asarray(x), np.asarray(y)
        return np.maximum(250.0 - 2.0 * np.abs(np.hypot(x, y) - 300.0), 0.0) * (np.sin(x / 40) + 1)

    orbit = OrbitController(cones, (0.0, 0.0, 0.0), distance=300.0, elevation=-20.0)
    eyes = []
    for _ in range(7200):
        orbit.turn(0.05, 0.002)
        orbit.advance(100.0)
        eyes.append(camera(orbit).eye)
        assert eyes[-1][2] >= cones(*eyes[-1][:2]) + ORBIT_CLEARANCE
    assert np.linalg.norm(np.diff(eyes, axis=0), axis=1).max() < 5.0
    assert np.ptp(np.array(eyes)[:, 2]) > 300.0


def test_an_orbit_jumps_at_once_and_comes_to_rest():
    orbit = OrbitController(plain, (0.0, 0.0, 0.0), heading=10.0, distance=300.0)
    orbit.turn(-40.0, 10.0)
    orbit.jump((5e5, 6e5, 7.0), distance=90.0)
    before = camera(orbit)
    assert (orbit.pivot, orbit.distance, orbit.heading) == ((5e5, 6e5, 7.0), 90.0, 50.0)
    orbit.advance(1.0)
    assert camera(orbit) == before

    orbit = OrbitController(hills, (1e6, 1e6, 0.0))
    orbit.turn(50.0, 10.0)
    orbit.zoom(0.3, about=(1e6 + 100.0, 1e6, 0.0))
    for _ in range(600):
        orbit.advance(1 / 60)
    rest = camera(orbit)
    for h in (0.001, 0.1, 0.02, 1.0):
        orbit.advance(h)
        assert np.abs(np.subtract(camera(orbit).eye, rest.eye)).max() < 1e-9


def test_a_line_of_sight_ends_at_its_first_intersection():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        orbit = OrbitController(
            hills, (*rng.uniform(-500, 500, 2), 0.0), heading=rng.uniform(0, 360), distance=900.0
        )
        view = camera(orbit)
        x, y = rng.uniform(-0.9, 0.9, 2)
        along = view.ray(x, y, ASPECT)
        point = intersect_terrain(hills, view.eye, along, max_distance=20_000.0)
        assert project(view, point)[:2] == pytest.approx([x, y], abs=1e-9), seed
        assert point[2] == pytest.approx(float(hills(*point[:2])), abs=1e-4), seed
        t = np.linspace(0.0, np.linalg.norm(np.subtract(point, view.eye)) - 1.0, 5000)[:, None]
        path = view.eye + t * along
        assert (path[:, 2] >= hills(path[:, 0], path[:, 1])).all(), seed
    # No intersection in the sky; the start point from below the terrain.
    assert intersect_terrain(plain, (0.0, 0.0, 10.0), (0.0, 0.6, 0.8), max_distance=1e5) is None
    assert intersect_terrain(plain, (0.0, 0.0, -3.0), (0.0, 1.0, 0.0), max_distance=1e5) == (0.0, 0.0, -3.0)


def slopes(x, y):
    """Up to 130 % steep, down to waves of 6 m."""
    x, y = np.asarray(x), np.asarray(y)
    return 60 * np.sin(x / 90) * np.cos(y / 70) + 4 * np.sin(x / 9 + 1) + 0.5 * np.sin(x / 1.7 + y)


def cliffs(seed):
    """Vertical steps of random height, 1 to 300 m, every 7 m."""
    heights = np.random.default_rng(seed).exponential(80.0, (64, 64))

    def ground(x, y):
        col, row = (np.floor(np.asarray(v) / 7.0).astype(int) % 64 for v in (x, y))
        return heights[row, col]

    return ground


def irregular(seconds, seed=5):
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0.0, seconds, int(40 * seconds)))
    return np.diff(np.concatenate([[0.0], times, [seconds]])).tolist()


def advance(walk, steps, *, look=0.0, **keys):
    """Advance by time steps while turning."""
    for h in steps:
        walk.look(look * h, 0.0)
        walk.advance(h, **keys)
    return np.array(walk.eye)


@pytest.mark.slow
def test_a_walk_does_not_depend_on_the_frame_rate():
    """0.1 % of the path after ten seconds, also with irregular steps (0 … 150 ms)."""
    rates = {str(rate): [1 / rate] * 10 * rate for rate in (24, 60, 240)} | {"irregular": irregular(10.0)}
    for ground, on_foot in itertools.product((plain, slopes), (False, True)):
        ends = {}
        for name, steps in rates.items():
            walk = WalkController(ground, (10.0, 20.0, 150.0), pitch=-2.0, on_foot=on_foot)
            ends[name] = advance(walk, steps, forward=1.0, right=0.3, boost=4.0)
        path = np.linalg.norm(ends["240"] - [10.0, 20.0, ends["240"][2]])
        assert path > 100
        for name, end in ends.items():
            assert np.linalg.norm(end - ends["240"]) < 1e-3 * path, (ground, on_foot, name)
        assert np.linalg.norm(ends["60"] - ends["240"]) < 1e-6 * path, (ground, on_foot)

    # Mouse motion comes in steps of a frame: 2 % of the path.
    ends = [
        advance(WalkController(plain, (0.0, 0.0, 300.0)), [1 / rate] * (5 * rate), look=40.0, forward=1.0)
        for rate in (60, 240)
    ]
    assert np.linalg.norm(ends[0] - ends[1]) < 0.02 * np.linalg.norm(ends[1])


@pytest.mark.parametrize(
    "seed",
    [0, *(pytest.param(n, marks=pytest.mark.slow if n < 2 else pytest.mark.soak) for n in range(1, 4))],
)
def test_a_walk_stays_above_cliffs_at_any_speed(seed):
    for boost, on_foot in itertools.product((0.2, 1.0, 30.0, 1000.0), (False, True)):
        ground = cliffs(seed)
        rng = np.random.default_rng(seed)
        walk = WalkController(
            ground, (3.0, 4.0, -50.0), heading=rng.uniform(0, 360), pitch=-60.0, on_foot=on_foot
        )
        for h in irregular(8.0, seed):
            walk.look(rng.normal(0, 20), rng.normal(0, 20))
            walk.advance(h, forward=1.0, right=rng.uniform(-1, 1), up=rng.uniform(-1, 1), boost=boost)
            x, y, z = walk.eye
            assert z >= ground(x, y) + CLEARANCE - 1e-9, (boost, on_foot)
            assert walk.clearance == pytest.approx(z - ground(x, y)), (boost, on_foot)
            assert np.isfinite(walk.eye).all(), (boost, on_foot)


def test_a_walk_comes_to_rest_without_input():
    """Also 1,000 km and more from the origin."""
    for origin, on_foot in itertools.product((0.0, -3e7), (False, True)):
        walk = WalkController(slopes, (origin + 3.0, origin - 5.0, 40.0), on_foot=on_foot)
        advance(walk, [1 / 60] * 60, look=30.0, forward=1.0, up=-1.0)
        advance(walk, [1 / 60] * 60 * 8)
        rest = walk.camera(draw_distance=7000.0)
        for h in irregular(2.0):
            walk.advance(h)
            camera = walk.camera(draw_distance=7000.0)
            assert np.abs(np.subtract(camera.eye, rest.eye)).max() < 1e-9, (origin, on_foot)
            assert np.abs(camera.forward - rest.forward).max() < 1e-9, (origin, on_foot)
        assert (walk.velocity == 0.0).all(), (origin, on_foot)


def test_a_slope_lifts_the_eye_smoothly():
    """A slope of 45° at 40 m/s: less than releasing the keys (190 m/s²); an abrupt stop takes 4,600."""

    def ramp(x, y):
        return np.clip(np.asarray(y) - 300.0, 0.0, 60.0) + 0.0 * np.asarray(x)

    walk = WalkController(ramp, (0.0, 0.0, 12.0))
    steps = 1 / 120
    path = []
    while walk.eye[1] < 500.0:
        advance(walk, [steps], forward=1.0, boost=4.0)
        path.append(walk.eye)
        assert len(path) < 5000
    vertical = np.diff(np.array(path)[:, 2]) / steps
    assert np.abs(np.diff(vertical) / steps).max() < 150.0
    assert path[-1][2] > 60.0 + CLEARANCE


def test_on_foot_the_eye_follows_the_terrain_and_flying_speed_grows_with_height():
    walk = WalkController(slopes, (0.0, 0.0, 500.0), on_foot=True)
    assert walk.eye[2] == slopes(0.0, 0.0) + EYE_HEIGHT
    heights = []
    for _ in range(1200):
        walk.advance(1 / 60, forward=1.0)
        heights.append(walk.clearance)
    assert min(heights) >= CLEARANCE
    assert max(heights) < EYE_HEIGHT + 1.0
    assert 70.0 < walk.eye[1] < 82.0  # 4 m/s, uphill too

    speeds = []
    for height in (0.0, 100.0, 1000.0, 20_000.0):
        walk = WalkController(plain, (0.0, 0.0, height))
        advance(walk, [1 / 60] * 120, forward=1.0)
        speeds.append(np.linalg.norm(walk.velocity))
    assert speeds == pytest.approx([4.0, 80.0, 800.0, 3000.0], rel=0.01)


def test_input_moves_along_its_axis_and_pitch_is_limited():
    for keys, path in (
        ({"forward": 1.0}, (1, 0, 0)),
        ({"right": 1.0}, (0, -1, 0)),
        ({"forward": -1.0, "right": -1.0}, (-1, 1, 0)),
        ({"up": 1.0}, (0, 0, 1)),
    ):
        walk = WalkController(plain, (0.0, 0.0, 100.0), heading=90.0)
        advance(walk, [0.1] * 5, **keys)
        moved = np.subtract(walk.eye, (0.0, 0.0, 100.0))
        assert moved / np.linalg.norm(moved) == pytest.approx(path / np.linalg.norm(path), abs=1e-9), keys

    walk = WalkController(plain, (0.0, 0.0, 100.0), heading=350.0)
    walk.look(30.0, 500.0)
    turns = [(walk.advance(1 / 60), walk.heading, walk.pitch)[1:] for _ in range(60)]
    assert turns[-1] == pytest.approx((20.0, 89.0))
    assert all(now[1] <= later[1] for now, later in itertools.pairwise(turns))
    camera = walk.camera(draw_distance=100.0)
    assert (camera.heading, camera.pitch) == pytest.approx((20.0, 89.0))


def test_jumps_and_long_pauses_end_above_the_terrain():
    walk = WalkController(slopes, (0.0, 0.0, 500.0))
    advance(walk, [1 / 60] * 30, forward=1.0)
    walk.jump((1e6, 2e6, -900.0), heading=45.0, pitch=-10.0)
    assert walk.eye == (1e6, 2e6, slopes(1e6, 2e6) + EYE_HEIGHT)
    assert (walk.heading, walk.pitch) == (45.0, -10.0)
    before = walk.camera(draw_distance=100.0)
    walk.advance(0.1)
    assert walk.camera(draw_distance=100.0).forward == pytest.approx(before.forward, abs=1e-12)

    walk = WalkController(slopes, (0.0, 0.0, 100.0))
    walk.advance(0.0, forward=1.0)
    assert walk.eye == (0.0, 0.0, 100.0)
    walk.advance(1e5, forward=-1.0, up=-1.0)
    assert np.isfinite(walk.eye).all()
    assert walk.clearance >= CLEARANCE - 1e-9
