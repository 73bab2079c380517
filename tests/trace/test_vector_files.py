"""Vector files: formats that GDAL reads, and malformed, oversized and hostile ones refused in one line."""

import json
import sqlite3

import numpy as np
import pyogrio
import pytest
import shapely

from sketchterrain.errors import InputError
from sketchterrain.trace.picture import kind_of
from sketchterrain.trace.vectors import sketch_from_vectors

LINE = '{"type":"LineString","coordinates":%s}'
FEATURE = '{"type":"Feature","properties":{"waterway":"river"},"geometry":%s}'


def refused(path, **options) -> str:
    with pytest.raises(InputError) as told:
        sketch_from_vectors(path, **options)
    line = str(told.value)
    assert "\n" not in line
    assert len(line) < 320
    return line


def write(path, driver: str, **options) -> None:
    shapes = shapely.to_wkb(np.array([shapely.box(0, 0, 1000, 500), shapely.box(0, 500, 400, 1000)]))
    options = {"layer": "lakes", "geometry_type": "Polygon", "crs": "EPSG:25832"} | options
    values = [np.array(["wood", "water"], object), np.array([0.25, np.nan])]
    pyogrio.raw.write(path, shapes, values, ["natural", "density"], driver=driver, **options)


@pytest.fixture
def package(tmp_path):
    write(tmp_path / "map.gpkg", "GPKG")
    return tmp_path / "map.gpkg"


def sql(path, *statements: str) -> None:
    with sqlite3.connect(path) as connection:
        for statement in statements:
            connection.execute(statement)
    connection.close()


def test_each_format_gives_the_same_sketch(tmp_path) -> None:
    sketches = {}
    for name, driver in {
        "map.gpkg": "GPKG",
        "map.geojson": "GeoJSON",
        "map.fgb": "FlatGeobuf",
        "map.shp": "ESRI Shapefile",
    }.items():
        write(tmp_path / name, driver, **({"RFC7946": "NO"} if driver == "GeoJSON" else {}))
        assert kind_of(tmp_path / name) == "vectors", name
        sketches[name] = sketch_from_vectors(tmp_path / name, size_px=50).sketch
    for name, sketch in sketches.items():
        assert sketch.extent == 1000, name
        assert sketch.layers["forest"][25:].all(), name
        assert sketch.properties("forest", 1)["density"] == 0.25, name
        assert np.argwhere(sketch.layers["lake"]).max(axis=0).tolist() == [24, 19], name


def test_malformed_geojson_is_refused_in_one_line(tmp_path) -> None:
    collection = '{"type":"FeatureCollection","features":%s}'
    for content, told in [
        ("", "begins with b''"),
        ("   ", "expected a vector file"),
        ("[1, 2]", "expected a vector file"),
        ("<OGRVRTDataSource><OGRVRTLayer/></OGRVRTDataSource>", "expected a vector file"),
        ('<VRTDataset rasterXSize="1" rasterYSize="1"/>', "expected a vector file"),
        ("{", "cannot be read as GeoJSON"),
        (collection % "[}", "cannot be read as GeoJSON"),
        ("{}", "cannot be read as GeoJSON"),
        ('{"type": "Topology", "objects": {}}', "cannot be read as GeoJSON"),
        ('{"type": "gdal_streamed_alg", "command_line": "gdal vector read x"}', "cannot be read as GeoJSON"),
        ('{"type": "FeatureCollection"}', "Missing 'features' member"),
        (collection % "[]", "it has none"),
        (collection % "[3]", "it has none"),
        (FEATURE % "null", "nothing in it says what it is"),
        (FEATURE % '{"type":"Curve"}', "nothing in it says what it is"),
        (FEATURE % (LINE % "[[1],[2]]"), "nothing in it says what it is"),
        (FEATURE % (LINE % '[["1","2"],["3","4"]]'), "nothing in it says what it is"),
        (FEATURE % (LINE % "[[1,2],[3,NaN]]"), "nothing in it says what it is"),
        (FEATURE % (LINE % "[[1,2],[3,1e999]]"), "nothing in it says what it is"),
        (FEATURE % (LINE % f"[[1,2],[3,1{'0' * 5000}]]"), "no longitude and latitude"),
        (FEATURE % (LINE % "[[452000,5403000],[453000,5404000]]"), "no longitude and latitude"),
        (FEATURE % (LINE % "[[11,47],[11,95]]"), "11, 95 is no longitude and latitude"),
        (FEATURE % (LINE % "[[11,47],[11,47]]"), "the area is 0 m long"),
        (FEATURE % (LINE % "[[11,47],[60,47]]"), "expected 1 to 1e+06 m"),
        (FEATURE.replace("water", "high") % (LINE % "[[11,47],[11,48]]"), "nothing in it says what"),
        ('{"a":' * 200_000, "cannot be read as GeoJSON"),
        (LINE % ("[" * 200_000 + "]" * 200_000), "nesting too deep"),
        ('{"type":"GeometryCollection","geometries":[' * 50_000 + "]}" * 50_000, "nesting too deep"),
        (b'{"type": "\xff\xfe"}', "cannot be read as GeoJSON"),
        (b"fgb\x03fgb\x01\xff\xff\xff\xff" + b"\xff" * 99, "it has none"),
        (b"\0\0\x27\x0a" + b"\xff" * 99, "cannot be read as ESRI Shapefile"),
        (b"\0\0\0\x0d\n\tOSMHeader\x18\x05" + b"\xff" * 99, "cannot be read as OSM"),
    ]:
        path = tmp_path / "map.geojson"
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
        line = refused(path)
        assert told in line, content[:120]
        assert line.startswith(str(path)), content[:120]

    assert "cannot be read (No such file" in refused(tmp_path / "none.geojson")
    assert "cannot be read" in refused(tmp_path)


