"""The engine on a thread of the test, and the link to it: what is missing or fails is said."""

from __future__ import annotations

import socket
import threading
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.terrain import make_recipe
from sketchterrain.terrain.changes import EVERYWHERE
from sketchterrain.ui.engine import link as link_module
from sketchterrain.ui.engine.background import JobQueue
from sketchterrain.ui.engine.channel import Channel, pickled
from sketchterrain.ui.engine.engine import Engine
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.link import EngineLink, PictureSource
from sketchterrain.ui.engine.protocol import (
    Adherence,
    Coming,
    EngineFacts,
    Followed,
    FrameTaken,
    FrameThere,
    LayerPatch,
    MeasureAdherence,
    Pick,
    Picked,
    PictureWritten,
    Plan,
    Quit,
    Relief,
    SketchUpdate,
    StillPlaced,
    StillRelief,
    TakePicture,
    Trouble,
    Turn,
    ViewState,
    Working,
)
from sketchterrain.ui.engine.sketch_updates import settings_of
from sketchterrain.ui.engine.terrain_session import TerrainSession


class Source(PictureSource):
    """Remembers its requests."""

    def __init__(self) -> None:
        super().__init__(ViewState())
        self.told: list[Any] = []

    def tell(self, message: Any) -> None:
        self.told.append(message)


def test_a_frame_in_shared_memory_becomes_the_picture_pixel_for_pixel(qapp):
    memory, source, shown = FrameMemory(), Source(), []
    source.frame_shown.connect(shown.append)
    colours = np.random.default_rng(3)
    try:
        for place, (width, height) in enumerate([(33, 20), (64, 48)]):
            rgbx = colours.integers(0, 256, (height, width, 4), dtype=np.uint8)
            start, capacity = memory.place(place, rgbx.nbytes)
            with memory.view(start, rgbx.nbytes, capacity) as pixels:
                pixels[:] = rgbx.tobytes()
            facts = SimpleNamespace(width=width, height=height)
            source._children = SimpleNamespace(frames=memory)
            source._take(0, "engine", FrameThere(facts, start, capacity))
            with memory.view(start, rgbx.nbytes, capacity) as pixels:
                pixels[:] = bytes(rgbx.nbytes)  # the next frame: the picture is a copy
            picture = source.picture
            assert (picture.width(), picture.height()) == (width, height)
            bgrx = np.frombuffer(picture.constBits().asarray(picture.sizeInBytes()), np.uint8)
            bgrx = bgrx.reshape(height, picture.bytesPerLine())[:, : 4 * width].reshape(height, width, 4)
            np.testing.assert_array_equal(bgrx[..., 2::-1], rgbx[..., :3])
            assert shown[-1] is source.frame is facts
        assert source.told == [FrameTaken(), FrameTaken()]
    finally:
        memory.close()


class Around:
    """An engine without OpenGL on a thread, and the other ends of its channels."""

    def __init__(self, session, pacer=None):
        mine, its_window = socket.socketpair()
        other, its_placer = socket.socketpair()
        self.window, self.placer = Channel(mine), Channel(other, patient=False)
        self.its = Channel(its_window, patient=False), Channel(its_placer)
        self.session = session
        self.engine = Engine(
            *self.its,
            session=session,
            pacer=pacer,
            jobs=JobQueue(),
            facts=EngineFacts(no_device=session.lacks),
        )
        self.thread = threading.Thread(target=self.engine.run, daemon=True)
        self.thread.start()
        self.version = 0

    def plan(self, image):
        self.version += 1
        sketch = Sketch(extent=3000.0, layers={"hill": image})
        update = SketchUpdate(
            self.version, image.shape, settings_of(sketch), {"hill": LayerPatch(0, 0, image)}
        )
        self.placer.send(Plan(update, pickled(make_recipe(sketch), but=sketch), (EVERYWHERE,), 0.0, 0.0, 0.0))

    def answer(self, kind):
        """Return the next message of a kind, and those before it."""
        before = []
        while not isinstance(message := self.window.receive(), kind):
            before.append(message)
        return message, before

    def end(self):
        self.window.send(Quit())
        self.thread.join(20.0)
        assert not self.thread.is_alive()
        for channel in (self.window, self.placer, *self.its):
            channel.close()


def failing(error):
    def fail(*_, **__):
        raise error

    return fail


def blob(column):
    image = np.zeros((48, 48), np.uint8)
    image[10:30, column : column + 15] = 1
    return image


@pytest.fixture
def around():
    made = Around(TerrainSession(ComputeContext))
    yield made
    made.end()


