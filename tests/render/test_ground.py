"""The ground's vertices: the shader's bits, and tiles that fit together."""

from __future__ import annotations

import moderngl
import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.render import Camera
from sketchterrain.render.frame import FrameBlock
from sketchterrain.render.ground import GroundPool
from sketchterrain.render.programs import FRAME_BINDING, set_uniforms
from sketchterrain.render.targets import Targets
from sketchterrain.resources import source
from sketchterrain.terrain.lattice import metres_per_unit

from .ground_model import QUADS, SIDE, Draws, open_edges, pack_tiles, shaded

WEST = 4
EYES = [(510.3, 480.7, 90.0), (-3e6 + 0.123, 7e6 + 0.77, 1234.5)]


def neighbours(eye):
    """Four tiles of a level and a coarser one west of them; morphs at random, but as they must be."""
    rng = np.random.default_rng(5)
    x, y = (int(axis // 1000.0) for axis in eye[:2])
    keys = [(1, 2 * x, 2 * y)]
    keys += [(2, 4 * x + col, 4 * y + row) for col, row in ((2, 1), (3, 1), (2, 0), (3, 0))]
    grid = rng.uniform(0, 1, (5, 5)).astype(np.float32)  # controls of the four, shared where they touch
    grid[:, 0] = 1.0
    coarse = rng.uniform(0, 1, (3, 3)).astype(np.float32)
    coarse[:, 2] = 0.0
    morph = [coarse, grid[:3, :3], grid[:3, 2:], grid[2:, :3], grid[2:, 2:]]
    return keys, Draws.of(keys, cases=[0, WEST, 0, WEST, 0], morph=morph)


@pytest.mark.gl
@pytest.mark.parametrize("eye", EYES)
def test_shader_gives_the_bits_of_its_oracle(gl, waves, eye):
    keys, draws = neighbours(eye)
    vertices = pack_tiles(waves, keys)
    expected, share, slope, _ = shaded(draws, vertices, waves.extent, eye)
    text = f"#version 430 core\n#define TILE_QUADS {QUADS}\n" + source("render/ground.glsl")
    text += """
out vec3 place; out float share; out vec2 flat_normal;
void main() {
    ivec2 at = place_in_tile();
    share = parent_share(at);
    place = ground_position(at, share);
    flat_normal = ground_normal_at(share).xy;
}"""
    program = gl.program(vertex_shader=text, varyings=["place", "share", "flat_normal"])
    program["Frame"].binding = FRAME_BINDING
    unit = metres_per_unit(waves.extent)
    set_uniforms(program, {"metres_per_unit": unit, "eye_fraction": tuple(np.mod(eye[:2], unit))})
    frame = FrameBlock(gl)
    frame["eye"] = (0.0, 0.0, eye[2])
    frame.upload()
    gl.simple_framebuffer((4, 4)).use()
    output = gl.buffer(reserve=24 * SIDE**2)
    for tile in range(len(keys)):
        pool = GroundPool(gl, waves.extent, gl.buffer(vertices[tile].tobytes()))
        pool.place(draws.part(tile), eye)
        gl.vertex_array(program, pool.content, skip_errors=True).transform(
            output, moderngl.POINTS, vertices=SIDE**2, instances=1
        )
        got = np.frombuffer(output.read(), np.float32).reshape(SIDE, SIDE, 6)
        assert (got[..., :3] == expected[tile]).all()
        assert (got[..., 3] == share[tile]).all()
        np.testing.assert_allclose(got[..., 4:], slope[tile] / 32767.0, atol=1e-7)


def test_tiles_of_two_levels_fit_without_a_crack(waves):
    for eye in EYES:
        keys, draws = neighbours(eye)
        vertices = pack_tiles(waves, keys)
        places, *_ = shaded(draws, vertices, waves.extent, eye)
        lonely = open_edges(draws, places)[..., :2] + np.mod(eye[:2], 1000.0)
        x, y = lonely[..., 0], lonely[..., 1]
        on_border = np.minimum.reduce([np.abs(x), np.abs(x - 1000.0), np.abs(y), np.abs(y - 500.0)]) < 1.0
        assert on_border.all()
        assert len(lonely) == 3 * 64 + 6 * 64  # of the coarse tile, of the fine ones
        draws.cases[:] = 0  # without stitches there are cracks
        places, *_ = shaded(draws, vertices, waves.extent, eye)
        assert len(open_edges(draws, places)) == 9 * 64 + 3 * 64


def test_normals_and_weights_are_equal_along_shared_borders(waves):
    for eye in EYES:
        keys, draws = neighbours(eye)
        coarse, nw, ne, sw, se = range(5)
        *_, slope, weights = shaded(draws, pack_tiles(waves, keys), waves.extent, eye)
        for values in (slope, weights):
            assert (values[nw, :, -1] == values[ne, :, 0]).all()
            assert (values[nw, -1] == values[sw, 0]).all()
            assert (values[ne, -1] == values[se, 0]).all()
            assert (values[coarse, :33, -1] == values[nw, ::2, 0]).all()
            assert (values[coarse, 32:, -1] == values[sw, ::2, 0]).all()


@pytest.mark.gl
def test_tiles_beyond_32_bits_are_refused(gl, waves):
    keys, draws = neighbours(EYES[0])
    pool = GroundPool(gl, waves.extent, gl.buffer(pack_tiles(waves, keys).tobytes()))
    with pytest.raises(InputError, match="128000 m of the eye"):
        pool.place(draws, (200_000.0, 0.0, 10.0))


@pytest.mark.gl
def test_no_ray_falls_between_tiles(gl, waves):
    eye = (503.0, 251.0, 300.0)
    keys, draws = neighbours(eye)
    pool = GroundPool(gl, waves.extent, gl.buffer(pack_tiles(waves, keys).tobytes()))
    pool.place(draws, eye)
    assert pool.tiles == 5
    frame = FrameBlock(gl)
    targets = Targets(gl, (256, 256), 2)
    for ahead in ((0.0, 0.0, -1.0), (0.02, 0.05, -1.0), (0.15, 0.1, -1.0)):
        frame["to_clip"] = Camera(eye, tuple(np.add(eye, ahead)), fov=40.0).to_clip(1.0)
        frame["eye"] = (0.0, 0.0, eye[2])
        frame.upload()
        targets.seen.use()
        targets.seen.clear(depth=1.0)
        gl.enable_only(moderngl.DEPTH_TEST | moderngl.CULL_FACE)
        pool.draw()
        gl.enable_only(moderngl.NOTHING)
        assert np.frombuffer(targets.depth.read(), np.float32).max() < 1.0, ahead
