"""Heights as 16-bit numbers: a range in metres, cut into 65536 steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

__all__ = ["HeightSteps"]


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
        return self.range / 65536.0

    @classmethod
    def of(cls, height: npt.NDArray[np.float32], wanted: tuple[float, float] | None = None) -> HeightSteps:
        """Return steps that hold all heights, in the range that was asked for, else as fine as may be.

        Raises
        ------
        InputError
            If heights lie outside of `wanted` (lowest and highest, m), or it is no range.
        """
        raise NotImplementedError

    def encode(self, height: npt.NDArray[np.float32]) -> npt.NDArray[np.uint16]:
        """Return the nearest steps."""
        raise NotImplementedError
