"""OpenCL devices: list them, choose one by selector, find a fallback.

The wheel ``intel-opencl-rt`` of the ``cpu`` extra puts its libraries where no loader looks. The loader
bundled with pyopencl reads a folder of ``.icd`` files, one per driver; it gets a folder with every driver it
would have found, and this one.
"""

import ctypes
import os
import sys
import tempfile
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution
from itertools import islice
from pathlib import Path
from typing import Any

from sketchterrain.compute.device_check import TWIN_VARIABLE, check_device, is_usable
from sketchterrain.errors import DeviceError, DeviceFailedError

_SYSTEM_VENDORS = Path("/etc/OpenCL/vendors")
_VENDORS_VARIABLE = "OCL_ICD_VENDORS"
# Dependencies that libintelocl.so would not find by itself, in load order.
_DEPENDENCIES = ("libirng.so", "libimf.so", "libintlc.so.5", "libsvml.so", "libtbb.so.12")


@contextmanager
def all_drivers_visible() -> Iterator[None]:
    """Make the first OpenCL call within this context find the system's drivers and the wheel's.

    The environment is restored afterwards for child processes. Does nothing without the wheel, or where the
    system has that runtime already.
    """
    library = _wheel_runtime()
    given = _read_icd_files()
    if library is None or any(library.name in text for text in given.values()):
        yield
        return
    _load_dependencies(library.parent)
    before = os.environ.get(_VENDORS_VARIABLE)
    with tempfile.TemporaryDirectory(prefix="sketchterrain-icd-") as folder:
        for name, text in given.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        (Path(folder) / "zz-intel-wheel.icd").write_text(f"{library}\n", encoding="utf-8")
        os.environ[_VENDORS_VARIABLE] = folder
        try:
            yield
        finally:
            if before is None:
                del os.environ[_VENDORS_VARIABLE]
            else:
                os.environ[_VENDORS_VARIABLE] = before


def _wheel_runtime() -> Path | None:
    """Return the path of the wheel's OpenCL driver, None if it is not installed."""
    try:
        installed = distribution("intel-opencl-rt").files or []
    except PackageNotFoundError:
        return None
    for file in installed:
        if file.name == "libintelocl.so":
            path = Path(str(file.locate())).resolve().with_name("libintelocl.so")
            return path if path.exists() and sys.platform == "linux" else None
    return None


def _read_icd_files() -> dict[str, str]:
    """Return name and text of every ``.icd`` file the loader would read by itself."""
    setting = os.environ.get(_VENDORS_VARIABLE)
    location = Path(setting) if setting else _SYSTEM_VENDORS
    if location.is_dir():
        return {file.name: file.read_text(encoding="utf-8") for file in sorted(location.glob("*.icd"))}
    if location.suffix == ".icd" and location.is_file():
        return {location.name: location.read_text(encoding="utf-8")}
    return {"user-setting.icd": f"{setting}\n"} if setting else {}


def _load_dependencies(folder: Path) -> None:
    for name in _DEPENDENCIES:
        # Newer runtimes may not need all of them; loading the driver fails if one is really missing.
        if (folder / name).exists():
            ctypes.CDLL(str(folder / name), ctypes.RTLD_GLOBAL)


with all_drivers_visible():
    import pyopencl as cl

    try:
        _PLATFORMS = tuple(cl.get_platforms())
    except cl.LogicError:  # no driver at all
        _PLATFORMS = ()

_TYPES = {cl.device_type.GPU: "GPU", cl.device_type.CPU: "CPU", cl.device_type.ACCELERATOR: "accelerator"}
_INTEL, _POCL = "Intel", "Portable Computing Language"
_KNOWN = (_INTEL, _POCL)
_ALIASES = {"pocl": _POCL.lower()}  # selectors that are not part of a platform's name
_INSTALL_HINT = (
    "no OpenCL device found: install a GPU driver, or a CPU driver with "
    "pip install 'sketchterrain[cpu]' or apt install pocl-opencl-icd"
)


@dataclass(frozen=True)
class Device:
    """One OpenCL device, as listed by ``sketchterrain devices``; strings as the driver reports them."""

    index: int  # position in the list, 0 for the preferred device
    name: str
    platform: str
    vendor: str
    driver: str
    version: str
    type: str  # 'GPU', 'CPU' or 'accelerator'
    memory_bytes: int  # global memory
    compute_units: int
    has_double: bool  # can run the float64 builds of the kernels
    gl_sharing: str  # how vertex buffers reach OpenGL: 'extension', 'mapped' (host memory) or 'copy'
    handle: Any  # the pyopencl device
    twin_of: "Device | None" = None  # the device of which this is a second entry, for tests

    @property
    def known(self) -> bool:
        """Whether the tests verify its driver's bits: Intel's CPU runtime and PoCL on a CPU."""
        return self.type == "CPU" and any(name in self.platform for name in _KNOWN)


@cache
def list_devices() -> tuple[Device, ...]:
    """Return every OpenCL device, the preferred first: GPU, then Intel's CPU runtime, then others.

    With ``SKETCHTERRAIN_TWIN_DEVICE`` set, the first CPU device that works is also the last, as its twin.
    """
    found = [handle for platform in _PLATFORMS for handle in _devices_of(platform)]
    found.sort(key=_preference)
    devices = [_describe(index, handle) for index, handle in enumerate(found)]
    if os.environ.get(TWIN_VARIABLE):
        working = (each for each in devices if each.type == "CPU" and not check_device(each).failure)
        devices += [_twin(each, len(devices)) for each in islice(working, 1)]
    return tuple(devices)


