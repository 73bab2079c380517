"""One-line messages for device failures."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pyopencl as cl

from sketchterrain.errors import BuildError, DeviceError, DeviceFailedError, DeviceMemoryError, one_line

if TYPE_CHECKING:
    from sketchterrain.compute.device import Device

_STATUS = cl.status_code
# CL_OUT_OF_RESOURCES is not one of them: drivers say it of a kernel that crashed, too.
_NO_ROOM = {
    _STATUS.MEM_OBJECT_ALLOCATION_FAILURE,
    _STATUS.OUT_OF_HOST_MEMORY,
    _STATUS.INVALID_BUFFER_SIZE,  # more than the device gives at once
}
_LONGEST = 200  # characters of a log's line


def call_error(device: Device, action: str, error: cl.Error) -> DeviceError:
    """Return the exception to raise for an OpenCL error; `action` is for example ``"launching patches"``."""
    reason = one_line(" ".join(str(error).split()))
    where = f"{device.name} ({device.platform})"
    if isinstance(error, cl.MemoryError) or _code(error) in _NO_ROOM:
        return DeviceMemoryError(f"{where} has no memory left for {action}: {reason}")
    return DeviceFailedError(f"{where} failed at {action}: {reason}")


def build_error(device: Device, file: str, options: tuple[str, ...], error: cl.Error) -> BuildError:
    """Return one line with the kernel's file, the device, the options and the log's first error."""
    return BuildError(
        f"kernels/{file} did not build on {device.name} ({device.platform} {device.driver}) "
        f"with {' '.join(options)}: {_first_error(str(error))} (SKETCHTERRAIN_DEBUG=1 shows the whole log)"
    )


def _code(error: cl.Error) -> int | None:
    try:
        return int(error.code)
    except (AttributeError, TypeError):  # raised by pyopencl itself, not by the driver
        return None


def _first_error(log: str) -> str:
    lines = [line.strip() for line in log.splitlines() if line.strip()]
    told = next((line for line in lines if "error:" in line.lower()), lines[0] if lines else "no log")
    return one_line(told[:_LONGEST])
