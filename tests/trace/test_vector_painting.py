"""Painting of lines and areas against brute force; few labels for many features; areas and zones."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from sketchterrain.metric_crs import metric_crs, named_crs
from sketchterrain.trace.vector_kinds import classed
from sketchterrain.trace.vector_place import area_of, metric, middle_longitude, reprojected
from sketchterrain.trace.vectors import paint_areas, paint_lines


@given(st.integers(0, 1000), st.integers(2, 12), st.floats(0, 6), st.integers(1, 40), st.integers(1, 40))
def test_a_line_holds_together_however_thin_it_is(seed, count, width, rows, columns) -> None:
    line = np.random.default_rng(seed).uniform(0, (columns, rows), (count, 2))
    painted = paint_lines((rows, columns), np.array([shapely.LineString(line)]), np.array([width]))
    assert ndimage.label(painted, np.ones((3, 3)))[1] == 1
    column, row = np.floor(line).astype(int).T
    assert painted[row, column].all()


def test_a_wide_line_covers_pixel_centres_within_half_its_width() -> None:
    line = shapely.LineString(np.random.default_rng(7).uniform(-15, 65, (6, 2)))
    rows, columns = np.indices((50, 60)) + 0.5
    away = shapely.distance(line, shapely.points(columns, rows))
    for width in [0.5, 1.5, 2.0, 5.0, 13.7, 60.0, 1e6]:
        painted = paint_lines((50, 60), np.array([line]), np.array([width]))
        assert painted[away < 0.5 * width - 0.1].all(), width
        beyond = painted & (away > 0.5 * width + 0.1)
        assert (away[beyond] < 0.75).all(), width  # only what the course itself touches

    disc = paint_lines((40, 40), np.array([shapely.Point(20, 20)]), np.array([20.0]))
    assert disc.sum() == pytest.approx(np.pi * 100, rel=0.02)
    assert not paint_lines((9, 9), np.array([]), np.array([])).any()


def test_areas_with_holes_are_painted_by_middles_or_by_touch() -> None:
    whole, hole = shapely.box(1.4, 1.4, 8.6, 8.6), shapely.box(4, 4, 6, 6)
    painted = paint_areas((10, 10), np.array([whole - hole]), touched=False)
    assert painted.sum() == 8 * 8 - 4
    assert not painted[4:6, 4:6].any()
    assert paint_areas((10, 10), np.array([whole]), touched=True).sum() == 64
    assert not paint_areas((10, 10), np.array([]), touched=True).any()


def test_equal_properties_share_a_label_in_order_of_appearance() -> None:
    wanted = [{"width": 3.0}, {"width": 1.0}, {"width": 3.0}, {}]
    assert classed(wanted, 16) == ([0, 1, 0, 2], [{"width": 3.0}, {"width": 1.0}, {}], 0.0)
    assert classed([{"kind": str(index)} for index in range(20)], 16) == ([0] * 20, [{}], np.inf)


@given(st.lists(st.floats(0.1, 2000), min_size=1, max_size=80), st.integers(1, 16))
def test_labels_and_their_error_are_bounded(values, most) -> None:
    of, classes, error = classed([{"width": value, "kind": "a"} for value in values], most)
    assert 1 <= len(classes) <= most
    for value, index in zip(values, of, strict=True):
        if np.isfinite(error):
            assert abs(classes[index]["width"] / value - 1) <= error + 1e-12


def test_areas_are_of_whole_pixels() -> None:
    area = area_of((100.4, 200.0, 1100.2, 700.0), 100, chosen=True)
    assert (area.west, area.south, area.extent) == (100, 200, 1001)
    assert (area.columns, area.rows) == (100, 50)
    assert area.rows * area.pixel >= 500
    np.testing.assert_allclose(area.pixels(np.array([[100.0, 200.0]])), [[0, 50]])
    slim = area_of((0, 0, 0, 1000), 100, chosen=False)
    assert (slim.columns, slim.rows, slim.west) == (25, 100, -125)


def test_metres_of_the_zone_are_metres_on_the_ground() -> None:
    degrees = named_crs("OGC:CRS84")
    for lon in [-179.5, -60.0, 0.1, 11.0, 179.5]:
        for lat in [-79.0, -33.0, 0.1, 47.0, 83.0]:
            crs = metric(degrees, (lon, lat))
            step = 0.001
            a, b = reprojected(np.array([(lon, lat), (lon, lat + step)]), degrees, crs)
            assert np.hypot(*(b - a)) == pytest.approx(step * 111_200, rel=0.006), (lon, lat)
            assert metric(crs, tuple(a)) == crs, (lon, lat)
    for longitudes, middle in [([10, 20], 15), ([179, -179], 180), ([190, 200], -165)]:
        off = middle_longitude(np.array(longitudes)) - middle
        assert np.cos(np.radians(off)) == pytest.approx(1.0), longitudes


def test_a_crs_is_a_code_a_urn_or_wkt() -> None:
    crs = metric_crs("EPSG:25832")
    for text in [
        "epsg:25832 ",
        "urn:ogc:def:crs:EPSG::25832",
        crs.to_wkt(),
        "+proj=utm +zone=32 +ellps=GRS80",
    ]:
        assert metric_crs(text).is_projected
    assert metric_crs(crs.to_wkt()) == crs
