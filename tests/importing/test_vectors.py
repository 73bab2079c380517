"""Vector maps as sketches: geometry kept, painting against brute force, and invalid files."""

import json
import math
import sqlite3

import numpy as np
import pyogrio
import pytest
import rasterio.warp
import shapely
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy import ndimage

from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.drape.drapes import Drapes
from sketchterrain.errors import InputError
from sketchterrain.importing.images import detect_kind
from sketchterrain.importing.legend import cluster_properties
from sketchterrain.importing.vector_files import mean_longitude, metric_crs_at, reproject
from sketchterrain.importing.vectors import _joined, paint_areas, paint_lines, sketch_from_vectors
from sketchterrain.io.crs import parse_crs, parse_metric_crs
from sketchterrain.landforms.hydrology.rivers import lay_out_water
from sketchterrain.stages.runner import Runner

LON, LAT = 11.0, 47.0
SQUARE = {"bounds": (0, 0, 1000, 1000), "size_px": 100}


def feature(kind: str, coordinates: object, **properties: object) -> dict:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def line(*places: list, **properties: object) -> dict:
    return feature("LineString", places, **properties)


def box(west: float, south: float, east: float, north: float) -> list:
    return [[west, south], [east, south], [east, north], [west, north], [west, south]]


def area(*sides: float, **properties: object) -> dict:
    return feature("Polygon", [box(*sides)], **properties)


@pytest.fixture
def written(tmp_path):
    """Return a function that writes features as GeoJSON, by default in EPSG:25832."""

    def write(*features: dict, crs: str | None = "EPSG:25832"):
        members = {} if crs is None else {"crs": {"type": "name", "properties": {"name": crs}}}
        path = tmp_path / "map.geojson"
        path.write_text(json.dumps({"type": "FeatureCollection", "features": features} | members))
        return path

    return write


def shapes(sketch, layer: str) -> np.ndarray:
    """Return the vectors of a layer."""
    return sketch.vectors[layer].shapes()


def properties(sketch, layer: str) -> list[dict]:
    """Return the properties of each vector of a layer."""
    vectors = sketch.vectors[layer]
    return [vectors.feature(number).properties for number in vectors.ids.tolist()]


def pack(path, crs, layer, shapes, *, driver="GPKG", geometry_type="Unknown", options=None, **fields) -> None:
    """Append a layer to a GeoPackage, or write another format."""
    values = [np.array(each, object if isinstance(each[0], str) else float) for each in fields.values()]
    given = {"layer": layer, "driver": driver, "geometry_type": geometry_type, "crs": crs} | (options or {})
    shapes = shapely.to_wkb(np.array(shapes, object))
    pyogrio.raw.write(path, shapes, values, list(fields), append=path.exists(), **given)


def test_features_are_at_their_positions(written) -> None:
    path = written(
        line([1000, 3000], [1000, 1000], waterway="river"),
        feature("Polygon", [box(2000, 1000, 3000, 2000), box(2400, 1400, 2600, 1600)], natural="water"),
        feature(
            "MultiPolygon", [[box(3000, 2500, 4000, 3000)], [box(4500, 2500, 5000, 3000)]], natural="wood"
        ),
        area(1200, 2600, 1400, 2800, natural="scree"),
        area(4000, 1000, 5000, 1500, layer="hill", height=55),
    )
    traced = sketch_from_vectors(path, bounds=(1000, 1000, 5000, 3000), size_px=400)
    sketch = traced.sketch
    assert (sketch.width_px, sketch.height_px, sketch.pixel_size, sketch.extent) == (400, 200, 10.0, 4000.0)
    (lake,), (river,) = shapes(sketch, "lake"), shapes(sketch, "river")
    assert lake.equals(shapely.box(1000, 0, 2000, 1000) - shapely.box(1400, 400, 1600, 600))
    assert shapely.get_coordinates(river).tolist() == [[0, 2000], [0, 0]]
    forest = shapely.union_all(shapes(sketch, "landuse"))
    assert forest.equals(shapely.box(2000, 1500, 3000, 2000) | shapely.box(3500, 1500, 4000, 2000))
    assert np.argwhere(sketch.layers["material"]).min(axis=0).tolist() == [20, 20]
    assert sketch.properties("material", 1)["material"] == "scree"
    assert sketch.layers["hill"][150:, 300:].all()
    assert sketch.properties("hill", 1)["height"] == 55
    assert not sketch.layers["river"].any()
    assert not sketch.layers["lake"].any()
    assert sketch.name == "map"
    assert sketch.frame == {"crs": "EPSG:25832", "east": 1000.0, "north": 1000.0, "vertical": ""}
    assert any("corner: 1000,1000 in EPSG:25832" in note for note in traced.notes)


