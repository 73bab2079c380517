"""The placer: the newest sketch is placed, without starving one who paints on and on."""

import socket
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from sketchterrain.sketch import Sketch
from sketchterrain.terrain import from_sketch, make_recipe
from sketchterrain.ui.engine import placer
from sketchterrain.ui.engine.channel import Channel, unpickled
from sketchterrain.ui.engine.placer import CancellationPolicy, Placer, Superseded
from sketchterrain.ui.engine.protocol import (
    LayerPatch,
    Placed,
    Quit,
    SketchUpdate,
    StillPlaced,
    Trouble,
    Working,
)
from sketchterrain.ui.engine.sketch_updates import settings_of


class Clock:
    def __init__(self, monkeypatch):
        self.now = 100.0
        monkeypatch.setattr(placer, "time", SimpleNamespace(monotonic=lambda: self.now))

    def spend(self, seconds):
        self.now += seconds


@pytest.fixture
def clock(monkeypatch):
    return Clock(monkeypatch)


def attempt(patience, clock, seconds) -> bool:
    """Place for so long, with a checkpoint every 10 ms; return whether it was finished."""
    patience.begin()
    try:
        for _ in range(round(seconds / 0.01)):
            clock.spend(0.01)
            patience.checkpoint()
    except Superseded:
        return False
    patience.end()
    return True


def test_short_work_and_work_that_nothing_supersedes_is_finished(clock) -> None:
    patience = CancellationPolicy(lambda: False)
    assert all(attempt(patience, clock, 0.5) for _ in range(3))

    patience = CancellationPolicy(lambda: True)
    assert all(attempt(patience, clock, 0.09) for _ in range(5))


def test_superseded_work_is_abandoned_unless_half_done_and_never_twice_in_a_row(clock) -> None:
    patience = CancellationPolicy(lambda: True)
    done = [attempt(patience, clock, 0.5) for _ in range(9)]
    assert done == [True, False, True, False, True, False, True, False, True]

    newer = []
    patience = CancellationPolicy(lambda: bool(newer))
    assert attempt(patience, clock, 0.5)
    patience.begin()
    clock.spend(0.26)
    newer.append(1)
    patience.checkpoint()
    assert patience.end() == pytest.approx(0.26)


class Around:
    """A placer on a thread, and the other ends of its channels."""

    def __init__(self):
        mine, its_window = socket.socketpair()
        other, its_engine = socket.socketpair()
        self.window, self.engine = Channel(mine), Channel(other)
        self.its = Channel(its_window), Channel(its_engine, patient=False)
        self.placer = Placer(*self.its)
        self.thread = threading.Thread(target=self.placer.run, daemon=True)
        self.version = 0

    def send(self, sketch, layers):
        self.version += 1
        patches = {name: LayerPatch(0, 0, image) for name, image in layers.items()}
        shape = next(iter(layers.values())).shape
        self.window.send(SketchUpdate(self.version, shape, settings_of(sketch), patches))

    def answer(self):
        while isinstance(message := self.window.receive(), Working):
            pass
        return message


@pytest.fixture
def around():
    made = Around()
    yield made
    made.window.send(Quit())
    made.thread.join(10.0)
    assert not made.thread.is_alive()
    for channel in (made.window, made.engine, *made.its):
        channel.close()


def painted(row, column):
    image = np.zeros((64, 64), np.uint8)
    image[row : row + 12, column : column + 12] = 1
    return image


def test_the_newest_of_many_is_placed_and_plans_add_up(around):
    sketch = Sketch(extent=4000.0)
    for step in range(20):
        around.send(sketch, {"mountain": painted(step, 20)})
    around.thread.start()
    assert around.answer().version == 20  # all of them waited when it looked first
    plan = around.engine.receive()
    whole = Sketch(extent=4000.0, layers={"mountain": painted(19, 20)})
    assert np.array_equal(unpickled(plan.recipe, but=whole).painted, make_recipe(whole).painted)
    assert plan.update.version == 20
    around.send(sketch, {"mountain": painted(19, 40)})
    placed = around.answer()
    assert isinstance(placed, Placed)
    assert placed.version == 21
    plan = around.engine.receive()
    assert plan.areas
    assert all(west < east for west, _, east, _ in plan.areas)
    assert list(plan.update.layers) == ["mountain"]
    assert plan.begun <= plan.ready <= time.monotonic()


def test_looks_change_nothing_that_is_placed(around):
    around.thread.start()
    layers = {"mountain": painted(10, 20)}
    around.send(Sketch(), layers)
    assert isinstance(around.answer(), Placed)
    around.engine.receive()
    around.send(Sketch(weather={"clouds": 0.9}, name="other"), layers)
    answer = around.answer()
    assert isinstance(answer, StillPlaced)
    assert answer.version == 2
    plan = around.engine.receive()
    assert (plan.recipe, plan.areas) == (None, ())
    assert plan.update.settings["weather"]["clouds"] == 0.9
    around.send(Sketch(weather={"clouds": 0.9}, seed=5), layers)
    assert isinstance(around.answer(), Placed)


def test_an_invalid_sketch_and_a_defect_are_reported_and_the_next_sketch_is_placed(
    around, monkeypatch, capsys
) -> None:
    around.thread.start()
    layers = {"mountain": painted(10, 20)}
    settings = settings_of(Sketch())
    around.window.send(SketchUpdate(1, (64, 64), {**settings, "seed": -5}, {}))
    trouble = around.answer()
    assert isinstance(trouble, Trouble)
    assert trouble.what == "sketch"
    assert "seed" in trouble.line
    around.version = 1
    around.send(Sketch(), layers)
    assert around.answer().version == 2

    def broken(*_, **__):
        raise ZeroDivisionError("oops")

    with monkeypatch.context() as patched:
        patched.setattr(from_sketch, "make_recipe", broken)
        around.send(Sketch(), {"mountain": painted(11, 20)})
        trouble = around.answer()
    assert isinstance(trouble, Trouble)
    assert "oops" in trouble.line
    assert "ZeroDivisionError" in capsys.readouterr().err
    around.send(Sketch(), {"mountain": painted(12, 20)})
    assert isinstance(around.answer(), Placed)
