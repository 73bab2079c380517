"""Vertices shared through cl_khr_gl_sharing, which a strict OpenCL layer adds to CPU drivers."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.errors import DeviceError
from sketchterrain.render.programs import close_context, open_context
from tests.devices import DEVICES, device_params

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
CPUS = [device for device in DEVICES if device.type == "CPU"]
pytestmark = [
    pytest.mark.gl,
    pytest.mark.slow,
    pytest.mark.skipif(not CPUS, reason="the layer is for CPU drivers, and there is none"),
]
each_cpu = pytest.mark.parametrize("device", device_params(lambda device: device.type == "CPU"))
RENDER_TESTS = Path(__file__).parents[1] / "render"


class Layer:
    """The layer's library, and its report on child processes."""

    def __init__(self, library, log):
        self._log = log
        self._environment = {"OPENCL_LAYERS": str(library), "GL_SHARING_LAYER_LOG": str(log)}

    def run(self, *arguments, environment=None):
        """Run Python with the layer; return its stdout."""
        return run_python(*arguments, environment=self._environment | (environment or {}))

    @property
    def misuses(self):
        """Violations of the specification, in order."""
        lines = self._log.read_text(encoding="utf-8").splitlines() if self._log.exists() else []
        return [
            re.sub(r" \(OpenGL buffer \d+\)$", "", line.removeprefix("misuse: "))
            for line in lines
            if line.startswith("misuse: ")
        ]

    @property
    def acquired(self):
        """Number of acquisitions of buffers."""
        return sum(map(int, re.findall(r"acquired (\d+), released", self._log.read_text(encoding="utf-8"))))


def run_python(*arguments, environment):
    command = [sys.executable, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | environment)
    assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
    return done.stdout


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    if not sys.platform.startswith("linux"):
        pytest.skip("the layer is written for Linux")
    if COMPILER is None:
        pytest.skip("missing tool: a C compiler (apt install gcc libc6-dev)")
    try:
        close_context(open_context())
    except DeviceError as error:
        pytest.skip(str(error))
    compiled = tmp_path_factory.mktemp("layer") / "gl_sharing_layer.so"
    source = Path(__file__).with_name("gl_sharing_layer.c")
    options = ["-std=gnu11", "-shared", "-fPIC", "-O1", "-Wall"]
    subprocess.run([COMPILER, *options, "-o", compiled, source, "-ldl"], check=True)
    return compiled


@pytest.fixture
def layer(library, tmp_path):
    return Layer(library, tmp_path / "log")


OPENED = """
import sys
from sketchterrain.compute import gl_interop
from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import list_devices
from sketchterrain.compute.buffers import ExtensionMemory
from sketchterrain.errors import DeviceError
from sketchterrain.render.programs import open_context
import numpy as np

device = list_devices()[int(sys.argv[1])]
gl = open_context()
context = ComputeContext(device, gl=gl_interop.current_handles())
COUNT = 1 << 12
WORDS = (np.arange(COUNT, dtype=np.uint32) + np.uint32(1)) * np.uint32(0x9E3779B1)
POISON = np.full(COUNT, 0xFFFFFFFF, np.uint32)

def write_words(buffer, count=COUNT):
    context.launch("sharing_probe.cl", "probe", (count,), np.uint32(0), buffer)

def gl_words():
    return np.frombuffer(vertices.read(), np.uint32)

def is_refused(call, *given):
    try:
        call(*given)
    except DeviceError:
        return True
    return False

vertices = gl.buffer(np.arange(COUNT, dtype=np.uint32).tobytes(), dynamic=True)
memory = ExtensionMemory(context, vertices.glo, 4 * COUNT)
"""

STRICT = """
memory.acquire()
write_words(memory.buffer, COUNT // 2)
assert (gl_words() == POISON).all()  # they are OpenCL's
gl_interop.release(device, context._queue, memory.buffer)
assert (gl_words() == POISON).all()  # the queue has not finished
context._queue.finish()
assert (gl_words()[: COUNT // 2] == WORDS[: COUNT // 2]).all()
assert (gl_words()[COUNT // 2 :] == np.arange(COUNT // 2, COUNT)).all()  # no kernel wrote there
"""

MISUSE = """
before = gl_words().copy()
write_words(memory.buffer)
write_words(context.sub_buffer(memory.buffer, 0, 2 * COUNT), COUNT // 2)
context.write(memory.buffer, WORDS).wait()
context._queue.finish()
assert (gl_words() == before).all()
assert is_refused(memory.release, [])
memory.acquire()
assert is_refused(memory.acquire)
memory.release([])
assert (context.download(memory.buffer, COUNT, np.uint32) == POISON).all()
assert is_refused(context.from_gl, 12345)
assert is_refused(ComputeContext(device).from_gl, vertices.glo)
other = gl.buffer(reserve=4 * COUNT)
acquired = ExtensionMemory(context, other.glo, 4 * COUNT)
acquired.acquire()
acquired.close()
vertices.orphan(8 * COUNT)
assert is_refused(memory.acquire)
"""

MISUSES = [
    "used by a kernel without being acquired",
    "used by a kernel without being acquired",
    "written without being acquired",
    "released without being acquired",
    "acquired twice",
    "read without being acquired",
    "created of no buffer with a data store",
    "created in a context without OpenGL",
    "deleted while it is acquired",
    "its data store was changed or deleted",
]


