"""Engine and placer on threads of the test, and the link to them: what is missing or fails is said."""

import socket
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import list_devices
from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.terrain import building as from_sketch
from sketchterrain.terrain.building import make_recipe
from sketchterrain.terrain.changes import EVERYWHERE
from sketchterrain.ui.engine import link as link_module
from sketchterrain.ui.engine import placer as placer_module
from sketchterrain.ui.engine import protocol as msg
from sketchterrain.ui.engine.background import JobQueue
from sketchterrain.ui.engine.channel import Channel, pickle_without, unpickle_with
from sketchterrain.ui.engine.engine import Engine
from sketchterrain.ui.engine.frames import FrameMemory
from sketchterrain.ui.engine.link import EngineLink, ViewSource
from sketchterrain.ui.engine.placer import CancellationPolicy, Placer, Superseded
from sketchterrain.ui.engine.sketch_updates import settings_of
from sketchterrain.ui.engine.terrain_session import TerrainSession


def test_a_frame_in_shared_memory_becomes_the_picture_pixel_for_pixel(qapp):
    memory, source, shown, told = FrameMemory(), ViewSource(msg.ViewState()), [], []
    source.send = told.append
    source.frame_shown.connect(shown.append)
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
        assert shown[-1] is source.frame is facts
    assert told == [msg.FrameAcknowledged(), msg.FrameAcknowledged()]
    memory.close()


class Around:
    """An engine without OpenGL or a placer on a thread, and the other ends of its two channels."""

    def __init__(self, make, *, patient):
        (mine, its), (my_other, its_other) = socket.socketpair(), socket.socketpair()
        self.window, self.other = Channel(mine), Channel(my_other, patient=not patient)
        self.its = Channel(its, patient=not patient), Channel(its_other, patient=patient)
        self.made = make(*self.its)
        self.thread = threading.Thread(target=self.made.run, daemon=True)
        self.version = 0

    def update(self, sketch, layers):
        self.version += 1
        patches = {name: msg.LayerPatch(0, 0, image) for name, image in layers.items()}
        shape = next(iter(layers.values())).shape
        return msg.SketchUpdate(self.version, shape, settings_of(sketch), patches)

    def plan(self, column):
        layers = {"hill": blob(column)}
        sketch = Sketch(extent=3000.0, layers=layers)
        recipe = pickle_without(make_recipe(sketch), sketch)
        self.other.send(msg.RecipeUpdate(self.update(sketch, layers), recipe, (EVERYWHERE,), 0.0, 0.0, 0.0))

    def answer(self, kind):
        """Return the next message of a kind, and those before it."""
        before = []
        while not isinstance(message := self.window.receive(), kind):
            before.append(message)
        return message, before

    def placed(self, sketch, layers):
        """Send a sketch to the placer and return its answer."""
        self.window.send(self.update(sketch, layers))
        return self.answer((msg.Placement, msg.Unchanged, msg.ErrorReport))[0]

    def end(self):
        self.window.send(msg.Quit())
        self.window_is_gone()

    def window_is_gone(self):
        self.thread.join(20.0)
        assert not self.thread.is_alive()
        for channel in (self.window, self.other, *self.its):
            channel.close()


def around_engine(device=None, pacer=None):
    session = TerrainSession(ComputeContext, device=device)
    facts = msg.EngineFacts(device_error=session.device_error)
    options = {"session": session, "pacer": pacer, "jobs": JobQueue(), "facts": facts}
    around = Around(lambda *its: Engine(*its, **options), patient=True)
    around.session = session
    around.thread.start()
    return around


def failing(error):
    def fail(*_, **__):
        raise error

    return fail


def blob(column, row=10):
    image = np.zeros((48, 48), np.uint8)
    image[row : row + 20, column : column + 15] = 1
    return image


@pytest.fixture
def around():
    made = around_engine()
    yield made
    made.end()


def test_the_newest_of_plans_that_wait_counts_and_all_their_areas(around, monkeypatch):
    taken, take, gate = [], around.session.apply, threading.Event()

    def slow(plans):
        gate.wait(20.0)
        taken.extend(plan.sketch.version for plan in plans)
        return take(plans)

    monkeypatch.setattr(around.session, "apply", slow)
    for column in (5, 10, 15, 20):
        around.plan(column)
    gate.set()
    versions = [around.answer(msg.TerrainUpdated)[0].version]
    while versions[-1] < 4:
        versions.append(around.answer(msg.TerrainUpdated)[0].version)
    assert taken == [1, 2, 3, 4]
    assert versions == sorted(versions)
    assert around.session.version == 4


