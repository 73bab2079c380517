"""Runs of a batch: failures, full disks, interrupts, kills and resuming."""

from __future__ import annotations

import errno
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from sketchterrain.app.cli import main
from sketchterrain.batch import results as manifest_module
from sketchterrain.batch import run as run_module
from sketchterrain.batch.plan import Source, plan
from sketchterrain.batch.results import MANIFEST, BatchProgress, Entry, Output, estimate_needs, read_manifest
from sketchterrain.batch.run import BatchResult, estimate_batch, run_batch
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import save_sketch
from sketchterrain.errors import DeviceError, InputError, SketchterrainError
from sketchterrain.export.files import move_files, prepare_folder, staging
from sketchterrain.export.target import ExportOptions
from sketchterrain.io.console import Stages
from sketchterrain.io.files import write_atomic
from sketchterrain.jobs.export import JobResult
from tests.refusals import refused

OUTPUT = Output(size=17, preview=False)
LOCK = threading.Lock()


class RecordingReporter(BatchProgress):
    """Remembers the calls."""

    def __init__(self) -> None:
        super().__init__()
        self.skipped, self.was_interrupted, self.results = 0, False, list[tuple[str, str]]()
        self.shares: list[tuple[str, float]] = []

    def started(self, items: int, skipped: int) -> None:
        self.skipped = skipped

    def share(self, name: str, share: float) -> None:
        super().share(name, share)
        self.shares.append((name, share))

    def finished(self, entry: Entry) -> None:
        self.results.append((entry.name, entry.state))

    def interrupted(self) -> None:
        self.was_interrupted = True


class FakeWriter:
    """Quick replacement of `write_terrain` that can fail."""

    def __init__(self) -> None:
        self.at_once, self.most = 0, 0
        self.seeds: list[int] = []
        self.before: Callable[[int], None] = lambda _: None
        self.problem: str | None = None

    def __call__(
        self, sketch: Sketch, folder: Path, output: Output, *, shared: object, stages: Stages
    ) -> JobResult:
        with LOCK:
            self.at_once += 1
            self.most = max(self.most, self.at_once)
        try:
            prepare_folder(folder)
            with staging(folder) as hidden, stages.stage("ground", "Heights") as progress:
                progress(0.5)
                names = ["height.bin", "report.json"] + (["map.png"] if output.map else [])
                files = [write_atomic(hidden / name, f"{name} {sketch.seed}".encode()) for name in names]
                self.before(sketch.seed)
                with stages.stage("files", "Writing"):
                    moved = move_files(folder, files)
            self.seeds.append(sketch.seed)
            return JobResult(
                {"adherence": {"mean_iou": 0.5, "shapes": [1]}, "restarts": []}, moved, self.problem
            )
        finally:
            with LOCK:
                self.at_once -= 1


@pytest.fixture
def writer(monkeypatch) -> FakeWriter:
    found = FakeWriter()
    monkeypatch.setattr(run_module, "write_terrain", found)
    monkeypatch.setattr(run_module, "gc", SimpleNamespace(collect=int))  # most of the time
    return found


SOURCE = Source("valley", "valley", Sketch(extent=64.0))


def run(folder, seeds=range(6), *, output=OUTPUT, jobs=2, resume=False, **options) -> BatchResult:
    items = plan(options.get("sources", (SOURCE,)), tuple(seeds))
    progress, device = options.get("reporter") or RecordingReporter(), options.get("device")
    return run_batch(items, folder, output, device=device, jobs=jobs, resume=resume, progress=progress)


def seeds_by_state(done: BatchResult) -> dict[str, list[int]]:
    """Seeds of the entries by their state, those that were whole before as "skipped"."""
    found = defaultdict[str, list[int]](list)
    for entry in done.entries:
        found["skipped" if entry.name in done.skipped else entry.state].append(entry.seed)
    return found


def files(folder: Path) -> dict[str, bytes]:
    """Every file but the manifest, hidden ones too."""
    found = (path for path in folder.rglob("*") if path.is_file() and path.name != MANIFEST)
    return {str(path.relative_to(folder)): path.read_bytes() for path in found}


