"""The GIS target, read back by GDAL: positions, orientation and file layout."""

import numpy as np
import pyogrio
import pytest
import rasterio
import shapely
import tifffile
from scipy import ndimage

import sketchterrain as st
from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.export.planning import checked_plan
from sketchterrain.export.target import ExportOptions
from sketchterrain.export.vectors import ExportLayer, Origin, geopackage, lake_layer
from sketchterrain.features.table import FeatureTable as Drawn
from sketchterrain.importing.vectors import sketch_from_vectors
from sketchterrain.landforms.placement.feature_types import Lake, ShapeField
from tests.export.exporting import export

EAST, NORTH = 512_000.0, 5_403_000.0
PLACED = {"crs": "EPSG:25832", "origin": (EAST, NORTH)}


@pytest.fixture(scope="module")
def outcome(exported):
    return exported("geotiff", size=513, **PLACED)


def raster(outcome, what):
    (path,) = outcome.paths(f"_{what}.tif")
    return path


def world(file):
    """Return where a reader thinks that the middles of the pixels lie, less the origin."""
    rows, columns = np.indices(file.shape)
    x, y = rasterio.transform.xy(file.transform, rows.ravel(), columns.ravel())
    return np.reshape(x, file.shape) - EAST, np.reshape(y, file.shape) - NORTH


def layer(outcome, name):
    (path,) = outcome.paths(".gpkg")
    meta, _, geometry, fields = pyogrio.raw.read(path, layer=name)
    return meta, shapely.from_wkb(geometry), dict(zip(meta["fields"], fields, strict=True))


def test_gdal_reads_heights_at_their_positions_with_and_without_crs(outcome, terrain, exported):
    with rasterio.open(raster(outcome, "height")) as file:
        height = file.read(1)
        x, y = world(file)
        assert file.crs.to_epsg() == 25832
        assert file.tags()["AREA_OR_POINT"] == "Point"
        assert file.nodata == -9999.0
        assert (file.dtypes, file.descriptions, file.units) == (("float32",), ("height",), ("m",))
        assert tuple(file.bounds) == (EAST - 1, NORTH - 1, EAST + 1025, NORTH + 1025)  # half a spacing more
    np.testing.assert_array_equal(height, terrain.heights(x, y, cell_size=2.0))

    local = exported("geotiff", size=65, plants=False)
    with rasterio.open(raster(local, "height")) as file:
        assert 'UNIT["metre",1' in file.crs.to_wkt()
        assert file.crs.to_epsg() is None
        assert file.xy(0, 0) == (0.0, 1024.0)
        np.testing.assert_array_equal(
            file.read(1)[0], terrain.heights(np.arange(65) * 16.0, 1024.0, cell_size=16.0)
        )
    assert local.sidecar["target"] == "geotiff"
    _, lakes, _ = layer(local, "lakes")
    assert shapely.contains_xy(lakes[0], 10 * 16.0, 10 * 16.0)


def test_files_are_cloud_optimised_with_averaged_overviews(outcome):
    """As GDAL's validate_cloud_optimized_geotiff.py wants it, but read without GDAL."""
    for what in ["height", "normal", "materials"]:
        path = raster(outcome, what)
        assert b"LAYOUT=IFDS_BEFORE_DATA" in path.read_bytes()[:400], what
        with tifffile.TiffFile(path) as file:
            assert [page.imagewidth for page in file.pages] == [513, 256], what
            assert all(page.tilewidth == page.tilelength == 256 for page in file.pages), what
            # The coarsest comes first after all directories, the finest last.
            first = [min(offset for offset in page.dataoffsets if offset) for page in file.pages]
            assert max(page.offset for page in file.pages) < min(first), what
        assert first == sorted(first, reverse=True), what
        assert path.stat().st_size > max(first), what

    with rasterio.open(raster(outcome, "height")) as file:
        height = file.read(1).astype(np.float64)
        assert file.overviews(1) == [2]
    with rasterio.open(raster(outcome, "height"), overview_level=0) as coarse:
        overview = coarse.read(1)
    assert overview.shape == (256, 256)
    # Exactly 513/256 pixels a pixel: the mean with the shares of those that are cut.
    edges = np.linspace(0.0, 513.0, 257)
    share = np.clip(
        np.minimum(edges[1:, None], np.arange(1, 514)) - np.maximum(edges[:-1, None], np.arange(513)), 0, 1
    )
    share /= share.sum(axis=1, keepdims=True)
    np.testing.assert_allclose(overview, share @ height @ share.T, atol=1e-3)


