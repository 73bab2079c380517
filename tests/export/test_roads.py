"""Roads, pads and walls in features.json, GeoPackages, engine splines and masks."""

import json
import sqlite3
from contextlib import closing
from types import SimpleNamespace
from xml.etree import ElementTree as ET

import numpy as np
import pyogrio
import pytest
import shapely
from PIL import Image

from sketchterrain.export.engines import EngineAxes
from sketchterrain.export.gis_layers import gis_layers, write_styles
from sketchterrain.export.roads import built_ground, coverage, road_content, road_layers, write_corridors
from sketchterrain.export.sampled import SampleGrid, TerrainSamples
from sketchterrain.export.target import Export, ExportOptions, Tiling
from sketchterrain.export.vectors import Origin, geopackage, write_features
from sketchterrain.landforms.placement.feature_types import FEATURE
from sketchterrain.roads.road_types import RoadNetwork
from sketchterrain.schema.layers import LAYERS
from sketchterrain.terrain.surfaces import TerrainFeatures
from tests.sample_roads import curved_road, make_network, make_road, straight_road

SLD = "{http://www.opengis.net/sld}"
ORIGIN = Origin(512_000.0, 5_403_000.0)


@pytest.fixture(scope="module")
def network():
    return make_network()


def features(network):
    return TerrainFeatures(np.zeros(0, FEATURE), (), network=network)


def test_geopackages_hold_the_styles_of_classes_as_qml_and_sld(network, tmp_path):
    counts = dict.fromkeys(("roads", "railways", "walls", "landuse"), 1)
    terrain = SimpleNamespace(sketch=SimpleNamespace(vectors={}))
    groups = gis_layers(SimpleNamespace(name="map", drapes=(), terrain=terrain), counts)
    path = tmp_path / "map.gpkg"
    with geopackage(path, "EPSG:25832") as file:
        for layer in road_layers(network, ORIGIN):
            file.add(layer)
    write_styles(path, [layer for group in groups.values() for layer in group])
    with closing(sqlite3.connect(path)) as file:
        rows = dict(file.execute("SELECT f_table_name, styleQML || styleSLD FROM layer_styles"))
        columns = file.execute("SELECT f_table_name, styleQML, styleSLD FROM layer_styles").fetchall()
    assert sorted(rows) == sorted(counts)
    for name, qml, text in columns:
        symbols, sld = ET.fromstring(qml), ET.fromstring(text)  # noqa: S314 # our own
        layer = next(each for each in LAYERS.values() if name in (f"{each.name}s", each.name))
        titles = [each.title for each in layer.classes]
        assert [each.get("label") for each in symbols.iter("rule")] == titles
        *casings, strokes = sld.iter(f"{SLD}FeatureTypeStyle")
        assert [each.findtext(f"{SLD}Title") for each in strokes] == titles
        assert sum(len(each) for each in casings) == sum(bool(each.style["casing"]) for each in layer.classes)
        colours = [each.text for each in strokes.iter(f"{SLD}CssParameter") if each.get("name") == "stroke"]
        assert colours == [each.style["colour"] for each in layer.classes]
    assert rows["roads"].count("<ogc:PropertyIsGreaterThanOrEqualTo>") == 2 * (1 + 2 + 3 + 4) - 4
    assert "&quot;material&quot; = 'hedge'" in rows["walls"]


def test_features_file_lists_roads_pads_and_walls_and_only_those_that_exist(network, tmp_path):
    (path,) = write_features(tmp_path, features(network))
    content = json.loads(path.read_text(encoding="utf-8"))
    assert [len(content[name]) for name in ("roads", "pads", "walls")] == [8, 2, 2]
    bridge, road = content["roads"][2], network.roads[2]
    assert (bridge["id"], bridge["layer"], bridge["structure"]) == (road.id, "road", "bridge")
    assert bridge["axis"] == road.axis.tolist()
    assert bridge["half_width"] == [3.0, 3.0]
    assert (bridge["surface"], bridge["cut"], bridge["fill"]) == ("asphalt", 1.0, 0.67)
    assert content["pads"][0]["outline"] == network.pads[0].outline.tolist()
    assert (content["pads"][0]["level"], content["pads"][0]["fill"]) == (40.0, 0.67)
    assert not any("works" in entry for name in ("roads", "pads", "walls") for entry in content[name])
    assert content["walls"][1]["material"] == "hedge"
    (path,) = write_features(tmp_path, features(RoadNetwork()))
    assert list(json.loads(path.read_text(encoding="utf-8"))) == ["format", "features", "splines", "lakes"]


