"""Engine and placer on threads of the test, and the link with fake processes: failures and messages."""

import re
import socket
import sys
import threading
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.rasters import RasterSource
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.generation import building as from_sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.jobs import estimates
from sketchterrain.ui.engine import channel as channel_module
from sketchterrain.ui.engine import link as link_module
from sketchterrain.ui.engine import placer as placer_module
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.background import JobQueue
from sketchterrain.ui.engine.channel import Channel, ContentChannel, UpdateBuilder, start_process
from sketchterrain.ui.engine.engine import Engine
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.link import EngineLink, ViewSource
from sketchterrain.ui.engine.placer import CancellationPolicy, Placer, Superseded
from sketchterrain.ui.engine.terrain_session import TerrainSession
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import SelectedFeature
from sketchterrain.ui.models.selection import FeatureDrag
from sketchterrain.ui.models.workspace import Selection
from tests.devices import KNOWN, needs_known_device


def test_a_shared_frame_is_copied_pixel_for_pixel(qapp):
    memory, source, frames, received = FrameMemory(), ViewSource(msg.ViewState()), [], []
    source.send = received.append
    source.frame_shown.connect(frames.append)
    source._processes = SimpleNamespace(frames=memory)
    colours = np.random.default_rng(3)
    for place, (width, height) in enumerate([(33, 20), (64, 48)]):
        rgbx = colours.integers(0, 256, (height, width, 4), dtype=np.uint8)
        start, capacity = memory.allocate(place, rgbx.nbytes)
        with memory.view(start, rgbx.nbytes, capacity) as pixels:
            pixels[:] = rgbx.tobytes()
        facts = SimpleNamespace(width=width, height=height)
        source._handle(0, "engine", msg.FrameReady(facts, start, capacity))
        with memory.view(start, rgbx.nbytes, capacity) as pixels:
            pixels[:] = bytes(rgbx.nbytes)  # the next frame: the picture is a copy
        picture = source.picture
        assert (picture.width(), picture.height()) == (width, height)
        bgrx = np.frombuffer(picture.constBits().asarray(picture.sizeInBytes()), np.uint8)
        bgrx = bgrx.reshape(height, picture.bytesPerLine())[:, : 4 * width].reshape(height, width, 4)
        np.testing.assert_array_equal(bgrx[..., 2::-1], rgbx[..., :3])
        assert frames[-1] is source.frame is facts
    assert received == [msg.FrameAcknowledged(), msg.FrameAcknowledged()]
    memory.close()


class Harness:
    """An engine without OpenGL, or a placer, on a thread, and the other ends of its two channels."""

    def __init__(self, make, *, patient):
        (ours, theirs), (our_other, their_other) = socket.socketpair(), socket.socketpair()
        self.window, self.other = Channel(ours), Channel(our_other, patient=not patient)
        self.peers = Channel(theirs, patient=not patient), Channel(their_other, patient=patient)
        self.served = make(*self.peers)
        self.thread = threading.Thread(target=self.served.run, daemon=True)
        self.version = 0

    def update(self, sketch, layers):
        self.version += 1
        return msg.SketchUpdate(self.version, sketch.replace(layers=layers))

    def send_recipe(self, column):
        self.version += 1
        self.other.send(msg.RecipeUpdate(self.version, *recipe_of(column), 0.0, 0.0))

    def answer(self, kind):
        """Return the next message of a kind, and those before it."""
        before = []
        while not isinstance(message := self.window.receive(), kind):
            assert not isinstance(message, msg.ErrorReport), message.line
            before.append(message)
        return message, before

    def placed(self, sketch, layers):
        """Send a sketch to the placer and return its answer."""
        self.window.send(self.update(sketch, layers))
        return self.answer((msg.Placement, msg.Unchanged, msg.ErrorReport))[0]

    def close(self):
        self.window.send(msg.Quit())
        self.join()

    def join(self):
        self.thread.join(300.0)
        assert not self.thread.is_alive()
        for channel in (self.window, self.other, *self.peers):
            channel.close()


