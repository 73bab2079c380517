"""`sketchterrain world`: what it will take, what it writes, and what it refuses before it writes."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import build
from sketchterrain.world import estimate as estimated
from sketchterrain.world import run as running
from sketchterrain.world import samples, scheduler
from sketchterrain.world.opening import open_world
from sketchterrain.world.run import Done

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sketchterrain.world.job import Job

SMALL = ("--bounds", "-10,20,310,180", "--cell", 4)


def files(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_a_world_is_the_terrain_at_its_vertices(
    call: Callable[..., Any], sketch: Path, tmp_path: Path
) -> None:
    out = tmp_path / "world.zarr"
    done = call("world", sketch, *SMALL, "-o", out)
    assert done.code == 0, done.err
    first, second = done.out.splitlines()
    assert first.startswith("1 of 1 task done in ")
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


@pytest.mark.slow
def test_a_dry_run_writes_nothing_and_tells_what_the_run_takes(
    call: Callable[..., Any], sketch: Path, tmp_path: Path
) -> None:
    out = tmp_path / "some" / "world.zarr"
    wanted = ("world", sketch, "--cell", 1, "-o", out)
    shown = call(*wanted, "--dry-run")
    assert shown.code == 0, shown.err
    assert [line.split(":")[0] for line in shown.out.splitlines() if line[0] != " "] == [
        "world",
        "disk",
        "memory",
        "time",
    ]
    told = json.loads(call(*wanted, "--dry-run", "--json").out)
    assert not out.parent.exists()
    assert (told["columns"], told["rows"], told["levels"]) == (513, 385, 3)
    assert told["memory"]["needed"] < told["memory"]["left"]
    done = json.loads(call(*wanted, "--json").out)
    assert done["estimate"]["vertices"] == told["vertices"]
    assert sum(told["disk"]["parts"].values()) == pytest.approx(done["bytes"], rel=0.2)
    for layer in ("height", "normal", "materials"):
        there = sum(path.stat().st_size for path in out.glob(f"*/{layer}/**/*") if path.is_file())
        assert told["disk"]["parts"][layer] == pytest.approx(there, rel=0.25)
    listed = {name: each for name, each in files(out).items() if name != "zarr.json" and "ledger" not in name}
    assert (done["bytes"], done["files"]) == (sum(len(each) for each in listed.values()), len(listed))
    assert (done["tasks"], done["made"], done["broken"]) == (3, 3, [])
    assert done["seconds"] > 0
    assert call(*wanted, "--dry-run").code == 3  # as the run
    again = json.loads(call(*wanted, "--dry-run", "--resume", "--json").out)
    assert (again["done"], again["disk"]["needed"] < told["disk"]["needed"] / 3) == (3, True)


def test_what_is_lost_is_named_and_made_again(call: Callable[..., Any], sketch: Path, tmp_path: Path) -> None:
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
        "sketchterrain: error: 2 files are missing or broken; `world --resume` mends them"
    )
    told = json.loads(call("stats", out, "--check", "--json").out)
    assert [each["file"] for each in told["broken"]] == ["0/height/c/0/0", "0/normal/c/0/0/0"]
    again = call("world", sketch, *SMALL, "-o", out, "--resume")
    assert again.code == 0, again.err
    assert "0/height/c/0/0 is missing: is made again" in again.err
    assert files(out) == before
    assert call("stats", out, "--check").out == f"{out}: every file is as it was written\n"
    other = call("world", sketch, *SMALL, "-o", out, "--resume", "--seed", 99)
    assert (other.code, "another sketch, seed, bounds" in other.error) == (3, True)
    taken = call("world", sketch, *SMALL, "-o", out)
    assert (taken.code, "--resume goes on with it" in taken.error) == (3, True)


@pytest.mark.parametrize("name", ["world.tif", "tiles"])
def test_geotiffs_are_the_same_world(
    name: str, call: Callable[..., Any], sketch: Path, tmp_path: Path
) -> None:
    words = (*SMALL, "--layers", "height,materials", "--step", 0.0625)
    whole = [tmp_path / "world.zarr", tmp_path / name]
    for out in whole:
        done = call("world", sketch, *words, "-o", out)
        assert done.code == 0, done.err
    zarr, tiff = ({**json.loads(call("stats", out, "--json").out), "world": ""} for out in whole)
    assert zarr == tiff
    assert call("stats", whole[1], "--check").code == 0


def test_no_room_is_told_before_anything_is_written(
    call: Callable[..., Any], sketch: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(samples, "_MOST", 6 << 16)
    out = tmp_path / "world.zarr"
    vast = call("world", sketch, "--bounds", "0,0,4e6,4e6", "-o", out, "--dry-run")
    assert vast.code == 3
    assert "4000001 × 4000001 vertices" in vast.out
    assert "the world's files need up to" in vast.err.splitlines()[-1]
    monkeypatch.setattr(estimated, "memory_left", lambda: 1 << 20)
    tight = call("world", sketch, *SMALL, "-o", out)
    assert tight.code == 3
    assert "of memory at once, 1.0 MiB are left" in tight.err.splitlines()[-1]
    assert not out.exists()


@pytest.mark.parametrize(
    ("words", "asked"),
    [
        ((), {"workers": None, "scheduler": None}),
        (("--workers", 3), {"workers": 3, "scheduler": None}),
        (("--scheduler", "tcp://host:1"), {"workers": None, "scheduler": "tcp://host:1"}),
    ],
)
def test_whoever_shall_do_it_is_asked(
    words: tuple[object, ...],
    asked: dict[str, object],
    call: Callable[..., Any],
    sketch: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def run(job: Job, *, resume: bool, watcher: object, **crew: object) -> Done:
        assert (job.sketch.seed, resume) == (7, False)
        assert crew == {"device": None, **asked}
        return Done(tasks=1, made=1, broken=(), files=3, bytes=1000, seconds=1.0)

    monkeypatch.setattr(running, "run_world", run)
    monkeypatch.setattr(scheduler, "check_scheduler", lambda _: None)
    done = call("world", sketch, *SMALL, "-o", tmp_path / "w.zarr", "--seed", 7, *words)
    assert done.code == 0, done.err
    assert "1 of 1 task done in 1 s" in done.out
    shown = "".join(line for line in done.err.splitlines() if line.startswith(("memory", "time")))
    assert ("by 3 workers" in shown, "of one worker" in shown) == (
        "--workers" in words,
        "--scheduler" in words,
    )