def test_too_large_files_are_refused(tmp_path, package, monkeypatch) -> None:
    path = tmp_path / "map.geojson"
    path.write_bytes(b'{"type":"LineString","coordinates":[' + b"[1,2]," * 10_000_000 + b"[1,2]]}")
    assert "about 5e+06 vertices: expected at most 4 million" in refused(path)
    path.write_bytes(b'{"type":"LineString","coordinates":[' + b"1," * 40_000_000 + b"1]}")
    assert "expected at most 4 million" in refused(path)
    with path.open("wb") as stream:
        stream.write(b"{")
        stream.truncate(600 << 20)
    assert "600 MiB: expected at most 512 MiB" in refused(path)
    monkeypatch.setattr("sketchterrain.trace.vector_files.MOST_VERTICES", 9)
    assert "vertices: expected at most" in refused(package)


def test_unusable_options_are_refused(tmp_path, capfd) -> None:
    for options, told in [
        ({"layer": "rivers"}, "unknown layer 'rivers': expected mountain"),
        ({"width": float("nan")}, "width: expected metres"),
        ({"width": -1.0}, "width: expected metres"),
        ({"bounds": (1, 0, 0, 1)}, "bounds: expected west < east"),
        ({"bounds": (0, 0, float("inf"), 1)}, "bounds: expected west < east"),
        ({"bounds": (20, 47, 21, 48)}, "nothing that belongs to a sketch lies in these bounds"),
        ({"bounds": (-89, -89, 89, 89)}, "give smaller bounds"),
        ({"size_px": 0}, "size: expected 1 to 16384 px"),
        ({"size_px": 20000}, "size: expected 1 to 16384 px"),
        ({"crs": "EPSG:0"}, "no coordinate reference system"),
        ({"crs": "EPSG:4326"}, "in degrees"),
        ({"crs": "EPSG:27200", "bounds": (10, 46, 12, 48)}, ""),
    ]:
        path = tmp_path / "map.geojson"
        path.write_text(FEATURE % (LINE % "[[11,47],[11.1,47.1]]"))
        assert told in refused(path, **options), options
        assert capfd.readouterr().err == "", options


def test_a_file_may_have_any_name(package, tmp_path) -> None:
    for name in ["a!b.gpkg", "zip:a.gpkg", "b.zip", "x!y.zip", "späť ?#%20.gpkg", "plain"]:
        package = package.rename(package.with_name(name))
        assert sketch_from_vectors(package, size_px=20).sketch.layers["lake"].any(), name
        assert [each.name for each in package.parent.iterdir()] == [name], name
    for name in ["a!b.json", "späť ?#%20.json", "http:plain"]:
        path = tmp_path / name
        path.write_text(json.dumps({"type": "LineString", "coordinates": [[11, 47], [11.1, 47.1]]}))
        assert sketch_from_vectors(path, size_px=20, layer="river").sketch.layers["river"].any(), name


