"""The benchmark of adaptive meshes, and the uniform grids they are compared with."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from sketchterrain.benchmarks import meshes
from sketchterrain.export.mesh import mesh_error


def test_a_uniform_grid_covers_the_ground_with_no_fewer_triangles():
    for shape, least in itertools.product([(33, 33), (17, 65), (5, 40)], [1, 7, 90, 10_000]):
        mesh = meshes.uniform_mesh(*shape, least=least)
        assert len(mesh.triangles) >= min(least, 2 * (shape[0] - 1) * (shape[1] - 1)), (shape, least)
        # Infinite if any vertex were uncovered.
        assert mesh_error(mesh, np.zeros(shape)) == 0.0, (shape, least)


@pytest.mark.slow
def test_errors_are_kept_and_uniform_grids_are_further_off(context, tiny):
    pytest.importorskip("pydelatin")
    (table,) = meshes.measure(context, tiny).tables
    assert [row["asked"] for row in table.rows] == list(tiny.mesh_errors)
    for row in table.rows:
        assert 0.0 < row["error"] <= row["asked"]
        assert row["uniform_triangles"] >= row["triangles"]
        assert row["uniform_error"] > row["error"]
