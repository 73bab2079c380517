"""Exports to Unity, read the way Unity reads them."""

from __future__ import annotations

import json
import struct
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from PIL import Image
from scipy.interpolate import RegularGridInterpolator

from sketchterrain.errors import InputError
from sketchterrain.export.sampled import Sampled
from sketchterrain.export.target import Export, ExportOptions
from sketchterrain.export.targets.unity import TARGETS
from sketchterrain.exporting import plan_of
from sketchterrain.progress import Stages

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import sketchterrain as st

SIZES = TARGETS[0].sizes


def tiles_of(settings: dict[str, Any]) -> list[dict[str, Any]]:
    """Return what is to be typed in for each terrain."""
    return [settings | tile for tile in settings["tiles"]]


def imported(folder: Path, tile: dict[str, Any]) -> np.ndarray:
    """Heights in m, [z, x], as *Import Raw* makes them of a file with what the sidecar says to type in.

    ImportRawHeightmap.ReadRaw: heights[y, x] = number · 1/(1 << 16), numbers row by row, y upward from z = 0.
    """
    count = tile["Resolution"] ** 2
    numbers = struct.unpack(f"<{count}H", (folder / tile["file"]).read_bytes())
    share = np.array(numbers, np.float64).reshape(tile["Resolution"], -1) / (1 << 16)
    return share * tile["Terrain Size"]["Y"] + tile["Position"]["Y"]


def places(sidecar: dict[str, Any], tile: dict[str, Any]) -> tuple[np.ndarray, np.ndarray]:
    """East and north, m of the sketch, of the vertices [z, x] of a terrain that stands where it shall."""
    axes = sidecar["axes"]
    assert (axes["x"], axes["y"], axes["z"], axes["unit"]) == ("east", "up", "north", "m")
    step = np.arange(tile["Resolution"]) / (tile["Resolution"] - 1)
    x = tile["Position"]["X"] + step * tile["Terrain Size"]["X"]
    z = tile["Position"]["Z"] + step * tile["Terrain Size"]["Z"]
    x, z = np.meshgrid(x + axes["origin"]["east"], z + axes["origin"]["north"])
    return x, z


def assert_heights(terrain: st.Terrain, outcome: Any, tile: dict[str, Any]) -> None:
    """A sample of vertices, corners among them, has the terrain's heights within half a step."""
    height = imported(outcome.folder, tile)
    east, north = places(outcome.sidecar, tile)
    chosen = np.random.default_rng(3).integers(0, height.size, 3000)
    chosen[:4] = 0, len(height) - 1, height.size - len(height), height.size - 1
    spacing = tile["Terrain Size"]["X"] / (tile["Resolution"] - 1)
    true = terrain.heights(east.ravel()[chosen], north.ravel()[chosen], cell_size=spacing)
    half = tile["Terrain Size"]["Y"] / 65536 / 2
    assert np.abs(height.ravel()[chosen] - true).max() <= half + 1e-4


@pytest.mark.parametrize(
    "size", [33, 65, *(pytest.param(size, marks=pytest.mark.slow) for size in SIZES if 65 < size <= 1025)]
)
def test_heights_are_those_of_the_terrain_where_unity_puts_them(
    terrain: st.Terrain, exported: Callable[..., Any], size: int
) -> None:
    outcome = exported("unity", size=size, plants=False)
    (tile,) = tiles_of(outcome.sidecar["import"])
    assert tile["Resolution"] == size
    assert (outcome.folder / tile["file"]).stat().st_size == 2 * size * size
    assert_heights(terrain, outcome, tile)


def test_each_tile_stands_where_its_ground_is(terrain: st.Terrain, exported: Callable[..., Any]) -> None:
    for size, tiles in [(129, (2, 2)), (65, (2, 1)), (97, (1, 3))]:
        outcome = exported("unity", size=size, tiles=tiles, plants=size == 129)
        for tile in tiles_of(outcome.sidecar["import"]):
            assert_heights(terrain, outcome, tile)


