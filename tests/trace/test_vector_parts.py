"""Clipping, rasterising and classing of vectors, against shapely and against brute force."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from sketchterrain.metric_crs import metric_crs, named_crs
from sketchterrain.trace.label_classes import classed
from sketchterrain.trace.stroke_painting import paint_areas, paint_lines
from sketchterrain.trace.vector_clip import ring_in, segments_in, segments_of
from sketchterrain.trace.vector_place import area_of, metric, reprojected, unrolled

BOX = (2.0, 1.0, 8.0, 6.0)


def walk(seed: int, count: int, size: float = 10.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(-0.3 * size, 1.3 * size, (count, 2))


def test_lines_are_clipped_as_shapely_clips_them() -> None:
    for seed in range(20):
        line = walk(seed, 15)
        if seed % 3 == 0:
            line = np.round(line)  # vertices on the rectangle's edges, segments along them
        parts = segments_in(segments_of(line), BOX)
        expected = shapely.intersection(shapely.linestrings(line), shapely.box(*BOX))
        lengths = np.hypot(*(parts[:, 1] - parts[:, 0]).T)
        doubled = shapely.length(
            shapely.intersection(shapely.linestrings(segments_of(line)), shapely.box(*BOX))
        )
        assert lengths.sum() == pytest.approx(doubled.sum()), seed
        if len(parts):
            assert shapely.hausdorff_distance(shapely.multilinestrings(parts), expected) < 1e-9, seed


def test_clipped_rings_hold_the_same_area() -> None:
    for seed in range(20):
        angle = np.sort(np.random.default_rng(seed).uniform(0, 2 * np.pi, 12))
        away = np.random.default_rng(seed + 1).uniform(0.5, 7, (12, 1))
        corners = np.stack([np.cos(angle), np.sin(angle)], axis=-1) * away + (5, 4)
        ring = np.concatenate([corners, corners[:1]])
        cut = ring_in(ring, BOX)
        wanted = shapely.intersection(shapely.polygons(ring), shapely.box(*BOX))
        assert shapely.symmetric_difference(shapely.make_valid(shapely.polygons(cut)), wanted).area < 1e-9, (
            seed
        )
        np.testing.assert_array_equal(cut[0], cut[-1])

    around = shapely.get_coordinates(shapely.box(-5, -5, 20, 20))
    assert shapely.polygons(ring_in(around, BOX)).equals(shapely.box(*BOX))
    assert len(ring_in(around + 100.0, BOX)) == 0


@given(st.integers(0, 1000), st.integers(1, 12), st.floats(0, 6), st.integers(1, 40), st.integers(1, 40))
def test_a_line_holds_together_however_thin_it_is(seed, count, width, rows, columns) -> None:
    line = np.random.default_rng(seed).uniform(0, (columns, rows), (count, 2))
    painted = paint_lines((rows, columns), segments_of(line), width)
    assert ndimage.label(painted, np.ones((3, 3)))[1] == 1
    column, row = np.floor(line).astype(int).T
    assert painted[row, column].all()


def test_a_wide_line_covers_pixel_centres_within_half_its_width() -> None:
    for width in [1.5, 2.0, 5.0, 13.7, 60.0]:
        line = walk(7, 6, 50.0)
        painted = paint_lines((50, 60), segments_of(line), width)
        rows, columns = np.indices((50, 60)) + 0.5
        away = shapely.distance(shapely.linestrings(line), shapely.points(columns, rows))
        assert painted[away < 0.5 * width - 0.1].all(), width
        beyond = painted & (away > 0.5 * width + 0.1)
        assert (away[beyond] < 0.75).all(), width  # only what the course itself runs through

    painted = paint_lines((40, 40), segments_of(np.array([[20.0, 20.0]])), 20.0)
    assert painted.sum() == pytest.approx(np.pi * 100, rel=0.02)


def test_areas_with_holes_are_painted_by_middles_or_by_touch() -> None:
    ring, hole = (
        shapely.get_coordinates(shapely.box(*each)) for each in [(1.4, 1.4, 8.6, 8.6), (4, 4, 6, 6)]
    )
    painted = paint_areas((10, 10), [[ring, hole]], touched=False)
    assert painted.sum() == 8 * 8 - 4 - 28 + 28
    assert not painted[4:6, 4:6].any()
    assert paint_areas((10, 10), [[ring]], touched=True).sum() == 64
    assert not paint_areas((10, 10), [], touched=True).any()


def test_equal_properties_share_a_label_in_order_of_appearance() -> None:
    wanted = [{"width": 3.0}, {"width": 1.0}, {"width": 3.0}, {}]
    classes = classed(wanted, 16)
    assert classes.of == (0, 1, 0, 2)
    assert classes.properties == ({"width": 3.0}, {"width": 1.0}, {})
    assert classes.error == 0.0

    classes = classed([{"kind": str(index)} for index in range(20)], 16)
    assert classes.properties == ({},)
    assert set(classes.of) == {0}


@given(st.lists(st.floats(0.1, 2000), min_size=1, max_size=80), st.integers(1, 16))
def test_no_more_labels_than_there_may_be_and_no_larger_error_than_told(values, most) -> None:
    wanted = [{"width": value, "kind": "a"} for value in values]
    classes = classed(wanted, most)
    assert 1 <= len(classes.properties) <= most
    for value, index in zip(values, classes.of, strict=True):
        if np.isfinite(classes.error):
            assert abs(classes.properties[index]["width"] / value - 1) <= classes.error + 1e-12


def test_areas_are_of_whole_pixels_and_unrolled_at_the_antimeridian() -> None:
    area = area_of((100.4, 200.0, 1100.2, 700.0), 100, chosen=True)
    assert (area.west, area.south, area.extent) == (100, 200, 1001)
    assert (area.columns, area.rows) == (100, 50)
    assert area.rows * area.pixel >= 500
    np.testing.assert_allclose(area.pixels(np.array([100.0, 200.0])), [0, 50])
    slim = area_of((0, 0, 0, 1000), 100, chosen=False)
    assert (slim.columns, slim.rows, slim.west) == (25, 100, -125)

    places = np.array([[179.0, 1.0], [-179.0, 2.0]])
    np.testing.assert_array_equal(unrolled(places), [[179, 1], [181, 2]])
    wide = np.array([[-100.0, 1.0], [0.0, 0.0], [100.0, 2.0]])
    np.testing.assert_array_equal(unrolled(wide), wide)


def test_metres_of_the_zone_are_metres_on_the_ground() -> None:
    for lon in [-179.5, -60.0, 0.1, 11.0, 179.5]:
        for lat in [-79.0, -33.0, 0.1, 47.0, 83.0]:
            crs = metric(named_crs("OGC:CRS84"), (lon, lat))
            step = 0.001
            a, b = reprojected(np.array([(lon, lat), (lon, lat + step)]), named_crs("OGC:CRS84"), crs)
            assert np.hypot(*(b - a)) == pytest.approx(step * 111_200, rel=0.006), (lon, lat)
            assert metric(crs, tuple(a)) == crs, (lon, lat)


def test_a_crs_is_a_code_a_urn_or_wkt() -> None:
    crs = metric_crs("EPSG:25832")
    for text in (
        "epsg:25832 ",
        "urn:ogc:def:crs:EPSG::25832",
        crs.to_wkt(),
        "+proj=utm +zone=32 +ellps=GRS80",
    ):
        assert metric_crs(text).is_projected
    assert metric_crs(crs.to_wkt()) == crs
