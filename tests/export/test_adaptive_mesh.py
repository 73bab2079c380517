"""Meshes within an error bound, checked by brute force on hard ground."""

from __future__ import annotations

import sys
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.export.mesh import adaptive_mesh
from sketchterrain.export.mesh_files import border, solid

pydelatin = pytest.importorskip("pydelatin")


def rough(rows: int, columns: int, seed: int = 3) -> np.ndarray:
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


def test_a_mesh_is_never_further_off_than_asked():
    for error in [0.001, 0.5, 20.0]:
        for ground in GROUNDS:
            height = GROUNDS[ground].astype(np.float32)
            made = adaptive_mesh(height, error)
            # NaN where nothing covers it.
            off = np.abs(surface_by_brute_force(made.mesh, height) - height).max()
            assert off <= error, (error, ground)
            assert made.error == pytest.approx(off, abs=1e-9 * max(1.0, float(np.abs(height).max()))), (
                error,
                ground,
            )


def test_triangles_cover_the_rectangle_once_and_face_up():
    for ground in GROUNDS:
        height = GROUNDS[ground].astype(np.float32)
        mesh = adaptive_mesh(height, 0.5).mesh
        x, y = mesh.column[mesh.triangles].astype(int), -mesh.row[mesh.triangles].astype(int)
        area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (y[:, 1] - y[:, 0]) * (x[:, 2] - x[:, 0])
        assert (area > 0).all(), ground
        assert area.sum() == 2 * (height.shape[0] - 1) * (height.shape[1] - 1), ground
        assert len({*zip(mesh.column.tolist(), mesh.row.tolist(), strict=True)}) == len(mesh.column), ground


def test_meshes_are_deterministic_and_grow_with_finer_errors():
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


def test_a_library_that_misses_its_own_bound_is_asked_again(monkeypatch):
    for careless in [1.5, 50.0, np.inf]:

        def made(height, *, max_error, careless=careless):
            return pydelatin.Delatin(height, max_error=min(careless * max_error, 1e30))

        monkeypatch.setitem(sys.modules, "pydelatin", SimpleNamespace(Delatin=made))
        height = GROUNDS["rough"].astype(np.float32)
        done = adaptive_mesh(height, 2.0)
        assert np.abs(surface_by_brute_force(done.mesh, height) - height).max() <= 2.0, careless


def test_a_solid_is_closed_and_has_the_volume_under_the_ground():
    for ground in GROUNDS:
        height = GROUNDS[ground].astype(np.float32)
        mesh = adaptive_mesh(height, 0.5).mesh
        place = np.stack([mesh.column, -mesh.row, height[mesh.row, mesh.column]], axis=-1).astype(np.float32)
        base = float(height.min()) - 10.0
        body = solid(mesh, place, base)
        edges = np.concatenate([body.triangles[:, [k, (k + 1) % 3]] for k in range(3)]).astype(np.int64)
        there = {*map(tuple, edges.tolist())}
        assert len(there) == len(edges), ground  # each edge once …
        assert all((b, a) in there for a, b in there), ground  # … and once the other way
        a, b, c = (body.place[body.triangles[:, k]].astype(np.float64) for k in range(3))
        upper = (place[mesh.triangles][..., 2].astype(np.float64).mean(axis=1) - base) @ _areas(place, mesh)
        volume = ((a - place[0]) * np.cross(b - place[0], c - place[0])).sum() / 6.0
        assert volume == pytest.approx(upper, rel=1e-6), ground
        assert len(border(mesh)) == len({*border(mesh).tolist()}), ground


def _areas(place, mesh):
    a, b, c = (place[mesh.triangles[:, k], :2].astype(np.float64) for k in range(3))
    return 0.5 * ((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