def states(folder: Path) -> dict[int, str]:
    manifest = read_manifest(folder)
    assert manifest is not None
    return {entry.seed: entry.state for entry in manifest.entries.values()}


def test_items_run_in_order_with_requested_jobs(writer, tmp_path):
    reporter = RecordingReporter()
    both = threading.Barrier(2, timeout=300.0)
    writer.before = lambda _: both.wait()
    done = run(tmp_path / "new" / "out", reporter=reporter)
    assert seeds_by_state(done) == {"done": [*range(6)]}
    assert sorted(writer.seeds) == list(range(6))
    assert writer.most == 2
    assert sorted(reporter.results) == sorted((entry.name, "done") for entry in done.entries)
    assert sorted(reporter.shares) == sorted((entry.name, 0.5) for entry in done.entries)
    manifest = read_manifest(tmp_path / "new" / "out")
    assert manifest is not None
    assert manifest.items == done.entries
    assert all(entry.is_intact(tmp_path / "new" / "out" / entry.name) for entry in manifest.items)
    assert manifest.items[0].adherence == {"mean_iou": 0.5}  # without the list of every shape
    assert set(manifest.items[0].timings) == {"ground", "files"}
    assert not reporter.was_interrupted

    writer.most, writer.before = 0, lambda _: None
    run(tmp_path / "one", jobs=1)
    assert writer.most == 1


def test_jobs_are_limited_by_memory(monkeypatch):
    sketch = Sketch(extent=1024.0)
    small, large = (estimate_needs(sketch, Output(size=size, preview=False)) for size in (257, 1025))
    assert (small.vertices, large.vertices) == (257**2, 1025**2)
    assert small.memory < large.memory
    assert small.disk < large.disk < estimate_needs(sketch, Output()).disk
    assert estimate_needs(sketch, Output(preview=False)) == large
    options = ExportOptions(size=257)
    assert estimate_needs(sketch, Output(target="raw", options=options, preview=False)).vertices == 257**2
    refused("size", estimate_needs, sketch, Output(size=100_000))

    needs = [small, large, large, large, InputError("no sketch")]
    for terrains, jobs in ((10, 4), (2.5, 2), (0.5, 1)):
        monkeypatch.setattr(run_module, "free_memory", lambda free=terrains * large.memory: int(free))
        found, estimate = estimate_batch(needs, Output(size=1025, preview=False), 8)
        assert found == jobs
        assert estimate.memory == jobs * large.memory
        assert estimate.disk_needed == small.disk + 3 * large.disk


def test_full_disk_is_refused_before_work(writer, tmp_path, monkeypatch):
    from sketchterrain.io import files as disk

    monkeypatch.setattr(disk, "free_disk_space", lambda _: 5000)
    refused(r"files of the batch need up to 0\.\d MiB, .* has 0\.0 MiB free", run, tmp_path)
    assert writer.seeds == []
    assert list(tmp_path.iterdir()) == []


def test_an_unexpected_exception_in_a_thread_never_hangs_the_batch(writer, tmp_path, monkeypatch):
    def broken(reporter: RecordingReporter, name: str, title: str) -> None:
        if name.endswith("3"):
            raise ZeroDivisionError("in the progress report")
        BatchProgress.stage(reporter, name, title)

    with monkeypatch.context() as patch:
        patch.setattr(RecordingReporter, "stage", broken)
        done = run(tmp_path / "a")
    assert seeds_by_state(done) == {"done": [0, 1, 2, 4, 5], "failed": [3]}
    assert "unexpected ZeroDivisionError: in the progress report" in done.entries[3].error

    writer.before = lambda seed: sys.exit(7) if seed == 3 else None
    with pytest.raises(SystemExit):
        run(tmp_path / "b")
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("terrain")]
    assert states(tmp_path / "b")[3] == "waiting"


