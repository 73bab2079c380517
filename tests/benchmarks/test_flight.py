"""The benchmarks of flights and of scale: meshes, tiles, the country, and where lines reach one pixel."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import shapely

from sketchterrain.benchmarks.flight import MOST, at_one_pixel, reaching
from sketchterrain.benchmarks.flight_methods import MESHERS, THESIS, Mesher, Square, mesher
from sketchterrain.benchmarks.flight_scene import (
    EXTENT,
    PICTURE,
    OwnTiles,
    Tiles,
    View,
    _refined,
    drawn,
    stops,
    uniform_tiles,
    view_of,
    within_world,
)
from sketchterrain.benchmarks.low_flight import RATE, SECONDS, flight_views
from sketchterrain.benchmarks.synthetic_land import EXTENT as COUNTRY
from sketchterrain.benchmarks.synthetic_land import SIDE, curve_count, synthetic_land


def test_the_flight_stays_above_the_ground_and_is_always_the_same(world):
    path = stops(world, 40)
    assert all(stop.camera.eye[2] > stop.ground + 1.9 for stop in path)
    assert path == stops(world, 40)


def test_where_a_line_reaches_a_pixel_is_read_in_logarithms():
    rows: list[Any] = [
        {"way": "a", MOST: 4.0, "triangles": 100, "ms": 1.0, "setting": 1.0},
        {"way": "a", MOST: 0.25, "triangles": 10_000, "ms": 4.0, "setting": 2.0},
        {"way": "b", MOST: 4.0, "triangles": 100, "ms": 1.0, "setting": 1.0},
    ]
    assert reaching(rows, "a", "triangles") == pytest.approx(1000)
    assert reaching(rows, "b", "triangles") is None
    assert reaching(rows, "c", "triangles") is None
    rows += [
        {**row, "way": f"{THESIS}, 64 quads", "triangles": 2 * int(row["triangles"])} for row in rows[:2]
    ]
    ratio = {row["way"]: row["of_thesis"] for row in at_one_pixel(rows).rows}
    assert ratio["a"] == pytest.approx(0.5)


def test_refined_heights_lie_on_the_coarse_triangles():
    rng = np.random.default_rng(1)
    coarse = rng.normal(size=(2, 5, 5))
    fine = _refined(coarse)
    assert (fine[:, ::2, ::2] == coarse).all()
    # Row 0 lies north: the middle of a quad is on its diagonal from north-west to south-east.
    assert fine[0, 1, 1] == pytest.approx((coarse[0, 0, 0] + coarse[0, 1, 1]) / 2)


def test_tiles_that_show_all_of_their_parent_have_its_surface(world):
    view = View(stops(world, 1)[0], PICTURE)
    own = uniform_tiles(EXTENT, 32, 3)
    whole = Tiles(32, own.places, own.cases, np.ones((len(own), 3, 3), np.float32))
    parents = {
        tuple(tiles.places[i]): vertices[i]
        for tiles, vertices in drawn(world, uniform_tiles(EXTENT, 32, 2), view).parts
        for i in range(len(tiles))
    }
    compared = 0
    for tiles, vertices in drawn(world, whole, view).parts:
        for (level, col, row), mine in zip(tiles.places.tolist(), vertices, strict=True):
            parent = parents.get((level - 1, col // 2, row // 2))
            if parent is None:
                continue
            place = {tuple(point[:2]): point[2] for point in parent}
            shared = [(point[2], place[tuple(point[:2])]) for point in mine if tuple(point[:2]) in place]
            assert len(shared) == 17 * 17
            assert all(a == b for a, b in shared)
            compared += 1
    assert compared


@pytest.mark.slow
def test_own_tiles_cover_the_view_once(world):
    stop = stops(world, 1)[0]
    frame = OwnTiles(world, quads=32, tolerance=64.0).converge(view_of(stop, EXTENT))
    tiles = within_world(frame.draws, 32)
    finest = int(tiles.places[:, 0].max())
    covered = np.zeros((2**finest, 2**finest), int)
    for level, col, row in tiles.places.tolist():
        width = 2 ** (finest - level)
        covered[row * width : (row + 1) * width, col * width : (col + 1) * width] += 1
    assert covered.max() == 1
    assert frame.tiles >= len(tiles)


@pytest.mark.parametrize("name", MESHERS)
def test_peers_put_heights_where_they_belong(name):
    pytest.importorskip(name)
    peer = mesher(name)
    row, col = np.mgrid[:257, :257]
    heights = (8 * np.sin(col / 20) + 0.05 * row).astype(np.float32)
    mesh = _mesh(peer, Square(100.0, 200.0, 512.0, heights))
    x, y, z = mesh.vertices.T
    assert (x.min(), x.max(), y.min(), y.max()) == (100.0, 612.0, 200.0, 712.0)
    assert z == pytest.approx(8 * np.sin((x - 100) / 2 / 20) + 0.05 * (712 - y) / 2, abs=1e-4)
    assert 2 <= len(mesh.triangles) < 2 * 256**2 / 4


def _mesh(peer: Mesher | object, square: Square) -> Any:
    return peer.mesh(square, 0.05)  # type: ignore[union-attr]


def test_the_flight_has_the_speeds_and_heights_of_the_paper() -> None:
    def heights(x, y, *, cell_size):
        return 40.0 * np.sin(x / 900.0)

    times = np.arange(0.0, SECONDS, 1.0 / RATE)
    views = flight_views(SimpleNamespace(extent=COUNTRY, heights=heights), times)
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
