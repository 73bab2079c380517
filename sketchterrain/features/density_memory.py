"""Densities asked for again after a few features changed: only near those is anything added up anew."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.features.density import DensityField, spread

_WIDER = 1 + 1e-6  # than reach, by more than rounding does


@dataclass(frozen=True, eq=False)
class FeatureSet:
    """Rows of numbers by id.

    Attributes
    ----------
    ids : (n,) uint64
        Sorted, each one once.
    positions : (n, 2) or (n, k, 2) float64
        Metres: of a feature, or of the places that it may take.
    sizes : (n,) float64
        Metres: a feature's weight, or how far each of its places reaches.
    """

    ids: npt.NDArray[np.uint64]
    positions: Float64Array
    sizes: Float64Array

    def same(self, other: FeatureSet) -> tuple[BoolArray, npt.NDArray[np.intp]]:
        """Which rows the other has too, bit for bit, and where; where it has not, any row."""
        if len(other.ids) == 0 or self.positions.shape[1:] != other.positions.shape[1:]:
            return np.zeros(len(self.ids), dtype=np.bool_), np.zeros(len(self.ids), dtype=np.intp)
        row = np.minimum(np.searchsorted(other.ids, self.ids), len(other.ids) - 1)
        equal = (other.ids[row] == self.ids) & (other.sizes[row] == self.sizes)
        axes = tuple(range(1, self.positions.ndim))
        return equal & (other.positions[row] == self.positions).all(axis=axes), row


class DensityCache:
    """Answers like `DensityField.around`, and remembers the last answer; the bits are the same."""

    def __init__(self) -> None:
        self._last: tuple[FeatureSet, FeatureSet, Float64Array] | None = None

    def around(self, features: FeatureSet, asked: FeatureSet) -> Float64Array:
        """Sum of the features' sizes around places, each weighted by the cubic kernel.

        Parameters
        ----------
        features : FeatureSet
            Positions (n, 2) and sizes.
        asked : FeatureSet
            Groups of places, (m, k, 2), and the distance at which a feature no longer counts.

        Returns
        -------
        (m, k) float64, in the unit of the sizes.
        """
        count = asked.positions.shape[1]
        result, anew = np.zeros((len(asked.ids), count)), np.ones(len(asked.ids), dtype=np.bool_)
        last = self._last  # read once: another thread may replace it
        if last is not None:
            features_then, asked_then, answers = last
            known, row = asked.same(asked_then)
            result[known] = answers[row[known]]
            anew = ~known | _near_changes(features_then, features, asked)
        places, reach = asked.positions[anew], asked.sizes[anew]
        if len(places):
            near = _in_box(features.positions, places, float(reach.max()))
            field = DensityField(features.positions[near], features.sizes[near])
            result[anew] = field.around(places, reach)
        self._last = (features, asked, result)
        return result


def _near_changes(before: FeatureSet, after: FeatureSet, asked: FeatureSet) -> BoolArray:
    """Which groups of places anything that came or went may have to do with."""
    changed = np.concatenate(
        [one.positions[~one.same(other)[0]] for one, other in ((before, after), (after, before))]
    )
    if len(changed) == 0 or len(asked.ids) == 0:
        return np.zeros(len(asked.ids), dtype=np.bool_)
    reach = (asked.sizes + spread(asked.positions)) * _WIDER
    distance, _ = cKDTree(changed).query(
        asked.positions[:, 0], distance_upper_bound=float(reach.max()) * _WIDER
    )
    return np.asarray(distance <= reach)


def _in_box(positions: Float64Array, places: Float64Array, reach: float) -> BoolArray:
    """Which positions lie in the rectangle around all places, widened by their reach."""
    every = places.reshape(-1, 2)
    low, high = every.min(axis=0) - reach * _WIDER, every.max(axis=0) + reach * _WIDER
    return np.asarray(((low <= positions) & (positions <= high)).all(axis=1))