def test_resume_writes_missing_damaged_changed_and_new_items(writer, tmp_path):
    run(tmp_path)
    whole = files(tmp_path)
    folder = tmp_path / "valley"
    (folder / "seed-001" / "height.bin").unlink()
    (folder / "seed-003" / "height.bin").write_bytes(b"damaged")
    (folder / "seed-004" / "height.bin").write_bytes(
        (folder / "seed-004" / "height.bin").read_bytes() + b"more"
    )
    writer.seeds.clear()
    reporter = RecordingReporter()
    done = run(tmp_path, resume=True, reporter=reporter)
    assert (sorted(writer.seeds), reporter.skipped) == ([1, 3, 4], 3)
    assert seeds_by_state(done)["skipped"] == [0, 2, 5]
    assert files(tmp_path) == whole

    run(tmp_path / "more", range(3))
    run(tmp_path / "more", range(3, 5), resume=True)
    assert states(tmp_path / "more") == dict.fromkeys([3, 4, 0, 1, 2], "done")

    run(tmp_path / "map", output=Output(size=17, preview=False, map="png"))
    assert (tmp_path / "map" / "valley" / "seed-001" / "map.png").exists()
    other = Source("valley", "valley", Sketch(extent=65.0))
    for sources, made in (((SOURCE,), 6), ((SOURCE,), 0), ((other,), 6), ((other,), 0)):
        writer.seeds.clear()
        run(tmp_path / "map", resume=True, sources=sources)
        assert len(writer.seeds) == made
        assert not list((tmp_path / "map").rglob("map.png"))  # of a batch that wanted maps


def test_used_folders_are_refused_and_unchanged(writer, tmp_path):
    run(tmp_path / "made")
    before = files(tmp_path / "made")
    refused(r"contains a batch .*--resume", run, tmp_path / "made")
    assert files(tmp_path / "made") == before

    (tmp_path / "broken").mkdir()
    (tmp_path / "broken" / MANIFEST).write_text("{}")
    for resume in (False, True):
        refused("expected a batch's manifest", run, tmp_path / "broken", resume=resume)
    assert [path.name for path in (tmp_path / "broken").iterdir()] == [MANIFEST]

    (tmp_path / "file").write_text("mine")
    refused("is a file", run, tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"

    (tmp_path / "valley").mkdir()
    (tmp_path / "valley" / "seed-001").write_text("mine")
    done = run(tmp_path, range(3))
    assert seeds_by_state(done) == {"done": [0, 2], "failed": [1]}
    assert "this is a file" in done.entries[1].error
    for name in ("valley/seed-001", "file"):
        assert (tmp_path / name).read_text() == "mine"

    with pytest.raises(DeviceError):
        run(tmp_path / "out", device="no such")
    assert not (tmp_path / "out").exists()


def test_failed_item_does_not_stop_others_and_is_retried(writer, tmp_path):
    run(tmp_path / "whole")
    for error, message in (
        (SketchterrainError("one\nline"), "one line"),
        (OSError(errno.ENOSPC, "No space left on device", "x"), "x: No space left on device"),
        (MemoryError(), "out of memory"),
        (RuntimeError("bug"), "unexpected RuntimeError: bug"),
    ):

        def fail(seed: int, error: Exception = error) -> None:
            if seed in (1, 4):
                raise error

        writer.before, folder = fail, tmp_path / message[:3]
        done = run(folder)
        assert seeds_by_state(done) == {"done": [0, 2, 3, 5], "failed": [1, 4]}, message
        assert done.entries[1].error.startswith(message), message
        assert not (folder / "valley" / "seed-001").exists(), message
        writer.before = lambda _: None
        again = run(folder, resume=True)
        assert seeds_by_state(again) == {"skipped": [0, 2, 3, 5], "done": [1, 4]}, message
        assert files(folder) == files(tmp_path / "whole"), message
    writer.before = lambda _: 1 // 0
    other = Source("valley", "valley", Sketch(extent=65.0))
    done = run(tmp_path / "whole", resume=True, sources=(other,))
    assert seeds_by_state(done) == {"failed": [*range(6)]}
    assert files(tmp_path / "whole") == files(folder)  # old files stay


def test_partial_and_unreadable_items_are_retried(writer, tmp_path):
    writer.problem = "no OpenGL"
    done = run(tmp_path, range(2))
    assert [(entry.state, entry.error) for entry in done.entries] == [("partial", "no OpenGL")] * 2
    writer.problem = None
    assert seeds_by_state(run(tmp_path, range(2), resume=True)) == {"done": [0, 1]}

    sources = (Source("bad", "bad", None, "bad: is none"), SOURCE)
    done = run(tmp_path / "b", range(2), sources=sources)
    assert seeds_by_state(done) == {"failed": [0, 1], "done": [0, 1]}
    assert [entry.error for entry in done.entries] == ["bad: is none", "bad: is none", "", ""]
    assert not (tmp_path / "b" / "bad").exists()
    again = run(tmp_path / "b", range(2), resume=True, sources=sources)
    assert seeds_by_state(again) == {"failed": [0, 1], "skipped": [0, 1]}


def test_interrupt_discards_unfinished_items(writer, tmp_path):
    reporter = RecordingReporter()
    main = threading.main_thread().ident
    assert main is not None

    def interrupt(seed: int) -> None:
        if seed == 3:
            while len(reporter.results) < 2:
                time.sleep(0.005)
            import signal

            signal.pthread_kill(main, signal.SIGINT)
            while not reporter.was_interrupted:
                time.sleep(0.005)

    writer.before = interrupt
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, range(12), reporter=reporter)
    found = states(tmp_path)
    assert found[3] == "waiting"
    assert set(found.values()) == {"waiting", "done"}
    done = {seed for seed, state in found.items() if state == "done"}
    assert done == set(writer.seeds)
    assert {name.split("/")[1] for name in files(tmp_path)} == {f"seed-{seed:03}" for seed in done}
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("terrain")]
    writer.before = lambda _: None
    assert len(run(tmp_path, range(12), resume=True).skipped) == len(done)
    assert set(states(tmp_path).values()) == {"done"}


