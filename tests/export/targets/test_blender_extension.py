"""The extension for Blender: its zip and reader, and with `bpy` or Blender itself what it builds."""

import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib.metadata import version
from pathlib import Path

import numpy as np
import OpenEXR
import pytest
from PIL import Image, ImageFilter

import sketchterrain as st
import sketchterrain.export
from sketchterrain.app.cli import main
from sketchterrain.export.targets.gltf import write_extension
from tests.export.exporting import export

PARENT = Path(sketchterrain.export.__file__).parent
SIZE = 65


def load_reader():
    path = PARENT / "blender_extension" / "source.py"
    spec = importlib.util.spec_from_file_location("blender_extension_source", path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # for dataclasses
    spec.loader.exec_module(module)
    return module


reader = load_reader()


@pytest.fixture(scope="module")
def blender(exported):
    return exported("blender", size=SIZE)


def test_zip_has_the_same_bytes_and_a_manifest(tmp_path, capsys):
    first, second = tmp_path / "a.zip", tmp_path / "b.zip"
    write_extension(first)
    assert main(["blender-extension", "-o", str(second)]) == 0
    assert str(second) in capsys.readouterr().out
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(first) as archive:
        names = set(archive.namelist())
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode())
    assert names == {path.name for path in (PARENT / "blender_extension").iterdir() if path.is_file()}
    assert (manifest["id"], manifest["version"]) == ("sketchterrain", version("sketchterrain"))
    assert manifest["blender_version_min"] == "4.2.0"
    assert main(["blender-extension", "-o", str(tmp_path)]) == 3
    assert "expected the name of a .zip file" in capsys.readouterr().err


