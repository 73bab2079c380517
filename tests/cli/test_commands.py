"""Short commands, pictures by `render`, and stages of progress."""

import json
import subprocess
import sys
import time
from importlib.metadata import version
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

import sketchterrain.app.progress
import sketchterrain.app.stills
import sketchterrain.render.offscreen
from sketchterrain.app.progress import Stages
from sketchterrain.compute.device import list_devices
from sketchterrain.document.store import load_sketch
from sketchterrain.io.resources import preset_names
from sketchterrain.render.overlays import LegendEntry
from sketchterrain.render.quality import Quality

COMMANDS = ("new", "generate", "render", "fly", "adherence", "edit", "bench", "devices", "presets")


def test_help_loads_no_numbers_no_driver_and_no_picture():
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


def test_new_is_a_sketch_that_loads_and_leaves_a_full_folder_alone(call, tmp_path):
    done = call("new", tmp_path / "mine")
    assert (done.code, str(tmp_path / "mine") in done.out) == (0, True)
    assert load_sketch(tmp_path / "mine").layers["mountain"].any()
    done = call("new", tmp_path)
    assert (done.code, "not empty" in done.error) == (3, True)
    assert [entry.name for entry in tmp_path.iterdir()] == ["mine"]


@pytest.mark.slow
def test_devices_tells_each_and_which_is_taken(call):
    told = json.loads(call("devices", "--json").out)
    assert [entry["name"] for entry in told] == [device.name for device in list_devices()]
    assert sum(entry["default"] for entry in told) == 1
    text = call("devices").out
    for device in list_devices():
        assert all(part in text for part in (device.name, device.driver, device.version, device.type))


def test_presets_tells_each(call):
    told = json.loads(call("presets", "--json").out)
    assert [entry["name"] for entry in told] == list(preset_names())
    assert all(entry["layers"] and entry["extent"] > 0 for entry in told)
    lines = call("presets").out.splitlines()
    assert [line.split()[0] for line in lines] == list(preset_names())
    for entry, line in zip(told, lines, strict=True):
        assert ("own material rules: " in line) == bool(entry["material_rules"])
        assert all(name in line for name in entry["material_rules"])
    assert any(entry["material_rules"] for entry in told)


@pytest.fixture
def shots(monkeypatch) -> list[dict[str, Any]]:
    """What the renderer was asked for, in place of a picture."""
    asked: list[dict[str, Any]] = []

    def picture(
        terrain: object, *, size: tuple[int, int], legend: list[LegendEntry], **options: Any
    ) -> NDArray[np.uint8]:
        asked.append({"terrain": terrain, "size": size, **options})
        legend.extend(LegendEntry((255, 0, 16), name) for name in options["overlays"])
        return np.zeros((size[1], size[0], 3), np.uint8)

    monkeypatch.setattr(sketchterrain.app.stills, "render_picture", picture)
    return asked


def test_render_writes_the_picture_it_names(call, sketch, tmp_path, shots):
    path = tmp_path / "made" / "a.png"
    done = call("render", sketch, "-o", path, "--size", "64x48", "--seed", 9)
    assert (done.code, done.out) == (0, f"{path}\n"), done.err
    with Image.open(path) as image:
        assert image.size == (64, 48)
    assert (shots[0]["size"], shots[0]["camera"]) == ((64, 48), None)
    assert shots[0]["terrain"].sketch.seed == 9

    done = call("render", sketch, "-o", path, "--overlay", "levels", "--overlay", "features")
    assert done.out.splitlines() == [str(path), "#ff0010  levels", "#ff0010  features"]
    assert shots[1]["overlays"] == ("levels", "features")
    told = " ".join(call("render", "--help").out.split())
    assert all(name in told for name in sketchterrain.render.overlays.OVERLAYS)


def test_render_takes_a_camera_and_an_eye_alone_looks_at_the_middle(call, sketch, tmp_path, shots):
    words = ("render", sketch, "-o", tmp_path / "a.png")
    assert call(*words, "--eye", "-10,20.5,900", "--look-at", "1e2,200,-30").code == 0
    assert (shots[0]["camera"].eye, shots[0]["camera"].target) == ((-10, 20.5, 900), (100, 200, -30))
    assert shots[0]["size"] == (1280, 720)
    for eye in ("-100,-100,500", "256,192,500", "256,192,-500"):
        done = call(*words, "--eye", eye)
        assert done.code == 0, done.err
    assert "under the ground" in done.err
    assert shots[1]["camera"].target[:2] == (256, 192)
    assert shots[2]["camera"].target[:2] == (256, 192 + 256)  # from the middle, north


