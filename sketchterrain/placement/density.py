"""Density metric: distance to painted shapes and the density of placed features."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array

_FEW = 64  # pixels for each place asked about: for fewer places than so a map of distances does not pay


class PaintedDistance:
    """Distance (m) to the nearest painted pixel of a mask (row 0 north).

    Exact at pixel centres inside the sketch, elsewhere taken from the pixel's centre. Beyond the edge it is
    √(outside² + inside²) via the nearest point of the sketch, which is never more than the true distance. The
    first queries use a tree of the painted borders; after many, a map of all distances. Both give the same
    bits.
    """

    def __init__(self, mask: npt.NDArray[np.bool_], pixel_size: float) -> None:
        self._height, self._width = mask.shape
        self._pixel_size = pixel_size
        self._mask = mask
        self._asked = 0
        self._tree: cKDTree | None = None
        self._map: npt.NDArray[np.float32] | None = None

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the distance (m) at positions (m); infinite if nothing is painted, 0 on painted pixels."""
        column = np.asarray(x, dtype=np.float64) / self._pixel_size
        row = self._height - np.asarray(y, dtype=np.float64) / self._pixel_size
        inside_column, inside_row = np.clip(column, 0.0, self._width), np.clip(row, 0.0, self._height)
        columns = np.minimum(inside_column.astype(np.intp), self._width - 1)
        rows = np.minimum(inside_row.astype(np.intp), self._height - 1)
        outside = np.hypot(column - inside_column, row - inside_row) * self._pixel_size
        return np.asarray(np.hypot(outside, self._pixels(rows, columns) * np.float32(self._pixel_size)))

    def _pixels(self, rows: npt.NDArray[np.intp], columns: npt.NDArray[np.intp]) -> npt.NDArray[np.float32]:
        """Return the distance in pixels from a pixel's centre to that of the nearest painted one."""
        self._asked += rows.size
        if self._map is None and self._asked * _FEW > self._mask.size and self._mask.any():
            distance = np.asarray(ndimage.distance_transform_edt(~self._mask), dtype=np.float32)
            self._map = distance
        if self._map is not None:
            return np.asarray(self._map[rows, columns])
        if self._tree is None:
            self._tree = cKDTree(np.argwhere(_border(self._mask)))
        result = np.zeros(rows.shape, dtype=np.float32)
        bare = ~self._mask[rows, columns]
        result[bare] = self._tree.query(np.stack([rows[bare], columns[bare]], axis=-1))[0]
        return result


