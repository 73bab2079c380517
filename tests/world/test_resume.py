"""Interrupted and damaged worlds, resumed to the bytes of an undisturbed run."""

import errno
import os
import pickle
import random
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import pytest

from sketchterrain.errors import InputError, SketchterrainError
from sketchterrain.world.grid import DEFAULT_LAYERS, World
from sketchterrain.world.job import Job, job_fingerprint, task_count
from sketchterrain.world.journal import (
    Header,
    Journal,
    Ledger,
    check_output_unused,
    check_world,
    load_ledger,
    remove_partial_files,
)
from sketchterrain.world.run import ProgressReporter, run_world
from sketchterrain.world.task_runner import shard_store
from tests.refusals import refused

pytestmark = pytest.mark.usefixtures("evaluated_once")

TASKS = 9
HEIGHT, NORMAL = "0/height/c/0/1", "0/normal/c/0/0/2"
FORMS = {"zarr": "world.zarr", "tiles": "world", "tif": "world.tif"}


@pytest.fixture(scope="module")
def small_job(small_job) -> Job:
    """The job without materials, whose files take longest."""
    return replace(small_job, layers=("height", "normal"))


@pytest.fixture(scope="module")
def finished_world(small_job, tmp_path_factory) -> Path:
    output = tmp_path_factory.mktemp("whole") / "world.zarr"
    run_world(replace(small_job, output=output), reporter=ProgressReporter(show=lambda *_: None))
    return output


@pytest.fixture
def copied(job, finished_world):
    """A copy of a finished world."""
    shutil.copytree(finished_world, job.output)
    return job.output


class _StoppedError(Exception):
    pass


def interrupted_reporter(reporter, after):
    """Return a reporter that ends the run once so many tasks are done."""

    def made(result):
        reporter.done.append(result)
        if len(reporter.done) == after:
            raise _StoppedError

    reporter.task_finished = made
    return reporter


def interrupt(job, reporter, after, *, resume=False):
    with pytest.raises(_StoppedError):
        run_world(job, resume=resume, reporter=interrupted_reporter(reporter, after))
    return reporter


def checked(world):
    return [(*each,) for each in check_world(world, progress=lambda _: None)]


def test_run_computes_each_task_once(job, reporter, finished_world, tree, evaluated_once) -> None:
    evaluated_once.clear()
    done = run_world(job, reporter=reporter)
    assert reporter.counts == [(TASKS, 0)]
    assert len({made.task for made in reporter.done}) == len(reporter.done) == TASKS
    assert (done.tasks, done.computed, done.broken) == (TASKS, TASKS, ())
    files = tree(job.output)
    assert files == tree(finished_world)
    assert not [name for name in files if name.split("/")[-1].startswith(".") or "journal" in name]
    assert [path.name for path in job.output.parent.iterdir()] == [job.output.name]


def test_resume_computes_only_pending_tasks(job, reporter, finished_world, tree) -> None:
    interrupt(job, reporter, 4)
    refused("world exists; --resume completes it", run_world, job, reporter=reporter)
    again = type(reporter)()
    done = run_world(job, resume=True, reporter=again)
    assert (again.counts, done.computed, done.broken) == ([(TASKS, 4)], TASKS - 4, ())
    before = (job.output / HEIGHT).stat().st_mtime_ns
    third = type(reporter)()
    done = run_world(job, resume=True, reporter=third)
    assert (done.computed, done.broken, third.counts) == (0, (), [])
    assert third.shares[-1] == pytest.approx(1.0)
    assert (job.output / HEIGHT).stat().st_mtime_ns == before
    assert tree(job.output) == tree(finished_world)


def swap(folder):
    one, other = folder / HEIGHT, folder / "0/height/c/0/0"
    content = one.read_bytes()
    one.write_bytes(other.read_bytes())
    other.write_bytes(content)
    return [HEIGHT, "0/height/c/0/0"]


def damage(folder, name, change):
    path = folder / name
    path.write_bytes(change(path.read_bytes()))
    return [name]


def lose(folder, *names):
    for name in names:
        (folder / name).unlink()
    return list(names)


def lose_half(folder):
    shutil.rmtree(folder / "0")
    return ["0/zarr.json", HEIGHT, NORMAL]


