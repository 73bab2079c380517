"""Vertices that kernels write and OpenGL draws: the same bytes by each kind of memory, the right pixels."""

from typing import Any

import moderngl
import numpy as np
import pytest

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.compute.sharing import kinds_for
from sketchterrain.errors import DeviceError, InputError
from sketchterrain.render.sharing_probe import open_device
from sketchterrain.render.vertex_memory import open_vertex_memory
from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import Terrain, build

pytestmark = pytest.mark.gl

DEVICES = list_devices()
KEYS = [(5, 15, 15), (6, 30, 30), (6, 31, 30), (6, 31, 31)]
SLOTS, PARENTS = [4, 0, 1, 5], [-1, 4, 4, 4]
COUNT = 7

DRAWN = """
#version 330
in float height;
in vec2 slope;
uniform vec2 range;
out vec3 told;
void main() {
    int at = gl_VertexID % (65 * 65);
    vec2 place = (vec2(at % 65, 64 - at / 65) + 0.5) / 65.0;
    gl_Position = vec4(2.0 * place - 1.0, 0.0, 1.0);
    gl_PointSize = 1.0;
    told = vec3((height - range.x) / range.y, slope);
}
"""
PIXEL = """
#version 330
in vec3 told;
out vec4 pixel;
void main() { pixel = vec4(told, 1.0); }
"""


@pytest.fixture(scope="module", params=[d for d in DEVICES if d.type == "CPU"], ids=lambda d: d.platform)
def terrain(request: pytest.FixtureRequest, gl: moderngl.Context) -> Terrain:
    """A terrain on a device that shares buffers with OpenGL, where its driver has cl_khr_gl_sharing."""
    return build(load_sketch("valley_river"), device=open_device(request.param))


def write(terrain: Terrain, gl: moderngl.Context, kind: str | None) -> tuple[Any, bytes]:
    bare = terrain.vertex_store(COUNT)
    memory = open_vertex_memory(gl, terrain.context, bare.nbytes, kind=kind)
    store = terrain.vertex_store(COUNT, memory=memory)
    terrain.write_tiles(KEYS[:2], SLOTS[:2], PARENTS[:2], store)
    terrain.write_tiles(KEYS[2:], SLOTS[2:], PARENTS[2:], store)
    return memory, memory.read()


def slots_of(data: bytes) -> dict[int, bytes]:
    size = len(data) // COUNT
    return {slot: data[slot * size : (slot + 1) * size] for slot in SLOTS}


def test_all_kinds_of_memory_hold_the_same_bytes(terrain: Terrain, gl: moderngl.Context) -> None:
    """Those of a store without OpenGL, read back through OpenGL."""
    plain = terrain.vertex_store(COUNT)
    terrain.write_tiles(KEYS, SLOTS, PARENTS, plain)
    expected = slots_of(plain.download().tobytes())
    for kind in kinds_for(terrain.context):
        memory, found = write(terrain, gl, kind)
        assert memory.kind == kind
        assert memory.reason == ""
        assert slots_of(found) == expected, kind
        memory.close()


def test_the_best_kind_is_the_default(terrain: Terrain, gl: moderngl.Context) -> None:
    memory, _ = write(terrain, gl, None)
    assert memory.kind == ("mapped" if terrain.context.gl is None else "extension")


def test_pixels_drawn_from_it_are_right(terrain: Terrain, gl: moderngl.Context) -> None:
    """Each vertex drawn as a pixel: what is read back is the tile; and again after it was overwritten."""
    for kind in kinds_for(terrain.context):
        check_pixels(terrain, gl, kind)


def check_pixels(terrain: Terrain, gl: moderngl.Context, kind: str) -> None:
    memory, _ = write(terrain, gl, kind)
    store = terrain.vertex_store(COUNT, memory=memory)
    target = gl.simple_framebuffer((65, 65), components=4, dtype="f4")
    program = gl.program(vertex_shader=DRAWN, fragment_shader=PIXEL)
    array = gl.vertex_array(program, [(memory.vertices, "1f4 4x 2i2 4x 16x", "height", "slope")])
    program["range"].value = (0.0, 1.0)
    for key in (KEYS[1], (6, 12, 50)):
        terrain.write_tiles([key], [1], [-1], store)
        tile = terrain.tile(*key)
        target.use()
        array.render(moderngl.POINTS, vertices=65 * 65, first=65 * 65)
        drawn = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(65, 65, 4)[::-1]
        np.testing.assert_array_equal(drawn[..., 0], tile.height)
        np.testing.assert_allclose(drawn[..., 1:3], tile.normal[..., :2] * 32767.0, rtol=0, atol=0.51)


def test_what_does_not_work_says_why(terrain: Terrain, gl: moderngl.Context, monkeypatch: Any) -> None:
    context = ComputeContext(terrain.context.device)
    with pytest.raises(DeviceError, match="not opened beside an OpenGL context"):
        open_vertex_memory(gl, context, 1024, kind="extension")
    monkeypatch.setattr("sketchterrain.render.vertex_memory._STORAGE_VERSION", 10_000)
    monkeypatch.setattr("sketchterrain.render.vertex_memory._STORAGE_EXTENSION", "GL_none")
    memory = open_vertex_memory(gl, context, 1024)
    assert (memory.kind, memory.reason) == ("copy", "this machine's OpenGL has no GL_none")


def test_too_little_memory(terrain: Terrain, gl: moderngl.Context) -> None:
    memory = open_vertex_memory(gl, terrain.context, 1024)
    with pytest.raises(InputError, match="2 tiles need 270400 bytes, there are 1024"):
        terrain.vertex_store(2, memory=memory)
