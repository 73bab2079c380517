"""Error of a mesh: analytic cases, and SciPy's interpolation between the same triangles."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import LinearNDInterpolator
from scipy.spatial import Delaunay

from sketchterrain.export.mesh import Mesh, grid_mesh, mesh_error


def two_triangles(columns: int, rows: int) -> Mesh:
    column = np.array([0, columns - 1, 0, columns - 1], np.int32)
    row = np.array([rows - 1, rows - 1, 0, 0], np.int32)
    return Mesh(column, row, np.array([[0, 1, 3], [0, 3, 2]], np.uint32))


def test_a_mesh_of_all_vertices_is_exact_and_faces_up():
    for shape in [(2, 2), (2, 9), (9, 2), (17, 12)]:
        rows, columns = shape
        height = np.random.default_rng(1).normal(0.0, 100.0, shape).astype(np.float32)
        mesh = grid_mesh(columns, rows)
        assert mesh_error(mesh, height) == 0.0, shape
        x, y = mesh.column[mesh.triangles].astype(int), -mesh.row[mesh.triangles].astype(int)
        area = (x[:, 1] - x[:, 0]) * (y[:, 2] - y[:, 0]) - (y[:, 1] - y[:, 0]) * (x[:, 2] - x[:, 0])
        assert (area == 1).all(), shape
        assert len(area) == 2 * (rows - 1) * (columns - 1), shape


def test_errors_of_two_triangles_are_analytic():
    row, column = np.indices((33, 65))
    assert mesh_error(two_triangles(65, 33), 3.0 * column - 7.0 * row + 11.0) < 1e-12

    for place in [(1, 1), (16, 32), (31, 1), (32, 5), (7, 64), (0, 3)]:
        height = np.zeros((33, 65))
        height[place] = -12.5
        assert mesh_error(two_triangles(65, 33), height) == 12.5, place

    height = np.full((9, 9), 3.25)
    mesh = two_triangles(9, 9)
    assert mesh_error(mesh, height, np.array([3.0, 3.0, 3.0, 3.0])) == 0.25

    mesh = two_triangles(9, 9)
    half = Mesh(mesh.column, mesh.row, mesh.triangles[:1])
    assert mesh_error(half, np.zeros((9, 9))) == np.inf


@pytest.mark.slow
def test_any_triangles_against_another_interpolation():
    for seed in range(4):
        rng = np.random.default_rng(seed)
        rows, columns = 41, 57
        height = rng.normal(0.0, 50.0, (rows, columns))
        ends = [(0, 0), (columns - 1, 0), (0, rows - 1), (columns - 1, rows - 1)]
        inner = np.stack([rng.integers(0, columns, 60), rng.integers(0, rows, 60)], axis=-1)
        places = np.unique(np.concatenate([ends, inner]), axis=0)
        made = Delaunay(places)
        mesh = Mesh(
            places[:, 0].astype(np.int32), places[:, 1].astype(np.int32), made.simplices.astype(np.uint32)
        )
        surface = LinearNDInterpolator(made, height[places[:, 1], places[:, 0]])
        row, column = np.indices(height.shape)
        off = np.abs(surface(column.ravel(), row.ravel()) - height.ravel())
        assert mesh_error(mesh, height) == pytest.approx(np.nanmax(off), rel=1e-9), seed
