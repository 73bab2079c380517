import numpy as np
import pytest

from sketchterrain.tiles.lod import ScreenError
from sketchterrain.tiles.quadtree import UNBOUNDED
from sketchterrain.tiles.refinement import ROOT_LEVEL


class Writer:
    """Contents of each slot: the tile, and when its own vertices and its parent's were computed."""

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

    def rewritten(self, draws, view):
        while batch := self._stream.stale_batch(draws):
            self.write(batch)
            draws = self._stream.draw_list(view)
        return draws

    def is_new(self, key, slot):
        cached, own = self.own[slot]
        assert cached == key
        return own >= self._last_change(key, 1) and self.parent[slot] >= self._last_change(key, 2)

    def _last_change(self, key, quads):
        """Number of the last change near a tile."""
        width = self._toy.EXTENT * 2.0**-key.level
        margin = quads * width / self._toy.QUADS
        west, south = key.col * width - margin, key.row * width - margin
        east, north = west + width + 2 * margin, south + width + 2 * margin
        near = [w <= east and e >= west and s <= north and n >= south for w, s, e, n in self.changes]
        return max((number + 1 for number, touched in enumerate(near) if touched), default=0)


@pytest.fixture
def world(toy):
    stream = toy.new_stream(metric=ScreenError(6.0, quad=1e9))
    return stream, Writer(toy, stream)


def frame(stream, writer, view, *, tiles=6):
    batch = stream.plan(view, budget=1.0)
    generated = type(batch)(batch.keys[:tiles], batch.slots[:tiles], batch.parents[:tiles])
    if generated:
        writer.write(generated)
    return writer.rewritten(stream.advance(view, elapsed=1 / 30), view)


def all_new(writer, draws):
    slots = draws.slots.tolist()
    return all(writer.is_new(key, slot) for key, slot in zip(draws.keys, slots, strict=True))


def converge(stream, writer, view):
    for _ in range(400):
        draws = frame(stream, writer, view, tiles=100)
        if stream.converged:
            return draws
    raise AssertionError("never converged")


@pytest.mark.parametrize(
    "seed", [pytest.param(n, marks=pytest.mark.slow if n < 2 else pytest.mark.soak) for n in range(6)]
)
def test_a_moving_camera_sees_only_the_newest_terrain(toy, world, seed):
    stream, writer = world
    toy.limited(stream, 6)
    rng = np.random.default_rng(seed)
    eye = np.array([300.0, 200.0, 60.0])
    for step in range(120):
        eye[:2] += rng.uniform(-30, 30, 2)
        view = toy.view_from(tuple(eye), everywhere=False, heading=step / 15)
        draws = frame(stream, writer, view)
        assert all_new(writer, draws)
        if step % 3 == 0:
            x, y = rng.uniform(-1500, 1500, 2)
            wide = 10.0 ** rng.uniform(-1, 3)
            area = (x, y, x + wide, y + wide * rng.uniform(0.3, 3))
            writer.change(UNBOUNDED if step % 30 == 9 else area)
            draws = writer.rewritten(stream.draw_list(view), view)
            assert all_new(writer, draws)
    draws = converge(stream, writer, view)
    assert all_new(writer, draws)
    codes, slots = stream.pool.tiles()
    assert not stream.pool.stale[slots].any()
    assert all(writer.is_new(writer.own[slot][0], slot) for slot in slots.tolist())
    assert len(codes) <= stream.pool.slots


def test_stale_tiles_that_are_not_in_sight_may_wait(toy, world):
    stream, writer = world
    view = toy.view_from((300.0, 200.0, 60.0))
    writer.rewritten(converge(stream, writer, view), view)
    writer.change(UNBOUNDED)
    writer.rewritten(stream.draw_list(view), view)
    assert stream.pool.stale_tiles().size
    assert not stream.plan(view, budget=np.inf, in_sight=True)
    assert stream.plan(view, budget=np.inf)
    far = toy.view_from((9300.0, 9200.0, 60.0))
    assert stream.plan(far, budget=np.inf, in_sight=True)  # it misses tiles in sight


def test_a_partly_written_batch_leaves_no_stale_tile(toy, world):
    stream, writer = world
    view = toy.view_from((300.0, 200.0, 60.0))
    converge(stream, writer, view)
    for tiles in (2, 64):
        toy.limited(stream, tiles)
        writer.change(UNBOUNDED)
        for _ in range(600):
            draws = frame(stream, writer, view, tiles=tiles)
            assert all_new(writer, draws)
            if stream.converged:
                break
        assert stream.converged


def test_small_changes_rewrite_few_tiles_and_hidden_ones_later(toy, world):
    stream, writer = world
    view = toy.view_from((300.0, 200.0, 60.0), everywhere=False)
    draws = converge(stream, writer, view)
    before = writer.count
    assert writer.change((1e6, 1e6, 1e6 + 5, 1e6 + 5)) == 0
    converge(stream, writer, view)
    assert writer.count == before
    writer.change((310.0, 300.0, 311.0, 301.0))
    draws = writer.rewritten(stream.draw_list(view), view)
    now = writer.count - before
    assert all_new(writer, draws)
    assert 0 < now <= 12
    assert now < 0.2 * len(draws.keys)

    converge(stream, writer, view)
    before = writer.count
    writer.change((200.0, 0.0, 400.0, 100.0))  # behind the eye
    writer.rewritten(stream.draw_list(view), view)
    behind = writer.count - before
    everywhere = writer.change(UNBOUNDED)
    writer.rewritten(stream.draw_list(view), view)
    assert everywhere == 0
    assert behind < 0.3 * (writer.count - before)
    # After a quick turn tiles are rewritten before they are drawn.
    south = toy.view_from((300.0, 200.0, 60.0), everywhere=False, heading=np.pi)
    draws = writer.rewritten(stream.draw_list(south), south)
    assert all_new(writer, draws)


def test_bounds_errors_and_level_of_detail_follow_the_changed_terrain(toy, world):
    stream, writer = world
    view = toy.view_from((300.0, 200.0, 60.0))
    draws = converge(stream, writer, view)
    few = len(draws.keys)
    writer._toy = Raised(toy)
    writer.change(UNBOUNDED)
    writer.rewritten(stream.draw_list(view), view)
    draws = converge(stream, writer, view)
    fresh = toy.new_stream(metric=ScreenError(6.0, quad=1e9)).generate_all(view, Raised(toy).generate)
    assert len(draws.keys) > 1.2 * few
    assert set(draws.keys) == set(fresh.keys)
    assert stream.pool.top[draws.slots].min() > 100.0


class Raised:
    """The same terrain, higher and rougher."""

    def __init__(self, toy):
        self._toy = toy
        self.EXTENT, self.QUADS = toy.EXTENT, toy.QUADS

    def generate(self, batch):
        properties = self._toy.generate(batch)
        properties["low"] += 150.0
        properties["high"] += 150.0
        properties["error"] *= 3.0
        return properties
