"""How long a batch will still take, by what its terrains took: honest, so nothing while nothing is known."""

from __future__ import annotations

import time
from collections import defaultdict
from statistics import median
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterable

__all__ = ["Remaining", "duration"]

_RECENT = 25  # of a kind: machines get busier and idle again


class Remaining:
    """Estimates the time that is left.

    Each terrain still to come takes the median of those of its kind; where none of its kind is done yet, of
    all. Several are in work at once: how much of each other's time they share is measured, too.

    Parameters
    ----------
    timer
        Seconds that run on.
    """

    def __init__(self, timer: Callable[[], float] = time.perf_counter) -> None:
        self._timer = timer
        self._start = timer()
        self._took: dict[Hashable, list[float]] = defaultdict(list)
        self._sum = 0.0

    def finished(self, kind: Hashable, seconds: float) -> None:
        """Tell that a terrain of a kind was in work for so long."""
        self._took[kind].append(seconds)
        self._sum += seconds

    def seconds(self, kinds: Iterable[Hashable]) -> float | None:
        """Return about how long terrains of kinds will take; None before the first one is done."""
        if not self._took:
            return None
        usual = {kind: median(took[-_RECENT:]) for kind, took in self._took.items()}
        any_kind = median([each for took in self._took.values() for each in took[-_RECENT:]])
        share = min((self._timer() - self._start) / max(self._sum, 1e-9), 1.0)
        return share * sum(usual.get(kind, any_kind) for kind in kinds)


def duration(seconds: float) -> str:
    """Return seconds as a person says them: ``40 s``, ``12 min``, ``3 h 20 min``."""
    if seconds < 90:
        return f"{max(round(seconds), 1)} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
