"""Uplift of painted features: built heights, footprints, and the control of heights."""

from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.landforms.drainage import BARE_ROUNDS, DrainageInput, coarsened, confined, drain
from sketchterrain.landforms.painted_uplift import drain_painted, height_without, painted_uplift
from sketchterrain.landforms.placement.heights import built_height
from sketchterrain.landforms.placement.placement import place
from sketchterrain.landforms.uplift import UpliftFeatures, uplift_features

CELL = 24.0
SIDE = 129


def _ground(*, uplift=0.05, origin=(0, 0), shape=(SIDE, SIDE)):
    base = np.full(shape, np.nan)
    base[[0, -1]] = base[:, [0, -1]] = 0.0
    return DrainageInput(
        np.full(shape, uplift),
        np.full(shape, 0.8),
        np.full(shape, CELL * CELL),
        base,
        np.ones(shape, np.bool_),
        np.full(shape, -1, np.int32),
        origin,
    )


def _features(*rows):
    """Return features from x, y, radius (nodes) and height (m), each a shape of its own."""
    x, y, radius, height = (np.array(each, np.float64) for each in zip(*rows, strict=True))
    half = np.full(len(x), 0.5)
    return UpliftFeatures(
        *(CELL * x, CELL * y, CELL * radius, height, half, half, 0.5 * half),
        *(np.ones(len(x), np.bool_), np.full(len(x), -np.inf), np.arange(len(x)), np.full(len(x), -1)),
    )


def _drained(features, ground=None):
    """Return the uplift of features, and the heights of level 0 with and without it on one network."""
    ground = _ground() if ground is None else ground
    levels = [ground]
    while len(levels) < 4:
        levels.append(coarsened(levels[-1]))
    bare = drain(levels[::-1], CELL, BARE_ROUNDS)

    def uplift_of(some):
        painted = painted_uplift(some, ground, CELL)
        sources = [
            confined(source, before, painted.zone_of(k))
            for k, (source, before) in enumerate(zip(painted.ground, bare, strict=True))
        ]
        return replace(painted, ground=tuple(sources))

    painted = uplift_of(features)
    drained, factors = drain_painted(painted, CELL, bare)
    nothing = uplift_of(features._replace(height=np.zeros(len(features.x))))
    return painted, drained[-1].height, height_without(nothing, drained[-1], factors, CELL), bare[-1].height


def _effect(features, ground=None):
    _, height, without, _ = _drained(features, ground)
    return height - without


def test_features_reach_their_heights_and_outlines():
    for radius, height in ((20.0, 350.0), (16.0, 90.0), (24.0, 500.0)):
        effect = _effect(_features((64.0, 64.0, radius, height)))
        assert np.nanmax(effect) == pytest.approx(height, rel=0.15)
        away = np.hypot(*(np.indices(effect.shape) - 64.0))
        painted, affected = away < radius, effect > 0.25 * height
        assert (painted & affected).sum() / (painted | affected).sum() > 0.75


def test_features_of_different_size_reach_their_heights_together():
    rows = [
        (30.0, 30.0, 14.0, 200.0),
        (44.0, 34.0, 10.0, 160.0),
        (90.0, 40.0, 12.0, 60.0),
        (60.0, 95.0, 18.0, 380.0),
    ]
    effect = _effect(_features(*rows))
    for x, y, radius, height in rows:
        near = np.hypot(np.arange(SIDE)[None] - x, np.arange(SIDE)[:, None] - y) < 0.6 * radius
        assert np.nanmax(effect[near]) == pytest.approx(height, rel=0.25)


def test_tiny_features_and_features_beyond_the_region_do_no_harm():
    rows = [
        (64.0, 64.0, 0.5, 20.0),
        (-10.0, 50.0, 20.0, 200.0),
        (128.0, 128.0, 10.0, 100.0),
        (1e4, 1e4, 9.0, 50.0),
    ]
    effect = _effect(_features(*rows))
    assert np.isfinite(effect).all()
    assert effect[64, 64] > 0.0


def test_without_features_the_ground_is_drained_as_it_is():
    nothing = _features((0.0, 0.0, 1.0, 1.0)).of(np.zeros(0, np.int64))
    _, height, _, bare = _drained(nothing)
    assert np.array_equal(painted_uplift(nothing, _ground(), CELL).ground[-1].uplift, _ground().uplift)
    assert np.array_equal(height, bare)


def test_ground_beyond_the_zone_keeps_its_bits():
    painted, height, _, bare = _drained(_features((40.0, 60.0, 12.0, 300.0), (60.0, 60.0, 10.0, 100.0)))
    assert 0.1 < painted.zone.mean() < 0.5
    assert np.array_equal(height[~painted.zone], bare[~painted.zone])
    assert (height[painted.zone] != bare[painted.zone]).mean() > 0.5


def test_an_edit_changes_no_zone_but_its_own():
    one, other = (30.0, 30.0, 10.0, 200.0), (95.0, 95.0, 12.0, 300.0)
    _, alone, _, _ = _drained(_features(one))
    _, both, _, _ = _drained(_features(one, other))
    assert np.array_equal(alone[:60, :60], both[:60, :60])


def test_edited_heights_stand_up_to_what_their_shape_can_carry():
    rows, columns = np.mgrid[:128, :128]
    image = (np.hypot(rows - 64, columns - 64) < 30).astype(np.uint8)
    labels = {("mountain", 1): {"height": 200.0, "multitude": 3}}
    sketch = Sketch(extent=1280.0, layers={"mountain": image}, labels=labels)
    points = place(sketch, seed=1)
    before = uplift_features(sketch, points)
    np.testing.assert_array_equal(before.height, points["strength"])
    highest = int(points["strength"].argmax())
    for asked, stands in ((90.0, 90.0), (250.0, 250.0), (5000.0, built_height(5000.0, 295.0, 0.8))):
        changed = points.copy()
        changed["strength"][highest] = asked
        after = uplift_features(sketch, changed)
        others = np.arange(len(points)) != highest
        np.testing.assert_array_equal(after.height[others], before.height[others])
        np.testing.assert_array_equal(after.radius[others], before.radius[others])
        assert after.height[highest] == pytest.approx(stands, rel=0.005)
    added = points[:1].copy()
    added["id"], added["strength"] = 1 << 62, 5000.0
    alone = uplift_features(sketch, added)
    assert alone.height[0] == pytest.approx(built_height(5000.0, alone.radius[0], 0.8))
