"""Land use in features.json, GeoPackages, reports and on maps."""

from __future__ import annotations

import json

import numpy as np
import pyogrio
import pytest
import shapely

from sketchterrain.document.sketch import Sketch
from sketchterrain.export.map.relief import LAND_CLASSES, MapFrame, MapSamples, shaded_relief
from sketchterrain.export.map.sheet import legend_entries
from sketchterrain.export.vectors import (
    Origin,
    geopackage,
    land_entries,
    land_facts,
    land_layer,
    land_shares,
    write_features,
)
from sketchterrain.features.table import AREA, Feature, FeatureTable
from sketchterrain.landforms.placement.feature_types import FEATURE
from sketchterrain.roads.road_types import RoadNetwork
from sketchterrain.schema.layers import LAND_USES
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.schema.styles import rgb_from_hex
from sketchterrain.terrain.surfaces import TerrainFeatures

ORIGIN = Origin(512_000.0, 5_403_000.0)
EXTENT = 100.0


def ring(west, south, east, north):
    return np.array([[west, south], [east, south], [east, north], [west, north]], float)


@pytest.fixture(scope="module")
def sketch() -> Sketch:
    """Return a field with a meadow on it and a hole for a village, and a second field beside it."""
    areas = [
        Feature(AREA, (ring(0, 0, 50, 100), ring(30, 30, 40, 40)), 1, {"name": "A"}, 2),
        Feature(AREA, (ring(10, 10, 20, 20),), 2, {}, 7),
        Feature(AREA, (ring(50, 0, 100, 100),), 1, {"crop": "maize", "direction": 45.0}, 1),
        Feature(AREA, (ring(30, 30, 40, 40),), 1, {"use": "built_up"}, 3),
    ]
    return Sketch(
        extent=EXTENT,
        layers={"hill": np.zeros((50, 50), np.uint8)},
        vectors={"landuse": FeatureTable("landuse").edited(add=areas)},
        labels={("landuse", 2): {"use": "meadow"}},
    )


def test_areas_are_exported_with_the_properties_of_their_labels(sketch, tmp_path):
    path = tmp_path / "land.gpkg"
    with geopackage(path, "EPSG:25832") as file:
        file.add(land_layer(sketch, ORIGIN))
    meta, _, wkb, values = pyogrio.raw.read(path, layer="landuse")
    columns = dict(zip(meta["fields"], (each.tolist() for each in values), strict=True))
    assert meta["geometry_type"] == "Polygon"
    assert columns["id"] == [1, 2, 3, 7]
    assert columns["use"] == ["field", "field", "built_up", "meadow"]
    assert columns["crop"] == ["maize", *3 * ["automatic"]]
    assert columns["direction"] == [45.0, *3 * [-1.0]]
    first, second, *_ = shapely.from_wkb(wkb)
    assert first.equals(shapely.Polygon(np.add(ring(50, 0, 100, 100), ORIGIN)))
    assert second.area == 4900.0


def test_features_file_lists_areas_with_their_holes(sketch, tmp_path):
    features = TerrainFeatures(np.zeros(0, FEATURE), ())
    (path,) = write_features(tmp_path, features, land_entries(sketch))
    entries = json.loads(path.read_text(encoding="utf-8"))["landuse"]
    assert [each["id"] for each in entries] == [1, 2, 3, 7]
    assert entries[1]["rings"] == [ring(0, 0, 50, 100).tolist(), ring(30, 30, 40, 40).tolist()]
    assert (entries[3]["use"], entries[3]["density"], entries[3]["conifers"]) == ("meadow", 0.8, -1.0)
    (path,) = write_features(tmp_path, features, land_entries(Sketch()))
    assert "landuse" not in json.loads(path.read_text(encoding="utf-8"))


def test_reports_sum_up_uses(sketch):
    assert land_facts(sketch) == {
        "field": {"areas": 2, "hectares": 0.99},
        "meadow": {"areas": 1, "hectares": 0.01},
        "built_up": {"areas": 1, "hectares": 0.01},
    }


def test_shares_around_samples_add_up_and_the_highest_id_is_on_top(sketch):
    shares = land_shares(sketch, (10.0, 10.0), (11, 11))
    field, meadow, forest, built_up = np.moveaxis(shares[::-1], -1, 0)  # rows from the south
    inner = np.s_[1:-1, 1:-1]
    assert (shares.sum(axis=-1)[inner] == 1.0).all()
    assert meadow[1:3, 1:3].tolist() == [[0.25, 0.25], [0.25, 0.25]]
    assert built_up[3, 3] == 0.25
    assert (meadow.sum(), forest.sum(), built_up.sum()) == (1.0, 0.0, 1.0)
    assert field[0, 5] == 0.5  # half of it is beyond the sketch


def test_maps_are_tinted_by_use_with_an_entry_in_the_legend(sketch):
    side = 101
    flat, dry = np.zeros((side, side), np.float32), np.full((side, side), -1.0, np.float32)
    cover = np.eye(1, len(BUILT_IN), dtype=np.float32) * np.ones((side, side, 1), np.float32)
    frame = MapFrame(10.0, 20.0, EXTENT, EXTENT, 1000.0)
    land = land_shares(sketch, (1.0, 1.0), (side, side))
    given = frame, (1.0, 1.0), flat, flat, 1.0, dry, dry, cover, BUILT_IN
    plain, drawn = (MapSamples(*given, each) for each in (None, land))
    grass = np.array(next(iter(BUILT_IN)).tint)
    before, after = (shaded_relief(each).astype(float) for each in (plain, drawn))
    for (x, y), name in (((75, 50), "field"), ((15, 15), "meadow"), ((35, 35), "built_up")):
        style = LAND_CLASSES[name].style
        tint, opacity = np.array(rgb_from_hex(style["fill"])), style["fill_opacity"]
        light = before[100 - y, x] / grass  # of flat ground
        expected = light * (opacity * tint + (1.0 - opacity) * grass)
        assert after[100 - y, x] == pytest.approx(expected, abs=4.0), name
    titles = [
        [meaning for meaning, _ in legend_entries([], each, 5.0, set(), [], RoadNetwork())]
        for each in (plain, drawn)
    ]
    assert [title for title in titles[1] if title not in titles[0]] == ["Field", "Meadow", "Built-up area"]
    assert set(LAND_CLASSES) < set(LAND_USES)