def test_rivers_have_properties_of_their_own(written) -> None:
    path = written(
        line([100, 900], [900, 900], waterway="river", width="40 m", name="Inn"),
        line([100, 500], [900, 500], waterway="stream"),
        line([100, 98], [900, 98], waterway="river", depth=3, osm_id=7),
        line([100, 50], [900, 50], layer="river", flow=90, smooth=1),
        area(100, 10, 900, 30, natural="water", water="river", name="Ä ö"),
        area(100, 200, 300, 400, natural="water", depth="9"),
    )
    streams = {"width": 3.0, "depth": 0.5}
    for width, of_streams in ((None, streams), (20, {"depth": 0.5})):
        sketch = sketch_from_vectors(path, bounds=(0, 0, 1000, 1000), size_px=250, width=width).sketch
        assert properties(sketch, "river") == [
            {"width": 40.0, "directed": 1, "name": "Inn"},
            of_streams | {"directed": 1},
            {"depth": 3.0, "directed": 1},
            {"flow": 90.0, "smooth": 1},
            {"width": 0.0, "name": "Ä ö"},
        ]
        assert sketch.vectors["river"].kinds.tolist() == [1, 1, 1, 1, 2]
        assert sketch.vectors["river"].labels.tolist() == [1] * 5
        assert sketch.properties("river", 1)["width"] == width or 12.0
        assert dict(sketch.labels["lake", 1]) == {}
        assert properties(sketch, "lake") == [{"depth": 9.0}]


def test_lines_that_meet_share_vertices(written) -> None:
    stem = line([0, 0], [1000, 0], [1000, 500], waterway="river")
    for tributary, expected in (
        ([[400, 300], [400, 0]], [400, 0]),
        ([[700, 300], [1000, 0]], [1000, 0]),  # at a vertex of the stem
        ([[1000, 500], [700, 800]], [1000, 500]),  # at its end
        ([[400, 300], [400, 0.375]], None),  # beside it
    ):
        path = written(
            stem, line(*tributary, waterway="stream"), line(tributary[0], [0, 700], waterway="ditch")
        )
        sketch = sketch_from_vectors(path, bounds=(0, 0, 1000, 1000)).sketch
        main, other, third = (shapely.get_coordinates(each).tolist() for each in shapes(sketch, "river"))
        shared = [at for at in main if at in other]
        assert shared == ([expected] if expected else []), tributary
        assert main == [
            at for at in ([0, 0], [400, 0], [1000, 0], [1000, 500]) if at[0] != 400 or shared == [at]
        ]
        assert (other, third) == (tributary, [tributary[0], [0, 700]])


@pytest.mark.parametrize("gap", [-0.4, 0.0, 0.4])
def test_lines_that_nearly_meet_are_one_network(written, gap) -> None:
    path = written(
        line([0, 500], [500, 500], waterway="river"),
        line([500 + gap, 500], [1000, 500], waterway="river"),
        line([250, 900], [250, 500 + gap], waterway="stream"),
    )
    sketch = sketch_from_vectors(path, bounds=(-500, 0, 1500, 2000)).sketch
    water = lay_out_water(sketch, seed=0, ground=lambda x, y: 200 - 0.02 * x + 0 * y, run=Runner())
    main, stream = water.courses
    assert (main.line[0].tolist(), main.line[-1].tolist()) == ([500, 500], [1500, 500])
    assert stream.parent is main
    np.testing.assert_array_equal(stream.line[-1], main.line[stream.joint])


@given(st.integers(0, 1000), st.integers(1, 12))
def test_tributaries_of_random_stems_join_them(seed, count) -> None:
    random = np.random.default_rng(seed)
    stem = shapely.LineString(np.cumsum(random.uniform(-20, 100, (5, 2)), axis=0))
    along = np.sort(random.choice(np.arange(2, int(stem.length) - 2, 3), count, replace=False))
    ends = shapely.get_coordinates(shapely.line_interpolate_point(stem, along))
    tops = ends + random.choice([-1, 1]) * np.array([1000.0, -1000.0])
    before = [stem, *shapely.linestrings(np.stack([tops, ends], axis=1))]
    before = shapely.transform(np.array(before), lambda at: np.rint(at * 1024) / 1024)
    away = shapely.distance(before[1:, None], shapely.points(ends))
    assume((away[~np.eye(count, dtype=bool)] > 1.0).all() and stem.is_simple)
    main, *others = _joined(before)
    vertices = [tuple(at) for at in main.coords]
    for line_, original in zip(others, before[1:], strict=True):
        assert line_.coords[0] == original.coords[0]
        assert line_.coords[-1] in vertices
        assert math.dist(line_.coords[-1], original.coords[-1]) < 0.002
    assert main.hausdorff_distance(before[0]) < 0.002
    assert set(before[0].coords) <= set(vertices)
    places = [before[0].project(shapely.Point(at)) for at in vertices]
    assert np.diff(places).min() > -0.002


