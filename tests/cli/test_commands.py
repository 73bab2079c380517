"""Short commands, `render`, and progress."""

import json
import shlex
import subprocess
import sys
import threading
from contextlib import contextmanager
from importlib.metadata import version
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from affine import Affine
from numpy.typing import NDArray
from PIL import Image

import sketchterrain.io.console
import sketchterrain.jobs.pictures
import sketchterrain.render.offscreen
from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import list_devices
from sketchterrain.document.store import load_sketch
from sketchterrain.export.map import relief
from sketchterrain.io.console import Stages
from sketchterrain.io.resources import preset_names
from sketchterrain.jobs.export import build_terrain
from sketchterrain.render.overlays import LegendEntry
from sketchterrain.render.quality import Quality
from tests.cli.conftest import PLACED
from tests.geo_files import write_raster

COMMANDS = ("new", "generate", "render", "fly", "adherence", "realism", "edit", "bench", "devices", "presets")


def test_help_loads_no_heavy_library():
    heavy = ["numpy", "scipy", "pyopencl", "moderngl", "PIL", "rasterio", "matplotlib", "PyQt6"]
    code = (
        "import sys\n"
        "from sketchterrain.app.cli import main\n"
        "codes = [main(['--help']), main(['edit', '--help']), main(['--version'])]\n"
        f"sys.stderr.write(repr((codes, sorted(set({heavy}) & set(sys.modules)))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "([0, 0, 0], [])"
    assert f"sketchterrain {version('sketchterrain')}\n" in done.stdout
    assert all(command in done.stdout for command in COMMANDS)


def test_missing_and_failing_standard_streams(tmp_path):
    """Without streams, no file gets what is printed; a reader that goes, as `head`, is no failure."""
    program = f"{shlex.quote(sys.executable)} -m sketchterrain"
    new = f"{program} new {shlex.quote(str(tmp_path / 'new'))}"
    commands = {
        f"{new}1 <&- >&- 2>&-": (0, ""),
        f"{program} targets > /dev/full": (1, "sketchterrain: error: No space left on device\n"),
        f"set -o pipefail; {program} targets --json | true": (0, ""),
    }
    children = [
        subprocess.Popen(["bash", "-c", line], stderr=subprocess.PIPE, text=True) for line in commands
    ]
    found = [(child.communicate()[1], child.returncode) for child in children]
    for (line, (code, error)), (printed, returned) in zip(commands.items(), found, strict=True):
        # A large buffer, as Python 3.13 has, is written at the end: the message then names the stream.
        assert (returned, printed.replace("stdout: ", "")) == (code, error), line
    assert load_sketch(tmp_path / "new1").layers["mountain"].any()


def test_new_writes_into_empty_folders_only(call, tmp_path):
    done = call("new", tmp_path / "mine")
    assert (done.code, str(tmp_path / "mine") in done.out) == (0, True)
    assert load_sketch(tmp_path / "mine").layers["mountain"].any()
    done = call("new", tmp_path)
    assert (done.code, "not empty" in done.error) == (3, True)
    assert [entry.name for entry in tmp_path.iterdir()] == ["mine"]


def test_new_takes_place_and_size_from_a_georeferenced_raster(call, tmp_path):
    at = Affine(20.0, 0.0, 600000.0, 0.0, -20.0, 5270000.0)
    path = write_raster(tmp_path / "map.tif", np.zeros((50, 100), np.uint8), at)
    Image.new("L", (4, 4)).save(tmp_path / "plain.png")

    options = ("--raster", f"elevation={tmp_path / 'plain.png'}", "--raster", f"picture={path}")
    assert call("new", tmp_path / "linked", *options).code == 0
    sketch = load_sketch(tmp_path / "linked")
    assert (sketch.size, sketch.width_px, sketch.height_px) == ((2000.0, 1000.0), 512, 256)
    assert sketch.frame == {"crs": "EPSG:25832", "east": 600000.0, "north": 5269000.0, "vertical": ""}
    assert [(each.role, each.path) for each in sketch.rasters] == [
        ("elevation", str(tmp_path / "plain.png")),
        ("picture", str(path)),
    ]
    assert all(each.sha256 for each in sketch.rasters)

    assert call("new", tmp_path / "own", *options, "--embed", "--crs", "EPSG:25833").code == 0
    own = load_sketch(tmp_path / "own")
    assert (own.size, own.frame["crs"]) == ((4096.0, 4096.0), "EPSG:25833")
    assert own.rasters[1].content == path.read_bytes()

    for options, code, problem in (
        (
            ("--raster", f"map={path}"),
            3,
            "raster.role = 'map': expected 'elevation' or 'orthophoto' or 'picture'",
        ),
        (("--raster", f"picture={tmp_path / 'none.tif'}"), 3, "none.tif: the file is missing"),
        (("--raster", f"picture={tmp_path / 'own/sketch.toml'}"), 3, "cannot be read as a raster"),
        (("--raster", "picture="), 3, "expected a file"),
        (("--raster", str(path)), 2, "expected ROLE=FILE, as picture=map.tif"),
        (("--embed",), 2, "--embed without --raster"),
    ):
        done = call("new", tmp_path / "refused", *options)
        assert done.code == code, options
        assert problem in done.error
        assert not (tmp_path / "refused").exists()


def test_new_on_elevation(call, tmp_path):
    path = tmp_path / "tiles" / "alps.tif"
    path.parent.mkdir()
    heights = np.add.outer(np.arange(60) * 9, np.arange(80) * 7).astype(np.int16)
    heights[30, 40] = -1
    write_raster(path, heights, Affine(30.0, 0.0, 600000.0, 0.0, -30.0, 5270000.0), nodata=-1)
    done = call("new", tmp_path / "alps", "--dem", path, "--extent", 1500, "--raster", f"picture={path}")
    lines = done.out.splitlines()
    assert done.code == 0
    assert f"wrote a sketch of 1.5 × 1.5 km on 1 grid of elevation to {tmp_path / 'alps'}: paint" in done.out
    assert "note: alps.tif: 1 samples in 1 small voids, filled" in lines
    sketch = load_sketch(tmp_path / "alps")
    assert (sketch.size, sketch.frame["crs"]) == ((1500.0, 1500.0), "EPSG:25832")
    assert [each.role for each in sketch.rasters] == ["elevation", "picture"]

    # Heightmaps of engines.
    raw = np.linspace(0, 65535, 65 * 65).astype("<u2")
    (isle := path.parent.parent / "raw" / "isle.r16").parent.mkdir()
    isle.write_bytes(raw.tobytes())
    done = call("new", tmp_path / "isle", "--dem", isle, "--cell", "2", "--range", "0,900")
    assert "note: isle.r16: 65 × 65 samples of 16 bits, little-endian (guessed)" in done.out.splitlines()
    (source,) = load_sketch(tmp_path / "isle").rasters
    assert (source.cell, source.range, source.stored_values["cell"]) == (2.0, "0,900", 2.0)
    assert "units" not in source.stored_values
    for options, code, problem in (
        (("--dem", isle), 3, "--range 0,900"),
        (("--dem", path, "--units", "furlong"), 3, "'furlong'"),
        (("--dem", path, "--range", "high"), 3, "two heights"),
        (("--signed",), 2, "--signed without --dem"),
    ):
        done = call("new", tmp_path / "refused", *options)
        assert (done.code, problem in done.error) == (code, True), done.err

    road = {"type": "LineString", "coordinates": [[601000, 5269000], [602000, 5269000]]}
    members = {"type": "Feature", "properties": {"highway": "primary"}, "geometry": road}
    crs = {"type": "name", "properties": {"name": "EPSG:25832"}}
    (tmp_path / "road.geojson").write_text(json.dumps(members | {"crs": crs}))
    done = call("new", tmp_path / "roads", "--dem", path, "--osm", tmp_path / "road.geojson")
    assert "note: used: 1 line as road" in done.out.splitlines()
    assert len(load_sketch(tmp_path / "roads").vectors["road"]) == 1

    target = tmp_path / "alps.sketch"
    for code, problem in ((0, ""), (3, "a new file, this one exists")):
        done = call("new", target, "--dem", path.parent, "--embed")
        assert done.code == code
        assert problem in done.err
    assert load_sketch(target).rasters[0].content == path.read_bytes()
    for options, code, problem in (
        (("--dem", tmp_path / "none.tif"), 3, "none.tif: the file is missing"),
        (("--dem", tmp_path), 3, "no elevation in it"),
        (("--dem", path, "--extent", "0"), 2, "--extent"),
        (("--extent", "100"), 2, "--extent without --dem"),
        (
            ("--osm", path),
            2,
            "--osm without --dem: expected elevation; `trace FILE -o DIR` takes vectors alone",
        ),
        (("--dem", path, "--osm", path), 3, "alps.tif: expected a vector file"),
        (("--dem", path, "--crs", "EPSG:4326"), 3, "is in degrees"),
    ):
        done = call("new", tmp_path / "refused", *options)
        assert done.code == code, options
        assert problem in done.err
        assert not (tmp_path / "refused").exists()


@pytest.mark.slow
def test_devices_lists_each_and_the_default(call):
    data = json.loads(call("devices", "--json").out)
    assert [entry["name"] for entry in data] == [device.name for device in list_devices()]
    assert sum(entry["default"] for entry in data) == 1
    text = call("devices").out
    for device in list_devices():
        assert all(part in text for part in (device.name, device.driver, device.version, device.type))


def test_presets_lists_each(call):
    data = json.loads(call("presets", "--json").out)
    assert [entry["name"] for entry in data] == list(preset_names())
    assert all(entry["layers"] and entry["extent"] > 0 for entry in data)
    lines = call("presets").out.splitlines()
    for entry, line in zip(data, lines, strict=True):
        assert line.split()[0] == entry["name"]
        assert ("own material rules: " in line) == bool(entry["material_rules"])
        assert all(name in line for name in entry["material_rules"])


@pytest.fixture
def pictures(monkeypatch) -> list[dict[str, Any]]:
    """Options of each call of a stub of `render_picture`."""
    requests: list[dict[str, Any]] = []

    def picture(
        terrain: object, *, size: tuple[int, int], legend: list[LegendEntry], **options: Any
    ) -> NDArray[np.uint8]:
        requests.append({"terrain": terrain, "size": size, **options})
        legend.extend(LegendEntry((255, 0, 16), name) for name in options["overlays"])
        return np.zeros((size[1], size[0], 3), np.uint8)

    monkeypatch.setattr(sketchterrain.jobs.pictures, "render_picture", picture)
    return requests


def test_render_writes_the_picture_it_names(call, sketch, tmp_path, pictures):
    path = tmp_path / "new" / "a.png"
    done = call("render", sketch, "-o", path, "--size", "64x48", "--seed", 9)
    assert (done.code, done.out) == (0, f"{path}\n"), done.err
    with Image.open(path) as image:
        assert image.size == (64, 48)
    assert (pictures[0]["size"], pictures[0]["camera"]) == ((64, 48), None)
    assert pictures[0]["terrain"].sketch.seed == 9

    done = call("render", sketch, "-o", path, "--overlay", "levels", "--overlay", "features")
    assert done.out.splitlines() == [str(path), "#ff0010  levels", "#ff0010  features"]
    assert pictures[1]["overlays"] == ("levels", "features")
    data = " ".join(call("render", "--help").out.split())
    assert all(name in data for name in sketchterrain.render.overlays.OVERLAYS)


def test_render_camera_defaults_to_the_middle(call, sketch, tmp_path, pictures):
    command = ("render", sketch, "-o", tmp_path / "a.png")
    assert call(*command, "--eye", "-10,20.5,900", "--look-at", "1e2,200,-30").code == 0
    assert (pictures[0]["camera"].eye, pictures[0]["camera"].target) == ((-10, 20.5, 900), (100, 200, -30))
    assert pictures[0]["size"] == (1280, 720)
    for eye in ("-100,-100,500", "256,192,500", "256,192,-500"):
        done = call(*command, "--eye", eye)
        assert done.code == 0, done.err
    assert "under the ground" in done.err
    assert pictures[1]["camera"].target[:2] == (256, 192)
    assert pictures[2]["camera"].target[:2] == (256, 192 + 256)  # from the middle, north


def test_render_passes_options_on(call, sketch, tmp_path, pictures):
    look = [
        "--view",
        "hill",
        "--time",
        "9:30",
        "--clouds",
        "0.2",
        "--sky",
        "stratocumulus",
        "--quality",
        "0.5",
    ]
    parts = ["--without", "trees", "--without", "haze", "--textures", tmp_path]
    done = call("render", sketch, "-o", tmp_path / "a.png", *look, *parts)
    assert done.code == 0, done.err
    (given,) = pictures
    weather = given["weather"]
    assert (given["view"], weather.hour, weather.clouds, weather.sky) == ("hill", 9.5, 0.2, "stratocumulus")
    assert given["quality"] == Quality.from_level(0.5, without=("trees", "haze"))
    assert (given["textures"], given["camera"]) == (tmp_path, None)


@pytest.mark.slow
def test_render_draws_a_map_by_file_suffix(call, sketch, tmp_path, monkeypatch):
    monkeypatch.setattr(relief, "MAX_SIDE", 0.5 * relief.MAX_SIDE)
    done = call("render", sketch, "-o", tmp_path / "a.svg", "--map")
    assert (done.code, done.out) == (0, f"{tmp_path / 'a.svg'}\n"), done.err
    tag = ET.fromstring((tmp_path / "a.svg").read_text()).tag  # noqa: S314 - written here
    assert tag.endswith("svg")
    done = call("render", sketch, "-o", tmp_path / "a.png", "--map", "--size", "600x400")
    assert done.code == 0, done.err
    with Image.open(tmp_path / "a.png") as image:
        assert image.width <= 600
        assert image.height == pytest.approx(400, abs=2)


def test_adherence_reports_and_draws(call, sketch, tmp_path):
    done = call("adherence", sketch, "--json", "-o", tmp_path / "where.png")
    assert done.code == 0
    data = json.loads(done.out)
    assert data["lost"] == 0
    assert {"mountain", "forest", "river"} == set(data["layers"])
    assert data["peaks"]["measured"] == 1
    with Image.open(tmp_path / "where.png") as picture:
        assert picture.mode == "RGB"
    lines = call("adherence", sketch).out.splitlines()
    assert lines[0].endswith("0 shapes lost")
    assert sum(line.startswith("mountain ") for line in lines) == 1
    # Its forest and its river are painted, but not described.
    assert sum(line.startswith("note: ") for line in lines) == len(data["notes"]) == 2


def test_realism_of_a_sketch_and_of_rasters(call, sketch, tmp_path):
    done = call("realism", sketch, "--json", "--map", tmp_path / "where.png")
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert (data["cell"], data["windows"]) == (30.0, 1)
    assert data["distance"] > 0
    with Image.open(tmp_path / "where.png") as picture:
        assert picture.mode == "RGB"
    y, x = np.mgrid[:100, :120]
    heights = (300 * np.sin(x / 9.0) * np.cos(y / 11.0) + 5 * x + 1).astype(np.float32)
    np.save(tmp_path / "heights.npy", heights)
    write_raster(tmp_path / "h.tif", heights, Affine(30.0, 0.0, 0.0, 0.0, -30.0, 0.0), "EPSG:32611")
    found = [
        json.loads(call("realism", tmp_path / name, "--json", *more).out)
        for name, more in (("heights.npy", ("--cell", "30")), ("h.tif", ()))
    ]
    assert found[0]["metrics"] == found[1]["metrics"]
    lines = call("realism", tmp_path / "h.tif", "--kind", "karst 90 m").out.splitlines()
    assert "to karst 90 m" in lines[0]
    for arguments, code, message in (
        (("h.tif", "--kind", "moon"), 3, "no kind of land 'moon'"),
        (("heights.npy",), 3, "--cell 2"),
        (("none.tif",), 3, "cannot be read"),
        (("h.tif", "--map", "where.jpg"), 2, "expected the name of a .png file"),
        (("h.tif", "--seed", "1"), 2, "are for sketches"),
    ):
        done = call("realism", tmp_path / arguments[0], *arguments[1:])
        assert (done.code, message in done.error) == (code, True), done.err


def run_stages() -> dict[str, float]:
    with Stages(costs={"a": 1.0, "b": 3.0}) as stages:
        with stages.stage("a", "First") as progress:
            progress(0.5)
        with pytest.raises(ValueError, match="no"), stages.stage("b", "Second"):
            raise ValueError("no")
    return stages.seconds


def test_stages_are_timed_and_displayed_on_terminals_or_if_slow(capsys, terminal, monkeypatch):
    monkeypatch.setattr(sketchterrain.io.console, "_SLOW", 600.0)
    assert list(run_stages()) == ["a"]
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sketchterrain.io.console, "_SLOW", 0.001)
    with Stages() as stages, stages.stage("a", "Slow"):
        for thread in threading.enumerate():
            if isinstance(thread, threading.Timer):
                thread.join()
    assert capsys.readouterr() == ("", "Slow …\n")
    monkeypatch.setattr(sys, "stderr", terminal)
    run_stages()
    assert all(text in terminal.getvalue() for text in ("First", "100%", "Second", "All", "25%"))


def test_placing_features_shows_its_share():
    shares = []

    @contextmanager
    def show(title):
        yield lambda share: shares.append((title, share))

    build_terrain(load_sketch("valley_river"), ComputeContext(), Stages(show), PLACED)
    assert shares == sorted(shares)
    assert shares[-1] == ("Placing features", 1.0)