def _border(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return painted pixels with an unpainted row or column neighbour: the nearest to any pixel outside."""
    inner = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    return mask & ~inner


Ints = npt.NDArray[np.intp]

_WIDER = 1 + 1e-9  # so that rounding leaves out no pair; one too many counts nothing


def cubic(t: Float64Array) -> Float64Array:
    """2t³ - 3t² + 1 for t in [0, 1], 0 beyond."""
    t = np.clip(t, 0.0, 1.0)
    return (2.0 * t - 3.0) * t * t + 1.0


class DensityField:
    """Density of features at `positions` (n, 2), m, weighted by `sizes` (n,), usually radii (m)."""

    def __init__(self, positions: Float64Array, sizes: Float64Array) -> None:
        self._positions = positions
        self._sizes = sizes
        self._tree = cKDTree(positions) if len(positions) else None

    def total(self, at: Float64Array, radius: Float64Array) -> Float64Array:
        """Return the sum of sizes, weighted by the cubic kernel of `radius` (m,), around positions (m, 2)."""
        position, feature, weight = self._pairs(at, radius)
        return np.bincount(position, weight * self._sizes[feature], minlength=len(at)).astype(np.float64)

    def mean(
        self, values: Float64Array, at: Float64Array, radius: Float64Array, *, default: float = 0.0
    ) -> Float64Array:
        """Return the mean of a property, weighted like `total`; `default` if no feature is in range."""
        position, feature, weight = self._pairs(at, radius)
        weight = weight * self._sizes[feature]
        total = np.bincount(position, weight, minlength=len(at))
        mean = np.bincount(position, weight * values[feature], minlength=len(at))
        return np.where(total > 0.0, mean / np.where(total > 0.0, total, 1.0), default)

    def around(self, places: Float64Array, radius: Float64Array) -> Float64Array:
        """Return `total`, bit for bit, (m, k), for groups (m, k, 2) of positions with one radius each."""
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
        """Return position index, feature index and kernel weight of each pair within the radius."""
        position, feature = self._near(at, radius)
        offset = at[position] - self._positions[feature]
        distance = np.sqrt(offset[:, 0] ** 2 + offset[:, 1] ** 2)
        return position, feature, cubic(distance / np.maximum(radius[position], 1e-9))

    def _near(self, at: Float64Array, radius: Float64Array) -> tuple[Ints, Ints]:
        """Return position and feature indices of each pair within the radius, and of some just beyond.

        Sorted by position and feature: the summation order never depends on how the tree was built.
        """
        if self._tree is None or len(at) == 0:
            none = np.zeros(0, dtype=np.intp)
            return none, none
        found = self._tree.query_ball_point(at, radius * _WIDER, return_sorted=True)
        counts = np.fromiter(map(len, found), dtype=np.intp, count=len(at))
        position = np.repeat(np.arange(len(at)), counts)
        return position, np.fromiter(chain.from_iterable(found), dtype=np.intp, count=int(counts.sum()))


def spread(places: Float64Array) -> Float64Array:
    """Return the greatest distance (m) of each group's positions, (m, k, 2), from its first one."""
    offset = places - places[:, :1]
    return np.asarray(np.sqrt((offset[..., 0] ** 2 + offset[..., 1] ** 2).max(axis=1)))


_DENSITY_MEMORY_WIDER = 1 + 1e-6  # than reach, by more than rounding does


@dataclass(frozen=True, eq=False)
class FeatureSet:
    """Positions and sizes by id."""

    ids: npt.NDArray[np.uint64]  # (n,) sorted, unique
    positions: Float64Array  # (n, 2) or candidates (n, k, 2), m
    sizes: Float64Array  # (n,) weight of a feature, or radius around each candidate, m

    def same(self, other: FeatureSet) -> tuple[BoolArray, npt.NDArray[np.intp]]:
        """Return which rows the other set has too, bit for bit, and their indices (arbitrary where not)."""
        if len(other.ids) == 0 or self.positions.shape[1:] != other.positions.shape[1:]:
            return np.zeros(len(self.ids), dtype=np.bool_), np.zeros(len(self.ids), dtype=np.intp)
        row = np.minimum(np.searchsorted(other.ids, self.ids), len(other.ids) - 1)
        equal = (other.ids[row] == self.ids) & (other.sizes[row] == self.sizes)
        axes = tuple(range(1, self.positions.ndim))
        return equal & (other.positions[row] == self.positions).all(axis=axes), row


class DensityCache:
    """Bit-equal `DensityField.around` that recomputes only the neighbourhoods of changed features."""

    def __init__(self) -> None:
        self._last: tuple[FeatureSet, FeatureSet, Float64Array] | None = None

    def around(self, features: FeatureSet, asked: FeatureSet) -> Float64Array:
        """Return the density of `features` at groups of positions `asked`, (m, k), in units of the sizes."""
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
    """Return which groups of positions an added or removed feature may affect."""
    changed = np.concatenate(
        [one.positions[~one.same(other)[0]] for one, other in ((before, after), (after, before))]
    )
    if len(changed) == 0 or len(asked.ids) == 0:
        return np.zeros(len(asked.ids), dtype=np.bool_)
    reach = (asked.sizes + spread(asked.positions)) * _DENSITY_MEMORY_WIDER
    distance, _ = cKDTree(changed).query(
        asked.positions[:, 0], distance_upper_bound=float(reach.max()) * _DENSITY_MEMORY_WIDER
    )
    return np.asarray(distance <= reach)


def _in_box(positions: Float64Array, places: Float64Array, reach: float) -> BoolArray:
    """Return which positions lie in the rectangle around all `places`, widened by `reach`."""
    every = places.reshape(-1, 2)
    low, high = (
        every.min(axis=0) - reach * _DENSITY_MEMORY_WIDER,
        every.max(axis=0) + reach * _DENSITY_MEMORY_WIDER,
    )
    return np.asarray(((low <= positions) & (positions <= high)).all(axis=1))
