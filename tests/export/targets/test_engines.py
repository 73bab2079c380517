"""Exports to Unity, Unreal and Godot (Terrain3D), decoded as these programs do."""

import json
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scipy.interpolate import RegularGridInterpolator

import sketchterrain as st
from sketchterrain.export.planning import HeightQuantisation, checked_plan, plan_export
from sketchterrain.export.sampled import SampleGrid
from sketchterrain.export.target import Export, ExportOptions
from sketchterrain.export.targets import godot, target_named, unreal
from sketchterrain.schema.materials import MATERIALS, weight_words
from tests.export.exporting import export
from tests.refusals import refused

ENGINES = {"unity": {"size": 129}, "unreal": {"size": 253}, "godot": {"format": "exr"}}


class Imported(NamedTuple):
    """A landscape in an engine: heights [row, column], m, where they lie in the sketch, and their quantum."""

    height: np.ndarray
    east: np.ndarray
    north: np.ndarray
    step: float


def numbers(path, shape):
    """Return the pixels of an image, or raw 16-bit numbers."""
    if path.suffix in (".r16", ".raw"):
        return np.fromfile(path, "<u2").reshape(shape)
    if path.suffix == ".exr":
        with OpenEXR.File(str(path), separate_channels=True) as file:
            (channel,) = file.channels().values()
            assert channel.name == "R"
            return np.array(channel.pixels)
    with Image.open(path) as image:
        assert image.mode == "I;16"
        return np.asarray(image)


def unity(outcome):
    """ImportRawHeightmap.ReadRaw: heights[y, x] = number · 1/(1 << 16), row by row, y upward from z = 0."""
    content, found = outcome.sidecar["import"], []
    origin, side = outcome.sidecar["axes"]["origin"], content["Resolution"]
    assert {content["Byte Order"], content["Depth"], content["Flip Vertically"]} == {
        "Windows",
        "Bit 16",
        False,
    }
    for tile in content["tiles"]:
        size, place = content["Terrain Size"], tile["Position"]
        height = numbers(outcome.folder / tile["file"], (side, side)) / 65536 * size["Y"] + place["Y"]
        at = np.arange(side) / (side - 1)
        east, north = (
            origin[direction] + place[axis] + at * size[axis]
            for direction, axis in (("east", "X"), ("north", "Z"))
        )
        found.append(Imported(height, east, north, size["Y"] / 65536))
    return found


def unreal_(outcome):
    """Rows go southward; 128 steps from 32768 on are one unit of scale in cm; tiles share an edge."""
    content, axes, found = outcome.sidecar["import"], outcome.sidecar["axes"], []
    side, scale = content["Overall Resolution"]["X"], content["Scale"]
    tiling = outcome.sidecar.get("tiling", {"columns": 1, "rows": 1})
    first = content["Heightmap File"]
    for y in range(tiling["rows"]):
        for x in range(tiling["columns"]):
            path = outcome.folder / first.replace("_x0_", f"_x{x}_")
            if tiling["rows"] > 1:
                path = path.with_name(f"high_corner_height_x{x}_y{y}{path.suffix}")
            down = tiling["rows"] - 1 - y if content.get("Flip Tile Y Coordinate") else y
            local = (numbers(path, (side, side)).astype(np.float64) - 32768.0) / 128.0
            height = (local * scale["Z"] + content["Location"]["Z"]) / 100.0
            across, along = (
                content["Location"][axis] + ((side - 1) * at + np.arange(side)) * scale[axis]
                for axis, at in (("X", x), ("Y", down))
            )
            east, north = axes["origin"]["east"] + across / 100.0, axes["origin"]["north"] - along / 100.0
            found.append(Imported(height, east, north, scale["Z"] / 128.0 / 100.0))
    return found


