import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

import sketchterrain as st
import sketchterrain.jobs.generate
from sketchterrain.app.cli import main
from sketchterrain.errors import DeviceError
from sketchterrain.export.foliage_files import VERTEX
from tests.geo_files import write_raster

FILES = {
    *("height.tif", "height.png", "height.json", "normal.png", "materials.png", "materials-2.png"),
    *("materials-3.png", "materials.json", "foliage.csv", "features.json", "report.json"),
    *("drainage.tif", "wetness.png"),
}
BARE = FILES - {"foliage.csv"}
SIZE = 65


def names(folder: Path) -> set[str]:
    return {entry.name for entry in folder.iterdir()}


def heights(folder: Path) -> NDArray[np.float32]:
    with rasterio.open(folder / "height.tif") as file:
        return np.asarray(file.read(1))


def report(folder: Path) -> Any:
    return json.loads((folder / "report.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def generated(sketch, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("generated")
    assert main(["generate", str(sketch), "-o", str(folder), "--size", str(SIZE), "--no-preview"]) == 0
    return folder


def test_images_have_one_size_and_north_up(generated):
    assert names(generated) == set(report(generated)["files"]) == FILES
    assert heights(generated).shape == (49, SIZE)
    for name in ("height.png", "normal.png", "materials.png", "materials-2.png"):
        with Image.open(generated / name) as image:
            assert image.size == (SIZE, 49)
    with Image.open(generated / "height.png") as image:
        value = np.asarray(image)
    np.testing.assert_array_equal(value.argmax(), heights(generated).argmax())
    row, column = np.unravel_index(value.argmax(), value.shape)
    assert row < 0.4 * value.shape[0]
    assert column > 0.7 * value.shape[1]


def test_drainage_is_at_the_nodes_of_the_drained_ground(generated, sketch):
    terrain = st.build(st.load_sketch(sketch))
    drainage = terrain.drainage()
    with rasterio.open(generated / "drainage.tif") as file, Image.open(generated / "wetness.png") as image:
        np.testing.assert_array_equal(file.read(1), drainage.area)
        np.testing.assert_array_equal(image, drainage.wetness)
        assert file.shape == (193, 257)
        assert file.xy(192, 0) == (0.0, 0.0)
        assert file.units == ("m2",)
        assert drainage.area.min() >= drainage.spacing**2
    # The wettest nodes lie low among their neighbours.
    z = terrain.heights(*np.meshgrid(np.arange(257) * 2.0, np.arange(193)[::-1] * 2.0), cell_size=2.0)
    wet = drainage.wetness > 200
    around = ndimage.uniform_filter(z, 33)
    assert (z < around)[wet].mean() > 0.8


def test_report_matches_the_terrain(generated, sketch):
    data = report(generated)
    terrain = st.build(st.load_sketch(sketch))
    plants = (generated / "foliage.csv").read_text(encoding="ascii").count("\n") - 1
    assert (data["sketch"], data["seed"], data["extent"]) == ("North-east", 5, 512.0)
    assert data["size"] == {"columns": SIZE, "rows": 49}
    assert data["device"]["name"] == terrain.context.device.name
    assert data["device"]["driver"] == terrain.context.device.driver
    assert sum(data["counts"]["plants"].values()) == plants > 0
    assert sum(data["counts"]["features"].values()) == len(terrain.features.points)
    assert data["foliage"]["files"] == ["foliage.csv"]
    assert data["foliage"]["plants"] == plants
    assert 0 < data["foliage"]["seconds"] <= data["timings"]["plants"]
    assert data["foliage"]["plants_per_second"] == pytest.approx(
        plants / data["foliage"]["seconds"], rel=0.01, abs=0.5
    )
    assert data["counts"]["rivers"] == len(terrain.features.rivers) > 0
    assert data["resolutions"] == [each.line for each in terrain.recipe.resolutions]
    assert data["edits"] == {"count": 0, "orphans": []}
    assert data["heights"]["maximum"] == heights(generated).max()
    assert 10 << 20 < data["peak_memory"] < 1 << 36
    assert {"sketch", "device", "features", "ground", "plants", "files"} <= data["timings"].keys()
    assert all(0 <= seconds < 600 for seconds in (data["timings"] | data["writing"]).values())
    *stages, total = data["timings"].values()
    assert sum(stages) <= total + 0.01


def test_stale_files_of_the_previous_run_are_removed(call, sketch, tmp_path):
    command = ("generate", sketch, "-o", tmp_path, "--size", 3, "--no-preview")
    assert call(*command, "--foliage", "both").code == 0
    (tmp_path / "mine.txt").write_text("mine")
    (tmp_path / "preview.png").write_bytes(b"of the last time")
    data = report(tmp_path)
    data["files"] += ["preview.png", "../" + sketch.name, "mine/../mine.txt"]
    (tmp_path / "report.json").write_text(json.dumps(data))
    assert call(*command, "--seed", 6, "--foliage", "none").code == 0
    assert names(tmp_path) == BARE | {"mine.txt"}
    assert sketch.exists()
    (tmp_path / "report.json").write_text("{")
    (tmp_path / "preview.png").write_bytes(b"whose?")
    assert call(*command, "--foliage", "none").code == 0
    assert names(tmp_path) == BARE | {"mine.txt", "preview.png"}


def test_json_and_text_output(call, sketch, tmp_path):
    command = ("generate", sketch, "--size", 9, "--no-preview", "-o")
    data = json.loads(call(*command, tmp_path, "--json").out)
    assert (data["folder"], set(data["files"])) == (str(tmp_path), FILES)
    assert data["timings"]["total"] > 0
    out = tmp_path / "new" / "out"
    done = call(*command, out, "--foliage", "none")
    assert done.code == 0
    assert all(part in done.out for part in (str(out), report(out)["device"]["name"]))
    assert "preview:" not in done.out


@pytest.mark.slow
def test_smallest_size_empty_and_full_sketches(call, sketch, tmp_path):
    bare = ("--no-preview", "--foliage", "none")
    assert call("generate", sketch, "-o", tmp_path / "two", "--size", 2, *bare).code == 0
    assert heights(tmp_path / "two").shape == (2, 2)
    (tmp_path / "empty").mkdir()
    (tmp_path / "empty" / "sketch.toml").write_text("format = 1\nextent = 300.0\n[density]\nhill = 20.0\n")
    full = {name: np.ones((32, 32), np.uint8) for name in st.Sketch().layers}
    st.save_sketch(st.Sketch(extent=300.0, layers=full), tmp_path / "full")
    for name in ("empty", "full"):
        done = call("generate", tmp_path / name, "-o", tmp_path / "out", "--size", 33, "--no-preview")
        assert done.code == 0, done.err
        assert np.isfinite(heights(tmp_path / "out")).all()


def test_without_opengl_only_the_preview_is_missing(call, sketch, tmp_path, monkeypatch):
    def refuse(*_: object, **__: object) -> None:
        raise DeviceError("no OpenGL 4.3 through EGL")

    monkeypatch.setattr(sketchterrain.jobs.generate, "_picture_taker", lambda *_: refuse)
    done = call("generate", sketch, "-o", tmp_path, "--size", 9, "--foliage", "none")
    assert done.code == 5
    assert done.error == "no preview, all other files are written: no OpenGL 4.3 through EGL"
    assert names(tmp_path) == BARE


def test_write_error_leaves_old_files(call, sketch, tmp_path, monkeypatch):
    (tmp_path / "report.json").write_text("old")

    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "normal.png")

    monkeypatch.setattr(sketchterrain.jobs.generate, "write_normal_png", full)
    done = call("generate", sketch, "-o", tmp_path, "--size", 9, "--no-preview", "--foliage", "none")
    assert (done.code, done.error) == (1, "normal.png: No space left on device")
    assert (tmp_path / "report.json").read_text() == "old"
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("kind", ["both", "none"])
def test_plant_file_formats(call, generated, sketch, tmp_path, kind):
    done = call("generate", sketch, "-o", tmp_path, "--size", 9, "--no-preview", "--foliage", kind)
    assert done.code == 0, done.err
    added = {"both": {"foliage.ply", "foliage.csv"}, "none": set[str]()}[kind]
    assert names(tmp_path) == BARE | added
    data = report(tmp_path)
    assert set(data["files"]) == names(tmp_path)
    assert (" plants" in done.out.splitlines()[0]) == (kind != "none")
    if kind == "none":
        assert data["counts"]["plants"] == {}
        return
    assert data["counts"]["plants"] == report(generated)["counts"]["plants"]
    assert (tmp_path / "foliage.csv").read_bytes() == (generated / "foliage.csv").read_bytes()
    plants = np.frombuffer((tmp_path / "foliage.ply").read_bytes().split(b"end_header\n", 1)[1], VERTEX)
    assert len(plants) == sum(data["counts"]["plants"].values()) > 0
    terrain = st.build(st.load_sketch(sketch))
    np.testing.assert_array_equal(plants["z"], terrain.heights(plants["x"], plants["y"]))


def test_interrupt_leaves_no_files(call, sketch, tmp_path, monkeypatch):
    real = st.Terrain.foliage_pieces
    seen: list[set[str]] = []

    def pieces(terrain: st.Terrain, *area: float, storey: str) -> Iterator[NDArray[np.void]]:
        if storey == "grass":  # the trees and shrubs are written by then
            (hidden,) = tmp_path.iterdir()
            seen.append({entry.name.split(".")[2] for entry in hidden.glob(".foliage.*.tmp")})
            raise KeyboardInterrupt
        yield from real(terrain, *area, storey=storey)

    monkeypatch.setattr(st.Terrain, "foliage_pieces", pieces)
    look = ["--size", 9, "--no-preview", "--foliage", "both", "--grass"]
    done = call("generate", sketch, "-o", tmp_path, *look)
    assert (done.code, done.error) == (130, "interrupted")
    assert seen == [{"csv", "ply"}]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.gl
@pytest.mark.slow
def test_the_preview_is_a_picture(call, sketch, tmp_path):
    done = call("generate", sketch, "-o", tmp_path, "--size", 9)
    assert done.code == 0, done.err
    assert str(tmp_path / "preview.png") in done.out
    with Image.open(tmp_path / "preview.png") as image:
        assert (image.size, image.mode) == ((1280, 720), "RGB")
        assert np.asarray(image).std() > 10
    assert names(tmp_path) == FILES | {"preview.png"}
    data = report(tmp_path)
    assert set(data["files"]) == names(tmp_path)
    assert 0 < sum(data["rendering"].values()) <= data["timings"]["total"]  # beside plants and adherence


@pytest.mark.slow
def test_map_and_view_options(call, sketch, tmp_path, monkeypatch):
    requested: dict[str, Any] = {}

    def picture(terrain: object, **options: Any) -> np.ndarray:
        requested.update(options)
        return np.zeros((18, 32, 3), np.uint8)

    monkeypatch.setattr(sketchterrain.jobs.generate, "_picture_taker", lambda *_: picture)
    look = ["--view", "air", "--time", "17", "--clouds", "1", "--map", "svg"]
    done = call("generate", sketch, "-o", tmp_path, "--size", 9, *look)
    assert done.code == 0, done.err
    assert (requested["view"], requested["weather"].hour, requested["weather"].clouds) == ("air", 17.0, 1.0)
    assert names(tmp_path) == FILES | {"preview.png", "map.svg"}
    assert "map.svg" in report(tmp_path)["files"]
    assert (tmp_path / "map.svg").read_text().rstrip().endswith("</svg>")


@pytest.mark.slow
def test_report_lists_real_elevation(call, tmp_path):
    heights = (500.0 + np.add.outer(np.arange(40) * 9, np.arange(50) * 7)).astype(np.int16)
    heights[20, 20] = -1
    at = rasterio.Affine(30.0, 0.0, 600000.0, 0.0, -30.0, 5270000.0)
    write_raster(tmp_path / "alps.tif", heights, at, nodata=-1)
    assert call("new", tmp_path / "alps", "--dem", tmp_path / "alps.tif", "--extent", 800).code == 0
    options = ("--size", 33, "--no-preview", "--foliage", "none")
    done = call("generate", tmp_path / "alps", "-o", tmp_path / "out", *options)
    assert done.code == 0
    assert "elevation: alps.tif: 1 samples in 1 small voids, filled" in done.out.splitlines()
    base = report(tmp_path / "out")["base"]
    (grid,) = base["grids"]
    assert (grid["name"], grid["rows"], grid["columns"]) == ("alps.tif", 40, 50)
    assert grid["step"] == pytest.approx(30.0)
    assert (base["error"], len(base["id"])) == (0.5, 32)
    assert "alps.tif: 1 samples in 1 small voids, filled" in base["findings"]
    (tmp_path / "alps.tif").unlink()
    done = call("generate", tmp_path / "alps", "-o", tmp_path / "out", *options)
    assert (done.code, "alps.tif: the file is missing" in done.error) == (3, True)
