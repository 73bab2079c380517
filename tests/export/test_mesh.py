"""Adaptive meshes against brute force, solids, and water meshes."""

import sys
from types import SimpleNamespace

import numpy as np
import pydelatin
import pytest

from sketchterrain.errors import InputError
from sketchterrain.export.mesh import GridMesh, adaptive_mesh, mesh_error, object_meshes
from sketchterrain.export.sampled import SampleGrid
from sketchterrain.export.targets.meshes import boundary, closed_solid
from sketchterrain.schema.layers import LAYERS


def rough(rows, columns, seed=3):
    rng = np.random.default_rng(seed)
    return np.cumsum(np.cumsum(rng.normal(0.0, 1.0, (rows, columns)), axis=0), axis=1)


ROW, COLUMN = np.indices((33, 41))
GROUNDS = {
    "flat": np.full((33, 41), 812.5),
    "slope": 3.0 * COLUMN - 2.0 * ROW,
    "cliff": np.where(COLUMN > 20, 900.0, 0.0),
    "slanting cliff": np.where(COLUMN > ROW, 900.0, 0.0),
    "spikes": np.where((ROW * 7 + COLUMN * 3) % 11 == 0, 500.0, 0.0),
    "one spike": np.where((ROW == 16) & (COLUMN == 39), 4000.0, 0.0),
    "chequers": 100.0 * ((ROW + COLUMN) % 2),
    "rough": rough(33, 41),
    "far above": 1e5 + rough(33, 41) * 0.01,
    "one row of quads": rough(2, 41),
    "one column of quads": rough(33, 2),
    "one quad": rough(2, 2),
}


def surface_by_brute_force(mesh, height):
    """Every vertex of the grid against every triangle, by barycentric coordinates in float64."""
    rows, columns = height.shape
    y, x = (each.ravel().astype(np.float64) for each in np.indices((rows, columns)))
    found = np.full(rows * columns, np.nan)
    for corners in mesh.triangles.astype(int):
        (ax, bx, cx), (ay, by, cy) = mesh.column[corners].astype(float), mesh.row[corners].astype(float)
        az, bz, cz = height[mesh.row[corners], mesh.column[corners]].astype(float)
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        wb = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
        wc = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
        inside = (wb >= -1e-12) & (wc >= -1e-12) & (wb + wc <= 1.0 + 1e-12)
        found[inside] = (az + wb * (bz - az) + wc * (cz - az))[inside]
    return found.reshape(rows, columns)


def areas(position, triangles):
    """Return the areas of triangles seen from above."""
    a, b, c = (position[triangles[:, k], :2].astype(np.float64) for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])


def test_adaptive_mesh_is_within_its_error_covers_once_and_faces_up():
    for ground, values in GROUNDS.items():
        height = values.astype(np.float32)
        rows, columns = height.shape
        for error in [0.001, 0.5, 20.0]:
            result = adaptive_mesh(height, error)
            # NaN where nothing covers it.
            off = np.abs(surface_by_brute_force(result.mesh, height) - height).max()
            assert off <= error, (error, ground)
            near = 1e-9 * max(1.0, float(np.abs(height).max()))
            assert result.error == pytest.approx(off, abs=near), (error, ground)
            mesh = result.mesh
            covered = areas(np.stack([mesh.column, -mesh.row], axis=-1), mesh.triangles)
            assert (covered > 0).all(), (error, ground)
            assert covered.sum() == (rows - 1) * (columns - 1), (error, ground)
            places = {*zip(mesh.column.tolist(), mesh.row.tolist(), strict=True)}
            assert len(places) == len(mesh.column), (error, ground)


def test_meshes_are_deterministic_and_finer_for_smaller_errors():
    assert len(adaptive_mesh(GROUNDS["flat"].astype(np.float32), 0.001).mesh.triangles) == 2
    height = GROUNDS["rough"].astype(np.float32)
    counts = [len(adaptive_mesh(height, error).mesh.triangles) for error in (40.0, 10.0, 2.0, 0.5)]
    assert counts == sorted(counts)
    assert counts[0] < counts[-1]

    for error in [0.0, -1.0, np.nan, np.inf]:
        with pytest.raises(InputError, match="expected an error"):
            adaptive_mesh(GROUNDS["flat"].astype(np.float32), error)

    height = GROUNDS["rough"].astype(np.float32)
    first, second = (adaptive_mesh(height, 2.0).mesh for _ in range(2))
    assert (first.triangles == second.triangles).all()
    assert (first.column == second.column).all()


def test_mesh_is_refined_when_the_library_misses_its_bound(monkeypatch):
    for careless in [1.5, 50.0, np.inf]:

        def result(height, *, max_error, careless=careless):
            return pydelatin.Delatin(height, max_error=min(careless * max_error, 1e30))

        monkeypatch.setitem(sys.modules, "pydelatin", SimpleNamespace(Delatin=result))
        height = GROUNDS["rough"].astype(np.float32)
        done = adaptive_mesh(height, 2.0)
        assert np.abs(surface_by_brute_force(done.mesh, height) - height).max() <= 2.0, careless


