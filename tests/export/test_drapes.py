"""Draped vector layers in exports: on the ground, with their properties, in the sketch's frame."""

import json

import numpy as np
import pygltflib
import pyogrio
import pytest
import shapely

import sketchterrain as st
from sketchterrain.document.drapes import DrapeClass, draped_layer
from sketchterrain.export.drapes import DrapedShapes, write_drapes
from sketchterrain.export.gltf import GlbWriter, add_drapes
from sketchterrain.export.planning import checked_plan
from sketchterrain.export.target import ExportOptions
from tests.export.exporting import export

EAST, NORTH = 600_000.0, 5_270_000.0
LINE = [(100.0, 200.0), (700.0, 260.0), (720.0, 900.0)]
AREA = [(300.0, 300.0), (600.0, 300.0), (600.0, 500.0), (300.0, 500.0), (300.0, 300.0)]


@pytest.fixture(scope="module")
def terrain(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drapes")

    def moved(points):
        return np.add(points, (EAST, NORTH)).tolist()

    def feature(shape, points, **properties):
        return {
            "type": "Feature",
            "properties": properties,
            "geometry": {"type": shape, "coordinates": points},
        }

    features = [
        feature("LineString", moved(LINE), name="trail", kind="black", Id=7, length=1.5),
        feature("Polygon", [moved(AREA)], name="parcel", kind="red", Id=8, length=None),
        feature("Point", moved([(500.0, 600.0)])[0], name=None, kind="red", Id=9, length=2),
        feature("LineString", moved([(900.0, 900.0), (5000.0, 900.0)]), name="long", kind="", Id=1, length=0),
        feature("Point", moved([(-500.0, 600.0)])[0], name="outside", kind="red", Id=10, length=2),
    ]
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    path = folder / "trails.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    layer = draped_layer(path, by="kind", colour="#ff0000").replace(
        classes=(DrapeClass("black", {"colour": "#000000"}),)
    )
    hidden, twin = layer.replace(visible=0, title="hidden"), layer.replace(title='TRAILS "2"')
    mountain = np.zeros((64, 64), np.uint8)
    mountain[20:44, 20:44] = 1
    frame = {"crs": "EPSG:25832", "east": EAST, "north": NORTH}
    sketch = st.Sketch(
        name="Draped", extent=1024.0, layers={"mountain": mountain}, frame=frame, drapes=(layer, hidden, twin)
    )
    return st.build(sketch)


@pytest.fixture(scope="module")
def exported(terrain, tmp_path_factory):
    folder = tmp_path_factory.mktemp("gltf")
    export(terrain, "gltf", folder, size=65, plants=False)
    return folder


def test_features_lie_on_the_ground_with_vertices_no_further_apart_than_samples(terrain, exported):
    path = exported / "draped_drapes.gpkg"
    assert [name for name, _ in pyogrio.list_layers(path)] == ["trails", "TRAILS _2_"]
    meta, _, wkb, fields = pyogrio.raw.read(path, layer="trails")
    assert meta["crs"] == "EPSG:25832"
    shapes = shapely.from_wkb(wkb)
    names = dict(zip(meta["fields"], fields, strict=True))
    assert names["name"].tolist() == ["trail", "parcel", None, "long"]
    assert names["Id_"].tolist() == [7, 8, 9, 1]
    assert np.isnan(names["length"][1])
    for shape in shapes:
        points = shapely.get_coordinates(shape, include_z=True)
        x, y = points[:, 0] - EAST, points[:, 1] - NORTH
        np.testing.assert_allclose(points[:, 2], terrain.heights(x, y, cell_size=16.0), atol=1e-3)
        assert (np.hypot(*np.diff(points[:, :2], axis=0).T) <= 16.0 + 1e-6).all()
        assert x.min() >= 0.0
        assert x.max() <= 1024.0
    corners = np.subtract(shapely.get_coordinates(shapes[0]), (EAST, NORTH))
    for corner in LINE:
        assert np.abs(corners - corner).max(axis=1).min() < 1e-6
    assert shapes[1].area == pytest.approx(300.0 * 200.0)


def test_scenes_have_lines_and_points_above_the_ground(terrain, exported):
    scene = pygltflib.GLTF2().load(exported / "draped.glb")
    meshes = [scene.meshes[node.mesh] for node in scene.nodes if node.name.startswith("trails")]
    assert [(mesh.name, mesh.primitives[0].mode) for mesh in meshes] == [
        ("trails", pygltflib.LINES),
        ("trails", pygltflib.POINTS),
        ("trails black", pygltflib.LINES),
    ]
    colours = [scene.materials[mesh.primitives[0].material] for mesh in meshes]
    assert [each.pbrMetallicRoughness.baseColorFactor[0] for each in colours] == [1.0, 1.0, 0.0]


def test_layers_without_features_are_empty_tables(terrain, tmp_path):
    empty = DrapedShapes(terrain.sketch.drapes[0], [], np.zeros(0, object), [])
    (path,) = write_drapes(tmp_path / "drapes.gpkg", [empty], terrain)
    assert pyogrio.read_info(path, layer="trails")["features"] == 0
    assert write_drapes(tmp_path / "none.gpkg", [], terrain) == ()
    glb = GlbWriter()

    class Job:
        drapes, grid = (empty,), checked_plan(terrain.sketch, "gltf", ExportOptions(size=9)).grid

    add_drapes(glb, Job)
    assert glb.scene.nodes == []
