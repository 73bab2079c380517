"""`export` and `targets`: every target, full disks, interrupts."""

import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import sketchterrain.app.export
import sketchterrain.app.jobs
import sketchterrain.export.files
import sketchterrain.export.planning
import sketchterrain.export.sidecar
from sketchterrain.app.arguments import TARGETS
from sketchterrain.app.export import file_name
from sketchterrain.errors import DeviceFailedError
from sketchterrain.export.sampled import TerrainSamples
from sketchterrain.export.targets import TARGET_NAMES, target_named

# The plainest target and a GIS library's in the default tier, all others in the slow one.
EACH_TARGET = pytest.mark.parametrize(
    "target",
    [
        name if name in {"raw", "geotiff"} else pytest.param(name, marks=pytest.mark.slow)
        for name in TARGET_NAMES
    ],
)


def smallest(target: str) -> list[str]:
    """Return the options of a small export."""
    known = target_named(target)
    if known.spacing is not None:
        return []
    return ["--size", str(min(known.sizes, default=33))]


def test_help_and_docs_name_all_targets():
    assert TARGETS == TARGET_NAMES
    page = (Path(__file__).parents[2] / "docs/exporting.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith("| `")]
    assert set(TARGET_NAMES) <= {name for row in rows for name in re.findall(r"\w+", row)}


@EACH_TARGET
def test_each_target_writes_its_files_and_sidecar(call, sketch, tmp_path, target):
    done = call("export", sketch, "--to", target, "-o", tmp_path / "out", *smallest(target), "--json")
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert data["target"] == target
    assert {path.name for path in (tmp_path / "out").iterdir()} == {each["file"] for each in data["files"]}
    written = json.loads((tmp_path / "out/terrain.json").read_text(encoding="utf-8"))
    assert written == {key: data[key] for key in written}
    assert {"ground", "total"} <= set(data["timings"])
    assert set(data["grid"]) == {"columns", "rows", "spacing", "bounds"}
    assert data["heights"]["minimum"] < data["heights"]["maximum"]
    assert data["byte_order"]
    assert data["orientation"]
    assert data["import"]
    assert all(each["what"] for each in data["files"])


def test_import_settings_are_printed(call, sketch, tmp_path):
    options = ("--size", 33, "--tiles", "4x4", "--no-plants", "--heights", "-100,900")
    done = call("export", sketch, "--to", "raw", "-o", tmp_path, *options)
    assert done.code == 0, done.err
    assert "33 × 25 vertices in 16 tiles 16 m apart" in done.out
    assert "import settings:" in done.out
    assert "and 60 more" in done.out
    assert "Byte Order       little-endian\n" in done.out


def test_targets_lists_options(call):
    done = call("targets", "--json")
    entries = {entry["name"]: entry for entry in json.loads(done.out)}
    assert tuple(entries) == TARGET_NAMES
    assert entries["raw"]["formats"][0] == "r16"
    assert "heights" in entries["raw"]["options"]
    listed = call("targets").out
    for name, entry in entries.items():
        assert f"{name} " in listed
        assert entry["title"] in listed


def test_listing_targets_loads_no_driver():
    code = (
        "import sys\n"
        "from sketchterrain.export.targets import TARGET_NAMES, target_named\n"
        "for name in TARGET_NAMES: target_named(name)\n"
        "print(*sorted({'pyopencl', 'scipy', 'moderngl', 'PyQt6', 'OpenEXR', 'pyogrio'} & set(sys.modules)))"
    )
    listed = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert listed.stdout.strip() == ""


def test_disk_space_is_checked_first(call, sketch, tmp_path, monkeypatch):
    usage = shutil.disk_usage(tmp_path)._replace(free=1 << 20)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    monkeypatch.setattr(sketchterrain.app.export, "sample_terrain", None)
    done = call("export", sketch, "--to", "raw", "-o", tmp_path / "out")
    assert done.code == 3
    assert f"{tmp_path / 'out'} has 1.0 MiB free" in done.error
    assert not (tmp_path / "out").exists()


def check_nothing_written(done: Any, folder: Path) -> None:
    assert (done.code, done.out) == (1, "")
    assert "cannot be written" in done.error
    assert str(folder) in done.error
    assert ".sketchterrain-" not in done.error
    assert [path.name for path in folder.iterdir()] == ["terrain.json"]
    assert (folder / "terrain.json").read_text() == "mine"


def test_stale_files_of_the_previous_export_are_removed(call, sketch, tmp_path):
    folder = tmp_path / "out"
    common = ("export", sketch, "-o", folder, "--no-plants", "--size", 33)
    assert call(*common, "--to", "raw", "--tiles", "2x2").code == 0
    assert call(*common, "--to", "raw", "--format", "r32").code == 0
    assert len(list(folder.glob("*_height*"))) == 1  # no tile is left
    data = json.loads((folder / "terrain.json").read_text(encoding="utf-8"))
    assert {path.name for path in folder.iterdir()} == {each["file"] for each in data["files"]}
    mine, outside = folder / "notes.txt", tmp_path / "outside.txt"
    for path in (mine, outside):
        path.write_text("mine")
    data["files"] += [{"file": "../outside.txt", "what": ""}, {"file": str(outside), "what": ""}]
    (folder / "terrain.json").write_text(json.dumps(data), encoding="utf-8")
    assert call(*common, "--to", "raw").code == 0
    assert mine.read_text() == outside.read_text() == "mine"
    before = {path.name for path in folder.iterdir()}
    assert call(*common, "--to", "exr").code == 0  # another target's files are another matter
    assert before <= {path.name for path in folder.iterdir()}
    (folder / "terrain.json").write_text("[", encoding="utf-8")
    assert call(*common, "--to", "exr").code == 0


@EACH_TARGET
def test_full_disk_leaves_the_old_export(call, sketch, tmp_path, monkeypatch, target):
    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    (tmp_path / "terrain.json").write_text("mine")
    monkeypatch.setattr(os, "fsync", full)
    check_nothing_written(call("export", sketch, "--to", target, "-o", tmp_path, *smallest(target)), tmp_path)


@pytest.mark.parametrize(
    "target", ["raw", *(pytest.param(name, marks=pytest.mark.slow) for name in ("exr", "geotiff"))]
)
def test_library_errors_on_a_full_disk_are_raised(call, sketch, tmp_path, monkeypatch, target):
    """As a process that may write no file larger than 1 KB: libraries must not hide it."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    real = sketchterrain.export.sampled.sample_terrain

    def then_full(*arguments: Any, **options: Any) -> TerrainSamples:
        sampled = real(*arguments, **options)  # before it, drivers write what they compiled
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # as Python has it, until LLVM is loaded
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024, hard))
        return sampled

    (tmp_path / "terrain.json").write_text("mine")
    monkeypatch.setattr(sketchterrain.app.export, "sample_terrain", then_full)
    try:
        done = call("export", sketch, "--to", target, "-o", tmp_path, *smallest(target))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    check_nothing_written(done, tmp_path)


@EACH_TARGET
def test_an_interrupted_export_leaves_nothing(call, sketch, tmp_path, monkeypatch, target):
    before = signal.getsignal(signal.SIGTERM)
    way = signal.SIGTERM if target == "raw" else signal.SIGINT
    monkeypatch.setattr(sketchterrain.export.sidecar, "write_json", lambda *_, **__: signal.raise_signal(way))
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored by background jobs
    try:
        done = call(
            "export", sketch, "--to", target, "-o", tmp_path / "out", *smallest(target), "--no-plants"
        )
    finally:
        signal.signal(signal.SIGINT, previous)
    assert (done.code, done.error) == (130, "interrupted")
    assert not (tmp_path / "out").exists()
    assert signal.getsignal(signal.SIGTERM) == before


def test_device_failure_restarts_on_another(call, sketch, tmp_path, monkeypatch):
    real, failed = sketchterrain.export.sampled.sample_terrain, []

    def once(*arguments: Any, **options: Any) -> TerrainSamples:
        if not failed:
            failed.append(True)
            raise DeviceFailedError("the device is gone")
        return real(*arguments, **options)

    words = ("export", sketch, "--to", "raw", "--size", 33, "-o")
    plain = call(*words, tmp_path / "plain")
    monkeypatch.setattr(sketchterrain.app.export, "sample_terrain", once)
    monkeypatch.setattr(
        sketchterrain.app.jobs, "fallback_device", lambda failed: failed[-1]
    )  # compiled already
    done = call(*words, tmp_path / "again")
    assert (plain.code, done.code) == (0, 0), done.err
    assert "restarted: the device is gone; restarted on" in done.out
    first, second = (
        {path.name: path.read_bytes() for path in (tmp_path / name).iterdir()} for name in ("plain", "again")
    )
    assert first == second


def test_file_names_are_portable():
    names = {"Valley with a river": "valley_with_a_river", "Höhenzug / Süd": "hohenzug_sud"}
    names |= {"../../etc": "etc", "山": "terrain", "": "terrain", "CON": "terrain_con", "a" * 300: "a" * 64}
    assert {title: file_name(title) for title in names} == names
