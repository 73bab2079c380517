"""Orbiting around a place, and lines of sight to the ground."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.render.orbit import CLEARANCE, Orbit
from sketchterrain.render.sight import sight

ASPECT = 16 / 9


def plain(x, y):
    return np.zeros(np.broadcast(x, y).shape)


def hills(x, y):
    return 60.0 * np.sin(np.asarray(x) / 90.0) * np.cos(np.asarray(y) / 70.0)


def camera(orbit):
    return orbit.camera(draw_distance=7000.0)


def distance(orbit):
    return np.linalg.norm(np.subtract(camera(orbit).eye, orbit.pivot))


def place(of, point):
    """Where a point lies in the picture, −1 … 1."""
    clip = of.to_clip(ASPECT) @ np.append(np.subtract(point, of.eye), 1.0)
    return clip[:2] / clip[3]


def test_it_keeps_its_distance_and_looks_at_the_pivot():
    for pivot in ((0.0, 0.0, 0.0), (1e6, -2e6, 0.0)):
        orbit = Orbit(plain, pivot, distance=400.0)
        rng = np.random.default_rng(3)
        for _ in range(200):
            orbit.turn(rng.normal(0, 30), rng.normal(5, 20))
            orbit.advance(rng.uniform(0.0, 0.1))
            if 400.0 * np.sin(np.radians(orbit.elevation)) > 2.0:
                assert distance(orbit) == pytest.approx(400.0, abs=1e-6), pivot
            assert place(camera(orbit), pivot) == pytest.approx([0.0, 0.0], abs=1e-6), pivot


def test_the_path_does_not_depend_on_the_frame_rate():
    """Where nothing is asked for in between it is the same to rounding."""
    ends = []
    for steps in ([0.5], [1 / 60] * 30, [1 / 240] * 120, np.diff([0.0, 0.01, 0.03, 0.2, 0.21, 0.5]).tolist()):
        orbit = Orbit(hills, (0.0, 0.0, 0.0), distance=400.0)
        orbit.turn(80.0, 20.0)
        orbit.pan(0.3, 0.2)
        orbit.zoom(0.4, about=(50.0, 30.0, 10.0))
        for h in steps:
            orbit.advance(h)
        ends.append([*camera(orbit).eye, *orbit.pivot])
    assert np.ptp(ends, axis=0).max() < 1e-9


def test_a_zoom_keeps_its_point_in_the_picture_up_to_its_ends():
    orbit = Orbit(plain, (0.0, 0.0, 0.0), distance=800.0, heading=30.0)
    point = (120.0, 60.0, 20.0)
    first = place(camera(orbit), point)
    for factor in (0.5, 0.5, 3.0, 0.1):
        orbit.zoom(factor, about=point)
        for _ in range(10):
            orbit.advance(1 / 60)
            assert place(camera(orbit), point) == pytest.approx(first, abs=1e-9)
    orbit.advance(10.0)
    assert orbit.distance == pytest.approx(60.0)
    orbit = Orbit(plain, (0.0, 0.0, 0.0), distance=800.0, elevation=89.0)
    point = (50.0, 90.0, 0.0)
    first = place(camera(orbit), point)
    for factor in (1e-9, 1e12):
        orbit.zoom(factor, about=point)
        orbit.advance(100.0)
        assert place(camera(orbit), point) == pytest.approx(first, abs=1e-6)
    assert orbit.distance == pytest.approx(5e6)


def test_a_pan_drags_the_ground_and_the_pivot_follows_it():
    for heading in (0.0, 130.0):
        orbit = Orbit(plain, (0.0, 0.0, 0.0), distance=500.0, heading=heading, elevation=89.0)
        orbit.pan(0.25, 0.125)  # the eye goes right and up: the pivot's old place, left and down
        orbit.advance(10.0)
        found = place(camera(orbit), (0.0, 0.0, 0.0))
        assert found == pytest.approx([-0.5 / ASPECT, -0.25], rel=0.02), heading

    orbit = Orbit(hills, (10.0, 20.0, float(hills(10.0, 20.0)) + 5.0))
    for _ in range(20):
        orbit.pan(0.2, 0.3)
    orbit.advance(10.0)
    x, y, z = orbit.pivot
    assert z == pytest.approx(float(hills(x, y)) + 5.0)


def test_the_eye_is_lifted_out_of_the_ground_without_a_jump():
    """Around a valley among steep cones, at and under the horizon: 0.05° more never move the eye 2 m."""

    def cones(x, y):
        x, y = np.asarray(x), np.asarray(y)
        return np.maximum(250.0 - 2.0 * np.abs(np.hypot(x, y) - 300.0), 0.0) * (np.sin(x / 40) + 1)

    orbit = Orbit(cones, (0.0, 0.0, 0.0), distance=300.0, elevation=-20.0)
    eyes = []
    for _ in range(7200):
        orbit.turn(0.05, 0.002)
        orbit.advance(100.0)
        eyes.append(camera(orbit).eye)
        assert eyes[-1][2] >= cones(*eyes[-1][:2]) + CLEARANCE
    assert np.linalg.norm(np.diff(eyes, axis=0), axis=1).max() < 5.0
    assert np.ptp(np.array(eyes)[:, 2]) > 300.0


def test_a_jump_takes_no_time_and_an_orbit_at_rest_does_not_move():
    orbit = Orbit(plain, (0.0, 0.0, 0.0), heading=10.0, distance=300.0)
    orbit.turn(-40.0, 10.0)
    orbit.jump((5e5, 6e5, 7.0), distance=90.0)
    before = camera(orbit)
    assert (orbit.pivot, orbit.distance, orbit.heading) == ((5e5, 6e5, 7.0), 90.0, 50.0)
    orbit.advance(1.0)
    assert camera(orbit) == before

    orbit = Orbit(hills, (1e6, 1e6, 0.0))
    orbit.turn(50.0, 10.0)
    orbit.zoom(0.3, about=(1e6 + 100.0, 1e6, 0.0))
    for _ in range(600):
        orbit.advance(1 / 60)
    rest = camera(orbit)
    for h in (0.001, 0.1, 0.02, 1.0):
        orbit.advance(h)
        assert np.abs(np.subtract(camera(orbit).eye, rest.eye)).max() < 1e-9


def test_a_line_of_sight_ends_where_it_first_meets_the_ground():
    for seed in range(5):
        rng = np.random.default_rng(seed)
        orbit = Orbit(hills, (*rng.uniform(-500, 500, 2), 0.0), heading=rng.uniform(0, 360), distance=900.0)
        view = camera(orbit)
        x, y = rng.uniform(-0.9, 0.9, 2)
        along = view.ray(x, y, ASPECT)
        point = sight(hills, view.eye, along, reach=20_000.0)
        assert place(view, point) == pytest.approx([x, y], abs=1e-9), seed
        assert point[2] == pytest.approx(float(hills(*point[:2])), abs=1e-4), seed
        t = np.linspace(0.0, np.linalg.norm(np.subtract(point, view.eye)) - 1.0, 5000)[:, None]
        way = view.eye + t * along
        assert (way[:, 2] >= hills(way[:, 0], way[:, 1])).all(), seed
    # Nothing in the sky; from below the ground, the place itself.
    assert sight(plain, (0.0, 0.0, 10.0), (0.0, 0.6, 0.8), reach=1e5) is None
    assert sight(plain, (0.0, 0.0, -3.0), (0.0, 1.0, 0.0), reach=1e5) == (0.0, 0.0, -3.0)
