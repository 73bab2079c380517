"""What a result was measured with: device, system, versions. Names no host and no path."""

from __future__ import annotations

import platform
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sketchterrain.compute.device import Device

_PACKAGES = (
    "sketchterrain",
    "numpy",
    "scipy",
    "scikit-image",
    "pyopencl",
    "intel-opencl-rt",
    "pocl-binary-distribution",
)


def describe(device: Device, *, command: str) -> dict[str, str]:
    """Return what a reader must know to judge the numbers, as headings and texts."""
    return {
        "device": f"{device.name} ({device.type}, {device.compute_units} compute units)",
        "platform": device.platform,
        "driver": f"{device.driver} ({device.version})",
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
        "packages": ", ".join(f"{name} {found}" for name in _PACKAGES if (found := _version(name))),
        "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        "command": command,
    }


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None