def test_manifest_lists_only_complete_items(writer, tmp_path, monkeypatch):
    counts: list[int] = []

    def watched(path: Path, content: bytes) -> Path:
        items = json.loads(content)["items"]
        counts.append(sum(item["state"] == "done" for item in items))
        for item in items:
            for file in item["files"]:
                assert (path.parent / item["name"] / file["file"]).stat().st_size == file["bytes"]
        if len(counts) == 10:
            raise SketchterrainError(f"{path}: cannot be written (No space left on device)")
        return write_atomic(path, content)

    monkeypatch.setattr(manifest_module, "write_atomic", watched)
    run(tmp_path / "a")
    assert counts == [*range(7), 6]  # after each, and with the sheets
    with pytest.raises(SketchterrainError, match="No space left"):
        run(tmp_path / "b", jobs=1)
    assert read_manifest(tmp_path / "b") is not None
    run(tmp_path / "b", resume=True)
    assert set(states(tmp_path / "b").values()) == {"done"}


def test_batch_holds_lock(writer, tmp_path):
    refused: list[str] = []

    def second(_: int) -> None:
        with pytest.raises(InputError, match="another run is writing it") as error:
            run(tmp_path, range(1), resume=True)
        refused.append(str(error.value))

    writer.before = second
    run(tmp_path, range(1))
    assert [str(tmp_path) in line for line in refused] == [True]
    assert not list(tmp_path.rglob(".*"))


def test_queued_preview_is_not_rendered_after_stop(monkeypatch):
    begun, finish, ended = threading.Event(), threading.Event(), threading.Event()
    calls: list[object] = []

    class SnapshotRenderer:
        def picture(self, terrain: object, **_: object) -> object:
            begun.set()
            assert finish.wait(300.0)
            calls.append(terrain)
            return terrain

        def close(self) -> None:
            calls.append("closed")

    def check_stop() -> None:
        if ended.is_set():
            raise InterruptedError

    monkeypatch.setattr(run_module, "SnapshotRenderer", SnapshotRenderer)
    with ThreadPoolExecutor(2) as pool, run_module._previews(check_stop) as render:
        first = pool.submit(render, "first", view="auto")
        assert begun.wait(300.0)
        second = pool.submit(render, "second", view="auto")
        ended.set()
        finish.set()
        assert first.result(300.0) == "first"
        assert isinstance(second.exception(300.0), InterruptedError)
    assert calls == ["first", "closed"]


