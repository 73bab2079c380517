"""What a world takes: disk and memory before the start, beside what it took."""

from dataclasses import replace
from pathlib import Path

import pytest

from sketchterrain.app import estimates as shared
from sketchterrain.errors import InputError
from sketchterrain.world.grid import World
from sketchterrain.world.job import Job
from sketchterrain.world.options import estimate_world

VAST = World(0.0, 0.0, 4e6, 4e6, 1.0)


def test_disk_follows_vertices_layers_and_form(small_job: Job, tmp_path: Path) -> None:
    job = replace(small_job, world=World(0.0, 0.0, 512.0, 512.0, 1.0), output=tmp_path / "w.zarr")
    found = estimate_world(job)
    assert set(found.needs.disk) == {"height", "normal", "materials"}
    four = estimate_world(replace(job, world=World(0.0, 0.0, 1024.0, 1024.0, 1.0)))
    assert four.needs.disk_needed / found.needs.disk_needed == pytest.approx(4.0, rel=0.02)
    rounded = estimate_world(replace(job, step=2.0**-7))
    assert rounded.needs.disk["height"] < found.needs.disk["height"] / 2
    joined = estimate_world(replace(job, form="tif", output=tmp_path / "w.tif"))
    assert joined.needs.disk_needed == 2 * found.needs.disk_needed
    planted = estimate_world(replace(job, plants="parquet"))
    beyond = estimate_world(replace(job, plants="parquet", world=World(600.0, 0.0, 900.0, 300.0, 1.0)))
    assert planted.needs.disk["plants"] > 0 == beyond.needs.disk["plants"]


def test_memory_is_what_a_shard_takes(small_job: Job, tmp_path: Path) -> None:
    job = replace(small_job, world=VAST, output=tmp_path / "w.zarr")
    alone, three = (estimate_world(job, workers=count).needs.memory for count in (0, 3))
    assert 400e6 < alone < 700e6
    assert three > 3 * alone
    assert estimate_world(small_job).needs.memory < alone


def test_too_little_disk_or_memory_is_refused(
    small_job: Job, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(InputError, match="the world's files need up to"):
        estimate_world(replace(small_job, world=VAST, output=tmp_path / "w.zarr")).check_resources()
    monkeypatch.setattr(shared, "free_memory", lambda: 1 << 20)
    with pytest.raises(InputError, match=r"of memory at once, 1\.0 MiB are free"):
        estimate_world(replace(small_job, output=tmp_path / "w.zarr")).check_resources()
