from __future__ import annotations

import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.errors import InputError
from sketchterrain.export import quantised_weights
from sketchterrain.export.sampled import BYTES_PER_VERTEX, Grid, sample
from sketchterrain.terrain import Raster, raster_windows


def test_the_sketch_s_rectangle_is_the_raster_to_the_bit(terrain: st.Terrain, raster: Raster) -> None:
    grid = Grid(0.0, 0.0, *terrain.size, columns=129, rows=97)
    sampled = sample(terrain, grid)
    np.testing.assert_array_equal(sampled.height, raster.height)
    np.testing.assert_array_equal(sampled.weights, quantised_weights(raster.materials))
    assert np.abs(sampled.normal / 127.5 - 1.0 - raster.normal).max() <= 0.5 / 127.5 + 1e-6
    kept = (sampled.height, sampled.normal, sampled.weights)
    assert sum(each.nbytes for each in kept) == BYTES_PER_VERTEX * 129 * 97


def test_bands_change_no_bit(terrain: st.Terrain, monkeypatch: pytest.MonkeyPatch) -> None:
    grid = Grid(-100.0, 50.0, 800.0, 1100.0, columns=150, rows=201)
    whole = sample(terrain, grid)
    monkeypatch.setattr(raster_windows, "_PATCHES_PER_BAND", 1)
    told: list[float] = []
    banded = sample(terrain, grid, progress=told.append)
    for one, other in zip(vars(whole).values(), vars(banded).values(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(told) == 4
    assert told == sorted(told)
    assert told[-1] == 1.0


def test_vertices_are_where_the_grid_says(terrain: st.Terrain) -> None:
    """Whole lattice steps apart, outside of the sketch too."""
    grid = Grid(-128.0, -64.0, 896.0, 1216.0, columns=65, rows=81)
    x = np.linspace(grid.west, grid.east, grid.columns)
    y = np.linspace(grid.north, grid.south, grid.rows)
    expected = terrain.heights(x[None], y[:, None], cell_size=16.0)
    np.testing.assert_array_equal(sample(terrain, grid).height, expected)


def test_a_part_is_a_view_that_knows_where_it_lies(terrain: st.Terrain) -> None:
    grid = Grid(0.0, 0.0, 1024.0, 768.0, columns=65, rows=49)
    sampled = sample(terrain, grid)
    part = sampled.part(16, 8, 33, 25)
    assert part.height.base is sampled.height
    np.testing.assert_array_equal(part.height, sampled.height[8:33, 16:49])
    assert part.grid == Grid(256.0, 256.0, 768.0, 640.0, columns=33, rows=25)
    np.testing.assert_array_equal(sample(terrain, part.grid).height, part.height)


def test_empty_and_non_finite_rectangles_are_refused(terrain: st.Terrain) -> None:
    for grid in [
        Grid(0.0, 0.0, 1.0, 1.0, 1, 2),
        Grid(0.0, 0.0, 0.0, 1.0, 2, 2),
        Grid(0.0, 1.0, 1.0, 0.0, 2, 2),
        Grid(0.0, 0.0, float("nan"), 1.0, 2, 2),
        Grid(0.0, 0.0, float("inf"), 1.0, 2, 2),
        Grid(0.0, 0.0, 1e300, 1.0, 2, 2),
    ]:
        with pytest.raises(InputError, match=r"expected|must be"):
            list(terrain.grid(*grid.area, columns=grid.columns, rows=grid.rows))