def test_without_opengl_there_is_a_relief_and_picks_are_answered(around):
    around.plan(blob(20))
    followed, _ = around.answer(Followed)
    assert followed.version == 1
    around.window.send(Turn(10.0, 0.0))
    around.window.send(Pick(7, 0.5, 0.6))
    picked, before = around.answer(Picked)
    assert picked.token == 7
    assert len(picked.place) == 3
    relief = next((each for each in before if isinstance(each, Relief)), None) or around.answer(Relief)[0]
    assert relief.height[15:25, 22:32].max() > 20.0


def test_the_newest_of_plans_that_wait_counts_and_all_their_areas(around, monkeypatch):
    taken = []
    take = around.session.take
    gate = threading.Event()

    def slow(plans):
        gate.wait(20.0)
        taken.append([plan.update.version for plan in plans])
        return take(plans)

    monkeypatch.setattr(around.session, "take", slow)
    around.plan(blob(5))
    for column in (10, 15, 20):
        around.plan(blob(column))
    gate.set()
    versions = [around.answer(Followed)[0].version]
    while versions[-1] < 4:
        versions.append(around.answer(Followed)[0].version)
    assert [version for group in taken for version in group] == [1, 2, 3, 4]
    assert versions == sorted(versions)
    assert around.session.version == 4


def test_adherence_is_measured_aside_once_there_is_a_terrain_and_a_picture_needs_opengl(around):
    around.window.send(MeasureAdherence())
    assert "no terrain yet" in around.answer(Trouble)[0].line
    around.window.send(Pick(1, 0.5, 0.5))
    assert around.answer(Picked)[0].place is None
    around.plan(blob(20))
    around.answer(Followed)
    around.window.send(TakePicture("nowhere.png", 100, 100))
    trouble, _ = around.answer(Trouble)
    assert trouble.what == "picture"
    around.window.send(MeasureAdherence())
    measured, _ = around.answer(Adherence)
    assert measured.version == 1
    assert measured.figures["layers"]["hill"]["shapes"] == 1
    painted, shown = measured.images["hill"]
    assert np.array_equal(painted, blob(20) > 0)
    assert shown.shape == painted.shape
    assert shown[painted].mean() > 0.3


def test_without_a_device_it_says_what_to_do_and_runs_on():
    around = Around(TerrainSession(ComputeContext, device="no such device"))
    facts, _ = around.answer(EngineFacts)
    assert "no such device" in facts.no_device
    around.plan(blob(20))
    around.answer(Followed)
    around.window.send(MeasureAdherence())
    trouble, _ = around.answer(Trouble)
    assert "no such device" in trouble.line
    around.end()


def test_a_device_that_fails_is_left_for_another_one(around, monkeypatch):
    if sum(device.type == "CPU" for device in list_devices()) < 2:
        pytest.skip("there is no second device")
    around.plan(blob(20))
    first, _ = around.answer(Relief)
    failed = around.session.device

    monkeypatch.setattr(around.session.terrain, "heights", failing(DeviceFailedError("the device fell over")))
    around.window.send(Pick(1, 0.5, 0.6))
    trouble, _ = around.answer(Trouble)
    assert "fell over" in trouble.line
    assert "goes on with" in trouble.line
    again, _ = around.answer(Relief)
    assert around.session.device != failed
    assert np.array_equal(again.height, first.height)
    around.window.send(Pick(2, 0.5, 0.6))
    assert around.answer(Picked)[0].place is not None


def test_a_defect_is_a_message(around, monkeypatch, capsys):
    around.plan(blob(20))
    around.answer(Followed)

    with monkeypatch.context() as patched:
        patched.setattr(around.session, "take", failing(ZeroDivisionError("oops")))
        around.plan(blob(10))
        trouble, _ = around.answer(Trouble)
    assert "oops" in trouble.line
    assert "ZeroDivisionError" in capsys.readouterr().err
    around.plan(blob(5))
    assert around.answer(Followed)[0].version == 3


class FailingPacer:
    """Draws nothing; its next frame raises what it is given."""

    def __init__(self):
        self.stage = SimpleNamespace(is_empty=False, sharing="copy", clear=lambda: None)
        self.error, self.broken, self.stops = None, False, 0
        self.expect = lambda *, coming: None
        self.show = lambda *_: ""

    def due(self, *, moving):
        return None if self.error is None else 0.0

    def frame(self, eye):
        error, self.error = self.error, None
        raise error

    def stop(self):
        self.stops += 1