def test_without_opengl_there_are_a_relief_picks_and_adherence_once_there_is_a_terrain(around):
    around.window.send(msg.MeasureAdherence())
    assert "not ready yet" in around.answer(msg.ErrorReport)[0].line
    around.window.send(msg.Pick(1, 0.5, 0.5))
    assert around.answer(msg.PickResult)[0].place is None
    around.plan(20)
    assert around.answer(msg.TerrainUpdated)[0].version == 1
    around.window.send(msg.Turn(10.0, 0.0))
    around.window.send(msg.Pick(7, 0.5, 0.6))
    picked, before = around.answer(msg.PickResult)
    assert (picked.token, len(picked.place)) == (7, 3)
    reliefs = [each for each in before if isinstance(each, msg.Relief)]
    relief = reliefs[0] if reliefs else around.answer(msg.Relief)[0]
    assert relief.height[15:25, 22:32].max() > 20.0
    around.window.send(msg.RenderPicture("nowhere.png", 100, 100))
    assert around.answer(msg.ErrorReport)[0].source == "picture"
    around.window.send(msg.MeasureAdherence())
    measured, _ = around.answer(msg.Adherence)
    assert measured.version == 1
    assert measured.figures["layers"]["hill"]["shapes"] == 1
    painted, shown = measured.images["hill"]
    assert np.array_equal(painted, blob(20) > 0)
    assert shown.shape == painted.shape
    assert shown[painted].mean() > 0.3


def test_without_a_device_it_says_what_to_do_and_runs_on():
    around = around_engine("no such device")
    assert "no such device" in around.answer(msg.EngineFacts)[0].device_error
    around.plan(20)
    around.answer(msg.TerrainUpdated)
    around.window.send(msg.MeasureAdherence())
    assert "no such device" in around.answer(msg.ErrorReport)[0].line
    around.end()


def test_a_device_that_fails_is_left_for_another_one(around, monkeypatch):
    if sum(device.type == "CPU" for device in list_devices()) < 2:
        pytest.skip("there is no second device")
    around.plan(20)
    first, _ = around.answer(msg.Relief)
    failed = around.session.device

    monkeypatch.setattr(around.session.terrain, "heights", failing(DeviceFailedError("the device fell over")))
    around.window.send(msg.Pick(1, 0.5, 0.6))
    trouble, _ = around.answer(msg.ErrorReport)
    assert "fell over" in trouble.line
    assert "continuing on" in trouble.line
    again, _ = around.answer(msg.Relief)
    assert around.session.device != failed
    assert np.array_equal(again.height, first.height)
    around.window.send(msg.Pick(2, 0.5, 0.6))
    assert around.answer(msg.PickResult)[0].place is not None


class FailingPacer:
    """Draws nothing; its next frame raises what it is given."""

    def __init__(self):
        self.renderer = SimpleNamespace(is_empty=False, sharing="copy", clear=lambda: None)
        self.error, self.failed, self.stops = None, False, 0
        self.set_update_pending = lambda pending: None
        self.set_terrain = lambda *_: ""

    def due(self, *, moving):
        return None if self.error is None else 0.0

    def draw(self, camera):
        error, self.error = self.error, None
        raise error

    def stop(self):
        self.stops += 1


def test_defects_of_plans_and_frames_are_reported_and_it_ends_when_the_window_is_gone(monkeypatch, capsys):
    pacer = FailingPacer()
    around = around_engine(pacer=pacer)
    around.plan(20)
    around.answer(msg.TerrainUpdated)
    with monkeypatch.context() as patched:
        patched.setattr(around.session, "apply", failing(ZeroDivisionError("oops")))
        around.plan(10)
        assert "oops" in around.answer(msg.ErrorReport)[0].line
    assert "ZeroDivisionError" in capsys.readouterr().err
    around.plan(5)
    assert around.answer(msg.TerrainUpdated)[0].version == 3
    before = pacer.stops
    for error in (InputError("odd"), ZeroDivisionError("0")):
        pacer.error = error
        around.window.send(msg.Turn(1.0, 0.0))
        trouble, _ = around.answer(msg.ErrorReport)
        assert trouble.source == "view"
        assert str(error) in trouble.line
    assert pacer.stops == before + 2
    assert "ZeroDivisionError" in capsys.readouterr().err
    around.window.close()
    around.window_is_gone()


class FakeChildren:
    """Processes that do nothing, and end when they are told to."""

    def __init__(self, made, *, device, draws=True, world=None):
        self.device, self.draws, self.frames = device, draws, FrameMemory()
        pairs = [[Channel(end, patient=False) for end in socket.socketpair()] for _ in range(2)]
        self.channels = {"engine": pairs[0][0], "placer": pairs[1][0]}
        self.its = pairs[0][1], pairs[1][1]
        made.append(self)

    def exit_status(self):
        return "the engine crashed (signal 11)"

    def close(self):
        for channel in (*self.channels.values(), *self.its):
            channel.close()
        self.frames.close()


@pytest.fixture
def children(monkeypatch):
    made = []
    monkeypatch.setattr(link_module, "EngineProcesses", lambda **options: FakeChildren(made, **options))
    return made


