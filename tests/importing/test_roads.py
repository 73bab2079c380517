"""Roads, railways, paths, walls and buildings of vector maps: tags, nodes, frames and damaged files."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
import shapely
from rasterio.transform import Affine

from sketchterrain.document.rasters import raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import InputError
from sketchterrain.importing.elevation import sketch_on_elevation
from sketchterrain.importing.legend import feature_label, label_properties, relevant_tags
from sketchterrain.importing.vector_files import reproject
from sketchterrain.importing.vectors import sketch_from_vectors, with_vectors_of
from sketchterrain.io.crs import parse_crs
from sketchterrain.schema.layers import LAYERS
from tests.document.random_documents import content_of
from tests.geo_files import write_raster, write_vectors

from .test_real_rivers import write_osm

CORNER = 600_000.0, 5_200_000.0


def values(layer: str, tags: dict[str, object]) -> dict[str, object]:
    """Return the properties that tags give a feature of a layer, with those of its label."""
    label = feature_label(relevant_tags(tags), "lines", None)
    assert label is not None, tags
    assert label.layer == layer, tags
    own = {key: value for key, value in label.properties.items() if key not in label.guessed}
    return label_properties(layer, label.label) | own


@pytest.fixture(scope="module")
def elevation(tmp_path_factory) -> Sketch:
    """Return an empty sketch of about 5 × 4 km on real elevation."""
    rows, columns = np.indices((80, 100))
    heights = (800.0 + 2.0 * rows + columns).astype(np.float32)
    place = Affine(50.0, 0.0, CORNER[0], 0.0, -50.0, CORNER[1])
    path = write_raster(tmp_path_factory.mktemp("elevation") / "dem.tif", heights, place)
    sketch, _ = sketch_on_elevation([raster_source(path, "elevation")])
    return sketch


def osm_of(path: Path, sketch: Sketch, *ways: tuple[list[tuple[float, float]], dict[str, str]]) -> Path:
    """Write ways, given in metres from a sketch's corner, as OpenStreetMap; equal places are one node."""
    places = list(dict.fromkeys(place for line, _ in ways for place in line))
    metres = np.add(places, (sketch.frame["east"], sketch.frame["north"]))
    degrees = reproject(metres, parse_crs(sketch.frame["crs"]), parse_crs("OGC:CRS84"))
    nodes = dict(enumerate(map(tuple, degrees.tolist()), start=1))
    return write_osm(path, nodes, [([places.index(at) + 1 for at in line], tags) for line, tags in ways])