@pytest.mark.slow
@pytest.mark.parametrize("size", [2049, 4097])
def test_large_sizes_come_back_too(corner: st.Sketch, terrain: st.Terrain, tmp_path: Path, size: int) -> None:
    plan = plan_of(corner, "unity", ExportOptions(size=size, plants=False))
    at = np.linspace(0.0, 1.0, size, dtype=np.float32)
    height = 900.0 * (0.7 * at[None] ** 2 + 0.3 * (1.0 - at[:, None])) - 150.0  # highest in the north-east
    flat = np.broadcast_to(np.uint8([128, 128, 255]), (size, size, 3))
    grass = np.broadcast_to(np.uint8([255, 0, 0, 0]), (size, size, 4))
    sampled = Sampled(plan.grid, height, flat, grass)
    written = plan.target.write(
        Export(terrain, "big", plan.options, plan.grid, plan.tiling, sampled, tmp_path, Stages())
    )
    (tile,) = tiles_of(written.settings)
    numbers = np.fromfile(tmp_path / "big.raw", "<u2").reshape(size, size)
    got = numbers[::-1] / 65536 * tile["Terrain Size"]["Y"] + tile["Position"]["Y"]
    assert np.abs(got - height).max() <= tile["Terrain Size"]["Y"] / 65536 / 2 + 1e-4
    with Image.open(tmp_path / "big_splat1.png") as image:
        assert image.size == (size - 1, size - 1)


def test_import_settings_normals_and_the_mountain_in_the_north_east(exported: Callable[..., Any]) -> None:
    outcome = exported("unity", size=129)
    (tile,) = tiles_of(outcome.sidecar["import"])
    height = imported(outcome.folder, tile)
    z, x = np.unravel_index(height.argmax(), height.shape)
    assert x > 0.7 * 128
    assert z > 0.7 * 128

    outcome = exported("unity", size=129)
    (tile,) = tiles_of(outcome.sidecar["import"])
    up, east = np.gradient(imported(outcome.folder, tile), 8.0)
    with Image.open(outcome.folder / "high_corner_normal.png") as image:
        normal = np.asarray(image)[::-1] / 127.5 - 1.0
    for channel, slope in ((0, east), (1, up)):
        assert np.corrcoef(normal[..., channel].ravel(), -slope.ravel())[0, 1] > 0.9

    told = exported("unity", size=129).sidecar
    assert told["byte_order"] == "little-endian"
    assert told["orientation"]["raw"]["row_0"] == "south"
    assert told["import"]["Byte Order"] == "Windows"
    assert told["import"]["Flip Vertically"] is False
    (tile,) = tiles_of(told["import"])
    assert tile["Terrain Size"] == {"X": 1024.0, "Y": told["heights"]["range"], "Z": 1024.0}
    assert tile["Position"] == {"X": 0.0, "Y": told["heights"]["low"], "Z": 0.0}

    outcome = exported("unity", size=33, heights=(-100.0, 924.0), plants=False)
    (tile,) = tiles_of(outcome.sidecar["import"])
    assert (tile["Position"]["Y"], tile["Terrain Size"]["Y"]) == (-100.0, 1024.0)


def test_tiles_share_edges_with_the_whole_to_the_bit(exported: Callable[..., Any]) -> None:
    whole = exported("unity", size=129)
    outcome = exported("unity", size=129, tiles=(2, 2), plants=True)
    tiles = tiles_of(outcome.sidecar["import"])
    assert {tile["file"] for tile in tiles} == {f"high_corner_{x}_{z}.raw" for x in (0, 1) for z in (0, 1)}
    joined = np.full((129, 129), np.nan)
    for tile in tiles:
        assert tile["Resolution"] == 65
        left, bottom = (round(tile["Position"][axis] / 8.0) for axis in "XZ")
        x, z = tile["file"].removesuffix(".raw").split("_")[-2:]
        assert (left, bottom) == (64 * int(x), 64 * int(z))
        window = joined[bottom : bottom + 65, left : left + 65]
        height = imported(outcome.folder, tile)
        known = ~np.isnan(window)
        np.testing.assert_array_equal(window[known], height[known])
        window[:] = height
    (tile,) = tiles_of(whole.sidecar["import"])
    np.testing.assert_array_equal(joined, imported(whole.folder, tile))

    folder = exported("unity", size=129, tiles=(2, 2), plants=True).folder
    for kind in ("splat1", "splat2"):
        sw, se, nw = (
            np.asarray(Image.open(folder / f"high_corner_{kind}_{at}.png")) for at in ("0_0", "1_0", "0_1")
        )
        np.testing.assert_array_equal(sw[:, -1], se[:, 0])
        np.testing.assert_array_equal(sw[0], nw[-1])  # images show north at the top


def splats(outcome: Any) -> np.ndarray:
    """Weights [z, x, layer] as Unity has an image's pixels: the first row is the lowest."""
    images = []
    for path in outcome.of(".png"):
        if "splat" in path.name:
            with Image.open(path) as image:
                assert image.mode == "RGBA"
                images.append(np.asarray(image)[::-1].astype(int))
    return np.concatenate(images, axis=-1)


