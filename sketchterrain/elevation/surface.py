"""The surface of a set of patches: height, gradient and weight of data at any points."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from sketchterrain.array_types import Float32Array, Float64Array, Int32Array, Int64Array, UInt8Array
from sketchterrain.elevation.mips import in_threads
from sketchterrain.elevation.patches import KERNEL, MARGIN, WHOLE

_HALF = KERNEL // 2 + MARGIN
_BEYOND = 1.5  # samples beyond a grid's rim where its weight is 0; it is 1 half a sample beyond
_CORNER = 36.0 * WHOLE  # masks are at least 1 over it at samples beside voids; in parts of 1
_NO_VALUES = np.zeros((0, 0))
_CHUNK = 4096  # points below which no thread starts


class BoxIndex(NamedTuple):
    """Index of boxes by classes of size, the largest first: lists of those that touch each cell."""

    places: Float64Array  # (classes, 3): west, south and side of the cells
    shapes: Int64Array  # (classes, 3): cells eastward and northward, and the first one's number
    starts: Int64Array
    items: Int64Array  # ascending in each cell

    @classmethod
    def from_boxes(cls, boxes: Float64Array) -> BoxIndex:
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
        self._slots, self._index = slots, BoxIndex.from_boxes(reach)

    def __len__(self) -> int:
        return len(self._slots.centre)

    def evaluate(self, x: Float64Array, y: Float64Array, values: Float64Array = _NO_VALUES) -> Heights:
        """Return heights, slopes and weights of data at points (m) of one shape, from its corner.

        Values (grids, k) have means there.

        The height and its first two derivatives are continuous where the weight is not 0.
        """
        east, north = np.ascontiguousarray(x, np.float64).ravel(), np.ascontiguousarray(y, np.float64).ravel()
        found, means = np.empty((5, len(east))), np.zeros((values.shape[1], len(east)))
        fixed = east, north, self._slots, self._index, values, found, means
        in_threads(lambda first, last: _evaluate(*fixed, first, last), len(east), _CHUNK)
        shape = np.shape(x)
        height, along, across, weight, patches = found.reshape(5, *shape)
        return Heights(height, along, across, weight, patches, means.reshape(len(means), *shape))


@njit(cache=True, nogil=True, inline="always")
def _steps(m, x, y):  # type: ignore[no-untyped-def]
    """Return steps from the centre and their derivatives by x and y."""
    value = m[0] + m[1] * x + m[2] * y + (m[3] * x + m[4] * y) * x + m[5] * y * y
    return value, m[1] + 2.0 * m[3] * x + m[4] * y, m[2] + m[4] * x + 2.0 * m[5] * y


@njit(cache=True, nogil=True, inline="always")
def _inside(u, low, high, scale):  # type: ignore[no-untyped-def]
    """Return 1 between the sides of a grid, C² down to 0 beyond them, and its derivative."""
    distance, sign = (u - low, scale) if u - low < high - u else (high - u, -scale)
    t = min(max(_BEYOND + scale * distance, 0.0), 1.0)
    return _smooth(t), sign * 30.0 * t * t * (1.0 - t) * (1.0 - t)


@njit(cache=True, nogil=True, inline="always")
def _faded(u, width):  # type: ignore[no-untyped-def]
    """Return 1 in the middle, C² down to 0 over some steps to the border of the patch, and its derivative."""
    t = min((_HALF - abs(u)) / width, 1.0)
    slope = 30.0 * t * t * (1.0 - t) * (1.0 - t) / width
    return _smooth(t), -slope if u > 0.0 else slope


@njit(cache=True, nogil=True, inline="always")
def _smooth(t):  # type: ignore[no-untyped-def]
    """Return a step from 0 at 0 to 1 at 1 and on, C²."""
    t = min(max(t, 0.0), 1.0)
    return t * t * t * (10.0 + t * (6.0 * t - 15.0))


@njit(cache=True, nogil=True, inline="always")
def _taps(t):  # type: ignore[no-untyped-def]
    """Return four weights of a cubic B-spline, times 6, and their derivatives, times 2."""
    s = 1.0 - t
    t2, s2 = t * t, s * s
    return (
        (s2 * s, 4.0 + t2 * (3.0 * t - 6.0), 4.0 + s2 * (3.0 * s - 6.0), t2 * t),
        (-s2, t * (3.0 * t - 4.0), s * (4.0 - 3.0 * s), t2),
    )


@njit(cache=True, nogil=True, inline="always")
def _spline(table, p, i, j, wu, du, wv, dv):  # type: ignore[no-untyped-def]
    """Return a spline's value and derivatives along columns and rows."""
    value = along = across = 0.0
    for r in range(4):
        k = i + r
        c0, c1, c2, c3 = table[p, k, j], table[p, k, j + 1], table[p, k, j + 2], table[p, k, j + 3]
        line = wu[0] * c0 + wu[1] * c1 + wu[2] * c2 + wu[3] * c3
        value += wv[r] * line
        across += dv[r] * line
        along += wv[r] * (du[0] * c0 + du[1] * c1 + du[2] * c2 + du[3] * c3)
    return value / 36.0, along / 12.0, across / 12.0