def test_tags_give_layer_class_and_structure() -> None:
    for layer, tags, expected in (
        ("road", {"highway": "motorway"}, {"lanes": 2, "grade": 0.06, "radius": 300.0}),
        ("road", {"highway": "primary", "lanes": "3", "surface": "concrete:plates"}, {"lanes": 3}),
        ("road", {"highway": "primary", "oneway": "-1"}, {"lanes": 1}),
        ("road", {"highway": "residential", "lanes": "1"}, {"lanes": 1, "width": 0.0}),
        ("road", {"highway": "residential", "width": "4.5 m", "lanes": "2"}, {"width": 4.5}),
        ("road", {"highway": "service", "width": "10 ft"}, {"width": 3.048}),
        ("road", {"highway": "track", "surface": "ground;grass", "est_width": 2}, {"surface": "soil"}),
        ("road", {"highway": "track", "tracktype": "grade2"}, {"surface": "gravel", "width": 3.0}),
        (
            "road",
            {"highway": "tertiary", "bridge": "viaduct", "layer": "2"},
            {"structure": "bridge", "level": 2},
        ),
        ("road", {"highway": "tertiary", "tunnel": "building_passage"}, {"structure": "tunnel"}),
        (
            "road",
            {"fclass": "track_grade3", "bridge": "T", "tunnel": "F", "layer": 1},
            {"structure": "bridge"},
        ),
        ("path", {"highway": "steps", "bridge": "no"}, {"grade": 1.0, "surface": "rock"}),
        ("railway", {"railway": "rail", "tracks": "2", "name": "Line 1"}, {"lanes": 2, "name": "Line 1"}),
        ("railway", {"other_tags": '"railway"=>"tram","layer"=>"-1"'}, {"width": 3.2, "level": -1}),
        ("road", {"highway": "service", "width": "12'6\""}, {"width": 3.81}),
        ("road", {"highway": "service", "width": "12 ft 6 in"}, {"width": 3.81}),
        ("road", {"highway": "service", "width": "3,5"}, {"width": 3.5}),
        ("road", {"highway": "service", "width": "~20"}, {"width": 20.0}),
        ("road", {"highway": "service", "width": "350 cm"}, {"width": 3.5}),
        ("road", {"highway": "service", "width": "0.01 mi"}, {"width": 16.0934}),
        ("road", {"highway": "unclassified", "lanes": "1.5"}, {"lanes": 1, "width": 4.5}),
        ("road", {"highway": "residential", "lanes": "1.5", "width": "5"}, {"lanes": 1, "width": 5.0}),
        ("road", {"highway": "primary", "bridge": "viaduct", "layer": "1;2"}, {"structure": "bridge"}),
        ("pad", {"building": "yes"}, {"building": 6.0}),
        ("pad", {"building": "greenhouse", "building:levels": "4"}, {"building": 12.0}),
        ("pad", {"building": "church", "height": "31 m"}, {"building": 31.0}),
        ("pad", {"layer": "pad", "building": 7.5}, {"building": 7.5}),
        ("wall", {"barrier": "hedge", "height": "2"}, {"material": "hedge", "height": 2.0, "width": 1.0}),
        (
            "road",
            {"layer": "road", "level": 1, "structure": "tunnel", "lanes": 4.0},
            {"level": 1, "lanes": 4},
        ),
    ):
        found = values(layer, tags)
        assert {key: found.get(key) for key in expected} == expected, tags
    assert "lanes" not in values("road", {"highway": "primary", "oneway": "yes", "junction": "roundabout"})
    assert "level" not in values("road", {"highway": "primary", "level": "3"})
    assert "structure" not in values("road", {"highway": "primary", "bridge": "no", "tunnel": "F"})
    unknown = feature_label(
        {"highway": "primary", "surface": "lava", "lanes": "some", "width": "999", "osm_id": "7"},
        "lines",
        None,
    )
    assert unknown.clipped == ("way 7 width='999'",)
    assert sorted(unknown.unread) == ["way 7 lanes='some'", "way 7 surface='lava'"]
    for tags, told in (
        ({"highway": "primary", "layer": "1;2"}, "way 7 layer='1;2'"),
        ({"highway": "primary", "layer": "0.5"}, "way 7 layer='0.5'"),
        ({"highway": "primary", "width": "1,234"}, "way 7 width='1,234'"),
        ({"highway": "primary", "width": "3-4 m"}, "way 7 width='3-4 m'"),
        ({"highway": "primary", "lanes": "2;1"}, "way 7 lanes='2;1'"),
        ({"building": "yes", "height": "tall"}, "way 7 height='tall'"),
        ({"building": "yes", "building:levels": "2;3"}, "way 7 building:levels='2;3'"),
        ({"waterway": "river", "width": "wide"}, "way 7 width='wide'"),
    ):
        assert feature_label({**tags, "osm_id": "7"}, "lines", None).unread == (told,)
    for tags in (
        {"highway": "construction", "construction": "primary"},
        {"highway": "proposed"},
        {"highway": "platform"},
        {"highway": "pedestrian", "area": "yes"},
        {"highway": "service", "service": "parking_aisle"},
        {"railway": "abandoned"},
        {"building": "no"},
        {"barrier": "gate"},
    ):
        assert feature_label(tags, "lines", None) is None, tags
    assert feature_label({"highway": "proposed"}, "roads", None) is None
    assert feature_label({"highway": "what"}, "roads", None).layer == "road"


