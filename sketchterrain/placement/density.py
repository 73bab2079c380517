"""Density metric: distance to painted shapes and the density of placed features."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import numpy.typing as npt
from scipy import ndimage
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.label_layers import LabelImage
from sketchterrain.stages.digests import digest_of

_MAP_RATIO = 64  # pixels per query; with fewer queries a map of distances does not pay


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
        self._queried = 0
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
        self._queried += rows.size
        if self._map is None and self._queried * _MAP_RATIO > self._mask.size and self._mask.any():
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


_distances = LRUCache(8)
"""By the image's digest: a recipe needs those of several layers, and the next one shares most of them."""


def painted_distance(image: LabelImage, pixel_size: float) -> PaintedDistance:
    """Return the distance to the painted pixels of a label image, which must not change."""
    return _distances.get_or_compute(
        (digest_of(image), pixel_size), lambda: PaintedDistance(image > 0, pixel_size)
    )


def _border(mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.bool_]:
    """Return painted pixels with an unpainted row or column neighbour: the nearest to any pixel outside."""
    inner = mask.copy()
    inner[1:] &= mask[:-1]
    inner[:-1] &= mask[1:]
    inner[:, 1:] &= mask[:, :-1]
    inner[:, :-1] &= mask[:, 1:]
    return mask & ~inner


Ints = npt.NDArray[np.intp]

_MARGIN = 1 + 1e-9  # so that rounding drops no pair; an extra one has weight 0


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

    def around(self, positions: Float64Array, radius: Float64Array) -> Float64Array:
        """Return the sum of sizes, weighted by the cubic kernel of `radius` (m,), at positions (m, k, 2).

        Positions of a group, the last k, have one radius.
        """
        count = positions.shape[1]
        # Features beyond a position's own radius count nothing, to the bit: cubic(1) is 0.
        group, feature = self._near(positions[:, 0], radius + spread(positions))
        offset = positions[group] - self._positions[feature][:, None]
        distance = np.sqrt(offset[..., 0] ** 2 + offset[..., 1] ** 2)
        weight = cubic(distance / np.maximum(radius[group], 1e-9)[:, None]) * self._sizes[feature][:, None]
        position_index = group[:, None] * count + np.arange(count)
        total = np.bincount(position_index.ravel(), weight.ravel(), minlength=len(positions) * count)
        return total.astype(np.float64).reshape(len(positions), count)

    def _near(self, at: Float64Array, radius: Float64Array) -> tuple[Ints, Ints]:
        """Return position and feature indices of each pair within the radius, and of some just beyond.

        Sorted by position and feature: the summation order never depends on how the tree was built.
        """
        if self._tree is None or len(at) == 0:
            empty = np.zeros(0, dtype=np.intp)
            return empty, empty
        found = self._tree.query_ball_point(at, radius * _MARGIN, return_sorted=True)
        counts = np.fromiter(map(len, found), dtype=np.intp, count=len(at))
        position = np.repeat(np.arange(len(at)), counts)
        return position, np.fromiter(chain.from_iterable(found), dtype=np.intp, count=int(counts.sum()))


def spread(positions: Float64Array) -> Float64Array:
    """Return the greatest distance (m) of each group's positions, (m, k, 2), from its first one."""
    offset = positions - positions[:, :1]
    return np.asarray(np.sqrt((offset[..., 0] ** 2 + offset[..., 1] ** 2).max(axis=1)))


@dataclass(frozen=True, eq=False)
class FeatureSet:
    """Positions and sizes by id."""

    ids: npt.NDArray[np.uint64]  # (n,) sorted, unique
    positions: Float64Array  # (n, 2) or candidates (n, k, 2), m
    sizes: Float64Array  # (n,) weight of a feature, or radius around each candidate, m
