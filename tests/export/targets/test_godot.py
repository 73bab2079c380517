"""Exports to Godot, read the way Terrain3D's importer reads them."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import OpenEXR
import pytest
from PIL import Image
from scipy.interpolate import RegularGridInterpolator

from sketchterrain.errors import InputError
from sketchterrain.export.planning import plan
from sketchterrain.export.sampled import Grid
from sketchterrain.export.target import ExportOptions
from sketchterrain.export.targets.godot import TARGETS, import_position, region_size
from sketchterrain.exporting import plan_of

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    import sketchterrain as st


def red(path: Path) -> np.ndarray:
    """Return the one channel of an EXR image."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        (channel,) = file.channels().values()
        assert channel.name == "R"
        return np.array(channel.pixels)


def imported(outcome: Any, tile: dict[str, Any]) -> np.ndarray:
    """Heights in m, [z, x], as Terrain3DUtil.load_image makes them of a file."""
    path = outcome.folder / tile["height_file_name"]
    if path.suffix == ".exr":
        height = red(path)
        assert height.dtype == np.float32
        return height
    size, low_high = (outcome.sidecar["import"][key] for key in ("r16_size", "r16_range"))
    share = np.fromfile(path, "<u2").reshape(size["y"], size["x"]) / 65535.0
    return share * (low_high["y"] - low_high["x"]) + low_high["x"]


def quantum(outcome: Any) -> float:
    return outcome.sidecar["heights"].get("metres_per_step", 0.0)


def assert_heights(terrain: st.Terrain, outcome: Any, tile: dict[str, Any]) -> None:
    """A sample of vertices, corners among them, has the terrain's heights, 1 m apart from the position on."""
    height, axes = imported(outcome, tile), outcome.sidecar["axes"]
    assert (axes["x"], axes["y"], axes["z"], axes["unit"]) == ("east", "up", "south", "m")
    random = np.random.default_rng(3)
    row, column = (np.append(random.integers(0, side, 3000), [0, side - 1]) for side in height.shape)
    x = tile["import_position"]["x"] + column
    z = tile["import_position"]["y"] + row
    true = terrain.heights(axes["origin"]["east"] + x, axes["origin"]["north"] - z, cell_size=1.0)
    assert np.abs(height[row, column] - true).max() <= quantum(outcome) / 2.0 + 1e-4


@pytest.mark.parametrize("form", ["exr", "r16"])
def test_heights_are_those_of_the_terrain_where_terrain3d_puts_them(
    terrain: st.Terrain, exported: Callable[..., Any], form: str
) -> None:
    outcome = exported("godot", format=form, plants=form == "exr")
    (tile,) = outcome.sidecar["import"]["tiles"]
    assert imported(outcome, tile).shape == (1024, 1024)  # whole regions: none is begun and left flat
    assert outcome.sidecar["import"]["region_size"] == 256
    assert tile["import_position"] == {"x": -512, "y": -512}
    assert_heights(terrain, outcome, tile)


def test_exr_heights_are_the_terrains_own_floats_with_the_mountain_in_the_north_east(
    terrain: st.Terrain, exported: Callable[..., Any]
) -> None:
    outcome = exported("godot", format="exr", plants=True)
    (tile,) = outcome.sidecar["import"]["tiles"]
    bounds = outcome.sidecar["grid"]["bounds"]
    area = (bounds[side] for side in ("west", "south", "east", "north"))
    bands = terrain.grid(*area, columns=1024, rows=1024)
    np.testing.assert_array_equal(imported(outcome, tile), np.concatenate([band.height for band in bands]))

    outcome = exported("godot", format="exr", plants=True)
    (tile,) = outcome.sidecar["import"]["tiles"]
    row, column = np.unravel_index(imported(outcome, tile).argmax(), (1024, 1024))
    assert row < 300  # z grows southward
    assert column > 700

    for outcome in (
        exported("godot", format="exr", plants=True),
        exported("godot", format="r16", plants=False),
    ):
        assert not [path for path in outcome.of(".png") if "height" in path.name]


def test_tiles_are_whole_regions_side_by_side(exported: Callable[..., Any]) -> None:
    whole = exported("godot", format="exr", plants=True)
    outcome = exported("godot", format="exr", tiles=(2, 2), plants=False)
    joined = np.full((1024, 1024), np.nan, np.float32)
    for tile in outcome.sidecar["import"]["tiles"]:
        left, top = (tile["import_position"][axis] + 512 for axis in "xy")
        assert left % 256 == top % 256 == 0
        height = imported(outcome, tile)
        assert np.isnan(joined[top : top + 512, left : left + 512]).all()
        joined[top : top + 512, left : left + 512] = height
    (tile,) = whole.sidecar["import"]["tiles"]
    np.testing.assert_array_equal(joined, imported(whole, tile))


