"""Vertex memory shared by OpenCL and OpenGL, and its probe in a child process."""

import sys
from dataclasses import replace

import moderngl
import numpy as np
import pytest

from sketchterrain.compute import gl_interop
from sketchterrain.compute.buffers import sharing_methods
from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.gl_interop import GLHandles, current_handles
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import DeviceError, InputError
from sketchterrain.generation.building import build
from sketchterrain.render import sharing_probe
from sketchterrain.render.sharing_probe import Sharing, open_device, probe_sharing, shared_with_gl
from sketchterrain.render.vertex_memory import open_vertex_memory
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.terrain.surfaces import vertex_dtype
from tests.devices import DEVICES, device_params

pytestmark = pytest.mark.gl

CPUS = [device for device in DEVICES if device.type == "CPU"]
KEYS = [(5, 15, 15), (6, 30, 30), (6, 31, 30), (6, 31, 31)]
SLOTS, PARENTS = [4, 0, 1, 5], [-1, 4, 4, 4]
COUNT = 7
MOUNTAIN = np.zeros((32, 32), np.uint8)
MOUNTAIN[8:20, 8:20] = 1
SKETCH = Sketch(extent=1024.0, layers={"mountain": MOUNTAIN})
VERTEX_BYTES = vertex_dtype(len(BUILT_IN)).itemsize

DRAWN = """
#version 330
in float height;
in vec2 slope;
uniform vec2 range;
out vec3 value;
void main() {
    int at = gl_VertexID % (65 * 65);
    vec2 place = (vec2(at % 65, 64 - at / 65) + 0.5) / 65.0;
    gl_Position = vec4(2.0 * place - 1.0, 0.0, 1.0);
    gl_PointSize = 1.0;
    value = vec3((height - range.x) / range.y, slope);
}
"""
PIXEL = """
#version 330
in vec3 value;
out vec4 pixel;
void main() { pixel = vec4(value, 1.0); }
"""


@pytest.fixture(scope="module", params=device_params(lambda device: device.type == "CPU"))
def terrain(request, gl):
    """A terrain on a device that shares buffers with OpenGL if its driver can."""
    return build(SKETCH, device=open_device(request.param))


def write(terrain, gl, kind):
    bare = terrain.vertex_store(COUNT)
    memory = open_vertex_memory(gl, terrain.context, bare.nbytes, kind=kind)
    store = terrain.vertex_store(COUNT, memory=memory)
    terrain.write_tiles(KEYS[:2], SLOTS[:2], PARENTS[:2], store)
    terrain.write_tiles(KEYS[2:], SLOTS[2:], PARENTS[2:], store)
    return memory, memory.read()


def slots_of(data):
    size = len(data) // COUNT
    return {slot: data[slot * size : (slot + 1) * size] for slot in SLOTS}


def test_all_sharing_methods_store_the_same_bytes(terrain, gl):
    """Read back through OpenGL, equal to a store without OpenGL."""
    plain = terrain.vertex_store(COUNT)
    terrain.write_tiles(KEYS, SLOTS, PARENTS, plain)
    expected = slots_of(plain.download().tobytes())
    for kind in sharing_methods(terrain.context):
        memory, found = write(terrain, gl, kind)
        assert memory.kind == kind
        assert memory.reason == ""
        assert slots_of(found) == expected, kind
        memory.close()
    memory, _ = write(terrain, gl, None)
    assert memory.kind == ("mapped" if terrain.context.gl is None else "extension")


def test_drawn_vertices_equal_the_tile(terrain, gl):
    """Each vertex drawn as a pixel, also after it was overwritten."""
    target = gl.simple_framebuffer((65, 65), components=4, dtype="f4")
    program = gl.program(vertex_shader=DRAWN, fragment_shader=PIXEL)
    for kind in sharing_methods(terrain.context):
        memory, _ = write(terrain, gl, kind)
        store = terrain.vertex_store(COUNT, memory=memory)
        array = gl.vertex_array(
            program, [(memory.vertices, f"1f4 4x 2i2 4x {VERTEX_BYTES - 16}x", "height", "slope")]
        )
        program["range"].value = (0.0, 1.0)
        for key in (KEYS[1], (6, 12, 50)):
            terrain.write_tiles([key], [1], [-1], store)
            tile = terrain.tile(*key)
            target.use()
            array.render(moderngl.POINTS, vertices=65 * 65, first=65 * 65)
            drawn = np.frombuffer(target.read(components=4, dtype="f4"), np.float32).reshape(65, 65, 4)[::-1]
            np.testing.assert_array_equal(drawn[..., 0], tile.height)
            np.testing.assert_allclose(drawn[..., 1:3], tile.normal[..., :2] * 32767.0, rtol=0, atol=0.51)