def test_weights_sum_to_255_and_lie_where_the_materials_are(exported: Callable[..., Any]) -> None:
    outcome = exported("unity", size=129)
    weights = splats(outcome)
    assert weights.shape == (128, 128, 8)
    assert (weights.sum(axis=-1) == 255).all()
    layers = outcome.sidecar["layers"]
    wood = next(i for i, layer in enumerate(layers) if layer["name"] == "forest_floor")
    assert layers[wood] == {"name": "forest_floor", "file": "splat2", "channel": "alpha"}
    z, x = np.indices((128, 128)) / 127.0
    share = weights[..., wood] / weights[..., wood].sum()
    # Painted in columns 34 … 52 of 64 and rows 40 … 56 from the north.
    assert (share * x).sum() == pytest.approx(43 / 64, abs=0.04)
    assert (share * z).sum() == pytest.approx(1 - 48 / 64, abs=0.04)


def test_trees_are_the_terrains_and_stand_on_unitys_ground(
    terrain: st.Terrain, exported: Callable[..., Any]
) -> None:
    for tiles in [(1, 1), (2, 2)]:
        outcome = exported("unity", size=129, tiles=tiles, plants=True)
        count = 0
        for tile, bounds in zip(tiles_of(outcome.sidecar["import"]), outcome.sidecar["tiles"], strict=True):
            name = tile["file"].replace("high_corner", "high_corner_plants").replace(".raw", ".json")
            told = json.loads((outcome.folder / name).read_text(encoding="utf-8"))
            assert told["terrain"] == tile["file"], tiles
            true = terrain.foliage(*(bounds["bounds"][side] for side in ("west", "south", "east", "north")))
            trees = told["instances"]
            assert [told["prototypes"][tree["prototypeIndex"]] for tree in trees] == [
                terrain.species_names[species] for species in true["species"]
            ], tiles
            at = np.array([[tree["position"][axis] for axis in "xyz"] for tree in trees])
            assert ((at >= 0.0) & (at <= 1.0)).all(), tiles
            x, y, z = (
                tile["Position"][axis] + at[:, i] * tile["Terrain Size"][axis] for i, axis in enumerate("XYZ")
            )
            np.testing.assert_allclose(x, true["x"], atol=1e-5)
            np.testing.assert_allclose(z, true["y"], atol=1e-5)
            ground = RegularGridInterpolator((range(tile["Resolution"]),) * 2, imported(outcome.folder, tile))
            stands = ground(at[:, [2, 0]] * (tile["Resolution"] - 1))
            assert np.abs(y - stands).max() <= tile["Terrain Size"]["Y"] / 65536 / 2 + 1e-4, tiles
            assert [tree["widthScale"] for tree in trees] == [tree["heightScale"] for tree in trees], tiles
            np.testing.assert_allclose([tree["widthScale"] for tree in trees], true["scale"], atol=1e-3)
            # Counter-clockwise here, clockwise in Unity.
            turned = np.array([tree["rotation"] for tree in trees]) + true["rotation"]
            np.testing.assert_allclose(np.cos(turned), 1.0, atol=1e-6)
            count += len(trees)
        assert count == len(terrain.foliage(0.0, 0.0, 1024.0, 1024.0)) > 1000, tiles


def test_the_river_runs_from_north_to_south_in_unitys_metres(
    terrain: st.Terrain, exported: Callable[..., Any]
) -> None:
    outcome = exported("unity", size=129)
    water = json.loads((outcome.folder / "high_corner_water.json").read_text(encoding="utf-8"))
    (river,), (lake,) = water["rivers"], water["lakes"]
    points = np.array(river["points"])
    assert points[0, 2] > 700.0 > 300.0 > points[-1, 2]
    assert (points[:, 0] < 300.0).all()
    assert (np.diff(points[:, 1]) <= 0.0).all()
    centreline = terrain.features.rivers[0].centreline
    np.testing.assert_allclose(points, centreline[:, [0, 2, 1]], atol=1e-3)
    outline = np.array(lake["outline"][0])
    assert np.ptp(outline[:, 1]) == 0.0
    assert outline[0, 1] == lake["level"]
    assert (outline[:, 2] < 300.0).all()


def test_options_that_unity_cannot_import_are_refused(corner: st.Sketch) -> None:
    for options, says in [
        ({"size": 1000}, "513 or 1025"),
        ({"size": 8193}, "4097"),
        ({"size": 129, "overlap": 0}, "overlap"),
        ({"size": 130, "tiles": (2, 2)}, "129"),
    ]:
        with pytest.raises(InputError, match=says):
            plan_of(corner, "unity", ExportOptions(**options))
