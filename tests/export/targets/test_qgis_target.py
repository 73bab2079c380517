"""QGIS projects: their XML and files, and in soak the real QGIS."""

import json
import os
import shutil
import subprocess
import zipfile
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pyogrio
import pytest
import rasterio
from PIL import Image

import sketchterrain as st
import sketchterrain.jobs.export
from sketchterrain.document.drapes import DrapeClass, draped_layer
from sketchterrain.export.target import SceneView
from tests.export.exporting import export

EAST, NORTH = 600_000.0, 5_270_000.0
PLACED = {"crs": "EPSG:25832", "origin": (EAST, NORTH)}
PRESETS = Path(__file__).parents[3] / "presets"


@pytest.fixture(scope="module")
def draped(corner, tmp_path_factory):
    """The corner with a draped layer of a line, an area and a point, with classes, a hatch and labels."""
    shapes = [
        ("LineString", [[100.0, 200.0], [900.0, 260.0]], "trail"),
        ("Polygon", [[[300.0, 300.0], [600.0, 300.0], [600.0, 500.0], [300.0, 300.0]]], "parcel & <field>"),
        ("Point", [500.0, 600.0], None),
    ]
    features = [
        {"type": "Feature", "properties": {"kind": kind}, "geometry": {"type": name, "coordinates": at}}
        for name, at, kind in shapes
    ]
    path = tmp_path_factory.mktemp("draped") / "ways.geojson"
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": features}))
    classes = (DrapeClass("parcel & <field>", {"hatch": "cross", "fill": "#20a040"}),)
    layer = draped_layer(path, by="kind", fill="#ff8800", label="kind", dash="6 3", unit="m")
    frame = {"crs": "EPSG:25832", "east": 0.0, "north": 0.0}
    return corner.replace(name="Draped", drapes=(layer.replace(classes=classes),), frame=frame)


def project(folder):
    (path,) = folder.glob("*.qgz")
    with zipfile.ZipFile(path) as file:
        (entry,) = file.infolist()
        assert entry.filename == f"{path.stem}.qgs"
        return ET.fromstring(file.read(entry))  # noqa: S314 # our own


def check_project(folder):
    """Check that sources exist beside the project, each layer is in the tree, and themes name layers."""
    root = project(folder)
    layers = {each.findtext("id"): each for each in root.iter("maplayer")}
    entries = [each.get("id") for each in root.iter("layer-tree-layer")]
    assert sorted(entries) == sorted(layers)
    for element in (*root.iter("visibility-preset"), *root.iter("terrain")):
        assert {each.get("id") for each in element.iter("layer")} <= set(layers), element.tag
    tables = set()
    for layer in layers.values():
        name, *parts = layer.findtext("datasource").split("|")
        assert name.startswith("./")
        assert (folder / name).is_file(), name
        tables |= {
            (name[2:], part.removeprefix("layername=")) for part in parts if part.startswith("layername")
        }
    written = {
        (path.name, str(table))
        for path in folder.glob("*.gpkg")
        for table, _ in pyogrio.list_layers(path)
        if table != "layer_styles" and pyogrio.read_info(path, layer=table)["features"]
    }
    assert tables == written
    assert [each.get("name") for each in root.iter("view")] == ["3-D view"]
    return root


def test_projects_are_relative_complete_and_deterministic(draped, tmp_path, monkeypatch):
    scene = SceneView(**dict.fromkeys(SceneView._fields, 0.0))
    scene = scene._replace(
        eye=(500.0, 0.0, 90.0), target=(500.0, 9.0, 40.0), sun_azimuth=90.0, sun_elevation=60.0
    )
    monkeypatch.setattr(sketchterrain.jobs.export, "scene_view", lambda terrain: scene)
    terrain = st.build(draped)
    done, again = (export(terrain, "qgis", tmp_path / name, size=33, plants=False) for name in "ab")
    for path in done.files:
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name
    assert [path.name for path in again.files] == [path.name for path in done.files]
    root = check_project(tmp_path / "a")
    titles = [each.findtext("layername") for each in root.iter("maplayer")]
    assert titles[:3] == ["ways (Point)", "ways (LineString)", "ways (Polygon)"]
    assert {"Rivers", "Lakes", "Contours", "Hillshade", "Materials", "Relief", "Wetness"} <= set(titles)
    assert "25832" in root.findtext("projectCrs/spatialrefsys/wkt")
    assert root.findtext("title") == "Draped"
    (light,) = root.iter("directional-light")
    assert [float(light.get(axis)) for axis in "xyz"] == pytest.approx(
        [-0.5, -(0.75**0.5), 0.0]
    )  # westward, down
    (camera,) = root.iterfind("mapViewDocks3D/view/camera")
    assert float(camera.get("yaw")) == 0.0
    assert [float(camera.get(axis)) for axis in ("xMap", "yMap", "zMap")] == [512.0, 512.0, 40.0]