WORDS = ("--seeds", "1-3", "--size", "33", "--no-preview")
KILLED = """
import os, signal, sys
calls, fsync = 0, os.fsync
def counted(descriptor):
    global calls
    calls += 1
    if calls == int(sys.argv[1]):
        os.kill(os.getpid(), signal.SIGKILL)
    fsync(descriptor)
os.fsync = counted
from sketchterrain.app.cli import main
sys.exit(main(sys.argv[2:]))
"""


@pytest.fixture
def sketch(tmp_path) -> Path:
    mountain, forest = (np.zeros((32, 32), np.uint8) for _ in range(2))
    mountain[4:10, 20:28] = 1
    forest[18:28, 4:14] = 1
    layers = {"mountain": mountain, "forest": forest}
    save_sketch(Sketch(extent=512.0, layers=layers), tmp_path / "hill")
    return tmp_path / "hill"


@pytest.mark.parametrize(
    "kills",
    [
        pytest.param((20,), marks=pytest.mark.slow),
        pytest.param(random.Random(1).sample(range(1, 45), 6), marks=pytest.mark.soak),
    ],
    ids=["once", "often"],
)
def test_killed_and_resumed_to_the_same_bytes(sketch, tmp_path, kills):
    """Each run is killed when it flushes so many files, the last one ends."""
    assert main(["batch", str(sketch), *WORDS, "-o", str(tmp_path / "whole")]) == 0
    words = ["batch", sketch, *WORDS, "-o", tmp_path / "killed", "--resume"]
    codes = [
        subprocess.run([sys.executable, "-c", KILLED, str(kill), *words], capture_output=True).returncode
        for kill in (*kills, 0)
    ]
    assert codes[0] == -signal.SIGKILL
    assert set(codes[:-1]) <= {0, -signal.SIGKILL}
    assert codes[-1] == 0
    assert differences(tmp_path / "whole", tmp_path / "killed") == []


@pytest.mark.parametrize(
    "way",
    [
        pytest.param(signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, marks=pytest.mark.soak),
    ],
)
def test_signal_exits_with_130_and_leaves_complete_files(way, sketch, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "sketchterrain", "batch", str(sketch), "-o", str(out)]
    command += ["--seeds", "1-500", "--size", "33", "--no-preview", "--foliage", "none"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stderr is not None
    assert any(line.startswith("[3/500]") for line in process.stderr)
    os.kill(process.pid, way)
    rest = process.communicate(timeout=600)[1]
    assert process.returncode == 130, rest
    assert rest.splitlines()[-1] == "sketchterrain: error: interrupted"
    assert "Traceback" not in rest
    assert not [path for path in out.rglob("*") if path.name.startswith(".")]
    done = {path.parent.name for path in out.rglob("report.json")}
    assert {path.name for path in (out / "hill").iterdir()} == done
    assert 3 <= len(done) < 500


_MEASURED = ("timings", "rendering", "writing", "peak_memory")  # and the memory that a driver has left


def differences(one: Path, other: Path) -> list[str]:
    """Return the files of two batches that differ, except in measured times."""
    names = [{str(path.relative_to(folder)) for path in folder.rglob("*")} for folder in (one, other)]
    lacking = sorted(names[0] ^ names[1])
    both = (name for name in sorted(names[0] & names[1]) if (one / name).is_file())
    return lacking + [name for name in both if _compared(one / name) != _compared(other / name)]


def _compared(path: Path) -> object:
    if path.name == "report.json":
        return _without_times(json.loads(path.read_bytes()))
    if path.name == "manifest.json":
        manifest = json.loads(path.read_bytes())
        for item in manifest["items"]:
            item["files"] = [each for each in item["files"] if each["file"] != "report.json"]
            del item["seconds"], item["timings"]
        return manifest
    return path.read_bytes()


def _without_times(report: dict[str, Any]) -> dict[str, Any]:
    for name in _MEASURED:
        report.pop(name, None)
    report["device"].pop("memory", None)
    for name in ("seconds", "plants_per_second"):
        report.get("foliage", {}).pop(name, None)
    return report
