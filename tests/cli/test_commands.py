from __future__ import annotations

import json
import subprocess
import sys
from importlib.metadata import version
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from PIL import Image

import sketchterrain.render
import sketchterrain.still
from sketchterrain.compute import list_devices
from sketchterrain.listings import adherence_lines
from sketchterrain.render import Quality
from sketchterrain.render.overlays import Legend
from sketchterrain.resources import preset_names
from sketchterrain.sketch import load_sketch

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from numpy.typing import NDArray

COMMANDS = ("new", "generate", "render", "fly", "adherence", "edit", "bench", "devices", "presets")


def test_help_loads_no_numbers_no_driver_and_no_picture() -> None:
    heavy = ["numpy", "scipy", "pyopencl", "moderngl", "PIL", "rasterio", "matplotlib", "PyQt6"]
    code = (
        "import sys\n"
        "from sketchterrain.cli import main\n"
        "codes = [main(['--help']), main(['generate', '--help']), main(['--version'])]\n"
        f"sys.stderr.write(repr((codes, sorted(set({heavy}) & set(sys.modules)))))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr == "([0, 0, 0], [])"
    assert all(command in done.stdout for command in COMMANDS)


def test_the_module_and_its_version() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "sketchterrain", "--version"], capture_output=True, text=True, check=True
    )
    assert done.stdout == f"sketchterrain {version('sketchterrain')}\n"


def test_new_is_a_sketch_that_loads(call: Callable[..., Any], tmp_path: Path) -> None:
    done = call("new", tmp_path / "mine")
    assert done.code == 0
    assert str(tmp_path / "mine") in done.out
    assert load_sketch(tmp_path / "mine").layers["mountain"].any()


def test_new_leaves_a_folder_alone_that_holds_something(call: Callable[..., Any], tmp_path: Path) -> None:
    (tmp_path / "mine").write_text("mine")
    done = call("new", tmp_path)
    assert done.code == 3
    assert "not empty" in done.error
    assert [entry.name for entry in tmp_path.iterdir()] == ["mine"]


@pytest.mark.slow
def test_devices_tells_each_and_which_is_taken(call: Callable[..., Any]) -> None:
    told = json.loads(call("devices", "--json").out)
    assert [entry["name"] for entry in told] == [device.name for device in list_devices()]
    assert sum(entry["default"] for entry in told) == 1
    text = call("devices").out
    for device in list_devices():
        assert all(part in text for part in (device.name, device.driver, device.version, device.type))


def test_presets_tells_each(call: Callable[..., Any]) -> None:
    told = json.loads(call("presets", "--json").out)
    assert [entry["name"] for entry in told] == list(preset_names())
    assert all(entry["layers"] and entry["extent"] > 0 for entry in told)
    lines = call("presets").out.splitlines()
    assert [line.split()[0] for line in lines] == list(preset_names())
    for entry, line in zip(told, lines, strict=True):
        assert ("own rules of materials: " in line) == bool(entry["material_rules"])
        assert all(name in line for name in entry["material_rules"])
    assert any(entry["material_rules"] for entry in told)


@pytest.fixture
def shots(monkeypatch: pytest.MonkeyPatch) -> list[dict[str, Any]]:
    """What the renderer was asked for, in place of a picture."""
    asked: list[dict[str, Any]] = []

    def picture(
        terrain: object, *, size: tuple[int, int], legend: list[Legend], **options: Any
    ) -> NDArray[np.uint8]:
        asked.append({"terrain": terrain, "size": size, **options})
        legend.extend(Legend((255, 0, 16), name) for name in options["overlays"])
        return np.zeros((size[1], size[0], 3), np.uint8)

    monkeypatch.setattr(sketchterrain.still, "render_picture", picture)
    return asked


def test_render_writes_the_picture_it_names(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, shots: list[dict[str, Any]]
) -> None:
    path = tmp_path / "made" / "a.png"
    done = call("render", sketch, "-o", path, "--size", "64x48", "--seed", 9)
    assert (done.code, done.out) == (0, f"{path}\n"), done.err
    with Image.open(path) as image:
        assert image.size == (64, 48)
    assert (shots[0]["size"], shots[0]["camera"]) == ((64, 48), None)
    assert shots[0]["terrain"].sketch.seed == 9


def test_render_takes_a_camera(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, shots: list[dict[str, Any]]
) -> None:
    eye = ["--eye", "-10,20.5,900", "--look-at", "1e2,200,-30"]
    assert call("render", sketch, "-o", tmp_path / "a.png", *eye).code == 0
    assert (shots[0]["camera"].eye, shots[0]["camera"].target) == ((-10, 20.5, 900), (100, 200, -30))
    assert shots[0]["size"] == (1280, 720)