def test_riverbanks_are_areas(written) -> None:
    ring = box(0, 400, 1000, 420)
    path = written(
        line(*ring, waterway="riverbank"),
        line(*ring, waterway="river"),
        line([0, 500], [1000, 500], waterway="riverbank"),
    )
    traced = sketch_from_vectors(path)
    assert traced.sketch.vectors["river"].kinds.tolist() == [2, 1, 1]
    assert traced.notes[0] == "used: 2 lines as river, 1 area as river"
    assert shapes(traced.sketch, "river")[1].is_closed


def test_labels_are_merged_beyond_sixteen(written) -> None:
    heights = np.geomspace(20, 2000, 100).tolist()
    tops = (area(0, 10 * i, 900, 10 * i + 9, natural="hill", height=h) for i, h in enumerate(heights))
    traced = sketch_from_vectors(written(*tops))
    labels = [label for name, label in traced.sketch.labels if name == "hill"]
    assert labels == list(range(1, len(labels) + 1))
    assert 8 <= len(labels) <= 16
    merged = [traced.sketch.properties("hill", label)["height"] for label in labels]
    assert merged == sorted(merged)
    assert np.abs(np.log(np.array(heights)[:, None] / merged)).min(axis=1).max() < 0.35
    assert any("some are merged; errors up to" in note for note in traced.notes)

    keys = {"height": 300, "peakiness": 0.2, "erosion": 0.3, "height_limit": 2.0, "multitude": 3}
    ridges = []
    for number in range(32):
        subset = {key: value for bit, (key, value) in enumerate(keys.items()) if number >> bit & 1}
        ridges.append(area(10 * number, 0, 10 * number + 9, 100, natural="ridge", **subset))
    traced = sketch_from_vectors(written(*ridges), size_px=320)
    assert [label for name, label in traced.sketch.labels if name == "mountain"] == [1]
    assert any("all have the defaults" in note for note in traced.notes)

    features = [{"width": 3.0}, {"width": 1.0}, {"width": 3.0}, {}]
    assert cluster_properties(features, 16) == ([0, 1, 0, 2], [{"width": 3.0}, {"width": 1.0}, {}], 0.0)


def test_degrees_are_projected_to_utm_also_across_the_antimeridian(written) -> None:
    path = written(line([LON, LAT + 0.1], [LON + 0.1, LAT], waterway="river"), crs=None)
    traced = sketch_from_vectors(path, size_px=200)
    x, y = rasterio.warp.transform("EPSG:4326", "EPSG:32632", [LON, LON + 0.1], [LAT + 0.1, LAT])
    sketch = traced.sketch
    assert sketch.frame["crs"] == "EPSG:32632"
    west, south = sketch.frame["east"], sketch.frame["north"]
    (river,) = shapes(sketch, "river")
    expected = np.stack([x, y], axis=-1) - (west, south)
    np.testing.assert_allclose(shapely.get_coordinates(river), expected, atol=0.0005)
    assert sketch.weather["latitude"] == pytest.approx(47.05, abs=0.01)

    for places, code in [
        ([[-70.1, -33.0], [-70, -33.1]], "EPSG:32719"),
        ([[179.9, -17.0], [-179.9, -17.2]], "EPSG:32701"),
        ([[179.8, -17.0], [-179.9, -17.2]], "EPSG:32760"),
        ([[10, 85.0], [11, 85.1]], "EPSG:5041"),
        ([[10, -85.0], [11, -85.1]], "EPSG:5042"),
    ]:
        traced = sketch_from_vectors(written(line(*places, waterway="river"), crs=None))
        assert any(f"in {code};" in note for note in traced.notes), places
        assert traced.sketch.extent < 40_000, places


def test_features_are_clipped_to_bounds_also_across_the_antimeridian(written) -> None:
    for places in (
        ([[179.9, -17], [180, -17]], [[-180, -17], [-179.9, -17]]),
        ([[179.9, -17], [-179.9, -17]],),
    ):
        rivers = [line(*each, waterway="river") for each in (*places, [[10, 50], [11, 50]])]
        path = written(*rivers, crs=None)
        traced = sketch_from_vectors(path, bounds=(179.9, -17.05, 180.1, -16.95), size_px=100)
        river = shapely.unary_union(shapes(traced.sketch, "river"))
        west, _, east, _ = river.bounds
        assert (west, east) == pytest.approx((0, traced.sketch.extent), abs=100), places
        assert river.length == pytest.approx(east - west, rel=2e-4), places
        assert any("1 outside" in note for note in traced.notes), places

    world = area(-179, -89, 11.05, 89, natural="water")
    path = written(world, crs=None)
    sketch = sketch_from_vectors(path, bounds=(11.0, 47.0, 11.1, 47.1), size_px=100).sketch
    (lake,) = shapes(sketch, "lake")
    width, height = sketch.size
    assert lake.covers(shapely.box(0, 0, 0.5 * width - 200, height))
    assert not lake.intersects(shapely.box(0.5 * width + 200, 0, width, height))
    assert -0.6 * width < lake.bounds[0] < -0.4 * width  # clipped to a margin


