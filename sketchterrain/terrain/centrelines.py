"""River centrelines as few arcs, and how far their valleys reach."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d

from sketchterrain.features.rounding import gaussian_filter, rounded
from sketchterrain.features.splines import catmull_rom, cubics
from sketchterrain.terrain.arcs import flattened, position
from sketchterrain.terrain.recipe import FINEST_CELL

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features import River

_CELL_SHARE = 0.01  # of a cell: how near arcs stay to the spline
_MOST_DOUBLINGS = 8  # of the finest cell: arcs for coarser ones would be hardly fewer
_SAME = 1e-6  # m
# How near a straight course of levels, widths and depths stays to what they are, as a share of the width.
_WIDTH_SHARE = 0.01
_SMALLEST_TOLERANCE = 0.02  # m
_BED_TOLERANCE = 0.004  # m
# A river is steep where it falls by this share of its depth over its width, and so many widths around.
_STEEP_DEPTHS = 0.2
_STEEP_WIDTHS = 3.0
_FLOODPLAIN_WIDTHS = 4.0
_LEAST_WIDTHS = 3.0  # whatever the largest reach
_SMALLEST_REACH = 30.0  # m
_VALLEY_RUN_PER_DEPTH = 1.7  # about 30° for the steepest part of a valley's side
_LARGEST_REACH = 900.0  # m


def valley_reach(river: River, ground: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Return how far a river shapes the ground on each side, at each point of its centreline.

    Parameters
    ----------
    river
    ground
        Height of the ground without rivers along the centreline, shape (m,), m. The deeper the river lies
        below it, the wider the valley.

    Returns
    -------
    ndarray of float64, shape (m,)
        Metres.
    """
    cut = np.maximum(ground - river.centreline[:, 2], 0)
    width = river.centreline_width.astype(np.float64)
    reach = np.maximum(_FLOODPLAIN_WIDTHS * width, _SMALLEST_REACH) + _VALLEY_RUN_PER_DEPTH * cut
    step = float(np.median(np.hypot(*np.diff(river.centreline[:, :2], axis=0).T)))
    sigma = max(float(np.median(reach)) / max(step, 1e-3) / 2, 1.0)
    smooth = rounded(gaussian_filter(reach, sigma, mode="reflect"))
    return np.maximum(np.minimum(smooth, _LARGEST_REACH), _LEAST_WIDTHS * width)


@dataclass(frozen=True)
class Reach:
    """A river's centreline as arcs.

    Attributes
    ----------
    points : ndarray of float64, shape (k, 6)
        Ends of the arcs: x, y (m), water surface (m), half width (m), depth (m), reach (m); upstream first.
    bend : ndarray of float64, shape (k - 1,)
        Of each arc; see `sketchterrain.terrain.arcs.nearest_on_arc`.
    """

    points: npt.NDArray[np.float64]
    bend: npt.NDArray[np.float64]


def tolerance_cell(cell_size: float) -> float:
    """Return the cell size (m) that centrelines are flattened for: few enough of them that all can be kept.

    The finest cell times a power of two, not above the cell size.
    """
    doublings = math.floor(math.log2(max(cell_size, FINEST_CELL) / FINEST_CELL) + 1e-9)
    return FINEST_CELL * 2.0 ** min(doublings, _MOST_DOUBLINGS)


TOLERANCE_CELLS = tuple(FINEST_CELL * 2.0**doublings for doublings in range(_MOST_DOUBLINGS + 1))
"""Every value of `tolerance_cell`."""

LARGEST_TOLERANCE = _CELL_SHARE * TOLERANCE_CELLS[-1]
"""How far (m) arcs are from the spline at most."""


@dataclass(frozen=True, eq=False)
class Course:
    """What of a river's centreline its arcs need whatever the cell size; made by `course_of`."""

    river: River
    line: npt.NDArray[np.float64]
    curve: npt.NDArray[np.float64]
    along: npt.NDArray[np.float64]
    kept: npt.NDArray[np.bool_]
    steep: npt.NDArray[np.bool_]


def course_of(
    river: River, reach: npt.NDArray[np.float64], meeting: npt.NDArray[np.float64] | None = None
) -> Course:
    """Prepare a river's centreline to be flattened.

    Parameters
    ----------
    river
    reach
        As `valley_reach` returns it.
    meeting
        Positions (m) where rivers end, shape (n, 2): those on this centreline are kept, so that where
        two rivers meet both have one level.
    """
    line = np.column_stack(
        [river.centreline, river.centreline_width / 2.0, river.centreline_depth.astype(np.float64), reach]
    )
    curve, along = _curve(river)
    return Course(river, line, curve, along, _kept(river, line, meetings_on(river, meeting)), _steep(river))


