"""Heights as 16-bit numbers: a range in metres, cut into 65536 steps."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError

_STEPS = 65536
_HIGHEST = _STEPS - 1
_DECIMALS = 3  # of what a person types in
_SMALLEST = 1.0  # m: a range that programs accept, also of flat ground
_FARTHEST = 1e5  # m: beyond it the steps of 16 bits are metres
_ROWS_AT_ONCE = 256


@dataclass(frozen=True)
class HeightSteps:
    """What the numbers 0 … 65535 mean: height = low + number · range / 65536.

    Engines scale so: Unity reads number / 65536 of its terrain's height, Unreal (number − 32768) / 128 of its
    Z scale in centimetres.

    Attributes
    ----------
    low : float
        m.
    range : float
        m of 65536 steps; the highest height that fits is ``low + range · 65535 / 65536``.
    """

    low: float
    range: float

    @property
    def step(self) -> float:
        """The quantum, m: a height is off by half of it at most."""
        return self.range / _STEPS

    @property
    def highest(self) -> float:
        """The height of the number 65535, m."""
        return self.low + self.step * _HIGHEST

    @property
    def facts(self) -> dict[str, Any]:
        """What a sidecar says of them."""
        return {
            "metres": "low + number * metres_per_step",
            "low": self.low,
            "range": self.range,
            "metres_per_step": self.step,
            "height_of_65535": self.highest,
        }

    @classmethod
    def of(cls, height: npt.NDArray[np.float32], wanted: tuple[float, float] | None = None) -> HeightSteps:
        """Return steps that hold all heights, in the range that was asked for, else as fine as may be.

        Found ones are whole millimetres, which can be typed in, and a range of 1 m at least.
        """
        low, high = float(height.min()), float(height.max())
        if wanted is not None:
            return cls._checked(low, high, wanted)
        unit = 10.0**_DECIMALS
        lowest = math.floor(low * unit) / unit
        least = (high - lowest) * (_STEPS / _HIGHEST)
        return cls(lowest, max(math.ceil(least * unit) / unit, _SMALLEST))

    @classmethod
    def between(cls, lowest: float, highest: float) -> HeightSteps:
        """Return the steps of a range, m."""
        if not (math.isfinite(lowest) and math.isfinite(highest) and lowest < highest):
            raise InputError(f"heights {lowest:g},{highest:g}: expected the lowest and the highest, m")
        if max(-lowest, highest) > _FARTHEST:
            raise InputError(f"heights {lowest:g},{highest:g}: expected them within ±{_FARTHEST:g} m")
        return cls(lowest, highest - lowest)

    @classmethod
    def _checked(cls, low: float, high: float, wanted: tuple[float, float]) -> HeightSteps:
        steps = cls.between(*wanted)
        lowest, highest = wanted
        if low < lowest - 0.5 * steps.step or high > steps.highest + 0.5 * steps.step:
            raise InputError(
                f"heights {lowest:g},{highest:g}: the terrain goes from {low:.2f} to {high:.2f} m, "
                f"which does not fit into them"
            )
        return steps

    def encode(self, height: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
        """Return the nearest steps, of the heights' shape."""
        result = np.empty(height.shape, np.uint16)
        for top in range(0, len(height), _ROWS_AT_ONCE):  # bounds the memory of large grids
            rows = slice(top, top + _ROWS_AT_ONCE)
            number = np.rint((height[rows].astype(np.float64) - self.low) / self.step)
            if number.min() < 0 or number.max() > _HIGHEST:
                low, high = float(height[rows].min()), float(height[rows].max())
                held = f"{self.low:g} to {self.highest:g} m"
                raise InputError(f"heights from {low:.2f} to {high:.2f} m do not fit into {held}")
            result[rows] = number
        return result