def engine_harness(device=None, pacer=None):
    session = TerrainSession(ComputeContext, device=device)
    facts = msg.EngineFacts(device_error=session.device_error)
    options = {"session": session, "pacer": pacer, "jobs": JobQueue(), "facts": facts}
    harness = Harness(lambda *ends: Engine(*ends, **options), patient=True)
    harness.session = session
    harness.thread.start()
    return harness


def failing(error):
    def fail(*_, **__):
        raise error

    return fail


def blob(column, row=10):
    image = np.zeros((48, 48), np.uint8)
    image[row : row + 20, column : column + 15] = 1
    return image


@cache
def recipe_of(column):
    """Return a sketch with a hill, and its recipe."""
    sketch = Sketch(extent=3000.0, layers={"hill": blob(column)})
    return sketch, make_recipe(sketch)


@pytest.fixture
def harness():
    created = engine_harness()
    yield created
    created.close()


def test_pending_updates_are_all_applied_and_the_newest_is_displayed(harness, monkeypatch):
    applied, apply, gate = [], harness.session.apply, threading.Event()

    def slow(updates):
        gate.wait(300.0)
        applied.extend(update.version for update in updates)
        return apply(updates)

    monkeypatch.setattr(harness.session, "apply", slow)
    for column in (5, 20, 10, 20):
        harness.send_recipe(column)
    gate.set()
    versions = [harness.answer(msg.TerrainUpdated)[0].version]
    while versions[-1] < 4:
        versions.append(harness.answer(msg.TerrainUpdated)[0].version)
    assert applied == [1, 2, 3, 4]
    assert versions == sorted(versions)
    assert harness.session.version == 4


def test_relief_and_picks_work_without_opengl(harness):
    harness.window.send(msg.MeasureAdherence())
    assert "not ready yet" in harness.answer(msg.ErrorReport)[0].line
    harness.window.send(msg.PickRequest(1, 0.5, 0.5))
    assert harness.answer(msg.PickResult)[0].place is None
    harness.send_recipe(20)
    assert harness.answer(msg.TerrainUpdated)[0].version == 1
    harness.window.send(msg.Turn(10.0, 0.0))
    harness.window.send(msg.PickRequest(7, 0.5, 0.6))
    picked, before = harness.answer(msg.PickResult)
    assert (picked.token, len(picked.place)) == (7, 3)
    reliefs = [each for each in before if isinstance(each, msg.Relief)]
    relief = reliefs[0] if reliefs else harness.answer(msg.Relief)[0]
    assert relief.height[15:25, 22:32].max() > 20.0
    harness.window.send(msg.RenderPicture("nowhere.png", 100, 100))
    assert harness.answer(msg.ErrorReport)[0].source == "picture"


@pytest.mark.slow
def test_adherence_is_measured_in_a_process(harness):
    harness.send_recipe(20)
    harness.answer(msg.TerrainUpdated)
    harness.window.send(msg.MeasureAdherence())
    measured, _ = harness.answer(msg.Agreement)
    assert measured.version == 1
    assert measured.figures["layers"]["hill"]["shapes"] == 1
    painted, present = measured.images["hill"]
    assert np.array_equal(painted, blob(20) > 0)
    assert present.shape == painted.shape
    assert present[painted].mean() > 0.3
    assert measured.realism["distance"] > 0.0
    assert measured.faults.shape == painted.shape


def test_a_missing_device_is_reported_and_the_engine_runs_on():
    harness = engine_harness("no such device")
    assert "no such device" in harness.answer(msg.EngineFacts)[0].device_error
    harness.send_recipe(20)
    harness.answer(msg.TerrainUpdated)
    harness.window.send(msg.MeasureAdherence())
    assert "no such device" in harness.answer(msg.ErrorReport)[0].line
    harness.close()