def test_material_raster_has_the_heaviest_materials_their_names_and_colours(exported, terrain):
    outcome = exported("qgis", size=65)
    check_project(outcome.folder)
    with (
        rasterio.open(*outcome.paths("_materials.tif")) as weights,
        rasterio.open(*outcome.paths("_material.tif")) as file,
    ):
        found, colours = file.read(1), file.colormap(1)
        np.testing.assert_array_equal(found, weights.read().argmax(axis=0))
        titles = [each.title for each in terrain.materials]
        assert [file.tags(1)[f"CLASS_{number}"] for number in range(len(titles))] == titles
    assert len(np.unique(found)) > 3
    legend = {
        int(each.get("value")): (each.get("label"), each.get("color"))
        for layer in project(outcome.folder).iter("maplayer")
        if layer.findtext("layername") == "Materials"
        for each in layer.iter("paletteEntry")
    }
    assert legend == {
        number: (titles[number], "#{:02x}{:02x}{:02x}".format(*colours[number]))
        for number in np.unique(found)
    }


@pytest.fixture(scope="session")
def qgis(tmp_path_factory):
    """The Python of a QGIS installation."""
    command = os.environ.get("SKETCHTERRAIN_QGIS_PYTHON") or "/usr/bin/python3"
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTHON")}
    environment |= {"QT_QPA_PLATFORM": "offscreen", "XDG_RUNTIME_DIR": str(tmp_path_factory.mktemp("qgis"))}
    found = shutil.which(command) and subprocess.run(
        [command, "-c", "import qgis.core, qgis._3d"], env=environment, capture_output=True, check=False
    )
    if not found or found.returncode:
        pytest.skip("needs QGIS: apt install python3-qgis, or SKETCHTERRAIN_QGIS_PYTHON with its Python")

    def report(path, picture, points):
        script = Path(__file__).with_name("qgis_report.py")
        place = picture.with_suffix(".txt")
        np.savetxt(place, points, fmt="%.17g")
        done = subprocess.run(
            [command, script, path, picture, place],
            env=environment,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert "Warning" not in done.stderr, done.stderr
        return json.loads(done.stdout)

    return report


@pytest.mark.soak
@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("corner", {}),
        ("corner", PLACED),
        ("draped", {}),
        ("mountain_pass", {}),
        ("island_coast", PLACED),
        ("andorra", {"plants": False}),
    ],
    ids=["local", "placed", "draped", "roads", "sea", "frame"],
)
def test_qgis_opens_draws_and_measures_the_project(qgis, request, tmp_path, name, options):
    sketch = request.getfixturevalue(name) if name in ("corner", "draped") else st.load_sketch(PRESETS / name)
    terrain = st.build(sketch)
    done = export(terrain, "qgis", tmp_path / "out", size=257, **options)
    check_project(tmp_path / "out")
    moved = (tmp_path / "out").rename(tmp_path / "moved, späť")
    (path,) = moved.glob("*.qgz")
    grid = done.report["grid"]
    rng = np.random.default_rng(7)
    column, row = rng.integers(0, grid["columns"], 1000), rng.integers(0, grid["rows"], 1000)
    local = np.stack([column * grid["spacing"]["x"], row * grid["spacing"]["y"]], axis=-1)
    found = qgis(path, tmp_path / "map.png", local + done.report["origin"])

    assert found["read"]
    assert found["error"] == ""
    assert found["messages"] == []
    assert found["drawing"] == []
    counts = done.report["layers"]
    for title, layer in found["layers"].items():
        assert layer["valid"], title
        assert layer["error"] == "", title
        assert layer["crs"], title
    for title, table in (("Rivers", "rivers"), ("Lakes", "lakes"), ("Plants", "plants"), ("Roads", "roads")):
        if title in found["layers"]:
            assert found["layers"][title]["features"] == counts[table], title
            assert found["layers"][title]["solid"] == (table in ("lakes", "plants")), title
    heights = terrain.heights(*local.T, cell_size=max(grid["spacing"].values()))
    assert np.array_equal(np.array(found["heights"], np.float32), heights)
    assert found["crs"][::2] == [True, 0]  # metres
    crs = options.get("crs") or sketch.frame["crs"]
    if not sketch.frame["vertical"]:  # a compound CRS has no code
        assert found["crs"][1] == crs
    east, north = done.report["origin"]
    assert found["extent"] == pytest.approx([east, north, east + sketch.size[0], north + sketch.size[1]])
    view = found["view"]
    assert (view["scale"], view["crs"], view["lights"], view["theme"]) == (1.0, True, 1, True)
    assert {"Rivers", "Lakes", "Materials"} <= set(view["layers"]) <= set(found["layers"])
    assert view["origin"] == pytest.approx([east + 0.5 * sketch.size[0], north + 0.5 * sketch.size[1]])
    with Image.open(tmp_path / "map.png") as image:
        colours = np.asarray(image.convert("RGB"), np.float64).reshape(-1, 3)
    assert colours.std(axis=0).min() > 5.0  # a relief, not a blank sheet