def test_render_passes_on_what_a_picture_shall_be(call, sketch, tmp_path, shots):
    look = ["--view", "hill", "--time", "9:30", "--clouds", "0.2", "--quality", "0.5"]
    parts = ["--without", "trees", "--without", "haze", "--textures", tmp_path]
    done = call("render", sketch, "-o", tmp_path / "a.png", *look, *parts)
    assert done.code == 0, done.err
    shot = shots[0]
    assert (shot["view"], shot["weather"].hour, shot["weather"].clouds) == ("hill", 9.5, 0.2)
    assert shot["quality"] == Quality.from_level(0.5, without=("trees", "haze"))
    assert (shot["textures"], shot["camera"]) == (tmp_path, None)


@pytest.mark.slow
def test_render_draws_a_map_by_the_files_name(call, sketch, tmp_path):
    done = call("render", sketch, "-o", tmp_path / "a.svg", "--map")
    assert (done.code, done.out) == (0, f"{tmp_path / 'a.svg'}\n"), done.err
    tag = ET.fromstring((tmp_path / "a.svg").read_text()).tag  # noqa: S314 - written here
    assert tag.endswith("svg")
    done = call("render", sketch, "-o", tmp_path / "a.png", "--map", "--size", "600x400")
    assert done.code == 0, done.err
    with Image.open(tmp_path / "a.png") as image:
        assert image.width <= 600
        assert image.height == pytest.approx(400, abs=2)


def test_bench_is_called_with_what_was_asked(call, tmp_path, monkeypatch):
    import sketchterrain.benchmarks

    asked: list[Any] = []
    monkeypatch.setattr(
        sketchterrain.benchmarks, "run", lambda names, **more: asked.append((names, more)) or 0
    )
    assert (
        call("bench", "noise", "tiles", "-o", tmp_path, "--quick", "--device", "0", "--fast", "--json").code
        == 0
    )
    more = {"output": tmp_path, "quick": True, "device": "0", "fast": True, "as_json": True}
    assert asked == [(["noise", "tiles"], more)]
    assert call("bench").code == 0
    assert asked[1] == ([], {"output": None, "quick": False, "device": None, "fast": False, "as_json": False})


def test_adherence_tells_numbers_and_shows_where(call, sketch, tmp_path):
    done = call("adherence", sketch, "--json", "-o", tmp_path / "where.png")
    assert done.code == 0
    told = json.loads(done.out)
    assert told["lost"] == 0
    assert {"mountain", "forest", "river"} == set(told["layers"])
    assert told["peaks"]["measured"] == 1
    with Image.open(tmp_path / "where.png") as picture:
        assert picture.mode == "RGB"
    lines = call("adherence", sketch).out.splitlines()
    assert lines[0].endswith("0 shapes lost")
    assert sum(line.startswith("mountain ") for line in lines) == 1
    river = next(line for line in lines if line.startswith("river "))
    assert river.endswith("1 narrower than 6 px, overlap not measured")
    # Its forest and its river are painted, but not described.
    assert sorted(line.split()[1:5] for line in lines if line.startswith("note: ")) == [
        ["label", "1", "of", "forest"],
        ["label", "1", "of", "river"],
    ]
    assert len(told["notes"]) == 2


def test_finished_stages_are_timed_in_order():
    with Stages() as stages:
        with stages.stage("a", "First") as tell:
            tell(0.5)
        with stages.stage("b", "Second"):
            pass
        with pytest.raises(ValueError, match="no"), stages.stage("c", "Third"):
            raise ValueError("no")
    assert list(stages.seconds) == ["a", "b"]
    assert all(seconds >= 0 for seconds in stages.seconds.values())


def test_a_quick_stage_says_nothing_and_a_slow_one_a_line(capsys, monkeypatch):
    with Stages() as stages, stages.stage("a", "Quick"):
        pass
    assert capsys.readouterr().err == ""
    monkeypatch.setattr(sketchterrain.app.progress, "_SLOW", 0.001)
    with Stages() as stages, stages.stage("a", "Slow"):
        time.sleep(0.2)
    assert capsys.readouterr() == ("", "Slow …\n")


def test_a_terminal_gets_bars(terminal, monkeypatch):
    monkeypatch.setattr(sys, "stderr", terminal)
    with Stages() as stages:
        with stages.stage("a", "First") as tell:
            tell(0.5)
        with pytest.raises(ValueError, match="no"), stages.stage("b", "Second"):
            raise ValueError("no")
    assert all(title in terminal.getvalue() for title in ("First", "Second"))
