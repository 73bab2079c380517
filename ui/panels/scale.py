"""How a slider's way maps to values: evenly, by ratios, or finer towards zero."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from sketchterrain.sketch import Parameter

_WIDE = 100.0
"""From this ratio of greatest to least value on, a slider goes by ratios."""


@dataclass(frozen=True)
class Scale:
    """A way from the least value, at 0, to the greatest, at 1."""

    low: float
    high: float
    kind: Literal["even", "ratio", "cube"] = "even"
    whole: bool = False

    def at(self, share: float) -> float:
        """Return the value at a share of the way, 0 … 1, rounded to what a person would type."""
        share = min(max(share, 0.0), 1.0)
        if share in (0.0, 1.0):
            return self.high if share else self.low
        if self.kind == "ratio":
            exact = self.low * (self.high / self.low) ** share
        else:
            exact = self.low + (self.high - self.low) * (share**3 if self.kind == "cube" else share)
        return min(max(self._rounded(exact), self.low), self.high)

    def share(self, value: float) -> float:
        """Return the share of the way, 0 … 1, at which a value lies; one beyond the ends lies at an end."""
        value = min(max(value, self.low), self.high)
        if self.kind == "ratio":
            return math.log(value / self.low) / math.log(self.high / self.low)
        share = (value - self.low) / (self.high - self.low)
        return share ** (1 / 3) if self.kind == "cube" else share

    @property
    def step(self) -> float:
        """What one click of an arrow adds, where it is the same everywhere: about a twentieth of the way."""
        step = _nice((self.high - self.low) / 20)
        return max(1.0, round(step)) if self.whole else step

    def _rounded(self, value: float) -> float:
        if self.whole:
            return float(round(value))
        size = max(self.high - self.low if self.kind == "even" else abs(value), 1e-9)
        power = math.floor(math.log10(size))
        grain = 10.0 ** (power - 2)
        if self.kind != "even":  # about a hundredth of the value: 100, 101, … 200, 202, … 500, 505
            grain *= next(n for n in (5, 2, 1) if n * 10.0**power <= size * 1.0001)
        return round(round(value / grain) * grain, 9)


def scale_of(parameter: Parameter, low: float, high: float) -> Scale:
    """Return the way of a slider for a parameter between two values."""
    whole = parameter.kind is int
    if low > 0 and high / low >= _WIDE:
        return Scale(low, high, "ratio", whole)
    if low == 0 and high >= _WIDE and parameter.unit != "°":
        return Scale(low, high, "cube", whole)
    return Scale(low, high, "even", whole)


def _nice(step: float) -> float:
    """Return the nearest of 1, 2, 5, 10 … at or below a step."""
    power = 10.0 ** math.floor(math.log10(step))
    return next(n * power for n in (5.0, 2.0, 1.0) if n * power <= step * 1.0001)
