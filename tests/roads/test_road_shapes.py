"""Points on and beside the axes of roads."""

import numpy as np
import pytest

from sketchterrain.roads.road_types import axis_points, profile_at
from tests.sample_roads import curved_road, make_road, straight_road


def test_straight_road_of_one_grade_has_its_stations_alone() -> None:
    road = straight_road()
    points = axis_points(road, 0.01)
    assert np.array_equal(points.position, road.axis)
    assert points.left == pytest.approx(np.array([[0.0, 1.0]] * 3))
    edge = points.beside(points.half_width)
    assert edge == pytest.approx(np.add(road.axis, (0.0, 3.0, -0.075)))
    assert points.beside(-3.0) == pytest.approx(np.add(road.axis, (0.0, -3.0, -0.075)))


def test_points_of_a_bend_lie_on_its_circle() -> None:
    _, bridge, _ = curved_road()
    for tolerance in (1.0, 0.01):
        points = axis_points(bridge, tolerance)
        centre = np.array([300.0, 400.0])
        for offset, radius in ((0.0, 100.0), (3.0, 103.0), (-3.0, 97.0)):
            line = points.beside(offset)
            assert np.hypot(*(line[:, :2] - centre).T) == pytest.approx(radius)
            middles = 0.5 * (line[1:] + line[:-1])
            assert np.abs(np.hypot(*(middles[:, :2] - centre).T) - radius).max() <= tolerance
        angle = np.arctan2(*(points.position[:, :2] - centre).T[::-1])
        assert points.along - 200.0 == pytest.approx(100.0 * (np.pi - angle))
        assert points.beside(3.0)[:, 2] - points.position[:, 2] == pytest.approx(0.09)
        share = (points.along - 200.0) / (bridge.along[-1] - 200.0)
        assert points.position[:, 2] == pytest.approx(profile_at(bridge, 0, share))


def test_vertical_curves_are_within_the_tolerance() -> None:
    crest = make_road([(0, 0, 0), (100, 0, 0)], slope=(0.1, -0.1))
    points = axis_points(crest, 0.01)
    share = np.linspace(0.0, 1.0, 1001)
    line = np.interp(100.0 * share, points.along, points.position[:, 2])
    assert np.abs(line - profile_at(crest, np.zeros(1001, int), share)).max() <= 0.01
