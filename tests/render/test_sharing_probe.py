"""Which kind of vertex memory works: tried in a child that may crash or hang."""

import sys
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.compute import ComputeContext, Device, gl_interop, list_devices
from sketchterrain.compute.gl_interop import GLHandles, current_handles
from sketchterrain.errors import DeviceError
from sketchterrain.render import sharing_probe
from sketchterrain.render.sharing_probe import Sharing, beside_gl, open_device, probe_sharing
from sketchterrain.sketch import Sketch
from sketchterrain.terrain import build

pytestmark = pytest.mark.gl

DEVICES = list_devices()
CPUS = [device for device in DEVICES if device.type == "CPU"]
MAPPED = replace(CPUS[0], gl_sharing="mapped")  # which it is unless its driver has cl_khr_gl_sharing

PROBE_FOR_EXTENSION = """
import sys
from sketchterrain.compute import gl_interop
from sketchterrain.render import sharing_probe
gl_interop._EXTENSION = sys.argv[3]
sharing_probe._probe(int(sys.argv[1]), sys.argv[2])
"""


@pytest.fixture(autouse=True)
def forgotten() -> Iterator[None]:
    probe_sharing.cache_clear()
    yield
    probe_sharing.cache_clear()


def probe_for_extension(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Share through an extension of this name, here and in the probe's child."""

    def command(device: Device, kind: str) -> list[str]:
        return [sys.executable, "-c", PROBE_FOR_EXTENSION, str(device.index), kind, name]

    monkeypatch.setattr(gl_interop, "_EXTENSION", name)
    monkeypatch.setattr(sharing_probe, "_command", command)


def each_in_its_tier(devices: list[Device]) -> list[object]:
    """The first device by default, the others in the slow tier."""
    first, *others = (pytest.param(device, id=device.platform) for device in devices)
    return [first, *(pytest.param(*other.values, id=other.id, marks=pytest.mark.slow) for other in others)]


@pytest.mark.parametrize("device", each_in_its_tier(DEVICES))
def test_the_best_kind_that_works_is_chosen(gl: object, device: Device) -> None:
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
    "a hang": ("import time; time.sleep(60)", "extension: the probe did not answer within 2 s"),
    "a refusal": ("raise SystemExit('the driver refuses')", "extension: the driver refuses"),
    "silence": ("raise SystemExit(3)", "extension: the probe failed with code 3"),
}


def test_a_probe_that_fails_ends_in_a_copy_with_its_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    device = replace(CPUS[0], type="GPU", gl_sharing="extension")
    for what, (code, reason) in FAILURES.items():

        def command(device: Device, kind: str, code: str = code) -> list[str]:
            return [sys.executable, "-c", code if kind == "extension" else "pass"]

        probe_sharing.cache_clear()
        monkeypatch.setattr(sharing_probe, "_command", command)
        assert probe_sharing(device, timeout=2.0) == Sharing("copy", reason), what
    monkeypatch.setattr(
        sharing_probe, "_command", lambda *_: [sys.executable, "-c", "raise SystemExit('no OpenGL 4.3')"]
    )
    assert probe_sharing(MAPPED) == Sharing("none", "mapped: no OpenGL 4.3; copy: no OpenGL 4.3")


@pytest.mark.slow
@pytest.mark.parametrize("device", each_in_its_tier(CPUS))
def test_a_driver_without_the_extension_is_not_asked_for_it(
    gl: object, device: Device, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PoCL's would end the process."""
    handles = current_handles()
    assert handles is not None
    assert handles.window_system == "EGL"
    assert GLHandles("EGL", 5, 7).properties == (0x2008, 5, 0x2009, 7)
    assert GLHandles("GLX", 5, 7).properties == (0x2008, 5, 0x200A, 7)
    probe_for_extension("cl_none_sharing", monkeypatch)
    with pytest.raises(DeviceError, match="shares no buffers with OpenGL: no cl_none_sharing"):
        gl_interop.context_beside(device, handles)
    found = probe_sharing(replace(device, gl_sharing="extension"))
    assert found.kind == "mapped"
    assert "no cl_none_sharing" in found.reason


@pytest.mark.slow
def test_a_driver_that_ends_the_process_is_probed_in_a_child(
    gl: object, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Asked without the extension, in a child: it says no, or it crashes, and vertices are mapped."""
    probe_for_extension("cl_khr_global_int32_base_atomics", monkeypatch)
    for device in CPUS:
        found = probe_sharing(replace(device, gl_sharing="extension"))
        assert "\n" not in found.reason
        if device.gl_sharing == "extension":
            assert (found.kind == "extension") == (found.reason == "")
        else:
            assert found.kind == "mapped"
            assert found.reason.startswith("extension: ")


def test_a_terrain_moves_beside_opengl(monkeypatch: pytest.MonkeyPatch) -> None:
    """To a device that shares buffers; elsewhere it stays where it is."""
    mountain = np.zeros((32, 32), np.uint8)
    mountain[8:20, 8:20] = 1
    sketch = Sketch(extent=1024.0, layers={"mountain": mountain})
    terrain = build(sketch, device=ComputeContext(MAPPED))
    assert beside_gl(terrain) is terrain
    other = ComputeContext(MAPPED)
    monkeypatch.setattr(sharing_probe, "open_device", lambda *_, **__: other)
    assert beside_gl(terrain) is terrain
    other.gl = GLHandles("EGL", 5, 7)
    moved = beside_gl(terrain)
    assert moved.context is other
    assert (moved.recipe, moved.sketch) == (terrain.recipe, terrain.sketch)
    np.testing.assert_array_equal(moved.tile(4, 3, 3).height, terrain.tile(4, 3, 3).height)
    assert beside_gl(moved) is moved
    assert beside_gl("a stand-in") == "a stand-in"