@needs_known_device
def test_a_failed_device_is_replaced(monkeypatch):
    harness = engine_harness(str(KNOWN[-1].index))
    harness.send_recipe(20)
    first, _ = harness.answer(msg.Relief)
    failed = harness.session.device

    monkeypatch.setattr(
        harness.session.terrain, "heights", failing(DeviceFailedError("the device fell over"))
    )
    harness.window.send(msg.PickRequest(1, 0.5, 0.6))
    error, _ = harness.answer(msg.ErrorReport)
    assert "fell over" in error.line
    assert "continuing on" in error.line
    again, _ = harness.answer(msg.Relief)
    assert harness.session.device != failed
    assert np.array_equal(again.height, first.height)
    harness.window.send(msg.PickRequest(2, 0.5, 0.6))
    assert harness.answer(msg.PickResult)[0].place is not None
    harness.close()


class FailingPacer:
    """Raises `error` instead of drawing."""

    def __init__(self):
        self.renderer = SimpleNamespace(is_empty=False, sharing="copy", clear=lambda: None)
        self.error, self.failed, self.stops = None, False, 0
        self.set_update_pending = lambda pending: None
        self.set_terrain = lambda *_: ""
        self.jump = lambda: None

    def due(self, *, moving):
        return None if self.error is None else 0.0

    def draw(self, camera):
        error, self.error = self.error, None
        raise error

    def stop(self):
        self.stops += 1


def test_defects_are_reported_and_the_engine_ends_with_the_window(monkeypatch, capsys):
    pacer = FailingPacer()
    harness = engine_harness(pacer=pacer)
    harness.send_recipe(20)
    harness.answer(msg.TerrainUpdated)
    with monkeypatch.context() as patched:
        patched.setattr(harness.session, "apply", failing(ZeroDivisionError("oops")))
        harness.send_recipe(10)
        assert "oops" in harness.answer(msg.ErrorReport)[0].line
    assert "ZeroDivisionError" in capsys.readouterr().err
    harness.send_recipe(5)
    assert harness.answer(msg.TerrainUpdated)[0].version == 3
    before = pacer.stops
    for failure in (InputError("odd"), ZeroDivisionError("0")):
        pacer.error = failure
        harness.window.send(msg.Turn(1.0, 0.0))
        error, _ = harness.answer(msg.ErrorReport)
        assert error.source == "view"
        assert str(failure) in error.line
    assert pacer.stops == before + 2
    assert "ZeroDivisionError" in capsys.readouterr().err
    harness.window.close()
    harness.join()


class FakeProcesses:
    """Channels without processes."""

    def __init__(self, created, *, device, draws=True, world=None):
        self.device, self.draws, self.frames = device, draws, FrameMemory()
        pairs = [[Channel(end, patient=False) for end in socket.socketpair()] for _ in range(2)]
        self.channels = {"engine": pairs[0][0], "placer": pairs[1][0]}
        self.peers = pairs[0][1], pairs[1][1]
        created.append(self)

    def exit_status(self):
        return "the engine crashed (signal 11)"

    def close(self):
        for channel in (*self.channels.values(), *self.peers):
            channel.close()
        self.frames.close()


@pytest.fixture
def launched(monkeypatch):
    created = []
    monkeypatch.setattr(link_module, "EngineProcesses", lambda **options: FakeProcesses(created, **options))
    return created


def test_crashed_processes_restart_at_last_without_opengl(document, qtbot, launched):
    link, errors = EngineLink(document), []
    link.device = "pocl"
    link.error_reported.connect(lambda error: errors.append(error.line))
    link.start()
    assert launched[-1].peers[0].receive() == link.view
    assert launched[-1].peers[0].receive() == msg.UpdatePending(1, fresh=True)
    assert isinstance(launched[-1].peers[1].receive(), msg.SketchUpdate)
    ends = ((2, "restarting."), (3, "restarting without the 3-D view."), (3, "start the program again."))
    for count, line in ends:
        launched[-1].peers[0].close()
        qtbot.waitUntil(lambda line=line: bool(errors) and errors[-1].endswith(line))
        assert errors[-1].startswith("The engine crashed (signal 11)")
        assert len(launched) == count
    assert [(each.device, each.draws) for each in launched] == [
        *(("pocl", True), ("pocl", True), ("pocl", False))
    ]
    link.start()
    assert launched[-1].draws
    link.stop()
    link.send(msg.Turn(1.0, 0.0))
    assert len(launched) == 4


