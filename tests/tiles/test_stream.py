from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.tiles.lod import ScreenError
from sketchterrain.tiles.quadtree import contains, decode, keys_of, parent_of
from sketchterrain.tiles.refinement import ROOT_LEVEL, TileSelector
from sketchterrain.tiles.stream import MORPH_SECONDS, TileStream

from .conftest import codes_of

EYES = [(300.0, 200.0, 40.0), (-5000.3, 17.0, 3.0), (1e6 + 0.25, -2e6, 90.0)]


@pytest.mark.parametrize(
    ("metric", "eye"),
    [
        *((ScreenError(2.0), eye) for eye in EYES),
        *((ScreenError(30.0, quad=200.0), eye) for eye in EYES),
    ],
)
def test_converged_tiles_cover_the_world_once_in_balance(toy, eye, metric):
    stream = toy.new_stream(metric=metric)
    draws = stream.generate_all(replace(toy.view_from(eye), draw_distance=np.inf), toy.generate)
    assert stream.converged
    codes = np.sort(codes_of(draws.keys))
    width = np.array([4.0 ** -(key.level - ROOT_LEVEL) for key in draws.keys])
    assert width.sum() == 25.0
    above = codes
    while (level := decode(above)[0]).max() > ROOT_LEVEL:
        above = np.unique(parent_of(above[level > ROOT_LEVEL]))
        assert not contains(above, codes).any(), "a tile and its ancestor"
    levels = {key: key.level for key in draws.keys}
    for key in draws.keys:
        for east, north in ((1, 0), (0, 1), (1, 1), (-1, 1)):
            place = (key.col + east, key.row + north)
            for up in range(2, key.level - ROOT_LEVEL + 1):
                assert (key.level - up, place[0] >> up, place[1] >> up) not in levels


@pytest.mark.parametrize(
    ("eye", "frames"),
    [
        (EYES[0], 60),
        pytest.param(EYES[1], 100, marks=pytest.mark.slow),
        pytest.param(EYES[2], 60, marks=pytest.mark.slow),
    ],
)
def test_no_cracks_and_no_popping_in_flight(toy, eye, frames):
    rng = np.random.default_rng(3)
    stream = toy.limited(toy.new_stream(metric=ScreenError(6.0, quad=1e9)), 9)
    eye = np.array(eye)
    first = toy.view_from(eye)
    while (
        not (batch := stream.plan(first, budget=1.0)).keys
        or len(stream.pool.find(stream._selector.roots(first))) > stream.pool.count
    ):
        stream.mark_generated(batch, toy.generate(batch), seconds=0.1)
    stream.mark_generated(batch, toy.generate(batch), seconds=0.1)
    stream.jump(first)
    near = rng.normal(0, 300.0, (16, 2)) + eye[:2]
    x, y = (near * (toy.LATTICE / toy.EXTENT)).T
    before, levels = None, set()
    for frame in range(frames):
        # Still, in flight, still.
        if 0.3 * frames <= frame < 0.65 * frames:
            eye += np.array([9.0, 4.0, 0.0])
        view = toy.view_from(eye)
        draws = toy.go(stream, view, tiles=9)
        levels |= set(draws.levels.tolist())
        triangles = toy.drawn_triangles(draws, toy.QUADS)
        if frame % 3 == 0:
            edges = toy.open_edges(triangles)
            assert toy.rim(edges, view).all(), f"frame {frame}: a crack"
        now = toy.surface_at(triangles, x, y)
        assert np.isfinite(now).all(), f"frame {frame}: a hole"
        if before is not None:
            # Levels differ by their roughness, at both ends.
            most = 2 * toy.roughness(min(levels)) * (1 / 30) / MORPH_SECONDS[0]
            assert np.abs(now - before).max() <= most * 1.001
        before = now
    assert len(levels) > 4
    draws = toy.rested(stream, toy.view_from(eye), tiles=9)
    complete = toy.new_stream(metric=ScreenError(6.0, quad=1e9)).generate_all(
        toy.view_from(eye), toy.generate
    )
    assert sorted(complete.keys) == sorted(draws.keys), "depends on the path"
    order, other = np.argsort(codes_of(complete.keys)), np.argsort(codes_of(draws.keys))
    assert (complete.morph[order] == draws.morph[other]).all()


