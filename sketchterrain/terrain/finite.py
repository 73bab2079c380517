"""No value that is not a number leaves a terrain."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.errors import DeviceFailedError

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.compute import Device


def require_finite(values: npt.NDArray[Any], what: str, device: Device) -> None:
    """Refuse values of which some are not finite: no recipe gives them, so the device went wrong.

    Parameters
    ----------
    values
    what
        What they are, for example ``"heights"``.
    device
        Where they were computed.

    Raises
    ------
    DeviceFailedError
        With how many they are.
    """
    bad = values.size - int(np.count_nonzero(np.isfinite(values)))
    if bad:
        raise DeviceFailedError(
            f"{device.name} ({device.platform}) computed {what}, {bad} of {values.size} of them no numbers"
        )
