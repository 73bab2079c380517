"""Exports to Unreal Engine, read the way its landscapes read them."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
import rasterio
from PIL import Image
from rasterio.errors import NotGeoreferencedWarning
from scipy.interpolate import RegularGridInterpolator

import sketchterrain as st
from sketchterrain.errors import InputError
from sketchterrain.export.height_steps import HeightSteps
from sketchterrain.export.sampled import Sampled
from sketchterrain.export.target import Export, ExportOptions
from sketchterrain.export.targets.unreal import TARGETS, _settings
from sketchterrain.exporting import plan_of, write_export
from sketchterrain.progress import Stages

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

# Epic's table of recommended sizes: quads a section, sections a component, components.
GUIDE = {
    127: (63, 2, 1),
    253: (63, 2, 2),
    505: (63, 2, 4),
    1009: (63, 2, 8),
    2017: (63, 2, 16),
    4033: (63, 2, 32),
    8129: (127, 2, 32),
}


def numbers(path: Path) -> np.ndarray:
    """Return a heightmap's numbers, by a reader that is not ours."""
    if path.suffix == ".r16":
        found = np.fromfile(path, "<u2")
        side = round(len(found) ** 0.5)
        return found.reshape(side, side)
    with Image.open(path) as image:
        assert image.mode == "I;16"
        return np.asarray(image)


def imported(found: np.ndarray, settings: dict[str, Any]) -> np.ndarray:
    """Heights in m, [y, x], y southward: 128 steps from 32768 on are one unit of scale in cm."""
    local = (found.astype(np.float64) - 32768.0) / 128.0
    return (local * settings["Scale"]["Z"] + settings["Location"]["Z"]) / 100.0


def assert_heights(terrain: st.Terrain, outcome: Any, height: np.ndarray) -> None:
    """A sample of vertices, corners among them, has the terrain's heights within half a step."""
    settings, axes = outcome.sidecar["import"], outcome.sidecar["axes"]
    assert (axes["x"], axes["y"], axes["z"], axes["unit"]) == ("east", "south", "up", "cm")
    random = np.random.default_rng(3)
    row, column = (np.append(random.integers(0, side, 3000), [0, side - 1]) for side in height.shape)
    x = settings["Location"]["X"] + column * settings["Scale"]["X"]
    y = settings["Location"]["Y"] + row * settings["Scale"]["Y"]
    east, north = axes["origin"]["east"] + x / 100.0, axes["origin"]["north"] - y / 100.0
    true = terrain.heights(east, north, cell_size=settings["Scale"]["X"] / 100.0)
    half = settings["Scale"]["Z"] / 128.0 / 100.0 / 2.0
    assert np.abs(height[row, column] - true).max() <= half + 1e-4


@pytest.mark.parametrize("form", ["png", "r16"])
@pytest.mark.parametrize(
    "size", [127, *(pytest.param(size, marks=pytest.mark.slow) for size in (253, 505, 1009))]
)
def test_heights_are_those_of_the_terrain_where_unreal_puts_them(
    terrain: st.Terrain, exported: Callable[..., Any], size: int, form: str
) -> None:
    outcome = exported("unreal", size=size, format=form, plants=False)
    settings = outcome.sidecar["import"]
    found = numbers(outcome.folder / settings["Heightmap File"])
    assert found.shape == (size, size)
    assert_heights(terrain, outcome, imported(found, settings))