def test_tiles_out_of_view_are_coarser_and_those_ahead_are_prefetched(toy):
    stream = toy.new_stream(metric=ScreenError(1.0, quad=1e9))
    eye = EYES[0]
    ahead = toy.rested(stream, toy.view_from(eye, heading=0.0, everywhere=False), tiles=64)
    every = toy.new_stream(metric=ScreenError(1.0, quad=1e9))
    every.generate_all(toy.view_from(eye), toy.generate)
    assert len(stream._tree.codes) < 0.9 * len(every._tree.codes)
    assert len(ahead.keys) < len(stream._tree.codes)
    back = stream.advance(toy.view_from(eye, heading=np.pi, everywhere=False), elapsed=1 / 30)
    assert back.keys
    assert back.screen_errors[back.levels < stream.finest].max() < 1.0 / 0.2

    quiet, moving = (toy.new_stream(metric=ScreenError(4.0, quad=1e9)) for _ in range(2))
    view = toy.view_from(EYES[0])
    for stream in (quiet, moving):
        stream.generate_all(view, toy.generate)
    assert not quiet.plan(view, budget=1.0)
    batch = moving.plan(toy.view_from(EYES[0], velocity=(200.0, 0.0, 0.0)), budget=1.0)
    assert batch
    ahead = keys_of(codes_of(batch.keys))
    width = np.array([toy.EXTENT * 2.0**-key.level for key in ahead])
    assert (np.array([key.col for key in ahead]) * width + width > EYES[0][0] - 600).all()


@pytest.mark.parametrize("eye", EYES)
def test_a_still_shows_the_tiles_of_the_whole_view_and_generates_fewer(toy, eye):
    view = toy.view_from(eye, heading=0.5, everywhere=False)
    whole, still = (toy.new_stream(metric=ScreenError(1.0, quad=1e9)) for _ in range(2))
    expected = whole.generate_all(view, toy.generate)
    draws = still.generate_all(view, toy.generate, still=True)
    assert sorted(draws.keys) == sorted(expected.keys)
    assert still.pool.count < 0.8 * whole.pool.count
    # The next view of a still adds what it shows, also beside and behind the first one.
    for heading in (0.6, 2.0, 4.0):
        view = toy.view_from(eye, heading=heading, everywhere=False)
        expected = whole.generate_all(view, toy.generate)
        draws = still.generate_all(view, toy.generate, still=True)
        assert sorted(draws.keys) == sorted(expected.keys)


def test_all_tiles_that_count_as_cached_are_generated(toy, monkeypatch):
    """Also if some that are not visible are still missing when a still is complete."""
    monkeypatch.setattr(TileSelector, "_in_picture", lambda _, view, pool, excess, codes: codes >= 0)
    view = toy.view_from(EYES[0], heading=0.5, everywhere=False)
    stream, written = toy.new_stream(metric=ScreenError(1.0, quad=1e9)), set()

    def generate(batch):
        written.update(batch.keys)
        return toy.generate(batch)

    stream.generate_all(view, generate, still=True)
    assert set(keys_of(stream.pool.tiles()[0])) == written


def test_a_small_pool_tolerates_more_error_without_holes(toy):
    stream = toy.new_stream(metric=ScreenError(0.5, quad=1e9), slots=300)
    view = toy.view_from(EYES[0])
    stream.generate_all(view, toy.generate)
    for _ in range(200):
        toy.go(stream, view, tiles=64)
    draws = toy.go(stream, view)
    assert stream._error_factor > 1
    assert stream.pool.count <= 300
    assert toy.is_whole(draws, view)


