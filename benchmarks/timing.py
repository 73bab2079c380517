"""Timing: laps of work, in rounds that alternate between the methods compared."""

import json
import math
import subprocess
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from time import perf_counter, process_time
from typing import Any, TypeVar

import numpy as np

from sketchterrain.compute.context import ComputeContext
from sketchterrain.io.resources import Defines
from sketchterrain.io.system import module_command

Name = TypeVar("Name")


@dataclass(frozen=True)
class Launch:
    """One launch of a kernel: its work items and its device time by profiling events, in seconds."""

    kernel: str
    items: int
    seconds: float


@dataclass(frozen=True)
class Lap:
    """One piece of work, timed once."""

    wall: float
    launches: tuple[Launch, ...] = ()
    processor: float = 0.0

    @property
    def device(self) -> float:
        """Device seconds of all launches."""
        return sum(launch.seconds for launch in self.launches)


class TimedContext(ComputeContext):
    """A compute context that also remembers each launch, with its work items."""

    def __init__(self, device: str | None = None, *, real: str = "float", fast: bool = False) -> None:
        super().__init__(device, real=real, fast=fast)
        self._launches: list[tuple[str, int, Any]] = []

    def launch(
        self,
        file: str,
        kernel: str,
        size: Sequence[int],
        *arguments: object,
        group: Sequence[int] | None = None,
        defines: Defines = (),
    ) -> Any:
        """Enqueue one kernel; see :meth:`ComputeContext.launch`."""
        event = super().launch(file, kernel, size, *arguments, group=group, defines=defines)
        self._launches.append((kernel, math.prod(size), event))
        return event

    def lap(self, work: Callable[[], object]) -> Lap:
        """Do a piece of work once and time it and its launches."""
        self._launches.clear()
        start = perf_counter()
        work()
        wall = perf_counter() - start
        launches = []
        for kernel, items, event in self._launches:
            self.wait(event, action="profiling")
            launches.append(Launch(kernel, items, (event.profile.end - event.profile.start) * 1e-9))
        return Lap(wall, tuple(launches))


@dataclass(frozen=True)
class Spread:
    """Median and 95th percentile of some times (s), and their number."""

    median: float
    p95: float
    count: int

    def cells(self, count: str = "rounds") -> dict[str, float]:
        """Return a row's cells: the number under the given key, `median_ms` and `p95_ms`."""
        return {count: self.count, "median_ms": self.median * 1e3, "p95_ms": self.p95 * 1e3}


def lap(work: Callable[[], object]) -> Lap:
    """Do a piece of work that needs no device once and time it."""
    start, used = perf_counter(), process_time()
    work()
    return Lap(perf_counter() - start, processor=process_time() - used)


def alternate(
    rivals: Mapping[Name, Callable[[], Lap]], *, rounds: int, quick: float = 0.0, more: int = 0
) -> dict[Name, list[Lap]]:
    """Time methods so that they can be compared: each once to warm up, then in turn, round after round.

    Every second round runs backwards, so that no method always follows the same one; a slowdown of the
    machine then affects all of them. Methods whose lap takes less than `quick` seconds get `more` times as
    many rounds again: short laps are disturbed most, and cost least to repeat.
    """
    for work in rivals.values():
        work()
    laps: dict[Name, list[Lap]] = {name: [] for name in rivals}
    for number in range(rounds):
        turn = list(rivals.items())
        for name, work in reversed(turn) if number % 2 else turn:
            laps[name].append(work())
    short = {name: rivals[name] for name, done in laps.items() if done[0].wall < quick}
    if short and more:
        for name, again in alternate(short, rounds=more * rounds).items():
            laps[name] += again
    return laps


def spread(seconds: Sequence[float]) -> Spread:
    """Return the median and the 95th percentile (linear between samples) of at least one time."""
    median, p95 = np.percentile(np.asarray(seconds, dtype=np.float64), [50, 95])
    return Spread(float(median), float(p95), len(seconds))


def run_program(words: Sequence[str]) -> dict[str, Any]:
    """Run a command of the program in a fresh process and return its report in JSON."""
    done = subprocess.run(module_command("sketchterrain", *words), check=True, capture_output=True)
    report: dict[str, Any] = json.loads(done.stdout)
    return report
