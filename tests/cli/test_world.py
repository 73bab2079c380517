"""`world` and `stats`."""

import contextlib
import io
import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sketchterrain.app.cli import main
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import build
from sketchterrain.world.stored_world import open_world

SMALL = ("--bounds", "-10,20,310,180", "--cell", 4)


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_world_is_the_terrain_at_its_vertices(call, sketch, tmp_path):
    out = tmp_path / "world.zarr"
    done = call("world", sketch, *SMALL, "-o", out)
    assert done.code == 0, done.err
    first, second = done.out.splitlines()
    assert first.startswith("1 of 1 shard written in ")
    assert first.endswith(str(out))
    assert second.startswith("3 321 vertices on 1 level, ")
    assert [line.split(":")[0] for line in done.err.splitlines() if not line.endswith("…")][:2] == [
        "world",
        "disk",
    ]
    stored = open_world(out)
    level = stored.levels[0]
    assert (level.columns, level.rows, level.cell) == (81, 41, 4.0)
    x = stored.west + level.cell * np.arange(level.columns)
    y = stored.north - level.cell * np.arange(level.rows)
    terrain = build(load_sketch(sketch))
    height = stored.read("height", 0, top=0, left=0, rows=level.rows, columns=level.columns)
    assert (height == terrain.heights(x[None], y[:, None], cell_size=4.0)).all()


@pytest.fixture(scope="module")
def written(sketch, tmp_path_factory) -> tuple[Path, dict[str, Any]]:
    """Return a world of the sketch, one vertex a metre, and what the command reports."""
    out, report = tmp_path_factory.mktemp("worlds") / "world.zarr", io.StringIO()
    with contextlib.redirect_stdout(report):
        assert main(["world", str(sketch), "--cell", "1", "-o", str(out), "--json"]) == 0
    return out, json.loads(report.getvalue())


def test_dry_run_estimates_the_run(call, sketch, written, tmp_path):
    out, done = written
    new = tmp_path / "some" / "world.zarr"
    command = ("world", sketch, "--cell", 1, "-o", new)
    listed = call(*command, "--dry-run")
    assert listed.code == 0, listed.err
    assert [line.split(":")[0] for line in listed.out.splitlines()] == ["world", "disk", "memory"]
    data = json.loads(call(*command, "--dry-run", "--json").out)
    assert not new.parent.exists()
    assert (data["columns"], data["rows"], data["levels"], data["tasks"]) == (513, 385, 3, 3)
    assert data["memory"]["needed"] < data["memory"]["left"]
    assert done["estimate"]["vertices"] == data["vertices"]
    assert done["bytes"] < sum(data["disk"]["parts"].values()) < 4 * done["bytes"]
    listed = {name: each for name, each in files(out).items() if name != "zarr.json" and "ledger" not in name}
    assert (done["bytes"], done["files"]) == (sum(len(each) for each in listed.values()), len(listed))
    assert (done["tasks"], done["made"], done["broken"]) == (3, 3, [])
    assert done["seconds"] > 0
    command = (*command[:-1], out, "--dry-run")
    assert call(*command).code == 3  # as the run
    again = json.loads(call(*command, "--resume", "--json").out)
    assert (again["done"], again["disk"]["there"]) == (3, done["bytes"])


def test_broken_files_are_listed_and_repaired(call, sketch, tmp_path):
    out = tmp_path / "world.zarr"
    assert call("world", sketch, *SMALL, "-o", out).code == 0
    before = files(out)
    (out / "0/height/c/0/0").unlink()
    (out / "0/normal/c/0/0/0").write_bytes(b"nothing")
    checked = call("stats", out, "--check")
    assert checked.code == 5
    assert "0/height/c/0/0 is missing" in checked.out
    assert "0/normal/c/0/0/0 has 7 bytes" in checked.out
    assert checked.err.splitlines()[-1] == (
        "sketchterrain: error: 2 files are missing or broken; `world --resume` repairs them"
    )
    data = json.loads(call("stats", out, "--check", "--json").out)
    assert [each["file"] for each in data["broken"]] == ["0/height/c/0/0", "0/normal/c/0/0/0"]
    again = call("world", sketch, *SMALL, "-o", out, "--resume")
    assert again.code == 0, again.err
    assert "0/height/c/0/0 is missing: will be rewritten" in again.err
    assert files(out) == before
    assert call("stats", out, "--check").out == f"{out}: all files are intact\n"
    other = call("world", sketch, *SMALL, "-o", out, "--resume", "--seed", 99)
    assert (other.code, "another sketch, seed, bounds" in other.error) == (3, True)
    existing = call("world", sketch, *SMALL, "-o", out)
    assert (existing.code, "--resume completes it" in existing.error) == (3, True)


def test_geotiff_worlds_equal_the_zarr_world(call, sketch, tmp_path):
    options = (*SMALL, "--layers", "height,materials", "--step", 0.0625)
    outputs = [tmp_path / name for name in ("world.zarr", "world.tif", "tiles")]
    for out in outputs:
        done = call("world", sketch, *options, "-o", out)
        assert done.code == 0, done.err
    zarr, *others = ({**json.loads(call("stats", out, "--json").out), "world": ""} for out in outputs)
    assert others == [zarr, zarr]
    for out in outputs[1:]:
        assert call("stats", out, "--check").code == 0


def test_disk_space_is_checked_first(call, sketch, tmp_path):
    out = tmp_path / "world.zarr"
    for more in ((), ("--dry-run",)):
        vast = call("world", sketch, "--bounds", "0,0,4e6,4e6", "-o", out, *more)
        assert vast.code == 3
        assert "4000001 × 4000001 vertices" in vast.out + vast.err
        assert "the world's files need up to" in vast.err.splitlines()[-1]
    assert not out.exists()


def test_statistics_match_the_heights(call, written):
    out, _ = written
    data = json.loads(call("stats", out, "--json").out)
    stored = open_world(out)
    height = stored.read("height", 0, top=0, left=0, rows=data["rows"], columns=data["columns"])
    assert (data["columns"], data["rows"], data["cell"], data["area"]) == (513, 385, 1.0, 512.0 * 384.0)
    assert data["relief"]["minimum"] == float(height.min())
    assert data["relief"]["maximum"] == float(height.max())
    assert data["relief"]["mean"] == pytest.approx(height.mean(dtype=np.float64))
    assert data["relief"]["quantiles"]["0.5"] == pytest.approx(np.median(height), abs=0.01)
    assert math.fsum(data["slopes"]["shares"]) == pytest.approx(1.0)
    assert math.fsum(data["materials"].values()) == pytest.approx(1.0)
    assert data["hypsometry"]["share_above"][0] == 1.0
    assert data["hypsometry"]["share_above"][-1] == 0.0
    below = np.mean(height > data["hypsometry"]["heights"][5])
    assert data["hypsometry"]["share_above"][5] == pytest.approx(below, abs=1e-3)