def test_geopackage_has_axes_edges_decks_tunnels_pads_and_walls_at_their_heights(network, tmp_path):
    path = tmp_path / "roads.gpkg"
    with geopackage(path, "EPSG:25832") as file:
        for layer in road_layers(network, ORIGIN):
            file.add(layer)
    found = {}
    for name, kind in pyogrio.list_layers(path):
        meta, _, geometry, values = pyogrio.raw.read(path, layer=name)
        assert meta["crs"] == "EPSG:25832"
        assert kind == ("LineString" if name == "walls" else meta["geometry_type"])
        found[name] = shapely.from_wkb(geometry), dict(zip(meta["fields"], values, strict=True))
    counts = {name: len(shapes) for name, (shapes, _) in found.items()}
    assert counts == {
        "roads": 4,
        "railways": 3,
        "paths": 1,
        "road_edges": 16,
        "bridge_decks": 1,
        "tunnels": 1,
        "pads": 2,
        "walls": 2,
    }
    axes, fields = found["roads"]
    assert shapely.get_coordinates(axes[0], include_z=True)[[0, -1]].tolist() == [
        [512_100.0, 5_403_100.0, 20.0],
        [512_900.0, 5_403_100.0, 60.0],
    ]
    assert fields["structure"].tolist() == ["ground", "ground", "bridge", "ground"]
    assert fields["width"].tolist() == [6.0] * 4
    assert fields["steepest"][0] == pytest.approx(0.05)
    assert fields["length"][2] == pytest.approx(50.0 * np.pi)
    (deck,), _ = found["bridge_decks"]
    assert deck.is_valid
    assert deck.area == pytest.approx(8.0 * 50.0 * np.pi, rel=1e-3)
    heights = shapely.get_coordinates(deck, include_z=True)[:, 2]
    assert heights.max() == pytest.approx(32.0 + 4.0 * 0.03)
    edges, fields = found["road_edges"]
    assert fields["side"].tolist()[:2] == ["left", "right"]
    assert shapely.distance(edges[0], edges[1]) == pytest.approx(6.0)
    (house, _), fields = found["pads"]
    assert (house.area, fields["building"].tolist()) == (240.0, [6.0, 0.0])
    assert shapely.get_coordinates(house, include_z=True)[0, 2] == 40.0
    (tunnel,), fields = found["tunnels"]
    assert fields["id"].tolist() == [str(network.roads[5].id)]
    assert tunnel.length == pytest.approx(100.0 * np.sqrt(2.0))
    assert road_layers(RoadNetwork(), ORIGIN) == []


def test_splines_are_in_engine_coordinates_with_width_and_bank(network):
    axes = EngineAxes("east", "south", "up", unit="cm", per_metre=100.0, origin=(0.0, 1024.0, 0.0))
    content = road_content(network, axes)
    straight, _, bridge = content["roads"][:3]
    assert straight["points"][0] == [10_000.0, 92_400.0, 2_000.0]
    assert straight["width"] == [600.0] * 3
    assert straight["bank"] == [0.0] * 3  # a crown is no bank
    assert bridge["structure"] == "bridge"
    assert bridge["bank"] == pytest.approx([np.degrees(np.arctan(0.03))] * len(bridge["points"]), abs=1e-3)
    assert [len({len(road[name]) for name in ("points", "width", "bank")}) for road in content["roads"]] == [
        1
    ] * 8


