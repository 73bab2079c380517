"""Distances on the screen between triangles and the ground that they stand for."""

import numpy as np
import pytest

from sketchterrain.benchmarks.screen_error import ErrorSummary, PictureSize, ScreenSamples, screen_distances
from sketchterrain.render.camera import Camera

PICTURE = PictureSize(320, 180)


def grid(xs: np.ndarray, ys: np.ndarray, height: object) -> tuple[np.ndarray, np.ndarray]:
    x, y = np.meshgrid(xs, ys)
    vertices = np.stack([x, y, height(x, y)], axis=-1).reshape(-1, 3)  # type: ignore[operator]
    number = np.arange(x.size).reshape(x.shape)
    a, b, c, d = (
        each.ravel() for each in (number[:-1, :-1], number[:-1, 1:], number[1:, :-1], number[1:, 1:])
    )
    return vertices, np.concatenate([np.stack([a, b, d], -1), np.stack([a, d, c], -1)])


def test_screen_distances_of_known_points():
    # 90° over 100 pixels: 50 pixels a radian; 2 m higher in 100 m, seen level, is 1 pixel.
    camera = Camera((0.0, 0.0, 0.0), (0.0, 100.0, 0.0), fov=90.0)
    picture = PictureSize(100, 100)
    assert picture.pixels_per_radian(camera) == pytest.approx(50.0)
    drawn = np.array([[0.0, 100.0, 0.0], [30.0, 200.0, 5.0]])
    found = screen_distances(camera, picture, drawn, [2.0, 5.0])
    assert found == pytest.approx([1.0, 0.0], abs=1e-9)
    # From above a height hardly shows.
    camera = Camera((0.0, 0.0, 100.0), (0.0, 0.0, 0.0))
    assert screen_distances(camera, PICTURE, np.zeros((1, 3)), [1.0]) == pytest.approx(0.0, abs=1e-9)
    # Ground behind the eye is infinitely far.
    camera = Camera((0.0, 0.0, 10.0), (0.0, 0.0, 0.0))
    assert screen_distances(camera, PICTURE, np.zeros((1, 3)), [20.0])[0] == np.inf


def test_a_slanted_plane_is_drawn_where_it_is():
    def plane(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 0.1 * x - 0.2 * y + 3.0

    camera = Camera((0.0, 0.0, 50.0), (10.0, 100.0, 0.0))
    samples = ScreenSamples(camera, PICTURE)
    samples.add(*grid(np.linspace(-400, 400, 9), np.linspace(-400, 400, 7), plane))
    points = samples.seen()
    assert 0 < len(points) <= samples.count
    assert points[:, 2] == pytest.approx(plane(points[:, 0], points[:, 1]), abs=1e-9)
    # Every sample that looks at the plane within the grid has found it: neither gaps nor edges left out.
    u, v = np.meshgrid(samples._u, samples._v)
    rays = np.stack([u, v, np.ones_like(u)], -1).reshape(-1, 3) @ samples._axes
    normal = np.array([-0.1, 0.2, 1.0])
    t = (3.0 - normal @ np.array(camera.eye)) / (rays @ normal)
    at = np.array(camera.eye) + rays * t[:, None]
    assert len(points) == np.sum((t > 0) & (np.abs(at[:, :2]) <= 400).all(axis=1))


def test_the_error_of_a_parabola_is_its_formula_and_summaries_count_quantiles():
    # Chords of a·x² over pieces of width s lie up to a·s²/4 above it; level from afar that is so many pixels.
    a, s, distance = 0.001, 10.0, 1000.0

    def ground(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return a * x * x + 0.5 * y

    camera = Camera((0.0, -distance, 0.0), (0.0, 0.0, 0.0), fov=30.0)
    picture = PictureSize(640, 360)
    samples = ScreenSamples(camera, picture, every=1)
    samples.add(*grid(np.arange(-100, 101, s), np.array([-10.0, 10.0]), ground))
    points = samples.seen()
    found = screen_distances(camera, picture, points, ground(points[:, 0], points[:, 1]))
    largest = a * s * s / 4 * picture.pixels_per_radian(camera) / distance
    assert ErrorSummary.of(found).worst == pytest.approx(largest, rel=0.03)

    found = ErrorSummary.of(np.concatenate([np.full(9_990, 0.5), np.full(10, 3.0)]))
    assert (found.samples, found.within, found.most, found.worst) == (10_000, 0.999, 0.5, 3.0)
    assert ErrorSummary.of(np.array([0.25])).most == 0.25


def test_nearer_triangles_hide_others_and_those_behind_the_eye_are_clipped():
    camera = Camera((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    square = np.array([[-1.0, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    triangles = [[0, 1, 2], [0, 2, 3]]
    for order in ((10.0, 20.0), (20.0, 10.0)):
        samples = ScreenSamples(camera, PICTURE)
        for far in order:
            samples.add(square * 20 + [0, far, 0], triangles)
        assert samples.seen()[:, 1] == pytest.approx(10.0)

    camera = Camera((0.0, 0.0, 2.0), (0.0, 10.0, 1.0))
    floor = np.array([[-1000.0, -1000, 0], [1000, -1000, 0], [0, 1000, 0]])
    samples = ScreenSamples(camera, PICTURE)
    samples.add(floor, [[0, 1, 2]])
    seen = samples.seen()
    assert seen[:, 2] == pytest.approx(0.0, abs=1e-9)
    assert seen[:, 1].min() > 0
    behind = ScreenSamples(camera, PICTURE)
    behind.add(floor - [0, 2000, 0], [[0, 1, 2]])
    assert not len(behind.seen())