def test_components_and_the_z_scale_follow_the_guide(
    corner: st.Sketch, exported: Callable[..., Any], tmp_path: Path
) -> None:
    assert tuple(GUIDE) == TARGETS[0].sizes
    for size, (quads, sections, components) in GUIDE.items():
        assert quads * sections * components + 1 == size
        plan = plan_of(corner, "unreal", ExportOptions(size=size, plants=False))
        assert (plan.grid.columns, plan.grid.rows) == (size, size)
        export = Export(None, "a", plan.options, plan.grid, plan.tiling, None, tmp_path, None)  # type: ignore[arg-type]
        settings = _settings(export, HeightSteps(-256.0, 512.0))
        assert settings["Section Size"] == f"{quads}x{quads} Quads", size
        assert settings["Sections Per Component"] == f"{sections}x{sections} Sections", size
        assert settings["Number of Components"] == {"X": components, "Y": components}, size
        assert settings["Overall Resolution"] == {"X": size, "Y": size}, size

    told = exported("unreal", size=127, heights=(-100.0, 924.0), plants=False).sidecar
    assert told["import"]["Scale"]["Z"] == 1024.0 * 100.0 / 512.0
    assert told["import"]["Location"]["Z"] == 41200.0
    assert told["import"]["Scale"]["X"] == told["import"]["Scale"]["Y"] == pytest.approx(102400.0 / 126)


@pytest.mark.slow
@pytest.mark.parametrize(("size", "form"), [(2017, "png"), (4033, "png"), (8129, "r16")])
def test_large_sizes_come_back_too(
    corner: st.Sketch, terrain: st.Terrain, tmp_path: Path, size: int, form: str
) -> None:
    plan = plan_of(corner, "unreal", ExportOptions(size=size, format=form, plants=False))
    at = np.linspace(0.0, 1.0, size, dtype=np.float32)
    height = 900.0 * (0.7 * at[None] ** 2 + 0.3 * (1.0 - at[:, None])) - 150.0  # highest in the north-east
    flat = np.broadcast_to(np.uint8([128, 128, 255]), (size, size, 3))
    grass = np.broadcast_to(np.uint8([255]), (size, size, 1))
    sampled = Sampled(plan.grid, height, flat, grass)
    one_layer = SimpleNamespace(material_names=("grass",), features=terrain.features)
    written = plan.target.write(
        Export(one_layer, "big", plan.options, plan.grid, plan.tiling, sampled, tmp_path, Stages())  # type: ignore[arg-type]
    )
    settings = written.settings
    quads, sections, components = GUIDE[size]
    assert settings["Section Size"] == f"{quads}x{quads} Quads"
    assert settings["Sections Per Component"] == f"{sections}x{sections} Sections"
    assert settings["Number of Components"] == {"X": components, "Y": components}
    assert settings["Overall Resolution"] == {"X": size, "Y": size}
    got = imported(numbers(tmp_path / f"big_height.{form}"), settings)
    assert np.abs(got - height).max() <= settings["Scale"]["Z"] / 128.0 / 100.0 / 2.0 + 1e-4


