"""Contexts: kernels, builds, the self-test's arithmetic, small arrays in one transfer."""

import re
from importlib.resources import files
from threading import Event
from threading import enumerate as threads
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import pytest

from sketchterrain.compute import context as context_module
from sketchterrain.compute.arithmetic import failed_operations
from sketchterrain.compute.buffers import StagingBuffer
from sketchterrain.compute.context import ComputeContext
from sketchterrain.errors import BuildError, DeviceMemoryError
from sketchterrain.io import resources
from sketchterrain.look import texture_levels
from sketchterrain.schema.materials import BUILT_IN
from sketchterrain.terrain.materials import material_defines
from tests.devices import each_device, needs_device

pytestmark = needs_device
ADD = """
__kernel void add(__global const float *a, float b, __global float *sum)
{
    sum[get_global_id(0)] = a[get_global_id(0)] + b;
}
"""


def test_kernels_run_and_are_timed_and_empty_arrays_round_trip(monkeypatch):
    monkeypatch.setattr(resources, "source", lambda *_: ADD)
    context = ComputeContext()
    values = np.arange(1000, dtype=np.float32)
    result = context.empty(1000, np.float32)
    context.launch("add.cl", "add", (1000,), context.upload(values), np.float32(0.5), result)
    event = context.launch("add.cl", "add", (1000,), context.upload(values), np.float32(2), result)
    np.testing.assert_array_equal(context.download(result, 1000, np.float32), values + 2)
    assert 0 < (event.profile.end - event.profile.start) * 1e-9 < 60

    context = ComputeContext()
    context.upload(np.zeros((0, 4), np.float32))
    assert context.download(context.empty(0, np.float32), 0, np.float32).shape == (0,)


def test_failed_builds_and_missing_kernels_raise_build_errors(monkeypatch):
    monkeypatch.setattr(resources, "source", lambda *_: "__kernel void broken() { nonsense; }")
    context = ComputeContext()
    with pytest.raises(BuildError, match=r"kernels/broken.cl did not build on .* with -cl-std") as caught:
        context.launch("broken.cl", "broken", (1,))
    assert "nonsense" in str(caught.value)

    monkeypatch.setattr(resources, "source", lambda *_: ADD)
    with pytest.raises(BuildError, match=r"kernels/add.cl was built on .* without its kernel subtract"):
        ComputeContext().launch("add.cl", "subtract", (1,))


def added(context, number):
    result = context.empty(4, np.float32)
    values = context.upload(np.arange(4, dtype=np.float32))
    context.launch("add.cl", "add", (4,), values, np.float32(number), result)
    return context.download(result, 4, np.float32).tolist()


def test_a_program_of_a_driver_without_a_cache_is_compiled_once(monkeypatch, tmp_path):
    programs, cl = [], context_module.cl
    monkeypatch.setattr(cl, "Program", Mock(side_effect=cl.Program))
    monkeypatch.setattr(resources, "source", lambda *_: ADD)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))

    def given_by_next_process(*, stores_itself=None):  # a source, or a device and a binary
        monkeypatch.setattr(context_module, "has_src_build_cache", lambda _: stores_itself)
        context_module._built.cache_clear()
        cl.Program.reset_mock()
        assert added(ComputeContext(), 2) == [2, 3, 4, 5]
        programs.extend(tmp_path.rglob("program-*.cached"))
        return [len(call.args) - 1 for call in cl.Program.call_args_list]

    assert given_by_next_process(stores_itself=True) == [1]
    assert not programs
    assert given_by_next_process() == [1]
    assert given_by_next_process() == [2]
    monkeypatch.setattr(context_module, "cached_bytes", lambda *_, **__: b"of another processor")
    assert given_by_next_process() == [2, 1]
    assert len(set(programs)) == 1
    context_module._built.cache_clear()


def test_a_child_process_compiles_what_is_built_ahead_and_stored(monkeypatch, tmp_path):
    cl = context_module.cl
    monkeypatch.setattr(cl, "Program", Mock(side_effect=cl.Program))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(context_module, "has_src_build_cache", lambda _: None)
    context_module._built.cache_clear()
    if ComputeContext().device.platform.startswith("Portable"):
        pytest.skip("the child process leaves storing to the driver")
    defines = (("UNUSED", 1),)
    ComputeContext().build_ahead([("sharing_probe.cl", defines)])
    for thread in threads():
        if thread.name == "programs":
            thread.join(60)
    assert ComputeContext()._build("sharing_probe.cl", defines).all_kernels()
    assert [len(call.args) for call in cl.Program.call_args_list] == [3]  # of a binary
    context_module._built.cache_clear()


