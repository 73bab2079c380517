"""OpenCL devices of the tests: those that pass the self-test, and a twin of one that can be made to fail.

A driver that does not build or run the self-test's kernel is absent: its tests are skipped with its reason.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from sketchterrain.compute.device import Device, list_devices
from sketchterrain.compute.device_check import check_device

_REAL = [device for device in list_devices() if device.twin_of is None]
ABSENT = {device: failure for device in _REAL if (failure := check_device(device).failure)}
DEVICES = [device for device in _REAL if device not in ABSENT]
USABLE = [device for device in list_devices() if device not in ABSENT]
"""`DEVICES` and the twin, which is the last: at least two on a machine with a CPU driver."""
TWIN = next((device for device in USABLE if device.twin_of), None)
KNOWN = [device for device in USABLE if device.known]
"""Those whose bits the tests verify."""
NO_DEVICE = "no OpenCL device" + "".join(f"; {each.platform}: {why}" for each, why in ABSENT.items())
needs_device = pytest.mark.skipif(not DEVICES, reason=NO_DEVICE)
needs_known_device = pytest.mark.skipif(not KNOWN, reason="needs a CPU driver")


def device_params(
    select: Callable[[Device], object] = lambda _: True, *, twin: bool = False, others: Any = ()
) -> list[Any]:
    """Return a parameter for each device, with a mark for all but the first; absent drivers' are skipped."""
    params: list[Any] = []
    for device in list_devices():
        if select(device) and (twin or not device.twin_of):
            marks = [others] if params and others else []
            if device in ABSENT:
                marks.append(pytest.mark.skip(reason=f"{device.platform}: {ABSENT[device]}"))
            params.append(pytest.param(device, id=device.platform, marks=marks))
    return params


each_device = pytest.mark.parametrize("device", device_params())
each_other_device = pytest.mark.parametrize(
    "other", device_params(lambda device: device not in DEVICES[:1], twin=True)
)


def machine(folder: Path, *, intel: bool = True, pocl: str = "works") -> dict[str, str]:
    """Return variables that hide Intel's runtime, and PoCL ("absent") or let its builds fail ("broken")."""
    variables = {
        "works": {},
        "absent": {"POCL_DEVICES": "none"},
        "broken": {"POCL_EXTRA_BUILD_FLAGS": "-D__kernel=error", "PYOPENCL_NO_CACHE": "1"},
    }[pocl]
    if not intel:  # a runtime that is listed but does not load is not looked for elsewhere
        (folder / "absent.icd").write_text("/absent/libintelocl.so\n", encoding="utf-8")
        variables |= {"OCL_ICD_VENDORS": str(folder)}
    return variables