def godot_(outcome):
    """Terrain3DUtil.load_image: metres, or a share of a range; z grows southward, vertices are 1 m apart."""
    content, origin, found = outcome.sidecar["import"], outcome.sidecar["axes"]["origin"], []
    for tile in content["tiles"]:
        size, ends = content.get("r16_size", {"x": 0, "y": 0}), content.get("r16_range")
        height = numbers(outcome.folder / tile["height_file_name"], (size["y"], size["x"]))
        if ends is not None:
            height = height / 65535.0 * (ends["y"] - ends["x"]) + ends["x"]
        east = origin["east"] + tile["import_position"]["x"] + np.arange(height.shape[1])
        north = origin["north"] - tile["import_position"]["y"] - np.arange(height.shape[0])
        found.append(Imported(height, east, north, outcome.sidecar["heights"].get("metres_per_step", 0.0)))
    return found


IMPORT = {"unity": unity, "unreal": unreal_, "godot": godot_}


def world(axes, vectors, *, places=True):
    """Return places or directions along a program's axes as east, north, up in m."""
    result = np.zeros((len(vectors), 3))
    for axis, values in zip("xyz", np.asarray(vectors, np.float64).T, strict=True):
        number, sign = {"east": (0, 1), "north": (1, 1), "south": (1, -1), "up": (2, 1)}[axes[axis]]
        result[:, number] = sign * values
    if places:
        result = result * {"m": 1.0, "cm": 0.01}[axes["unit"]] + list(axes["origin"].values())
    return result


def bilinear(ground, places):
    order = 1 if ground.north[0] < ground.north[-1] else -1
    plan = RegularGridInterpolator((ground.north[::order], ground.east), ground.height[::order].astype(float))
    low, high = (ground.north.min(), ground.east.min()), (ground.north.max(), ground.east.max())
    return plan(np.clip(places[:, 1::-1], low, high))


QUICK = [
    *(("unity", {"size": size}) for size in (33, 65)),
    *(("unity", {"size": size, "tiles": t}) for size, t in ((129, (2, 2)), (65, (2, 1)), (97, (1, 3)))),
    *(("unreal", {"size": 127, "format": form}) for form in ("png", "r16")),
    ("unreal", {"size": 253, "tiles": (2, 1)}),
    *(("godot", {"format": form}) for form in ("exr", "r16")),
]
LARGE = [
    *(("unity", {"size": size}) for size in (129, 257, 513, 1025)),
    *(("unreal", {"size": size, "format": f}) for size in (253, 505, 1009) for f in ("png", "r16")),
]


@pytest.mark.parametrize("exports", [QUICK, pytest.param(LARGE, marks=pytest.mark.slow)])
def test_engine_heights_match_the_terrain(terrain, exported, exports):
    for target, options in exports:
        outcome = exported(target, plants=False, **options)
        for tile in IMPORT[target](outcome):
            if "size" in options and "tiles" not in options:
                assert tile.height.shape == (options["size"], options["size"])
            random = np.random.default_rng(3)
            row, column = (np.append(random.integers(0, n, 3000), [0, n - 1]) for n in tile.height.shape)
            cell = outcome.sidecar["grid"]["spacing"]["x"]
            true = terrain.heights(tile.east[column], tile.north[row], cell_size=cell)
            off = np.abs(tile.height[row, column] - true).max()
            assert off <= (tile.step / 2 + 1e-4 if tile.step else 0.0), (target, options)


def test_normals_match_slopes(exported):
    for target, options in ENGINES.items():
        outcome = exported(target, **options)
        (tile,) = IMPORT[target](outcome)
        northward, eastward = np.gradient(tile.height, tile.north, tile.east)
        with Image.open(outcome.folder / "high_corner_normal.png") as image:
            normal = np.asarray(image) / 127.5 - 1.0  # images show north at the top
        if tile.north[0] < tile.north[-1]:
            normal = normal[::-1]
        for channel, slope in ((0, eastward), (1, -northward if target == "unreal" else northward)):
            assert np.corrcoef(normal[..., channel].ravel(), -slope.ravel())[0, 1] > 0.9, target
        assert (normal[..., 2] > 0.0).all(), target