def test_features_of_one_class_share_a_label(tmp_path, elevation) -> None:
    path = osm_of(
        tmp_path / "map.osm",
        elevation,
        ([(100, 100), (900, 100)], {"highway": "track"}),
        ([(100, 300), (900, 300)], {"highway": "track", "bridge": "yes"}),
        ([(100, 500), (900, 500)], {"highway": "secondary"}),
    )
    for width, expected in ((None, {"width": 3.0, "grade": 0.35}), (7.0, {"width": 7.0, "grade": 0.35})):
        traced = sketch_from_vectors(path, size_px=32, width=width)
        roads = traced.sketch.vectors["road"]
        track, bridge, other = roads.labels.tolist()
        assert track == bridge != other
        found = traced.sketch.properties("road", track)
        assert {key: found[key] for key in expected} == expected
        assert roads.properties([0, 1, 2]) == [{}, {"structure": "bridge"}, {}]
        assert any(
            note.startswith("roads, railways and paths without a width (3 of 3)") for note in traced.notes
        )
    save_sketch(traced.sketch, tmp_path / "a")
    loaded = load_sketch(tmp_path / "a")
    assert content_of(loaded.vectors["road"]) == content_of(roads)
    assert loaded.labels == traced.sketch.labels


def test_ways_keep_their_nodes_and_meet_only_ways(tmp_path, elevation) -> None:
    path = osm_of(
        tmp_path / "map.osm",
        elevation,
        ([(100, 100), (500, 300), (900, 100)], {"highway": "primary"}),
        ([(500, 300), (500, 900)], {"highway": "path"}),
        ([(0, 800), (1000, 800)], {"railway": "rail"}),
        ([(900, 500), (950, 500), (950, 550), (900, 500)], {"highway": "service"}),
        ([(100, 500), (200, 500), (200, 600), (100, 500)], {"building": "yes"}),
        ([(100, 900), (200, 900), (200, 950), (100, 900)], {"barrier": "wall", "area": "yes"}),
    )
    sketch = sketch_from_vectors(path, size_px=32).sketch
    lines = {name: layer.shapes() for name, layer in sketch.vectors.items() if layer}
    assert {name: len(each) for name, each in lines.items()} == {
        "road": 2,
        "railway": 1,
        "path": 1,
        "pad": 1,
        "wall": 1,
    }
    junction = shapely.get_coordinates(lines["road"][0])[1]
    assert junction.tolist() in shapely.get_coordinates(lines["path"]).tolist()
    assert [each.is_closed for each in lines["road"]] == [False, True]
    assert lines["wall"][0].is_closed
    assert lines["pad"][0].geom_type == "Polygon"
    # A track and a stream end on a railway, at no node of it.
    shapes = shapely.linestrings([[(0, 0), (900, 0)], [(300, 0), (300, 300)], [(600, 0), (600, 300)]])
    path = write_vectors(tmp_path / "a.gpkg", shapes, {"layer": ["railway", "road", "river"]})
    vectors = sketch_from_vectors(path, size_px=32).sketch.vectors
    assert vectors["railway"].vertices.tolist() == [[0, 0], [300, 0], [900, 0]]