def test_a_frame_that_fails_is_reported_and_drawing_stops(capsys):
    pacer = FailingPacer()
    around = Around(TerrainSession(ComputeContext), pacer)
    around.plan(blob(20))
    around.answer(Followed)
    for error in (InputError("odd"), ZeroDivisionError("0")):
        pacer.error = error
        around.window.send(Turn(1.0, 0.0))
        trouble, _ = around.answer(Trouble)
        assert trouble.what == "view"
        assert str(error) in trouble.line
    assert pacer.stops == 2
    assert "ZeroDivisionError" in capsys.readouterr().err
    around.end()


def test_it_ends_when_the_window_is_gone():
    around = Around(TerrainSession(ComputeContext))
    around.answer(EngineFacts)
    around.window.close()
    around.thread.join(20.0)
    assert not around.thread.is_alive()
    for channel in (around.placer, *around.its):
        channel.close()


class FakeChildren:
    """Processes that do nothing, and end when they are told to."""

    made: ClassVar[list[FakeChildren]] = []

    def __init__(self, *, device, draws=True, world=None):
        self.device, self.draws, self.frames = device, draws, FrameMemory()
        mine, its = socket.socketpair()
        my_placer, its_window = socket.socketpair()
        self.channels = {
            "engine": Channel(mine, patient=False),
            "placer": Channel(my_placer, patient=False),
        }
        self.its = Channel(its, patient=False), Channel(its_window, patient=False)
        self.made.append(self)

    def ended(self):
        return "the engine crashed (signal 11)"

    def end(self):
        for channel in (*self.channels.values(), *self.its):
            channel.close()
        self.frames.close()


def test_a_link_starts_crashed_processes_again_at_last_without_opengl(document, qtbot, monkeypatch):
    monkeypatch.setattr(link_module, "Children", FakeChildren)
    monkeypatch.setattr(FakeChildren, "made", [])
    link = EngineLink(document)
    link.device = "pocl"
    troubles = []
    link.trouble.connect(lambda trouble: troubles.append(trouble.line))
    link.start()
    made = FakeChildren.made
    assert made[-1].its[0].receive() == link.view
    assert made[-1].its[0].receive() == Coming(1, fresh=True)
    assert set(made[-1].its[1].receive().layers) == set(LAYERS)
    for count, line in (
        (2, "it is started again."),
        (3, "without the 3-D view."),
        (3, "start the program again."),
    ):
        made[-1].its[0].close()
        qtbot.waitUntil(lambda line=line: bool(troubles) and troubles[-1].endswith(line))
        assert troubles[-1].startswith("The engine crashed (signal 11)")
        assert len(made) == count
    assert [(each.device, each.draws) for each in made] == [("pocl", True), ("pocl", True), ("pocl", False)]
    link.start()
    assert made[-1].draws
    link.stop()
    link.tell(Turn(1.0, 0.0))
    assert len(made) == 4


def test_a_link_hands_over_what_the_processes_tell(document, qtbot, placed, monkeypatch):
    monkeypatch.setattr(link_module, "Children", FakeChildren)
    monkeypatch.setattr(FakeChildren, "made", [])
    link = EngineLink(document)
    told = []
    names = "placed_changed relief_changed adherence_changed picture_written picked facts_changed"
    for name in names.split():
        getattr(link, name).connect(lambda what, name=name: told.append((name, what)))
    link.start()
    engine, placer = FakeChildren.made[-1].its
    relief = Relief(1, 1, np.zeros((4, 4), np.float32), np.zeros((4, 4), np.uint8))
    placer.send(Working("Placing features"))
    qtbot.waitUntil(lambda: link.working == "Placing features")
    engine.send(Working("Drawing"))
    qtbot.waitUntil(lambda: link.working == "Drawing")
    engine.send(Working(""))
    qtbot.waitUntil(lambda: link.working == "Placing features")
    placer.send(placed)
    placer.send(StillPlaced(7))
    qtbot.waitUntil(lambda: link.placed is not None and link.placed.version == 7)
    facts = EngineFacts(device="a")
    for message in (relief, StillRelief(8), Picked(3, None), facts, PictureWritten("b.png")):
        engine.send(message)
    qtbot.waitUntil(lambda: told[-1] == ("picture_written", "b.png"))
    assert [name for name, _ in told] == [
        *("placed_changed", "placed_changed", "relief_changed", "picked", "facts_changed", "picture_written")
    ]
    assert link.relief.version == 8
    assert link.facts.device == "a"
    link.stop()
    assert link.working == ""
