"""Plants in the wind against NumPy: nothing moves without wind, and no foot ever does."""

from __future__ import annotations

import numpy as np
import pytest

from .test_shaders import evaluate

pytestmark = pytest.mark.gl

FILES = ["render/tree_wind.glsl"]
TURN = 2 * np.pi / 70.0


def gust(place, wind, time):
    speed = np.hypot(*wind)
    along = np.array(wind) / speed
    run, aside = place @ along - speed * time, place @ [-along[1], along[0]]
    wide = np.sin(run * TURN + 1.7 * np.sin(aside * TURN * 0.37))
    return 1.0 + 0.45 * wide + 0.25 * np.sin(run * TURN * 2.3 + aside * TURN)


def rows(count, seed=2):
    return np.random.default_rng(seed).uniform(0.0, 1.0, (count, 4)).astype(np.float32)


def swayed(gl, points, wind, time, leafy=1.0):
    """Where points (n, 4: at, phase) of a plant 12 m high are moved to."""
    sway = f"sway_of(vec2(31.0, -7.0), 12.0, vec2({wind[0]:.4f}, {wind[1]:.4f}), {time:.4f})"
    call = f"vec4(swayed(a.xyz, 12.0, {sway}, a.w, {leafy:.1f}, {time:.4f}), 0.0)"
    return evaluate(gl, FILES, call, points)[:, :3]


def test_gusts_travel_with_the_wind_and_move_no_foot(gl):
    places = rows(400) * 300.0
    call = "vec4(gust(a.xy, vec2(3.0, 4.0), 2.0), gust(a.xy + vec2(1.5, 2.0), vec2(3.0, 4.0), 2.5), 0.0, 0.0)"
    got = evaluate(gl, FILES, call, places)
    expected = gust(places[:, :2].astype(float), (3.0, 4.0), 2.0)
    assert np.abs(got[:, 0] - expected).max() < 1e-3
    assert np.abs(got[:, 1] - expected).max() < 1e-3
    assert abs(gust(rows(20_000)[:, :2] * 9000.0, (3.0, 4.0), 0.0).mean() - 1.0) < 0.02

    points = rows(500)
    still = np.c_[points[:, :3], np.zeros(500)].astype(np.float32)
    call = "vec4(swayed(a.xyz, 12.0, sway_of(vec2(31.0, -7.0), 12.0, a.ww, 3.7), 0.3, 1.0, 3.7), 0.0)"
    assert (evaluate(gl, FILES, call, still) == 0.0).all()
    points[:, 2] = 0.0
    assert (swayed(gl, points, (9.0, -12.0), 3.7) == 0.0).all()


def test_wood_leans_with_the_wind_and_the_square_of_the_height(gl):
    points = rows(60)
    points[:, :2], points[:, 2] = 0.0, np.linspace(0.05, 1.0, 60)
    many = np.mean(
        [swayed(gl, points, (15.0, 0.0), time, leafy=0.0) for time in np.linspace(0, 400, 80)], axis=0
    )
    lean = 12.0 * 0.16 * 15.0**2 / (15.0**2 + 18.0**2)
    assert np.abs(many[:, 0] - lean * points[:, 2] ** 2).max() < 0.05 * lean
    assert np.abs(many[:, 1]).max() < 0.03 * lean
    weak, strong = (np.abs(swayed(gl, points, (speed, 0.0), 1.0, leafy=0.0)[-1, 0]) for speed in (2.0, 20.0))
    assert weak < 0.1 * strong
    assert strong < 0.3 * 12.0


def test_leaves_flutter_on_boughs_that_swing(gl):
    points = rows(300)
    points[:, 2] = 0.3 + 0.6 * points[:, 2]
    calm, later = (swayed(gl, points, (6.0, 0.0), time) for time in (1.0, 1.1))
    wood, wood_later = (swayed(gl, points, (6.0, 0.0), time, leafy=0.0) for time in (1.0, 1.1))
    assert (
        np.linalg.norm(later - calm, axis=1).mean() > 1.2 * np.linalg.norm(wood_later - wood, axis=1).mean()
    )
    assert np.linalg.norm(later - calm, axis=1).max() < 0.1
