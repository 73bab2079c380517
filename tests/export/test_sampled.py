"""A terrain sampled at a grid, and its features as JSON."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.errors import InputError
from sketchterrain.export import quantised_weights, write_features
from sketchterrain.export.sampled import BYTES_PER_VERTEX, Grid, sample
from sketchterrain.features import FEATURE, FEATURE_TYPES, Lake, ShapeField
from sketchterrain.terrain import Raster, TerrainFeatures, raster_windows


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


def test_vertices_and_parts_are_where_the_grid_says(terrain: st.Terrain) -> None:
    """Whole lattice steps apart, outside of the sketch too."""
    grid = Grid(-128.0, -64.0, 896.0, 1216.0, columns=65, rows=81)
    x = np.linspace(grid.west, grid.east, grid.columns)
    y = np.linspace(grid.north, grid.south, grid.rows)
    expected = terrain.heights(x[None], y[:, None], cell_size=16.0)
    np.testing.assert_array_equal(sample(terrain, grid).height, expected)

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


COMMON = {"id", "type", "x", "y", "radius", "strength", "painted"}


@pytest.fixture
def told(tmp_path: Path, terrain: st.Terrain) -> dict[str, Any]:
    (path,) = write_features(tmp_path, terrain.features)
    result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return result


def test_points_rivers_and_types_are_written_exactly(told: dict[str, Any], terrain: st.Terrain) -> None:
    assert list(told) == ["format", "features", "splines", "lakes"]
    assert told["format"] == 1

    points = terrain.features.points
    assert {"mountain", "hill", "forest"} <= {entry["type"] for entry in told["features"]}
    assert [entry["id"] for entry in told["features"]] == points["id"].tolist()
    for entry, point in zip(told["features"], points, strict=True):
        assert entry["type"] == FEATURE_TYPES[point["type"]]
        assert (entry["x"], entry["y"]) == (point["x"], point["y"])
        for name in entry.keys() - {"id", "type", "x", "y", "painted", "conifers"}:
            assert np.float32(entry[name]) == point[name]
        assert entry["painted"] is bool(point["painted"])

    rivers = terrain.features.rivers
    assert len(told["splines"]) == len(rivers) > 0
    for entry, river in zip(told["splines"], rivers, strict=True):
        assert (entry["id"], entry["type"], entry["label"]) == (river.id, "river", river.label)
        np.testing.assert_array_equal(entry["points"], river.points)
        np.testing.assert_array_equal(entry["centreline"], river.centreline)
        assert len(entry["width"]) == len(entry["depth"]) == len(entry["points"])
        assert len(entry["centreline_width"]) == len(entry["centreline_depth"]) == len(entry["centreline"])
        assert (np.diff(np.array(entry["centreline"])[:, 2]) <= 0).all()


def test_each_type_has_only_its_own_properties_and_a_lake_its_outline(tmp_path: Path) -> None:
    points = np.zeros(len(FEATURE_TYPES), FEATURE)
    points["type"] = np.arange(len(points))
    (path,) = write_features(tmp_path, TerrainFeatures(points, ()))
    told = json.loads(path.read_text(encoding="utf-8"))
    own = {entry["type"]: entry.keys() - COMMON for entry in told["features"]}
    assert own == {
        "mountain": {"peakiness", "erosion", "gullies"},
        "hill": {"erosion", "gullies"},
        "dune": {"wavelength", "wind"},
        "forest": {"conifers"},
    }
    assert told["splines"] == []

    point = np.zeros(1, FEATURE)
    point["peakiness"], point["id"] = 0.6, 2**64 - 1
    text = write_features(tmp_path, TerrainFeatures(point, ()))[0].read_text(encoding="utf-8")
    assert '"peakiness": 0.6,' in text
    assert '"id": 18446744073709551615,' in text

    (path,) = write_features(tmp_path, TerrainFeatures(np.zeros(0, FEATURE), ()))
    nothing = {"format": 1, "features": [], "splines": [], "lakes": []}
    assert json.loads(path.read_text(encoding="utf-8")) == nothing

    step = np.arange(-30, 31)
    ring = 60 - np.abs(np.hypot(step, step[:, None]) * 5 - 80)  # an island of 20 m in a lake of 140 m
    lake = Lake(77, 3, ShapeField(350.0, 850.0, 5.0, ring.astype(np.float32)), 12.5, 6.0)
    (path,) = write_features(tmp_path, TerrainFeatures(np.zeros(0, FEATURE), (), (lake,)))
    (told,) = json.loads(path.read_text(encoding="utf-8"))["lakes"]
    assert (told["id"], told["label"], told["level"], told["depth"]) == (77, 3, 12.5, 6.0)
    radii = sorted(float(np.hypot(*(np.array(r) - (500, 1000)).T).mean()) for r in told["outline"])
    np.testing.assert_allclose(radii, [20, 140], atol=0.6)
    assert all(outline[0] == outline[-1] for outline in told["outline"])
