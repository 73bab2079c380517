"""Device check, cached on disk: the driver survives its first kernel and computes IEEE 754 arithmetic.

The check runs in a child process: a driver that aborts, hangs or exits there cannot end the program.
"""

from __future__ import annotations

import json
import logging
import os
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from hashlib import sha256
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from sketchterrain.errors import SketchterrainError
from sketchterrain.io import resources
from sketchterrain.io.files import cache_folder, write_atomic
from sketchterrain.io.system import ChildFailedError, ChildTimedOutError, module_result

if TYPE_CHECKING:
    from sketchterrain.compute.device import Device  # which lists devices by their checks

TWIN_VARIABLE: Final = "SKETCHTERRAIN_TWIN_DEVICE"  # adds a second entry of a working device to the list
_MODULE: Final = "sketchterrain.compute.arithmetic"
_TIMEOUT: Final = 60.0  # s
_LOG = logging.getLogger("sketchterrain")


@dataclass(frozen=True)
class DeviceCheck:
    """Result of the check of one device."""

    failure: str  # why the device can't be used and what to install, one line; empty if usable
    wrong: tuple[str, ...] = ()  # operations whose bits differ from IEEE 754


@cache
def check_device(device: Device) -> DeviceCheck:
    """Run the self-test on a device, in a child process the first time; a twin's is that of its device."""
    if device.twin_of is not None:
        return check_device(device.twin_of)

    def check() -> dict[str, Any]:
        # PoCL's cache would hide a missing linker; a list with a twin would need this check.
        environment = os.environ | {"POCL_KERNEL_CACHE": "0", TWIN_VARIABLE: ""}
        try:
            result = module_result(
                _MODULE, str(device.index), name="the self-test", timeout=_TIMEOUT, environment=environment
            )
        except ChildTimedOutError:
            raise
        except ChildFailedError as error:
            return {"failure": str(error), "wrong": []}
        return {"failure": "", "wrong": json.loads(result)}

    test = (
        resources.source("self_test.cl"),
        files("sketchterrain.compute").joinpath("arithmetic.py").read_text(),
    )
    try:
        found = cached_on_disk("arithmetic", (device,), test, check)
    except ChildTimedOutError as error:
        return DeviceCheck(str(error))
    return DeviceCheck(found["failure"], tuple(found["wrong"]))


def is_usable(device: Device) -> bool:
    """Return whether a device passed its check; log one line per process if not."""
    failure = check_device(device).failure
    if failure:
        _log_once(f"{device.name} ({device.platform}) is not used: {failure}")
    return not failure


@cache
def _log_once(line: str) -> None:
    _LOG.warning("%s", line)


def cached_on_disk(
    test: str, devices: tuple[Device, ...], sources: tuple[str, ...], run: Callable[[], dict[str, Any]]
) -> dict[str, Any]:
    """Return a test's cached JSON result for a device, or run the test and store the result.

    `devices` is the tested device, then those it is compared with. A change of `sources`, of a driver's
    version, of PoCL's settings or of the linker in the PATH makes the stored result stale. A test that
    raises, as on a timeout, is not stored.
    """
    drivers = [(device.platform, device.name, device.driver, device.version) for device in devices]
    settings = sorted(setting for setting in os.environ.items() if setting[0].startswith("POCL_"))
    key = _digest([drivers, settings, shutil.which("ld"), *sources])
    path = cache_folder() / f"device-{test}-{_digest(drivers[0])[:16]}.json"
    stored = _read(path)
    if stored.get("key") != key:
        stored = {"key": key, "result": run()}
        with suppress(OSError, SketchterrainError):  # without a cache the next start is slower
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, json.dumps(stored).encode())
    result: dict[str, Any] = stored["result"]
    return result


def clear_check_results() -> None:
    """Delete all cached results, so that each device is tested again."""
    check_device.cache_clear()
    with suppress(OSError):
        for path in cache_folder().glob("device-*.json"):
            path.unlink(missing_ok=True)


def _digest(value: object) -> str:
    return sha256(json.dumps(value).encode()).hexdigest()


def _read(path: Path) -> dict[str, Any]:
    try:
        stored = json.loads(path.read_bytes())
    except (OSError, ValueError):
        return {}
    return stored if isinstance(stored, dict) else {}
