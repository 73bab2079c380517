"""A world that was disturbed in any way, and gone on with, has the bytes of one that never was."""

from __future__ import annotations

import errno
import os
import shutil
import signal
from dataclasses import replace
from types import SimpleNamespace
from typing import TYPE_CHECKING

import pytest

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.world.grid import World
from sketchterrain.world.journal import exclusive_run
from sketchterrain.world.run import run_world
from sketchterrain.world.verification import check_world

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from sketchterrain.world.job import Job
    from sketchterrain.world.tasks import TaskResult

TASKS = 9
HEIGHT = "0/height/c/0/1"
NORMAL = "0/normal/c/0/0/2"


@pytest.fixture
def copied(job: Job, whole_world: Path) -> Path:
    """A finished world of the test's own."""
    shutil.copytree(whole_world, job.output)
    return job.output


class _StoppedError(Exception):
    pass


def stopping(heard, after: int):
    """Return a watcher that ends the run once so many tasks are done."""

    def made(made: TaskResult) -> None:
        heard.done.append(made)
        if len(heard.done) == after:
            raise _StoppedError

    heard.made = made
    return heard


def test_a_run_makes_every_task_once_and_leaves_nothing_else(job, heard, whole_world, tree) -> None:
    done = run_world(job, watcher=heard)
    assert heard.counts == [(TASKS, 0)]
    assert len({made.task for made in heard.done}) == len(heard.done) == TASKS
    assert done.tasks == done.made == TASKS
    assert done.broken == ()
    files = tree(job.output)
    assert files == tree(whole_world)
    assert not [name for name in files if name.split("/")[-1].startswith(".") or "journal" in name]
    assert all({"evaluate", "write"} == set(made.parts) for made in heard.done)


def test_a_run_that_ends_early_is_gone_on_with(job, heard, whole_world, tree) -> None:
    with pytest.raises(_StoppedError):
        run_world(job, watcher=stopping(heard, 4))
    with pytest.raises(InputError, match="there is a world; --resume completes it"):
        run_world(job, watcher=heard)
    again = type(heard)()
    done = run_world(job, resume=True, watcher=again)
    assert again.counts == [(TASKS, 4)]
    assert (done.made, done.broken) == (TASKS - 4, ())
    assert tree(job.output) == tree(whole_world)


def test_a_finished_world_is_verified_and_left(job, copied, heard, whole_world, tree) -> None:
    before = (copied / HEIGHT).stat().st_mtime_ns
    done = run_world(job, resume=True, watcher=heard)
    assert (done.made, done.broken, heard.counts) == (0, (), [])
    assert heard.shares[-1] == pytest.approx(1.0)
    assert (copied / HEIGHT).stat().st_mtime_ns == before
    assert tree(copied) == tree(whole_world)


def swap(folder: Path) -> list[str]:
    one, other = folder / HEIGHT, folder / "0/height/c/0/0"
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)
    return [HEIGHT, "0/height/c/0/0"]


def damage(folder: Path, name: str, change: Callable[[bytes], bytes]) -> list[str]:
    path = folder / name
    path.write_bytes(change(path.read_bytes()))
    return [name]


def lose(folder: Path, *names: str) -> list[str]:
    for name in names:
        (folder / name).unlink()
    return list(names)


def lose_half(folder: Path) -> list[str]:
    shutil.rmtree(folder / "0")
    return ["0/zarr.json", HEIGHT, NORMAL]


