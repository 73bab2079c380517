"""No cracks between tiles while a camera moves: in indices and heights, and in pictures."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.render import Quality
from sketchterrain.render.ground_stream import GroundStream
from sketchterrain.terrain.vertices import VERTEX
from sketchterrain.tiles import TileStream, View

from .ground_model import SIDE, TILE_BYTES, along_rims, beyond, names_of, open_edges, shaded, write_tiles
from .ground_pictures import MAGENTA, Eye, camera_towards, holes, must_be_covered

SLOTS = 600
REACH = 20_000.0
SIZE = (192, 108)


class Streamed:
    """A stream over a terrain without a GPU."""

    def __init__(self, terrain, **options):
        self.terrain = terrain
        self.stream = TileStream(terrain.extent, slots=SLOTS, **options)
        self.store = terrain.vertex_store(SLOTS)
        self.vertices = self.store.buffer.view(VERTEX).reshape(SLOTS, SIDE, SIDE)

    def frame(self, view, *, elapsed, budget=0.01, leap=False):
        batch = self.stream.plan(view, budget=budget)
        while batch:
            facts = write_tiles(self.terrain, batch.keys, batch.slots, batch.parents, self.store)
            self.stream.arrived(batch, facts, seconds=0.001 * len(batch.keys))
            batch = self.stream.plan(view, budget=budget) if leap else None
        if leap:
            self.stream.jump(view)
        return self.stream.advance(view, elapsed=elapsed)


def view_from(eye):
    return View(tuple(eye), np.zeros((0, 4)), 300.0, draw_distance=REACH)


def spread(groups, values):
    """By how much values (..., k) differ within a group at most."""
    flat = values.reshape(groups.size, -1)
    low, high = (np.full((groups.max() + 1, flat.shape[1]), far) for far in (np.inf, -np.inf))
    np.minimum.at(low, groups.ravel(), flat)
    np.maximum.at(high, groups.ravel(), flat)
    return float((high - low).max())


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2))])
def test_every_border_edge_is_shared_bit_for_bit(waves, seed):
    rng = np.random.default_rng(seed)
    streamed = Streamed(waves)
    eye = np.array([*rng.uniform(-2000, 2000, 2), 200.0])
    levels = cases = moved = 0
    for step in range(12):
        leap = step % 4 == 0
        if leap and step:
            eye[:2] += rng.uniform(-5000, 5000, 2)
        eye[:2] += rng.uniform(-40, 40, 2)
        eye[2] = float(waves.heights(eye[0], eye[1])) + 10.0 ** rng.uniform(0.5, 3.0)
        draws = streamed.frame(view_from(eye.tolist()), elapsed=rng.uniform(0.01, 0.2), leap=not step)
        assert draws.keys
        places, _, slope, weights = shaded(draws, streamed.vertices, waves.extent, eye)
        assert np.isfinite(places).all()
        lonely = open_edges(draws, places)
        assert beyond(draws, lonely, waves.extent, eye).all()
        at = names_of(along_rims(draws, places))
        for values in (slope, weights):
            assert spread(at, along_rims(draws, values)) == 0
        levels = max(levels, len(set(draws.levels.tolist())))
        cases |= int(np.bitwise_or.reduce(draws.cases))
        moved += int(np.count_nonzero((draws.morph > 0) & (draws.morph < 1)))
    assert levels >= 4
    assert cases == 31
    assert moved > 100


@pytest.mark.gl
def test_no_magenta_under_the_horizon_while_tiles_stream_and_after(gl, waves):
    rng = np.random.default_rng(3)
    eye = Eye(gl, SIZE)
    stream = GroundStream(gl, waves, Quality(quads=64, tile_memory=SLOTS * TILE_BYTES))
    place, lowest = np.array([300.0, 200.0, 0.0]), -100.0
    for step in range(24):
        if step % 6 == 0:
            place[:2] += rng.uniform(-3000, 3000, 2)
            bearing, pitch = rng.uniform(0, 360), rng.uniform(-80, 5)
        place[:2] += rng.uniform(-20, 20, 2)
        ground = float(waves.heights(place[0], place[1]))
        place[2] = ground + (2.0, 20.0, 400.0, 9000.0)[step // 6]
        camera = camera_towards(place.tolist(), ground, bearing, pitch, REACH)
        stats = stream.update(camera, SIZE, elapsed=0.04, budget=0.01, draw_distance=REACH)
        assert stats.tiles_drawn
        assert holes(eye.see(stream, camera), camera, REACH, lowest) == 0
    stream.settle(camera, SIZE, draw_distance=REACH)
    assert holes(eye.see(stream, camera), camera, REACH, lowest) == 0
    assert stream.tiles.settled


@pytest.mark.gl
def test_a_hole_would_be_seen(gl, waves):
    eye = Eye(gl, SIZE)
    stream = GroundStream(gl, waves, Quality(quads=64, tile_memory=SLOTS * TILE_BYTES))
    camera = camera_towards([300.0, 200.0, 400.0], 0.0, 30.0, -40.0, REACH)
    stream.settle(camera, SIZE, draw_distance=REACH)
    picture = eye.see(stream, camera).copy()
    assert must_be_covered(camera, SIZE, REACH, -100.0).all()
    assert holes(picture, camera, REACH, -100.0) == 0
    picture[20, 30, :3] = MAGENTA
    assert holes(picture, camera, REACH, -100.0) == 1
