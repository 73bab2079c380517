"""Time budgets of frames, work estimates, statistics."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

_OVERHEAD: Final = 0.0004  # s of any piece of work, however small
_SMOOTHING: Final = 0.3  # weight of one fast measurement; a slow one replaces the estimate at once
_OPTIMISM: Final = 0.9  # factor of the estimate after a refusal with (almost) the whole budget left
_WHOLE_BUDGET: Final = 0.8  # share of the largest recent budget that counts as all of it
_BUDGET_DECAY: Final = 0.95  # factor of the largest recent budget from query to query: budgets may shrink


class TimeBudget:
    """Seconds that remain of a frame's budget, counted from construction."""

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
        """Remaining seconds, at least 0."""
        return max(self._seconds - self.spent, 0.0)

    def fraction(self, share: float) -> TimeBudget:
        """Return a budget of a share of the remaining time."""
        return TimeBudget(share * self.left, timer=self._timer)


class WorkRate:
    """Estimated seconds per unit of one kind of work, updated from measurements."""

    def __init__(self, unit: float) -> None:
        self.unit = unit
        self._fastest = unit
        self._largest_budget = 0.0

    def steps_within(self, budget: TimeBudget, *, step: int = 1) -> int:
        """Return the number of steps of `step` units expected to fit into the remaining time.

        If none fits although the budget is as large as it gets, the estimate is lowered: one slow measurement
        must not stop the work for ever.
        """
        left = budget.left
        self._largest_budget = max(left, _BUDGET_DECAY * self._largest_budget)
        steps = max(int((left - _OVERHEAD) / (self.unit * step)), 0)
        if not steps and left > max(2.0 * _OVERHEAD, _WHOLE_BUDGET * self._largest_budget):
            self.unit = max(_OPTIMISM * self.unit, self._fastest)
        return steps

    def record(self, units: int, seconds: float) -> None:
        """Update the estimate from a measured piece of work."""
        unit = max(seconds - _OVERHEAD, 0.1 * seconds, 1e-9) / units
        self.unit = unit if unit > self.unit else (1.0 - _SMOOTHING) * self.unit + _SMOOTHING * unit
        self._fastest = min(self._fastest, self.unit)

    def run(self, budget: TimeBudget, work: Callable[[int], object], *, count: int, step: int = 1) -> int:
        """Execute up to `count` steps (of `step` units) within the budget; return their number."""
        steps = min(self.steps_within(budget, step=step), count)
        if steps:
            before = budget.spent
            work(steps)
            self.record(steps * step, budget.spent - before)
        return steps


@dataclass(frozen=True)
class FrameStats:
    """Statistics of one frame of a moving picture."""

    generation_seconds: float  # for new tiles, including waiting for the device
    light_seconds: float  # for parts of the light maps
    plant_seconds: float  # for plants and their shadow maps
    draw_seconds: float
    tiles_generated: int
    tiles_drawn: int
    resident_tiles: int
    triangles: int  # of terrain and plants
    size: tuple[int, int]  # of the internal picture (px); smaller than the framebuffer during motion
    converged: bool  # the picture is final: nothing is missing, only water and plants move


@dataclass(frozen=True)
class StreamStats:
    """Statistics of the tiles of one frame."""

    generation_seconds: float  # including waiting for the device
    tiles_generated: int
    tiles_drawn: int
    triangles: int
    resident_tiles: int
    converged: bool  # no tile is missing or morphing
    jumped: bool  # the eye jumped, and the frame got a larger budget


@dataclass(frozen=True)
class TerrainUpdateStats:
    """Cost of replacing the terrain of a renderer or tile stream."""

    tile_seconds: float  # until visible tiles held the new heights, including waiting for the device
    seconds: float  # of all work before the next frame
    tiles_rewritten: int
    tiles_dropped: int
