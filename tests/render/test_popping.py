"""Before a camera that stands still, tiles refine and morph without a jump."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from sketchterrain.render import Camera, Quality
from sketchterrain.render.frame import FrameBlock
from sketchterrain.render.ground_stream import LEAP, GroundStream
from sketchterrain.render.programs import FRAME_BINDING
from sketchterrain.resources import source
from sketchterrain.tiles import ScreenError

from .ground_model import TILE_BYTES

pytestmark = pytest.mark.gl

SIZE = (256, 144)
RATE = 30.0
SMALL = Quality(quads=64, tile_memory=600 * TILE_BYTES)
REACH = 60_000.0
BOUND = 1.0
"""Of 255 levels, at 30 frames a second; beyond what an edge that moves by a pixel brings."""


LIT = """#version 430 core
in vec3 ground_normal;
out float light;
void main() { light = 110.0 + 140.0 * max(dot(normalize(ground_normal), vec3(-0.5, 0.35, 0.79)), 0.0); }
"""


class Shade:
    """Draws a stream's ground lit from the side, up to 250; the sky is 255."""

    def __init__(self, gl, stream):
        self.gl = gl
        self.light = gl.texture(SIZE, 1, dtype="f4")
        self.target = gl.framebuffer([self.light], gl.depth_renderbuffer(SIZE))
        self.frame = FrameBlock(gl)
        version, _, rest = source("render/ground.vert.glsl").partition("\n")
        program = gl.program(
            vertex_shader=f"{version}\n#define TILE_QUADS {SMALL.quads}\n{rest}", fragment_shader=LIT
        )
        program["Frame"].binding = FRAME_BINDING
        self.pool = stream.pool
        self.array = stream.pool.array(program)

    def see(self, camera):
        self.frame["to_clip"] = camera.to_clip(SIZE[0] / SIZE[1])
        self.frame["eye"] = (0.0, 0.0, camera.eye[2])
        self.frame.upload()
        self.target.use()
        self.target.clear(255.0, depth=1.0)
        self.gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        self.pool.draw(self.array)
        self.gl.enable_only(moderngl.NOTHING)
        return np.frombuffer(self.light.read(), np.float32).reshape(*SIZE[::-1]).astype(np.float64)


def change(before, after):
    """By how much each pixel leaves what it and its eight neighbours showed: an edge may move a pixel."""
    padded = np.pad(before, 1, mode="edge")
    height, width = before.shape
    near = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.maximum(np.maximum(np.min(near, axis=0) - after, after - np.max(near, axis=0)), 0.0)


def camera_at(x, y, z, bearing, pitch):
    angle, rise = np.radians([bearing, pitch])
    ahead = np.sin(angle) * np.cos(rise), np.cos(angle) * np.cos(rise), np.sin(rise)
    return Camera((x, y, z), tuple(np.add((x, y, z), ahead)), fov=45.0, near=1.0, far=90_000.0)


@pytest.mark.parametrize(("z", "pitch"), [(95.0, -4.0), (180.0, -25.0)])
def test_tiles_come_and_go_unseen(gl, waves, z, pitch):
    stream = GroundStream(gl, waves, SMALL, metric=ScreenError(tolerance=0.3, quad=10.0))
    shade = Shade(gl, stream)
    stream.settle(camera_at(300.0, 200.0, z + 400.0, 200.0, -20.0), SIZE, draw_distance=REACH)
    camera = camera_at(350.0, 260.0, z + 350.0, 20.0, pitch)
    assert np.hypot(np.hypot(50.0, 60.0), 50.0) < LEAP * waves.extent
    biggest = []
    drawn = set()
    first = before = None
    for _ in range(90):
        stats = stream.update(camera, SIZE, elapsed=1 / RATE, budget=0.006, draw_distance=REACH)
        assert not stats.leapt
        picture = shade.see(camera)
        if before is None:
            first = picture
        else:
            biggest.append(change(before, picture).max())
        before = picture
        drawn.add(stats.triangles)
    assert stats.settled
    assert len(drawn) > 3
    assert max(biggest) < BOUND
    # There was something to be seen, had it come at once.
    assert change(first, before).max() > 1.5 * max(biggest)
    assert max(biggest[-5:]) == 0.0
