"""Time that a frame may spend on what is new, and how much of a kind of work fits into it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Final

_LAUNCH: Final = 0.0004
"""s that a piece of work takes however small it is."""
_SLOWER: Final = 0.3
"""How much of one quick measurement is believed; a slow one is believed at once."""
_HOPE: Final = 0.9
_AS_MUCH: Final = 0.8
"""Of the most time that there was, which counts as as much …"""
_FORGETS: Final = 0.95
"""… and of which so much is remembered from one time to the next, for budgets may get smaller."""


class TimeBudget:
    """Seconds that are left of a frame's budget.

    Parameters
    ----------
    seconds
        The budget.
    timer
        Seconds that run on; tests give their own.

    Attributes
    ----------
    spent : float
        Seconds since it was made, less those that were not counted.
    """

    def __init__(self, seconds: float, *, timer: Callable[[], float] = time.perf_counter) -> None:
        self._seconds = seconds
        self._timer = timer
        self._start = timer()

    @property
    def spent(self) -> float:
        """Seconds since the start."""
        return self._timer() - self._start

    @property
    def left(self) -> float:
        """Seconds that are left, 0 at least."""
        return max(self._seconds - self.spent, 0.0)

    def fraction(self, share: float) -> TimeBudget:
        """Return an allowance for a share of what is left."""
        return TimeBudget(share * self.left, timer=self._timer)


class WorkRate:
    """What a unit of a kind of work takes, learnt from what it took.

    Parameters
    ----------
    unit
        Seconds that a unit is expected to take at first.
    """

    def __init__(self, unit: float) -> None:
        self.unit = unit
        self._quickest = unit
        self._most = 0.0

    def steps_within(self, allowance: TimeBudget, *, step: int = 1) -> int:
        """Return how many steps of so many units are expected to fit into what is left, 0 if none.

        Where none does though there is as much time as there ever was, the next answer is more hopeful: one
        slow moment of the machine must not stop the work for ever.
        """
        left = allowance.left
        self._most = max(left, _FORGETS * self._most)
        steps = max(int((left - _LAUNCH) / (self.unit * step)), 0)
        if not steps and left > max(2.0 * _LAUNCH, _AS_MUCH * self._most):
            self.unit = max(_HOPE * self.unit, self._quickest)
        return steps

    def record(self, units: int, seconds: float) -> None:
        """Learn from a piece of work."""
        unit = max(seconds - _LAUNCH, 0.1 * seconds, 1e-9) / units
        self.unit = unit if unit > self.unit else (1.0 - _SLOWER) * self.unit + _SLOWER * unit
        self._quickest = min(self._quickest, self.unit)
