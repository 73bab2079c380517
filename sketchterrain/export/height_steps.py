"""Quantisation of heights to 16 bits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError

_STEPS = 65536
_HIGHEST = _STEPS - 1
_DECIMALS = 3  # of fitted ranges, which users copy into import dialogs
_MIN_RANGE = 1.0  # m, also for flat terrain: engines refuse 0
_LIMIT = 1e5  # m; beyond it a step is metres
_ROWS_AT_ONCE = 256  # bounds the memory of large grids


@dataclass(frozen=True)
class HeightQuantisation:
    """Heights as the numbers 0 … 65535: height = low + number · range / 65536, as engines scale them.

    Unity reads number / 65536 of its terrain's height, Unreal (number − 32768) / 128 of its Z scale in cm.
    """

    low: float  # m
    range: float  # m of 65536 steps

    @property
    def step(self) -> float:
        """The quantum (m); the error is at most half of it."""
        return self.range / _STEPS

    @property
    def highest(self) -> float:
        """The height of the number 65535 (m)."""
        return self.low + self.step * _HIGHEST

    @property
    def metadata(self) -> dict[str, Any]:
        """Its entry in the sidecar."""
        return {
            "metres": "low + number * metres_per_step",
            "low": self.low,
            "range": self.range,
            "metres_per_step": self.step,
            "height_of_65535": self.highest,
        }

    @classmethod
    def from_heights(
        cls, height: npt.NDArray[np.float32], requested: tuple[float, float] | None = None
    ) -> HeightQuantisation:
        """Return the requested range if all heights fit into it; by default the smallest that they fit into.

        A fitted range is in whole millimetres and at least 1 m.
        """
        low, high = float(height.min()), float(height.max())
        if requested is not None:
            steps = cls.from_range(*requested)
            if low < steps.low - 0.5 * steps.step or high > steps.highest + 0.5 * steps.step:
                lowest, highest = requested
                raise InputError(
                    f"heights {lowest:g},{highest:g}: the terrain goes from {low:.2f} to {high:.2f} m, "
                    f"which does not fit into them"
                )
            return steps
        unit = 10.0**_DECIMALS
        lowest = math.floor(low * unit) / unit
        least = (high - lowest) * (_STEPS / _HIGHEST)
        return cls(lowest, max(math.ceil(least * unit) / unit, _MIN_RANGE))

    @classmethod
    def from_range(cls, lowest: float, highest: float) -> HeightQuantisation:
        """Return the quantisation of a range (m)."""
        if not (math.isfinite(lowest) and math.isfinite(highest) and lowest < highest):
            raise InputError(f"heights {lowest:g},{highest:g}: expected the lowest and the highest, m")
        if max(-lowest, highest) > _LIMIT:
            raise InputError(f"heights {lowest:g},{highest:g}: expected them within ±{_LIMIT:g} m")
        return cls(lowest, highest - lowest)

    def encode(self, height: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
        """Return the nearest numbers, in the heights' shape."""
        result = np.empty(height.shape, np.uint16)
        for top in range(0, len(height), _ROWS_AT_ONCE):
            rows = slice(top, top + _ROWS_AT_ONCE)
            number = np.rint((height[rows].astype(np.float64) - self.low) / self.step)
            if number.min() < 0 or number.max() > _HIGHEST:
                low, high = float(height[rows].min()), float(height[rows].max())
                valid = f"{self.low:g} to {self.highest:g} m"
                raise InputError(f"heights from {low:.2f} to {high:.2f} m do not fit into {valid}")
            result[rows] = number
        return result
