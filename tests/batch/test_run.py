"""How a batch goes on when terrains fail, disks are full, people press Ctrl-C and files get lost."""

from __future__ import annotations

import errno
import fcntl
import json
import os
import threading
import time
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import pytest

import sketchterrain.batch.crew
import sketchterrain.batch.run
from sketchterrain.batch.manifest import MANIFEST, read_manifest
from sketchterrain.batch.output import Output
from sketchterrain.batch.plan import Source, plan
from sketchterrain.batch.run import run_batch
from sketchterrain.errors import DeviceError, InputError, SketchterrainError
from sketchterrain.export import move_into, prepare_folder, staging
from sketchterrain.generate import Generated
from sketchterrain.sketch import Sketch
from sketchterrain.whole_files import write_whole

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path

    from sketchterrain.batch.manifest import Entry
    from sketchterrain.batch.plan import Item
    from sketchterrain.batch.run import Done
    from sketchterrain.progress import Stages

OUTPUT = Output(size=17, preview=False)


class Heard:
    """A watcher that remembers."""

    def __init__(self) -> None:
        self.begun: list[str] = []
        self.skipped = 0
        self.told: list[tuple[str, str]] = []
        self.stopped = False

    def checking(self, number: int, items: int) -> None:
        assert 0 <= number < items

    def begins(self, items: Sequence[Item], skipped: int) -> None:
        self.begun, self.skipped = [item.name for item in items], skipped

    def stage(self, item: Item, title: str) -> None:
        assert item.name
        assert title

    def finished(self, item: Item, entry: Entry) -> None:
        self.told.append((item.name, entry.state))

    def stops(self) -> None:
        self.stopped = True


class Works:
    """Stands in for what makes terrains: quick, and fails when told to."""

    def __init__(self) -> None:
        self.at_once, self.most = 0, 0
        self.made: list[int] = []
        self.before: Callable[[int], None] = lambda _: None
        self.problem: str | None = None
        self._lock = threading.Lock()

    def __call__(
        self, sketch: Sketch, folder: Path, output: Output, *, shared: object, stages: Stages
    ) -> Generated:
        with self._lock:
            self.at_once += 1
            self.most = max(self.most, self.at_once)
        try:
            prepare_folder(folder)
            with staging(folder) as hidden, stages.stage("ground", "Heights"):
                files = [
                    write_whole(hidden / name, f"{name} {sketch.seed}".encode())
                    for name in self.names(output)
                ]
                self.before(sketch.seed)
                with stages.stage("files", "Writing"):
                    moved = move_into(folder, files)
            with self._lock:
                self.made.append(sketch.seed)
            report = {"adherence": {"mean_iou": 0.5, "shapes": [1]}, "restarts": []}
            return Generated(report, moved, self.problem)
        finally:
            with self._lock:
                self.at_once -= 1

    def names(self, output: Output) -> list[str]:
        return ["height.bin", "report.json"] + (["map.png"] if output.map else [])


@pytest.fixture
def works(monkeypatch: pytest.MonkeyPatch) -> Works:
    found = Works()
    monkeypatch.setattr(sketchterrain.batch.crew, "make", found)
    monkeypatch.setattr(sketchterrain.batch.run, "gc", SimpleNamespace(collect=int))  # most of the time
    return found


SOURCE = Source("valley", "valley", Sketch(extent=64.0))


def run(
    folder: Path,
    seeds: Sequence[int] = range(6),
    *,
    jobs: int = 2,
    resume: bool = False,
    output: Output = OUTPUT,
    heard: Heard | None = None,
    sources: Sequence[Source] = (SOURCE,),
) -> Done:
    items = plan(sources, tuple(seeds))
    return run_batch(items, folder, output, device=None, jobs=jobs, resume=resume, watcher=heard or Heard())