def as_arcs(course: Course, *, cell_size: float = FINEST_CELL, least: float = 0.0) -> Reach:
    """Flatten a river's spline to arcs within 1 % of a cell.

    Parameters
    ----------
    course
    cell_size
        Metres between the samples that the terrain is wanted at: one of `TOLERANCE_CELLS`.
    least
        Metres that ends of arcs are rounded to anyway: a finer tolerance would be no better.
    """
    curve, u, kept = course.curve, course.along, course.kept
    if float(course.river.centreline_width.max()) > 2.0 * cell_size:
        kept = kept | course.steep  # else there is no channel that water could leave
    cuts = np.union1d(u[kept], np.arange(len(curve) + 1.0))
    cubic = np.minimum(cuts[:-1].astype(np.intp), len(curve) - 1)
    tolerance = max(_CELL_SHARE * cell_size - 0.75 * least, 0.5 * _CELL_SHARE * cell_size)
    pieces = flattened(curve, tolerance, spans=(cubic, cuts[:-1] - cubic, cuts[1:] - cubic))
    at = np.append(pieces.cubic + pieces.first, float(len(curve)))
    points = np.stack([np.interp(at, u, column) for column in course.line.T], axis=-1)
    between = np.flatnonzero(~np.isin(at, u))
    # What was sampled stays to the bit, so that rivers that meet there have one point.
    points[between, :2] = position(curve[pieces.cubic[between]], pieces.first[between, None])[:, 0]
    return Reach(points, pieces.bend)


def _curve(river: River) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """Find the cubics of a river's spline, and where on it the centreline's points are.

    A centreline that is not the spline through its control points is one through all of its own points.
    """
    own = np.arange(len(river.centreline), dtype=np.float64)
    ends = {row.tobytes(): number for number, row in enumerate(river.centreline)}
    controls = np.array([ends.get(row.tobytes(), -1) for row in river.points])
    if controls[0] == 0 and controls[-1] == own[-1] and (np.diff(controls) > 0).all():
        u = np.interp(own, controls, np.arange(len(controls), dtype=np.float64))
        if np.abs(catmull_rom(river.points[:, :2], u) - river.centreline[:, :2]).max() < _SAME:
            return cubics(river.points[:, :2]), u
    return cubics(river.centreline[:, :2]), own


def _kept(river: River, line: npt.NDArray[np.float64], kept: npt.NDArray[np.intp]) -> npt.NDArray[np.bool_]:
    """Which points of the centreline its level, width, depth and reach need, straight in between."""
    width, depth = float(river.centreline_width.min()), float(river.centreline_depth.max())
    # Half a width is one in the bed's parabola: off its line it is shallower by depth * (2 off / width)^2.
    tolerance = min(_WIDTH_SHARE * width, 0.5 * width * math.sqrt(_BED_TOLERANCE / depth))
    tolerance = max(tolerance, _SMALLEST_TOLERANCE)
    # Levels must agree where waters meet; the reach only widens a blend.
    profile = line[:, 2:] * np.array([20, 1, 20, 0.02]) / tolerance
    steps = np.hypot(*np.diff(line[:, :2], axis=0).T)
    return _douglas_peucker(np.concatenate([[0.0], np.cumsum(steps)]), profile, kept)


def _steep(river: River) -> npt.NDArray[np.bool_]:
    """Return where the water falls so much over its width that it must be shared out evenly.

    Ground beside it takes a weighted mean of the levels near; with long pieces on one side and short ones on
    the other it would lie below the water.
    """
    steps = np.hypot(*np.diff(river.centreline[:, :2], axis=0).T)
    fall = -np.diff(river.centreline[:, 2]) * river.centreline_width[1:]
    steep = fall > _STEEP_DEPTHS * river.centreline_depth[1:] * steps
    around = 2 * math.ceil(_STEEP_WIDTHS * float(river.centreline_width.max()) / float(np.median(steps))) + 1
    return np.asarray(maximum_filter1d(np.append(steep, steep[-1:]), around), dtype=np.bool_)


def meetings_on(river: River, meeting: npt.NDArray[np.float64] | None) -> npt.NDArray[np.intp]:
    """Find the indices of the centreline's ends and of its points where another river ends, ascending.

    Parameters
    ----------
    river, meeting
        As for `course_of`.
    """
    line = river.centreline[:, 0] + 1j * river.centreline[:, 1]
    at = np.zeros(len(line), dtype=bool) if meeting is None else np.isin(line, meeting @ np.array([1, 1j]))
    at[[0, -1]] = True
    return np.flatnonzero(at)


def _douglas_peucker(
    arc: npt.NDArray[np.float64], values: npt.NDArray[np.float64], kept: npt.NDArray[np.intp]
) -> npt.NDArray[np.bool_]:
    """Which points to keep so that values straight in between stay within 1 (Douglas & Peucker 1973)."""
    keep = np.zeros(len(arc), dtype=bool)
    keep[kept] = True
    while True:  # all stretches between kept points at once, each split where it strays most
        ends = np.flatnonzero(keep)
        stretch = np.repeat(np.arange(len(ends) - 1), np.diff(ends))
        first, last = ends[stretch], ends[stretch + 1]
        inner = slice(ends[0], ends[-1])
        share = (arc[inner] - arc[first]) / np.maximum(arc[last] - arc[first], 1e-12)
        straight = values[first] + share[:, None] * (values[last] - values[first])
        off = np.abs(values[inner] - straight).max(axis=1)
        most = np.maximum.reduceat(off, ends[:-1] - ends[0])
        worst = np.flatnonzero((off == most[stretch]) & (off > 1.0))
        if len(worst) == 0:
            return keep
        _, where = np.unique(stretch[worst], return_index=True)
        keep[ends[0] + worst[where]] = True
