from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.features.catalogue import Lake, ShapeField
from sketchterrain.features.lakes import (
    lake_centre,
    lake_pixels,
    painted_lakes,
    runs_inside,
    still_runs,
    within,
)
from sketchterrain.sketch.document import Sketch

SIZE = 64
ROW, COLUMN = np.mgrid[:SIZE, :SIZE]


def disc(x: float, y: float, radius: float, *, margin: float = 50.0) -> Lake:
    spacing = 2.0
    count = int((radius + margin) / spacing) + 1
    step = spacing * np.arange(-count, count + 1)
    inside = (radius - np.hypot(step, step[:, None])).astype(np.float32)
    return Lake(1, 1, ShapeField(x - count * spacing, y - count * spacing, spacing, inside), 5.0, 2.0)


def test_the_distance_inside_a_disc_is_that_to_its_circle() -> None:
    at = np.array([[100.0, 100.0], [110.0, 100.0], [100.0, 65.0], [100.0, 160.0]])
    np.testing.assert_allclose(within(disc(100, 100, 40).shape, at), [40, 30, 5, -20], atol=0.6)
    np.testing.assert_allclose(lake_centre(disc(130, 70, 20)), [130, 70])


def test_a_line_through_two_lakes_has_a_run_in_each() -> None:
    line = np.column_stack([np.arange(0.0, 400.0, 1.0), np.full(400, 100.0)])
    runs = runs_inside([disc(300, 100, 30), disc(100, 100, 40)], line)
    assert [lake for _, _, lake in runs] == [1, 0]
    (first, last, _), (later, end, _) = runs
    assert (first, last) == pytest.approx((60, 140), abs=1.5)
    assert (later, end) == pytest.approx((270, 330), abs=1.5)


def test_still_runs_begin_before_the_shore_and_include_the_rim() -> None:
    lake = disc(200, 100, 40, margin=50.0)  # its rim: 0.2 of 50 m
    x = np.arange(0.0, 400.0, 1.0)
    ((shore, first, last, _),) = still_runs([lake], np.column_stack([x, np.full(400, 100.0)]))
    assert (shore, first, last) == pytest.approx((150, 160, 240), abs=2)
    ((shore, first, last, _),) = still_runs([lake], np.column_stack([x, np.full(400, 145.0)]))
    assert last == first - 1
    assert shore < 200 < last
    assert still_runs([lake], np.column_stack([x, np.full(400, 155.0)])) == []


def test_a_lake_stands_below_the_low_parts_of_its_shore() -> None:
    layer = (np.hypot(COLUMN - 32, ROW - 32) < 12).astype(np.uint8)
    sketch = Sketch(extent=640.0, layers={"lake": layer}, labels={("lake", 1): {"depth": 9.0}})
    (flat,) = painted_lakes(sketch, lambda x, _: 0 * x + 20.0)
    assert flat.level == pytest.approx(19.75)
    assert flat.depth == 9.0
    (slope,) = painted_lakes(sketch, lambda x, _: 0.1 * x)
    assert 0.1 * 200 < slope.level < 0.1 * 250  # the western shore, at 205 m


def test_lake_pixels_are_those_painted() -> None:
    layer = np.zeros((SIZE, SIZE), np.uint8)
    assert lake_pixels(Sketch(layers={"lake": layer})) is None
    layer[10, 20] = 1
    tree = lake_pixels(Sketch(layers={"lake": layer}))
    assert tree is not None
    assert tree.query([10, 23])[0] == 3.0
