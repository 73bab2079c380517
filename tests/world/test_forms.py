"""Every form of output is gone on with, verified and mended alike, plants too."""

from dataclasses import replace
from pathlib import Path

import pytest

from sketchterrain.errors import InputError
from sketchterrain.world.grid import World
from sketchterrain.world.job import Job, shard_store, task_count
from sketchterrain.world.journal import check_world, load_ledger
from sketchterrain.world.run import run_world

FORMS = {
    "zarr, parquet": ("world.zarr", {"form": "zarr", "plants": "parquet"}),
    "tiles, flatgeobuf": ("world", {"form": "tiles", "plants": "flatgeobuf", "layers": ("height",)}),
    "tif": ("world.tif", {"form": "tif", "layers": ("height", "materials")}),
    "tif, parquet": ("world.tif", {"form": "tif", "plants": "parquet", "layers": ("height",)}),
}


class _StoppedError(Exception):
    pass


@pytest.fixture(params=FORMS)
def formed(request, small_job, tmp_path: Path) -> Job:
    name, changes = FORMS[request.param]
    world = World(-20.0, 250.0, 300.0, 254.0, 0.125)
    (tmp_path / "mine").mkdir()
    return replace(small_job, output=tmp_path / "mine" / name, world=world, **changes)


@pytest.mark.slow
def test_stopped_damaged_and_mended(formed: Job, reporter, tmp_path: Path, tree) -> None:
    whole, heard_type = replace(formed, output=tmp_path / "whole" / formed.output.name), type(reporter)
    done = run_world(whole, reporter=reporter)
    expected = tree(tmp_path / "whole")
    assert done.tasks == done.computed == task_count(formed)
    assert list(check_world(whole.output, progress=lambda _: None)) == []

    stopped = heard_type()
    stopped.task_finished = lambda made: stopped.done.append(made) or _stop(len(stopped.done) == 3)
    with pytest.raises(_StoppedError):
        run_world(formed, reporter=stopped)
    assert len(load_ledger(formed, shard_store(formed)).done) == 3
    with pytest.raises(InputError, match="is not finished"):
        check_world(formed.output, progress=lambda _: None)
    again = heard_type()
    run_world(formed, resume=True, reporter=again)
    assert again.counts == [(done.tasks, 3)]
    assert tree(tmp_path / "mine") == expected

    largest = max((tmp_path / "mine").rglob("*"), key=lambda path: path.is_file() and path.stat().st_size)
    content = largest.read_bytes()
    largest.write_bytes(content[:100] + bytes([content[100] ^ 1]) + content[101:])
    (found,) = check_world(formed.output, progress=lambda _: None)
    assert found.file.endswith(largest.name)
    third = heard_type()
    mended = run_world(formed, resume=True, reporter=third)
    assert mended.broken == (found,)
    assert mended.computed >= 1
    assert tree(tmp_path / "mine") == expected
    assert (mended.files, mended.bytes) == (done.files, done.bytes)


def _stop(now: bool) -> None:
    if now:
        raise _StoppedError
