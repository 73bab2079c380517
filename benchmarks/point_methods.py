"""Poisson-disk methods with one interface, and the fill, free area and spectrum of their points.

Spectra after Ulichney: the periodogram of a set in a square of 64 distances is
``P(f) = |Σ exp(-2πi f·p)|² / n``, 1 on average for random points. It is evaluated at whole numbers of waves
along the square's side, where the transform of the square itself is zero: the mean density leaks into no
frequency and no taper is needed. A ring is one wave of the square wide (1/64): the mean of P over the angle
is the radial power, the variance over the angle by the squared mean the anisotropy. A mean of M sets varies
by 1/M, -13.0 dB for twenty, which is the lower limit (Lagae & Dutré 2008, "A comparison of methods for
generating Poisson disk distributions"). A band is 0.125 wide, from 0.25 to 4 waves a distance, the mean of at
least 400 frequencies; the worst of thirty bands is up to 0.7 dB above the limit for ideal points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.baselines import points as bridson
from sketchterrain.benchmarks.baselines.noise import Absent
from sketchterrain.benchmarks.baselines.points import PhaseGroups
from sketchterrain.benchmarks.poisson_disk import PoissonDisk
from sketchterrain.benchmarks.timing import Lap, TimedContext
from sketchterrain.vegetation.poisson_grids import GREATEST_DENSITY

if TYPE_CHECKING:
    Points = npt.NDArray[np.float64]

SIDE = 64
"""Of the square, in distances."""
LOWEST, HIGHEST = 0.25, 4.0
"""Waves a distance between which bands are judged."""

_BAND = 0.125
_MOST = int(HIGHEST * SIDE)


@dataclass(frozen=True, eq=False)
class Spectrum:
    """What the periodograms of some sets have in common."""

    plane: Float64Array
    frequency: Float64Array
    power: Float64Array
    anisotropy: Float64Array
    weight: Float64Array
    points: float

    def bands(self) -> tuple[Float64Array, Float64Array, Float64Array]:
        """Return the bands' middles (waves a distance), mean powers, and anisotropies in dB."""
        edges = np.arange(LOWEST, HIGHEST + 0.5 * _BAND, _BAND)
        band = np.digitize(self.frequency, edges) - 1
        inside = (band >= 0) & (band < len(edges) - 1)
        weight = np.bincount(band[inside], self.weight[inside])
        power = np.bincount(band[inside], (self.weight * self.power)[inside]) / weight
        spread = np.bincount(band[inside], (self.weight * self.anisotropy)[inside]) / weight
        return edges[:-1] + 0.5 * _BAND, power, 10.0 * np.log10(spread)

    @property
    def worst(self) -> float:
        """The worst band's anisotropy, dB."""
        return float(self.bands()[2].max())

    @property
    def worst_frequency(self) -> float:
        """Where the worst band is, waves a distance."""
        middle, _, anisotropy = self.bands()
        return float(middle[np.argmax(anisotropy)])

    def power_difference(self, other: Spectrum) -> float:
        """Return the largest difference of the bands' powers; 1 is the power of points by chance."""
        return float(np.abs(self.bands()[1] - other.bands()[1]).max())


def spectrum_of(sets: Iterable[npt.ArrayLike], distance: float = 1.0) -> Spectrum:
    """Measure the spectrum of sets of points."""
    total = np.zeros((_MOST + 1, 2 * _MOST + 1))
    counts = []
    for points in sets:
        place = np.asarray(points, np.float64) / (distance * SIDE)
        place = place[((place >= 0.0) & (place < 1.0)).all(axis=1)]
        # float32 is exact enough once whole waves are taken off in float64.
        total += np.abs(_waves(place[:, 1], 0).T @ _waves(place[:, 0], -_MOST)) ** 2 / len(place)
        counts.append(len(place))
    half = total / len(counts)
    plane = np.concatenate([half[:0:-1, ::-1], half])
    plane[_MOST, _MOST] = 0.0
    return Spectrum(plane, *_rings(half), float(np.mean(counts)))


