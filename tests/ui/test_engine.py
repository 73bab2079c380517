"""The real engine processes: strokes are placed, evaluated, rendered, and requests answered."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.geometry.camera import Camera
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.models.document import Document

from .events import paint, wait

pytestmark = pytest.mark.gl

SIDE = 96
VIEW = msg.ViewState(width=160, height=100, quality=0.0, plays=False, refines=False)


def sketch() -> Sketch:
    image = np.zeros((SIDE, SIDE), np.uint8)
    image[20:40, 20:40] = 1
    return Sketch(extent=4000.0, layers={"mountain": image})


def pixels(link) -> np.ndarray:
    image = link.picture
    data = image.constBits().asarray(image.sizeInBytes())
    return np.frombuffer(data, np.uint8).reshape(image.height(), image.width(), 4)[..., :3].copy()


class Listener:
    def __init__(self, link):
        self.errors, self.updated, self.frames, self.picked, self.written = [], [], [], [], []
        link.error_reported.connect(self.errors.append)
        link.terrain_updated.connect(self.updated.append)
        link.frame_shown.connect(self.frames.append)
        link.picked.connect(self.picked.append)
        link.picture_written.connect(lambda written: self.written.append(written.path))


def converged(link, version=0):
    return lambda: (
        link.frame is not None
        and link.frame.version >= version
        and link.frame.converged
        and link.relief is not None
        and link.relief.version >= version
    )


def newest(link) -> int:
    return link._updates._version


def final(link, listener):
    """No draft, and no terrain on its way: what an earlier test undid is gone."""
    return lambda: (
        not link._timer.isActive()
        and listener.updated[-1].version >= newest(link)
        and not listener.updated[-1].draft
    )


@pytest.fixture(scope="module")
def running(qapp):
    """A document and its link after the first picture."""
    document = Document(sketch())
    link = EngineLink(document)
    listener = Listener(link)
    link.set_view(VIEW)
    link.start()
    wait(lambda: listener.errors or converged(link)())
    assert listener.errors == []
    yield document, link, listener
    link.stop()
    assert listener.errors == []


@pytest.mark.slow
def test_strokes_are_placed_drawn_picked_and_undone(running):
    document, link, listener = running
    assert all((link.facts.device, link.facts.platform, link.facts.renderer))
    assert link.facts.sharing in ("extension", "mapped", "copy")
    assert not link.facts.device_error + link.facts.opengl_error
    assert (link.picture.width(), link.picture.height()) == (160, 100)
    assert pixels(link).std() > 5.0  # not one colour
    assert link.relief.step == 1
    assert link.relief.height.shape == link.relief.shade.shape == (SIDE, SIDE)
    assert link.relief.height[22:38, 22:38].max() > link.relief.height[60:].max()
    assert min(link.frame.tiles, link.frame.triangles, link.frame.memory >> 20) > 0

    look(link, elevation=0.15)
    image = pixels(link)
    top, bottom = image[:10].reshape(-1, 3).mean(axis=0), image[-10:].reshape(-1, 3).mean(axis=0)
    assert top[0] > bottom[0]  # bytes of RGB32 are blue, green, red: the sky is the bluer one

    look(link)
    before, heights = pixels(link), link.relief.height
    draft = paint(document, "mountain", (60, 60, 72, 72), title=None)
    wait(converged(link, newest(link) + 1))
    assert link.relief.height[62:70, 62:70].max() > heights[62:70, 62:70].max() + 50.0
    assert np.array_equal(link.relief.height[:10, :10], heights[:10, :10])
    assert np.abs(pixels(link).astype(int) - before).max() > 30
    draft.commit("Paint mountains")
    document.undo()
    wait(lambda: converged(link, newest(link))() and not link._timer.isActive())
    assert np.array_equal(link.relief.height, heights)
    assert np.abs(pixels(link).astype(int) - before).mean() < 1.0

    listener.picked.clear()
    tokens = [link.pick(x, y) for x, y in ((0.5, 0.5), (0.3, 0.7), (0.5, 0.001))]
    wait(lambda: len(listener.picked) == 3)
    assert [each.token for each in listener.picked] == tokens
    frame = link.frame
    to_clip = frame.pose.to_clip(frame.width / frame.height)
    for answer, (x, y) in zip(listener.picked[:2], ((0.5, 0.5), (0.3, 0.7)), strict=True):
        clip = to_clip @ [*np.subtract(answer.place, frame.pose.eye), 1.0]
        at = 0.5 + 0.5 * clip[0] / clip[3], 0.5 - 0.5 * clip[1] / clip[3]
        assert np.allclose(at, (x, y), atol=2e-3)


def look(link, *, elevation=0.7):
    """Look from the south at an elevation (tangent), and wait for the converged picture."""
    target = np.array([2000.0, 2000.0, 300.0])
    eye = target + 3000.0 * np.array([0.0, -1.0, elevation])
    link.send(msg.Look(Camera(tuple(eye.tolist()), tuple(target.tolist()), 50.0)))
    wait(lambda: np.allclose(link.frame.pose.eye, eye, atol=1.0) and link.frame.converged)


def finish_messages(link, listener):
    """Wait until the engine has handled all messages."""
    listener.picked.clear()
    link.pick(0.5, 0.5)
    wait(lambda: listener.picked)


@pytest.mark.slow
def test_the_camera_moves_and_comes_to_rest(running, qapp):
    _, link, listener = running

    def distance():
        return np.linalg.norm(np.subtract(link.frame.pose.target, link.frame.pose.eye))

    near = pytest.approx(0.5 * distance(), rel=0.02)
    link.send(msg.Turn(30.0, 10.0))
    link.send(msg.Zoom(0.5, 0.4, 0.6))
    wait(lambda: link.frame.converged and distance() == near)
    count = len(listener.frames)
    for _ in range(10):
        finish_messages(link, listener)
    assert len(listener.frames) <= count + 2  # no frame is rendered at rest

    start = np.array(link.frame.pose.eye)
    link.set_view(replace(link.view, mode="fly"))
    link.send(msg.Fly(forward=1.0))
    wait(lambda: np.linalg.norm(np.array(link.frame.pose.eye) - start) > 100.0)
    link.send(msg.Fly())
    link.set_view(replace(link.view, mode="orbit"))
    link.send(msg.GoTo(1000.0, 1000.0, 1500.0))
    wait(lambda: np.allclose(link.frame.pose.target[:2], 1000.0, atol=5.0))
    look(link)


@pytest.mark.slow
def test_view_state_changes_the_picture_and_a_hidden_view_is_not_drawn(running, qapp):
    document, link, listener = running
    link.set_view(replace(VIEW, width=200, height=140))
    wait(lambda: link.picture.width() == 200 and link.frame.converged)
    plain = pixels(link)
    link.set_view(replace(link.view, overlays=("features",)))
    wait(lambda: not np.array_equal(pixels(link), plain))
    link.set_view(replace(VIEW, quality=0.25))
    wait(lambda: link.picture.width() == 160 and link.frame.converged)
    link.set_view(VIEW)
    wait(lambda: link.frame.converged)

    link.set_view(replace(VIEW, width=0, height=0))
    finish_messages(link, listener)
    listener.frames.clear()
    draft = paint(document, "mountain", (70, 20, 82, 32), title=None)
    wait(lambda: link.relief.version > 0 and link.relief.height[72:80, 22:30].max() > 100.0)
    assert listener.frames == []
    draft.cancel()
    link.set_view(VIEW)
    wait(lambda: link.frame.version >= newest(link) and link.frame.converged)


@pytest.mark.slow
def test_hour_and_look_change_the_picture_and_no_heights(running):
    document, link, _ = running
    hour, colour = {"weather": {"hour": 16.5, "clouds": 0.0}}, {"look": {"grass": {"colour": "#c04040"}}}
    for change, least in ((hour, 1.0), (colour, 0.5)):
        look(link)
        before, heights, version = pixels(link), link.relief.height, newest(link)
        document.do("Set", document.sketch.replace(**change))
        wait(lambda version=version: link.frame.version > version and link.frame.converged)
        assert np.abs(pixels(link).astype(int) - before).mean() > least, change
        assert link.relief.height is heights
        document.undo()
        wait(lambda version=version: link.frame.version > version + 1)


@pytest.mark.slow
def test_a_view_at_rest_becomes_the_still_and_motion_is_shown_at_once(running, tmp_path):
    from PIL import Image

    document, link, listener = running
    wait(final(link, listener))
    look(link)
    moving = pixels(link).astype(int)
    path = tmp_path / "still.png"
    listener.frames.clear()
    listener.written.clear()
    link.send(msg.RenderPicture(str(path), VIEW.width, VIEW.height))
    link.set_view(replace(VIEW, refines=True))
    wait(lambda: listener.written and listener.frames and link.frame.converged)
    with Image.open(path) as picture:
        assert picture.size == (VIEW.width, VIEW.height)
        still = np.asarray(picture.convert("RGB")).astype(int)[..., ::-1]
    difference = np.abs(pixels(link).astype(int) - still)
    assert np.mean(difference <= 8) > 0.99  # grass and water move
    assert np.abs(moving - still).mean() > 2.0 * difference.mean()

    shown = len(listener.frames)
    link.send(msg.Turn(2.0, 0.0))
    wait(lambda: len(listener.frames) > shown)
    assert not listener.frames[shown].converged
    # A stroke ends the refinement, too, and the still is drawn from the new terrain.
    draft = paint(document, "mountain", (60, 60, 72, 72), title=None)
    wait(converged(link, newest(link) + 1))
    assert np.abs(pixels(link).astype(int) - still).max() > 30
    draft.commit("Paint mountains")
    document.undo()
    link.set_view(VIEW)
    wait(converged(link, newest(link)))


@pytest.mark.slow
def test_another_document_opens_with_a_good_view_and_an_empty_one_as_a_whole(running):
    document, link, _ = running
    link.send(msg.Zoom(0.2))
    wait(lambda: link.frame.converged)
    other = Sketch(extent=9000.0, layers={"hill": np.ones((64, SIDE), np.uint8)})
    document.open(other)
    wait(lambda: link.relief.height.shape == (64, SIDE) and link.frame.version >= newest(link))
    wait(lambda: link.frame.converged)
    assert link.frame.pose.fov == 36.0  # of views that are found
    document.open(Sketch(extent=6000.0, layers={"hill": np.zeros((64, SIDE), np.uint8)}))
    wait(converged(link, newest(link) + 1))
    assert link.frame.pose.target[0] == pytest.approx(3000.0, abs=50.0)
    assert link.frame.pose.fov == 50.0
    document.open(sketch())
    wait(converged(link, newest(link) + 1))


@pytest.mark.slow
def test_a_killed_engine_is_reported_and_restarted(running):
    document, link, listener = running
    os.kill(link._processes._processes["engine"].pid, signal.SIGKILL)
    wait(lambda: listener.errors)
    assert listener.errors[0].source == "engine"
    assert "signal 9" in listener.errors[0].line
    listener.errors.clear()
    listener.frames.clear()
    wait(lambda: listener.frames and link.frame.converged)
    paint(document, "mountain", (60, 60, 72, 72))
    wait(converged(link, newest(link) + 1))
    assert link.relief.height[62:70, 62:70].max() > 100.0


@pytest.mark.slow
def test_stop_frees_processes_and_descriptors(qapp):
    link = EngineLink(Document(sketch()))
    link.set_view(VIEW)
    open_before = len(list(Path("/proc/self/fd").iterdir()))
    for started in (lambda: True, lambda: link.facts != msg.EngineFacts()):
        link.start()
        processes = list(link._processes._processes.values())
        wait(started)
        link.stop()
        assert all(child.returncode is not None for child in processes)
        assert not any(Path(f"/proc/{child.pid}").exists() for child in processes)
    assert len(list(Path("/proc/self/fd").iterdir())) == open_before


@pytest.mark.slow
def test_processes_end_with_the_window_even_if_it_is_killed(qapp):
    code = (
        "import sys\n"
        "from sketchterrain.ui.engine.link import EngineProcesses\n"
        "c = EngineProcesses()\n"
        "print(*(p.pid for p in c._processes.values()), flush=True)\n"
        "sys.stdin.read()\n"
    )
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", code], text=True, **pipes) as window:
        processes = [int(word) for word in window.stdout.readline().split()]
        wait(lambda: all("numpy" in Path(f"/proc/{child}/maps").read_text() for child in processes))
        window.kill()
    wait(lambda: not any(is_running(child) for child in processes))


def is_running(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0]
    except OSError:
        return False
    return state != "Z"
