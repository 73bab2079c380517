"""Meshes of the ground: what is measured of them, and the uniform grids beside."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.benchmarks import meshes
from sketchterrain.export.mesh_error import mesh_error


@pytest.mark.parametrize("shape", [(33, 33), (17, 65), (5, 40)])
@pytest.mark.parametrize("least", [1, 7, 90, 10_000])
def test_a_uniform_grid_covers_the_ground_with_no_fewer_triangles(shape, least):
    mesh = meshes.uniform_mesh(*shape, least=least)
    assert len(mesh.triangles) >= min(least, 2 * (shape[0] - 1) * (shape[1] - 1))
    assert mesh_error(mesh, np.zeros(shape)) == 0.0  # infinite if any vertex were uncovered


def test_errors_are_kept_and_uniform_grids_are_further_off(context, tiny):
    pytest.importorskip("pydelatin")
    (table,) = meshes.measure(context, tiny).tables
    assert [row["asked"] for row in table.rows] == list(tiny.mesh_errors)
    for row in table.rows:
        assert 0.0 < row["error"] <= row["asked"]
        assert row["uniform_triangles"] >= row["triangles"]
        assert row["uniform_error"] > row["error"]


def test_without_the_library_its_absence_is_told(context, tiny, monkeypatch):
    monkeypatch.setattr(meshes, "missing", lambda libraries: libraries)
    (table,) = meshes.measure(context, tiny).tables
    assert "pydelatin" in table.rows[0]["note"]
