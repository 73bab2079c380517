import math

import numpy as np
import pytest

from sketchterrain.tiles.lod import ScreenError
from sketchterrain.tiles.refinement import ROOT_LEVEL

UNBOUNDED = (-math.inf, -math.inf, math.inf, math.inf)


class Written:
    """What each slot holds, told by when its own vertices and its parent's were computed."""

    def __init__(self, toy, stream):
        self._toy, self._stream = toy, stream
        self.now, self.changes = 0, []
        self.own, self.parent, self.count = {}, {}, 0

    def write(self, batch):
        done = set()
        for key, slot, parent in zip(batch.keys, batch.slots.tolist(), batch.parents.tolist(), strict=True):
            assert (parent >= 0) == (key.level > ROOT_LEVEL)
            if parent >= 0:
                assert self.own[parent][0] == (key.level - 1, key.col >> 1, key.row >> 1)
            done.add(slot)
            self.own[slot] = key, self.now
            self.parent[slot] = self.own[parent][1] if parent >= 0 else self.now
        assert len(done) == len(batch.keys)
        self.count += len(batch.keys)
        self._stream.mark_generated(batch, self._toy.generate(batch), seconds=None)

    def change(self, area):
        self.now += 1
        self.changes.append(area)
        return self._stream.invalidate([area])

    def renewed(self, draws, view):
        while batch := self._stream.stale_batch(draws):
            self.write(batch)
            draws = self._stream.draw_list(view)
        return draws

    def is_new(self, key, slot):
        held, own = self.own[slot]
        assert held == key
        return own >= self._touched(key, 1) and self.parent[slot] >= self._touched(key, 2)

    def _touched(self, key, quads):
        """When the last change came near a tile."""
        width = self._toy.EXTENT * 2.0**-key.level
        margin = quads * width / self._toy.QUADS
        west, south = key.col * width - margin, key.row * width - margin
        east, north = west + width + 2 * margin, south + width + 2 * margin
        near = [w <= east and e >= west and s <= north and n >= south for w, s, e, n in self.changes]
        return max((number + 1 for number, touched in enumerate(near) if touched), default=0)


@pytest.fixture
def world(toy):
    stream = toy.new_stream(metric=ScreenError(6.0, quad=1e9))
    return stream, Written(toy, stream)


def frame(stream, written, view, *, tiles=6):
    batch = stream.plan(view, budget=1.0)
    made = type(batch)(batch.keys[:tiles], batch.slots[:tiles], batch.parents[:tiles])
    if made:
        written.write(made)
    return written.renewed(stream.advance(view, elapsed=1 / 30), view)


def all_new(written, draws):
    slots = draws.slots.tolist()
    return all(written.is_new(key, slot) for key, slot in zip(draws.keys, slots, strict=True))


def converge(stream, written, view):
    for _ in range(400):
        draws = frame(stream, written, view, tiles=100)
        if stream.converged:
            return draws
    raise AssertionError("it never settled")


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_a_moving_eye_sees_only_the_newest_ground(toy, world, seed):
    stream, written = world
    toy.limited(stream, 6)
    rng = np.random.default_rng(seed)
    eye = np.array([300.0, 200.0, 60.0])
    for step in range(120):
        eye[:2] += rng.uniform(-30, 30, 2)
        view = toy.view_from(tuple(eye), everywhere=False, heading=step / 15)
        draws = frame(stream, written, view)
        assert all_new(written, draws)
        if step % 3 == 0:
            x, y = rng.uniform(-1500, 1500, 2)
            wide = 10.0 ** rng.uniform(-1, 3)
            area = (x, y, x + wide, y + wide * rng.uniform(0.3, 3))
            written.change(UNBOUNDED if step % 30 == 9 else area)
            draws = written.renewed(stream.draw_list(view), view)
            assert all_new(written, draws)
    draws = converge(stream, written, view)
    assert all_new(written, draws)
    codes, slots = stream.pool.tiles()
    assert not stream.pool.stale[slots].any()
    assert all(written.is_new(written.own[slot][0], slot) for slot in slots.tolist())
    assert len(codes) <= stream.pool.slots


def test_a_batch_that_is_cut_short_leaves_no_outdated_tile(toy, world):
    """A frame that stops amid a batch leaves nothing wrong: the rest is written anew later."""
    stream, written = world
    view = toy.view_from((300.0, 200.0, 60.0))
    converge(stream, written, view)
    for tiles in (1, 2, 5, 64):
        toy.limited(stream, tiles)
        written.change(UNBOUNDED)
        for _ in range(600):
            draws = frame(stream, written, view, tiles=tiles)
            assert all_new(written, draws)
            if stream.converged:
                break
        assert stream.converged


def test_small_changes_write_few_tiles_and_those_out_of_view_later(toy, world):
    stream, written = world
    view = toy.view_from((300.0, 200.0, 60.0), everywhere=False)
    draws = converge(stream, written, view)
    before = written.count
    assert written.change((1e6, 1e6, 1e6 + 5, 1e6 + 5)) == 0
    converge(stream, written, view)
    assert written.count == before
    written.change((310.0, 300.0, 311.0, 301.0))
    draws = written.renewed(stream.draw_list(view), view)
    now = written.count - before
    assert all_new(written, draws)
    assert 0 < now <= 12
    assert now < 0.2 * len(draws.keys)

    converge(stream, written, view)
    before = written.count
    written.change((200.0, 0.0, 400.0, 100.0))  # behind the eye
    written.renewed(stream.draw_list(view), view)
    behind = written.count - before
    everywhere = written.change(UNBOUNDED)
    written.renewed(stream.draw_list(view), view)
    assert everywhere == 0
    assert behind < 0.3 * (written.count - before)
    # One turns round before there was time: it is written before it is drawn.
    south = toy.view_from((300.0, 200.0, 60.0), everywhere=False, heading=np.pi)
    draws = written.renewed(stream.draw_list(south), south)
    assert all_new(written, draws)


def test_changed_tiles_that_nothing_needs_are_dropped(toy, world):
    stream, written = world
    here, there = (toy.view_from((x, 200.0, 60.0)) for x in (300.0, 12_000.0))
    converge(stream, written, here)
    converge(stream, written, there)
    held = stream.pool.count
    gone = written.change(UNBOUNDED)
    assert gone > 0
    assert stream.pool.count == held - gone
    assert all_new(written, converge(stream, written, here))


def test_bounds_and_errors_follow_the_changed_ground(toy, world):
    """Boxes and errors are those of what was written last: levels of detail follow."""
    stream, written = world
    view = toy.view_from((300.0, 200.0, 60.0))
    draws = converge(stream, written, view)
    few = len(draws.keys)
    written._toy = Raised(toy)
    written.change(UNBOUNDED)
    written.renewed(stream.draw_list(view), view)
    draws = converge(stream, written, view)
    fresh = toy.new_stream(metric=ScreenError(6.0, quad=1e9)).generate_all(view, Raised(toy).generate)
    assert len(draws.keys) > 1.2 * few
    assert set(draws.keys) == set(fresh.keys)
    assert stream.pool.top[draws.slots].min() > 100.0


class Raised:
    """The same ground, so much higher and rougher."""

    def __init__(self, toy):
        self._toy = toy
        self.EXTENT, self.QUADS = toy.EXTENT, toy.QUADS

    def generate(self, batch):
        facts = self._toy.generate(batch)
        facts["low"] += 150.0
        facts["high"] += 150.0
        facts["error"] *= 3.0
        return facts