def test_normals_and_weights_have_named_bands(outcome, terrain):
    with rasterio.open(raster(outcome, "normal")) as file:
        assert file.descriptions == ("east", "north", "up")
        normal = file.read().astype(np.float64) / 127.5 - 1.0
    with rasterio.open(raster(outcome, "height")) as file:
        height = file.read(1).astype(np.float64)
    north, east = np.gradient(height, 2.0)
    slope = np.stack([-east, north, np.ones_like(east)])
    slope /= np.linalg.norm(slope, axis=0)
    cosine = (normal * slope).sum(axis=0) / np.linalg.norm(normal, axis=0)
    assert np.median(np.degrees(np.arccos(np.clip(cosine, -1, 1)))) < 1.0
    with rasterio.open(raster(outcome, "materials")) as file:
        assert file.descriptions == terrain.material_names
        assert np.all(file.read().sum(axis=0, dtype=int) == 255)


def test_rivers_and_lakes_match_the_terrain(outcome, terrain):
    meta, (line,), fields = layer(outcome, "rivers")
    assert meta["geometry_type"] == "LineString Z"
    assert rasterio.crs.CRS.from_user_input(meta["crs"]).to_epsg() == 25832
    (river,) = terrain.features.rivers
    places = shapely.get_coordinates(line, include_z=True) - (EAST, NORTH, 0.0)
    np.testing.assert_allclose(places, river.centreline, atol=1e-6)
    assert places[0, 1] > 900 > 300 > places[-1, 1]
    assert places[:, 0].max() < 300
    assert np.all(np.diff(places[:, 2]) <= 0)
    assert fields["id"].tolist() == [str(river.id)]
    assert fields["length"][0] == pytest.approx(line.length)
    assert fields["width_mouth"][0] == river.centreline_width[-1]
    assert river.centreline_depth.min() <= fields["depth"][0] <= river.centreline_depth.max()
    _, stations, along = layer(outcome, "river_stations")
    assert len(stations) == len(places)
    np.testing.assert_array_equal(along["width"], river.centreline_width)
    assert along["distance"][-1] == pytest.approx(line.length)

    _, (area,), fields = layer(outcome, "lakes")
    (lake,) = terrain.features.lakes
    assert fields["level"].tolist() == [lake.level]
    assert shapely.get_coordinates(area, include_z=True)[0, 2] == pytest.approx(lake.level)
    west, south, east, north = area.bounds
    assert (west - EAST, south - NORTH, east - EAST, north - NORTH) == pytest.approx(
        (4 * 16, 6 * 16, 16 * 16, 14 * 16), abs=24
    )


def test_lake_areas_have_islands_and_ponds():
    away = np.hypot(*(np.indices((41, 41)) - 20.0))
    inside = np.where(away < 4, 3.0 - away, np.minimum(away - 8.0, 17.0 - away)).astype(np.float32)
    field = ShapeField(west=100.0, south=200.0, spacing=2.0, inside=inside)
    layer_ = lake_layer([Lake(7, 1, field, 12.5, 3.0)], Origin(1000.0, 2000.0))
    (area,) = layer_.geometry
    assert area.is_valid
    assert [len(part.interiors) for part in sorted(area.geoms, key=lambda part: -part.area)] == [1, 0]
    assert area.area == pytest.approx(4 * np.pi * (17**2 - 8**2 + 3**2), rel=0.02)
    assert (area.centroid.x, area.centroid.y) == pytest.approx((1140.0, 2240.0), abs=0.1)


