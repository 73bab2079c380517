"""The country and the flight that scale is measured with."""

from types import SimpleNamespace

import numpy as np
import pytest
import shapely

from sketchterrain.benchmarks.low_flight import RATE, SECONDS, flight_views
from sketchterrain.benchmarks.synthetic_land import EXTENT, SIDE, curve_count, synthetic_land


def test_the_flight_has_the_speeds_and_heights_of_the_paper() -> None:
    def heights(x, y, *, cell_size):
        return 40.0 * np.sin(x / 900.0)

    times = np.arange(0.0, SECONDS, 1.0 / RATE)
    views = flight_views(SimpleNamespace(extent=EXTENT, heights=heights), times)
    eye = np.array([view.eye for view in views])
    speed = np.array([view.velocity[0] for view in views])
    above = eye[:, 2] - heights(eye[:, 0], eye[:, 1], cell_size=0.0)
    assert eye[-1, 0] - eye[0, 0] == pytest.approx(13_000.0, rel=0.01)
    assert np.diff(eye[:, 0]) * RATE == pytest.approx(speed[:-1])
    assert speed[[0, speed.argmin(), -1]] * 3.6 == pytest.approx([2000.0, 60.0, 90.0], rel=0.01)
    assert above[[0, -1]] == pytest.approx([5000.0, 5.0], rel=0.05)
    assert above[round(60 * RATE)] == pytest.approx(8.0, rel=0.05)
    assert above.min() > 2.0


def test_the_country_has_the_density_of_the_paper() -> None:
    side = 60
    sketch = synthetic_land(side)
    layer, roads = sketch.vectors["landuse"], sketch.vectors["road"]
    ends = np.stack([layer.vertices, np.roll(layer.vertices, -1, axis=0)], axis=1)
    last = layer.rings[1:] - 1
    ends[last, 1] = layer.vertices[layer.rings[:-1]]
    segments = len(np.unique(np.sort(ends @ [1.0, 1j], axis=1), axis=0))
    holes = int((np.diff(layer.parts) - 1).sum())
    curves = (segments - 6 * holes) // 2 + holes + (len(roads.vertices) - len(roads)) // 2
    assert curves == pytest.approx(curve_count(side), rel=0.03)
    assert len(layer) / side**2 * SIDE**2 == pytest.approx(190_000, rel=0.03)
    assert curve_count(SIDE) == pytest.approx(600_000, rel=0.02)


def test_roads_meet_at_shared_vertices_and_run_along_borders() -> None:
    sketch = synthetic_land(90)
    roads = sketch.vectors["road"]
    ends = np.concatenate([roads.vertices[roads.rings[:-1]], roads.vertices[roads.rings[1:] - 1]])
    _, counts = np.unique(roads.vertices, axis=0, return_counts=True)
    assert 2 <= counts.max() <= 4  # a road that ends on one that passes: T, with another one: a crossing
    assert len(np.unique(ends, axis=0)) > 10
    borders = {tuple(at) for at in sketch.vectors["landuse"].vertices.tolist()}
    assert np.mean([tuple(at) in borders for at in roads.vertices.tolist()]) > 0.9
    pieces = np.stack([roads.vertices[:-1], roads.vertices[1:]], axis=1)
    inner = np.ones(len(pieces), np.bool_)
    inner[roads.rings[1:-1] - 1] = False
    assert len(np.unique(np.sort(pieces[inner] @ [1.0, 1j], axis=1), axis=0)) == inner.sum()  # none twice
    assert shapely.is_simple(roads.shapes()).all()