def test_undistorted_metric_crs_is_used_unless_another_is_requested(written) -> None:
    for source, expected, lon, lat in [
        ("EPSG:25832", "EPSG:25832", LON, LAT),
        ("EPSG:3857", "EPSG:326", LON, LAT),
        ("EPSG:2263", "EPSG:326", -74.0, 40.7),
        ("EPSG:2056", "EPSG:2056", 8.0, 47.0),
        ("EPSG:2048", "EPSG:327", 19.0, -33.0),
    ]:
        x, y = rasterio.warp.transform("EPSG:4326", source, [lon, lon + 0.01], [lat, lat + 0.01])
        path = written(line(*np.stack([x, y], axis=-1).tolist(), waterway="river"), crs=source)
        traced = sketch_from_vectors(path)
        assert any(f"in {expected}" in note for note in traced.notes), source
        assert traced.sketch.extent == pytest.approx(1112, rel=0.03), source

    path = written(line([LON, LAT], [LON + 0.1, LAT], waterway="river"), crs=None)
    assert any("EPSG:3035" in note for note in sketch_from_vectors(path, crs="EPSG:3035").notes)


def test_summits_are_discs_and_ridges_are_bands(written) -> None:
    path = written(
        feature("Point", [500, 500], natural="peak", radius=100, ele=2000),
        line([2000, 200], [2000, 800], natural="ridge"),
    )
    sketch = sketch_from_vectors(path, bounds=(0, 0, 2500, 1000), size_px=250, width=300).sketch
    shapes, count = ndimage.label(sketch.layers["mountain"])
    assert count == 2
    rows, columns = np.nonzero(shapes == shapes[50, 50])
    assert len(rows) == pytest.approx(math.pi * 100, rel=0.03)
    assert (rows.mean() + 0.5, columns.mean() + 0.5) == pytest.approx((50, 50), abs=0.2)
    assert (shapes[50] == shapes[50, 200]).sum() == 30
    assert (
        sketch.properties("mountain", 1)["height"] == 0
    )  # automatic: an elevation is no height above the foot


def test_skipped_features_are_reported_by_reason(written) -> None:
    path = written(
        line([0, 0], [1000, 0], waterway="river"),
        feature("Point", [5, 5], amenity="bench"),
        feature("Point", [5, 5], natural="water"),
        line([0, 0], [10, 10], landuse="forest"),
        line([0, 0], [10, 10], natural="water", width=5),
        feature("Polygon", [[[0, 0], [1, 1], [0, 0]]], natural="water"),
        area(10, 10, 11, 11, natural="scree"),
        line([5, 5], [5.0001, 5.0001], waterway="river"),
        feature("Polygon", [], natural="water"),
        {"type": "Feature", "properties": None, "geometry": None},
    )
    traced = sketch_from_vectors(path, size_px=100)
    (note,) = [note for note in traced.notes if note.startswith("skipped")]
    for part in (
        "1 without a known layer",
        "1 that are points of areas",
        "2 that are open lines of areas",
        "1 with areas of less than three corners",
        "1 smaller than half a pixel",
        "1 that collapse to a point",
        "2 without a valid shape",
    ):
        assert part in note
    assert traced.notes[0] == "used: 1 line as river"


def test_properties_and_tags_determine_layer_and_parameters(written) -> None:
    for tags, layer, expected in [
        ({"layer": "Lakes", "waterway": "river"}, "lake", {}),
        ({"layer": -1, "waterway": "canal"}, "river", {"width": 10.0}),
        ({"tags": {"waterway": "stream", "width": "2"}}, "river", {"width": 2.0, "depth": 0.5}),
        ({"other_tags": '"waterway"=>"river","width"=>"7.5 m"', "waterway": None}, "river", {"width": 7.5}),
        ({"fclass": "reservoir"}, "lake", {}),
        ({"WATERWAY": "River", "WIDTH": 9}, "river", {"width": 9.0}),
        ({"natural": "glacier"}, "material", {"material": "snow"}),
        ({"type": "mountain", "strength": 321.0}, "mountain", {"height": 321.0}),
        ({"natural": "wood", "density": 7}, "landuse", {"density": 1.0}),
        ({"layer": "forest", "density": "thick"}, "forest", {"density": 0.8}),
        ({}, "dune", {}),
    ]:
        ring = box(0, 0, 1000, 1000)
        path = written(line(*ring, **tags) if layer == "river" else area(0, 0, 1e3, 1e3, **tags))
        sketch = sketch_from_vectors(path, layer="dune", size_px=40).sketch
        found = [name for name, image in sketch.layers.items() if image.any()]
        found += [name for name, vectors in sketch.vectors.items() if len(vectors)]
        assert found == [layer], tags
        values = properties(sketch, layer)[0] if layer in sketch.vectors else sketch.properties(layer, 1)
        assert {key: values[key] for key in expected} == expected, tags