def test_features_and_plants_are_points_with_a_spatial_index(outcome, terrain):
    _, points, fields = layer(outcome, "features")
    placed = terrain.features.points
    assert fields["id"].tolist() == [str(each) for each in placed["id"]]
    assert set(fields["type"]) <= {"mountain", "hill", "dune", "forest"}
    highest = fields["strength"] == fields["strength"][fields["type"] == "mountain"].max()
    assert shapely.get_x(points[highest])[0] - EAST > 700 < shapely.get_y(points[highest])[0] - NORTH
    _, trees, woods = layer(outcome, "plants")
    plants = terrain.foliage(0, 0, 1024, 1024)
    assert len(trees) == len(plants) > 100
    assert outcome.sidecar["layers"]["plants"] == len(plants)
    places = shapely.get_coordinates(trees, include_z=True) - (EAST, NORTH, 0.0)
    np.testing.assert_allclose(places, np.stack([plants[axis] for axis in "xyz"], axis=-1), atol=1e-6)
    assert woods["species"].tolist() == [terrain.species_names[each] for each in plants["species"]]
    np.testing.assert_allclose(np.radians(woods["rotation"]), plants["rotation"], atol=1e-5)

    (path,) = outcome.paths(".gpkg")
    box = (EAST + 500, NORTH + 100, EAST + 700, NORTH + 300)
    info = pyogrio.raw.read(path, layer="plants", bbox=box)[2]
    assert len(info) == len(terrain.foliage(500, 100, 700, 300)) > 0


@pytest.fixture(scope="module")
def lawn():
    """Too small for anything but grass."""
    return st.Sketch(
        name="Lawn", extent=24.0, ground={"relief": 0.0}, layers={"hill": np.zeros((8, 8), np.uint8)}
    )


def test_empty_layers_are_written_and_files_are_deterministic(lawn, tmp_path):
    terrain = st.build(lawn)
    done = export(terrain, "geotiff", tmp_path, size=9, grass=True)
    for again in export(terrain, "geotiff", tmp_path / "again", size=9, grass=True).files:
        assert again.read_bytes() == (tmp_path / again.name).read_bytes(), again.name
    assert pyogrio.get_gdal_config_option("OGR_CURRENT_DATE") is None  # the clock runs on for others
    path = tmp_path / "lawn.gpkg"
    *names, styles = [str(name) for name, _ in pyogrio.list_layers(path)]
    assert styles == "layer_styles"
    assert names == ["lakes", "rivers", "river_stations", "features", "plants", "grass"]
    counts = [pyogrio.read_info(path, layer=name)["features"] for name in names]
    grass = len(terrain.foliage(0, 0, 24, 24, storey="grass"))
    assert counts == [0, 0, 0, len(terrain.features.points), len(terrain.foliage(0, 0, 24, 24)), grass]
    assert list(done.report["layers"].values()) == counts
    assert grass > 0


def test_invalid_reference_systems_are_refused(corner, capfd):
    for crs, message in [
        ("", "'' is not a coordinate"),
        ("EPSG:999999", "is not a coordinate"),
        ("https://example.com/x", "is not a coordinate"),
        ("a\nb" * 9999, "is not a coordinate"),
        ("EPSG:4326", "is in degrees"),
        ("EPSG:2263", "unit US survey foot"),
        ("EPSG:4978", "is not projected"),
        ("EPSG:2048", "has a westward axis"),
    ]:
        with pytest.raises(InputError, match=message) as refused:
            checked_plan(corner, "geotiff", ExportOptions(crs=crs))
        assert "\n" not in str(refused.value), crs
        assert len(str(refused.value)) < 220, crs
        assert capfd.readouterr().err == "", crs  # no output of GDAL


def test_folder_names_are_not_interpreted(tmp_path):
    layer = ExportLayer("plants", "Point", shapely.points([[1.0, 2.0]]), {"number": np.arange(1)})
    for name in ["a!b.zip", "zip:c", "späť 'x\" ?#%20"]:
        path = tmp_path / name / "plants.gpkg"
        path.parent.mkdir()
        with geopackage(path, "EPSG:25832") as file:
            file.add(layer)
            file.add(layer._replace(name="more"))
            file.add(layer)
        assert [each.name for each in path.parent.iterdir()] == ["plants.gpkg"], name
        assert [each.name for each in tmp_path.iterdir()] == [name], name
        moved = path.rename(tmp_path / "plants.gpkg")
        assert pyogrio.read_info(moved, layer="plants")["features"] == 2, name
        moved.unlink()
        path.parent.rmdir()