def test_tiles_are_bit_equal_to_the_whole_grid(exported):
    flips = [{"tiles_from_south": False}, {"tiles_from_south": True}]
    for target, options in [("unity", {}), ("unreal", flips[0]), ("unreal", flips[1]), ("godot", {})]:
        (whole,) = IMPORT[target](exported(target, **ENGINES[target]))
        cut = exported(target, **ENGINES[target], tiles=(2, 2), plants=target == "unity", **options)
        joined, count = np.full(whole.height.shape, np.nan), 0
        for tile in IMPORT[target](cut):
            at = np.ix_(
                np.abs(whole.north[:, None] - tile.north).argmin(axis=0),
                np.abs(whole.east[:, None] - tile.east).argmin(axis=0),
            )
            known = ~np.isnan(joined[at])
            np.testing.assert_array_equal(joined[at][known], tile.height[known], target)
            joined[at], count = tile.height, count + 1
        assert count == 4, target
        np.testing.assert_array_equal(joined, whole.height, target)


def layers(outcome, kind, at=""):
    """Return weights [row, column, layer] of images whose first row is the north edge."""
    paths = [path for path in outcome.paths(f"{at}.png") if f"_{kind}" in path.name]
    images = [np.asarray(Image.open(path)).astype(int) for path in paths]
    return np.concatenate([image if image.ndim == 3 else image[..., None] for image in images], axis=-1)


def test_weights_sum_to_255_at_the_right_positions(exported):
    for target, kind in (("unity", "splat"), ("unreal", "weight_"), ("godot", "weights")):
        outcome = exported(target, **ENGINES[target])
        found = layers(outcome, kind)
        side = len(IMPORT[target](outcome)[0].height) - (target == "unity")
        count = len(MATERIALS) if target == "unreal" else 4 * weight_words(len(MATERIALS))
        assert found.shape == (side, side, count), target
        assert (found.sum(axis=-1) == 255).all(), target
        content = outcome.sidecar["textures"] if target == "godot" else outcome.sidecar["layers"]
        if target == "unity":
            assert content[7] == {"name": "forest_floor", "file": "splat2", "channel": "alpha"}
        else:
            assert (content["7"] if target == "godot" else content[7]) == "forest_floor"
        wood = found[..., 7] / found[..., 7].sum()
        y, x = np.indices(wood.shape) / (side - 1)
        # Painted in columns 34 … 52 of 64 and rows 40 … 56 from the north.
        assert ((wood * x).sum(), (wood * y).sum()) == pytest.approx((43 / 64, 48 / 64), abs=0.04), target


def test_control_map_has_the_two_heaviest_materials(exported):
    outcome = exported("godot", **ENGINES["godot"])
    (tile,) = outcome.sidecar["import"]["tiles"]
    bits = numbers(outcome.folder / tile["control_file_name"], (0, 0)).view(np.uint32)
    # As Terrain3DUtil unpacks them.
    base, overlay, blend = bits >> 27 & 0x1F, bits >> 22 & 0x1F, bits >> 14 & 0xFF
    assert (bits & 0x3FFF == 0).all()  # no turn, no hole, painted by hand
    weights = layers(outcome, "weights")
    at_base, at_overlay = (
        np.take_along_axis(weights, each[..., None].astype(int), axis=-1)[..., 0] for each in (base, overlay)
    )
    ordered = np.sort(weights, axis=-1)
    np.testing.assert_array_equal(at_base, ordered[..., -1])
    mixed = blend > 0
    np.testing.assert_array_equal(at_overlay[mixed], ordered[..., -2][mixed])
    share = ordered[..., -2] / (ordered[..., -1] + ordered[..., -2])
    assert np.abs(blend / 255.0 - share).max() <= 0.5 / 255.0 + 1e-9