def test_solid_is_closed_and_has_the_volume_below_the_surface():
    for ground in GROUNDS:
        height = GROUNDS[ground].astype(np.float32)
        mesh = adaptive_mesh(height, 0.5).mesh
        position = np.stack([mesh.column, -mesh.row, height[mesh.row, mesh.column]], axis=-1).astype(
            np.float32
        )
        base = float(height.min()) - 10.0
        body_position, body_triangles = closed_solid(mesh, position, base)
        edges = np.concatenate([body_triangles[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.int64)
        directed = {*map(tuple, edges.tolist())}
        assert len(directed) == len(edges), ground  # each edge once …
        assert all((b, a) in directed for a, b in directed), ground  # … and once the other way
        a, b, c = (body_position[body_triangles[:, k]].astype(np.float64) for k in range(3))
        above = position[mesh.triangles][..., 2].astype(np.float64).mean(axis=1) - base
        upper = above @ areas(position, mesh.triangles)
        volume = ((a - position[0]) * np.cross(b - position[0], c - position[0])).sum() / 6.0
        assert volume == pytest.approx(upper, rel=1e-6), ground
        assert len(boundary(mesh)) == len({*boundary(mesh).tolist()}), ground


def two_triangles(columns, rows):
    column = np.array([0, columns - 1, 0, columns - 1], np.int32)
    row = np.array([rows - 1, rows - 1, 0, 0], np.int32)
    return GridMesh(column, row, np.array([[0, 1, 3], [0, 3, 2]], np.uint32))


def test_mesh_error_of_two_triangles_is_analytic():
    row, column = np.indices((33, 65))
    assert mesh_error(two_triangles(65, 33), 3.0 * column - 7.0 * row + 11.0) < 1e-12

    for position in [(1, 1), (16, 32), (31, 1), (32, 5), (7, 64), (0, 3)]:
        height = np.zeros((33, 65))
        height[position] = -12.5
        assert mesh_error(two_triangles(65, 33), height) == 12.5, position

    height = np.full((9, 9), 3.25)
    mesh = two_triangles(9, 9)
    assert mesh_error(mesh, height, np.array([3.0, 3.0, 3.0, 3.0])) == 0.25

    half = GridMesh(mesh.column, mesh.row, mesh.triangles[:1])
    assert mesh_error(half, np.zeros((9, 9))) == np.inf


GRID = SampleGrid(0.0, 0.0, 400.0, 400.0, 41, 41)
LEVEL = 20.0


def river(number, points, width):
    line = np.asarray(points, np.float64)
    number += LAYERS["river"].code << 48
    return SimpleNamespace(id=number, centreline=line, centreline_width=np.full(len(line), width, np.float32))


def lake(number, centre, radius):
    y, x = np.mgrid[0.0:401.0:4.0, 0.0:401.0:4.0]
    inside = (radius - np.hypot(x - centre[0], y - centre[1])).astype(np.float32)
    field = SimpleNamespace(west=0.0, south=0.0, spacing=4.0, inside=inside)
    number += LAYERS["lake"].code << 48
    return SimpleNamespace(id=number, shape=field, level=LEVEL)


def ground(low, height=90.0):
    heights = np.full((GRID.rows, GRID.columns), height, np.float32)
    heights[0, 0] = low
    return SimpleNamespace(grid=GRID, height=heights)


@pytest.fixture(scope="module")
def found():
    x = np.linspace(-60.0, 250.0, 80)
    line = np.stack([x, np.full(80, 200.0), np.maximum(LEVEL, 32.0 - 0.08 * x)], axis=-1)
    features = SimpleNamespace(
        lakes=[lake(3, (250.0, 200.0), 90.0)], rivers=[river(7, line, 16.0)], sea_level=LEVEL - 5.0
    )
    return {
        water.name.split()[0]: water for water in object_meshes(features, ground(LEVEL - 5.1, LEVEL - 3.0))
    }


def test_water_meshes_face_up_are_clipped_and_never_coplanar(found):
    assert list(found) == ["lake", "river", "sea"]
    for water in found.values():
        assert (areas(water.position, water.triangles) > 0.0).all()
        assert set(water.triangles.ravel().tolist()) == set(range(len(water.position)))
    water = found["lake"]
    assert (water.position[:, 2] == LEVEL).all()
    assert (
        90.0**2 < areas(water.position, water.triangles).sum() / np.pi < 96.0**2
    )  # it ends within its banks
    position = found["river"].position
    assert position[:, 0].min() == 0.0
    assert position[:, 0].max() < 250.0 - 90.0 + 20.0
    wet = np.hypot(position[:, 0] - 250.0, position[:, 1] - 200.0) < 90.0 - 1.0
    assert wet.any()
    assert (position[wet, 2] < LEVEL - 0.02).all()
    assert (position[~wet, 2] > LEVEL - 0.05).all()
    beside = np.stack([np.linspace(0.0, 300.0, 40), np.full(40, 900.0), np.full(40, 5.0)], axis=-1)
    features = SimpleNamespace(lakes=[], rivers=[river(1, beside, 8.0)], sea_level=None)
    assert not list(object_meshes(features, ground(0.0)))


def test_river_that_a_coarse_grid_has_no_channel_of_is_on_its_ground():
    line = np.stack([np.linspace(20.0, 280.0, 40), np.full(40, 200.0), np.full(40, 5.0)], axis=-1)
    features = SimpleNamespace(lakes=[], rivers=[river(1, line, 8.0)], sea_level=None)
    (water,) = object_meshes(features, ground(90.0))
    middle = np.abs(water.position[:, 1] - 200.0) < 3.0
    assert middle.any()
    assert np.abs(water.position[middle, 2] - 90.1).max() < 1e-3


def test_the_sea_is_a_rectangle_if_any_ground_is_below_it(found):
    sea = found["sea"]
    assert (sea.position[:, 2] == LEVEL - 5.0).all()
    assert areas(sea.position, sea.triangles).sum() == pytest.approx(
        (GRID.east - GRID.west) * (GRID.north - GRID.south)
    )
    features = SimpleNamespace(lakes=[], rivers=[], sea_level=LEVEL)
    assert not list(object_meshes(features, ground(LEVEL)))