def test_full_disk_is_reported_for_incomplete_geopackages(tmp_path, files_no_larger_than):
    points = shapely.points(np.random.default_rng(3).random((5000, 2)))
    layer = ExportLayer("plants", "Point", points, {"number": np.arange(5000)})
    whole = tmp_path / "whole.gpkg"
    with geopackage(whole, "EPSG:25832") as file:
        file.add(layer)
    for share in [0.1, 0.5, 0.8, 0.97]:
        limit = int(whole.stat().st_size * share)
        with (
            files_no_larger_than(limit),
            pytest.raises(SketchterrainError, match=r"cut\.gpkg: cannot be written") as message,
            geopackage(tmp_path / "cut.gpkg", "EPSG:25832") as file,
        ):
            file.add(layer)
        assert "\n" not in str(message.value), share


def test_geopackage_traces_back_to_the_sketch(outcome, corner):
    (path,) = outcome.paths(".gpkg")
    bounds = (EAST, NORTH, EAST + 1024, NORTH + 1024)
    traced = sketch_from_vectors(path, bounds=bounds, size_px=64).sketch
    assert traced.extent == corner.extent
    for layer_name, off in (("forest", 4), ("mountain", 6)):
        was, now = corner.layers[layer_name] > 0, traced.layers[layer_name] > 0
        near = ndimage.distance_transform_edt(~was)[now]
        assert near.max() <= off, layer_name
    (river,), (lake,) = traced.vectors["river"].shapes(), traced.vectors["lake"].shapes()
    painted = {}
    for layer_name in ("river", "lake"):
        rows, columns = np.nonzero(corner.layers[layer_name])
        pixels = shapely.box(16 * columns, 1024 - 16 * rows - 16, 16 * columns + 16, 1024 - 16 * rows)
        painted[layer_name] = shapely.union_all(pixels)
    assert painted["river"].buffer(16).covers(river & shapely.box(0, 256, 1024, 1024))
    assert river.length > 45 * 16
    assert (lake & painted["lake"]).area / (lake | painted["lake"]).area > 0.8


def test_vectors_are_exported_as_drawn(corner, tmp_path):
    lines = [shapely.LineString([(100, 100), (200.5, 300.25), (900, 100)]), shapely.box(0, 0, 50, 20)]
    hole = shapely.box(500, 500, 900, 800) - shapely.box(600, 600, 700, 700)
    names = {"name": ("Inn", ""), "FID": np.array([7.5, np.nan]), "Geom": ("a", "b"), "ID": ("c", "d")}
    columns = {"width": np.array([np.nan, 4.0]), "directed": np.array([1, 0]), **names}
    river = Drawn.from_shapes("river", np.array(lines), ids=[5, 3], labels=[1, 2], columns=columns)
    lake = Drawn.from_shapes("lake", np.array([hole]))
    sketch = st.Sketch(
        extent=1024.0,
        layers={"hill": np.zeros((8, 8), np.uint8)},
        vectors={"river": river, "lake": lake},
        frame={"crs": "EPSG:25832", "east": EAST, "north": NORTH},
    )
    done = export(st.build(sketch), "geotiff", tmp_path, size=9, plants=False)
    path = next(each for each in done.files if each.suffix == ".gpkg")
    found = {}
    for name in ("sketch_river", "sketch_lake"):
        meta, _, geometry, fields = pyogrio.raw.read(path, layer=name)
        assert pyogrio.read_info(path, layer=name)["crs"] == "EPSG:25832"
        found[name] = shapely.from_wkb(geometry), dict(zip(meta["fields"], fields, strict=True))
        assert done.report["layers"][name] == len(geometry)
    shapes, values = found["sketch_river"]
    moved = shapely.transform(np.array(lines), lambda at: np.add(at, (EAST, NORTH)))
    assert shapely.equals(shapes, moved).all()
    assert shapely.get_coordinates(shapes[0]).tolist() == shapely.get_coordinates(moved[0]).tolist()
    assert values["id"].tolist() == [5, 3]
    assert values["label"].tolist() == [1, 2]
    assert np.isnan(values["width"][0])
    assert values["width"][1] == 4.0
    assert values["directed"].tolist() == [1, 0]
    assert [values[key].tolist()[0] for key in ("name", "FID_", "Geom_", "ID_")] == ["Inn", 7.5, "a", "c"]
    (area,), _ = found["sketch_lake"]
    assert area.equals(shapely.transform(hole, lambda at: np.add(at, (EAST, NORTH))))