@njit(cache=True, nogil=True)
def _evaluate(xs, ys, slots, index, values, found, means, first, last):  # type: ignore[no-untyped-def]
    """Evaluate points first … last - 1."""
    centre, to_steps, density, base, grid, coefficients, mask_of, masks, rims = slots
    places, shapes, starts, items = index
    for n in range(first, last):
        total = total_x = total_y = 0.0
        sum_h = sum_x = sum_y = 0.0
        missing, count = 1.0, 0
        for c in range(len(places)):
            column = math.floor((xs[n] - places[c, 0]) / places[c, 2])
            row = math.floor((ys[n] - places[c, 1]) / places[c, 2])
            if not (0 <= column < shapes[c, 0] and 0 <= row < shapes[c, 1]):
                continue
            key = shapes[c, 2] + int(row) * shapes[c, 0] + int(column)
            for k in range(starts[key], starts[key + 1]):
                p = items[k]
                x, y = xs[n] - centre[p, 0], ys[n] - centre[p, 1]
                u, ux, uy = _steps(to_steps[p, 0], x, y)
                v, vx, vy = _steps(to_steps[p, 1], x, y)
                if not (abs(u) < _HALF and abs(v) < _HALF):
                    continue
                i, j = int(v + _HALF), int(u + _HALF)
                wu, du = _taps(u + _HALF - j)
                wv, dv = _taps(v + _HALF - i)
                (a, a1), (b, b1) = _faded(u, 2.0 * MARGIN), _faded(v, 2.0 * MARGIN)
                weight, weight_u, weight_v = a * b, a1 * b, a * b1
                known = 1.0
                if mask_of[p] >= 0:
                    west, east, north, south, scale = rims[mask_of[p]]
                    (a, a1), (b, b1) = _inside(u, west, east, scale), _inside(v, north, south, scale)
                    if a * b == 0.0:
                        continue
                    part, part_u, part_v = _spline(masks, mask_of[p], i, j, wu, du, wv, dv)
                    part, part_u, part_v = part / WHOLE, part_u / WHOLE, part_v / WHOLE
                    known = a * b * _smooth(_CORNER * part)
                    part_u, part_v, part = (
                        part_u * a * b + part * a1 * b,
                        part_v * a * b + part * a * b1,
                        part * a * b,
                    )
                    weight_u = weight_u * part + weight * part_u
                    weight_v = weight_v * part + weight * part_v
                    weight *= part
                    if weight == 0.0:
                        continue
                height, height_u, height_v = _spline(coefficients, p, i, j, wu, du, wv, dv)
                height += base[p]
                weight *= density[p]
                weight_x = density[p] * (weight_u * ux + weight_v * vx)
                weight_y = density[p] * (weight_u * uy + weight_v * vy)
                missing *= 1.0 - known * _faded(u, 1.0)[0] * _faded(v, 1.0)[0]
                count += 1
                total += weight
                for m in range(len(means)):
                    means[m, n] += weight * values[grid[p], m]
                total_x += weight_x
                total_y += weight_y
                sum_h += weight * height
                sum_x += weight_x * height + weight * (height_u * ux + height_v * vx)
                sum_y += weight_y * height + weight * (height_u * uy + height_v * vy)
        if total > 0.0:
            height = sum_h / total
            found[0, n] = height
            found[1, n] = (sum_x - height * total_x) / total
            found[2, n] = (sum_y - height * total_y) / total
            found[3, n] = min(1.0 - missing, 1.0)
            for m in range(len(means)):
                means[m, n] /= total
        else:
            found[0, n] = found[1, n] = found[2, n] = np.nan
            found[3, n] = 0.0
        found[4, n] = count