def test_an_eye_alone_looks_at_the_middle_and_from_the_middle_north(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, shots: list[dict[str, Any]]
) -> None:
    for eye in ("-100,-100,500", "256,192,500", "256,192,-500"):
        done = call("render", sketch, "-o", tmp_path / "a.png", "--eye", eye)
        assert done.code == 0, done.err
    assert "under the ground" in done.err
    outside, inside, _ = (shot["camera"] for shot in shots)
    assert outside.target[:2] == (256, 192)
    assert inside.target[:2] == (256, 192 + 256)


def test_overlays_are_drawn_and_their_colours_told(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, shots: list[dict[str, Any]]
) -> None:
    path = tmp_path / "a.png"
    done = call("render", sketch, "-o", path, "--overlay", "levels", "--overlay", "features")
    assert done.code == 0, done.err
    assert done.out.splitlines() == [str(path), "#ff0010  levels", "#ff0010  features"]
    assert shots[0]["overlays"] == ("levels", "features")


def test_help_names_every_overlay(call: Callable[..., Any]) -> None:
    told = " ".join(call("render", "--help").out.split())
    assert all(name in told for name in sketchterrain.render.OVERLAYS)


def test_render_passes_on_what_a_picture_shall_be(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, shots: list[dict[str, Any]]
) -> None:
    look = ["--view", "hill", "--time", "9:30", "--clouds", "0.2", "--quality", "0.5"]
    parts = ["--without", "trees", "--without", "haze", "--textures", tmp_path]
    done = call("render", sketch, "-o", tmp_path / "a.png", *look, *parts)
    assert done.code == 0, done.err
    shot = shots[0]
    assert (shot["view"], shot["weather"].hour, shot["weather"].clouds) == ("hill", 9.5, 0.2)
    assert shot["quality"] == Quality.of(0.5, without=("trees", "haze"))
    assert (shot["textures"], shot["camera"]) == (tmp_path, None)


@pytest.mark.slow
def test_render_draws_a_map_by_the_files_name(call: Callable[..., Any], sketch: Path, tmp_path: Path) -> None:
    done = call("render", sketch, "-o", tmp_path / "a.svg", "--map")
    assert (done.code, done.out) == (0, f"{tmp_path / 'a.svg'}\n"), done.err
    tag = ET.fromstring((tmp_path / "a.svg").read_text()).tag  # noqa: S314 - written here
    assert tag.endswith("svg")
    done = call("render", sketch, "-o", tmp_path / "a.png", "--map", "--size", "600x400")
    assert done.code == 0, done.err
    with Image.open(tmp_path / "a.png") as image:
        assert image.width <= 600
        assert image.height == pytest.approx(400, abs=2)


@pytest.mark.slow
@pytest.mark.gl
def test_render_is_a_picture_of_its_camera(call: Callable[..., Any], sketch: Path, tmp_path: Path) -> None:
    for name, eye in {"a": "-200,-200,300", "b": "700,600,300"}.items():
        done = call("render", sketch, "-o", tmp_path / f"{name}.png", "--size", "96x64", "--eye", eye)
        assert done.code == 0, done.err
    first, second = (np.asarray(Image.open(tmp_path / f"{name}.png")).astype(int) for name in "ab")
    assert first.shape == (64, 96, 3)
    assert np.abs(first - second).mean() > 2


def test_bench_is_called_with_what_was_asked(
    call: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sketchterrain.benchmarks

    asked: dict[str, Any] = {}

    def run(names: list[str], **options: object) -> int:
        asked.update(options, names=names)
        return 0

    monkeypatch.setattr(sketchterrain.benchmarks, "run", run)
    flags = ["--quick", "--device", "0", "--fast", "--json"]
    assert call("bench", "noise", "tiles", "-o", tmp_path, *flags).code == 0
    assert asked == {
        "names": ["noise", "tiles"],
        "output": tmp_path,
        "quick": True,
        "device": "0",
        "fast": True,
        "as_json": True,
    }
    assert call("bench").code == 0
    assert (asked["names"], asked["fast"]) == ([], False)


def test_adherence_tells_numbers_and_shows_where(
    call: Callable[..., Any], sketch: Path, tmp_path: Path
) -> None:
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


def test_a_lost_course_is_told() -> None:
    river = {"label": 3, "id": 1, "area": 9, "lost": True}
    told = {"sketch": "a", "seed": 1, "fidelity": 0.8, "lost": 1, "layers": {}, "peaks": {"measured": 0}}
    assert adherence_lines(told | {"rivers": [river], "notes": []}) == [
        "a, seed 1, fidelity 0.8: 1 shape lost",
        "course 1  of a river: lost",
    ]