def test_geometries_in_collections_and_closed_lines_are_read(tmp_path, written) -> None:
    path = tmp_path / "lakes.json"
    nested: dict = {"type": "Polygon", "coordinates": [box(11, 47, 11.1, 47.1)]}
    for _ in range(9):
        nested = {"type": "GeometryCollection", "geometries": [nested]}
    path.write_bytes(b"\xef\xbb\xbf \n" + json.dumps(nested).encode())
    assert detect_kind(path) == "vectors"
    assert len(shapes(sketch_from_vectors(path, size_px=20).sketch, "lake")) == 1  # by the file's name
    path = written(line(*box(0, 0, 1000, 1000), natural="wood"))
    (wood,) = shapes(sketch_from_vectors(path, size_px=50).sketch, "landuse")
    assert wood.equals(shapely.box(0, 0, 1000, 1000))


def test_layers_of_a_geopackage_are_reprojected_and_combined(tmp_path) -> None:
    path = tmp_path / "map.gpkg"
    pack(path, "EPSG:25832", "rivers", [shapely.LineString([(0, 0), (1000, 1000)])], width=[80.0])
    lake = shapely.MultiPolygon([shapely.box(700, 0, 1000, 300)])
    ground = [shapely.box(0, 0, 300, 1000), shapely.Point(5, 5), lake]
    pack(path, "EPSG:25832", "ground", ground, natural=["wood", "tree", "water"], width=[math.nan] * 3)
    degrees = shapely.transform(
        shapely.box(600, 600, 800, 800),
        lambda xy: np.stack(rasterio.warp.transform("EPSG:25832", "EPSG:4326", *xy.T), axis=-1),
    )
    pack(path, "EPSG:4326", "Mountains", [degrees])
    traced = sketch_from_vectors(path, **SQUARE)
    layers = traced.sketch.layers
    assert shapes(traced.sketch, "landuse")[0].equals(shapely.box(0, 0, 300, 1000))
    assert shapes(traced.sketch, "lake")[0].equals(shapely.box(700, 0, 1000, 300))
    assert shapely.get_coordinates(shapes(traced.sketch, "river")).tolist() == [[0, 0], [1000, 1000]]
    assert properties(traced.sketch, "river") == [{"width": 80}]
    mountain = np.argwhere(layers["mountain"])
    np.testing.assert_allclose([mountain.min(axis=0), mountain.max(axis=0)], [[20, 60], [39, 79]], atol=1)


def test_geopackage_without_crs_is_in_metres(tmp_path) -> None:
    path = tmp_path / "map.gpkg"
    with pytest.warns(UserWarning, match="'crs' was not provided"):
        pack(path, None, "lakes", [shapely.box(10, 20, 110, 60)], depth=[3.5])
    traced = sketch_from_vectors(path, size_px=50)
    assert traced.sketch.size == (100.0, 40.0)
    assert shapes(traced.sketch, "lake")[0].equals(shapely.box(0, 0, 100, 40))
    assert properties(traced.sketch, "lake") == [{"depth": 3.5}]
    with pytest.raises(InputError, match="no coordinate reference system"):
        sketch_from_vectors(path, crs="EPSG:25832")


@given(st.integers(0, 1000), st.integers(2, 12), st.floats(0, 6), st.integers(1, 40), st.integers(1, 40))
def test_painted_lines_are_connected(seed, count, width, rows, columns) -> None:
    line = np.random.default_rng(seed).uniform(0, (columns, rows), (count, 2))
    painted = paint_lines((rows, columns), np.array([shapely.LineString(line)]), np.array([width]))
    assert ndimage.label(painted, np.ones((3, 3)))[1] == 1
    column, row = np.floor(line).astype(int).T
    assert painted[row, column].all()


def test_painted_lines_cover_pixel_centres_within_half_their_width() -> None:
    line = shapely.LineString(np.random.default_rng(7).uniform(-15, 65, (6, 2)))
    rows, columns = np.indices((50, 60)) + 0.5
    away = shapely.distance(line, shapely.points(columns, rows))
    for width in [0.5, 1.5, 2.0, 5.0, 13.7, 60.0, 1e6]:
        painted = paint_lines((50, 60), np.array([line]), np.array([width]))
        assert painted[away < 0.5 * width - 0.1].all(), width
        beyond = painted & (away > 0.5 * width + 0.1)
        assert (away[beyond] < 0.75).all(), width  # only what the course itself touches

    disc = paint_lines((40, 40), np.array([shapely.Point(20, 20)]), np.array([20.0]))
    assert disc.sum() == pytest.approx(np.pi * 100, rel=0.02)
    assert not paint_lines((9, 9), np.array([]), np.array([])).any()


def test_areas_are_painted_by_pixel_centres_or_by_touch() -> None:
    whole, hole = shapely.box(1.4, 1.4, 8.6, 8.6), shapely.box(4, 4, 6, 6)
    painted = paint_areas((10, 10), np.array([whole - hole]), touched=False)
    assert painted.sum() == 8 * 8 - 4
    assert not painted[4:6, 4:6].any()
    assert paint_areas((10, 10), np.array([whole]), touched=True).sum() == 64
    assert not paint_areas((10, 10), np.array([]), touched=True).any()


