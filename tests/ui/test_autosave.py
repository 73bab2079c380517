"""What is kept in case of a crash, by whom, until when; saving beside the window; recent sketches."""

import json
import subprocess
import sys
import time
from pathlib import Path
from threading import Event

import pytest

from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.ui.models.autosave import Autosave, Lock, new_recovery_path, write_recovery
from sketchterrain.ui.models.background import BackgroundQueue, SketchSaver
from sketchterrain.ui.models.preferences import RecentFiles


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "recovery"


@pytest.fixture
def autosave(document, folder):
    made = Autosave(document, folder, interval_s=0.05)
    yield made
    made.close()


def left_by_a_crash(folder: Path, sketch: Sketch, original: Path | None = None) -> Path:
    """A sketch that a program kept which is no more."""
    folder.mkdir(exist_ok=True)
    path = new_recovery_path(folder)
    path.with_suffix(".lock").touch()
    time.sleep(0.01)  # the disk's clock is coarser than ours
    write_recovery(path, sketch, original)
    return path


def seed(document, number):
    document.do("Seed", document.sketch.replace(seed=number))


def test_a_modified_document_is_kept_and_dropped_when_it_is_saved(document, autosave, qtbot, tmp_path):
    qtbot.wait(100)
    assert not autosave.path.exists()
    seed(document, 5)
    qtbot.waitUntil(autosave.path.exists)
    assert load_sketch(autosave.path).seed == 5
    document.mark_saved(document.sketch, tmp_path / "a.sketch")
    qtbot.waitUntil(lambda: not autosave.path.exists())
    seed(document, 6)
    qtbot.waitUntil(autosave.path.exists)
    document.undo()
    qtbot.waitUntil(lambda: not autosave.path.exists())


def test_steps_without_a_pause_are_kept_at_the_interval(document, autosave, qtbot):
    found, start = set(), time.monotonic()
    while len(found) <= 3:
        assert time.monotonic() - start < 10
        seed(document, document.sketch.seed + 1)
        qtbot.wait(5)
        if autosave.path.exists():
            found.add(load_sketch(autosave.path).seed)


def test_a_clean_end_leaves_nothing(document, folder):
    autosave = Autosave(document, folder)
    seed(document, 5)
    autosave.save_now()
    autosave.wait()
    assert autosave.path.exists()
    autosave.close()
    assert list(folder.iterdir()) == []
    seed(document, 6)  # nobody listens any more
    unused = Autosave(document, folder / "never")
    unused.close()
    assert not (folder / "never").exists()


def test_what_another_program_left_is_found_opened_and_discarded(document, autosave, folder, qtbot):
    sketch = document.sketch.replace(seed=77, name="Lost")
    old = left_by_a_crash(folder, document.sketch)
    path = left_by_a_crash(folder, sketch, Path("/home/valley.sketch"))
    newest, older = autosave.recoverable()
    assert (newest.path, newest.name, newest.original) == (path, "Lost", Path("/home/valley.sketch"))
    assert (older.path, older.original) == (old, None)
    assert older.when < newest.when
    assert [each.path for each in autosave.recoverable()] == [path, old]
    document.open(load_sketch(newest.path), newest.original, modified=True)
    autosave.discard(newest)
    assert path.exists()  # until this program has kept it itself
    qtbot.waitUntil(lambda: not path.exists())
    assert load_sketch(autosave.path).seed == 77
    autosave.discard(older)
    qtbot.waitUntil(lambda: not old.exists())
    assert {each.suffix for each in folder.iterdir()} == {".sketch", ".lock"}
    assert {each.stem for each in folder.iterdir()} == {autosave.path.stem}


def test_what_was_saved_after_it_was_kept_is_told(document, autosave, folder, tmp_path):
    for count, name in enumerate(["valley", "valley.sketch"]):
        left_by_a_crash(folder, document.sketch, tmp_path / name)
        assert not autosave.recoverable()[0].was_saved_since
        save_sketch(document.sketch, tmp_path / name)
        assert autosave.recoverable()[0].was_saved_since
        left_by_a_crash(folder, document.sketch.replace(seed=5), tmp_path / name)
        since = [each.was_saved_since for each in autosave.recoverable()]
        assert since == [False, True] * (count + 1)


def test_what_was_not_discarded_is_left_to_the_next_program(document, folder):
    path = left_by_a_crash(folder, document.sketch)
    first = Autosave(document, folder)
    assert [each.path for each in first.recoverable()] == [path]
    second = Autosave(document, folder)
    assert second.recoverable() == []  # the first one has it
    first.close()
    assert [each.path for each in second.recoverable()] == [path]
    second.close()
    assert path.exists()


