"""`batch`: its files equal those of `generate` and `export`."""

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import DeviceFailedError
from sketchterrain.render.offscreen import SnapshotRenderer
from sketchterrain.schema.layers import LAYERS
from tests.devices import needs_known_device

QUICK = ("--size", 17, "--no-preview")
MEASURED = ("timings", "rendering", "writing", "peak_memory")


def comparable(folder: Path) -> dict[str, object]:
    """Every file's bytes, and the report without what was measured."""
    found: dict[str, object] = {path.name: path.read_bytes() for path in folder.iterdir()}
    report = json.loads(bytes(found["report.json"]))  # type: ignore[call-overload]
    for name in MEASURED:
        report.pop(name, None)
    for name in ("seconds", "plants_per_second"):
        report.get("foliage", {}).pop(name, None)
    found["report.json"] = report
    return found


def manifest(folder: Path) -> Any:
    return json.loads((folder / "manifest.json").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_files_equal_those_of_generate(call, sketch, tmp_path):
    done = call("batch", sketch, "-o", tmp_path / "all", "--seeds", "2,1", *QUICK)
    assert (done.code, done.err.count("\n")) == (0, 2)
    assert "2 terrains written in" in done.out
    for seed in (1, 2):
        alone = tmp_path / f"alone-{seed}"
        assert call("generate", sketch, "-o", alone, "--seed", seed, *QUICK).code == 0
        assert comparable(tmp_path / "all" / "north_east" / f"seed-00{seed}") == comparable(alone)
    data = manifest(tmp_path / "all")
    assert [item["name"] for item in data["items"]] == [f"north_east/seed-00{seed}" for seed in (2, 1)]
    assert all(item["state"] == "done" for item in data["items"])
    assert data["items"][0]["adherence"]["layers"]["mountain"]["shapes"] == 1
    assert data["items"][0]["timings"]["ground"] > 0


def test_changes_of_layers_are_reported(call, sketch, tmp_path):
    shutil.copytree(sketch, tmp_path / "mine")
    layer = LAYERS["mountain"]
    picture = Image.fromarray(np.where(np.eye(48, 64), 0, 1).astype(np.uint8))
    picture.putpalette((*layer.colour, 0, 0, 0))
    picture.save(tmp_path / "mine" / "mountain.png")
    for command in ("batch", "export"):
        done = call(command, tmp_path / "mine", "-o", tmp_path / command, "--to", "raw", "--size", 10**6)
        assert done.code == 3  # too large
        assert "sketchterrain: note: mountain.png: colours decide" in done.err


@pytest.mark.slow
def test_options_override_the_sweep_file(call, sketch, tmp_path):
    file = tmp_path / "sweep.toml"
    file.write_text(
        f'sketches = "{sketch}"\nseeds = "1-50"\nsize = 33\npreview = false\n[set]\nfidelity = [0, 1]\n'
    )
    options = ("--seeds", 2, "--size", 17, "--foliage", "none", "--json")
    done = call("batch", "--sweep", file, "-o", tmp_path / "out", *options)
    data = json.loads(done.out)
    assert (done.code, data["made"]) == (0, 2)
    assert [item["settings"] for item in data["items"]] == [{"fidelity": 0.0}, {"fidelity": 1.0}]
    report = json.loads((tmp_path / "out" / data["items"][0]["name"] / "report.json").read_text())
    assert report["size"]["columns"] == 17


@pytest.mark.slow
def test_target_files_equal_those_of_export(call, sketch, tmp_path):
    options = ("--to", "raw", "--size", 17, "--tiles", "2x1", "--heights=-100,900")
    done = call("batch", sketch, "-o", tmp_path / "all", "--seeds", 4, *options, "--no-preview")
    assert done.code == 0, done.err
    assert call("export", sketch, "-o", tmp_path / "alone", "--seed", 4, *options).code == 0
    folder = tmp_path / "all" / "north_east" / "seed-004"
    found = {path.name: path.read_bytes() for path in folder.iterdir()}
    report = json.loads(found.pop("report.json"))
    assert found == {path.name: path.read_bytes() for path in (tmp_path / "alone").iterdir()}
    assert (report["target"], report["seed"]) == ("raw", 4)
    assert sorted(report["files"]) == sorted([*found, "report.json"])
    assert manifest(tmp_path / "all")["items"][0]["adherence"]["lost"] == 0


@pytest.mark.slow
def test_failed_items_are_listed_in_a_table(call, sketch, tmp_path):
    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / "sketch.toml").write_text("extent = 'far'")
    out = tmp_path / "out"
    done = call("batch", tmp_path / "broken", sketch, "-o", out, "--seeds", "1-2", *QUICK)
    assert done.code == 5
    table = [line for line in done.err.splitlines() if line.startswith("broken/seed-00")]
    assert len(table) == 2
    assert all("failed" in line and "broken/sketch.toml" in line for line in table)
    assert done.err.endswith("error: 2 of 4 terrains failed; --resume tries them again\n")
    assert (out / "north_east" / "seed-002" / "height.tif").exists()
    save_sketch(load_sketch(str(sketch)), tmp_path / "broken")
    again = call("batch", tmp_path / "broken", sketch, "-o", out, "--seeds", "1-2", *QUICK, "--resume")
    assert again.code == 0
    assert "2 terrains written in" in again.out
    assert "2 unchanged" in again.out