def test_messages_become_attributes_and_signals(document, qtbot, placed, launched):
    link, received = EngineLink(document), []
    names = "placed_changed relief_changed adherence_changed picture_written picked facts_changed"
    for name in names.split():
        getattr(link, name).connect(lambda what, name=name: received.append((name, what)))
    link.start()
    engine, placer = launched[-1].peers
    for process, work, displayed in (
        (placer, "Placing features", "Placing features"),
        (engine, "Drawing", "Drawing"),
        (engine, "", "Placing features"),
    ):
        process.send(msg.Activity(work))
        qtbot.waitUntil(lambda displayed=displayed: link.activity == displayed)
    placer.send(placed)
    placer.send(msg.Unchanged("placement", 7))
    qtbot.waitUntil(lambda: link.placed is not None and link.placed.version == 7)
    relief = msg.Relief(1, 1, np.zeros((4, 4), np.float32), np.zeros((4, 4), np.uint8))
    facts = msg.EngineFacts(device="a")
    for message in (
        relief,
        msg.Unchanged("relief", 8),
        msg.PickResult(3, None),
        facts,
        msg.PictureWritten("b.png"),
    ):
        engine.send(message)
    qtbot.waitUntil(lambda: received[-1] == ("picture_written", msg.PictureWritten("b.png")))
    expected = "placed_changed placed_changed relief_changed picked facts_changed picture_written"
    assert [name for name, _ in received] == expected.split()
    assert (link.relief.version, link.facts.device) == (8, "a")
    link.stop()
    assert link.activity == ""


class Clock:
    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(placer_module, "time", SimpleNamespace(monotonic=lambda: self.now))


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def attempt(policy, clock, seconds, *, shapes=True) -> bool:
    """Work for `seconds` with a checkpoint every 10 ms; return whether it finished."""
    policy.start()
    try:
        for _ in range(round(seconds / 0.01)):
            clock.now += 0.01
            policy.checkpoint()
    except Superseded:
        return False
    policy.finish(shapes=shapes)
    return True


def test_superseded_work_is_cancelled_unless_short_or_half_done_and_never_twice_in_a_row(clock):
    policy = CancellationPolicy(lambda: False)
    assert all(attempt(policy, clock, 0.5) for _ in range(3))
    policy = CancellationPolicy(lambda: True)
    assert all(attempt(policy, clock, 0.09) for _ in range(5))
    policy = CancellationPolicy(lambda: True)
    done = [attempt(policy, clock, 0.5) for _ in range(9)]
    assert done == [True, False, True, False, True, False, True, False, True]

    newer = []
    policy = CancellationPolicy(lambda: bool(newer))
    assert attempt(policy, clock, 0.5)
    policy.start()
    clock.now += 0.26
    newer.append(1)
    policy.checkpoint()
    assert policy.finish(shapes=True) == pytest.approx(0.26)
    newer.clear()
    assert policy.shows_drafts
    assert all(attempt(policy, clock, 0.01, shapes=False) for _ in range(30))  # of materials, as one strokes
    assert attempt(policy, clock, 0.01)
    assert policy.shows_drafts  # a short placement is no measure of the next one
    assert all(attempt(policy, clock, 0.01) for _ in range(9))
    assert not policy.shows_drafts


@pytest.fixture
def placer():
    created = Harness(Placer, patient=False)
    yield created
    created.close()


def test_the_newest_of_many_sketches_is_placed_and_changes_accumulate(placer):
    sketch = Sketch(extent=2000.0)
    for step in range(20):
        placer.window.send(placer.update(sketch, {"mountain": blob(20, row=step)}))
    placer.thread.start()
    assert placer.answer(msg.Placement)[0].version == 20  # all were pending at its first look
    plan = placer.other.receive()
    whole = Sketch(extent=2000.0, layers={"mountain": blob(20, row=19)})
    assert np.array_equal(plan.recipe.points.painted, make_recipe(whole).points.painted)
    assert plan.version == 20
    placed = placer.placed(sketch, {"mountain": blob(30, row=19)})
    assert isinstance(placed, msg.Placement)
    assert placed.version == 21
    plan = placer.other.receive()
    assert np.array_equal(plan.sketch.layers["mountain"], blob(30, row=19))
    assert plan.started <= plan.placed


