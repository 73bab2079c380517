"""Systematic offsets between overlapping DEM grids: in height, and by half a cell."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.patches import GridPatches
from sketchterrain.elevation.selection import Patchwork

_MOST, _LEAST = 1 << 14, 30  # samples that are compared
_LEAST_TOLD = 0.1  # m
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

    def finding(self, grids: Sequence[GridPatches], names: Sequence[str]) -> tuple[str, ...]:
        """Return what is found, in words: nothing within the grids' accuracies."""
        a, b = grids[self.first], grids[self.second]
        name, other = names[self.first], names[self.second]
        told = []
        if abs(self.height) > a.accuracy + b.accuracy + max(0.1 * self.spread, _LEAST_TOLD):
            side = "above" if self.height > 0.0 else "below"
            facts = f"median of {self.samples:,} samples, spread {self.spread:.1f} m"
            hint = ""
            if _GEOID[0] < abs(self.height) < _GEOID[1] and self.spread < 0.2 * abs(self.height):
                hint = ", as if one were above the ellipsoid and one above sea level"
            told.append(f"{name} lies {abs(self.height):.1f} m {side} {other} ({facts}){hint}")
        if any(self.shift):
            where = "{:+.3g} m eastward, {:+.3g} m northward".format(*self.shift)
            facts = f"spread {self.spread:.1f} m, {self.spread_shifted:.1f} m if it is moved"
            told.append(f"{name} seems to lie half a cell off {other}: {where} ({facts})")
        return tuple(told)


def measure_offsets(grids: Sequence[GridPatches]) -> list[GridOffset]:
    """Return the offsets of all pairs of grids that overlap in at least 30 samples of the coarser one."""
    works = [Patchwork({each.id: each}) for each in grids]
    found = (_offset(grids, works, *pair) for pair in combinations(range(len(grids)), 2))
    return [each for each in found if each is not None]


def corrections(grids: Sequence[GridPatches], offsets: Sequence[GridOffset]) -> list[float]:
    """Return metres to add to each grid to remove offsets; of overlapping ones the most accurate stays."""
    count = len(grids)
    pairs = np.array([(each.first, each.second) for each in offsets], int).reshape(-1, 2)
    weight = np.sqrt([each.samples for each in offsets])
    rows = np.arange(len(offsets))
    matrix = np.zeros((len(offsets), count))
    matrix[rows, pairs[:, 0]], matrix[rows, pairs[:, 1]] = weight, -weight
    linked = coo_array((np.ones(len(offsets)), (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    _, group = connected_components(linked, directed=False)
    order = sorted(range(count), key=lambda n: (grids[n].accuracy, grids[n].step, grids[n].id))
    fixed = [next(n for n in order if group[n] == each) for each in range(group.max(initial=-1) + 1)]
    free = np.setdiff1d(np.arange(count), fixed)
    metres = np.zeros(count)
    metres[free] = np.linalg.lstsq(matrix[:, free], [-each.height for each in offsets] * weight)[0]
    return [float(each) for each in metres]


def _offset(
    grids: Sequence[GridPatches], works: Sequence[Patchwork], first: int, second: int
) -> GridOffset | None:
    """Compare some samples of the coarser grid with the finer one's surface for cells as large."""
    coarse, fine, sign = first, second, 1.0
    if grids[coarse].step < grids[fine].step:
        coarse, fine, sign = fine, coarse, -1.0
    x, y = _samples_within(grids[coarse], grids[fine])
    if not len(x):
        return None
    own, step = _heights(works[coarse], x, y, 0.0), grids[coarse].step

    def rises(east: float, north: float) -> Float64Array:
        """Return how far the coarse grid, moved back by some metres, lies above the fine one."""
        rise = own - _heights(works[fine], x - east, y - north, step)
        return np.asarray(rise[np.isfinite(rise)])

    rise = rises(0.0, 0.0)
    if len(rise) < _LEAST:
        return None
    height, spread = _centre(rise)
    best, shift = spread, (0.0, 0.0)
    for cells in (_cell(grids[each], x, y) for each in (coarse, fine)):
        for u, v in ((u, v) for u in (-0.5, 0.0, 0.5) for v in (-0.5, 0.0, 0.5) if (u, v) != (0.0, 0.0)):
            east, north = (float(each) for each in u * cells[0] + v * cells[1])
            found = rises(east, north)
            if len(found) >= _LEAST and (left := _centre(found)[1]) < min(best, _BETTER * spread):
                best, shift = left, (sign * east, sign * north)
    return GridOffset(first, second, sign * height, spread, len(rise), shift, best)


def _samples_within(coarse: GridPatches, fine: GridPatches) -> tuple[Float64Array, Float64Array]:
    """Return the places (m) of some samples of a grid around another one."""
    rows, columns = (np.linspace(0.0, n - 1.0, 9) for n in fine.shape)
    outline = fine.grid.to_metres(*(each.ravel() for each in np.meshgrid(columns, rows)))
    spans = []
    for at, n in zip(coarse.grid.to_samples(*outline)[::-1], coarse.shape, strict=True):
        spans.append((max(int(at.min()) - 1, 0), min(int(at.max()) + 2, n)))
    size = np.prod([max(high - low, 0) for low, high in spans])
    stride = max(int(np.ceil(np.sqrt(size / _MOST))), 1)
    row, column = np.meshgrid(*(np.arange(*span, stride, dtype=float) for span in spans), indexing="ij")
    x, y = coarse.grid.to_metres(column.ravel(), row.ravel())
    return x, y


def _heights(work: Patchwork, x: Float64Array, y: Float64Array, cell: float) -> Float64Array:
    """Return heights (m) for cells of a size, NaN beside the data."""
    which = work.cover(0.0) if cell == 0.0 else work.cover_for_cells(cell)
    area = float(x.min()), float(y.min()), float(x.max()), float(y.max())
    found = work.surface(work.within(which, area)).evaluate(x, y)
    return np.where(found.weight > 0.999, found.height, np.nan)


def _cell(part: GridPatches, x: Float64Array, y: Float64Array) -> Float64Array:
    """Return the vectors (2, 2), m, of a cell of a grid in the middle of some places."""
    column, row = (np.mean(each) for each in part.grid.to_samples(x, y))
    east, north = part.grid.to_metres(column + np.array([0.0, 1.0, 0.0]), row + np.array([0.0, 0.0, 1.0]))
    return np.stack([east[1:] - east[0], north[1:] - north[0]], axis=1)


def _centre(values: Float64Array) -> tuple[float, float]:
    """Return the median and a robust spread."""
    median = float(np.median(values))
    return median, float(_ROBUST * np.median(np.abs(values - median)))
