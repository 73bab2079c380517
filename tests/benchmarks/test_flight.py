"""The benchmark of flights: its meshes, its tiles, and where lines reach one pixel."""

from typing import Any

import numpy as np
import pytest

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