def test_the_control_map_has_the_two_heaviest_materials(exported: Callable[..., Any]) -> None:
    outcome = exported("godot", format="exr", plants=True)
    (tile,) = outcome.sidecar["import"]["tiles"]
    bits = red(outcome.folder / tile["control_file_name"]).view(np.uint32)
    # As Terrain3DUtil unpacks them.
    base, overlay, blend = bits >> 27 & 0x1F, bits >> 22 & 0x1F, bits >> 14 & 0xFF
    assert (bits & 0x3FFF == 0).all()  # no turn, no hole, painted by hand
    images = [Image.open(outcome.folder / f"high_corner_weights{number}.png") for number in (1, 2)]
    weights = np.concatenate([np.asarray(image) for image in images], axis=-1).astype(int)
    assert (weights.sum(axis=-1) == 255).all()
    at_base = np.take_along_axis(weights, base[..., None].astype(int), axis=-1)[..., 0]
    at_overlay = np.take_along_axis(weights, overlay[..., None].astype(int), axis=-1)[..., 0]
    ordered = np.sort(weights, axis=-1)
    np.testing.assert_array_equal(at_base, ordered[..., -1])
    mixed = blend > 0
    np.testing.assert_array_equal(at_overlay[mixed], ordered[..., -2][mixed])
    share = ordered[..., -2] / (ordered[..., -1] + ordered[..., -2])
    assert np.abs(blend / 255.0 - share).max() <= 0.5 / 255.0 + 1e-9
    textures = outcome.sidecar["textures"]
    wood = np.isin(base, [int(key) for key, name in textures.items() if name == "forest_floor"])
    rows, columns = np.nonzero(wood)
    # Painted in columns 34 … 52 of 64 and rows 40 … 56 from the north.
    assert columns.mean() / 1024 == pytest.approx(43 / 64, abs=0.04)
    assert rows.mean() / 1024 == pytest.approx(48 / 64, abs=0.04)


def test_plants_are_the_terrains_and_stand_on_the_ground(
    terrain: st.Terrain, exported: Callable[..., Any]
) -> None:
    outcome = exported("godot", format="exr", plants=True)
    (tile,) = outcome.sidecar["import"]["tiles"]
    told = json.loads((outcome.folder / "high_corner_plants.json").read_text(encoding="utf-8"))
    rows = dict(zip(told["fields"], np.array(told["plants"]).T, strict=True))
    true = terrain.foliage(0.0, 0.0, 1023.0, 1023.0)
    np.testing.assert_array_equal(rows["species"], true["species"])
    np.testing.assert_allclose(rows["x"], true["x"] - 512.0, atol=1e-3)
    np.testing.assert_allclose(rows["z"], 511.0 - true["y"], atol=1e-3)
    ground = RegularGridInterpolator((range(1024), range(1024)), imported(outcome, tile).astype(float))
    place = np.stack([rows["z"], rows["x"]], axis=-1) + 512.0
    assert np.abs(rows["y"] - ground(np.clip(place, 0.0, 1023.0))).max() < 2e-3
    # Godot turns counter-clockwise seen from above, as the terrain does.
    np.testing.assert_allclose(np.cos(rows["rotation"] - true["rotation"]), 1.0, atol=1e-6)
    np.testing.assert_allclose(rows["normal_z"], -true["normal"][:, 1], atol=1e-4)
    np.testing.assert_allclose(rows["normal_y"], true["normal"][:, 2], atol=1e-4)


def test_the_river_runs_southward(terrain: st.Terrain, exported: Callable[..., Any]) -> None:
    outcome = exported("godot", format="exr", plants=True)
    water = json.loads((outcome.folder / "high_corner_water.json").read_text(encoding="utf-8"))
    points, true = np.array(water["rivers"][0]["points"]), terrain.features.rivers[0].centreline
    np.testing.assert_allclose(points[:, 0], true[:, 0] - 512.0, atol=1e-3)
    np.testing.assert_allclose(points[:, 1], true[:, 2], atol=1e-3)
    np.testing.assert_allclose(points[:, 2], 511.0 - true[:, 1], atol=1e-3)


def test_the_terrain_fills_whole_regions_around_the_origin(corner: st.Sketch) -> None:
    for side, region, position in [
        (512, 256, -256),
        (1024, 256, -512),
        (1536, 256, -768),
        (8192, 256, -4096),
        (8704, 512, -4096),
        (16384, 512, -8192),
    ]:
        grid = Grid(0.0, 0.0, side - 1.0, side - 1.0, side, side)
        assert region_size(grid) == region, side
        assert import_position(grid) == (position, position), side
        assert position % region == side % region == 0, side
        assert max(-position, side + position) <= 16 * region, side

    for extent, tiles, vertices in [
        (100.0, (1, 1), 512),
        (1024.0, (1, 1), 1024),
        (1025.5, (1, 1), 1536),
        (1024.0, (3, 3), 1536),
        (9000.0, (2, 2), 9216),
    ]:
        sketch = replace(corner, extent=extent)
        made = plan(sketch, TARGETS[0], ExportOptions(tiles=tiles))
        assert (made.grid.columns, made.grid.rows) == (vertices, vertices), (extent, tiles)
        assert made.grid.spacing == (1.0, 1.0), (extent, tiles)
        assert made.tile_side[0] % region_size(made.grid) == 0, (extent, tiles)


def test_options_that_terrain3d_cannot_import_are_refused(corner: st.Sketch) -> None:
    for extent, options, says in [
        (1024.0, {"size": 513}, "1 m apart"),
        (1024.0, {"heights": (0.0, 500.0)}, "r16"),
        (1024.0, {"format": "png"}, "exr or r16"),
        (1024.0, {"overlap": 1}, "overlap"),
        (20000.0, {}, "16384"),
    ]:
        with pytest.raises(InputError, match=says):
            plan_of(replace(corner, extent=extent), "godot", ExportOptions(**options))
