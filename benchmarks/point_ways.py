"""Ways to scatter points, all asked alike; how full they fill the ground and what room they leave."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.benchmarks.baselines import bridson
from sketchterrain.benchmarks.baselines.phase_groups import PhaseGroups
from sketchterrain.benchmarks.baselines.problem import Absent
from sketchterrain.benchmarks.poisson_disk import PoissonDisk
from sketchterrain.benchmarks.timing import Lap, TimedContext
from sketchterrain.vegetation.graded_poisson import GREATEST_DENSITY

if TYPE_CHECKING:
    Points = npt.NDArray[np.float64]

__all__ = ["OURS", "THESIS", "TURNS", "Way", "fill_of", "own", "peers", "room_of", "thesis"]

OURS, THESIS = "this program", "the thesis's way"
TURNS = f"{THESIS}, a dart a turn"
_RADIUS = 1 << 14  # lattice units; the points' number, not their distance in metres, is what costs
_BORDER = 2.0  # distances; nearer to a square's border points lie denser, for none stand beyond it


@dataclass(frozen=True)
class Way:
    """A way to scatter points over a square."""

    name: str
    trials: int
    side: float
    run: Callable[[int], tuple[Lap, Points]]

    def lap(self) -> Lap:
        """Scatter the points of seed 0 once."""
        return self.run(0)[0]


def own(context: TimedContext, side: float, trials: int) -> Way:
    """Return this program's way, from call to array; each seed's buffers are kept from call to call."""
    area = (0, 0, round(side * _RADIUS), round(side * _RADIUS))

    @cache
    def world(seed: int) -> PoissonDisk:
        return PoissonDisk(context, _RADIUS, seed=seed, trials=trials)

    def run(seed: int) -> tuple[Lap, Points]:
        found: list[npt.NDArray[np.int64]] = []
        taken = context.lap(lambda: found.append(world(seed).within(area).position))
        return taken, found[0] / _RADIUS

    return Way(OURS, trials, side, run)


def thesis(context: TimedContext, side: float, trials: int, *, turns: bool = False) -> Way:
    """Return the thesis's way, from launch to array; with `turns` a dart of a cell a turn of the groups."""
    groups = PhaseGroups(context, side, 1.0, trials, rounds=turns)

    def run(seed: int) -> tuple[Lap, Points]:
        found: list[npt.NDArray[np.float32]] = []
        taken = context.lap(lambda: found.append(groups.points(seed)))
        return taken, found[0].astype(np.float64)

    return Way(TURNS if turns else THESIS, trials, side, run)


def peers(
    side: float, trials: Sequence[int], *, scipy_side: float | None = None
) -> tuple[list[Way], list[Absent]]:
    """Return the libraries that are on this machine, and those that are not."""
    ways: list[Way] = []
    absent: list[Absent] = []
    for made, wide, ladder in (
        (bridson.in_numba(), side, trials),
        (bridson.in_rust(), side, trials),
        (bridson.in_node(), side, trials[:1]),
        (bridson.in_scipy(), scipy_side, trials[-1:]),
    ):
        if isinstance(made, Absent):
            absent.append(made)
        elif wide is not None:
            ways += [Way(made.name, k, wide, partial(made.scatter, wide, k)) for k in ladder]
    return ways, absent


def fill_of(points: Points, side: float) -> float:
    """Return the density of points away from the border, as a share of that of a maximal set."""
    inside = ((points >= _BORDER) & (points < side - _BORDER)).all(axis=1)
    return float(inside.sum() / (GREATEST_DENSITY * (side - 2.0 * _BORDER) ** 2))


def room_of(points: Points, side: float, *, places: int, seed: int) -> float:
    """Return the share of the ground, away from the border, where another point would fit."""
    drawn = np.random.default_rng(seed).random((places, 2)) * (side - 2.0 * _BORDER) + _BORDER
    away, _ = cKDTree(points).query(drawn, distance_upper_bound=1.0)
    return float(np.isinf(away).mean())