def test_what_a_living_program_keeps_is_not_taken(document, folder):
    program = (
        "import sys, time; from pathlib import Path\n"
        "from sketchterrain.document.sketch import Sketch\n"
        "from sketchterrain.ui.models.autosave import Lock, write_recovery\n"
        "path = Path(sys.argv[1]); lock = Lock(path); write_recovery(path, Sketch(seed=3), None)\n"
        "print('kept', flush=True); time.sleep(60)\n"
    )
    folder.mkdir()
    path = folder / "1-other.sketch"
    autosave = Autosave(document, folder)
    with subprocess.Popen([sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE) as child:
        try:
            assert child.stdout.readline() == b"kept\n"
            assert autosave.recoverable() == []
        finally:
            child.kill()
    assert [each.path for each in autosave.recoverable()] == [path]
    autosave.close()


def test_stale_locks_are_removed_and_foreign_files_left_alone(document, autosave, folder, tmp_path):
    folder.mkdir()
    (folder / "1-dead.lock").touch()
    (folder / "2-strange.sketch").write_bytes(b"not a zip")
    (folder / "notes.txt").write_text("mine")
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
    autosave = Autosave(document, tmp_path / "recovery")
    told: list[str] = []
    autosave.failed.connect(told.append)
    for number in range(3):
        seed(document, 100 + number)
        autosave.save_now()
        autosave.wait()
    assert len(told) == 1
    autosave.close()


@pytest.fixture
def background(qapp):
    made = BackgroundQueue()
    yield made
    made.wait()


@pytest.fixture
def saving(document):
    made = SketchSaver(document)
    yield made
    made.wait()


def same(a: Sketch, b: Sketch) -> bool:
    return a.seed == b.seed and all((a.layers[name] == b.layers[name]).all() for name in LAYERS)


def test_work_is_done_in_order_and_the_newest_of_a_purpose_wins(background, qtbot):
    begun, go, did, told = Event(), Event(), [], []

    def first():
        begun.set()
        assert go.wait(10)
        did.append("first")

    background.do("a", first, lambda line: told.append(("first", line)))
    assert begun.wait(10)
    for number in range(5):
        for purpose, what in (("a", number), ("b", -number)):
            background.do(purpose, lambda n=what: did.append(n), lambda line, n=what: told.append((n, line)))
    assert background.is_busy
    with qtbot.waitSignal(background.busy_changed, check_params_cb=lambda busy: not busy):
        go.set()
    assert did == ["first", 4, -4]
    assert told == [("first", ""), (4, ""), (-4, "")]
    assert not background.is_busy


def test_saving_returns_at_once_and_the_document_is_saved_beside_the_window(
    document, saving, qtbot, tmp_path
):
    seed(document, 4)
    path = tmp_path / "valley.sketch"
    with qtbot.waitSignal(saving.saved) as signal:
        saving.save(path)
        assert saving.is_busy
        assert document.is_modified
    assert signal.args == [path]
    assert (document.path, document.is_modified, saving.is_busy) == (path, False, False)
    assert same(load_sketch(path), document.sketch)

    start = time.process_time()
    saving.save(tmp_path / "a.sketch")
    assert time.process_time() - start < 0.02


def test_the_newest_state_is_saved_and_every_place_that_was_asked_for(document, saving, tmp_path):
    for path in (tmp_path / "folder", tmp_path / "zip.sketch"):
        for number in range(20):
            seed(document, number)
            saving.save(path)
        assert saving.wait()
        assert load_sketch(path).seed == 19
        assert document.path == path
        assert not document.is_modified

    paths = [tmp_path / name for name in ("a.sketch", "b.sketch", "c")]
    for path in paths:
        saving.save(path)
    assert saving.wait()
    assert document.path == paths[-1]
    assert all(same(load_sketch(path), document.sketch) for path in paths)


def test_steps_and_documents_that_come_meanwhile_stay_unsaved(document, saving, tmp_path):
    saving.save(tmp_path / "a.sketch")
    seed(document, 99)
    saving.wait()
    assert document.is_modified
    document.undo()
    assert not document.is_modified
    saving.save(tmp_path / "a.sketch")
    document.open(load_sketch("valley_river"), modified=True)
    saving.wait()
    assert document.path is None
    assert document.is_modified
    assert (tmp_path / "a.sketch").exists()


def test_a_save_that_fails_is_told_in_a_line(document, saving, tmp_path):
    told: list[str] = []
    saving.failed.connect(told.append)
    (tmp_path / "photo.png").write_bytes(b"mine")
    seed(document, 99)
    saving.save(tmp_path / "photo.png")
    assert not saving.wait()
    assert len(told) == 1
    assert "expected a folder or a name that ends in .sketch" in told[0]
    assert document.is_modified
    assert document.path is None
    saving.save(tmp_path / "a.sketch")
    assert saving.wait()


def test_recent_files_are_newest_first_once_and_shared_by_programs(qapp, tmp_path):
    file = tmp_path / "state" / "recent.json"
    recent = RecentFiles(file)
    changes = []
    recent.changed.connect(lambda: changes.append(recent.paths))
    assert recent.paths == ()
    for number in range(20):
        recent.add(tmp_path / str(number))
    recent.add(tmp_path / "15")
    wanted = tuple(tmp_path / str(n) for n in (15, 19, 18, 17, 16, 14, 13, 12, 11, 10, 9, 8))
    assert recent.paths == wanted
    assert RecentFiles(file).paths == wanted
    recent.add(tmp_path / "15")
    assert len(changes) == 21
    recent.forget(tmp_path / "19")
    assert recent.paths == (wanted[0], *wanted[2:])
    recent.clear()
    assert RecentFiles(file).paths == ()

    one, other = RecentFiles(tmp_path / "recent.json"), RecentFiles(tmp_path / "recent.json")
    one.add(Path("/a"))
    other.add(Path("/b"))
    one.add(Path("/c"))
    assert RecentFiles(tmp_path / "recent.json").paths == (Path("/c"), Path("/b"), Path("/a"))


def test_broken_and_unwritable_lists_of_recent_files_count_as_empty(qapp, tmp_path):
    for content in ["", "{}", "[1, null]", "\x00", json.dumps([["/a"]])]:
        file = tmp_path / "recent.json"
        file.write_text(content)
        recent = RecentFiles(file)
        assert recent.paths == (), content
        recent.add(Path("/a"))
        assert RecentFiles(file).paths == (Path("/a"),), content

    (tmp_path / "state").write_text("a file")
    recent = RecentFiles(tmp_path / "state" / "recent.json")
    recent.add(Path("/a"))
    recent.add(Path("/b"))
    assert recent.paths == (Path("/b"), Path("/a"))
