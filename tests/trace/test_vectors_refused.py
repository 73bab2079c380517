"""Malformed, oversized and hostile vector files: each is refused in one line."""

from __future__ import annotations

import sqlite3

import numpy as np
import pyogrio
import pytest
import shapely

from sketchterrain.errors import InputError
from sketchterrain.trace.vectors import is_vectors, sketch_from_vectors

LINE = '{"type":"LineString","coordinates":%s}'
FEATURE = '{"type":"Feature","properties":{"waterway":"river"},"geometry":%s}'


def refused(path, **options) -> str:
    with pytest.raises(InputError) as told:
        sketch_from_vectors(path, **options)
    line = str(told.value)
    assert "\n" not in line
    assert len(line) < 320
    return line


def test_malformed_geojson_is_refused_in_one_line(tmp_path) -> None:
    for content, told in [
        ("", "begins with b''"),
        ("   ", "expected GeoJSON or a GeoPackage"),
        ("[1, 2]", "expected GeoJSON or a GeoPackage"),
        ("<OGRVRTDataSource><OGRVRTLayer/></OGRVRTDataSource>", "expected GeoJSON or a GeoPackage"),
        ('<VRTDataset rasterXSize="1" rasterYSize="1"/>', "expected GeoJSON or a GeoPackage"),
        ("{", "expected JSON"),
        ('{"type": "FeatureCollection", "features": [}', "line 1, column 44"),
        ("{}", "got the type None"),
        ('{"type": "Topology", "objects": {}}', "got the type 'Topology'"),
        ('{"type": {"a": []}}', "expected GeoJSON"),
        ('{"type": "FeatureCollection"}', "features: expected a list"),
        ('{"type": "FeatureCollection", "features": []}', "it has none"),
        ('{"type": "FeatureCollection", "features": [3]}', "features[0]: expected a Feature, got 3"),
        (FEATURE % "null", "nothing in it says what it is"),
        (FEATURE % "[]", "expected a geometry, got []"),
        (FEATURE % '{"type":"Curve"}', "expected a geometry"),
        (FEATURE % '{"type":"GeometryCollection"}', "geometries: expected a list"),
        (FEATURE % (LINE % "7"), "coordinates: expected a list, got 7"),
        (FEATURE % (LINE % "[1,2]"), "expected a list of positions"),
        (FEATURE % (LINE % "[[1],[2]]"), "expected a list of positions"),
        (FEATURE % (LINE % '[["1","2"],["3","4"]]'), "expected a list of positions"),
        (FEATURE % (LINE % "[[true,false],[false,true]]"), "expected a list of positions"),
        (FEATURE % (LINE % "[[1,null],[2,3]]"), "expected a list of positions"),
        (FEATURE % (LINE % '[[1,2],{"a":1}]'), "expected a list of positions"),
        (FEATURE % (LINE % "[[1,2],[3,NaN]]"), "NaN is no number"),
        (FEATURE % (LINE % "[[1,2],[3,1e999]]"), "expected finite coordinates"),
        (FEATURE % (LINE % f"[[1,2],[3,1{'0' * 5000}]]"), "expected JSON"),
        (FEATURE % (LINE % f"[[1,2],[3,1{'0' * 30}]]"), "expected a list of positions"),
        (FEATURE % (LINE % "[[452000,5403000],[453000,5404000]]"), "no longitude and latitude"),
        (FEATURE % (LINE % "[[11,47],[11,95]]"), "11, 95 is no longitude and latitude"),
        (FEATURE % (LINE % "[[11,47],[11,47]]"), "the area is 0 m long"),
        (FEATURE % (LINE % "[[11,47],[60,47]]"), "expected 1 to 1e+06 m"),
        (FEATURE.replace("water", "high") % (LINE % "[[11,47],[11,48]]"), "nothing in it says what"),
        ('{"type":"Feature","properties":[1],"geometry":null}', "properties as an object"),
        ('{"type":"FeatureCollection","features":[],"crs":{"type":"link"}}', "crs: expected a name"),
        ('{"type":"FeatureCollection","features":[],"crs":{"properties":{"name":"x"}}}', "crs: 'x' is no"),
    ]:
        path = tmp_path / "map.geojson"
        path.write_text(content)
        line = refused(path)
        assert told in line, content[:120]
        assert line.startswith(str(path)), content[:120]

    path = tmp_path / "map.geojson"
    path.write_bytes(b'{"type": "\xff\xfe"}')
    assert "expected UTF-8, byte 10 is none" in refused(path)

    for content in [
        '{"a":' * 200_000,
        '{"type":"LineString","coordinates":' + "[" * 200_000 + "]" * 200_000 + "}",
        *('{"type":"LineString","coordinates":' + "[" * n + "]" * n + "}" for n in range(900, 1000, 7)),
        '{"type":"GeometryCollection","geometries":[' * 50_000 + "]}" * 50_000,
    ]:
        path = tmp_path / "map.geojson"
        path.write_text(content)
        refused(path)

    assert "cannot be read (No such file" in refused(tmp_path / "none.geojson")
    assert "cannot be read" in refused(tmp_path)
    assert not is_vectors(tmp_path / "none.geojson")
    assert not is_vectors(tmp_path)


