"""How long a batch will still take, by what its terrains took: honest, so nothing while nothing is known."""

from __future__ import annotations

import time
from collections import defaultdict
from statistics import median
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Mapping

__all__ = ["Remaining", "duration"]

_RECENT = 25  # of a kind: machines get busier and idle again


class Remaining:
    """Estimates the time that is left.

    Each terrain takes the median of those of its kind; where none of its kind is done yet, of all. Several
    are in work at once: how much of each other's time they share is measured, too.

    Parameters
    ----------
    timer
        Seconds that run on.
    """

    def __init__(self, timer: Callable[[], float] = time.perf_counter) -> None:
        self._timer = timer
        self._start = timer()
        self._began: dict[str, float] = {}
        self._took: dict[Hashable, list[float]] = defaultdict(list)
        self._sum = 0.0

    def begins(self, name: str) -> None:
        """Tell that a terrain is in work from now on; more than once does no harm."""
        self._began.setdefault(name, self._timer())

    def finished(self, name: str, kind: Hashable, seconds: float) -> None:
        """Tell that a terrain of a kind is done, and was in work for so long."""
        self._began.pop(name, None)
        self._took[kind].append(seconds)
        self._sum += seconds

    def failed(self, name: str) -> None:
        """Tell that one failed: how long that took tells nothing of the others."""
        self._sum += self._timer() - self._began.pop(name, self._timer())

    def seconds(self, left: Mapping[str, Hashable]) -> float | None:
        """Return about how long terrains, by name their kinds, will take; None before the first is done."""
        if not self._took:
            return None
        usual = {kind: median(took[-_RECENT:]) for kind, took in self._took.items()}
        any_kind = median([each for took in self._took.values() for each in took[-_RECENT:]])
        now = self._timer()
        spent = {name: now - began for name, began in self._began.items()}
        work = self._sum + sum(spent.values())
        share = min((now - self._start) / max(work, 1e-9), 1.0)
        return share * sum(
            max(usual.get(kind, any_kind) - spent.get(name, 0.0), 0.0) for name, kind in left.items()
        )


def duration(seconds: float) -> str:
    """Return seconds as a person says them: ``40 s``, ``12 min``, ``3 h 20 min``."""
    if seconds < 90:
        return f"{max(round(seconds), 1)} s"
    minutes = round(seconds / 60)
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"