def _waves(place: Float64Array, first: int) -> npt.NDArray[np.complex64]:
    """Return exp(2πi f p) for every place, and every whole frequency from the first one on."""
    phase = place[:, None] * np.arange(first, _MOST + 1)
    return np.exp(np.float32(2.0 * np.pi) * 1j * (phase % 1.0).astype(np.float32)).astype(np.complex64)


def _rings(half: Float64Array) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return frequency, mean power, anisotropy and number of frequencies of each ring."""
    row, column = np.mgrid[0 : _MOST + 1, -_MOST : _MOST + 1]
    ring = np.rint(np.hypot(row, column)).astype(np.int64)
    once = (ring > 1) & (ring <= _MOST) & ((row > 0) | (column > 0))
    ring, power = ring[once] - 2, half[once]
    weight = np.bincount(ring).astype(np.float64)
    mean = np.bincount(ring, power) / weight
    variance = np.bincount(ring, (power - mean[ring]) ** 2) / (weight - 1.0)
    return (np.arange(len(weight)) + 2.0) / SIDE, mean, variance / mean**2, weight


OURS, THESIS = "this program", "the thesis's way"
TURNS = f"{THESIS}, a dart a turn"
_RADIUS = 1 << 14  # lattice units; the points' number, not their distance in metres, is what costs
_BORDER = 2.0  # distances; nearer to a square's border points lie denser, for none stand beyond it


@dataclass(frozen=True)
class ScatterMethod:
    """A way to scatter points over a square."""

    name: str
    trials: int
    side: float
    run: Callable[[int], tuple[Lap, Points]]

    def lap(self) -> Lap:
        """Scatter the points of seed 0 once."""
        return self.run(0)[0]


def own(context: TimedContext, side: float, trials: int) -> ScatterMethod:
    """Return this program's way, from call to array; each seed's buffers are kept from call to call."""
    area = (0, 0, round(side * _RADIUS), round(side * _RADIUS))

    @cache
    def world(seed: int) -> PoissonDisk:
        return PoissonDisk(context, _RADIUS, seed=seed, trials=trials)

    def run(seed: int) -> tuple[Lap, Points]:
        found: list[npt.NDArray[np.int64]] = []
        taken = context.lap(lambda: found.append(world(seed).within(area).position))
        return taken, found[0] / _RADIUS

    return ScatterMethod(OURS, trials, side, run)


def thesis(context: TimedContext, side: float, trials: int, *, turns: bool = False) -> ScatterMethod:
    """Return the thesis's way, from launch to array; with `turns` a dart of a cell a turn of the groups."""
    groups = PhaseGroups(context, side, 1.0, trials, rounds=turns)

    def run(seed: int) -> tuple[Lap, Points]:
        found: list[npt.NDArray[np.float32]] = []
        taken = context.lap(lambda: found.append(groups.points(seed)))
        return taken, found[0].astype(np.float64)

    return ScatterMethod(TURNS if turns else THESIS, trials, side, run)


def peers(
    side: float, trials: Sequence[int], *, scipy_side: float | None = None
) -> tuple[list[ScatterMethod], list[Absent]]:
    """Return the libraries that are on this machine, and those that are not."""
    methods: list[ScatterMethod] = []
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
            methods += [ScatterMethod(made.name, k, wide, partial(made.scatter, wide, k)) for k in ladder]
    return methods, absent


def fill_of(points: Points, side: float) -> float:
    """Return the density of points away from the border, as a share of that of a maximal set."""
    inside = ((points >= _BORDER) & (points < side - _BORDER)).all(axis=1)
    return float(inside.sum() / (GREATEST_DENSITY * (side - 2.0 * _BORDER) ** 2))


def room_of(points: Points, side: float, *, places: int, seed: int) -> float:
    """Return the share of the ground, away from the border, where another point would fit."""
    drawn = np.random.default_rng(seed).random((places, 2)) * (side - 2.0 * _BORDER) + _BORDER
    away, _ = cKDTree(points).query(drawn, distance_upper_bound=1.0)
    return float(np.isinf(away).mean())
