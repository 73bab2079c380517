"""Bookmarks: storage by sketch, and their panel."""

import json
from dataclasses import replace

import pytest
from PyQt6.QtCore import Qt
from PyQt6.QtGui import QColor, QImage
from PyQt6.QtWidgets import QListWidget, QToolButton

from sketchterrain.document.store import load_sketch
from sketchterrain.geometry.camera import Camera
from sketchterrain.ui.engine.protocol import FrameFacts, Look
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Bookmark, Bookmarks
from sketchterrain.ui.panels.lists import BookmarksPanel

HERE, THERE = Camera((0.0, 1.0, 2.0), (3.0, 4.0, 5.0), 50.0), Camera((9.0, 8.0, 7.0), (3.0, 4.0, 5.0), 40.0)


@pytest.fixture
def folder(tmp_path):
    return tmp_path / "state" / "bookmarks"


def test_bookmarks_are_stored_by_path(document, folder, tmp_path):
    one, other = tmp_path / "one.sketch", tmp_path / "other.sketch"
    bookmarks = Bookmarks(document, folder)
    bookmarks.add(Bookmark("Summit", HERE, "walk", b"jpeg"))
    assert not folder.exists(), "the sketch has no path yet"
    document.mark_saved(document.state, one)
    bookmarks.add(Bookmark("Lake", THERE))
    stored = bookmarks.all
    again = Document()
    later = Bookmarks(again, folder)
    assert later.all == ()
    again.open(load_sketch("valley_river"), one)
    assert later.all == stored
    again.open(load_sketch("valley_river"), other)
    assert later.all == ()
    again.open(load_sketch("valley_river"), one)
    again.mark_saved(again.state, other)
    assert later.all == stored, "copied by Save As"
    again.open(load_sketch("valley_river"), other)
    assert later.all == stored


def bookmark_file(**changes) -> bytes:
    """Return a file with one bookmark and some invalid values."""
    good = {"name": "a", "eye": [0, 0, 0], "target": [0, 1, 0], "fov": 50, "mode": "walk", "picture": ""}
    return json.dumps({"bookmarks": [good | changes]}).encode()


def test_an_unreadable_file_is_treated_as_empty(document, folder, tmp_path):
    invalid = [{"target": [0, 0, 0]}, {"eye": [0, 0, float("nan")]}, {"eye": [0, 0]}]
    invalid += [{"mode": "swim"}, {"fov": 0}, {"picture": "?"}]
    broken = (b"", b"{", b"[]", b"\xff\xfe", b'{"bookmarks": [{}]}')
    for content in (*broken, *(bookmark_file(**changes) for changes in invalid)):
        path = tmp_path / "one.sketch"
        bookmarks = Bookmarks(document, folder)
        document.mark_saved(document.state, path)
        bookmarks.add(Bookmark("a", HERE))
        (file,) = folder.iterdir()
        assert json.loads(file.read_bytes())["sketch"] == str(path), content
        file.write_bytes(content)
        document.open(document.sketch, path)
        assert bookmarks.all == (), content
        bookmarks.add(Bookmark("b", HERE))
        assert [each.name for each in bookmarks.all] == ["b"], content


def test_an_unwritable_folder_is_reported(document, folder, tmp_path):
    folder.parent.mkdir()
    folder.write_text("a file")
    bookmarks = Bookmarks(document, folder)
    lines = []
    bookmarks.failed.connect(lines.append)
    document.mark_saved(document.state, tmp_path / "one.sketch")
    bookmarks.add(Bookmark("a", HERE))
    assert "cannot be saved" in lines[0]
    assert len(bookmarks.all) == 1


@pytest.fixture
def panel(show_widget, document, folder, link):
    return show_widget(BookmarksPanel(link, Bookmarks(document, folder)))


def picture(link, pose: Camera = HERE):
    link.picture = QImage(320, 240, QImage.Format.Format_RGB32)
    link.picture.fill(QColor(200, 60, 20))
    link.frame = FrameFacts(320, 240, 1, pose, 0.1, 0.0, 1, 1, True, 1)
    link.frame_shown.emit(link.frame)


def buttons(panel) -> dict[str, QToolButton]:
    return {each.accessibleName().split()[0]: each for each in panel.findChildren(QToolButton)}


def list_of(panel):
    return panel.findChildren(QListWidget)[0]


def titles(panel) -> list[str]:
    return [list_of(panel).item(row).text() for row in range(list_of(panel).count())]


def test_a_bookmark_stores_view_and_picture(panel, link):
    assert not buttons(panel)["Add"].isEnabled()
    panel.add()
    assert titles(panel) == []
    picture(link)
    buttons(panel)["Add"].click()
    picture(link, THERE)
    panel.add()
    rows = list_of(panel)
    assert titles(panel) == ["View 1", "View 2"]
    thumbnail = rows.item(0).icon().pixmap(96, 60).toImage()
    assert thumbnail.pixelColor(thumbnail.width() // 2, thumbnail.height() // 2).red() > 180
    panel.go_to(0)
    assert link.requests[-1] == Look(HERE)
    rows.itemClicked.emit(rows.item(1))
    assert link.requests[-1] == Look(THERE)
    link.requests.clear()
    panel.go_to(5)
    assert link.requests == []
    link.set_view(replace(link.view, mode="walk"))
    panel.add()
    link.set_view(replace(link.view, mode="orbit"))
    panel.go_to(2)
    assert link.view.mode == "walk"


def test_bookmarks_are_renamed_replaced_and_deleted(qtbot, panel, link):
    picture(link)
    panel.add()
    panel.add()
    rows = list_of(panel)
    rows.item(0).setText("Gorge")
    assert titles(panel) == ["Gorge", "View 2"]
    rows.setCurrentRow(0)
    picture(link, THERE)
    buttons(panel)["Replace"].click()
    panel.go_to(0)
    assert link.requests[-1] == Look(THERE)
    rows.setFocus()
    qtbot.keyClick(rows, Qt.Key.Key_Delete)
    assert titles(panel) == ["View 2"]
    buttons(panel)["Delete"].click()
    assert rows.count() == 0
    assert not buttons(panel)["Delete"].isEnabled()
    panel.delete_current()