def test_plants_match_the_terrain_in_engine_coordinates(terrain, exported):
    for target, side in (("unreal", 1024.0), ("godot", 1023.0)):
        outcome = exported(target, **ENGINES[target])
        content = json.loads((outcome.folder / "high_corner_plants.json").read_text(encoding="utf-8"))
        rows = dict(zip(content["fields"], np.array(content["plants"]).T, strict=True))
        true = terrain.foliage(0.0, 0.0, side, side)
        np.testing.assert_array_equal(rows["species"], true["species"], target)
        place = world(content["axes"], np.stack([rows[axis] for axis in "xyz"], axis=-1))
        unit = {"m": 1.0, "cm": 0.01}[content["axes"]["unit"]]  # numbers have three decimals
        np.testing.assert_allclose(place[:, :2], np.stack([true["x"], true["y"]], axis=-1), atol=1e-3 * unit)
        (ground,) = IMPORT[target](outcome)
        assert np.abs(place[:, 2] - bilinear(ground, place)).max() <= ground.step / 2 + 2e-3 * unit + 8e-5, (
            target
        )
        # Unreal's yaw is in degrees and clockwise seen from above, Godot's counter-clockwise in radians.
        turn = -np.radians(rows["rotation"]) if target == "unreal" else rows["rotation"]
        np.testing.assert_allclose(np.exp(1j * turn), np.exp(1j * true["rotation"]), atol=1e-4)
        normal = np.stack([rows[f"normal_{axis}"] for axis in "xyz"], axis=-1)
        np.testing.assert_allclose(world(content["axes"], normal, places=False), true["normal"], atol=1e-4)


def test_unity_trees_match_the_terrain(terrain, exported):
    for tiles in [(1, 1), (2, 2)]:
        outcome = exported("unity", size=129, **({"tiles": tiles, "plants": True} if tiles == (2, 2) else {}))
        settings, count = outcome.sidecar["import"], 0
        for tile, ground, bounds in zip(
            settings["tiles"], unity(outcome), outcome.sidecar["tiles"], strict=True
        ):
            name = tile["file"].replace("high_corner", "high_corner_plants").replace(".raw", ".json")
            content = json.loads((outcome.folder / name).read_text(encoding="utf-8"))
            assert content["terrain"] == tile["file"], tiles
            true = terrain.foliage(*(bounds["bounds"][side] for side in ("west", "south", "east", "north")))
            trees = content["instances"]
            assert [content["prototypes"][tree["prototypeIndex"]] for tree in trees] == [
                terrain.species_names[species] for species in true["species"]
            ], tiles
            at = np.array([[tree["position"][axis] for axis in "xzy"] for tree in trees])
            assert ((at >= 0.0) & (at <= 1.0)).all(), tiles
            place = np.stack(
                [tile["Position"][a] + at[:, i] * settings["Terrain Size"][a] for i, a in enumerate("XZY")],
                axis=-1,
            )
            np.testing.assert_allclose(place[:, :2], np.stack([true["x"], true["y"]], axis=-1), atol=1e-5)
            assert np.abs(place[:, 2] - bilinear(ground, place)).max() <= ground.step / 2 + 1e-4, tiles
            assert all(tree["widthScale"] == tree["heightScale"] for tree in trees), tiles
            np.testing.assert_allclose([tree["widthScale"] for tree in trees], true["scale"], atol=1e-3)
            turned = np.array([tree["rotation"] for tree in trees]) + true["rotation"]  # clockwise in Unity
            np.testing.assert_allclose(np.cos(turned), 1.0, atol=1e-6)
            count += len(trees)
        assert count == len(terrain.foliage(0.0, 0.0, 1024.0, 1024.0)) > 1000, tiles


