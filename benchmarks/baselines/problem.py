"""The noise that every baseline computes: octaves as plain arrays, and how rows are shared by threads."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

_BANDS = 4  # a thread: where one is held up, the others do more


@dataclass(frozen=True, eq=False)
class NoiseProblem:
    """fBm on a square grid, as ``bench_fbm`` in ``kernels/bench.cl`` sums it."""

    corner: npt.NDArray[np.uint32]
    turned: npt.NDArray[np.uint32]
    amplitude: npt.NDArray[np.float32]
    side: int
    threads: int


@dataclass(frozen=True)
class Rival:
    """A way to compute the problem: its name with version, its threads, and the work of one lap."""

    name: str
    threads: int
    run: Callable[[], npt.NDArray[np.float32]]


@dataclass(frozen=True)
class Absent:
    """A rival that is not on this machine, and how to get it."""

    name: str
    reason: str


def in_threads(rows: Callable[[int, int], object], *, side: int, threads: int) -> None:
    """Call ``rows(first, last)`` for bands of rows, four a thread; threads are kept for the next call."""
    bands = min(_BANDS * threads, side)
    bounds = [side * i // bands for i in range(bands + 1)]
    list(_pool(threads).map(rows, bounds[:-1], bounds[1:]))


@cache
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads)