@given(st.lists(st.floats(0.1, 2000), min_size=1, max_size=80), st.integers(1, 16))
def test_number_and_error_of_clusters_are_bounded(values, most) -> None:
    of, classes, error = cluster_properties([{"width": value, "kind": "a"} for value in values], most)
    assert 1 <= len(classes) <= most
    for value, index in zip(values, of, strict=True):
        if np.isfinite(error):
            assert abs(classes[index]["width"] / value - 1) <= error + 1e-12


def test_utm_metres_are_true_and_crs_can_be_code_urn_or_wkt() -> None:
    degrees = parse_crs("OGC:CRS84")
    for lon in [-179.5, -60.0, 0.1, 11.0, 179.5]:
        for lat in [-79.0, -33.0, 0.1, 47.0, 83.0]:
            crs = metric_crs_at(degrees, (lon, lat))
            step = 0.001
            a, b = reproject(np.array([(lon, lat), (lon, lat + step)]), degrees, crs)
            assert np.hypot(*(b - a)) == pytest.approx(step * 111_200, rel=0.006), (lon, lat)
            assert metric_crs_at(crs, tuple(a)) == crs, (lon, lat)
    for longitudes, middle in [([10, 20], 15), ([179, -179], 180), ([190, 200], -165)]:
        off = mean_longitude(np.array(longitudes)) - middle
        assert np.cos(np.radians(off)) == pytest.approx(1.0), longitudes

    crs = parse_metric_crs("EPSG:25832")
    for text in ("epsg:25832 ", "urn:ogc:def:crs:EPSG::25832", crs.to_wkt()):
        assert parse_metric_crs(text) == crs


LINE = '{"type":"LineString","coordinates":%s}'
FEATURE = '{"type":"Feature","properties":{"waterway":"river"},"geometry":%s}'


def refused(path, **options) -> str:
    with pytest.raises(InputError) as message:
        sketch_from_vectors(path, **options)
    line = str(message.value)
    assert "\n" not in line
    assert len(line) < 320
    return line


def write(path, **options) -> None:
    areas = [shapely.box(0, 0, 1000, 500), shapely.box(0, 500, 400, 1000)]
    fields = {"natural": ["wood", "water"], "density": [0.25, math.nan]}
    pack(path, "EPSG:25832", "lakes", areas, geometry_type="Polygon", **fields, **options)


@pytest.fixture
def package(tmp_path):
    write(tmp_path / "map.gpkg")
    return tmp_path / "map.gpkg"


def sql(path, *statements: str) -> None:
    with sqlite3.connect(path) as connection:
        for statement in statements:
            connection.execute(statement)
    connection.close()


def test_all_formats_give_the_same_sketch(tmp_path) -> None:
    sketches = {}
    for name, driver, options in (
        *(("map.gpkg", "GPKG", {}), ("map.geojson", "GeoJSON", {"RFC7946": "NO"})),
        *(("map.fgb", "FlatGeobuf", {}), ("map.shp", "ESRI Shapefile", {})),
    ):
        write(tmp_path / name, driver=driver, options=options)
        assert detect_kind(tmp_path / name) == "vectors", name
        sketches[name] = sketch_from_vectors(tmp_path / name, size_px=50).sketch
    for name, sketch in sketches.items():
        assert sketch.extent == 1000, name
        assert shapes(sketch, "landuse")[0].equals(shapely.box(0, 0, 1000, 500)), name
        assert properties(sketch, "landuse") == [{"density": 0.25}], name
        assert shapes(sketch, "lake")[0].equals(shapely.box(0, 500, 400, 1000)), name


def test_malformed_geojson_is_refused(tmp_path) -> None:
    collection = '{"type":"FeatureCollection","features":%s}'
    nowhere = collection[:-1] + ',"crs":{"type":"name","properties":{"name":"EPSG:77777"}}}'
    for content, message in [
        ("", "begins with b''"),
        ("[1, 2]", "expected a vector file"),
        ("<OGRVRTDataSource><OGRVRTLayer/></OGRVRTDataSource>", "expected a vector file"),
        ("{", "cannot be read as GeoJSON"),
        ('{"type": "Topology", "objects": {}}', "cannot be read as GeoJSON"),
        ('{"type": "gdal_streamed_alg", "command_line": "gdal vector read x"}', "cannot be read as GeoJSON"),
        ('{"type": "FeatureCollection"}', "Missing 'features' member"),
        (collection % "[]", "found none"),
        *(
            (FEATURE % shape, "no usable feature (1 with")
            for shape in ("null", '{"type":"Curve"}', LINE % "[[1],[2]]", LINE % "[[1,2],[3,NaN]]")
        ),
        (FEATURE % (LINE % "[[452000,5403000],[453000,5404000]]"), "not a longitude and latitude"),
        (FEATURE % (LINE % "[[11,47],[11,95]]"), "11, 95 is not a longitude and latitude"),
        (nowhere % "[]", "'EPSG:77777' is not a coordinate reference system"),
        (FEATURE % (LINE % "[[11,47],[11,47]]"), "the area is 0 m long"),
        (FEATURE % (LINE % "[[11,47],[60,47]]"), "expected 1 to 1e+06 m"),
        (FEATURE.replace("water", "high") % (LINE % "[[11,47],[11,48]]"), "no feature has a layer"),
        (LINE % ("[" * 200_000 + "]" * 200_000), "nesting too deep"),
        (b'{"type": "\xff\xfe"}', "cannot be read as GeoJSON"),
        (b"fgb\x03fgb\x01\xff\xff\xff\xff" + b"\xff" * 99, "found none"),
        (b"\0\0\x27\x0a" + b"\xff" * 99, "cannot be read as ESRI Shapefile"),
        (b"\0\0\0\x0d\n\tOSMHeader\x18\x05" + b"\xff" * 99, "cannot be read as OSM"),
    ]:
        path = tmp_path / "map.geojson"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        line = refused(path)
        assert message in line, content[:120]
        assert line.startswith(str(path)), content[:120]

    assert "cannot be read (No such file" in refused(tmp_path / "none.geojson")
    assert "cannot be read" in refused(tmp_path)