@pytest.mark.slow
def test_roads_end_a_hundred_metres_around_a_sketch_on_elevation(tmp_path, elevation) -> None:
    width, _ = elevation.size
    ring = [(500.0, 500.0), (1500.0, 500.0), (1500.0, 1500.0), (500.0, 500.0)]
    path = osm_of(
        tmp_path / "map.osm",
        elevation,
        ([(-900.0, 1000.0), (1000.0, 1000.0), (width + 900.0, 1000.0)], {"highway": "primary"}),
        ([(-5e4, 0.0), (-4e4, 0.0)], {"highway": "primary"}),
        (ring, {"natural": "wood"}),
        (ring, {"natural": "ridge"}),
        ([(2000.0, 500.0), (2100.0, 500.0), (2100.0, 600.0), (2000.0, 500.0)], {"building": "yes"}),
        ([(2000.0, 900.0), (2100.0, 900.0)], {"waterway": "stream"}),
    )
    sketch, notes = with_vectors_of(elevation, path)
    (road,) = sketch.vectors["road"].shapes()
    np.testing.assert_allclose(road.bounds, [-100.0, 1000.0, width + 100.0, 1000.0], atol=0.01)
    assert len(sketch.vectors["pad"]) == len(sketch.vectors["river"]) == 1
    assert sketch.vectors["landuse"].shapes()[0].area == pytest.approx(0.5e6, abs=50.0)
    assert not sketch.layers["mountain"].any()
    assert "1 that the elevation already has" in notes[-1]
    assert sketch.frame == elevation.frame
    assert sketch.rasters == elevation.rasters
    assert sketch.labels["road", 1] == elevation.labels["road", 1]
    assert sketch.labels["road", int(sketch.vectors["road"].labels[0])] == dict(
        LAYERS["road"].tags[2].properties
    )
    away = osm_of(tmp_path / "away.osm", elevation, ([(-5e4, 0), (-4e4, 0)], {"highway": "primary"}))
    with pytest.raises(InputError, match=r"away\.osm: .*expected points, lines or areas, found none|within"):
        with_vectors_of(elevation, away)
    with pytest.raises(InputError, match=r"map\.osm: expected a CRS of both"):
        with_vectors_of(elevation.replace(frame={}), path)


def test_odd_and_damaged_ways_are_skipped_or_refused(tmp_path) -> None:
    nodes = {1: (9.0, 46.9), 2: (9.001, 46.9), 3: (9.001, 46.9), 4: (9.002, 46.901)}
    odd = [
        ([1], {"highway": "primary"}),
        ([2, 3], {"highway": "primary"}),
        ([1, 1, 1], {"highway": "track"}),
        (
            [1, 2, 2, 3, 4, 4],
            {"highway": "primary", "lanes": "-3", "width": "wide", "layer": "99", "x:y": "z"},
        ),
        ([1, 2, 1], {"building": "yes"}),
        ([1, 99], {"railway": "rail"}),
        ([4, 2, 4, 2], {"highway": "path", "bridge": "\u00e9" * 300}),
    ]
    path = write_osm(tmp_path / "odd.osm", nodes, odd)
    traced = sketch_from_vectors(path, size_px=32)
    (road,) = traced.sketch.vectors["road"].shapes()
    assert len(road.coords) == 3
    assert traced.sketch.vectors["road"].properties([0]) == [{"lanes": 1, "level": 5}]
    assert traced.sketch.vectors["path"].properties([0]) == [{"structure": "bridge"}]
    assert "invalid properties left out (1): way 4 width='wide'" in traced.notes
    assert any(note.startswith("clipped numbers out of range (2): way 4 ") for note in traced.notes)
    whole = path.read_bytes()
    random = np.random.default_rng(3)
    for length in random.integers(0, len(whole), 12).tolist():
        path.write_bytes(whole[:length])
        with suppress(InputError):
            sketch_from_vectors(path, size_px=8)


def test_gis_files_of_any_format_give_the_same_roads(tmp_path) -> None:
    shapes = shapely.linestrings([[(0, 0), (400, 100)], [(400, 100), (900, 900)]])
    fields = {"highway": ["primary", "track"], "bridge": ["yes", None]}
    found = []
    for suffix in (".gpkg", ".geojson", ".shp"):
        path = write_vectors(tmp_path / f"a{suffix}", shapes, fields)
        found.append(sketch_from_vectors(path, size_px=32).sketch.vectors["road"])
    assert len({content_of(each) for each in found}) == 1
    assert found[0].properties([0, 1]) == [{"structure": "bridge"}, {}]
    assert found[0].shapes()[1].coords[0] == found[0].shapes()[0].coords[1] == (400.0, 100.0)