def test_programs_are_built_ahead_and_no_launch_waits_for_another_one(monkeypatch):
    slow, built, go_on = ADD + "\n// slow", [], Event()
    sources = {"add.cl": ADD, "slow.cl": slow, "broken.cl": "nonsense", "late.cl": ADD + "\n// late"}
    monkeypatch.setattr(resources, "source", lambda name, _: sources[name])
    real = context_module._built.__wrapped__

    def build(context, source, options):
        assert source != slow or go_on.wait(60)
        built.append(source)
        return real(context, source, options)

    def wait():
        for thread in threads():
            if thread.name == "programs":
                thread.join(60)

    monkeypatch.setattr(context_module, "_built", context_module.cache(build))
    context = ComputeContext()
    context.build_ahead([("slow.cl", ()), ("broken.cl", ())])
    assert added(context, 1) == [1, 2, 3, 4]
    assert built == [ADD]
    go_on.set()
    wait()
    context.launch("slow.cl", "add", (1,), context.empty(1, "f4"), np.float32(1), context.empty(1, "f4"))
    assert built == [ADD, slow, "nonsense"]
    with pytest.raises(BuildError, match=r"kernels/broken.cl did not build"):
        context.launch("broken.cl", "add", (1,))

    monkeypatch.setattr(context_module, "main_thread", lambda: SimpleNamespace(is_alive=lambda: False))
    context.build_ahead([("late.cl", ())])
    wait()
    assert sources["late.cl"] not in built


def test_kernels_use_double_only_if_supported():
    for file in files("sketchterrain.kernels").iterdir():
        if file.name.endswith((".cl", ".clh")):
            code = re.sub(r"//.*|/\*.*?\*/", "", file.read_text(encoding="utf-8"))
            code = re.sub(r"(?sm)^#ifdef cl_khr_fp64$.*?^#endif$", "", code)
            assert not re.search(r"double", code), file.name


@pytest.mark.parametrize("real", ["float", pytest.param("double", marks=pytest.mark.slow)])
@each_device
def test_every_kernel_builds_on_every_device(device, real):
    if real == "double" and not device.has_double:
        pytest.skip("no 64-bit floats")
    context = ComputeContext(device, real=real)
    programs = [file.name for file in files("sketchterrain.kernels").iterdir() if file.name.endswith(".cl")]
    assert {"terrain.cl", "tiles.cl", "graded_poisson.cl"} <= set(programs)
    for file in programs:
        if file != "ground_bytes.cl" or device.has_double:  # it rounds in 64 bits, else has no kernel
            defines = texture_levels.DEFINES if file == texture_levels.SOURCE else material_defines(BUILT_IN)
            assert context._build(file, defines).all_kernels(), file


@each_device
def test_arithmetic_is_ieee_and_contraction_is_detected(device, monkeypatch):
    assert failed_operations(ComputeContext(device)) == ()
    if device.known:  # these compilers fuse where they may
        assert "inverse_sqrt" in failed_operations(ComputeContext(device, fast=True))
    text = resources.source("self_test.cl")
    fused = text.replace("a[i] * b[i] + c[i];", "fma(a[i], b[i], c[i]);")
    assert fused != text
    monkeypatch.setattr(resources, "source", lambda *_: fused)
    assert failed_operations(ComputeContext(device)) == ("a product and a sum",)


@pytest.mark.parametrize(
    ("right", "wrong", "name"),
    [
        ("mixed(n);", "mixed(n) + 1;", "mixed"),
        ("inverse_sqrt(p);", "rsqrt(p);", "inverse_sqrt"),
        ("far >> (n & 31)", "(ulong)far >> (n & 31)", None),
        ("far >> (n & 31)", "far / (1L << (n & 31))", "a shift"),
        ("(uint)(int)(a[i] * R(1e6))", "(uint)convert_int_rte(a[i] * R(1e6))", "a conversion"),
    ],
)
def test_a_planted_wrong_operation_is_named(monkeypatch, right, wrong, name):
    text = resources.source("self_test.cl")
    assert right in text
    monkeypatch.setattr(resources, "source", lambda *_: text.replace(right, wrong))
    assert failed_operations(ComputeContext()) == (() if name is None else (name,))


@each_device
def test_staged_arrays_round_trip(device):
    context, draw = ComputeContext(device), np.random.default_rng(3)
    staging = StagingBuffer(context)
    for count in (1, 7, 3, 4000, 2, 4001):
        arrays = {
            "reals": draw.normal(size=(count, 4)).astype(np.float32),
            "nothing": np.zeros(0, np.int32),
            "longs": draw.integers(0, 1 << 60, 3 * count),
        }
        parts = staging.upload(arrays)
        for name, array in arrays.items():
            found = context.download(parts[name], array.shape, array.dtype)
            np.testing.assert_array_equal(found, array)


def test_staging_still_works_after_out_of_memory(monkeypatch):
    context = ComputeContext()
    staging = StagingBuffer(context)
    staging.upload({"a": np.arange(10)})

    with monkeypatch.context() as patch:
        patch.setattr(context, "empty", Mock(side_effect=DeviceMemoryError("full")))
        with pytest.raises(DeviceMemoryError):
            staging.upload({"a": np.arange(10_000)})
        small = staging.upload({"a": np.arange(20)})
    np.testing.assert_array_equal(context.download(small["a"], 20, np.int64), np.arange(20))
    large = staging.upload({"a": np.arange(10_000)})
    np.testing.assert_array_equal(context.download(large["a"], 10_000, np.int64), np.arange(10_000))