def test_a_link_starts_crashed_processes_again_at_last_without_opengl(document, qtbot, children):
    link, troubles = EngineLink(document), []
    link.device = "pocl"
    link.error_reported.connect(lambda trouble: troubles.append(trouble.line))
    link.start()
    assert children[-1].its[0].receive() == link.view
    assert children[-1].its[0].receive() == msg.UpdatePending(1, fresh=True)
    assert set(children[-1].its[1].receive().layers) == set(LAYERS)
    ends = ((2, "restarting."), (3, "restarting without the 3-D view."), (3, "start the program again."))
    for count, line in ends:
        children[-1].its[0].close()
        qtbot.waitUntil(lambda line=line: bool(troubles) and troubles[-1].endswith(line))
        assert troubles[-1].startswith("The engine crashed (signal 11)")
        assert len(children) == count
    assert [(each.device, each.draws) for each in children] == [
        *(("pocl", True), ("pocl", True), ("pocl", False))
    ]
    link.start()
    assert children[-1].draws
    link.stop()
    link.send(msg.Turn(1.0, 0.0))
    assert len(children) == 4


def test_a_link_hands_over_what_the_processes_tell(document, qtbot, placed, children):
    link, told = EngineLink(document), []
    names = "placed_changed relief_changed adherence_changed picture_written picked facts_changed"
    for name in names.split():
        getattr(link, name).connect(lambda what, name=name: told.append((name, what)))
    link.start()
    engine, placer = children[-1].its
    for process, work, shown in (
        (placer, "Placing features", "Placing features"),
        (engine, "Drawing", "Drawing"),
        (engine, "", "Placing features"),
    ):
        process.send(msg.Activity(work))
        qtbot.waitUntil(lambda shown=shown: link.activity == shown)
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
    qtbot.waitUntil(lambda: told[-1] == ("picture_written", msg.PictureWritten("b.png")))
    wanted = "placed_changed placed_changed relief_changed picked facts_changed picture_written"
    assert [name for name, _ in told] == wanted.split()
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


def attempt(policy, clock, seconds) -> bool:
    """Place for so long, with a checkpoint every 10 ms; return whether it was finished."""
    policy.start()
    try:
        for _ in range(round(seconds / 0.01)):
            clock.now += 0.01
            policy.checkpoint()
    except Superseded:
        return False
    policy.finish()
    return True


def test_superseded_work_is_abandoned_unless_short_or_half_done_and_never_twice_in_a_row(clock):
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
    assert policy.finish() == pytest.approx(0.26)


@pytest.fixture
def placer():
    made = Around(Placer, patient=False)
    yield made
    made.end()


def test_the_newest_of_many_is_placed_and_plans_add_up(placer):
    sketch = Sketch(extent=4000.0)
    for step in range(20):
        placer.window.send(placer.update(sketch, {"mountain": blob(20, row=step)}))
    placer.thread.start()
    assert placer.answer(msg.Placement)[0].version == 20  # all of them waited when it looked first
    plan = placer.other.receive()
    whole = Sketch(extent=4000.0, layers={"mountain": blob(20, row=19)})
    assert np.array_equal(unpickle_with(plan.recipe, whole).painted, make_recipe(whole).painted)
    assert plan.sketch.version == 20
    placed = placer.placed(sketch, {"mountain": blob(30, row=19)})
    assert isinstance(placed, msg.Placement)
    assert placed.version == 21
    plan = placer.other.receive()
    assert plan.areas
    assert all(west < east for west, _, east, _ in plan.areas)
    assert list(plan.sketch.layers) == ["mountain"]
    assert plan.started <= plan.sent <= time.monotonic()


def test_looks_change_nothing_that_is_placed(placer):
    placer.thread.start()
    layers = {"mountain": blob(20)}
    assert isinstance(placer.placed(Sketch(), layers), msg.Placement)
    placer.other.receive()
    answer = placer.placed(Sketch(weather={"clouds": 0.9}, name="other"), layers)
    assert isinstance(answer, msg.Unchanged)
    assert answer.version == 2
    plan = placer.other.receive()
    assert (plan.recipe, plan.areas) == (None, ())
    assert plan.sketch.settings["weather"]["clouds"] == 0.9
    assert isinstance(placer.placed(Sketch(weather={"clouds": 0.9}, seed=5), layers), msg.Placement)


def test_an_invalid_sketch_and_a_defect_are_reported_and_the_next_sketch_is_placed(
    placer, monkeypatch, capsys
):
    placer.thread.start()
    layers = {"mountain": blob(20)}
    placer.window.send(msg.SketchUpdate(1, (48, 48), {**settings_of(Sketch()), "seed": -5}, {}))
    trouble, _ = placer.answer(msg.ErrorReport)
    assert trouble.source == "sketch"
    assert "seed" in trouble.line
    placer.version = 1
    assert placer.placed(Sketch(), layers).version == 2
    with monkeypatch.context() as patched:
        patched.setattr(from_sketch, "make_recipe", failing(ZeroDivisionError("oops")))
        assert "oops" in placer.placed(Sketch(), {"mountain": blob(21)}).line
    assert "ZeroDivisionError" in capsys.readouterr().err
    assert isinstance(placer.placed(Sketch(), {"mountain": blob(22)}), msg.Placement)
