"""The surface of a set of patches: height, gradient and weight of data at any points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sketchterrain.array_types import Float32Array, Float64Array, Int32Array, Int64Array, UInt8Array
from sketchterrain.elevation.mips import in_threads
from sketchterrain.host.library import host_function

_NO_VALUES = np.zeros((0, 0))
_CHUNK = 4096  # points below which no thread starts


class BoxClasses(NamedTuple):
    """Index of boxes by classes of size, the largest first: lists of those that touch each cell."""

    places: Float64Array  # (classes, 3): west, south and side of the cells
    shapes: Int64Array  # (classes, 3): cells eastward and northward, and the first one's number
    starts: Int64Array
    items: Int64Array  # ascending in each cell

    @classmethod
    def from_boxes(cls, boxes: Float64Array) -> BoxClasses:
        """Return the index of boxes (n, 4): west, south, east, north."""
        side = np.maximum(boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1])
        size = np.ceil(np.log2(np.maximum(side, 1e-300))).astype(np.int64)
        places, shapes, starts, items = [], [], [], []
        cells = listed = 0
        for each in np.unique(size)[::-1]:
            members = np.flatnonzero(size == each)
            mine = boxes[members]
            corner, cell = mine[:, :2].min(axis=0), 2.0 ** float(each)
            span = mine[:, 2:].max(axis=0) - corner
            while np.prod(span / cell + 1.0) > 16 * len(members) + 64:  # few boxes, far apart
                cell *= 2.0
            wide, deep = (int(n) for n in np.floor(span / cell) + 1)
            low = ((mine[:, :2] - corner) // cell).astype(np.int64)
            high = np.minimum(((mine[:, 2:] - corner) // cell).astype(np.int64), [wide - 1, deep - 1])
            across, down = (high - low + 1).T
            count = across * down
            owner = np.repeat(np.arange(len(mine)), count)  # of each pair of a box and a cell that it touches
            nth = np.arange(len(owner)) - np.repeat(np.cumsum(count) - count, count)
            row, column = np.divmod(nth, across[owner])
            key = (low[owner, 1] + row) * wide + low[owner, 0] + column
            order = np.argsort(key, kind="stable")
            places.append((corner[0], corner[1], cell))
            shapes.append((wide, deep, cells))
            starts.append(listed + np.searchsorted(key[order], np.arange(wide * deep)))
            items.append(members[owner[order]])
            cells, listed = cells + wide * deep, listed + len(key)
        starts.append(np.array([listed]))
        return cls(
            np.array(places).reshape(-1, 3),
            np.array(shapes, np.int64).reshape(-1, 3),
            np.concatenate(starts).astype(np.int64),
            np.concatenate(items) if items else np.zeros(0, np.int64),
        )


class Heights(NamedTuple):
    """Values of a surface at n points."""

    height: Float64Array  # m; NaN without data
    east: Float64Array  # slope, m/m
    north: Float64Array
    weight: Float64Array  # of the data: 1 between samples, 0 further than 1.5 samples from them, C²
    patches: Float64Array  # number of those that have a weight
    means: Float64Array  # (k, …) of values of the grids by the weights of their patches; 0 without data


class PatchSlots(NamedTuple):
    """Columns of the n patches of a surface."""

    centre: Float64Array  # (n, 2)
    to_steps: Float64Array  # (n, 2, 6)
    density: Float64Array  # 1 / area of a step, squared, 1/m⁴
    base: Float64Array  # m
    grid: Int32Array  # number of the grid
    coefficients: Float32Array  # (n, 35, 35), m above the base
    mask_of: Int64Array  # index of the mask, -1 where data are all around
    masks: UInt8Array  # (masks, 35, 35)
    rims: Float64Array  # (masks, 5): sides of the grid as `Patches.rim`, and 2^level


class PatchSurface:
    """Mean of patches by C² weights (Rocca et al. 2012, equation 1).

    The weights are flat in the middle and fall over the four steps that neighbours share, where both sum to
    that of one: a coarse patch that overlaps fine ones has the same small share everywhere, that of the
    squares of their densities. With the paper's (Wendland 1995, of the same volume) it would prevail where
    fine kernels meet. Weights are summed by size and then by id: the
    same bits in whatever order grids were added.
    """

    def __init__(self, slots: PatchSlots, reach: Float64Array) -> None:
        self._slots = PatchSlots(*map(np.ascontiguousarray, slots))
        self._index = BoxClasses.from_boxes(reach)

    def __len__(self) -> int:
        return len(self._slots.centre)

    def evaluate(self, x: Float64Array, y: Float64Array, values: Float64Array = _NO_VALUES) -> Heights:
        """Return heights, slopes and weights of data at points (m) of one shape, from its corner.

        Values (grids, k) have means there.

        The height and its first two derivatives are continuous where the weight is not 0.
        """
        east, north = np.ascontiguousarray(x, np.float64).ravel(), np.ascontiguousarray(y, np.float64).ravel()
        found, means = np.empty((5, len(east))), np.empty((values.shape[1], len(east)))
        fixed = east, north, *self._slots, *self._index, np.ascontiguousarray(values), *found, means
        in_threads(lambda *part: host_function("evaluate_surface")(*fixed, *part), len(east), _CHUNK)
        shape = np.shape(x)
        height, along, across, weight, patches = found.reshape(5, *shape)
        return Heights(height, along, across, weight, patches, means.reshape(len(means), *shape))