def test_tiles_are_of_the_materials_with_weight(blender, terrain):
    tiles = blender.sidecar["tiles_of_materials"]
    weights = {
        path.name: np.asarray(Image.open(path)) for path in blender.paths(".png") if "_materials" in path.name
    }
    present = [
        name
        for index, name in enumerate(terrain.material_names)
        if list(weights.values())[index // 4][..., index % 4].any()
    ]
    assert [tile["material"] for tile in tiles] == present
    assert len(present) in range(4, len(terrain.material_names))
    for tile in tiles:
        assert weights[tile["weights"]][..., tile["channel"]].any()
        picture = np.asarray(Image.open(blender.folder / tile["file"]))
        assert picture.shape == (512, 512, 4)
        assert picture.std(axis=(0, 1)).min() > 1.0
        assert tile["width"] == terrain.materials.layers[tile["material"]].width
    scene = blender.sidecar["scene"]
    assert scene["camera"]["eye"][2] > 0.0
    assert 0.0 < scene["skylight"][1] < scene["sunlight"][1]
    assert min(scene["air"]["extinction"]) > 0.0
    assert max(scene["air"]["extinction"]) < 1e-3


def test_reader_has_positions_of_ground_and_plants(blender, exported, terrain):
    plants = terrain.foliage(0.0, 0.0, 1024.0, 1024.0)
    for content, levels in ((blender, 3), (exported("gltf", size=SIZE), 1)):
        source = reader.read_terrain(content.folder)
        ground = source.ground
        places = ground.position + ground.location
        x, y = (each.ravel() for each in content.places())
        assert np.abs(places[:, 0] - x).max() < 1e-3
        assert np.abs(places[:, 2] - terrain.heights(x, y, cell_size=16.0)).max() < 1e-3
        assert np.abs(ground.uv[0] - [0.5 / SIZE, 1.0 - 0.5 / SIZE]).max() < 1e-6  # north-west
        assert {len(each.levels) for each in source.plants} == {levels}
        found = np.concatenate([each.position for each in source.plants])
        order, expected = np.lexsort(found[:, :2].round(2).T), np.stack([plants["x"], plants["y"]], axis=-1)
        assert np.abs(found[order, :2] - expected[np.lexsort(expected.round(2).T)]).max() < 0.02
        for each in source.plants:
            sizes = [len(level.indices) for level in each.levels]
            assert sizes == sorted(sizes, reverse=True)
            assert all(level.position[:, 2].max() > 1.0 for level in each.levels)  # upright


def bad_inputs(good, folder):
    """Write bad exports, and return the text that each message contains."""
    expected = {
        "version": "format 2: this extension reads format 1",
        "target": "an export for 'unity': expected --to blender or --to gltf",
        "missing": "high_corner_tile_grass.png is missing",
        "half": "no terrain.json: expected a folder of `sketchterrain export`",
        "truncated": "truncated: ",
        "damaged": "damaged: export it again",
        "text": "not a sidecar of `sketchterrain export`",
    }
    for name in expected:
        shutil.copytree(good, folder / name)
    for name, key, value in (("version", "format", 2), ("target", "target", "unity")):
        path = folder / name / "terrain.json"
        path.write_text(
            json.dumps(json.loads(path.read_text(encoding="utf-8")) | {key: value}), encoding="utf-8"
        )
    (folder / "missing" / "high_corner_tile_grass.png").unlink()
    (folder / "half" / "terrain.json").unlink()
    (folder / "text" / "terrain.json").write_text("[]", encoding="utf-8")
    path = folder / "truncated" / "high_corner.glb"
    path.write_bytes(path.read_bytes()[:-1000])
    path = folder / "damaged" / "high_corner.glb"
    path.write_bytes(path.read_bytes().replace(b'"POSITION"', b'"POSITIOM"', 1))
    return expected


def test_reader_refuses_bad_exports_in_one_line(blender, tmp_path):
    for name, text in bad_inputs(blender.folder, tmp_path).items():
        with pytest.raises(reader.SourceError) as caught:
            reader.read_terrain(tmp_path / name)
        assert text in str(caught.value)
        assert "\n" not in str(caught.value)
    with pytest.raises(reader.SourceError, match="cannot be read"):
        reader.read_terrain(tmp_path / "nowhere.glb")
    alone = shutil.copy(blender.paths("corner.glb")[0], tmp_path / "alone.glb")
    assert reader.read_terrain(alone).sidecar == {}


def blender_command():
    """Return the command that runs a script in Blender's Python, or skip."""
    own = os.environ.get("SKETCHTERRAIN_BLENDER_PYTHON")
    if own or importlib.util.find_spec("bpy"):
        return [own or sys.executable]
    if shutil.which("blender"):
        return ["blender", "--background", "--factory-startup", "--python-exit-code", "1", "--python"]
    pytest.skip("needs Blender ≥ 4.2: `blender` on PATH, or SKETCHTERRAIN_BLENDER_PYTHON, a Python with bpy")


def run_blender(work, *steps):
    script = Path(__file__).with_name("blender_program.py")
    command = blender_command()
    arguments = ["--"] if command[0] == "blender" else []
    done = subprocess.run(
        [*command, str(script), *arguments, str(PARENT), str(work), ",".join(steps)],
        capture_output=True,
        text=True,
        timeout=500,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    assert "Traceback" not in done.stderr
    return json.loads(next(line for line in done.stdout.splitlines() if line.startswith('{"')))


def exr_heights(outcome):
    with OpenEXR.File(str(outcome / "high_corner_height.exr"), separate_channels=True) as file:
        return np.array(file.channels()["R"].pixels)


def height_error(places, heights):
    """Return the largest difference of vertices from a grid over 1024 m, row 0 north."""
    last = len(heights) - 1
    column, row = (
        np.rint(each * last / 1024.0).astype(int) for each in (places[:, 0], 1024.0 - places[:, 1])
    )
    assert np.abs(places[:, 0] - column * 1024.0 / last).max() < 1e-3
    assert len(places) == heights.size
    return np.abs(places[:, 2] - heights[row, column]).max()


@pytest.mark.soak
def test_blender_builds_and_refreshes_a_terrain(blender, corner, tmp_path):
    blender_command()
    shutil.copytree(blender.folder, tmp_path / "first")
    (tmp_path / "bad").mkdir()
    other = corner.replace(seed=6)
    second = export(st.build(other), "blender", tmp_path / "second", size=129).report
    expected = bad_inputs(blender.folder, tmp_path / "bad")
    again = shutil.copytree(blender.folder, tmp_path / "bad" / "again")
    expected[again.name] = "this file has the terrain 'High corner' already: use Refresh"
    heights = exr_heights(tmp_path / "first")
    facts = run_blender(tmp_path, "imported", "refused", "refreshed") | run_blender(tmp_path, "written")

    found, sidecar = facts["imported"], blender.sidecar
    assert height_error(np.load(tmp_path / "ground.npy"), heights) < 1e-3
    tiles = sidecar["tiles_of_materials"]
    assert found["ground_nodes"] == sorted(
        f"High corner {each}" for each in ["air", *(t["title"] for t in tiles)]
    )
    assert len(found["images"]) >= len(tiles) + len({tile["weights"] for tile in tiles})
    levels = found["instances"]["levels"]
    assert sum(levels.values()) == sidecar["plants"]["count"]
    plants = np.concatenate([each.position for each in reader.read_terrain(blender.folder).plants])
    assert np.abs(np.sort(np.load(tmp_path / "plants.npy"), axis=0) - np.sort(plants, axis=0)).max() < 1e-3
    assert set(levels) == {"1", "2", "3"}
    assert found["instances"]["nearest"]["2"] >= 150.0
    assert found["instances"]["nearest"]["3"] >= 500.0
    box = np.array(found["model"])
    assert 5.0 < box[:, 2].max() < 30.0
    assert -1.0 < box[:, 2].min() <= 0.5
    camera, scene = np.array(found["camera"]["matrix"]), sidecar["scene"]
    eye, target = (np.array(scene["camera"][name]) for name in ("eye", "target"))
    assert np.allclose(camera[:3, 3], eye, atol=1e-3)
    assert np.allclose(-camera[:3, 2], (target - eye) / np.linalg.norm(target - eye), atol=1e-5)
    assert np.degrees(found["camera"]["fov"]) == pytest.approx(scene["camera"]["vertical_fov"], abs=1e-3)
    azimuth, elevation = (np.radians(scene["sun"][name]) for name in ("azimuth", "elevation"))
    towards = [np.sin(azimuth) * np.cos(elevation), np.cos(azimuth) * np.cos(elevation), np.sin(elevation)]
    assert np.allclose(found["sun"], towards, atol=1e-5)
    assert found["undone"]
    assert found["redone"]

    assert facts["refused"].keys() == expected.keys()
    for name, (line, is_unchanged) in facts["refused"].items():
        assert expected[name] in line, name
        assert line.count("\n") == 0
        assert is_unchanged, name

    found = facts["refreshed"]
    assert found["same"]
    assert height_error(np.load(tmp_path / "refreshed.npy"), exr_heights(tmp_path / "first")) < 1e-3
    assert exr_heights(tmp_path / "first").shape == (129, 129)
    assert "cabin" in found["objects"]
    assert "sun" not in found["objects"]
    assert found["modifiers"] == ["own"]
    assert (found["strength"], found["lens"]) == (0.25, 21.0)
    assert found["plants"] == second["plants"]["count"] == sum(found["instances"]["levels"].values())

    assert (facts["written"]["code"], facts["written"]["bad"]) == (0, 1)
    assert "ground" in facts["written"]["objects"]
    assert "Cube" not in facts["written"]["objects"]
    assert all(path.startswith("//") for path in facts["written"]["images"])


@pytest.mark.soak
def test_blender_builds_a_lone_glb_and_an_adaptive_mesh(exported, blender, tmp_path):
    blender_command()
    adaptive = exported("gltf", size=SIZE, error=2.0)
    shutil.copy(exported("gltf", size=SIZE).paths("corner.glb")[0], tmp_path / "alone.glb")
    shutil.copytree(adaptive.folder, tmp_path / "gltf")
    facts = run_blender(tmp_path, "alone")["alone"]
    count = blender.sidecar["plants"]["count"]
    for content in facts.values():
        assert content["instances"] == count
        assert {tuple(size) for size in content["images"]} == {(SIZE, SIZE)}  # baked
        assert content["own_normals"]
    assert facts["alone.glb"]["vertices"] == SIZE * SIZE
    assert facts["gltf"]["vertices"] == adaptive.sidecar["mesh"]["vertices"] < SIZE * SIZE


PICTURE = (480, 270)


def picture(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(float)


def blurred(values):
    grey = Image.fromarray(np.rint(values).astype(np.uint8))
    return np.asarray(grey.filter(ImageFilter.GaussianBlur(2))).astype(float)


def skyline(pixels):
    """Return the row of each column where blue drops most within 6 rows of the upper part."""
    blue = blurred(pixels[..., 2])
    return (blue[:-6] - blue[6:])[:170].argmax(axis=0) + 3


def best_shift(first, second, reach=12):
    """Return the shift of two pictures' edges, rows and columns, with the best correlation."""
    a, b = (np.hypot(*np.gradient(blurred(each.mean(axis=-1)))) for each in (first, second))
    inner = a[reach:-reach, reach:-reach].ravel()
    shifts = [(y, x) for y in range(-reach, reach + 1) for x in range(-reach, reach + 1)]
    rows, columns = a.shape
    parts = [b[reach + y : rows - reach + y, reach + x : columns - reach + x].ravel() for y, x in shifts]
    return shifts[int(np.argmax([np.corrcoef(inner, part)[0, 1] for part in parts]))]


def lowest(mask):
    """Return the lowest row of a mask in each column that has more than 3 pixels of it, else -1."""
    return np.where(mask.sum(axis=0) > 3, len(mask) - 1 - mask[::-1].argmax(axis=0), -1)


@pytest.mark.soak
@pytest.mark.parametrize("preset", ["valley_river", "alpine_range", "mountain_pass"])
def test_cycles_picture_is_composed_as_the_still(preset, tmp_path):
    blender_command()
    assert main(["export", preset, "--to", "blender", "-o", str(tmp_path / "first")]) == 0
    assert main(["render", preset, "-o", str(tmp_path / "still.png"), "--size", "480x270"]) == 0
    run_blender(tmp_path, "imported", "rendered")
    still, render = (picture(tmp_path / name) for name in ("still.png", "render.png"))
    assert render.shape == (*PICTURE[::-1], 3)
    assert np.abs(best_shift(still, render)).max() <= 2
    apart = np.abs(skyline(still) - skyline(render))
    assert np.median(apart) <= 2.0
    assert (apart <= 5).mean() > 0.5  # clouds and snow hide the rest
    if preset == "valley_river":  # the lake is the blue below the middle
        lakes = [(each[135:, :, 2] > 1.2 * each[135:, :, 0]) for each in (still, render)]
        assert (lakes[0] & lakes[1]).sum() > 0.65 * (lakes[0] | lakes[1]).sum()
    if preset == "alpine_range":
        snow = [lowest(each[60:200].min(axis=-1) > 165.0) for each in (still, render)]
        both = (snow[0] > 0) & (snow[1] > 0)
        assert both.mean() > 0.6
        assert abs(np.median((snow[0] - snow[1])[both])) <= 4.0