DAMAGES = {
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


LATER = ("a shard cut off", "other metadata")


@pytest.mark.parametrize(
    "how", [pytest.param(how, marks=pytest.mark.slow) if how in LATER else how for how in DAMAGES]
)
def test_broken_files_are_reported_and_rewritten(how, job, copied, reporter, finished_world, tree) -> None:
    names = DAMAGES[how](copied)
    found = {file for file, _ in checked(copied)}
    assert set(names) <= found
    done = run_world(job, resume=True, reporter=reporter)
    assert {each.file for each in done.broken} == found
    assert reporter.found == list(done.broken)
    assert done.computed < TASKS
    assert tree(copied) == tree(finished_world)
    assert checked(copied) == []


def without_a_line(folder, number, change):
    lines = (folder / "ledger/c/0").read_bytes().splitlines(keepends=True)
    lines[number : number + 1] = change(lines[number])
    (folder / "ledger/c/0").write_bytes(b"".join(lines))


BROKEN, UNNAMED = "has unreadable lines: 1", "does not list the metadata files"
LEDGERS = {
    "a line broken": (lambda folder: without_a_line(folder, 4, lambda line: [b"{" + line]), BROKEN, 1),
    "a line lost": (lambda folder: without_a_line(folder, 4, lambda _: []), "", 1),
    "the second line lost": (lambda folder: without_a_line(folder, 1, lambda _: []), UNNAMED, 0),
    "metadata of the root lost": (lambda folder: lose(folder, "zarr.json"), "", 0),
    "metadata of the ledger lost": (lambda folder: lose(folder, "ledger/zarr.json"), "", 0),
}


@pytest.mark.parametrize("how", LEDGERS)
def test_broken_ledger_is_repaired(how, job, copied, reporter, finished_world, tree) -> None:
    disturb, why, made = LEDGERS[how]
    disturb(copied)
    named = [("ledger", why)] if why else []
    assert checked(copied) == named
    done = run_world(job, resume=True, reporter=reporter)
    assert (done.computed, [(*each,) for each in done.broken]) == (made, named)
    assert tree(copied) == tree(finished_world)


def test_truncated_journal_is_resumed(job, reporter, finished_world, tree) -> None:
    interrupt(job, reporter, 5)
    journal = job.output / "ledger/journal.jsonl"
    journal.write_bytes(journal.read_bytes()[:-20])
    assert interrupt(job, type(reporter)(), 1, resume=True).counts == [(TASKS, 4)]
    assert interrupt(job, type(reporter)(), 1, resume=True).counts == [(TASKS, 5)]
    assert run_world(job, resume=True, reporter=type(reporter)()).computed == TASKS - 6
    assert tree(job.output) == tree(finished_world)


def test_partial_and_damaged_files_of_killed_run_are_replaced(job, reporter, finished_world, tree) -> None:
    interrupt(job, reporter, 8)
    name = reporter.done[6].files[0].file
    damage(job.output, name, lambda content: content[:-1])
    written = {file.file for made in reporter.done for file in made.files}
    unknown = next(each for each in (HEIGHT, "0/height/c/0/0", "0/height/c/0/2") if each not in written)
    (job.output / unknown).write_bytes(b"in no journal")
    (job.output / unknown).with_name(".1.0123abcd.tmp").write_bytes(b"half")
    (job.output / "notes.txt").write_text("mine")
    again = interrupt(job, type(reporter)(), 1, resume=True)
    assert [each.file for each in again.found] == [name]
    assert run_world(job, resume=True, reporter=type(reporter)()).broken == ()
    (job.output / "notes.txt").unlink()
    assert tree(job.output) == tree(finished_world)


@pytest.mark.parametrize("at", ["shard", "journal", "metadata"])
def test_full_disk_is_reported_and_resumed(at, job, reporter, finished_world, tree, monkeypatch) -> None:
    full = {"shard": HEIGHT, "journal": "ledger/journal.jsonl", "metadata": "1/zarr.json"}[at]

    def no_space(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    if at == "journal":
        monkeypatch.setattr(
            "sketchterrain.world.journal.os", SimpleNamespace(**{**vars(os), "fsync": no_space})
        )
    else:
        replaced = type(job.output).replace
        monkeypatch.setattr(
            type(job.output),
            "replace",
            lambda path, target: no_space() if target == job.output / full else replaced(path, target),
        )
    with pytest.raises(SketchterrainError) as caught:
        run_world(job, reporter=reporter)
    monkeypatch.undo()
    assert str(caught.value) == f"{job.output / full}: cannot be written (No space left on device)"
    assert caught.value.exit_code == 1
    run_world(job, resume=True, reporter=reporter)
    assert tree(job.output) == tree(finished_world)


@pytest.mark.parametrize("way", [pytest.param(signal.SIGINT, marks=pytest.mark.slow), signal.SIGTERM])
def test_signal_finishes_current_shards(way, job, reporter, finished_world, tree) -> None:
    def made(result):
        reporter.done.append(result)
        if len(reporter.done) == 2:
            os.kill(os.getpid(), way)

    reporter.task_finished = made
    with pytest.raises(KeyboardInterrupt):
        run_world(job, reporter=reporter)
    assert 2 <= len(reporter.done) <= 4
    again = type(reporter)()
    run_world(job, resume=True, reporter=again)
    assert again.counts == [(TASKS, len(reporter.done))]
    assert tree(job.output) == tree(finished_world)


@pytest.mark.slow
@pytest.mark.parametrize("step", ["verified", "joined"])
def test_signal_interrupts_verifying_and_joining(step, job, reporter, tree) -> None:
    job = replace(job, output=job.output.with_suffix(".tif"), form="tif")
    if step == "verified":
        run_world(job, reporter=reporter)
    reporter.shares.clear()

    def report(share):
        reporter.shares.append(share)
        os.kill(os.getpid(), signal.SIGTERM)

    setattr(reporter, step, report)
    before = tree(job.output.parent)
    with pytest.raises(KeyboardInterrupt):
        run_world(job, resume=step == "verified", reporter=reporter)
    assert len(reporter.shares) == 1
    run_world(job, resume=True, reporter=type(reporter)())
    if before:
        assert tree(job.output.parent) == before
    names = (".ledger.jsonl", ".tif", "_normal.tif")
    assert sorted(tree(job.output.parent)) == [f"world{name}" for name in names]


def test_resuming_another_job_is_refused(job, copied, reporter, finished_world, tree) -> None:
    for changes in (
        {"world": World(-20.0, 250.0, 492.0, 254.0, 0.125)},
        {"step": 0.5},
        {"layers": ("height",)},
        {"sketch": replace(job.sketch, seed=job.sketch.seed + 1)},
    ):
        with pytest.raises(InputError, match="computed from another sketch, seed, bounds or options"):
            run_world(replace(job, **changes), resume=True, reporter=reporter)
    assert tree(copied) == tree(finished_world)
    damage(copied, "ledger/c/0", lambda text: text.replace(b'"version":"', b'"version":"0.0.', 1))
    refused(r"started by version 0\.0\.", run_world, job, resume=True, reporter=reporter)


USER_FILES = [
    *((form, "world-plants/notes.txt") for form in FORMS),
    *(("tiles", f"world/{name}") for name in ("sketch.sketch", "height.vrt")),
    *(("zarr", f"world.zarr/{name}") for name in ("zarr.json", "0/height/c/0/0", "letter.txt")),
    *(("tif", name) for name in ("world.tif", "world_normal.tif", "world_materials.tif")),
]


@pytest.mark.parametrize(("form", "name"), USER_FILES)
def test_user_files_are_refused_and_unchanged(form, name, small_job, tmp_path, reporter, tree) -> None:
    changes = {"form": form, "plants": "parquet", "layers": DEFAULT_LAYERS}
    job = replace(small_job, output=tmp_path / FORMS[form], **changes)
    path = tmp_path / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text('{"zarr_format": 3, "node_type": "group"}')
    before = tree(tmp_path)
    for resume in (False, True):
        refused("holds other files; choose another output", run_world, job, resume=resume, reporter=reporter)
    for output, message in ((path, "expected a folder"), (path / "world.zarr", "is a file")):
        refused(message, run_world, replace(job, form="zarr", output=output), reporter=reporter)
    assert tree(tmp_path) == before


@pytest.mark.parametrize("form", FORMS)
def test_only_partial_files_are_removed(form, small_job, tmp_path, tree) -> None:
    job = replace(small_job, output=tmp_path / FORMS[form], form=form, plants="parquet")
    store, layout = shard_store(job), job.layout
    layout.journal.parent.mkdir(parents=True)
    layout.journal.with_name(".journal.jsonl.0123abcd.tmp").write_bytes(b"half")
    check_output_unused(job, resume=False)  # killed before it wrote anything
    with Journal(layout.journal, Ledger(Header(job_fingerprint(job), version("sketchterrain")), {})):
        store.create()
    remove_partial_files(job)
    check_output_unused(job, resume=True)
    refused("world exists; --resume completes it", check_output_unused, job, resume=False)
    (tmp_path / "world-plants").mkdir()
    for folder in (tmp_path, layout.journal.parent, tmp_path / "world-plants"):
        for name in (".draft.tmp", ".draft.12345678x.tmp", ".sketchterrain-mine", "notes.txt"):
            (folder / name).write_text("mine")
    before = tree(tmp_path)
    probe = f".sketchterrain-{'0' * 32}"
    for path in (
        layout.journal.with_name(".height.tif.0123abcd.tmp"),
        tmp_path / "world-plants" / ".p.01234567.tmp",
        layout.journal.with_name(probe),
        layout.journal.with_name(f"{probe}-0123abcd"),
    ):
        path.write_bytes(b"half")
    remove_partial_files(job)
    assert tree(tmp_path) == before


FORM_CHANGES = {
    "zarr, parquet": ("world.zarr", {"form": "zarr", "plants": "parquet"}),
    "tiles, flatgeobuf": ("world", {"form": "tiles", "plants": "flatgeobuf", "layers": ("height",)}),
    "tif": ("world.tif", {"form": "tif", "layers": ("height", "materials")}),
    "tif, parquet": ("world.tif", {"form": "tif", "plants": "parquet", "layers": ("height",)}),
}


@pytest.fixture(
    params=[
        pytest.param(form, marks=pytest.mark.soak if form == "tif" else pytest.mark.slow)
        for form in FORM_CHANGES
    ]
)
def form_job(request, small_job, tmp_path: Path) -> Job:
    name, changes = FORM_CHANGES[request.param]
    world = World(-20.0, 250.0, 300.0, 254.0, 0.125)
    (tmp_path / "mine").mkdir()
    return replace(small_job, output=tmp_path / "mine" / name, world=world, **changes)


def test_interrupted_and_damaged_worlds_are_repaired(form_job: Job, reporter, tmp_path: Path, tree) -> None:
    whole, reporter_type = (
        replace(form_job, output=tmp_path / "whole" / form_job.output.name),
        type(reporter),
    )
    done = run_world(whole, reporter=reporter)
    expected = tree(tmp_path / "whole")
    assert done.tasks == done.computed == task_count(form_job)
    assert list(check_world(whole.output, progress=lambda _: None)) == []

    stopped = reporter_type()
    stopped.task_finished = lambda made: stopped.done.append(made) or _raise_if(len(stopped.done) == 3)
    with pytest.raises(_StoppedError):
        run_world(form_job, reporter=stopped)
    assert len(load_ledger(form_job).done) == 3
    refused("is not finished", check_world, form_job.output, progress=lambda _: None)
    again = reporter_type()
    run_world(form_job, resume=True, reporter=again)
    assert again.counts == [(done.tasks, 3)]
    assert tree(tmp_path / "mine") == expected

    largest = max((tmp_path / "mine").rglob("*"), key=lambda path: path.is_file() and path.stat().st_size)
    content = largest.read_bytes()
    largest.write_bytes(content[:100] + bytes([content[100] ^ 1]) + content[101:])
    (found,) = check_world(form_job.output, progress=lambda _: None)
    assert found.file.endswith(largest.name)
    third = reporter_type()
    mended = run_world(form_job, resume=True, reporter=third)
    assert mended.broken == (found,)
    assert mended.computed >= 1
    assert tree(tmp_path / "mine") == expected
    assert (mended.files, mended.bytes) == (done.files, done.bytes)


def _raise_if(now: bool) -> None:
    if now:
        raise _StoppedError


KILLS = 4
SCRIPT = """
import itertools, os, pickle, signal, sys
from pathlib import Path
from sketchterrain.world.run import run_world

class Watcher:
    def __getattr__(self, name):
        return lambda *_: None

def on_event(event, given):
    is_output = event in ("open", "os.rename") and str(given[0]).startswith(str(job.output))
    if is_output and next(events) == moment:
        os.kill(os.getpid(), signal.SIGKILL)

job, moment, events = pickle.loads(Path(sys.argv[1]).read_bytes()), int(sys.argv[2]), itertools.count()
sys.addaudithook(on_event)
run_world(job, resume=True, reporter=Watcher())
"""


@pytest.mark.soak
def test_killed_and_resumed_to_the_same_bytes(job, tmp_path: Path, finished_world, tree) -> None:
    (tmp_path / "job").write_bytes(pickle.dumps(job))
    chance = random.Random(8)
    for moment in (*(chance.randrange(100) for _ in range(KILLS)), -1):
        command = [sys.executable, "-c", SCRIPT, str(tmp_path / "job"), str(moment)]
        assert subprocess.run(command).returncode == (-signal.SIGKILL if moment >= 0 else 0)
    assert tree(job.output) == tree(finished_world)