def test_too_large_geojson_is_refused_before_it_is_parsed(tmp_path) -> None:
    path = tmp_path / "map.geojson"
    with path.open("wb") as stream:
        stream.write(b'{"type":"LineString","coordinates":[')
        stream.write(b"[1,2]," * 10_000_000)
        stream.write(b"[1,2]]}")
    assert "about 1e+07 vertices: expected at most 4 million" in refused(path)
    path.write_bytes(b'{"type":"LineString","coordinates":[' + b"1," * 40_000_000 + b"1]}")
    assert "expected at most 4 million" in refused(path)

    path = tmp_path / "map.geojson"
    with path.open("wb") as stream:
        stream.write(b"{")
        stream.truncate(600 << 20)
    assert "600 MiB: expected at most 512 MiB" in refused(path)


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


@pytest.fixture
def package(tmp_path):
    path = tmp_path / "map.gpkg"
    shapes = shapely.to_wkb(np.array([shapely.box(0, 0, 1000, 500)]))
    pyogrio.raw.write(
        path, shapes, [], [], layer="lakes", driver="GPKG", geometry_type="Polygon", crs="EPSG:25832"
    )
    return path


def sql(path, *statements: str) -> None:
    with sqlite3.connect(path) as connection:
        for statement in statements:
            connection.execute(statement)
    connection.close()


def test_a_geopackage_may_be_called_anything(package) -> None:
    for name in ["a!b.gpkg", "zip:a.gpkg", "b.zip", "x!y.zip", "späť ?#%20.gpkg", "plain"]:
        package = package.rename(package.with_name(name))
        assert sketch_from_vectors(package, size_px=20, layer="lake").sketch.layers["lake"].any(), name
        assert [each.name for each in package.parent.iterdir()] == [name], name


def test_views_of_a_geopackage_are_not_queried(package) -> None:
    whole = package.read_bytes()
    sql(
        package,
        "CREATE VIEW endless AS WITH RECURSIVE n(fid) AS (SELECT 1 UNION ALL SELECT fid + 1 FROM n) "
        "SELECT fid, NULL AS geom FROM n",
        "INSERT INTO gpkg_contents (table_name, data_type, identifier, srs_id) VALUES "
        "('endless', 'features', 'endless', 25832)",
        "INSERT INTO gpkg_geometry_columns VALUES ('endless', 'geom', 'POLYGON', 25832, 0, 0)",
    )
    assert "layer 'endless': expected a table, not a view" in refused(package)

    package.write_bytes(whole)
    sql(package, "ALTER TABLE lakes RENAME TO other", "CREATE VIEW lakes AS SELECT * FROM other")
    assert refused(package)


def test_triggers_are_never_run(package) -> None:
    sql(package, "CREATE TRIGGER bad AFTER INSERT ON lakes BEGIN DELETE FROM lakes; END")
    before = package.read_bytes()
    assert sketch_from_vectors(package, size_px=20).sketch.layers["lake"].any()
    assert package.read_bytes() == before


def test_a_geopackage_of_too_many_vertices_is_refused(package, monkeypatch) -> None:
    monkeypatch.setattr("sketchterrain.trace.geopackage_layers.MOST_VERTICES", 10_000)
    sql(
        package,
        "DROP TRIGGER IF EXISTS rtree_lakes_geom_insert",
        "INSERT INTO lakes (geom) SELECT zeroblob(400000)",
    )
    assert "vertices: expected at most 4 million" in refused(package)


def test_truncated_and_corrupt_geopackages_are_refused(package) -> None:
    content = package.read_bytes()
    for keep in [16, 100, 4096, 0.5, 0.9]:
        package.write_bytes(content[: int(keep if keep > 1 else keep * len(content))])
        refused(package)

    package.write_bytes(content[:100] + np.random.default_rng(1).bytes(len(content) - 100))
    refused(package)

    broken = content.replace(b"TABLE gpkg_ogr_contents", b"TABLX gpkg_ogr_contents")
    package.write_bytes(broken.replace(b"gpkg_ogr_contents", b"gpkg_ogr_con\xf5\xf5\xf5\xf5\xf5"))
    assert "expected a whole GeoPackage" in refused(package)


def test_a_geopackage_without_its_crs_or_of_another_kind_is_refused(package, tmp_path) -> None:
    sql(package, "DELETE FROM gpkg_spatial_ref_sys WHERE srs_id = 25832")
    assert "layer 'lakes': its coordinate reference system 25832 is not in the file" in refused(package)

    path = tmp_path / "another.gpkg"
    sql(path, "CREATE TABLE lakes (geom BLOB)")
    assert "another SQLite database" in refused(path)


def test_shapes_that_cannot_be_read_are_left_out(package) -> None:
    sql(
        package,
        "DROP TRIGGER IF EXISTS rtree_lakes_geom_insert",
        "INSERT INTO lakes (geom) VALUES (x'4750'), (NULL), (x'47500001000000000103')",
    )
    traced = sketch_from_vectors(package, size_px=20)
    assert any("3 without a shape that can be read" in note for note in traced.notes)
