"""Filling against labelled components, lines against the spline through their points, and picking."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.sketch import Sketch
from sketchterrain.ui.painting.fill import flood, pick
from sketchterrain.ui.painting.stroke import Stroke, draw_line, line_path, line_width


def empty(side: int = 96) -> np.ndarray:
    return np.zeros((side, side), dtype=np.uint8)


def test_a_fill_is_the_component() -> None:
    for seed in range(30):
        rng = np.random.default_rng(seed)
        shape = (int(rng.integers(1, 90)), int(rng.integers(1, 90)))
        labels = rng.integers(0, rng.integers(2, 5), shape).astype(np.uint8)
        image = ndimage.zoom(labels, int(rng.integers(1, 5)), order=0)
        row, column = int(rng.integers(image.shape[0])), int(rng.integers(image.shape[1]))
        old = image[row, column]
        components, _ = ndimage.label(image == old, np.ones((3, 3)) if old else None)
        region = components == components[row, column]
        wanted = np.where(region, 9, image)
        box = flood(image, row, column, 9)
        np.testing.assert_array_equal(image, wanted, err_msg=f"seed {seed}")
        rows, columns = np.flatnonzero(region.any(axis=1)), np.flatnonzero(region.any(axis=0))
        assert box == (rows[0], columns[0], rows[-1] + 1, columns[-1] + 1), seed


def test_empty_ground_is_filled_up_to_the_thinnest_ring_and_nothing_outside() -> None:
    image = empty()
    stroke = Stroke(image, 2)
    for k in range(41):
        stroke.to(48 + 30 * math.cos(k * math.tau / 40), 48 + 30 * math.sin(k * math.tau / 40), 0.5)
    stroke.finish()
    assert flood(image, 48, 48, 5) is not None
    assert image[0, 0] == 0
    assert (image == 5).sum() == pytest.approx(math.pi * 29.5**2, rel=0.02)
    assert flood(image, 0, 0, 7) == (0, 0, 96, 96)
    assert image[48, 48] == 5

    image = empty()
    assert flood(image, 3, 4, 0) is None
    for row, column in ((-1, 0), (0, -1), (96, 0), (0, 96)):
        assert flood(image, row, column, 1) is None
    assert not image.any()


def test_a_line_is_the_stroke_through_its_points_and_shown_where_it_is_painted() -> None:
    points = [(10.5, 12.0), (40.0, 60.25), (80.0, 30.0), (85.5, 88.5)]
    image, stroked = empty(), empty()
    box = draw_line(image, points, 7.0, 3)
    stroke = Stroke(stroked, 3)
    for x, y in points:
        stroke.to(x, y, 3.5)
    stroke.finish()
    np.testing.assert_array_equal(image, stroked)
    rows, columns = np.flatnonzero(image.any(axis=1)), np.flatnonzero(image.any(axis=0))
    assert box == (rows[0], columns[0], rows[-1] + 1, columns[-1] + 1)

    points = [(10.5, 10.5), (60.0, 20.0), (30.0, 80.0)]
    path = line_path(points)
    assert set(points) <= set(path)
    image = empty()
    draw_line(image, points, 1.0, 1)
    assert all(image[int(y), int(x)] for x, y in path)
    assert line_path([]) == []


def test_a_river_is_as_wide_as_its_label_says_and_never_thinner_than_a_pixel() -> None:
    sketch = Sketch(extent=1024.0, labels={("river", 2): {"width": 24.0}, ("river", 3): {"width": 0.5}})
    assert line_width(sketch, "river", 2, 99.0) == 12.0
    assert line_width(sketch, "river", 3, 99.0) == 1.0
    assert line_width(sketch, "mountain", 1, 9.0) == 18.0
    image = empty()
    draw_line(image, [(0.5, 48.5), (95.5, 48.5)], line_width(sketch, "river", 2, 99.0), 2)
    assert set(image[:, 48].nonzero()[0]) == set(range(43, 54)) | {54, 42}


def test_the_topmost_paint_is_picked() -> None:
    top, below = empty(), empty()
    top[10:20, 10:20] = 3
    below[5:40, 5:40] = 200
    layers = [("river", top), ("mountain", below)]
    assert pick(layers, 15, 15) == ("river", 3)
    assert pick(layers, 30, 30) == ("mountain", 200)
    assert pick(layers, 80, 80) is None
    assert pick(layers, -1, 15) is None