def files(folder: Path) -> dict[str, bytes]:
    """Every file but the manifest, hidden ones too."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file() and path.name != MANIFEST
    }


def states(folder: Path) -> dict[int, str]:
    manifest = read_manifest(folder)
    assert manifest is not None
    return {entry.seed: entry.state for entry in manifest.entries.values()}


def test_all_items_are_made_in_order(works: Works, tmp_path: Path) -> None:
    heard = Heard()
    works.before = lambda _: time.sleep(0.02)
    done = run(tmp_path / "new" / "out", heard=heard)
    assert [entry.seed for entry in done.made] == list(range(6))
    assert (done.skipped, done.failed, done.partial) == ((), (), ())
    assert sorted(works.made) == list(range(6))
    assert works.most == 2
    assert heard.begun == [entry.name for entry in done.made]
    assert sorted(heard.told) == sorted((entry.name, "done") for entry in done.made)
    manifest = read_manifest(tmp_path / "new" / "out")
    assert manifest is not None
    assert [entry.name for entry in manifest.entries.values()] == heard.begun
    assert all(entry.whole(manifest.folder / entry.name) for entry in manifest.entries.values())
    first = next(iter(manifest.entries.values()))
    assert first.adherence == {"mean_iou": 0.5}  # without the list of every shape
    assert set(first.timings) == {"ground", "files"}
    assert not heard.stopped


def test_no_more_jobs_run_at_once_than_asked_for(works: Works, tmp_path: Path) -> None:
    works.before = lambda _: time.sleep(0.01)
    run(tmp_path, jobs=1)
    assert works.most == 1


def test_resuming_makes_only_what_is_missing_damaged_or_new(works: Works, tmp_path: Path) -> None:
    run(tmp_path)
    whole = files(tmp_path)
    (tmp_path / "valley" / "seed-001" / "height.bin").unlink()
    (tmp_path / "valley" / "seed-003" / "height.bin").write_bytes(b"damaged")
    with (tmp_path / "valley" / "seed-004" / "height.bin").open("ab") as stream:
        stream.write(b"more")
    works.made.clear()
    heard = Heard()
    done = run(tmp_path, resume=True, heard=heard)
    assert sorted(works.made) == [1, 3, 4]
    assert heard.skipped == 3
    assert [entry.seed for entry in done.skipped] == [0, 2, 5]
    assert files(tmp_path) == whole

    more = tmp_path / "more"
    run(more, range(3))
    run(more, range(3, 5), resume=True)
    assert states(more) == dict.fromkeys([3, 4, 0, 1, 2], "done")
    works.made.clear()
    run(more, range(5), resume=True)
    assert works.made == []


def test_resuming_makes_what_changed(works: Works, tmp_path: Path) -> None:
    run(tmp_path, output=Output(size=17, preview=False, map="png"))
    assert (tmp_path / "valley" / "seed-001" / "map.png").exists()
    works.made.clear()
    run(tmp_path, resume=True)
    assert sorted(works.made) == list(range(6))
    assert not list(tmp_path.rglob("map.png"))  # of a batch that wanted maps
    works.made.clear()
    other = Source("valley", "valley", Sketch(extent=65.0))
    run(tmp_path, resume=True, sources=(other,))
    assert sorted(works.made) == list(range(6))
    works.made.clear()
    run(tmp_path, resume=True, sources=(other,))
    assert works.made == []


def test_a_batch_restarts_only_on_resume_and_keeps_foreign_files(works: Works, tmp_path: Path) -> None:
    run(tmp_path / "made")
    before = files(tmp_path / "made")
    with pytest.raises(InputError, match=r"there is a batch in it .*--resume"):
        run(tmp_path / "made")
    assert files(tmp_path / "made") == before

    (tmp_path / "notes.txt").write_text("mine")
    run(tmp_path, range(1), resume=True)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_a_failed_item_stops_no_other_and_is_retried_on_resume(works: Works, tmp_path: Path) -> None:
    for error, told in [
        (SketchterrainError("one\nline"), "one line"),
        (OSError(errno.ENOSPC, "No space left on device", "x"), "x: No space left on device"),
        (MemoryError(), "out of memory"),
        (RuntimeError("bug"), "unexpected RuntimeError: bug"),
    ]:

        def fail(seed: int, error: Exception = error) -> None:
            if seed in (1, 4):
                raise error

        works.before, folder = fail, tmp_path / told[:3]
        done = run(folder)
        assert [entry.seed for entry in done.failed] == [1, 4], told
        assert done.failed[0].error.startswith(told), told
        assert [entry.seed for entry in done.made] == [0, 2, 3, 5], told
        assert not (folder / "valley" / "seed-001").exists(), told
        works.before = lambda _: None
        again = run(folder, resume=True)
        assert [entry.seed for entry in again.made] == [1, 4], told
        fresh = folder / "fresh"
        run(fresh)
        assert {f"valley/{name}" for name in files(fresh / "valley")} <= set(files(folder)), told


def test_old_files_stay_when_an_item_fails_again(works: Works, tmp_path: Path) -> None:
    run(tmp_path, range(2))
    whole = files(tmp_path)

    def fail(_: int) -> None:
        raise SketchterrainError("no")

    works.before = fail
    other = Source("valley", "valley", Sketch(extent=65.0))
    assert len(run(tmp_path, range(2), resume=True, sources=(other,)).failed) == 2
    assert files(tmp_path) == whole
    assert set(states(tmp_path).values()) == {"failed"}


def test_an_item_without_its_preview_is_partial_and_retried(works: Works, tmp_path: Path) -> None:
    works.problem = "no OpenGL"
    done = run(tmp_path, range(2))
    assert [entry.error for entry in done.partial] == ["no OpenGL"] * 2
    works.problem = None
    assert len(run(tmp_path, range(2), resume=True).made) == 2


def test_a_sketch_that_cannot_be_read_stops_no_other(works: Works, tmp_path: Path) -> None:
    done = run(tmp_path, range(2), sources=(Source("bad", "bad", None, "bad: is none"), SOURCE))
    assert [(entry.name, entry.error) for entry in done.failed] == [
        ("bad/seed-000", "bad: is none"),
        ("bad/seed-001", "bad: is none"),
    ]
    assert len(done.made) == 2
    assert not (tmp_path / "bad").exists()
    again = run(tmp_path, range(2), resume=True, sources=(Source("bad", "bad", None, "bad: is none"), SOURCE))
    assert (len(again.failed), len(again.skipped)) == (2, 2)


def test_an_interrupt_drops_pending_items_and_keeps_finished_ones(works: Works, tmp_path: Path) -> None:
    heard = Heard()
    main = threading.main_thread().ident
    assert main is not None

    def interrupt(seed: int) -> None:
        if seed == 3:
            while len(heard.told) < 2:
                time.sleep(0.005)
            import signal

            signal.pthread_kill(main, signal.SIGINT)
            while not heard.stopped:
                time.sleep(0.005)
            time.sleep(0.05)

    works.before = interrupt
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, range(12), heard=heard)
    found = states(tmp_path)
    assert found[3] == "waiting"
    assert set(found.values()) == {"waiting", "done"}
    done = {seed for seed, state in found.items() if state == "done"}
    assert done == set(works.made)
    assert {name.split("/")[1] for name in files(tmp_path)} == {f"seed-{seed:03}" for seed in done}
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]
    assert not [thread for thread in threading.enumerate() if thread.name.startswith("terrain-")]
    works.before = lambda _: None
    assert len(run(tmp_path, range(12), resume=True).skipped) == len(done)
    assert set(states(tmp_path).values()) == {"done"}


def test_partial_files_of_a_killed_run_are_removed(works: Works, tmp_path: Path) -> None:
    run(tmp_path, range(2))
    whole = files(tmp_path)
    (tmp_path / "valley" / "seed-001" / ".sketchterrain-abc").mkdir()
    (tmp_path / "valley" / "seed-001" / ".sketchterrain-abc" / "height.bin").write_bytes(b"h")
    (tmp_path / ".manifest.json.0123abcd.tmp").write_bytes(b"{")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / ".keep.tmp").write_bytes(b"mine")
    run(tmp_path, range(2), resume=True)
    assert files(tmp_path) == {**whole, "elsewhere/.keep.tmp": b"mine"}


def test_a_manifest_that_cannot_be_written_ends_the_batch(
    works: Works, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sketchterrain.batch.manifest

    calls = [0]

    def full(path: Path, content: bytes) -> Path:
        calls[0] += 1
        if calls[0] > 2:
            raise SketchterrainError(f"{path}: cannot be written (No space left on device)")
        return write_whole(path, content)

    monkeypatch.setattr(sketchterrain.batch.manifest, "write_whole", full)
    with pytest.raises(SketchterrainError, match="No space left"):
        run(tmp_path, range(6), jobs=1)
    monkeypatch.undo()
    assert read_manifest(tmp_path) is not None
    monkeypatch.setattr(sketchterrain.batch.crew, "make", works)
    run(tmp_path, range(6), resume=True)
    assert set(states(tmp_path).values()) == {"done"}


def test_a_locked_folder_is_refused(works: Works, tmp_path: Path) -> None:
    held = os.open(tmp_path, os.O_RDONLY)
    try:
        fcntl.flock(held, fcntl.LOCK_EX)
        with pytest.raises(InputError, match="another batch is at work there"):
            run(tmp_path)
        assert list(tmp_path.iterdir()) == []
    finally:
        os.close(held)
    run(tmp_path, range(1))


def test_files_in_place_of_folders_are_refused_or_fail_one_item(works: Works, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    with pytest.raises(InputError, match="this is a file"):
        run(tmp_path / "file")
    assert (tmp_path / "file").read_text() == "mine"

    (tmp_path / "valley").mkdir()
    (tmp_path / "valley" / "seed-001").write_text("mine")
    done = run(tmp_path, range(3))
    assert [entry.seed for entry in done.failed] == [1]
    assert "this is a file" in done.failed[0].error
    assert (tmp_path / "valley" / "seed-001").read_text() == "mine"


def test_a_broken_manifest_is_left_alone(works: Works, tmp_path: Path) -> None:
    (tmp_path / MANIFEST).write_text("{}")
    for resume in (False, True):
        with pytest.raises(InputError, match="expected a batch's manifest"):
            run(tmp_path, resume=resume)
    assert [path.name for path in tmp_path.iterdir()] == [MANIFEST]


def test_no_device_stops_it_before_anything_is_written(works: Works, tmp_path: Path) -> None:
    items = plan((SOURCE,), (1,))
    with pytest.raises(DeviceError):
        run_batch(items, tmp_path / "out", OUTPUT, device="no such", jobs=1, resume=False, watcher=Heard())
    assert not (tmp_path / "out").exists()


def test_every_written_manifest_lists_only_complete_items(
    works: Works, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import sketchterrain.batch.manifest

    seen: list[dict[str, Any]] = []

    def watched(path: Path, content: bytes) -> Path:
        told = json.loads(content)
        seen.append(told)
        for item in told["items"]:
            for file in item["files"]:
                assert (tmp_path / item["name"] / file["file"]).stat().st_size == file["bytes"]
        return write_whole(path, content)

    monkeypatch.setattr(sketchterrain.batch.manifest, "write_whole", watched)
    run(tmp_path)
    counts = [sum(item["state"] == "done" for item in told["items"]) for told in seen]
    assert counts == [*range(7), 6]  # after each, and with the sheets