def test_coverage_of_areas_is_exact():
    grid = SampleGrid(0.0, 0.0, 40.0, 30.0, 41, 31)
    shapes = [
        shapely.box(3.25, 4.5, 9.75, 4.75),  # thinner than a cell
        shapely.Polygon([(15.2, 3.1), (12.7, 18.3), (29.9, 11.4)]),
        shapely.Polygon([(-20.0, 20.0), (10.3, 50.0), (12.4, 22.2)]),  # beyond the grid
        shapely.box(35.0, -9.0, 60.0, 8.5),
    ]
    outlines = [
        shapely.get_coordinates(shapely.orient_polygons(each, exterior_cw=True))[:-1] for each in shapes
    ]
    x, y = np.meshgrid(np.arange(41.0), np.arange(30.0, -1.0, -1.0))
    cells = shapely.box(x - 0.5, y - 0.5, x + 0.5, y + 0.5)
    expected = shapely.area(shapely.intersection(cells, shapely.union_all(shapes)))
    assert np.abs(coverage(outlines, grid) / 255.0 - expected).max() <= 0.5 / 255.0 + 1e-6
    assert (coverage(outlines * 2, grid) >= coverage(outlines, grid)).all()
    assert not coverage([outlines[0] + 1000.0], grid).any()


def test_masks_of_tiles_are_parts_of_the_whole_and_leave_bridges_out(network):
    grid = SampleGrid(0.0, 0.0, 1024.0, 768.0, 1025, 769)
    masks = {kind: coverage(found, grid) for kind, found in built_ground(network, grid).items()}
    assert masks["carriageway"][768 - 100, 300] == 255
    assert not masks["carriageway"][768 - 470 : 768 - 450, 180:250].any()  # the bridge
    assert masks["built"][768 - 606, 610] == 255
    assert (masks["built"].astype(int) - masks["carriageway"] >= -1).all()  # halves are rounded either way
    part = grid.window(100, 300, 512, 256)
    tile = coverage(built_ground(network, grid)["built"], part)
    assert np.abs(tile - masks["built"][300:556, 100:612].astype(int)).max() <= 1


def test_curved_strips_cover_their_area():
    _, bridge, _ = curved_road()
    grid = SampleGrid(0.0, 0.0, 768.0, 768.0, 193, 193)
    road = make_road(bridge.axis, bend=bridge.bend, width=6.0)
    mask = coverage(built_ground(RoadNetwork((road,)), grid)["carriageway"], grid)
    assert mask.sum(dtype=np.float64) / 255.0 * 16.0 == pytest.approx(6.0 * 50.0 * np.pi, rel=5e-3)


def test_strips_that_turn_back_on_themselves_have_no_holes():
    hairpin = make_road([(20, 20, 0), (22, 20, 0)], bend=-1.0, width=10.0)  # a radius of 1 m
    grid = SampleGrid(0.0, 0.0, 40.0, 40.0, 161, 161)
    mask = coverage(built_ground(RoadNetwork((hairpin,)), grid)["carriageway"], grid)
    (x, y) = np.meshgrid(np.linspace(0.0, 40.0, 161), np.linspace(40.0, 0.0, 161))
    near = (np.hypot(x - 21.0, y - 20.0) < 5.5) & (y < 19.5)
    assert (mask[near] == 255).all()


def test_road_files_are_written_for_each_tile_only_if_there_are_roads(network, tmp_path):
    grid = SampleGrid(0.0, 0.0, 1024.0, 1024.0, 129, 129)
    empty = np.zeros((129, 129), np.uint8)
    samples = TerrainSamples(grid, empty.astype(np.float32), empty[..., None], empty[..., None])

    def written(network, **options):
        terrain = SimpleNamespace(features=features(network))
        tiling = Tiling(columns=2, rows=1)
        export = Export(terrain, "pass", ExportOptions(), grid, tiling, samples, tmp_path, None)
        return [path.name for path in write_corridors(export, EngineAxes("east", "up", "north"), **options)]

    assert written(RoadNetwork()) == ["pass_water.json"]
    masks = [f"pass_{kind}_x{x}_y0.png" for kind in ("carriageway", "built") for x in (0, 1)]
    assert written(network) == ["pass_water.json", *masks, "pass_roads.json"]
    with Image.open(tmp_path / masks[0]) as image:
        assert (image.mode, image.size) == ("L", (65, 129))
    written(network, splat=True)
    with Image.open(tmp_path / masks[0]) as image:
        assert image.size == (64, 128)
    assert straight_road().layer == json.loads((tmp_path / "pass_roads.json").read_text())["roads"][0]["type"]
