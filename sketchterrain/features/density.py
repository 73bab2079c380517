"""The density metric of Zaaijer 2013 §4.4: how much of something stands around a position."""

from __future__ import annotations

from itertools import chain

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array

Ints = npt.NDArray[np.intp]

_WIDER = 1 + 1e-9  # so that rounding leaves out no pair; one too many counts nothing


def cubic(t: Float64Array) -> Float64Array:
    """2t³ - 3t² + 1 for t in [0, 1], 0 beyond: one at the centre, flat at both ends."""
    t = np.clip(t, 0.0, 1.0)
    return (2.0 * t - 3.0) * t * t + 1.0


class DensityField:
    """Features as a field of density.

    Parameters
    ----------
    positions : (n, 2) float64
        Metres.
    sizes : (n,) float64
        Weight of each feature, usually its radius in metres.
    """

    def __init__(self, positions: Float64Array, sizes: Float64Array) -> None:
        self._positions = positions
        self._sizes = sizes
        self._tree = cKDTree(positions) if len(positions) else None

    def total(self, at: Float64Array, radius: Float64Array) -> Float64Array:
        """Sum of the features' sizes around positions, each weighted by the cubic kernel.

        Parameters
        ----------
        at : (m, 2) float64
            Positions (m).
        radius : (m,) float64
            Distance (m) at which a feature no longer counts.

        Returns
        -------
        (m,) float64, in the unit of the sizes.
        """
        position, feature, weight = self._pairs(at, radius)
        return np.bincount(position, weight * self._sizes[feature], minlength=len(at)).astype(np.float64)

    def mean(
        self, values: Float64Array, at: Float64Array, radius: Float64Array, *, default: float = 0.0
    ) -> Float64Array:
        """Mean of a property of the features around positions, weighted like `total`.

        Parameters
        ----------
        values : (n,) float64
            The property, one value a feature.
        at, radius
            As in `total`.
        default : float
            Where there is no feature within the radius.
        """
        position, feature, weight = self._pairs(at, radius)
        weight = weight * self._sizes[feature]
        total = np.bincount(position, weight, minlength=len(at))
        mean = np.bincount(position, weight * values[feature], minlength=len(at))
        return np.where(total > 0.0, mean / np.where(total > 0.0, total, 1.0), default)

    def around(self, places: Float64Array, radius: Float64Array) -> Float64Array:
        """Like `total`, for groups of places that are close together.

        Parameters
        ----------
        places : (m, k, 2) float64
            Positions (m), k in each group.
        radius : (m,) float64
            As in `total`, one for each group.

        Returns
        -------
        (m, k) float64, the very numbers that `total` gives.
        """
        count = places.shape[1]
        # Features beyond a place's own radius count nothing, to the bit: cubic(1) is 0.
        group, feature = self._near(places[:, 0], radius + spread(places))
        offset = places[group] - self._positions[feature][:, None]
        distance = np.sqrt(offset[..., 0] ** 2 + offset[..., 1] ** 2)
        weight = cubic(distance / np.maximum(radius[group], 1e-9)[:, None]) * self._sizes[feature][:, None]
        place = group[:, None] * count + np.arange(count)
        total = np.bincount(place.ravel(), weight.ravel(), minlength=len(places) * count)
        return total.astype(np.float64).reshape(len(places), count)

    def _pairs(self, at: Float64Array, radius: Float64Array) -> tuple[Ints, Ints, Float64Array]:
        """Index of the position, index of the feature and kernel weight of each pair within reach."""
        position, feature = self._near(at, radius)
        offset = at[position] - self._positions[feature]
        distance = np.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2)
        return position, feature, cubic(distance / np.maximum(radius[position], 1e-9))

    def _near(self, at: Float64Array, radius: Float64Array) -> tuple[Ints, Ints]:
        """Index of the position and of the feature of each pair within reach, and of some just beyond.

        Sorted by position and feature: the order of adding up never depends on how the tree was built.
        """
        if self._tree is None or len(at) == 0:
            none = np.zeros(0, dtype=np.intp)
            return none, none
        found = self._tree.query_ball_point(at, radius * _WIDER, return_sorted=True)
        counts = np.fromiter(map(len, found), dtype=np.intp, count=len(at))
        position = np.repeat(np.arange(len(at)), counts)
        return position, np.fromiter(chain.from_iterable(found), dtype=np.intp, count=int(counts.sum()))


def spread(places: Float64Array) -> Float64Array:
    """Return how far (m) the places of each group, (m, k, 2), lie from its first one, at most."""
    offset = places - places[:, :1]
    return np.asarray(np.sqrt((offset[..., 0] ** 2 + offset[..., 1] ** 2).max(axis=1)))