def test_far_from_the_origin_the_same_terrain_gives_the_same_tiles(toy):
    shift = 2**14 * toy.EXTENT * 2.0**-ROOT_LEVEL

    def flat(batch):
        facts = toy.facts_of(batch.keys, toy.QUADS)
        facts["low"], facts["high"] = 0.0, 10.0
        facts["error"] = toy.roughness(np.array([key.level for key in batch.keys]))
        return facts

    here = toy.new_stream(metric=ScreenError(4.0)).generate_all(toy.view_from((100.3, 50.2, 20.0)), flat)
    there = toy.new_stream(metric=ScreenError(4.0)).generate_all(
        toy.view_from((100.3 + shift, 50.2, 20.0)), flat
    )
    assert len(here.keys) == len(there.keys)
    assert (here.corners[:, 0] + (2**14 << (24 - ROOT_LEVEL)) == there.corners[:, 0]).all()
    # The eye has a resolution of 1 µm there.
    assert np.abs(here.morph - there.morph).max() < 1e-5


def test_invalid_numbers_raise(toy):
    for options, expected in (
        *(({"quads": 48}, "power of two"), ({"quads": 512}, "power of two")),
        *(({"finest_cell": 0.0}, "finest cell > 0"), ({"slots": 0}, "1 slot")),
    ):
        with pytest.raises(InputError, match=expected):
            TileStream(toy.EXTENT, **{"quads": 4, **options})
    stream = toy.new_stream()
    for east, budget, expected in ((1e12, 1.0, "within ±"), (np.nan, 1.0, "within ±"), (0.0, -1.0, "budget")):
        with pytest.raises(InputError, match=expected):
            stream.plan(toy.view_from((east, 0.0, 1.0)), budget=budget)


def test_only_tiles_hidden_by_nearer_terrain_are_culled(toy):
    view = toy.view_from((300.0, 200.0, -120.0))
    every, seen = (
        toy.new_stream(metric=ScreenError(4.0, quad=1e9), hide=hide).generate_all(view, toy.generate)
        for hide in (False, True)
    )
    assert set(seen.keys) < set(every.keys)
    gone = [i for i, key in enumerate(every.keys) if key not in set(seen.keys)]
    lattice = toy.LATTICE / toy.EXTENT
    eye = np.array(view.eye) * [lattice, lattice, 1.0]
    hidden = toy.drawn_triangles(every, toy.QUADS)
    rng = np.random.default_rng(1)
    for i in rng.choice(gone, 12):
        _, _, own, parent = toy.heights_of(every.keys[i], toy.QUADS)
        top = max(own.max(), parent.max())
        col, row = every.corners[i] + every.steps[i] * toy.QUADS * np.array([0.5, -0.5])
        ray = eye + np.geomspace(1e-3, 0.999, 400)[:, None] * (np.array([col, row, top]) - eye)
        ground = toy.surface_at(hidden, ray[:, 0], ray[:, 1])
        assert (ground > ray[:, 2]).any(), "a ray from the eye reaches a tile that was left out"
    assert len(toy.drawn_triangles(seen, toy.QUADS)) < len(hidden)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("step", "steps"),
    [((390.0, 0.0, 0.0), 60), ((-90.0, 140.0, 0.0), 130)],
)
def test_a_long_walk_with_a_short_view_ends_with_the_tiles_of_a_still_camera(toy, step, steps):
    """Tiles out of view are not balanced, and must not keep those in view from refinement."""
    metric = ScreenError(3.0, quad=1e9)
    stream = toy.limited(toy.new_stream(metric=metric), 40)
    eye = np.array([0.0, 0.0, 30.0])

    def short(eye):
        return replace(toy.view_from(eye), draw_distance=3.0 * toy.EXTENT)

    stream.generate_all(short(eye), toy.generate)
    for _ in range(steps):
        eye += np.array(step)
        toy.go(stream, short(eye), tiles=40)
    assert stream.pool.count <= stream.pool.slots
    draws = toy.rested(stream, short(eye), tiles=40)
    alone = toy.new_stream(metric=metric).generate_all(short(eye), toy.generate)
    assert sorted(alone.keys) == sorted(draws.keys)
    assert toy.is_whole(draws, short(eye))