@each_cpu
def test_the_layer_is_strict(layer, device):
    """Bytes owned by the other API are poisoned, and exactly the planted misuses are reported."""
    layer.run("-c", OPENED + STRICT, str(device.index))
    assert layer.misuses == []
    layer.run("-c", OPENED + MISUSE, str(device.index))
    assert layer.misuses == MISUSES


def test_vertex_memory_is_shared_by_the_specification(layer):
    """The probe selects the extension, and all methods yield the same bytes."""
    code = """
import sys
from sketchterrain.compute.device import list_devices
from sketchterrain.render.sharing_probe import probe_sharing
for index in map(int, sys.argv[1:]):
    device = list_devices()[index]
    print(device.gl_sharing, probe_sharing(device))
"""
    output = layer.run("-c", code, *(str(device.index) for device in CPUS)).splitlines()
    assert output == ["extension Sharing(kind='extension', reason='')"] * len(CPUS)
    probed = layer.acquired
    assert probed >= len(CPUS)
    files = [str(RENDER_TESTS / "test_vertex_memory.py")]
    layer.run("-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", *files)
    assert layer.acquired > probed
    assert layer.misuses == []


PICTURES = """
import sys
from dataclasses import replace
from sketchterrain.compute.context import ComputeContext
from sketchterrain.compute.device import list_devices
from sketchterrain.document.sketch import Sketch
from sketchterrain.render import vertex_memory
from sketchterrain.render.quality import Quality
from sketchterrain.render.offscreen import render_picture
from sketchterrain.generation.building import build
import numpy as np

folder, method, *indices = sys.argv[1:]
sharing_methods = vertex_memory.sharing_methods
def only_kind(context):
    kind = method if method != "best" else sharing_methods(context)[0]
    print(kind)
    return [kind]
vertex_memory.sharing_methods = only_kind
mountain = np.zeros((32, 32), np.uint8)
mountain[8:20, 8:20] = 1
sketch = Sketch(extent=1024.0, layers={"mountain": mountain})
quality = replace(Quality.from_level(0.0, without=["trees"]), tile_memory=32 << 20)
for index in indices:
    terrain = build(sketch, device=ComputeContext(list_devices()[int(index)]))
    np.save(f"{folder}/{method} {index}.npy", render_picture(terrain, size=(160, 90), quality=quality))
"""


def test_images_equal_those_of_copied_vertices(layer, tmp_path):
    indices = [str(device.index) for device in CPUS]
    assert layer.run("-c", PICTURES, str(tmp_path), "best", *indices).split() == ["extension"] * len(CPUS)
    assert layer.acquired > 0
    assert layer.misuses == []
    output = run_python("-c", PICTURES, str(tmp_path), "copy", *indices, environment={})
    assert output.split() == ["copy"] * len(CPUS)
    for index in indices:
        shared, copied = (np.load(tmp_path / f"{method} {index}.npy") for method in ("best", "copy"))
        np.testing.assert_array_equal(shared, copied)
        assert shared.std() > 10.0


PROBE = """
import sys
from sketchterrain.compute.device import list_devices
from sketchterrain.render.sharing_probe import probe_sharing
found = probe_sharing(list_devices()[int(sys.argv[1])])
print(found.kind, found.reason, sep="\\n")
"""

FAILING_LATER = """
import os, sys
from sketchterrain.compute.device import list_devices
from sketchterrain.errors import DeviceError
from sketchterrain.render.programs import open_context
from sketchterrain.render.sharing_probe import open_device
from sketchterrain.render.vertex_memory import open_vertex_memory

gl = open_context()
context = open_device(list_devices()[int(sys.argv[1])])
memory = open_vertex_memory(gl, context, 4096)
assert (memory.kind, memory.reason) == ("extension", "")
os.environ["GL_SHARING_LAYER_FAIL"] = "clEnqueueAcquireGLObjects"
try:
    memory.acquire()
except DeviceError as error:
    print(error)
os.environ["GL_SHARING_LAYER_FAIL"] = "clCreateFromGLBuffer"
memory = open_vertex_memory(gl, context, 4096)
print(memory.kind, memory.reason, sep="\\n")
"""


def test_failing_calls_are_reported_and_memory_falls_back_to_mapped(layer):
    device = CPUS[0]
    refusal = f"{device.name} ({device.platform}) shares no buffers with OpenGL: "
    failures = {
        "clCreateContext": "clCreateContext: error -1000",  # CL_INVALID_GL_SHAREGROUP_REFERENCE_KHR
        "clCreateFromGLBuffer": "clCreateFromGLBuffer: OUT_OF_RESOURCES",
        "clEnqueueAcquireGLObjects": "clEnqueueAcquireGLObjects: OUT_OF_RESOURCES",
        "clEnqueueReleaseGLObjects": "clEnqueueReleaseGLObjects: OUT_OF_RESOURCES",
    }
    for call, failure in failures.items():
        output = layer.run("-c", PROBE, str(device.index), environment={"GL_SHARING_LAYER_FAIL": call})
        assert output.splitlines() == ["mapped", f"extension: {refusal}{failure}"]
    assert layer.run("-c", FAILING_LATER, str(device.index)).splitlines() == [
        refusal + failures["clEnqueueAcquireGLObjects"],
        "mapped",
        refusal + failures["clCreateFromGLBuffer"],
    ]
