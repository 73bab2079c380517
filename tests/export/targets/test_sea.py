"""The sea in exports: there with a level that covers ground, and nowhere without."""

import json
from dataclasses import replace

import numpy as np
import pygltflib
import pyogrio.raw
import pytest
import shapely

from sketchterrain.export.map import relief
from sketchterrain.export.map.drawing import Polygons
from sketchterrain.export.map.sheet import map_sheet
from sketchterrain.generation.terrain import Terrain
from tests.export.exporting import export


def features_json(folder):
    return json.loads((folder / "features.json").read_text(encoding="utf-8")).get("sea", {}).get("level")


def water_json(folder):
    (path,) = folder.glob("*_water.json")
    content = json.loads(path.read_text(encoding="utf-8"))
    axes = content["axes"]
    unit = {"m": 1.0, "cm": 0.01}[axes["unit"]]
    return unit * content["sea"]["level"] + axes["origin"]["up"] if "sea" in content else None


def glb_node(folder):
    (path,) = [path for path in folder.glob("*.glb") if "points" not in path.name]
    scene = pygltflib.GLTF2().load(path)
    meshes = [scene.meshes[node.mesh] for node in scene.nodes if node.name == "sea"]
    if not meshes:
        return None
    place = scene.accessors[meshes[0].primitives[0].attributes.POSITION]
    assert place.min[1] == place.max[1]
    assert place.max[0] - place.min[0] == place.max[2] - place.min[2] == 1024.0
    return place.min[1]


def obj_object(folder):
    (path,) = folder.glob("*.obj")
    lines = path.read_text(encoding="utf-8").splitlines()
    if "o sea" not in lines:
        return None
    after = lines[lines.index("o sea") :]
    heights = {float(line.split()[2]) for line in after if line.startswith("v ")}
    assert len(heights) == 1
    return heights.pop()


def gis_layer(folder):
    (path,) = folder.glob("*.gpkg")
    if "sea" not in pyogrio.list_layers(path)[:, 0]:
        return None
    _, _, geometry, (level,) = pyogrio.raw.read(path, layer="sea")
    (area,) = shapely.from_wkb(geometry)
    assert area.is_valid
    assert (shapely.get_coordinates(area, include_z=True)[:, 2] == level[0]).all()
    return float(level[0])


EXPORTS = {
    "raw": (features_json, {}),
    "npy": (features_json, {}),
    "unreal": (water_json, {"size": 127}),
    "unity": (water_json, {}),
    "godot": (water_json, {"size": None}),
    "gltf": (glb_node, {}),
    "blender": (glb_node, {}),
    "obj": (obj_object, {}),
    "geotiff": (gis_layer, {}),
}


@pytest.fixture
def sea(terrain, monkeypatch):
    """Return a function that gives the terrain a sea at a level (m), or none."""
    features = terrain.features

    def set_level(level):
        monkeypatch.setattr(Terrain, "features", replace(features, sea_level=level))
        monkeypatch.setattr(Terrain, "sea_level", level)

    return set_level


@pytest.mark.slow
def test_exports_have_the_sea_if_there_is_one(terrain, sea, tmp_path):
    level, seen = round(float(np.median(terrain.raster(65).height)), 2), set()
    for target, (found, options) in EXPORTS.items():
        for given in (level,) if found in seen else (None, level):
            seen.add(found)
            sea(given)
            folder = tmp_path / f"{target} {given}"
            export(terrain, target, folder, **{"size": 33, "plants": False} | options)
            expected = None if given is None else pytest.approx(given, abs=2e-3)
            assert found(folder) == expected, (target, given)


def test_the_area_of_the_sea_is_the_ground_below_it(terrain, sea, tmp_path):
    height = terrain.raster(513).height
    level = float(np.percentile(height, 40.0))
    sea(level)
    export(terrain, "geotiff", tmp_path, size=513, plants=False)
    (path,) = tmp_path.glob("*.gpkg")
    (area,) = shapely.from_wkb(pyogrio.raw.read(path, layer="sea")[2])
    assert area.area == pytest.approx(0.4 * 1024.0**2, rel=0.01)
    assert area.bounds[0] >= 0.0
    assert area.bounds[2] <= 1024.0
    row, column = np.argwhere(np.abs(height - level) > 2.0)[::97].T
    inside = shapely.intersects_xy(area, column * 2.0, 1024.0 - row * 2.0)  # also on the sketch's border
    assert (inside == (height[row, column] < level)).mean() > 0.999


def test_maps_have_the_sea_in_tints_and_in_the_legend(terrain, sea, monkeypatch):
    monkeypatch.setattr(relief, "MAX_SIDE", 0.4 * relief.MAX_SIDE)
    for level in (None, float(np.median(terrain.raster(65).height))):
        sea(level)
        sheet = map_sheet(terrain)
        texts = [getattr(shape, "text", "") for shape in sheet.layers["legend"]]
        assert any("Sea, depth lines" in text for text in texts) == (level is not None)
        assert bool(sheet.layers["sea"]) == (level is not None)
        shores = [shape for shape in sheet.layers["sea"] if isinstance(shape, Polygons)][:1]
        area = sum(abs(shapely.Polygon(ring).area) for shape in shores for ring in shape.paths)
        assert (area > 0.3 * np.prod(sheet.width - 50)) == (level is not None)
