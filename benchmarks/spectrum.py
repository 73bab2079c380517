"""The spectrum of a way to scatter points: power and anisotropy by frequency, after Ulichney.

Twenty sets of points that are at least 1 apart, each in a square of 64 by 64. The periodogram of a set is
``P(f) = |Σ exp(-2πi f·p)|² / n``: 1 on average for points that know nothing of each other. It is taken at
whole numbers of waves along the square's side, where the transform of the square itself is exactly zero: the
mean density leaks into no frequency, so that no taper is needed, and only f = 0 is left out. Each point of
the spectrum has its half: one of f and -f.

A ring is one wave of the square wide (1/64); within it the mean of P over the angle is the radial power, the
variance over the angle by the mean squared the anisotropy. A mean of M sets spreads by 1/M by chance alone,
-13.0 dB for twenty: that is the best there is (Lagae & Dutré 2008, "A comparison of methods for generating
Poisson disk distributions"). A band is 0.125 wide, from 0.25 to 4 waves a distance: the mean of its rings,
by their frequencies. Even the smallest holds 400 frequencies, so that chance moves it by 0.3 dB; the worst of
thirty bands is up to 0.7 dB above the ideal where nothing is wrong.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array

__all__ = ["HIGHEST", "LOWEST", "SETS", "SIDE", "Spectrum", "spectrum_of"]

SIDE = 64
"""Of the square, in distances."""
SETS = 20
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
