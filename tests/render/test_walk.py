"""Walking and flying over the ground."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from sketchterrain.render.walk import CLEARANCE, EYE_HEIGHT, Walk


def plain(x, y):
    return np.zeros(np.broadcast(x, y).shape)


def hills(x, y):
    """Up to 130 % steep, down to waves of 6 m."""
    x, y = np.asarray(x), np.asarray(y)
    return 60 * np.sin(x / 90) * np.cos(y / 70) + 4 * np.sin(x / 9 + 1) + 0.5 * np.sin(x / 1.7 + y)


def cliffs(seed):
    """Ground in steps of random height, 1 to 300 m, every 7 m: as steep as ground can be."""
    heights = np.random.default_rng(seed).exponential(80.0, (64, 64))

    def ground(x, y):
        col, row = (np.floor(np.asarray(v) / 7.0).astype(int) % 64 for v in (x, y))
        return heights[row, col]

    return ground


def irregular(seconds, seed=5):
    rng = np.random.default_rng(seed)
    times = np.sort(rng.uniform(0.0, seconds, int(40 * seconds)))
    return np.diff(np.concatenate([[0.0], times, [seconds]])).tolist()


def fly(walk, steps, *, look=0.0, **keys):
    """Fly through steps of time, turning all the while."""
    for h in steps:
        walk.look(look * h, 0.0)
        walk.advance(h, **keys)
    return np.array(walk.eye)


@pytest.mark.slow
def test_the_path_does_not_depend_on_the_frame_rate():
    """A tenth of a percent of the way after ten seconds, also where steps are irregular (0 … 150 ms)."""
    rates = {
        "60": [1 / 60] * 600,
        "240": [1 / 240] * 2400,
        "24": [1 / 24] * 240,
        "irregular": irregular(10.0),
    }
    for ground, on_foot in itertools.product((plain, hills), (False, True)):
        ends = {}
        for name, steps in rates.items():
            walk = Walk(ground, (10.0, 20.0, 150.0), pitch=-2.0, on_foot=on_foot)
            ends[name] = fly(walk, steps, forward=1.0, right=0.3, boost=4.0)
        way = np.linalg.norm(ends["240"] - [10.0, 20.0, ends["240"][2]])
        assert way > 100
        for name, end in ends.items():
            assert np.linalg.norm(end - ends["240"]) < 1e-3 * way, (ground, on_foot, name)
        assert np.linalg.norm(ends["60"] - ends["240"]) < 1e-6 * way, (ground, on_foot)

    # The mouse itself moves in steps of a frame: 2 % of the way.
    ends = [
        fly(Walk(plain, (0.0, 0.0, 300.0)), [1 / rate] * (5 * rate), look=40.0, forward=1.0)
        for rate in (60, 240)
    ]
    assert np.linalg.norm(ends[0] - ends[1]) < 0.02 * np.linalg.norm(ends[1])


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
def test_the_eye_is_never_in_the_ground_however_steep_and_fast(seed):
    for boost, on_foot in itertools.product((0.2, 1.0, 30.0, 1000.0), (False, True)):
        ground = cliffs(seed)
        rng = np.random.default_rng(seed)
        walk = Walk(ground, (3.0, 4.0, -50.0), heading=rng.uniform(0, 360), pitch=-60.0, on_foot=on_foot)
        for h in irregular(8.0, seed):
            walk.look(rng.normal(0, 20), rng.normal(0, 20))
            walk.advance(h, forward=1.0, right=rng.uniform(-1, 1), up=rng.uniform(-1, 1), boost=boost)
            x, y, z = walk.eye
            assert z >= ground(x, y) + CLEARANCE - 1e-9, (boost, on_foot)
            assert walk.clearance == pytest.approx(z - ground(x, y)), (boost, on_foot)
            assert np.isfinite(walk.eye).all(), (boost, on_foot)


def test_an_eye_at_rest_does_not_move():
    """1,000 km away and farther: after the keys are let go the camera comes to rest to the last bit."""
    for origin, on_foot in itertools.product((0.0, 1e6, -3e7), (False, True)):
        walk = Walk(hills, (origin + 3.0, origin - 5.0, 40.0), on_foot=on_foot)
        fly(walk, [1 / 60] * 60, look=30.0, forward=1.0, up=-1.0)
        fly(walk, [1 / 60] * 60 * 8)
        rest = walk.camera(draw_distance=7000.0)
        for h in irregular(2.0):
            walk.advance(h)
            camera = walk.camera(draw_distance=7000.0)
            assert np.abs(np.subtract(camera.eye, rest.eye)).max() < 1e-9, (origin, on_foot)
            assert np.abs(camera.forward - rest.forward).max() < 1e-9, (origin, on_foot)
        assert (walk.velocity == 0.0).all(), (origin, on_foot)


def test_a_hillside_lifts_the_eye_without_a_jerk():
    """Up a slope of 45°, at 40 m/s: less than letting the keys go (190 m/s²); a hard stop takes 4,600."""

    def ramp(x, y):
        return np.clip(np.asarray(y) - 300.0, 0.0, 60.0) + 0.0 * np.asarray(x)

    walk = Walk(ramp, (0.0, 0.0, 12.0))
    steps = 1 / 120
    path = []
    while walk.eye[1] < 500.0:
        fly(walk, [steps], forward=1.0, boost=4.0)
        path.append(walk.eye)
        assert len(path) < 5000
    vertical = np.diff(np.array(path)[:, 2]) / steps
    assert np.abs(np.diff(vertical) / steps).max() < 150.0
    assert path[-1][2] > 60.0 + CLEARANCE


def test_on_foot_the_eye_keeps_to_the_ground():
    walk = Walk(hills, (0.0, 0.0, 500.0), on_foot=True)
    assert walk.eye[2] == hills(0.0, 0.0) + EYE_HEIGHT
    heights = []
    for _ in range(1200):
        walk.advance(1 / 60, forward=1.0)
        heights.append(walk.clearance)
    assert min(heights) >= CLEARANCE
    assert max(heights) < EYE_HEIGHT + 1.0
    assert 70.0 < walk.eye[1] < 82.0  # 4 m/s, uphill too


def test_speed_grows_with_the_height_above_ground():
    speeds = []
    for height in (0.0, 100.0, 1000.0, 20_000.0):
        walk = Walk(plain, (0.0, 0.0, height))
        fly(walk, [1 / 60] * 120, forward=1.0)
        speeds.append(np.linalg.norm(walk.velocity))
    assert speeds == pytest.approx([4.0, 80.0, 800.0, 3000.0], rel=0.01)


def test_keys_move_in_their_directions():
    for keys, way in (
        ({"forward": 1.0}, (1, 0, 0)),
        ({"right": 1.0}, (0, -1, 0)),
        ({"forward": -1.0, "right": -1.0}, (-1, 1, 0)),
        ({"up": 1.0}, (0, 0, 1)),
    ):
        walk = Walk(plain, (0.0, 0.0, 100.0), heading=90.0)
        fly(walk, [0.1] * 5, **keys)
        gone = np.subtract(walk.eye, (0.0, 0.0, 100.0))
        assert gone / np.linalg.norm(gone) == pytest.approx(way / np.linalg.norm(way), abs=1e-9), keys


def test_the_look_follows_and_stops_short_of_straight_up():
    walk = Walk(plain, (0.0, 0.0, 100.0), heading=350.0)
    walk.look(30.0, 500.0)
    turns = [(walk.advance(1 / 60), walk.heading, walk.pitch)[1:] for _ in range(60)]
    assert turns[-1] == pytest.approx((20.0, 89.0))
    assert all(now[1] <= later[1] for now, later in itertools.pairwise(turns))
    camera = walk.camera(draw_distance=100.0)
    assert (camera.heading, camera.pitch) == pytest.approx((20.0, 89.0))


def test_jumps_and_long_pauses_end_above_the_ground():
    walk = Walk(hills, (0.0, 0.0, 500.0))
    fly(walk, [1 / 60] * 30, forward=1.0)
    walk.jump((1e6, 2e6, -900.0), heading=45.0, pitch=-10.0)
    assert walk.eye == (1e6, 2e6, hills(1e6, 2e6) + EYE_HEIGHT)
    assert (walk.heading, walk.pitch) == (45.0, -10.0)
    before = walk.camera(draw_distance=100.0)
    walk.advance(0.1)
    assert walk.camera(draw_distance=100.0).forward == pytest.approx(before.forward, abs=1e-12)

    walk = Walk(hills, (0.0, 0.0, 100.0))
    walk.advance(0.0, forward=1.0)
    assert walk.eye == (0.0, 0.0, 100.0)
    walk.advance(1e5, forward=-1.0, up=-1.0)
    assert np.isfinite(walk.eye).all()
    assert walk.clearance >= CLEARANCE - 1e-9