def test_a_draft_comes_before_a_long_placement(placer):
    placer.thread.start()
    layers = {"mountain": blob(10)}
    placer.placed(Sketch(extent=2000.0), layers)
    assert not placer.other.receive().draft
    placer.served._policy._slowest = 10.0  # s
    placer.placed(Sketch(extent=2000.0), {"mountain": np.maximum(blob(10), blob(14))})
    draft, final = placer.other.receive(), placer.other.receive()
    assert (draft.version, draft.draft, final.version, final.draft) == (2, True, 2, False)
    assert draft.recipe is not None
    placer.served._policy._slowest = 10.0
    painted = {"mountain": np.maximum(blob(10), blob(14)), "lake": blob(30)}
    placer.placed(Sketch(extent=2000.0), painted)
    draft, final = placer.other.receive(), placer.other.receive()
    assert [len(each.recipe.lakes) for each in (draft, final)] == [1, 1]
    placer.served._policy._slowest = 10.0
    placer.placed(Sketch(extent=2000.0), {"mountain": blob(11), "hill": blob(30)})  # another sketch
    assert not placer.other.receive().draft
    placer.served._policy._slowest = 0.5  # at the end of a stroke a draft would delay the terrain
    placer.placed(Sketch(extent=2000.0), {"mountain": blob(12), "hill": blob(30)})
    assert not placer.other.receive().draft


def test_the_share_of_a_long_placement_is_shown_with_the_remaining_time(placer, monkeypatch):
    monkeypatch.setattr(estimates, "_SOON", 0.0)
    placer.thread.start()
    placer.window.send(placer.update(Sketch(extent=2000.0), {"mountain": blob(10)}))
    texts = [message.text for message in placer.answer(msg.Placement)[1]]
    assert texts.pop() == ""
    pattern = r"Placing features: (\d+)%, about \d+ (s|min) left"
    shares = [int(re.fullmatch(pattern, text)[1]) for text in texts if text != "Placing features"]
    assert shares == sorted(shares)
    assert shares[-1] > 50


def test_a_draft_is_shown_until_the_terrain_is_there():
    session = TerrainSession(ComputeContext)
    sketches, (first, second) = zip(*map(recipe_of, (10, 20)), strict=True)
    session.apply([msg.RecipeUpdate(1, sketches[0], first, 0.0, 0.0)])
    session.apply([msg.RecipeUpdate(2, sketches[1], second, 0.0, 0.0, draft=True)])
    assert (session.version, session.sketch, session.recipe) == (1, sketches[0], first)
    assert session.terrain.sketch is sketches[1]
    session.apply([msg.RecipeUpdate(3, sketches[0], None, 0.0, 0.0)])  # undone
    assert (session.version, session.terrain.sketch) == (3, sketches[0])
    np.testing.assert_array_equal(session.terrain.recipe.points.painted, first.points.painted)
    session.apply(
        [
            msg.RecipeUpdate(4, sketches[1], second, 0.0, 0.0, draft=True),
            msg.RecipeUpdate(4, sketches[1], second, 0.0, 0.0),
        ]
    )
    assert (session.version, session.recipe) == (4, second)


def test_a_newer_sketch_cancels_what_is_drafted():
    waiting = False
    policy = CancellationPolicy(lambda: waiting)
    policy.start()
    policy.drafted()
    policy.checkpoint()
    waiting = True
    with pytest.raises(Superseded):
        policy.checkpoint()
    for _ in range(3):  # drafts follow the stroke
        policy.start()
        policy.checkpoint()
        policy.drafted()
        with pytest.raises(Superseded):
            policy.checkpoint()


