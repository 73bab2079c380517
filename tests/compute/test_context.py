import re
from importlib.resources import files

import numpy as np
import pytest

from sketchterrain import resources
from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.errors import BuildError

pytestmark = pytest.mark.skipif(not list_devices(), reason="no OpenCL device")
ADD = """
__kernel void add(__global const float *a, float b, __global float *sum)
{
    sum[get_global_id(0)] = a[get_global_id(0)] + b;
}
"""


def test_a_kernel_runs_and_is_timed_and_empty_arrays_travel(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resources, "source", lambda name: ADD)
    context = ComputeContext()
    values = np.arange(1000, dtype=np.float32)
    result = context.empty(1000, np.float32)
    context.launch("add.cl", "add", (1000,), context.upload(values), np.float32(0.5), result)
    context.start_profile()
    context.launch("add.cl", "add", (1000,), context.upload(values), np.float32(2), result)
    (time,) = context.stop_profile()
    np.testing.assert_array_equal(context.download(result, 1000, np.float32), values + 2)
    assert time.kernel == "add"
    assert 0 < time.seconds < 60

    context = ComputeContext()
    context.upload(np.zeros((0, 4), np.float32))
    assert context.download(context.empty(0, np.float32), 0, np.float32).shape == (0,)


def test_failed_builds_and_missing_kernels_are_one_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(resources, "source", lambda name: "__kernel void broken() { nonsense; }")
    context = ComputeContext()
    with pytest.raises(BuildError, match=r"kernels/broken.cl did not build on .* with -cl-std") as caught:
        context.launch("broken.cl", "broken", (1,))
    assert "nonsense" in str(caught.value)

    monkeypatch.setattr(resources, "source", lambda name: ADD)
    with pytest.raises(BuildError, match=r"kernels/add.cl was built on .* without its kernel subtract"):
        ComputeContext().launch("add.cl", "subtract", (1,))


def test_kernels_name_double_only_where_there_is_one() -> None:
    """Compilers without 64-bit floats refuse the very name."""
    for file in files("sketchterrain.kernels").iterdir():
        if file.name.endswith((".cl", ".clh")):
            code = re.sub(r"//.*|/\*.*?\*/", "", file.read_text(encoding="utf-8"))
            code = re.sub(r"(?sm)^#ifdef cl_khr_fp64$.*?^#endif$", "", code)
            assert not re.search(r"double", code), file.name


@pytest.mark.parametrize("real", ["float", pytest.param("double", marks=pytest.mark.slow)])
@pytest.mark.parametrize("device", list_devices(), ids=lambda d: d.platform)
def test_every_kernel_builds_on_every_device(device, real: str) -> None:
    if real == "double" and not device.has_double:
        pytest.skip("no doubles here")
    context = ComputeContext(device, real=real)
    programs = [file.name for file in files("sketchterrain.kernels").iterdir() if file.name.endswith(".cl")]
    assert {"terrain.cl", "tiles.cl", "poisson.cl"} <= set(programs)
    for file in programs:
        if file != "ground_bytes.cl" or device.has_double:  # it rounds in 64 bits, else has no kernel
            assert context._build(file).all_kernels(), file
