"""Density metric: distance to painted shapes and the density of placed features."""

from __future__ import annotations

from itertools import chain

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.label_layers import LabelImage
from sketchterrain.stages.digests import digest_of


class PaintedDistance:
    """Distance (m) to the nearest painted pixel of a mask (row 0 north).

    Exact at pixel centres inside the sketch, elsewhere taken from the pixel's centre. Beyond the edge it is
    √(outside² + inside²) via the nearest point of the sketch, which is never more than the true distance.
    """

    def __init__(self, mask: npt.NDArray[np.bool_], pixel_size: float) -> None:
        self._mask, self._pixel_size = mask, pixel_size
        self._tree = cKDTree(np.argwhere(_border(mask)))

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return the distance (m) at positions (m); infinite if nothing is painted, 0 on painted pixels."""
        height, width = self._mask.shape
        column = np.asarray(x, dtype=np.float64) / self._pixel_size
        row = height - np.asarray(y, dtype=np.float64) / self._pixel_size
        inside_column, inside_row = np.clip(column, 0.0, width), np.clip(row, 0.0, height)
        columns = np.minimum(inside_column.astype(np.intp), width - 1)
        rows = np.minimum(inside_row.astype(np.intp), height - 1)
        outside = np.hypot(column - inside_column, row - inside_row) * self._pixel_size
        pixels = np.zeros(rows.shape, dtype=np.float32)
        bare = ~self._mask[rows, columns]
        pixels[bare] = self._tree.query(np.stack([rows[bare], columns[bare]], axis=-1))[0]
        return np.asarray(np.hypot(outside, pixels * np.float32(self._pixel_size)))


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


_MARGIN = 1 + 1e-9  # so that rounding drops no pair; an extra one has weight 0


def cubic(t: Float64Array) -> Float64Array:
    """2t³ - 3t² + 1 for t in [0, 1], 0 beyond."""
    t = np.clip(t, 0.0, 1.0)
    return (2.0 * t - 3.0) * t * t + 1.0


def density_around(
    features: Float64Array, sizes: Float64Array, positions: Float64Array, radius: Float64Array
) -> Float64Array:
    """Return the sum of features' sizes, weighted by the cubic kernel of a radius, at positions, (m, k).

    Parameters
    ----------
    features, sizes : (n, 2), m, and (n,) weights, usually radii (m)
    positions, radius : (m, k, 2), m, in groups that have one radius (m,), m
    """
    groups, count = positions.shape[:2]
    if not (len(features) and groups):
        return np.zeros((groups, count))
    # Features beyond a position's own radius count nothing, to the bit: cubic(1) is 0. Sorted, so that the
    # summation order does not depend on how the tree was built.
    spread = np.sqrt(((positions - positions[:, :1]) ** 2).sum(axis=-1).max(axis=1))
    near = cKDTree(features).query_ball_point(
        positions[:, 0], (radius + spread) * _MARGIN, return_sorted=True
    )
    group = np.repeat(np.arange(groups), [len(each) for each in near])
    feature = np.fromiter(chain.from_iterable(near), dtype=np.intp, count=len(group))
    offset = positions[group] - features[feature][:, None]
    distance = np.sqrt(offset[..., 0] ** 2 + offset[..., 1] ** 2)
    weight = cubic(distance / np.maximum(radius[group], 1e-9)[:, None]) * sizes[feature][:, None]
    index = group[:, None] * count + np.arange(count)
    total = np.bincount(index.ravel(), weight.ravel(), minlength=groups * count)
    return total.astype(np.float64).reshape(groups, count)
