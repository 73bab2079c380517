"""Export plans and tilings, terrains sampled at a grid, features as JSON."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as some

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.export.planning import option_names, plan_export
from sketchterrain.export.sampled import BYTES_PER_VERTEX, SampleGrid, quantise_weights, sample_terrain
from sketchterrain.export.target import ExportOptions, ExportOutput, Target, TileWindow, Tiling
from sketchterrain.export.targets import TARGET_NAMES, target_named
from sketchterrain.export.vectors import write_features
from sketchterrain.landforms.placement.feature_types import FEATURE, FEATURE_TYPES, Lake, ShapeField
from sketchterrain.terrain import rasters as raster_windows
from sketchterrain.terrain.surfaces import TerrainFeatures
from tests.refusals import refused

TILED = frozenset({"tiles", "overlap"})
PLAIN = Target("plain", "Plain", "…", lambda _: ExportOutput({}), options=TILED, tiling=Tiling())
SQUARE = replace(PLAIN, square=True, sizes=(33, 65, 129), size=65)
SPACED = replace(PLAIN, spacing=1.0)
WIDE, HIGH = (
    Sketch(name="A", extent=1024.0, layers={"hill": np.zeros(shape, np.uint8)})
    for shape in ((48, 64), (64, 48))
)


def grid_of(sketch, target, **options):
    return plan_export(sketch, target, ExportOptions(**options)).grid


def test_grids_follow_extent_tiles_and_spacing():
    assert grid_of(WIDE, PLAIN, size=65) == SampleGrid(0.0, 0.0, 1024.0, 768.0, 65, 49)
    assert grid_of(HIGH, PLAIN, size=65) == SampleGrid(0.0, 0.0, 768.0, 1024.0, 49, 65)

    grid = grid_of(WIDE, PLAIN, size=65, tiles=(4, 5))
    assert (grid.columns, grid.rows) == (65, 51)
    assert grid.bounds == (0.0, 0.0, 1024.0, 768.0)

    assert grid_of(WIDE, PLAIN, tiles=(3, 1)).columns == 1024
    assert grid_of(WIDE, PLAIN, tiles=(4, 3)).columns == 1025

    assert grid_of(WIDE, SQUARE) == SampleGrid(0.0, 0.0, 1024.0, 1024.0, 65, 65)
    assert grid_of(HIGH, SQUARE, size=33) == SampleGrid(0.0, 0.0, 1024.0, 1024.0, 33, 33)
    assert grid_of(WIDE, SQUARE, tiles=(4, 4)).columns == 4 * 64 + 1

    assert grid_of(WIDE, SPACED) == SampleGrid(0.0, 0.0, 1024.0, 768.0, 1025, 769)
    odd = WIDE.replace(extent=1000.5)
    grid = grid_of(odd, SPACED, tiles=(4, 1))
    assert grid.spacing == (1.0, 1.0)
    assert grid.columns == 1005
    assert grid.east >= odd.size[0]
    assert grid.north >= odd.size[1]

    regions = replace(SPACED, multiple=256)
    assert grid_of(WIDE, regions) == SampleGrid(0.0, 0.0, 1023.0, 767.0, 1024, 768)
    assert grid_of(WIDE.replace(extent=1025.0), regions).columns == 1280


@given(some.integers(1, 6), some.integers(1, 6), some.sampled_from([WIDE, HIGH]))
def test_square_tiles_cover_the_sketch_with_square_quads(columns, rows, sketch):
    plan = plan_export(sketch, SQUARE, ExportOptions(tiles=(columns, rows)))
    dx, dy = plan.grid.spacing
    assert dx == pytest.approx(dy, rel=1e-12)
    assert plan.tile_side == (65, 65)
    east, north = sketch.size
    assert plan.grid.east >= east
    assert plan.grid.north >= north
    assert plan.grid.east == east or plan.grid.north == north


def test_targets_declare_known_options_and_valid_sizes():
    for name in TARGET_NAMES:
        target = target_named(name)
        assert target.options <= set(vars(ExportOptions())), name
        assert (target.tiling is not None) == ("tiles" in target.options), name
        assert not target.sizes or target.size in target.sizes, name
        assert target.title, name
        assert target.summary, name
        assert ("format" in target.options) == bool(target.formats), name
        for size in target.sizes:
            assert plan_export(WIDE, target, ExportOptions(size=size)).tile_side == (size, size), (name, size)


COUNTS = some.integers(1, 9)


def test_tiles_are_numbered_and_named():
    assert list(Tiling().tiles(33, 17)) == [TileWindow(0, 0, 0, 0, 33, 17)]
    assert Tiling().tile_name("valley", TileWindow(0, 0, 0, 0, 33, 17)) == "valley"

    tiling = Tiling(2, 3)
    tiles = list(tiling.tiles(5, 13))
    assert tiles[:2] == [TileWindow(0, 0, 0, 0, 3, 5), TileWindow(1, 0, 2, 0, 3, 5)]
    assert tiles[-1] == TileWindow(1, 2, 2, 8, 3, 5)
    assert tiling.tile_name("valley", tiles[2]) == "valley_x0_y1"

    tiling = Tiling(2, 2, first=1, from_south=True, pattern="{name}_{y:02}_{x}")
    names = [tiling.tile_name("a", each) for each in tiling.tiles(5, 5)]
    assert names == ["a_02_1", "a_02_2", "a_01_1", "a_01_2"]


@given(COUNTS, COUNTS, some.integers(0, 5), some.integers(1, 9))
def test_tiles_cover_the_grid(columns, rows, overlap, step):
    side = max(step + overlap, 2)
    tiling = Tiling(columns, rows, overlap=overlap)
    width, height = tiling.grid_side(side, columns), tiling.grid_side(side, rows)
    whole = np.arange(width * height).reshape(height, width)
    seen = np.zeros_like(whole)
    for piece in tiling.tiles(width, height):
        assert (piece.columns, piece.rows) == (side, side)
        part = seen[piece.top : piece.top + side, piece.left : piece.left + side]
        assert part.shape == (side, side)
        part += 1
    assert (seen > 0).all()
    if overlap == 0:
        assert (seen == 1).all()


@given(some.integers(2, 200), some.integers(1, 9), some.integers(0, 5))
def test_nearest_sizes_are_valid_and_nearest(vertices, tiles, overlap):
    tiling = Tiling(tiles, tiles, overlap=overlap)
    near = tiling.nearest_sides(vertices, tiles)
    for each in near:
        tiling.tile_side(each, tiles)
    least = min(abs(each - vertices) for each in near)
    for nearer in range(max(vertices - least + 1, 2), vertices + least):
        refused("nearest: ", tiling.tile_side, nearer, tiles)


def test_invalid_patterns_numbers_and_sizes_are_refused():
    for reason, patterns in {
        "expected {x} and {y}": ["{name}", "{name}_{x}"],
        "two tiles would have the same name": ["{x}{y}"],
        "a valid file name": [
            "../{x}_{y}",
            "a\\{x}_{y}",
            ".{x}_{y}",
            "a{x}_{y}:b",
            "a\0{x}_{y}",
            "{x}_{y}" + 200 * "a",
        ],
        "expected only": [
            "{x}_{y}_{z}",
            "{x}_{y}_{}",
            "{x.real}_{y}",
            "{x!r}_{y}",
            "{name:9}_{x}_{y}",
            "{x}_{y:{x}}",
        ],
        "invalid pattern|expected only": ["{x_{y}", "{x}_{y}}"],
    }.items():
        for pattern in patterns:
            refused(reason, Tiling, 12, 12, pattern=pattern)

    for change in [{"columns": 0}, {"rows": -1}, {"overlap": -1}, {"first": -1}, {"columns": 99999}]:
        refused("expected", Tiling, **change)
    with pytest.raises(
        InputError, match=r"^1024 vertices .* 2 equal tiles that share an edge.* 1023 or 1025$"
    ):
        Tiling(2, 2).tiles(1024, 1025)
    refused(r"that share nothing; nearest: 1024 or 1026$", Tiling(2, 2, overlap=0).tiles, 1025, 1024)


NUMBERS = some.none() | some.integers(-2, 10_000)
METRES = some.floats(allow_nan=True, allow_infinity=True)
OPTIONS = some.builds(
    ExportOptions,
    size=NUMBERS,
    tiles=some.tuples(some.integers(-1, 12), some.integers(-1, 12)),
    overlap=NUMBERS,
    tile_name=some.none() | some.text(max_size=30) | some.sampled_from(["{name}_{x}_{y}", "{x:03}{y:03}"]),
    tile_first=NUMBERS,
    tiles_from_south=some.none() | some.booleans(),
    format=some.none() | some.text(max_size=5) | some.sampled_from(["r16", "exr", "png"]),
    heights=some.none() | some.tuples(METRES, METRES),
    error=some.none() | METRES,
    crs=some.none() | some.text(max_size=10),
    origin=some.tuples(METRES, METRES),
    plants=some.booleans(),
    grass=some.booleans(),
)


@pytest.mark.slow
@given(some.sampled_from(TARGET_NAMES), OPTIONS)
def test_arbitrary_options_give_a_plan_or_an_input_error(name, options):
    target = target_named(name)
    supported = {each: getattr(options, each) for each in option_names(target)}
    for requested in (options, ExportOptions(**supported)):
        message = ""
        try:
            plan = plan_export(WIDE, target, requested)
        except InputError as error:
            message = str(error)
        assert message.isprintable()
        if message:
            continue
        side = plan.tile_side
        assert not target.sizes or side[0] == side[1] in target.sizes
        pieces = list(plan.tiling.tiles(plan.grid.columns, plan.grid.rows))
        assert len({plan.tiling.tile_name("a", each).casefold() for each in pieces}) == len(pieces)


def test_samples_of_the_sketch_are_bit_equal_to_the_raster(terrain, raster):
    grid = SampleGrid(0.0, 0.0, *terrain.size, columns=129, rows=97)
    samples = sample_terrain(terrain, grid)
    np.testing.assert_array_equal(samples.height, raster.height)
    np.testing.assert_array_equal(samples.weights, quantise_weights(raster.materials))
    assert np.abs(samples.normal / 127.5 - 1.0 - raster.normal).max() <= 0.5 / 127.5 + 1e-6
    arrays = (samples.height, samples.normal, samples.weights)
    assert sum(each.nbytes for each in arrays) == BYTES_PER_VERTEX * 129 * 97


def test_sampling_in_bands_is_bit_equal(terrain, monkeypatch):
    grid = SampleGrid(-100.0, 50.0, 800.0, 1100.0, columns=150, rows=201)
    whole = sample_terrain(terrain, grid)
    monkeypatch.setattr(raster_windows, "_PATCHES_PER_BAND", 1)
    fractions = []
    banded = sample_terrain(terrain, grid, progress=fractions.append)
    for one, other in zip(vars(whole).values(), vars(banded).values(), strict=True):
        np.testing.assert_array_equal(one, other)
    assert len(fractions) == 4
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


def test_samples_and_windows_are_at_the_grid_positions(terrain):
    grid = SampleGrid(-128.0, -64.0, 896.0, 1216.0, columns=65, rows=81)
    x = np.linspace(grid.west, grid.east, grid.columns)
    y = np.linspace(grid.north, grid.south, grid.rows)
    samples = sample_terrain(terrain, grid)
    np.testing.assert_array_equal(samples.height, terrain.heights(x[None], y[:, None], cell_size=16.0))
    part = samples.window(16, 8, 33, 25)
    assert part.height.base is samples.height
    assert part.grid == SampleGrid(128.0, 704.0, 640.0, 1088.0, columns=33, rows=25)
    np.testing.assert_array_equal(part.height, samples.height[8:33, 16:49])
    np.testing.assert_array_equal(sample_terrain(terrain, part.grid).height, part.height)


COMMON = {"id", "type", "x", "y", "radius", "strength", "painted"}


def test_features_json_is_exact(tmp_path, terrain):
    (path,) = write_features(tmp_path, terrain.features)
    content = json.loads(path.read_text(encoding="utf-8"))
    assert list(content) == ["format", "features", "splines", "lakes"]
    assert content["format"] == 1

    points = terrain.features.points
    assert {"mountain", "forest"} <= {entry["type"] for entry in content["features"]}
    assert [entry["id"] for entry in content["features"]] == points["id"].tolist()
    for entry, point in zip(content["features"], points, strict=True):
        assert entry["type"] == FEATURE_TYPES[point["type"]]
        assert (entry["x"], entry["y"]) == (point["x"], point["y"])
        for name in entry.keys() - {"id", "type", "x", "y", "painted", "conifers"}:
            assert np.float32(entry[name]) == point[name]
        assert entry["painted"] is bool(point["painted"])

    rivers = terrain.features.rivers
    assert len(content["splines"]) == len(rivers) > 0
    for entry, river in zip(content["splines"], rivers, strict=True):
        assert (entry["id"], entry["type"], entry["label"]) == (river.id, "river", river.label)
        np.testing.assert_array_equal(entry["points"], river.points)
        np.testing.assert_array_equal(entry["centreline"], river.centreline)
        assert len(entry["width"]) == len(entry["depth"]) == len(entry["points"])
        assert len(entry["centreline_width"]) == len(entry["centreline_depth"]) == len(entry["centreline"])
        assert (np.diff(np.array(entry["centreline"])[:, 2]) <= 0).all()


def test_features_json_has_columns_by_type_and_lake_outlines(tmp_path):
    points = np.zeros(len(FEATURE_TYPES), FEATURE)
    points["type"] = np.arange(len(points))
    (path,) = write_features(tmp_path, TerrainFeatures(points, ()))
    content = json.loads(path.read_text(encoding="utf-8"))
    own = {entry["type"]: entry.keys() - COMMON for entry in content["features"]}
    assert own == {
        "mountain": {"peakiness", "erosion", "strata"},
        "hill": {"erosion"},
        "dune": {"wavelength", "wind"},
        "forest": {"conifers"},
    }
    assert content["splines"] == []

    point = np.zeros(1, FEATURE)
    point["peakiness"], point["id"] = 0.6, 2**64 - 1
    text = write_features(tmp_path, TerrainFeatures(point, ()))[0].read_text(encoding="utf-8")
    assert '"peakiness": 0.6,' in text
    assert '"id": 18446744073709551615,' in text

    (path,) = write_features(tmp_path, TerrainFeatures(np.zeros(0, FEATURE), ()))
    nothing = {"format": 1, "features": [], "splines": [], "lakes": []}
    assert json.loads(path.read_text(encoding="utf-8")) == nothing

    step = np.arange(-30, 31)
    ring = 60 - np.abs(np.hypot(step, step[:, None]) * 5 - 80)  # an island of 20 m in a lake of 140 m
    lake = Lake(77, 3, ShapeField(350.0, 850.0, 5.0, ring.astype(np.float32)), 12.5, 6.0)
    (path,) = write_features(tmp_path, TerrainFeatures(np.zeros(0, FEATURE), (), (lake,)))
    (entry,) = json.loads(path.read_text(encoding="utf-8"))["lakes"]
    assert (entry["id"], entry["label"], entry["level"], entry["depth"]) == (77, 3, 12.5, 6.0)
    radii = sorted(float(np.hypot(*(np.array(r) - (500, 1000)).T).mean()) for r in entry["outline"])
    np.testing.assert_allclose(radii, [20, 140], atol=0.6)
    assert all(outline[0] == outline[-1] for outline in entry["outline"])
