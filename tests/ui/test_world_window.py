"""Window of a stored world, and its engine process."""

from dataclasses import replace
from unittest.mock import MagicMock

import numpy as np
import pytest
from PyQt6.QtCore import Qt
from PyQt6.QtGui import QImage
from PyQt6.QtWidgets import QDialog, QTextBrowser

from sketchterrain.document.sketch import Sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.geometry.camera import Camera
from sketchterrain.ui import world_window as worlds
from sketchterrain.ui.engine import protocol
from sketchterrain.ui.engine.protocol import ErrorReport, Fly, Look, PickResult
from sketchterrain.ui.world_window import WorldLink
from sketchterrain.world.grid import World
from sketchterrain.world.job import Job
from sketchterrain.world.run import run_world

from .events import RIGHT, click, key, wait

MISSING = ("the world holds no sketch",)
WORLD = protocol.WorldFacts((1000.0, 5000.0), (0.0, -2000.0, 4000.0, 0.0), 2.0, 120.0, MISSING)


class FakeWorldLink(WorldLink):
    """A link that starts no process and records its requests."""

    starts = 0

    def start(self):
        self.requests, self.starts = [], self.starts + 1

    def stop(self):
        pass

    def send(self, message):
        self.requests.append(message)


@pytest.fixture
def window(qtbot, tmp_path, monkeypatch):
    monkeypatch.setattr(worlds, "WorldLink", FakeWorldLink)
    monkeypatch.setattr(worlds, "state_folder", lambda: tmp_path)
    window = worlds.WorldWindow(tmp_path / "island.zarr")
    qtbot.addWidget(window)
    window.resize(640, 400)
    window.show()
    link = window.link
    link.world = WORLD
    link.world_known.emit(WORLD)
    link.picture = QImage(320, 200, QImage.Format.Format_RGB32)
    link.picture.fill(0xFF336699)
    pose = Camera((10.0, -20.0, 300.0), (10.0, 80.0, 280.0))
    link.frame = protocol.FrameFacts(320, 200, 0, pose, 0.02, 0.01, 9, 1000, True, 1 << 20)
    link.frame_shown.emit(link.frame)
    link.requests.clear()
    return window


def test_navigation_without_selection(window):
    view, link = window.view, window.link
    assert link.view.mode == "fly"
    key(view, Qt.Key.Key_W)
    key(view, Qt.Key.Key_W, up=True)
    assert [request for request in link.requests if isinstance(request, Fly)] == [Fly(forward=1.0), Fly()]
    key(view, Qt.Key.Key_3)
    assert link.view.mode == "walk"
    assert window.actions_by_name["mode-walk"].isChecked()
    key(view, Qt.Key.Key_R)
    (look,) = [request for request in link.requests if isinstance(request, Look)]
    assert look.pose.target == (2000.0, -1000.0, 120.0), "the middle, in viewing coordinates"
    assert look.pose.eye[1] < -2000.0 < look.pose.eye[2]
    for button in (Qt.MouseButton.LeftButton, RIGHT):
        click(view, 300, 200, button)
        link.picked.emit(PickResult(link.requests[-1].token, (70.0, -90.0, 12.0)))
    for code in (Qt.Key.Key_Delete, Qt.Key.Key_F, Qt.Key.Key_Menu):
        key(view, code)
    assert not view.grab().isNull()


def test_only_actions_without_a_sketch_are_offered(window, monkeypatch):
    listed = [each.objectName() for menu in window.menuBar().actions() for each in menu.menu().actions()]
    expected = "save-picture quit full-screen mode-fly look-all play bookmark keys"
    assert set(expected.split()) <= set(listed)
    assert not {"save", "undo", "measure", "export", "look-selection", "canvas-only"} & set(listed)
    window.actions_by_name["play"].trigger()
    assert not window.link.view.plays
    pages = []
    monkeypatch.setattr(QDialog, "exec", lambda it: pages.append(it.findChild(QTextBrowser).toPlainText()))
    window.actions_by_name["keys"].trigger()
    assert "Fly and walk" in pages[0]
    assert "Erase" not in pages[0]


def test_extent_position_and_missing_parts_are_shown(window):
    card = window.view._hud.placeholder
    assert window.windowTitle() == "island.zarr"
    assert "4.0 km × 2.0 km, 2 m between vertices" in window._extent.text()
    assert "Eye at 1010, 4980 m, 300 m high" in window._position.text()
    assert window.banner.message.line == "The world holds no sketch."
    for chunk in range(2):
        window.link.error_reported.emit(ErrorReport("world", f"height {chunk}: broken"))
    assert window.banner.message.kind == "warning"
    assert "height 1: broken (2 parts so far)" in window.banner.message.line
    assert not card.isVisible(), "the picture stays visible"
    window.link.error_reported.emit(ErrorReport("engine", "no such device"))
    assert card.notice.line == "no such device"
    card.pressed.emit()
    assert window.link.starts == 2


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    """Write a world with a hill and a corrupt block of heights in the north-west."""
    hill = np.zeros((32, 32), np.uint8)
    hill[8:24, 8:24] = 1
    sketch = Sketch(extent=1024.0, layers={"hill": hill})
    folder = tmp_path_factory.mktemp("worlds") / "hills.zarr"
    layers = ("height", "normal", "materials")
    job = Job(sketch, make_recipe(sketch), World(0.0, 0.0, 1024.0, 1024.0, 4.0), folder, "zarr", layers)
    run_world(job, reporter=MagicMock())
    (shard,) = [path for path in (folder / "0" / "height" / "c").rglob("*") if path.is_file()]
    data = bytearray(shard.read_bytes())
    for place in range(0, len(data) // 4, 500):
        data[place] ^= 1
    shard.write_bytes(data)
    return folder


@pytest.mark.gl
@pytest.mark.slow
def test_the_process_renders_reports_errors_and_restarts(world, qapp):
    link, errors = WorldLink(world), []
    link.view = replace(link.view, width=160, height=100, quality=0.0, plays=False, refines=False)
    link.error_reported.connect(errors.append)
    try:
        link.start()
        wait(lambda: link.frame is not None)
        assert link.world.bounds == (0.0, -1024.0, 1024.0, 0.0)
        assert link.picture.size().width() == 160
        # Close to the corrupt block its finest level is read.
        link.send(Look(Camera((200.0, -200.0, 60.0), (60.0, -60.0, 0.0))))
        wait(lambda: any("height" in each.line for each in errors))
        wait(lambda: link.frame.converged)
        assert all(each.source == "world" for each in errors)
        x = link.frame.pose.eye[0]
        link.send(Fly(right=1.0))
        wait(lambda: abs(link.frame.pose.eye[0] - x) > 1.0)
        errors.clear()
        link._processes._processes["engine"].kill()
        wait(lambda: errors)
        assert (errors[0].source, errors[0].line) == ("engine", "The engine crashed (signal 9).")
        link.frame_shown.connect(errors.append)
        link.start()
        wait(lambda: len(errors) > 1)
        assert abs(link.frame.pose.eye[0] - x) < 2000.0, "the eye is restored"
        child = link._processes._processes["engine"]
    finally:
        link.stop()
    assert child.poll() is not None


@pytest.mark.slow
def test_a_folder_without_a_world_is_reported(tmp_path, qapp):
    link, errors = WorldLink(tmp_path), []
    link.error_reported.connect(errors.append)
    link.start()
    wait(lambda: errors)
    link.stop()
    assert [each.source for each in errors] == ["engine"]
    assert "expected a world" in errors[0].line