def test_a_dry_run_writes_nothing(call, sketch, tmp_path):
    out = tmp_path / "out"
    arguments = ("batch", sketch, "-o", out, "--seeds", "1-2", *QUICK, "--dry-run")
    done = call(*arguments)
    assert (done.code, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[:2] == [f"north_east/seed-00{seed}  to make" for seed in (1, 2)]
    assert [line.split(":")[0] for line in lines[3:]] == ["disk", "memory"]
    assert not out.exists()
    data = json.loads(call(*arguments, "--json").out)
    assert [item["vertices"] for item in data["items"]] == [17 * 13] * 2
    assert data["disk"]["needed"] < data["disk"]["left"]
    call("batch", sketch, "-o", out, "--seeds", "1", *QUICK)
    data = json.loads(call(*arguments, "--json", "--resume").out)
    assert [item["state"] for item in data["items"]] == ["there", "to make"]
    assert call(*arguments).code == 3  # as without --dry-run
    (tmp_path / "file").write_text("mine")
    there = call("batch", sketch, "-o", tmp_path / "file" / "x", *QUICK, "--dry-run")
    assert (there.code, "is a file" in there.error) == (3, True)


@pytest.mark.gl
@pytest.mark.slow
def test_previews_equal_those_of_generate_on_a_contact_sheet(call, sketch, tmp_path, monkeypatch):
    monkeypatch.setattr(SnapshotRenderer.__init__, "__defaults__", ((320, 180),))
    done = call("batch", sketch, "-o", tmp_path / "all", "--seeds", 2, "--size", 17)
    assert done.code == 0, done.err
    assert f"contact sheet: {tmp_path / 'all' / 'sheet.png'}" in done.out
    assert call("generate", sketch, "-o", tmp_path / "alone", "--seed", 2, "--size", 17).code == 0
    there = tmp_path / "all" / "north_east" / "seed-002"
    assert comparable(there) == comparable(tmp_path / "alone")
    with Image.open(tmp_path / "all" / "sheet.png") as sheet, Image.open(there / "preview.png") as preview:
        small = np.asarray(preview.resize((400, 225), Image.Resampling.BOX)).astype(int)
        thumbnail = np.asarray(sheet)[12 : 12 + 225, 12 : 12 + 400].astype(int)
    assert (small == thumbnail).all()


@pytest.mark.slow
@needs_known_device
def test_failed_device_is_replaced_for_all_items(call, sketch, tmp_path, monkeypatch):
    assert call("batch", sketch, "-o", tmp_path / "whole", "--seeds", "1-3", *QUICK).code == 0
    launch, used = ComputeContext.launch, []

    def failing(context: ComputeContext, *given: Any, **named: Any) -> None:
        used.append(context.device.index)
        if context.device.index == used[0] and len(used) > 5:
            raise DeviceFailedError(f"{context.device.name} is gone")
        launch(context, *given, **named)

    monkeypatch.setattr(ComputeContext, "launch", failing)
    done = call("batch", sketch, "-o", tmp_path / "out", "--seeds", "1-3", "--jobs", 1, *QUICK)
    assert done.code == 0, done.err
    assert len(set(used)) == 2
    assert used == sorted(used, key=lambda index: index != used[0])  # never back to the one that failed
    notes = [item["notes"] for item in manifest(tmp_path / "out")["items"]]
    assert [len(each) for each in notes] == [1, 0, 0]
    for seed in (1, 2, 3):
        both = (comparable(tmp_path / name / "north_east" / f"seed-00{seed}") for name in ("whole", "out"))
        one, other = ({name: each for name, each in found.items() if name != "report.json"} for found in both)
        assert one == other
