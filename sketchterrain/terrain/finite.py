"""Checks for non-finite values from a device."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.errors import DeviceFailedError

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.compute import Device


def require_finite(values: npt.NDArray[Any], what: str, device: Device) -> None:
    """Raise DeviceFailedError if any value is not finite.

    No recipe gives such values, so the device failed.
    """
    bad = values.size - int(np.count_nonzero(np.isfinite(values)))
    if bad:
        raise non_finite(what, device, f"{bad} of {values.size}")


def non_finite(what: str, device: Device, count: str) -> DeviceFailedError:
    """Return the error for a count of non-finite values, for example ``"3 of 4225"`` ``"heights"``."""
    return DeviceFailedError(
        f"{device.name} ({device.platform}) produced non-finite {what} (NaN or Inf): {count}"
    )