@pytest.mark.slow
def test_grass_has_a_separate_file(corner, tmp_path):
    meadow = replace(corner, extent=48.0)
    terrain = st.build(meadow)
    export(terrain, "unreal", tmp_path, size=127, grass=True)
    for kind, storey in (("plants", "woody"), ("grass", "grass")):
        content = json.loads((tmp_path / f"high_corner_{kind}.json").read_text(encoding="utf-8"))
        true = terrain.foliage(0.0, 0.0, 48.0, 48.0, storey=storey)
        assert [row[0] for row in content["plants"]] == true["species"].tolist()


def test_water_matches_the_terrain_in_engine_coordinates(terrain, exported):
    (river,), (lake,) = terrain.features.rivers, terrain.features.lakes
    for target, options in ENGINES.items():
        outcome = exported(target, **options)
        content = json.loads((outcome.folder / "high_corner_water.json").read_text(encoding="utf-8"))
        (line,), (area,) = content["rivers"], content["lakes"]
        unit = {"m": 1.0, "cm": 0.01}[content["axes"]["unit"]]
        np.testing.assert_allclose(
            world(content["axes"], np.array(line["points"])), river.centreline, atol=1e-3 * unit
        )
        np.testing.assert_allclose(unit * np.array(line["width"]), river.centreline_width, atol=6e-4 * unit)
        outline = world(content["axes"], np.array(area["outline"][0]))
        np.testing.assert_allclose(outline[:, 2], lake.level, atol=1e-3 * unit)
        assert unit * area["level"] == pytest.approx(lake.level, abs=1e-3 * unit), target


def test_unreal_components_and_z_scale_follow_the_guide(corner, exported, tmp_path):
    # Epic's table of recommended sizes: quads a section, components; 2 sections a component.
    sizes = (127, 253, 505, 1009, 2017, 4033, 8129)
    assert sizes == unreal.TARGETS[0].sizes
    for size, quads, components in zip(sizes, [63] * 6 + [127], (1, 2, 4, 8, 16, 32, 32), strict=True):
        plan = checked_plan(corner, "unreal", ExportOptions(size=size, plants=False))
        job = Export(None, "a", plan.options, plan.grid, plan.tiling, None, tmp_path, None)
        settings = unreal._settings(job, HeightQuantisation(-256.0, 512.0))
        assert settings["Section Size"] == f"{quads}x{quads} Quads", size
        assert settings["Sections Per Component"] == "2x2 Sections", size
        assert settings["Number of Components"] == {"X": components, "Y": components}, size
        assert settings["Overall Resolution"] == {"X": size, "Y": size}, size

    content = exported("unreal", size=127, heights=(-100.0, 924.0), plants=False).sidecar["import"]
    assert content["Scale"]["Z"] == 1024.0 * 100.0 / 512.0
    assert content["Location"]["Z"] == 41200.0
    assert content["Scale"]["X"] == content["Scale"]["Y"] == pytest.approx(102400.0 / 126)

    for from_south in [False, True]:
        settings = exported("unreal", size=253, tiles=(2, 2), tiles_from_south=from_south, plants=False)
        settings = settings.sidecar["import"]
        assert settings["Flip Tile Y Coordinate"] is from_south
        assert settings.get("Tile Coordinates Offset") == (None if from_south else {"X": 0, "Y": 0})
    content = exported("unreal", size=254, tiles=(2, 2), overlap=0, plants=False).sidecar
    assert (content["grid"]["columns"], content["tiles"][1]["left"]) == (254, 127)