def choose_device(selector: str | None = None) -> Device:
    """Return the first usable device that matches a selector; failing ones are skipped and logged.

    A selector is an index of :func:`list_devices`; ``gpu``, ``cpu`` or ``accelerator``; or part of a
    platform's, vendor's or device's name, in any case, ``pocl`` too. Platform names are matched before
    vendors, vendors before devices: ``intel`` is Intel's runtime, not PoCL on an Intel processor. ``None``
    uses ``PYOPENCL_CTX`` (``"platform"`` or ``"platform:device"``, each a number or part of a name) if set,
    else the preferred device.

    Raises DeviceError if no device matches, DeviceFailedError if all that match failed their check.
    """
    devices = list_devices()
    if not devices:
        raise DeviceError(_INSTALL_HINT)
    if selector is not None:
        matching = _match(devices, selector)
        origin = f"--device {selector}"
    elif os.environ.get("PYOPENCL_CTX"):
        matching = _by_pyopencl_ctx(os.environ["PYOPENCL_CTX"], devices)
        origin = f"PYOPENCL_CTX={os.environ['PYOPENCL_CTX']}"
    else:
        matching, origin = list(devices), ""
    if not matching:
        names = "; ".join(f"{d.index}: {d.name} ({d.platform}, {d.type})" for d in devices)
        raise DeviceError(f"no OpenCL device fits {origin}; there are {names}")
    if all(check_device(d).failure for d in matching):  # stops at the first usable one
        failures = "; ".join(f"{d.name} ({d.platform}): {check_device(d).failure}" for d in matching)
        raise DeviceFailedError(
            f"no OpenCL device {f'that fits {origin} ' if origin else ''}works: {failures}"
        )
    return next(filter(is_usable, matching))


def fallback_device(failed: Collection[Device]) -> Device | None:
    """Return the CPU device to resume work on after others failed, None if none is left."""
    spares = (d for d in list_devices() if d.type == "CPU" and d not in failed)
    return next(filter(is_usable, spares), None)


def _devices_of(platform: Any) -> list[Any]:
    try:
        return list(platform.get_devices())
    except cl.Error:  # a driver without a device of its kind, or a broken one, must not hide the others
        return []


def _preference(handle: Any) -> tuple[int, int]:
    if handle.type & cl.device_type.GPU:
        return 0, -int(handle.max_compute_units)
    if _INTEL in handle.platform.name:
        return 1, 0
    return (2 if _POCL in handle.platform.name else 3), 0


def _describe(index: int, handle: Any) -> Device:
    kind = next((name for bit, name in _TYPES.items() if handle.type & bit), "other")
    extensions = handle.extensions.split()
    # Where host memory is device memory, a kernel can write into a mapped vertex buffer.
    without_extension = "mapped" if kind == "CPU" else "copy"
    return Device(
        index=index,
        name=handle.name.strip(),
        platform=handle.platform.name.strip(),
        vendor=handle.vendor.strip(),
        driver=handle.driver_version.strip(),
        version=handle.version.strip(),
        type=kind,
        memory_bytes=int(handle.global_mem_size),
        compute_units=int(handle.max_compute_units),
        has_double="cl_khr_fp64" in extensions,
        gl_sharing="extension" if "cl_khr_gl_sharing" in extensions else without_extension,
        handle=handle,
    )


def _twin(device: Device, index: int) -> Device:
    name, platform = f"Twin of {device.name}", f"{device.platform} (twin)"
    return replace(device, index=index, name=name, platform=platform, twin_of=device)


def _match(devices: tuple[Device, ...], selector: str) -> list[Device]:
    if selector.isdigit():
        return [device for device in devices if device.index == int(selector)]
    pattern = selector.lower()
    if pattern in {name.lower() for name in _TYPES.values()}:
        return [device for device in devices if device.type.lower() == pattern]
    pattern = _ALIASES.get(pattern, pattern)
    for name in ("platform", "vendor", "name"):
        matching = [device for device in devices if pattern in getattr(device, name).lower()]
        if matching:
            return matching
    return []


def _by_pyopencl_ctx(setting: str, devices: tuple[Device, ...]) -> list[Device]:
    """Return devices that ``PYOPENCL_CTX`` names, by pyopencl's own numbering."""
    platform_part, _, device_part = setting.partition(":")
    matching = []
    for number, platform in enumerate(_PLATFORMS):
        if not _part_matches(platform_part, number, platform.name):
            continue
        handles = _devices_of(platform)
        matching += [
            d
            for i, h in enumerate(handles)
            if _part_matches(device_part, i, h.name)
            for d in devices
            if d.handle == h
        ]
    return matching


def _part_matches(part: str, number: int, name: str) -> bool:
    return part == "" or (int(part) == number if part.isdigit() else part.lower() in name.lower())


def device_entry(device: Device) -> dict[str, Any]:
    """Return the facts about a device; memory in bytes."""
    return {
        "index": device.index,
        "name": device.name,
        "version": device.version,
        "platform": device.platform,
        "driver": device.driver,
        "type": device.type,
        "memory": device.memory_bytes,
        "compute_units": device.compute_units,
        "float64": device.has_double,
        "gl_sharing": device.gl_sharing,
    }