def test_gdal_reads_the_heightmap_and_normals_are_y_down(exported: Callable[..., Any]) -> None:
    outcome = exported("unreal", size=253)
    path = outcome.folder / outcome.sidecar["import"]["Heightmap File"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        file = rasterio.open(path)
    with file:
        assert (file.count, file.dtypes) == (1, ("uint16",))
        np.testing.assert_array_equal(file.read(1), numbers(path))

    outcome = exported("unreal", size=253)
    found = numbers(outcome.folder / outcome.sidecar["import"]["Heightmap File"])
    row, column = np.unravel_index(found.argmax(), found.shape)
    assert row < 0.3 * 252
    assert column > 0.7 * 252

    outcome = exported("unreal", size=253)
    settings = outcome.sidecar["import"]
    height = imported(numbers(outcome.folder / settings["Heightmap File"]), settings)
    south, east = np.gradient(height, settings["Scale"]["X"] / 100.0)
    with Image.open(outcome.folder / "high_corner_normal.png") as image:
        normal = np.asarray(image) / 127.5 - 1.0
    for channel, slope in ((0, east), (1, south)):
        assert np.corrcoef(normal[..., channel].ravel(), -slope.ravel())[0, 1] > 0.9
    assert (normal[..., 2] > 0.0).all()


def test_tiles_are_cut_from_the_whole_and_share_edges(exported: Callable[..., Any]) -> None:
    for from_south in [False, True]:
        whole = exported("unreal", size=253)
        outcome = exported("unreal", size=253, tiles=(2, 2), tiles_from_south=from_south)
        settings = outcome.sidecar["import"]
        assert settings["Flip Tile Y Coordinate"] is from_south, from_south
        assert settings.get("Tile Coordinates Offset") == (None if from_south else {"X": 0, "Y": 0}), (
            from_south
        )
        assert settings["Overall Resolution"] == {"X": 127, "Y": 127}, from_south
        assert settings["Number of Components"] == {"X": 1, "Y": 1}, from_south
        joined = np.full((253, 253), -1)
        for x in (0, 1):
            for y in (0, 1):
                found = numbers(outcome.folder / f"high_corner_height_x{x}_y{y}.png")
                down = 1 - y if settings["Flip Tile Y Coordinate"] else y  # Unreal's y points south
                window = joined[126 * down : 126 * down + 127, 126 * x : 126 * x + 127]
                np.testing.assert_array_equal(window[window >= 0], found[window >= 0])
                window[:] = found
        np.testing.assert_array_equal(joined, numbers(whole.folder / "high_corner_height.png"))


def test_rows_of_tiles_reach_beyond_the_sketch_and_may_share_nothing(
    terrain: st.Terrain, exported: Callable[..., Any]
) -> None:
    outcome = exported("unreal", size=253, tiles=(2, 1), plants=False)
    assert outcome.sidecar["grid"]["bounds"] == {"west": 0.0, "south": 0.0, "east": 2048.0, "north": 1024.0}
    tiles = [numbers(outcome.folder / f"high_corner_height_x{x}_y0.png") for x in (0, 1)]
    np.testing.assert_array_equal(tiles[0][:, -1], tiles[1][:, 0])
    whole = np.concatenate([tiles[0], tiles[1][:, 1:]], axis=1)
    assert_heights(terrain, outcome, imported(whole, outcome.sidecar["import"]))

    outcome = exported("unreal", size=254, tiles=(2, 2), overlap=0, plants=False)
    grid = outcome.sidecar["grid"]
    assert (grid["columns"], outcome.sidecar["tiles"][1]["left"]) == (254, 127)


def weights(outcome: Any, suffix: str = "") -> np.ndarray:
    layers = []
    for name in outcome.sidecar["layers"]:
        with Image.open(outcome.folder / f"high_corner_weight_{name}{suffix}.png") as image:
            assert image.mode == "L"
            layers.append(np.asarray(image).astype(int))
    return np.stack(layers, axis=-1)


def test_weights_sum_to_255_and_lie_where_the_materials_are(exported: Callable[..., Any]) -> None:
    outcome = exported("unreal", size=253)
    found = weights(outcome)
    assert found.shape == (253, 253, 8)
    assert (found.sum(axis=-1) == 255).all()
    wood = found[..., outcome.sidecar["layers"].index("forest_floor")]
    y, x = np.indices(wood.shape) / 252.0
    # Painted in columns 34 … 52 of 64 and rows 40 … 56 from the north.
    assert (wood * x).sum() / wood.sum() == pytest.approx(43 / 64, abs=0.04)
    assert (wood * y).sum() / wood.sum() == pytest.approx(48 / 64, abs=0.04)
    tiled = exported("unreal", size=253, tiles=(2, 2), tiles_from_south=False)
    np.testing.assert_array_equal(weights(tiled, "_x1_y0"), found[:127, 126:])


def test_plants_are_the_terrains_and_stand_on_unreals_ground(
    terrain: st.Terrain, exported: Callable[..., Any]
) -> None:
    outcome = exported("unreal", size=253)
    told = json.loads((outcome.folder / "high_corner_plants.json").read_text(encoding="utf-8"))
    rows = dict(zip(told["fields"], np.array(told["plants"]).T, strict=True))
    true = terrain.foliage(0.0, 0.0, 1024.0, 1024.0)
    assert told["species"] == list(terrain.species_names)
    np.testing.assert_array_equal(rows["species"], true["species"])
    np.testing.assert_allclose(rows["x"], 100.0 * true["x"], atol=1e-3)
    np.testing.assert_allclose(rows["y"], 100.0 * (1024.0 - true["y"]), atol=1e-3)
    settings = outcome.sidecar["import"]
    height = imported(numbers(outcome.folder / settings["Heightmap File"]), settings)
    ground = RegularGridInterpolator((range(253), range(253)), height)
    place = np.stack([rows["y"] / settings["Scale"]["Y"], rows["x"] / settings["Scale"]["X"]], axis=-1)
    step = settings["Scale"]["Z"] / 128.0
    assert np.abs(rows["z"] - 100.0 * ground(np.clip(place, 0.0, 252.0))).max() <= step / 2.0 + 1e-2
    # Unreal's yaw is clockwise seen from above: a plant that looks north looks along −y.
    yaw = np.radians(rows["rotation"])
    np.testing.assert_allclose(np.cos(yaw), np.cos(true["rotation"]), atol=1e-5)
    np.testing.assert_allclose(np.sin(yaw), -np.sin(true["rotation"]), atol=1e-5)
    np.testing.assert_allclose(rows["normal_y"], -true["normal"][:, 1], atol=1e-4)
    np.testing.assert_allclose(rows["normal_z"], true["normal"][:, 2], atol=1e-4)


def test_grass_is_a_file_of_its_own(corner: st.Sketch, tmp_path: Path) -> None:
    meadow = replace(corner, extent=48.0)
    terrain = st.build(meadow)
    plan = plan_of(meadow, "unreal", ExportOptions(size=127, grass=True))
    write_export(plan, terrain, tmp_path, stages=Stages())
    for kind, storey in (("plants", "woody"), ("grass", "grass")):
        told = json.loads((tmp_path / f"high_corner_{kind}.json").read_text(encoding="utf-8"))
        true = terrain.foliage(0.0, 0.0, 48.0, 48.0, storey=storey)
        assert [row[0] for row in told["plants"]] == true["species"].tolist()


def test_water_is_in_centimetres(terrain: st.Terrain, exported: Callable[..., Any]) -> None:
    outcome = exported("unreal", size=253)
    water = json.loads((outcome.folder / "high_corner_water.json").read_text(encoding="utf-8"))
    (river,), (lake,) = water["rivers"], water["lakes"]
    points, true = np.array(river["points"]), terrain.features.rivers[0]
    np.testing.assert_allclose(points[:, 0], 100.0 * true.centreline[:, 0], atol=1e-3)
    np.testing.assert_allclose(points[:, 1], 100.0 * (1024.0 - true.centreline[:, 1]), atol=1e-3)
    np.testing.assert_allclose(points[:, 2], 100.0 * true.centreline[:, 2], atol=1e-3)
    np.testing.assert_allclose(river["width"], 100.0 * true.centreline_width, rtol=1e-6)
    assert lake["level"] == pytest.approx(100.0 * terrain.features.lakes[0].level, abs=1e-3)
    assert {point[2] for ring in lake["outline"] for point in ring} == {lake["level"]}


def test_options_that_unreal_cannot_import_are_refused(corner: st.Sketch) -> None:
    for options, says in [
        ({"size": 1024}, "1009 or 2017"),
        ({"size": 128}, "127 or 253"),
        ({"size": 16257}, "8129"),
        ({"size": 505, "format": "raw"}, "png or r16"),
        ({"size": 505, "crs": "EPSG:25832"}, "crs"),
    ]:
        with pytest.raises(InputError, match=says):
            plan_of(corner, "unreal", ExportOptions(**options))