def test_too_large_files_are_refused(tmp_path, package, monkeypatch) -> None:
    path = tmp_path / "map.geojson"
    path.write_bytes(b'{"type":"LineString","coordinates":[' + b"[1,2]," * 10_000_000 + b"[1,2]]}")
    assert "about 5e+06 vertices: expected at most 4 million" in refused(path)
    with path.open("wb") as stream:
        stream.write(b"{")
        stream.truncate(600 << 20)
    assert "600 MiB: expected at most 512 MiB" in refused(path)
    monkeypatch.setattr("sketchterrain.importing.vector_files.MAX_VERTICES", 9)
    assert "vertices: expected at most" in refused(package)


def test_unusable_options_are_refused(tmp_path, capfd) -> None:
    for options, message in [
        ({"layer": "rivers"}, "unknown layer 'rivers': expected mountain"),
        ({"width": -1.0}, "width: expected metres"),
        ({"bounds": (1, 0, 0, 1)}, "bounds: expected west < east"),
        ({"bounds": (20, 47, 21, 48)}, "no usable feature within the bounds"),
        ({"bounds": (-89, -89, 89, 89)}, "set smaller bounds"),
        ({"size_px": 20000}, "size: expected 1 to 16384 px"),
        ({"crs": "EPSG:0"}, "not a coordinate reference system"),
        ({"crs": "EPSG:4326"}, "in degrees"),
        ({"crs": "EPSG:27200", "bounds": (10, 46, 12, 48)}, ""),
    ]:
        path = tmp_path / "map.geojson"
        path.write_text(FEATURE % (LINE % "[[11,47],[11.1,47.1]]"))
        assert message in refused(path, **options), options
        assert capfd.readouterr().err == "", options


def test_file_names_are_not_interpreted(package, tmp_path) -> None:
    for name in ["zip:a.gpkg", "x!y.zip", "späť ?#%20.gpkg", "plain"]:
        package = package.rename(package.with_name(name))
        assert len(sketch_from_vectors(package, size_px=20).sketch.vectors["lake"]) == 1, name
        assert [each.name for each in package.parent.iterdir()] == [name], name
    for name in ["a!b.json", "http:plain"]:
        path = tmp_path / name
        path.write_text(json.dumps({"type": "LineString", "coordinates": [[11, 47], [11.1, 47.1]]}))
        assert len(sketch_from_vectors(path, size_px=20, layer="river").sketch.vectors["river"]) == 1, name


def test_views_of_a_geopackage_are_refused_and_triggers_not_run(package) -> None:
    sql(package, "CREATE TRIGGER bad AFTER INSERT ON lakes BEGIN DELETE FROM lakes; END")
    content = package.read_bytes()
    assert len(sketch_from_vectors(package, size_px=20).sketch.vectors["lake"]) == 1
    assert package.read_bytes() == content
    endless = "WITH RECURSIVE n(fid) AS (SELECT 1 UNION ALL SELECT fid + 1 FROM n)"
    sql(
        package,
        f"CREATE VIEW endless AS {endless} SELECT fid, NULL AS geom FROM n",  # noqa: S608
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES "
        "('endless', 'features', 'endless', 25832)",
        "INSERT INTO gpkg_geometry_columns VALUES ('endless', 'geom', 'POLYGON', 25832, 0, 0)",
    )
    assert "expected a table, not a view" in refused(package)
    package.write_bytes(content)
    sql(
        package,
        "DROP TABLE gpkg_geometry_columns",
        f"CREATE VIEW gpkg_geometry_columns AS {endless} SELECT fid AS table_name, fid AS srs_id FROM n",  # noqa: S608
    )
    assert "another SQLite database" in refused(package)