def test_unavailable_methods_report_the_reason(terrain, gl, monkeypatch):
    context = ComputeContext(terrain.context.device)
    with pytest.raises(DeviceError, match="not opened with an OpenGL context"):
        open_vertex_memory(gl, context, 1024, kind="extension")
    monkeypatch.setattr("sketchterrain.render.vertex_memory._STORAGE_VERSION", 10_000)
    monkeypatch.setattr("sketchterrain.render.vertex_memory._STORAGE_EXTENSION", "GL_none")
    memory = open_vertex_memory(gl, context, 1024)
    assert (memory.kind, memory.reason) == ("copy", "this machine's OpenGL has no GL_none")
    memory = open_vertex_memory(gl, terrain.context, 1024)
    with pytest.raises(InputError, match=f"expected {2 * 65**2 * VERTEX_BYTES} bytes for 2 tiles, got 1024"):
        terrain.vertex_store(2, memory=memory)


@pytest.fixture
def mapped():
    """A CPU device as of a driver without cl_khr_gl_sharing."""
    if not CPUS:
        pytest.skip("needs a CPU driver")
    return replace(CPUS[0], gl_sharing="mapped")


PROBE_FOR_EXTENSION = """
import sys
from sketchterrain.compute import gl_interop
from sketchterrain.render import sharing_probe
gl_interop._EXTENSION = sys.argv[3]
sharing_probe._probe(int(sys.argv[1]), sys.argv[2])
"""


@pytest.fixture(autouse=True)
def empty_probe_cache():
    probe_sharing.cache_clear()
    yield
    probe_sharing.cache_clear()


def probe_for_extension(name, monkeypatch):
    """Replace the name of the sharing extension, also in the probe's child."""

    def command(device, kind):
        return [sys.executable, "-c", PROBE_FOR_EXTENSION, str(device.index), kind, name]

    monkeypatch.setattr(gl_interop, "_EXTENSION", name)
    monkeypatch.setattr(sharing_probe, "_command", command)


@pytest.mark.parametrize("device", device_params(others=pytest.mark.slow))
def test_the_best_working_method_is_selected(gl, device):
    found = probe_sharing(device)
    if device.gl_sharing == "extension":
        assert (found.kind == "extension") == (found.reason == "")
    else:
        assert found == Sharing(device.gl_sharing)
    assert (open_device(device).gl is not None) == (found.kind == "extension")


FAILURES = {
    "a crash": (
        "import os, signal; os.kill(os.getpid(), signal.SIGSEGV)",
        "extension: the probe crashed (SIGSEGV); update or reinstall the driver",
    ),
    "a refusal": ("raise SystemExit('the driver refuses')", "extension: the driver refuses"),
    "silence": ("raise SystemExit(3)", "extension: the probe failed with code 3"),
}


def test_a_failed_probe_falls_back_to_copies_with_a_reason(mapped, monkeypatch):
    device = replace(mapped, type="GPU", gl_sharing="extension")
    for name, (code, reason) in FAILURES.items():

        def command(device, kind, code=code):
            return [sys.executable, "-c", code if kind == "extension" else "pass"]

        probe_sharing.cache_clear()
        monkeypatch.setattr(sharing_probe, "_command", command)
        assert probe_sharing(device, timeout=300.0) == Sharing("copy", reason), name
    monkeypatch.setattr(
        sharing_probe, "_command", lambda *_: [sys.executable, "-c", "raise SystemExit('no OpenGL 4.3')"]
    )
    assert probe_sharing(mapped) == Sharing("none", "mapped: no OpenGL 4.3; copy: no OpenGL 4.3")


@pytest.mark.slow
@pytest.mark.parametrize("device", device_params(lambda device: device.type == "CPU"))
def test_drivers_without_the_extension_are_not_called(gl, device, monkeypatch):
    """PoCL would end the process."""
    handles = current_handles()
    assert handles is not None
    assert handles.window_system == "EGL"
    assert GLHandles("EGL", 5, 7).properties == (0x2008, 5, 0x2009, 7)
    assert GLHandles("GLX", 5, 7).properties == (0x2008, 5, 0x200A, 7)
    probe_for_extension("cl_none_sharing", monkeypatch)
    with pytest.raises(DeviceError, match="shares no buffers with OpenGL: no cl_none_sharing"):
        gl_interop.open_shared_context(device, handles)
    found = probe_sharing(replace(device, gl_sharing="extension"))
    assert found.kind == "mapped"
    assert "no cl_none_sharing" in found.reason


def test_a_terrain_moves_to_a_sharing_context_if_there_is_one(mapped, monkeypatch):
    terrain = build(SKETCH, device=ComputeContext(mapped))
    assert shared_with_gl(terrain) is terrain
    other = ComputeContext(mapped)
    monkeypatch.setattr(sharing_probe, "open_device", lambda *_, **__: other)
    assert shared_with_gl(terrain) is terrain
    other.gl = GLHandles("EGL", 5, 7)
    moved = shared_with_gl(terrain)
    assert moved.context is other
    assert (moved.recipe, moved.sketch) == (terrain.recipe, terrain.sketch)
    np.testing.assert_array_equal(moved.tile(4, 3, 3).height, terrain.tile(4, 3, 3).height)
    assert shared_with_gl(moved) is moved
    assert shared_with_gl("a stand-in") == "a stand-in"