DISTURBED = {
    "a bit of a shard": lambda folder: damage(
        folder, HEIGHT, lambda content: content[:99] + bytes([content[99] ^ 1]) + content[100:]
    ),
    "a shard cut off": lambda folder: damage(folder, NORMAL, lambda content: content[: len(content) // 2]),
    "a shard emptied": lambda folder: damage(folder, NORMAL, lambda _: b""),
    "shards in each other's place": swap,
    "half of it deleted": lose_half,
    "metadata": lambda folder: lose(folder, "0/height/zarr.json", "2/x/c/0"),
    "other metadata": lambda folder: damage(folder, "0/height/zarr.json", lambda content: content + b" "),
}


@pytest.mark.parametrize("how", DISTURBED)
def test_what_is_broken_is_named_and_mended(how, job, copied, heard, whole_world, tree) -> None:
    names = DISTURBED[how](copied)
    found = {each.file for each in check_world(copied, progress=lambda _: None)}
    assert set(names) <= found
    done = run_world(job, resume=True, watcher=heard)
    assert {each.file for each in done.broken} == found
    assert heard.found == list(done.broken)
    assert done.made < TASKS
    assert tree(copied) == tree(whole_world)
    assert list(check_world(copied, progress=lambda _: None)) == []


@pytest.mark.parametrize("lost", ["zarr.json", "ledger/zarr.json"])
def test_metadata_that_changes_at_the_end_is_written_again(
    lost, job, copied, heard, whole_world, tree
) -> None:
    (copied / lost).unlink()
    assert run_world(job, resume=True, watcher=heard).made == 0
    assert tree(copied) == tree(whole_world)


def test_without_its_ledger_all_is_made_again(job, copied, heard, whole_world, tree) -> None:
    (copied / "ledger" / "c" / "0").unlink()
    (copied / "0/height/c/0/77").write_bytes(b"of no task")
    assert run_world(job, resume=True, watcher=heard).made == TASKS
    assert tree(copied) == tree(whole_world)


@pytest.mark.parametrize("how", ["a line broken", "a line lost"])
def test_a_ledger_that_tells_of_less_is_mended(how, job, copied, heard, whole_world, tree) -> None:
    ledger = copied / "ledger" / "c" / "0"
    lines = ledger.read_bytes().splitlines(keepends=True)
    lines[4:5] = [b"{" + lines[4]] if how == "a line broken" else []
    ledger.write_bytes(b"".join(lines))
    named = [("ledger", "has broken lines: 1")] if how == "a line broken" else []
    assert [(*each,) for each in check_world(copied, progress=lambda _: None)] == named
    done = run_world(job, resume=True, watcher=heard)
    assert (done.made, [(*each,) for each in done.broken]) == (1, named)
    assert tree(copied) == tree(whole_world)


def test_a_ledger_without_its_second_line_is_mended(job, copied, heard, whole_world, tree) -> None:
    ledger = copied / "ledger" / "c" / "0"
    first, _, *rest = ledger.read_bytes().splitlines(keepends=True)
    ledger.write_bytes(b"".join([first, *rest]))
    named = [("ledger", "does not name the files that belong to the whole")]
    assert [(*each,) for each in check_world(copied, progress=lambda _: None)] == named
    done = run_world(job, resume=True, watcher=heard)
    assert (done.made, [(*each,) for each in done.broken]) == (0, named)
    assert tree(copied) == tree(whole_world)


def test_a_journal_that_is_lost_or_cut_off(job, heard, whole_world, tree) -> None:
    with pytest.raises(_StoppedError):
        run_world(job, watcher=stopping(heard, 5))
    journal = job.output / "ledger" / "journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-20])
    again = type(heard)()
    with pytest.raises(_StoppedError):
        run_world(job, resume=True, watcher=stopping(again, 1))
    assert again.counts == [(TASKS, 4)]
    third = type(heard)()
    with pytest.raises(_StoppedError):
        run_world(job, resume=True, watcher=stopping(third, 1))
    assert third.counts == [(TASKS, 5)]
    journal.unlink()
    assert run_world(job, resume=True, watcher=heard).made == TASKS
    assert tree(job.output) == tree(whole_world)


def test_damage_amid_the_work_is_found_too(job, heard, whole_world, tree) -> None:
    with pytest.raises(_StoppedError):
        run_world(job, watcher=stopping(heard, 8))
    name = heard.done[6].files[0].file
    damage(job.output, name, lambda content: content[:-1])
    again = type(heard)()
    with pytest.raises(_StoppedError):
        run_world(job, resume=True, watcher=stopping(again, 1))
    assert [each.file for each in again.found] == [name]
    done = run_world(job, resume=True, watcher=type(heard)())
    assert done.broken == ()
    assert tree(job.output) == tree(whole_world)


def test_half_written_files_of_a_killed_run_are_swept(job, heard, whole_world, tree) -> None:
    with pytest.raises(_StoppedError):
        run_world(job, watcher=stopping(heard, 3))
    (job.output / HEIGHT).parent.mkdir(parents=True)
    (job.output / HEIGHT).with_name(".1.0123abcd.tmp").write_bytes(b"half")
    (job.output / HEIGHT).write_bytes(b"told of in no journal")
    (job.output / "notes.txt").write_text("mine")
    run_world(job, resume=True, watcher=heard)
    assert (job.output / "notes.txt").read_text() == "mine"
    (job.output / "notes.txt").unlink()
    assert tree(job.output) == tree(whole_world)


@pytest.mark.parametrize("at", ["shard", "journal", "metadata"])
def test_a_full_disk_is_told_and_gone_on_with(at, job, heard, whole_world, tree, monkeypatch) -> None:
    full = {"shard": HEIGHT, "journal": "ledger/journal.jsonl", "metadata": "1/zarr.json"}[at]
    if at == "journal":
        monkeypatch.setattr("sketchterrain.world.journal.os", SimpleNamespace(fsync=_no_room))
        monkeypatch.setattr("sketchterrain.world.journal._SYNC", -1.0)
    else:
        replaced = type(job.output).replace

        def replace_(path: Path, target: Path) -> Path:
            if target == job.output / full:
                _no_room()
            return replaced(path, target)

        monkeypatch.setattr(type(job.output), "replace", replace_)
    with pytest.raises(SketchterrainError, match="No space left") as caught:
        run_world(job, watcher=heard)
    monkeypatch.undo()
    assert str(caught.value) == f"{job.output / full}: cannot be written (No space left on device)"
    assert caught.value.exit_code == 1
    run_world(job, resume=True, watcher=heard)
    assert tree(job.output) == tree(whole_world)


def _no_room(*_: object) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("way", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_lets_what_is_begun_be_written(way, job, heard, whole_world, tree) -> None:
    def made(made: TaskResult) -> None:
        heard.done.append(made)
        if len(heard.done) == 2:
            os.kill(os.getpid(), way)

    heard.made = made
    with pytest.raises(KeyboardInterrupt):
        run_world(job, watcher=heard)
    assert 2 <= len(heard.done) <= 4
    again = type(heard)()
    run_world(job, resume=True, watcher=again)
    assert again.counts == [(TASKS, len(heard.done))]
    assert tree(job.output) == tree(whole_world)


def test_a_signal_ends_verifying_at_once(job, copied, heard, whole_world, tree) -> None:
    def verified(share: float) -> None:
        heard.shares.append(share)
        if len(heard.shares) == 3:
            os.kill(os.getpid(), signal.SIGINT)

    heard.verified = verified
    with pytest.raises(KeyboardInterrupt):
        run_world(job, resume=True, watcher=heard)
    assert len(heard.shares) == 3
    assert tree(copied) == tree(whole_world)
    assert run_world(job, resume=True, watcher=type(heard)()).made == 0
    assert tree(copied) == tree(whole_world)


@pytest.mark.parametrize("while_it", ["verifies", "joins"])
def test_a_signal_ends_what_takes_long_besides(while_it, job, heard, tree) -> None:
    job = replace(job, output=job.output.with_suffix(".tif"), form="tif")
    if while_it == "verifies":
        run_world(job, watcher=heard)
    heard.shares.clear()

    def tell(share: float) -> None:
        heard.shares.append(share)
        os.kill(os.getpid(), signal.SIGTERM)

    setattr(heard, {"verifies": "verified", "joins": "joined"}[while_it], tell)
    before = tree(job.output.parent)
    with pytest.raises(KeyboardInterrupt):
        run_world(job, resume=while_it == "verifies", watcher=heard)
    assert len(heard.shares) == 1
    run_world(job, resume=True, watcher=type(heard)())
    if before:
        assert tree(job.output.parent) == before
    assert sorted(tree(job.output.parent)) == [
        f"world{name}" for name in (".ledger.jsonl", ".tif", "_materials.tif", "_normal.tif")
    ]


def test_two_runs_at_once_are_refused(job, heard) -> None:
    with exclusive_run(job.output), pytest.raises(InputError, match="another run is writing it"):
        run_world(job, resume=True, watcher=heard)
    assert not job.output.exists()


def test_what_is_something_else_is_refused_and_left(job, heard, tree) -> None:
    job.output.mkdir()
    (job.output / "letter.txt").write_text("dear")
    for resume in (False, True):
        with pytest.raises(InputError, match="there is something else; take another output"):
            run_world(job, resume=resume, watcher=heard)
    assert list(tree(job.output)) == ["letter.txt"]
    file = replace(job, output=job.output / "letter.txt")
    with pytest.raises(InputError, match="expected a folder to write into, this is a file"):
        run_world(file, watcher=heard)
    below = replace(job, output=job.output / "letter.txt" / "world.zarr")
    with pytest.raises(InputError, match=r"letter\.txt is a file"):
        run_world(below, watcher=heard)


def test_another_world_is_refused(job, copied, heard, whole_world, tree) -> None:
    for other in (
        replace(job, world=World(-20.0, 250.0, 492.0, 254.0, 0.125)),
        replace(job, step=0.5),
        replace(job, layers=("height",)),
        replace(job, sketch=replace(job.sketch, seed=job.sketch.seed + 1)),
    ):
        with pytest.raises(InputError, match="made from another sketch, seed, bounds or options"):
            run_world(other, resume=True, watcher=heard)
    assert tree(copied) == tree(whole_world)


def test_a_ledger_of_another_version_is_refused_by_its_version(job, copied, heard) -> None:
    ledger = copied / "ledger" / "c" / "0"
    head, rest = ledger.read_text().split("\n", 1)
    ledger.write_text(head.replace('"version":"', '"version":"0.0.') + "\n" + rest)
    with pytest.raises(InputError, match=r"begun by version 0\.0\."):
        run_world(job, resume=True, watcher=heard)