def damaged(path, kind):
    """Write a Shapefile or FlatGeobuf of 19 rivers, damaged from number 12 on."""
    rivers = shapely.linestrings([[(10 * k, 0), (10 * k, 500), (10 * k + 5, 900)] for k in range(19)])
    columns = [np.array(["river"] * 19, object), np.arange(19)]
    given = {"driver": "FlatGeobuf", "layer_options": {"SPATIAL_INDEX": "NO"}}
    given = given if path.suffix == ".fgb" else {"driver": "ESRI Shapefile"}
    given |= {"geometry_type": "LineString", "crs": "EPSG:25832"}
    pyogrio.raw.write(path, shapely.to_wkb(rivers), columns, ["waterway", "number"], **given)
    part = path.with_suffix(kind.split()[0])
    whole = part.read_bytes()
    size = {".shp": 104, ".shx": 8, ".dbf": (len(whole) - 1) // 19, ".fgb": 128}[part.suffix]
    at = len(whole) - 7 * size
    part.write_bytes(whole[:at] + (b"" if kind.endswith("cut") else b"\xff" * (len(whole) - at)))
    return path


@pytest.mark.parametrize(
    "kind", [".shp cut", ".shp", ".shx", ".shx cut", ".dbf cut", ".dbf", ".fgb cut", ".fgb"]
)
def test_intact_features_of_damaged_files_are_kept(tmp_path, kind) -> None:
    path = damaged(tmp_path / ("a.fgb" if ".fgb" in kind else "a.shp"), kind)
    traced = sketch_from_vectors(path, size_px=16)
    kept = len(traced.sketch.vectors["river"])
    assert kept == 19 if ".shx" in kind else 9 <= kept <= 14, kept
    assert kept == 19 or f"skipped: {19 - kept} " in " ".join(traced.notes)
    drapes = Drapes.open([DrapedLayer(str(path))], traced.sketch.frame, (900.0, 900.0), 900.0)
    assert drapes.problems == ()
    table = drapes.table(0)
    assert table.values("number", [0, 9]) == [0, 9]
    assert table.feature(9).geometry.bounds[3] == pytest.approx(900.0, abs=1.0)
    note = f"a: {19 - kept} of 19 features have no geometry, or are damaged"
    assert drapes.notes == (() if kept == 19 else (note,))


def test_damaged_geopackages_are_refused(package, tmp_path) -> None:
    content = package.read_bytes()
    for length in [16, 4096, len(content) // 2]:
        package.write_bytes(content[:length])
        refused(package)
    package.write_bytes(content[:100] + np.random.default_rng(1).bytes(len(content) - 100))
    refused(package)
    package.write_bytes(content)
    sql(package, "DELETE FROM gpkg_spatial_ref_sys WHERE srs_id = 25832")
    assert "layer 'lakes': its CRS 25832 is not in the file" in refused(package)
    sql(tmp_path / "another.gpkg", "CREATE TABLE lakes (geom BLOB)")
    assert "another SQLite database" in refused(tmp_path / "another.gpkg")


def test_invalid_shapes_are_skipped_or_repaired(package, tmp_path) -> None:
    sql(
        package,
        "DROP TRIGGER IF EXISTS rtree_lakes_geom_insert",
        "INSERT INTO lakes (geom) VALUES (x'4750'), (NULL), (x'47500001000000000103')",
    )
    notes = sketch_from_vectors(package, size_px=20).notes
    assert any("3 without a valid shape" in note for note in notes)

    bow = [(0, 0), (100, 100), (100, 0), (0, 100), (0, 0)]
    overlapping = [(200, 0), (300, 0), (300, 80), (200, 80), (200, 20), (300, 20), (300, 100), (200, 100)]
    flat = [(0, 0), (50, 50), (0, 0), (0, 0)]
    with np.errstate(invalid="ignore"):
        endless = shapely.from_wkt(["LINESTRING (0 0, nan 5)", "LINESTRING (0 0, inf 5)"])
    odd = [
        *(shapely.Polygon(each) for each in (bow, overlapping, flat)),
        *endless,
        shapely.GeometryCollection([shapely.box(0, 200, 100, 300), shapely.Point(5, 5)]),
    ]
    pack(tmp_path / "odd.gpkg", "EPSG:25832", "lakes", odd)
    traced = sketch_from_vectors(tmp_path / "odd.gpkg", bounds=(0, 0, 300, 300), size_px=300)
    lakes = shapes(traced.sketch, "lake")
    assert [each.area for each in lakes] == [2500, 2500, 10_000, 10_000]
    assert lakes[2].equals(shapely.box(200, 0, 300, 100))
    assert lakes[3].equals(shapely.box(0, 200, 100, 300))
    (note,) = (note for note in traced.notes if note.startswith("skipped"))
    assert "2 with coordinates that are not finite" in note
    assert "1 with areas of less than three corners" in note
    assert "1 that are points" in note
    assert "areas that cross themselves (2): repaired" in traced.notes
