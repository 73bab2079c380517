import os
import subprocess
import sys
from importlib.metadata import distributions
from pathlib import Path

import pytest

from sketchterrain.compute import device_check
from sketchterrain.compute.device import Device, choose_device, list_devices
from sketchterrain.compute.device_check import DeviceCheck, is_usable
from sketchterrain.errors import DeviceError
from tests.devices import DEVICES, TWIN, USABLE, needs_device


def in_fresh_process(code, **environment):
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=os.environ | environment
    )
    return done.stdout.strip()


@needs_device
def test_devices_are_sorted_and_selected_by_index_and_name():
    order = {"GPU": 0, "CPU": 1}
    listed = list_devices()
    kinds = [order.get(device.type, 2) for device in listed if device != TWIN]
    assert kinds == sorted(kinds)
    assert [device.index for device in listed] == list(range(len(listed)))
    assert choose_device() == DEVICES[0] or "PYOPENCL_CTX" in os.environ

    for device in USABLE:
        assert choose_device(str(device.index)) == device
        assert choose_device(device.platform.upper()).platform == device.platform


def test_selectors_match_types_then_platforms_then_vendors_then_names(monkeypatch):
    def device(index, platform, vendor, name, kind="CPU"):
        return Device(index, name, platform, vendor, "1", "OpenCL 3.0", kind, 1 << 30, 4, True, "copy", index)

    devices = (
        device(0, "NVIDIA CUDA", "NVIDIA Corporation", "NVIDIA H200", "GPU"),
        device(1, "rusticl", "Intel", "Mesa Intel(R) Arc", "GPU"),
        device(2, "Portable Computing Language", "GenuineIntel", "cpu-haswell-Intel(R) Core(TM) CPU"),
        device(3, "Intel(R) OpenCL", "Intel(R) Corporation", "Intel(R) Core(TM) CPU"),
        device(4, "rusticl", "Mesa/X.org", "llvmpipe (LLVM 19.1.7, 256 bits)"),
        device(5, "AMD Accelerated Parallel Processing", "Advanced Micro Devices, Inc.", "gfx1100", "GPU"),
    )
    monkeypatch.setattr("sketchterrain.compute.device.list_devices", lambda: devices)
    for function in ("device.check_device", "device_check.check_device"):
        monkeypatch.setattr(f"sketchterrain.compute.{function}", lambda _: DeviceCheck(""))
    expected = [(None, "0", "gpu", "GPU", "nvidia", "h200"), ("rusticl",)]
    expected += [("cpu", "pocl", "PoCL", "portable", "haswell"), ("intel",), ("llvmpipe", "mesa/x.org")]
    expected += [("5", "amd", "advanced micro")]
    monkeypatch.delenv("PYOPENCL_CTX", raising=False)
    for number, selectors in enumerate(expected):
        assert {choose_device(selector).index for selector in selectors} == {number}, selectors
    for selector in ("accelerator", "6", "-1", "no such"):
        with pytest.raises(
            DeviceError, match=f"no OpenCL device fits --device {selector}; there are 0: "
        ) as no:
            choose_device(selector)
        assert all(f"{d.index}: {d.name} ({d.platform}, {d.type})" in str(no.value) for d in devices)


@needs_device
def test_a_twin_is_a_second_entry_of_a_working_device_for_tests_alone(monkeypatch):
    code = (
        "from sketchterrain.compute.device import list_devices; print([d.platform for d in list_devices()])"
    )
    names = [device.platform for device in list_devices()]
    assert in_fresh_process(code) == str(names)
    assert in_fresh_process(code, SKETCHTERRAIN_TWIN_DEVICE="") == str(names[:-1] if TWIN else names)
    if TWIN is not None:
        assert (TWIN.platform, TWIN.name) == (
            f"{TWIN.twin_of.platform} (twin)",
            f"Twin of {TWIN.twin_of.name}",
        )
        assert TWIN.known == TWIN.twin_of.known
        monkeypatch.setattr(device_check, "module_result", None)
        assert is_usable(TWIN)  # without a check of its own


@needs_device
def test_pyopencl_ctx_selects_a_device(monkeypatch):
    for device in DEVICES:
        for selector in (device.platform, f"{device.platform}:0"):
            monkeypatch.setenv("PYOPENCL_CTX", selector)
            assert choose_device().platform == device.platform
    monkeypatch.setenv("PYOPENCL_CTX", "no such platform")
    with pytest.raises(DeviceError, match="no OpenCL device fits PYOPENCL_CTX=no such platform"):
        choose_device()


def test_without_devices_the_error_names_packages_to_install(monkeypatch):
    monkeypatch.setattr("sketchterrain.compute.device.list_devices", tuple)
    with pytest.raises(DeviceError, match="pip install") as caught:
        choose_device()
    assert caught.value.exit_code == 4
    assert "\n" not in str(caught.value)


WHEEL = list(distributions(name="intel-opencl-rt"))
needs_wheel = pytest.mark.skipif(not WHEEL, reason="intel-opencl-rt is not installed")


@needs_wheel
def test_the_wheels_runtime_hides_no_other_driver():
    names = "print(*sorted(p.name for p in cl.get_platforms()), sep=';')"
    try:
        plain = in_fresh_process(f"import pyopencl as cl; {names}", OCL_ICD_VENDORS="")
    except subprocess.CalledProcessError:  # no platform at all is an error in pyopencl
        plain = ""
    ours = in_fresh_process(
        f"from sketchterrain.compute.device import list_devices; import pyopencl as cl; {names}",
        OCL_ICD_VENDORS="",
    )
    assert set(filter(None, plain.split(";"))) < set(ours.split(";"))


@needs_wheel
def test_drivers_of_ocl_icd_vendors_are_found_and_the_setting_is_restored(tmp_path):
    library = next(f for f in WHEEL[0].files or [] if f.name == "libintelocl.so")
    (tmp_path / "mine.icd").write_text(f"{Path(str(library.locate())).resolve()}\n", encoding="utf-8")
    done = in_fresh_process(
        "import os; from sketchterrain.compute.device import list_devices; "
        "print(os.environ['OCL_ICD_VENDORS'], sum('Intel' in d.platform for d in list_devices()))",
        OCL_ICD_VENDORS=str(tmp_path),
        SKETCHTERRAIN_TWIN_DEVICE="",
    )
    assert done == f"{tmp_path} 1"


@pytest.mark.gl
@pytest.mark.skipif(sys.platform != "linux", reason="EGL of Linux")
def test_egl_is_a_global_symbol_as_rusticl_requires():
    code = (
        "import ctypes; from sketchterrain.compute.gl_interop import current_handles; current_handles();"
        "print(hasattr(ctypes.CDLL(None), 'eglGetProcAddress'))"
    )
    assert in_fresh_process(code) == "True"
