from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import sketchterrain as st
from sketchterrain.export import write_features
from sketchterrain.features import FEATURE, FEATURE_TYPES, Lake, ShapeField
from sketchterrain.terrain import TerrainFeatures

COMMON = {"id", "type", "x", "y", "radius", "strength", "painted"}


@pytest.fixture
def told(tmp_path: Path, terrain: st.Terrain) -> dict[str, Any]:
    (path,) = write_features(tmp_path, terrain.features)
    result: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return result


def test_every_point_feature_is_written_exactly(told: dict[str, Any], terrain: st.Terrain) -> None:
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


def test_each_type_has_only_its_own_properties_in_short_numbers(tmp_path: Path) -> None:
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


def test_rivers_are_splines_from_spring_to_mouth(told: dict[str, Any], terrain: st.Terrain) -> None:
    rivers = terrain.features.rivers
    assert len(told["splines"]) == len(rivers) > 0
    for entry, river in zip(told["splines"], rivers, strict=True):
        assert (entry["id"], entry["type"], entry["label"]) == (river.id, "river", river.label)
        np.testing.assert_array_equal(entry["points"], river.points)
        np.testing.assert_array_equal(entry["centreline"], river.centreline)
        assert len(entry["width"]) == len(entry["depth"]) == len(entry["points"])
        assert len(entry["centreline_width"]) == len(entry["centreline_depth"]) == len(entry["centreline"])
        assert (np.diff(np.array(entry["centreline"])[:, 2]) <= 0).all()


def test_a_lake_is_its_outline(tmp_path: Path) -> None:
    step = np.arange(-30, 31)
    ring = 60 - np.abs(np.hypot(step, step[:, None]) * 5 - 80)  # an island of 20 m in a lake of 140 m
    lake = Lake(77, 3, ShapeField(350.0, 850.0, 5.0, ring.astype(np.float32)), 12.5, 6.0)
    (path,) = write_features(tmp_path, TerrainFeatures(np.zeros(0, FEATURE), (), (lake,)))
    (told,) = json.loads(path.read_text(encoding="utf-8"))["lakes"]
    assert (told["id"], told["label"], told["level"], told["depth"]) == (77, 3, 12.5, 6.0)
    radii = sorted(float(np.hypot(*(np.array(r) - (500, 1000)).T).mean()) for r in told["outline"])
    np.testing.assert_allclose(radii, [20, 140], atol=0.6)
    assert all(outline[0] == outline[-1] for outline in told["outline"])