def test_godot_terrains_have_complete_regions_around_the_origin(corner, exported):
    for side, region, position in [
        (512, 256, -256),
        (1536, 256, -768),
        (8704, 512, -4096),
        (16384, 512, -8192),
    ]:
        grid = SampleGrid(0.0, 0.0, side - 1.0, side - 1.0, side, side)
        assert godot.region_size(grid) == region, side
        assert godot.import_position(grid) == (position, position), side
        assert position % region == side % region == 0, side
        assert max(-position, side + position) <= 16 * region, side

    for extent, tiles, vertices in [(100.0, (1, 1), 512), (1025.5, (1, 1), 1536), (1024.0, (3, 3), 1536)]:
        plan = plan_export(replace(corner, extent=extent), godot.TARGETS[0], ExportOptions(tiles=tiles))
        assert (plan.grid.columns, plan.grid.rows) == (vertices, vertices), (extent, tiles)
        assert plan.grid.spacing == (1.0, 1.0), (extent, tiles)
        assert plan.tile_side[0] % godot.region_size(plan.grid) == 0, (extent, tiles)

    content = exported("godot", format="exr", tiles=(2, 2), plants=False)
    assert not [
        path for path in content.paths(".png") if "height" in path.name
    ]  # Godot reads 8 bits of a PNG
    assert content.sidecar["import"]["region_size"] == 256
    for tile in content.sidecar["import"]["tiles"]:
        assert tile["import_position"]["x"] % 256 == tile["import_position"]["y"] % 256 == 0


def test_invalid_options_are_refused(corner):
    for target, options, message in [
        ("unity", {"size": 1000}, "513 or 1025"),
        ("unity", {"size": 8193}, "4097"),
        ("unity", {"size": 129, "overlap": 0}, "overlap"),
        ("unity", {"size": 130, "tiles": (2, 2)}, "129"),
        ("unreal", {"size": 1024}, "1009 or 2017"),
        ("unreal", {"size": 128}, "127 or 253"),
        ("unreal", {"size": 16257}, "8129"),
        ("unreal", {"size": 505, "format": "raw"}, "png or r16"),
        ("unreal", {"size": 505, "crs": "EPSG:25832"}, "crs"),
        ("godot", {"size": 513}, "1 m apart"),
        ("godot", {"heights": (0.0, 500.0)}, "r16"),
        ("godot", {"format": "png"}, "exr or r16"),
        ("godot", {"overlap": 1}, "overlap"),
        ("raw", {"format": "r32", "heights": (0.0, 1.0)}, "only 16-bit numbers have a range"),
        ("geotiff", {"origin": (np.nan, 0.0)}, "expected two finite numbers, m"),
        ("qgis", {"crs": "EPSG:4326"}, "is in degrees"),
    ]:
        refused(message, checked_plan, corner, target, ExportOptions(**options))
    refused("16384", checked_plan, replace(corner, extent=20000.0), "godot", ExportOptions())
    refused(r"expected one of .* as target, got 'quake'", target_named, "quake")


def same_bytes(*folders):
    first, second = ({path.name: path.read_bytes() for path in folder.iterdir()} for folder in folders)
    assert first.keys() == second.keys()
    assert not [name for name in first if first[name] != second[name]]


@pytest.mark.slow
@pytest.mark.parametrize("target", ["raw", "png16", "exr", "npy", "gltf", "geotiff"])
def test_exports_are_deterministic(terrain, exported, tmp_path, target):
    options = {"size": 65, "crs": "EPSG:25832", "origin": (5e5, 5e6)} if target == "geotiff" else {"size": 65}
    outcome = exported(target, **options)
    export(terrain, target, tmp_path, **options)
    same_bytes(outcome.folder, tmp_path)


def test_bare_terrain_exports_are_deterministic_and_without_plants(corner, tmp_path):
    bare = st.build(replace(corner, extent=64.0, layers={}, labels={}))
    for target, options in (
        ("unity", {"size": 33}),
        ("unreal", {"size": 127, "format": "r16"}),
        ("godot", {}),
    ):
        folders = [tmp_path / f"{target}-{name}" for name in ("one", "two", "none")]
        for folder in folders:
            done = export(bare, target, folder, plants="none" not in folder.name, **options)
        same_bytes(*folders[:2])
        names = {path.name for path in done.files}
        assert not [name for name in names if "plants" in name or "grass.json" in name], target
        content = json.loads((folders[2] / "high_corner_water.json").read_text(encoding="utf-8"))
        assert content["rivers"] == content["lakes"] == [], target