def test_views_of_a_geopackage_are_not_queried_and_triggers_not_run(package) -> None:
    sql(package, "CREATE TRIGGER bad AFTER INSERT ON lakes BEGIN DELETE FROM lakes; END")
    whole = package.read_bytes()
    assert sketch_from_vectors(package, size_px=20).sketch.layers["lake"].any()
    assert package.read_bytes() == whole
    endless = "WITH RECURSIVE n(fid) AS (SELECT 1 UNION ALL SELECT fid + 1 FROM n)"
    for statements in [
        [
            f"CREATE VIEW endless AS {endless} SELECT fid, NULL AS geom FROM n",  # noqa: S608
            "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES "
            "('endless', 'features', 'endless', 25832)",
            "INSERT INTO gpkg_geometry_columns VALUES ('endless', 'geom', 'POLYGON', 25832, 0, 0)",
        ],
        [
            "ALTER TABLE lakes RENAME TO other",
            "CREATE VIEW lakes AS SELECT * FROM other",
            "UPDATE gpkg_contents SET table_name = 'lakes'",
            "UPDATE gpkg_geometry_columns SET table_name = 'lakes'",
        ],
    ]:
        package.write_bytes(whole)
        sql(package, *statements)
        assert "expected a table, not a view" in refused(package)
    package.write_bytes(whole)
    sql(
        package,
        "DROP TABLE gpkg_geometry_columns",
        f"CREATE VIEW gpkg_geometry_columns AS {endless} SELECT fid AS table_name, fid AS srs_id FROM n",  # noqa: S608
    )
    assert "another SQLite database" in refused(package)


def test_damaged_geopackages_are_refused(package, tmp_path) -> None:
    content = package.read_bytes()
    for keep in [16, 100, 4096, 0.5, 0.9]:
        package.write_bytes(content[: int(keep if keep > 1 else keep * len(content))])
        refused(package)
    package.write_bytes(content[:100] + np.random.default_rng(1).bytes(len(content) - 100))
    refused(package)
    broken = content.replace(b"TABLE gpkg_ogr_contents", b"TABLX gpkg_ogr_contents")
    package.write_bytes(broken.replace(b"gpkg_ogr_contents", b"gpkg_ogr_con\xf5\xf5\xf5\xf5\xf5"))
    assert "expected a whole GeoPackage" in refused(package)

    package.write_bytes(content)
    sql(package, "DELETE FROM gpkg_spatial_ref_sys WHERE srs_id = 25832")
    assert "layer 'lakes': its CRS 25832 is not in the file" in refused(package)
    sql(tmp_path / "another.gpkg", "CREATE TABLE lakes (geom BLOB)")
    assert "another SQLite database" in refused(tmp_path / "another.gpkg")


def test_unreadable_shapes_are_left_out_and_broken_ones_repaired(package, tmp_path) -> None:
    sql(
        package,
        "DROP TRIGGER IF EXISTS rtree_lakes_geom_insert",
        "INSERT INTO lakes (geom) VALUES (x'4750'), (NULL), (x'47500001000000000103')",
    )
    notes = sketch_from_vectors(package, size_px=20).notes
    assert any("3 without a shape that can be read" in note for note in notes)

    bow = [(0, 0), (100, 100), (100, 0), (0, 100), (0, 0)]
    overlapping = [(200, 0), (300, 0), (300, 80), (200, 80), (200, 20), (300, 20), (300, 100), (200, 100)]
    flat = [(0, 0), (50, 50), (0, 0), (0, 0)]
    with np.errstate(invalid="ignore"):
        endless = shapely.from_wkt(["LINESTRING (0 0, nan 5)", "LINESTRING (0 0, inf 5)"])
    shapes = [
        *(shapely.Polygon(each) for each in (bow, overlapping, flat)),
        *endless,
        shapely.GeometryCollection([shapely.box(0, 200, 100, 300), shapely.Point(5, 5)]),
    ]
    pyogrio.raw.write(
        tmp_path / "odd.gpkg", shapely.to_wkb(np.array(shapes)), [], [], layer="lakes", driver="GPKG",
        geometry_type="Unknown", crs="EPSG:25832",
    )  # fmt: skip
    traced = sketch_from_vectors(tmp_path / "odd.gpkg", bounds=(0, 0, 300, 300), size_px=300)
    lake = traced.sketch.layers["lake"] > 0
    assert lake[:100, :100].all()
    assert lake[200:, 200:].all()
    assert lake[200:, :100].sum() == pytest.approx(5000, abs=200)
    (left,) = (note for note in traced.notes if note.startswith("left out"))
    assert "2 with coordinates that are not finite" in left
    assert "1 with areas of less than three corners" in left
    assert "1 that are points" in left
