"""Nothing opens between tiles, whatever a camera does: in their indices and heights, and in pictures."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from sketchterrain.render import Camera, Quality
from sketchterrain.render.camera import clip_planes, direction
from sketchterrain.render.frame import FrameBlock
from sketchterrain.render.ground_stream import GroundStream
from sketchterrain.terrain.vertices import VERTEX
from sketchterrain.tiles import TileStream, View

from .ground_model import SIDE, TILE_BYTES, along_rims, beyond, names_of, open_edges, shaded, write_tiles

SLOTS = 600
REACH = 20_000.0
SIZE = (192, 108)
MAGENTA = (255, 0, 255)


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


@pytest.mark.parametrize("seed", range(3))
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
    assert cases == 15
    assert moved > 100


def holes(picture, camera, reach, lowest):
    """How many pixels show the background although their ray meets the plane under all ground in reach.

    Picture (height, width, 4) of uint8, row 0 at the bottom; reach and lowest ground in m.
    """
    height, width = picture.shape[:2]
    half = np.tan(np.radians(camera.fov) / 2.0)
    x = ((np.arange(width) + 0.5) / width * 2.0 - 1.0) * half * width / height
    y = ((np.arange(height) + 0.5) / height * 2.0 - 1.0)[:, None] * half
    axes = camera.view()[:3, :3]
    way = x[..., None] * axes[0] + y[..., None] * axes[1] - axes[2]
    down = -way[..., 2]
    with np.errstate(divide="ignore"):
        far = (camera.eye[2] - lowest) / np.maximum(down, 0.0) * np.hypot(way[..., 0], way[..., 1])
    return int(np.count_nonzero((picture[..., :3] == MAGENTA).all(axis=-1) & (far < reach)))


class Eye:
    """Draws a stream's ground before magenta."""

    def __init__(self, gl, size):
        self.gl, self.size = gl, size
        self.texture = gl.texture(size, 4)
        self.target = gl.framebuffer([self.texture], gl.depth_renderbuffer(size))
        self.frame = FrameBlock(gl)

    def see(self, stream, camera):
        self.frame["to_clip"] = camera.to_clip(self.size[0] / self.size[1])
        self.frame["eye"] = (0.0, 0.0, camera.eye[2])
        self.frame.upload()
        self.target.use()
        self.target.clear(1.0, 0.0, 1.0, 1.0, depth=1.0)
        self.gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        stream.draw(camera.eye)
        self.gl.enable_only(moderngl.NOTHING)
        return np.frombuffer(self.texture.read(), np.uint8).reshape(*self.size[::-1], 4)


def camera_towards(eye, ground, bearing, pitch):
    near, far = clip_planes(eye[2] - ground, REACH)
    return Camera(tuple(eye), tuple(np.add(eye, direction(bearing, pitch))), fov=50.0, near=near, far=far)


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
        camera = camera_towards(place.tolist(), ground, bearing, pitch)
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
    camera = camera_towards([300.0, 200.0, 400.0], 0.0, 30.0, -40.0)
    stream.settle(camera, SIZE, draw_distance=REACH)
    picture = eye.see(stream, camera).copy()
    assert holes(picture, camera, REACH, -100.0) == 0
    picture[20, 30, :3] = MAGENTA
    assert holes(picture, camera, REACH, -100.0) == 1
