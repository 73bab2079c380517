"""Autosave, recovery after a crash or a kill at any moment, saving in the background, recent files."""

import importlib.util
import json
import random
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import JOURNAL, file_hashes, load_sketch, save_sketch
from sketchterrain.schema.layers import PAINTED_LAYERS
from sketchterrain.ui.models.background import (
    Autosave,
    Lock,
    SketchSaver,
    new_recovery_path,
    read_recovery,
    write_recovery,
)
from sketchterrain.ui.models.workspace import RecentFiles


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "recovery"


@pytest.fixture
def autosave(document, folder):
    created = Autosave(document, folder, interval_s=0.05)
    yield created
    created.close()


@pytest.fixture
def saver(document):
    created = SketchSaver(document)
    yield created
    created.wait()


def write_crashed(folder: Path, sketch: Sketch, original: Path | None = None) -> Path:
    """Write the recovery file of a crashed instance."""
    folder.mkdir(exist_ok=True)
    path = new_recovery_path(folder)
    lock = path.with_suffix(".lock")
    lock.touch()
    before = lock.stat().st_mtime_ns
    while lock.stat().st_mtime_ns == before:  # a later file has a later time
        lock.touch()
    write_recovery(path, sketch, original, {} if original is None else file_hashes(original))
    return path


def seed(document, number):
    document.do("Seed", document.sketch.replace(seed=number))


def same(a: Sketch, b: Sketch) -> bool:
    return a.seed == b.seed and all((a.layers[name] == b.layers[name]).all() for name in PAINTED_LAYERS)


def test_a_modified_document_is_written_and_removed_once_saved(document, autosave, qtbot, tmp_path):
    assert not autosave._interval.isActive()
    seed(document, 5)
    qtbot.waitUntil(autosave.path.exists)
    assert load_sketch(autosave.path).seed == 5
    document.mark_saved(document.state, tmp_path / "a.sketch")
    qtbot.waitUntil(lambda: not autosave.path.exists())
    seed(document, 6)
    qtbot.waitUntil(autosave.path.exists)
    document.undo()
    qtbot.waitUntil(lambda: not autosave.path.exists())


def test_changes_without_a_pause_are_written_at_the_interval(document, autosave, qtbot):
    seeds = set()

    def changed_and_often_written():
        seed(document, document.sketch.seed + 1)
        if autosave.path.exists():
            seeds.add(load_sketch(autosave.path).seed)
        return len(seeds) > 3

    qtbot.waitUntil(changed_and_often_written)


def test_closing_removes_all_files(document, folder):
    autosave = Autosave(document, folder)
    seed(document, 5)
    autosave.save_now()
    autosave.wait()
    assert autosave.path.exists()
    autosave.close()
    assert list(folder.iterdir()) == []
    seed(document, 6)  # disconnected
    Autosave(document, folder / "unused").close()
    assert not (folder / "unused").exists()


def test_a_crashed_instances_files_are_found_opened_and_discarded(document, autosave, folder, qtbot):
    old = write_crashed(folder, document.sketch)
    original = Path("/home/valley.sketch")
    path = write_crashed(folder, document.sketch.replace(seed=77, name="Lost"), original)
    newest, older = autosave.recoverable()
    assert (newest.path, newest.name, newest.original) == (path, "Lost", original)
    assert (older.path, older.original) == (old, None)
    assert older.when < newest.when
    assert [each.path for each in autosave.recoverable()] == [path, old]
    document.open(load_sketch(newest.path), newest.original, modified=True)
    autosave.discard(newest)
    assert path.exists()  # until this instance has written it
    qtbot.waitUntil(lambda: not path.exists())
    assert load_sketch(autosave.path).seed == 77
    autosave.discard(older)
    qtbot.waitUntil(lambda: not old.exists())
    assert {each.name for each in folder.iterdir()} == {
        autosave.path.name,
        autosave.path.with_suffix(".lock").name,
    }


def test_a_sketch_saved_after_its_recovery_file_is_reported(document, autosave, folder, tmp_path):
    for count, name in enumerate(["valley", "valley.sketch"]):
        write_crashed(folder, document.sketch, tmp_path / name)
        assert not autosave.recoverable()[0].was_saved_since
        save_sketch(document.sketch, tmp_path / name)
        assert autosave.recoverable()[0].was_saved_since
        write_crashed(folder, document.sketch.replace(seed=5), tmp_path / name)
        since = [each.was_saved_since for each in autosave.recoverable()]
        assert since == [False, True] * (count + 1)


