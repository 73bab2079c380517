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

import sketchterrain.export.files
import sketchterrain.export.planning
import sketchterrain.export.target
import sketchterrain.jobs.export
from sketchterrain.app.arguments import TARGETS
from sketchterrain.export.sampled import TerrainSamples
from sketchterrain.export.targets import TARGET_NAMES, target_named
from sketchterrain.jobs.export import file_name

# The plainest target in the default tier, all others in the slow one.
EACH_TARGET = pytest.mark.parametrize(
    "target",
    [name if name == "raw" else pytest.param(name, marks=pytest.mark.slow) for name in TARGET_NAMES],
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
    monkeypatch.setattr(sketchterrain.jobs.export, "sample_terrain", None)
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


def test_an_export_of_another_sketch_or_target_is_not_overwritten(call, sketch, tmp_path):
    assert call("export", sketch, "-o", tmp_path, "--no-plants", "--size", 9, "--to", "raw").code == 0
    before = {path.name: path.read_bytes() for path in tmp_path.iterdir()}
    for other, target in ((sketch, "exr"), ("valley_river", "raw")):
        done = call("export", other, "-o", tmp_path, "--no-plants", "--size", 9, "--to", target)
        assert done.code == 3
        assert done.error == (
            f"{tmp_path}: holds 'North-east' for raw, in terrain.json: "
            "expected another folder for each sketch and target"
        )
        assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == before


@pytest.mark.slow
def test_paths_need_not_be_utf8(call, sketch, tmp_path):
    out = tmp_path / os.fsdecode(b"gel\xe4nde")
    done = call("export", sketch, "--to", "geotiff", "-o", out, "--no-plants", "--size", 9, "--json")
    assert (done.code, json.loads(done.out)["folder"]) == (0, str(out))
    assert {each["file"] for each in json.loads(done.out)["files"]} == {path.name for path in out.iterdir()}
    own = tmp_path / os.fsdecode(b"sk\xe9")
    shutil.copytree(sketch, own)
    done = call("batch", own, "-o", tmp_path / "all", "--size", 9, "--no-preview")
    assert done.code == 0, done.err
    manifest = json.loads((tmp_path / "all" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["items"][0]["sketch"] == f"{tmp_path}/sk\ufffd"


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
    monkeypatch.setattr(sketchterrain.jobs.export, "sample_terrain", then_full)
    try:
        done = call("export", sketch, "--to", target, "-o", tmp_path, *smallest(target))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    check_nothing_written(done, tmp_path)


@EACH_TARGET
def test_an_interrupted_export_leaves_nothing(call, sketch, tmp_path, monkeypatch, target):
    before = signal.getsignal(signal.SIGTERM)
    sent = signal.SIGTERM if target == "raw" else signal.SIGINT
    monkeypatch.setattr(sketchterrain.export.target, "write_json", lambda *_, **__: signal.raise_signal(sent))
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


def test_file_names_are_portable():
    names = {"Valley with a river": "valley_with_a_river", "Höhenzug / Süd": "hohenzug_sud"}
    names |= {"../../etc": "etc", "山": "terrain", "": "terrain", "CON": "terrain_con", "a" * 300: "a" * 64}
    assert {title: file_name(title) for title in names} == names