def test_appearance_settings_do_not_place_again(placer):
    placer.thread.start()
    layers = {"mountain": blob(20)}
    assert isinstance(placer.placed(Sketch(extent=2000.0), layers), msg.Placement)
    placer.other.receive()
    answer = placer.placed(Sketch(extent=2000.0, weather={"clouds": 0.9}, name="other"), layers)
    assert isinstance(answer, msg.Unchanged)
    assert answer.version == 2
    plan = placer.other.receive()
    assert plan.recipe is None
    assert plan.sketch.weather["clouds"] == 0.9
    assert isinstance(
        placer.placed(Sketch(extent=2000.0, weather={"clouds": 0.9}, seed=5), layers), msg.Placement
    )


def test_an_invalid_sketch_and_a_defect_are_reported_and_the_next_sketch_is_placed(
    placer, monkeypatch, capsys
):
    placer.thread.start()
    layers = {"mountain": blob(20)}
    gone = RasterSource("/gone.tif", role="elevation")
    placer.window.send(msg.SketchUpdate(1, Sketch(extent=2000.0, rasters=(gone,))))
    error, _ = placer.answer(msg.ErrorReport)
    assert error.source == "sketch"
    assert "gone.tif" in error.line
    placer.version = 1
    assert placer.placed(Sketch(extent=2000.0), layers).version == 2
    with monkeypatch.context() as patched:
        patched.setattr(from_sketch, "evaluation", failing(ZeroDivisionError("oops")))
        assert "oops" in placer.placed(Sketch(extent=2000.0), {"mountain": blob(21)}).line
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert isinstance(placer.placed(Sketch(extent=2000.0), {"mountain": blob(22)}), msg.Placement)


_RECORDING = """
import sys
from pathlib import Path
from sketchterrain.generation.stages import STAGES
from sketchterrain.ui.engine import placer
from sketchterrain.ui.engine.channel import ContentChannel

class Recorder(placer.Placer):
    first = None
    def _place(self, version, sketch):
        super()._place(version, sketch)
        if self.first is None:
            self.first = self._last
        rivers = [each.sketch.vectors["river"] for each in (self.first, self._last)]
        changed = [name for name in STAGES if self._last[name] is not self.first[name]]
        changed += ["vectors.river"] * (rivers[0] is not rivers[1])
        Path(sys.argv[3]).write_text(" ".join(changed))

Recorder(*(ContentChannel.from_descriptor(int(number), patient=False) for number in sys.argv[1:3])).run()
"""


@pytest.mark.slow
def test_ten_drags_of_a_road_leave_the_natural_terrain_as_it_is(qapp, monkeypatch, tmp_path):
    command = [sys.executable, "-P", "-c", _RECORDING]
    monkeypatch.setattr(channel_module, "module_command", lambda _, *arguments: [*command, *arguments])
    saved, (window, window_end), (engine, engine_end) = (
        tmp_path / "changed",
        *(socket.socketpair() for _ in "12"),
    )
    ends = [window_end, engine_end]
    child = start_process("placer", [*(str(end.fileno()) for end in ends), str(saved)], ends)
    document, placed, link = Document(load_sketch("andorra")), [], ContentChannel(window)
    updates, road = UpdateBuilder(document), int(document.sketch.vectors["road"].ids[7])
    for number in range(11):
        if number:
            handles = SelectedFeature.find(document, Selection("road", road)).vertex_handles
            drag = FeatureDrag(document, placed[-1], handles[len(handles) // 2])
            drag.to(drag.handle.x + 3.0, drag.handle.y)
            drag.finish()
        link.send(updates.next()[0])
        while not isinstance(message := link.receive(), msg.Placement):
            assert not isinstance(message, msg.ErrorReport), message.line
        placed.append(message)
    assert placed[0].roads != placed[-1].roads
    link.send(msg.Quit())
    assert child.wait(300.0) == 0
    assert saved.read_text().split() == ["files", "roads", "recipe"]
    for end in (link, engine):
        end.close()