def test_recovery_files_belong_to_one_instance_at_a_time(document, folder):
    path = write_crashed(folder, document.sketch)
    first, second = Autosave(document, folder), Autosave(document, folder)
    assert [each.path for each in first.recoverable()] == [path]
    assert second.recoverable() == []
    first.close()
    assert [each.path for each in second.recoverable()] == [path]
    second.close()
    assert path.exists()

    program = (
        "import sys; from pathlib import Path\n"
        "from sketchterrain.document.sketch import Sketch\n"
        "from sketchterrain.ui.models.background import Lock, write_recovery\n"
        "path = Path(sys.argv[1]); lock = Lock(path); write_recovery(path, Sketch(seed=3), None, {})\n"
        "print('written', flush=True); sys.stdin.read()\n"
    )
    other, autosave = folder / "1-other.sketch", Autosave(document, folder)
    command = [sys.executable, "-c", program, str(other)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        try:
            assert child.stdout.readline() == b"written\n"
            assert [each.path for each in autosave.recoverable()] == [path]
        finally:
            child.kill()
    assert [each.path for each in autosave.recoverable()] == [other, path]
    autosave.close()


def test_stale_locks_are_removed_and_foreign_files_left_alone(document, autosave, folder, tmp_path):
    folder.mkdir()
    (folder / "1-dead.lock").touch()
    (folder / "2-strange.sketch").write_bytes(b"not a zip")
    assert autosave.recoverable() == []
    assert not (folder / "1-dead.lock").exists()
    assert (folder / "2-strange.sketch").read_bytes() == b"not a zip"
    for _ in range(2):
        lock = Lock(tmp_path / "a.sketch")
        assert (tmp_path / "a.lock").exists()
        with pytest.raises(BlockingIOError):
            Lock(tmp_path / "a.sketch")
        lock.remove()


def test_an_unwritable_folder_is_reported_once(document, tmp_path):
    (tmp_path / "recovery").write_text("a file")
    autosave, errors = Autosave(document, tmp_path / "recovery"), []
    autosave.failed.connect(errors.append)
    for number in range(3):
        seed(document, 100 + number)
        autosave.save_now()
        autosave.wait()
    assert len(errors) == 1
    autosave.close()


def test_the_newest_state_is_saved_at_each_path(document, saver, tmp_path):
    for path in (tmp_path / "folder", tmp_path / "zip.sketch"):
        for number in range(20):
            seed(document, number)
            saver.save(path)
        assert saver.wait()
        assert load_sketch(path).seed == 19
        assert (document.path, document.is_modified) == (path, False)
    paths = [tmp_path / name for name in ("a.sketch", "b.sketch", "c")]
    for path in paths:
        saver.save(path)
    assert saver.wait()
    assert document.path == paths[-1]
    assert all(same(load_sketch(path), document.sketch) for path in paths)


def test_changes_and_documents_opened_during_a_save_stay_modified(document, saver, tmp_path):
    saver.save(tmp_path / "a.sketch")
    seed(document, 99)
    saver.wait()
    assert document.is_modified
    document.undo()
    assert not document.is_modified
    saver.save(tmp_path / "a.sketch")
    document.open(load_sketch("valley_river"), modified=True)
    saver.wait()
    assert (document.path, document.is_modified) == (None, True)
    assert (tmp_path / "a.sketch").exists()


def test_a_failed_save_is_reported_in_one_line(document, saver, tmp_path):
    errors: list[str] = []
    saver.failed.connect(errors.append)
    (tmp_path / "photo.png").write_bytes(b"mine")
    seed(document, 99)
    saver.save(tmp_path / "photo.png")
    assert not saver.wait()
    (error,) = errors
    assert "expected a folder or a name that ends in .sketch" in error
    assert (document.path, document.is_modified) == (None, True)
    saver.save(tmp_path / "a.sketch")
    assert saver.wait()


def test_recent_files_are_unique_newest_first_and_shared_by_instances(qapp, tmp_path):
    file = tmp_path / "state" / "recent.json"
    recent, changes = RecentFiles(file), []
    recent.changed.connect(lambda: changes.append(recent.paths))
    for number in range(20):
        recent.add(tmp_path / str(number))
    recent.add(tmp_path / "15")
    expected = tuple(tmp_path / str(n) for n in (15, 19, 18, 17, 16, 14, 13, 12, 11, 10, 9, 8))
    assert recent.paths == RecentFiles(file).paths == expected
    recent.add(tmp_path / "15")
    assert len(changes) == 21
    recent.forget(tmp_path / "19")
    assert recent.paths == (expected[0], *expected[2:])
    recent.clear()
    assert RecentFiles(file).paths == ()
    other = RecentFiles(file)
    recent.add(Path("/a"))
    other.add(Path("/b"))
    recent.add(Path("/c"))
    assert RecentFiles(file).paths == (Path("/c"), Path("/b"), Path("/a"))


def test_broken_and_unwritable_recent_files_count_as_empty(qapp, tmp_path):
    file = tmp_path / "recent.json"
    for content in ["", "{}", "[1, null]", "\x00", json.dumps([["/a"]])]:
        file.write_text(content)
        recent = RecentFiles(file)
        assert recent.paths == (), content
        recent.add(Path("/a"))
        assert RecentFiles(file).paths == (Path("/a"),), content
    recent = RecentFiles(file / "recent.json")
    recent.add(Path("/a"))
    recent.add(Path("/b"))
    assert recent.paths == (Path("/b"), Path("/a"))


PROGRAM = Path(__file__).with_name("paint_until_killed.py")
INTERVAL = 0.1
"""Time between autosaves (s), instead of 20."""
LINES = 200
"""Most lines that are logged before a kill."""


def program():
    spec = importlib.util.spec_from_file_location("paint_until_killed", PROGRAM)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@dataclass(frozen=True)
class Log:
    """The program's log: (event, fingerprint of the sketch)."""

    lines: tuple[tuple[str, str], ...]

    @classmethod
    def read(cls, path: Path) -> "Log":
        return cls(tuple((kind, digest) for kind, digest in map(str.split, path.read_text().splitlines())))

    def states(self) -> list[str]:
        return [digest for kind, digest in self.lines if kind == "state"]

    @property
    def saves(self) -> int:
        return sum(kind == "saved" for kind, _ in self.lines)

    def may_be_saved(self) -> set[str]:
        """Return the sketches the file may hold: the last saved one, or any whose save started later."""
        ends = [k for k, (kind, _) in enumerate(self.lines) if kind == "saved"]
        started = [digest for kind, digest in self.lines[ends[-1] if ends else 0 :] if kind == "saving"]
        return {*started, *(self.lines[k][1] for k in ends[-1:])}

    def written(self) -> int:
        """Return the number of the newest state that was saved or autosaved, 0 if none was."""
        newest, states = 0, []
        for kind, digest in self.lines:
            if kind == "state":
                states.append(digest)
            elif kind in ("saved", "autosaved") and digest in states:
                newest = max(newest, max(k for k, each in enumerate(states) if each == digest))
        return newest

    def lost(self, digest: str) -> int:
        """Return how many states are newer than a sketch."""
        return self.states()[::-1].index(digest)


def paint_and_kill(target: Path, folder: Path, log: Path, rng: random.Random) -> None:
    """Run the program until it has logged a random number of lines, and kill it."""
    command = [sys.executable, str(PROGRAM), str(target), str(folder), str(log), str(INTERVAL)]
    lines = rng.randint(1, LINES)
    with subprocess.Popen([*command, str(rng.randrange(10**9))], stderr=subprocess.PIPE) as child:
        while not log.exists() or log.read_bytes().count(b"\n") < lines:
            assert child.poll() is None, child.stderr.read().decode()
            time.sleep(0.005)
        child.kill()


SLOW = pytest.param("valley.sketch", 8, marks=pytest.mark.slow)
SOAK = [pytest.param(name, 100, marks=pytest.mark.soak) for name in ("valley", "valley.sketch")]


@pytest.mark.parametrize(("name", "kills"), [SLOW, *SOAK])
def test_a_kill_at_any_moment_loses_nothing_that_was_written(tmp_path: Path, name: str, kills: int):
    fingerprint = program().fingerprint
    rng = random.Random(name)
    target, folder = tmp_path / name, tmp_path / "recovery"
    on_file: set[str] = set()
    saves, recoveries, cut_off = 0, 0, 0
    lost: list[int] = []
    for number in range(kills):
        path = tmp_path / f"{number}.log"
        paint_and_kill(target, folder, path, rng)
        log = Log.read(path)
        survived = [log.states()[0]] if not number else []
        if log.saves or on_file:
            saved = fingerprint(load_sketch(target))
            assert saved in (log.may_be_saved() if log.saves else log.may_be_saved() | on_file)
            on_file = {saved}
        elif target.exists() and is_whole(target):
            on_file = {fingerprint(load_sketch(target))}
            assert on_file <= log.may_be_saved()
        recovered = [fingerprint(load_sketch(each)) for each in folder.glob("*.sketch")]
        assert all(read_recovery(each) is not None for each in folder.glob("*.sketch"))
        assert len(recovered) <= 2  # of the previous kill and of this one
        known = set(log.states())
        survived += [digest for digest in (*on_file, *recovered) if digest in known]
        assert survived, "everything is lost"
        lost.append(min(map(log.lost, survived)))
        assert lost[-1] <= len(log.states()) - 1 - log.written()
        saves += log.saves
        recoveries += bool(recovered)
        left = [*tmp_path.rglob(".*.tmp"), *tmp_path.rglob(JOURNAL)]
        cut_off += bool(left)
        for each in left:
            if each.name != JOURNAL:
                each.unlink()
    print(  # noqa: T201
        f"{kills} kills, {cut_off} of them in the middle of writing: {saves} saves, {recoveries} "
        f"recoveries, at most {max(lost)} states lost"
    )
    assert saves > kills // 4
    assert recoveries > kills // 4


def is_whole(folder: Path) -> bool:
    """Return whether a first save has written a readable sketch."""
    return folder.is_file() or any((folder / name).exists() for name in (JOURNAL, "sketch.toml"))
