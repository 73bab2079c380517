"""Systematic offsets between overlapping DEM grids: in height, and by half a cell."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.grids import ElevationGrid
from sketchterrain.elevation.patches import step_of

_MOST, _LEAST = 1 << 16, 30  # samples that are compared
_MEANS = 4  # along a cell of the coarser grid, of the finer one
_BETTER = 0.7  # of the spread: a shift that leaves less is told
_GEOID = 8.0, 107.0  # m between the ellipsoid and sea level, where it can be told from other offsets
_ROBUST: Final = 1.4826  # a normal distribution's standard deviation, in median absolute deviations


class GridOffset(NamedTuple):
    """The offset of a grid from another one."""

    first: int  # numbers of the grids
    second: int
    height: float  # m of the first above the second: the median
    spread: float  # m
    samples: int
    shift: tuple[float, float]  # m eastward and northward of the first, where half a cell fits better
    spread_shifted: float  # m

    def finding(self, grids: Sequence[ElevationGrid]) -> tuple[str, ...]:
        """Return what is found, in words: nothing within the grids' accuracies."""
        a, b = (grids[each] for each in (self.first, self.second))
        told = []
        if abs(self.height) > a.accuracy + b.accuracy + 0.1 * self.spread:
            side = "above" if self.height > 0.0 else "below"
            facts = f"median of {self.samples:,} samples, spread {self.spread:.1f} m"
            hint = ""
            if _GEOID[0] < abs(self.height) < _GEOID[1] and self.spread < 0.2 * abs(self.height):
                hint = ", as if one were above the ellipsoid and one above sea level"
            told.append(f"{a.name} lies {abs(self.height):.1f} m {side} {b.name} ({facts}){hint}")
        if any(self.shift):
            where = "{:+.3g} m eastward, {:+.3g} m northward".format(*self.shift)
            facts = f"spread {self.spread:.1f} m, {self.spread_shifted:.1f} m if it is moved"
            told.append(f"{a.name} seems to lie half a cell off {b.name}: {where} ({facts})")
        return tuple(told)


def measure_offsets(grids: Sequence[ElevationGrid]) -> list[GridOffset]:
    """Return the offsets of all pairs of grids that overlap in at least 30 samples of the coarser one."""
    found = (_offset(grids, *pair) for pair in combinations(range(len(grids)), 2))
    return [each for each in found if each is not None]


def corrections(grids: Sequence[ElevationGrid], offsets: Sequence[GridOffset]) -> list[float]:
    """Return metres to add to each grid to remove offsets; of overlapping ones the most accurate stays."""
    count = len(grids)
    pairs = np.array([(each.first, each.second) for each in offsets], int).reshape(-1, 2)
    weight = np.sqrt([each.samples for each in offsets])
    rows = np.arange(len(offsets))
    matrix = np.zeros((len(offsets), count))
    matrix[rows, pairs[:, 0]], matrix[rows, pairs[:, 1]] = weight, -weight
    linked = coo_array((np.ones(len(offsets)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, group = connected_components(linked, directed=False)
    order = sorted(range(count), key=lambda n: (grids[n].accuracy, step_of(grids[n]), grids[n].id))
    fixed = [next(n for n in order if group[n] == each) for each in range(group.max(initial=-1) + 1)]
    free = np.setdiff1d(np.arange(count), fixed)
    metres = np.zeros(count)
    metres[free] = np.linalg.lstsq(matrix[:, free], [-each.height for each in offsets] * weight)[0]
    return [float(each) for each in metres]


def _offset(grids: Sequence[ElevationGrid], first: int, second: int) -> GridOffset | None:
    coarse, fine, sign = grids[first], grids[second], 1.0
    if step_of(coarse) < step_of(fine):
        coarse, fine, sign = fine, coarse, -1.0
    # Places of some of the coarse samples in the fine grid.
    rows, columns = (np.linspace(0.0, n - 1.0, 9) for n in fine.samples.shape)
    outline = fine.to_metres(*(each.ravel() for each in np.meshgrid(columns, rows)))
    spans = []
    for at, n in zip(coarse.to_samples(*outline)[::-1], coarse.samples.shape, strict=True):
        low, high = max(int(at.min()) - 1, 0), min(int(at.max()) + 2, n)
        spans.append((low, high))
    size = np.prod([max(high - low, 0) for low, high in spans])
    if size == 0:
        return None
    stride = int(np.ceil(np.sqrt(size / _MOST)))
    row, column = (
        each.ravel() for each in np.meshgrid(*(np.arange(*span, stride) for span in spans), indexing="ij")
    )
    heights = coarse.samples[row, column].astype(np.float64)

    def place(right: float, down: float) -> Float64Array:
        """Return rows and columns in the fine grid of the coarse samples, moved by cells of their grid."""
        x, y = coarse.to_metres(column + right, row + down)
        return np.stack(fine.to_samples(x, y)[::-1])

    origin = place(0.0, 0.0)
    across, along = (np.median(place(*each) - origin, axis=1)[:, None] for each in ((1.0, 0.0), (0.0, 1.0)))
    means = int(np.clip(np.rint(np.linalg.norm(across)), 1, _MEANS))
    inside = ((np.arange(means) + 0.5) / means - 0.5).tolist()

    def rises(moved: Float64Array) -> Float64Array:
        """Return how far the coarse grid lies above the fine one's means, moved by its cells."""
        total = np.zeros(len(heights))
        for right in inside:
            for down in inside:
                at = origin - moved + right * across + down * along
                total += ndimage.map_coordinates(
                    fine.samples, at, np.float64, 1, mode="constant", cval=np.nan
                )
        rise = heights - total / means**2
        return np.asarray(rise[np.isfinite(rise)])

    rise = rises(np.zeros((2, 1)))
    if len(rise) < _LEAST:
        return None
    height, spread = _centre(rise)
    best, shift = spread, np.zeros((2, 1))
    for u, v in ((u, v) for u in (-0.5, 0.0, 0.5) for v in (-0.5, 0.0, 0.5) if (u, v) != (0.0, 0.0)):
        for cell in (u * across + v * along, np.array([[v], [u]])):  # of the coarse grid, of the fine one
            found = rises(cell)
            if len(found) >= _LEAST and (left := _centre(found)[1]) < min(best, _BETTER * spread):
                best, shift = left, cell
    x, y = fine.to_metres(*(origin.mean(axis=1, keepdims=True) + np.hstack([shift, 0.0 * shift]))[::-1])
    metres = sign * (x[0] - x[1]), sign * (y[0] - y[1])
    return GridOffset(first, second, sign * height, spread, len(rise), metres, best)


def _centre(values: Float64Array) -> tuple[float, float]:
    """Return the median and a robust spread."""
    median = float(np.median(values))
    return median, float(_ROBUST * np.median(np.abs(values - median)))
