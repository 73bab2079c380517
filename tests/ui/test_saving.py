"""Saving beside the window, and the list of recent sketches."""

from __future__ import annotations

import json
import time
from pathlib import Path
from threading import Event
from typing import TYPE_CHECKING

import pytest

from sketchterrain.sketch import LAYERS, load_sketch
from sketchterrain.ui.models.background import Background, Saving
from sketchterrain.ui.models.preferences import RecentFiles

if TYPE_CHECKING:
    from sketchterrain.sketch import Sketch


@pytest.fixture
def background(qapp):
    made = Background()
    yield made
    made.wait()


@pytest.fixture
def saving(document):
    made = Saving(document)
    yield made
    made.wait()


def same(a: Sketch, b: Sketch) -> bool:
    return a.seed == b.seed and all((a.layers[name] == b.layers[name]).all() for name in LAYERS)


def test_work_is_done_in_order_and_the_newest_of_a_purpose_wins(background, qtbot) -> None:
    begun, go, did, told = Event(), Event(), [], []

    def first() -> None:
        begun.set()
        assert go.wait(10)
        did.append("first")

    background.do("a", first, lambda line: told.append(("first", line)))
    assert begun.wait(10)
    for number in range(5):
        background.do(
            "a", lambda number=number: did.append(number), lambda line, n=number: told.append((n, line))
        )
        background.do(
            "b", lambda number=number: did.append(-number), lambda line, n=number: told.append((-n, line))
        )
    assert background.is_busy
    with qtbot.waitSignal(background.busy_changed, check_params_cb=lambda busy: not busy):
        go.set()
    assert did == ["first", 4, -4]
    assert told == [("first", ""), (4, ""), (-4, "")]
    assert not background.is_busy


def test_saving_returns_at_once_and_the_document_is_saved_beside_the_window(
    document, saving, qtbot, tmp_path
) -> None:
    document.do("Seed", document.sketch.replace(seed=4))
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


def test_the_newest_state_is_saved_and_every_place_that_was_asked_for(document, saving, tmp_path) -> None:
    for path in (tmp_path / "folder", tmp_path / "zip.sketch"):
        for seed in range(20):
            document.do("Seed", document.sketch.replace(seed=seed))
            saving.save(path)
        assert saving.wait()
        assert load_sketch(path).seed == 19
        assert document.path == path
        assert not document.is_modified

    saving.save(tmp_path / "a.sketch")
    saving.save(tmp_path / "b.sketch")
    saving.save(tmp_path / "c")
    assert saving.wait()
    assert document.path == tmp_path / "c"
    assert all(same(load_sketch(tmp_path / name), document.sketch) for name in ("a.sketch", "b.sketch", "c"))


def test_steps_and_documents_that_come_meanwhile_stay_unsaved(document, saving, tmp_path) -> None:
    saving.save(tmp_path / "a.sketch")
    document.do("Seed", document.sketch.replace(seed=99))
    saving.wait()
    assert document.is_modified
    document.undo()
    assert not document.is_modified
    saving.wait()
    saving.save(tmp_path / "a.sketch")
    document.open(load_sketch("valley_river"), modified=True)
    saving.wait()
    assert document.path is None
    assert document.is_modified
    assert (tmp_path / "a.sketch").exists()


def test_a_save_that_fails_is_told_in_a_line(document, saving, tmp_path) -> None:
    told: list[str] = []
    saving.failed.connect(told.append)
    (tmp_path / "photo.png").write_bytes(b"mine")
    document.do("Seed", document.sketch.replace(seed=99))
    saving.save(tmp_path / "photo.png")
    assert not saving.wait()
    assert len(told) == 1
    assert "expected a folder or a name that ends in .sketch" in told[0]
    assert document.is_modified
    assert document.path is None
    saving.save(tmp_path / "a.sketch")
    assert saving.wait()


def test_recent_files_are_newest_first_once_and_shared_by_programs(qapp, tmp_path) -> None:
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


def test_broken_and_unwritable_lists_of_recent_files_count_as_empty(qapp, tmp_path) -> None:
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
