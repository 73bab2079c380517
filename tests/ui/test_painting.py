"""Strokes, lines and fills against their definitions: a pixel is covered if its centre is inside."""

import math

import numpy as np
import pytest
from scipy import ndimage
from scipy.spatial import cKDTree

from sketchterrain.document.label_layers import union_box
from sketchterrain.document.sketch import Sketch
from sketchterrain.geometry.splines import sample_catmull_rom
from sketchterrain.ui.models.painting import (
    Stroke,
    StrokeSmoother,
    draw_line,
    flood_fill,
    line_path,
    line_width,
    paint_sweep,
)

SIDE = 96


def empty(height: int = SIDE, width: int = SIDE) -> np.ndarray:
    return np.zeros((height, width), dtype=np.uint8)


def centres(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    rows, columns = np.mgrid[: image.shape[0], : image.shape[1]]
    return columns + 0.5, rows + 0.5


def box_of(image: np.ndarray) -> tuple | None:
    rows, columns = np.flatnonzero(image.any(axis=1)), np.flatnonzero(image.any(axis=0))
    return (rows[0], columns[0], rows[-1] + 1, columns[-1] + 1) if len(rows) else None


def depth(image: np.ndarray, start: tuple, end: tuple) -> np.ndarray:
    """Return the depth (px) of each pixel centre inside a swept disc: the maximum of a concave function."""
    x, y = centres(image)
    (ax, ay, a), (bx, by, b) = start, end
    length = math.hypot(bx - ax, by - ay)
    if length <= abs(b - a):
        return np.maximum(a - np.hypot(x - ax, y - ay), b - np.hypot(x - bx, y - by))
    along = ((x - ax) * (bx - ax) + (y - ay) * (by - ay)) / length
    across = np.abs((x - ax) * (by - ay) - (y - ay) * (bx - ax)) / length
    slope = (b - a) / length
    best = np.clip(along + across * slope / math.sqrt(1.0 - slope * slope), 0.0, length)
    return a + slope * best - np.hypot(along - best, across)


def stroke_image(places: list[tuple], *, label: int = 1, image: np.ndarray | None = None) -> np.ndarray:
    image = empty() if image is None else image
    stroke = Stroke(image, label)
    for place in places:
        stroke.to(*place)
    stroke.finish()
    return image


def scribble(seed: int, *, radius: float | None = None, count: int = 12) -> list[tuple]:
    rng = np.random.default_rng(seed)
    x = np.round(rng.uniform(0.1 * SIDE, 0.9 * SIDE, (count, 2)) * 8) / 8
    radii = np.full(count, radius) if radius else np.round(rng.uniform(0.5, 9.0, count) * 8) / 8
    return [(*map(float, place), float(r)) for place, r in zip(x, radii, strict=True)]


def test_a_dab_covers_the_disc():
    for centre in [(48.5, 48.5), (48.0, 48.0), (31.25, 60.875), (0.0, 95.5), (-20.0, 110.0)]:
        for radius in [0.5, 0.75, 1.0, 1.5, 2.25, 5.0, 16.125, 40.0, 64.5]:
            image = stroke_image([(*centre, radius)])
            x, y = centres(image)
            expected = (x - centre[0]) ** 2 + (y - centre[1]) ** 2 <= radius**2
            # Never less than a pixel.
            expected |= np.maximum(np.abs(x - centre[0]), np.abs(y - centre[1])) <= 0.5
            np.testing.assert_array_equal(image == 1, expected, err_msg=f"{centre}, {radius}")


def test_a_sweep_covers_the_hull_of_its_discs():
    for seed in range(60):
        rng = np.random.default_rng(seed)
        a, b = (np.round([*rng.uniform(-10, SIDE + 10, 2), rng.uniform(0.5, 30)], 2).tolist() for _ in "ab")
        image = empty()
        box = paint_sweep(image, a, b, 3)
        inside = depth(image, a, b)
        clear = np.abs(inside) > 1e-6
        np.testing.assert_array_equal((image == 3)[clear], (inside > 0)[clear], err_msg=f"seed {seed}")
        assert box == box_of(image), seed


def test_edges_through_pixel_centres_are_painted():
    for radius in [0.5, 1.0, 5.0, 13.0]:
        for step in [(8.0, 0.0), (0.0, 8.0), (8.0, 8.0), (6.0, 8.0), (12.0, 5.0), (-8.0, 0.0)]:
            start, end = (40.5, 40.5, radius), (40.5 + step[0], 40.5 + step[1], radius)
            image = empty()
            paint_sweep(image, start, end, 1)
            inside = depth(image, start, end)
            assert (image[inside > -1e-9] == 1).all(), (radius, step)
            beyond = (inside < -1e-6) & (depth(image, (*start[:2], 0.7072), (*end[:2], 0.7072)) < 0.0)
            assert not image[beyond].any(), (radius, step)


def test_a_stroke_follows_the_spline_within_half_a_pixel():
    for seed in range(10):
        radius = [0.5, 1.0, 3.0, 8.5, 20.0][seed % 5]
        places = scribble(seed, radius=radius)
        image = stroke_image(places)
        path, _ = sample_catmull_rom(np.array(places)[:, :2], 0.02)
        x, y = centres(image)
        far, _ = cKDTree(path).query(np.dstack([x, y]))
        assert (image[far <= radius - 0.5] == 1).all(), seed
        assert not image[far > radius + 0.5].any(), seed


def test_smoothing_halves_jitter_and_stays_within_a_pixel():
    for grain in [0.25, 1.0, 4.0]:
        raw, smooth = [], []
        for angle in np.linspace(0.05, 1.5, 20):
            way = np.arange(0.0, 150.0 * grain, 0.9 * grain)[:, None] * (math.cos(angle), math.sin(angle))
            sampled = np.round(way / grain) * grain
            sampled = sampled[np.append(True, (np.diff(sampled, axis=0) != 0.0).any(axis=1))]
            smoother = StrokeSmoother(grain)
            nodes = [node for x, y in sampled if (node := smoother.to((x, y, 1.0)))] + smoother.finish()
            assert nodes[0][:2] == tuple(sampled[0]), grain
            assert nodes[-1][:2] == tuple(sampled[-1]), grain
            normal = (-math.sin(angle), math.cos(angle))
            raw += list((sampled @ normal) / grain)
            smooth += list((np.array(nodes)[1:-1, :2] @ normal) / grain)
        assert np.std(smooth) < 0.5 * np.std(raw), grain

    rng = np.random.default_rng(0)
    places = [(*map(float, place), 2.0) for place in rng.integers(0, 90, (40, 2))]
    smoother = StrokeSmoother(1.0)
    nodes = [node for place in places if (node := smoother.to(place))] + smoother.finish()
    far, _ = cKDTree(np.array(nodes)[:, :2]).query(np.array(places)[:, :2])
    assert far.max() <= 1.0 + 1e-3


def test_pressure_changes_the_width_and_zero_erases_beside_other_labels():
    image = stroke_image([(10.5, 48.5, 1.0), (80.5, 48.5, 15.0)])
    widths = image[:, 20:70].sum(axis=0).astype(float)
    assert (np.diff(widths) >= 0).all()
    assert np.polyfit(np.arange(50), widths, 1)[0] == pytest.approx(2 * 14 / 70, rel=0.05)
    grown = stroke_image([(48.5, 48.5, 2.0), (48.5, 48.5, 9.0)])
    np.testing.assert_array_equal(grown, stroke_image([(48.5, 48.5, 9.0)]))

    places = [(20.5, 20.5, 6.0), (70.5, 50.5, 6.0)]
    erased = stroke_image(places, label=0, image=np.full((SIDE, SIDE), 4, dtype=np.uint8))
    np.testing.assert_array_equal(erased, np.where(stroke_image(places), 0, 4))


def test_the_thinnest_stroke_has_no_gap_and_is_a_pixel_wide():
    for seed in range(8):
        image = stroke_image(scribble(seed, radius=0.01, count=5))
        _, pieces = ndimage.label(image, np.ones((3, 3)))
        assert pieces == 1, seed
        assert not ndimage.binary_erosion(image, np.ones((4, 4))).any(), seed
        straight = stroke_image([(10.5, 30.5, 0.5), (70.5, 30.5, 0.5)])
        assert (straight.sum(), straight[30, 10:71].sum()) == (61, 61), seed


def test_strokes_are_clipped_at_the_image_border():
    for seed in range(6):
        places = [(2 * x - 48, 2 * y - 48, r) for x, y, r in scribble(seed)]
        wide = stroke_image(
            [(x + 100, y + 100, r) for x, y, r in places], image=empty(SIDE + 200, SIDE + 200)
        )
        np.testing.assert_array_equal(stroke_image(places), wide[100:-100, 100:-100], err_msg=f"seed {seed}")

    image = empty()
    stroke = Stroke(image, 1)
    boxes = [stroke.to(x, y, 5.0) for x, y in [(-50, 20), (-60, 300), (40, 400), (500, 40), (1e6, -1e6)]]
    assert [*boxes, stroke.finish()] == [None] * 6
    assert not image.any()


def test_returned_boxes_contain_all_changes_and_their_union_is_tight():
    for seed in range(10):
        image = empty()
        stroke = Stroke(image, 1)
        together = None
        for place in [*scribble(seed), None]:
            before = image.copy()
            box = stroke.to(*place) if place else stroke.finish()
            together = union_box(together, box)
            if box is None:
                assert (image == before).all(), seed
                continue
            top, left, bottom, right = box
            before[top:bottom, left:right] = image[top:bottom, left:right]
            assert (image == before).all(), seed
        assert together == box_of(image), seed


def test_a_fill_relabels_the_connected_component():
    for seed in range(30):
        rng = np.random.default_rng(seed)
        shape = (int(rng.integers(1, 90)), int(rng.integers(1, 90)))
        labels = rng.integers(0, rng.integers(2, 5), shape).astype(np.uint8)
        image = ndimage.zoom(labels, int(rng.integers(1, 5)), order=0)
        row, column = int(rng.integers(image.shape[0])), int(rng.integers(image.shape[1]))
        old = image[row, column]
        components, _ = ndimage.label(image == old, np.ones((3, 3)) if old else None)
        region = components == components[row, column]
        expected = np.where(region, 9, image)
        box = flood_fill(image, row, column, 9)
        np.testing.assert_array_equal(image, expected, err_msg=f"seed {seed}")
        assert box == box_of(region), seed


def test_an_ineffective_fill_returns_none():
    image = empty()
    for row, column, label in ((3, 4, 0), (-1, 0, 1), (0, -1, 1), (96, 0, 1), (0, 96, 1)):
        assert flood_fill(image, row, column, label) is None
    assert not image.any()


def test_a_line_equals_the_stroke_through_its_points_and_its_preview():
    points = [(10.5, 12.0), (40.0, 60.25), (80.0, 30.0), (85.5, 88.5)]
    image = empty()
    assert draw_line(image, points, 7.0, 3) == box_of(image)
    np.testing.assert_array_equal(image, stroke_image([(*point, 3.5) for point in points], label=3))

    points = [(10.5, 10.5), (60.0, 20.0), (30.0, 80.0)]
    path = line_path(points)
    assert set(points) <= set(path)
    image = empty()
    draw_line(image, points, 1.0, 1)
    assert all(image[int(y), int(x)] for x, y in path)
    assert line_path([]) == []


def test_a_river_line_has_its_labels_width_and_at_least_a_pixel():
    sketch = Sketch(extent=1024.0, labels={("river", 2): {"width": 24.0}, ("river", 3): {"width": 0.5}})
    assert line_width(sketch, "river", 2, 99.0) == 12.0
    assert line_width(sketch, "river", 3, 99.0) == 1.0
    assert line_width(sketch, "mountain", 1, 9.0) == 18.0
