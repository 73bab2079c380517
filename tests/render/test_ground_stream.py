"""Streaming of the ground by the clock of the test: a budget a frame, a whole picture after a leap."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.render import Quality
from sketchterrain.render.ground_stream import LEAP, LEAP_BUDGET, GroundStream
from sketchterrain.tiles import ScreenError

from .conftest import Waves
from .ground_model import TILE_BYTES
from .ground_pictures import Eye, camera_towards, holes

pytestmark = pytest.mark.gl

SIZE = (160, 90)
RATE = 30.0
BUDGET = 0.006
REACH = 6000.0
QUALITY = Quality(quads=64, tile_memory=900 * TILE_BYTES)


class Slow(Waves):
    """Takes 1.2 ms for a batch, 0.4 ms for a level and 0.5 ms for a tile, and up to a quarter more."""

    def __init__(self):
        super().__init__()
        self.clock = 0.0
        self.rng = np.random.default_rng(9)

    def write_tiles(self, keys, slots, parents, store):
        levels = len({key[0] for key in keys})
        self.clock += (0.0012 + 0.0004 * levels + 0.0005 * len(keys)) * self.rng.uniform(1.0, 1.25)
        return super().write_tiles(keys, slots, parents, store)


@pytest.fixture
def slow():
    return Slow()


def opened(gl, slow, *, quad=12.0):
    metric = ScreenError(tolerance=0.4, quad=quad)
    return GroundStream(gl, slow, QUALITY, metric=metric, timer=lambda: slow.clock)


def frame(stream, eye, bearing=30.0):
    camera = camera_towards(eye, 0.0, bearing, -10.0, REACH)
    return stream.update(camera, SIZE, elapsed=1 / RATE, budget=BUDGET, draw_distance=REACH)


def test_frames_that_generate_keep_to_their_budget(gl, slow):
    stream = opened(gl, slow, quad=5.0)
    eye = np.array([300.0, 200.0, 160.0])
    for _ in range(90):
        frame(stream, tuple(eye))
    took, tiles = [], 0
    for _ in range(240):
        eye += [16.0, 10.0, 0.0]
        stats = frame(stream, tuple(eye))
        assert not stats.leapt
        if stats.tiles_generated:
            took.append(stats.generation_seconds)
            tiles += stats.tiles_generated
    assert len(took) > 50
    assert np.mean(np.array(took) <= BUDGET) >= 0.99
    assert max(took) <= 2 * BUDGET
    assert tiles > 1.5 * len(took)  # it is used, too


def test_a_leap_gives_a_whole_picture_at_once_and_a_settled_one_within_a_second(gl, slow):
    stream, seen = opened(gl, slow), Eye(gl, SIZE)
    for _ in range(40):
        frame(stream, (300.0, 200.0, 160.0))
    eye = (70_300.0, -30_200.0, 150.0)
    stats = frame(stream, eye)
    assert stats.leapt
    assert stats.generation_seconds >= LEAP_BUDGET or stats.settled
    assert stats.generation_seconds <= LEAP_BUDGET + 0.06  # the batch that was begun in time
    camera = camera_towards(eye, 0.0, 30.0, -10.0, REACH)
    assert holes(seen.see(stream, camera), camera, REACH, -100.0) == 0
    for _ in range(int(RATE)):
        stats = frame(stream, eye)
        assert not stats.leapt
    assert stats.settled


def test_only_large_steps_are_leaps_and_a_settled_picture_stays_the_same(gl, slow):
    stream = opened(gl, slow)
    assert frame(stream, (0.0, 0.0, 160.0)).leapt
    assert not frame(stream, (0.9 * LEAP * slow.extent, 0.0, 160.0)).leapt
    assert frame(stream, (2.0 * LEAP * slow.extent, 0.0, 160.0)).leapt

    stream, seen = opened(gl, slow), Eye(gl, SIZE)
    camera = camera_towards((300.0, 200.0, 160.0), 0.0, 30.0, -10.0, REACH)
    stream.settle(camera, SIZE, draw_distance=REACH)
    before = seen.see(stream, camera).copy()
    for _ in range(5):
        stats = frame(stream, camera.eye)
        assert stats.settled
        assert not stats.leapt
        assert stats.tiles_generated == 0
    assert (seen.see(stream, camera) == before).all()
