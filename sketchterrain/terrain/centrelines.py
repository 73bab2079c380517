"""Centrelines of rivers, flattened to arcs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.ndimage import maximum_filter1d

from sketchterrain.array_types import BoolArray, Float64Array, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.hashing import gaussian_filter, rounded
from sketchterrain.geometry.splines import arc_length, at_lengths, catmull_rom, cubics
from sketchterrain.io.resources import kernel_constants
from sketchterrain.landforms.hydrology.river_shape import bank_sway, bend_lean
from sketchterrain.landforms.placement.feature_types import River
from sketchterrain.stages.digests import digest_of
from sketchterrain.terrain.noise import FINEST_CELL

if TYPE_CHECKING:
    Ints = npt.NDArray[np.intp]

_CHECKS = 15  # samples inside a piece where the curve is compared
_SHARE = 0.9  # of the tolerance allowed at the samples: the rest is for what lies between, and for rounding
_MAX_BEND = 0.25  # a tangent: no arc of more than 56°, so that points beside it have one nearest point
_MAX_HALVINGS = 24
(_CENTRE,) = kernel_constants("spline_arcs.clh", "CENTRE")
_POINT = 1e-12  # m: shorter chords are points

(_CHANNEL_CELLS,) = kernel_constants("layers/corridors.clh", "CHANNEL_CELLS")
LEAST_WIDTH = 2.0 * _CHANNEL_CELLS * FINEST_CELL
"""Least width (m) that a river is carved with: the finest cells show a narrower one as a bank."""

_CELL_SHARE = 0.01  # of a cell: tolerance between arcs and spline
_MAX_DOUBLINGS = 8  # of the finest cell: arcs for coarser ones would be hardly fewer
_SAME = 1e-6  # m
# Tolerance of piecewise linear levels, widths and depths, as a share of the width.
_WIDTH_SHARE = 0.01
_MIN_TOLERANCE = 0.02  # m
_BED_TOLERANCE = 0.004  # m
# A river is steep where it falls by this share of its depth over its width, and so many widths around.
_STEEP_DEPTHS = 0.2
_STEEP_WIDTHS = 3.0
_FLOODPLAIN_WIDTHS = 4.0
_SWING_REACH = 10.0  # widths: standard deviation of the blur of a width
_MIN_WIDTHS = 3.0  # takes precedence over _MAX_RADIUS
_MIN_RADIUS = 30.0  # m
VALLEY_RUN_PER_DEPTH = 1.7  # about 30° for the steepest part of a valley's side
_MAX_RADIUS = 900.0  # m

TOLERANCE_CELLS = tuple(FINEST_CELL * 2.0**doublings for doublings in range(_MAX_DOUBLINGS + 1))
"""All values of `tolerance_cell`."""

MAX_TOLERANCE = _CELL_SHARE * TOLERANCE_CELLS[-1]
"""Greatest distance (m) of any arc from its spline."""


@dataclass(frozen=True)
class Pieces:
    """Pieces of cubics, in order, shape (n,) each: the cubic, its parameters 0 … 1 at both ends, the bend."""

    cubic: Ints
    first: Float64Array
    last: Float64Array
    bend: Float64Array


def position(cubics: Float64Array, t: Float64Array) -> Float64Array:
    """Evaluate cubics (n, 2, 4) at t (n, ...): shape (n, ..., 2)."""
    t = t[..., None]
    c = cubics.reshape(len(cubics), *([1] * (t.ndim - 2)), 2, 4)
    return np.asarray(((c[..., 3] * t + c[..., 2]) * t + c[..., 1]) * t + c[..., 0])


@dataclass(frozen=True)
class Bisection:
    """Arcs or chords of stretches of cubics and of their halves, until each is within a tolerance."""

    pieces: Pieces
    missed: Float64Array  # (n,) greatest distance (m) from the curve
    above: Float64Array  # (n,) the least one of the stretches that it is part of

    def within(self, tolerance: float) -> Pieces:
        """Return the widest pieces that are within a tolerance (m), in order."""
        most = _SHARE * tolerance
        widest = np.flatnonzero((self.missed <= most) & (self.above > most))
        order = widest[np.lexsort((self.pieces.first[widest], self.pieces.cubic[widest]))]
        every = self.pieces
        return Pieces(every.cubic[order], every.first[order], every.last[order], every.bend[order])


def bisect(
    cubics: Float64Array,
    tolerance: float,
    *,
    arcs: bool = True,
    spans: tuple[Ints, Float64Array, Float64Array] | None = None,
) -> Bisection:
    """Bisect cubics (n, 2, 4) until each piece is within the tolerance (m) of an arc or chord.

    An arc through the ends of a piece of length L misses the curve by about κ′L³/125 where a chord misses it
    by κL²/8 (κ: curvature, κ′: its derivative): few arcs replace many chords.
    ``spans`` (cubic, first, last) are stretches to flatten instead of whole cubics; their ends stay ends.
    """
    if spans is None:
        spans = np.arange(len(cubics)), np.zeros(len(cubics)), np.ones(len(cubics))
    cubic, first, last = spans
    above = np.full(len(cubic), np.inf)
    tested: list[tuple[npt.NDArray[Any], ...]] = []
    for halving in range(_MAX_HALVINGS + 1):
        bend, missed = _fit_arcs(cubics[cubic], first, last, arcs=arcs)
        if halving == _MAX_HALVINGS:
            missed[:] = 0.0
        tested.append((cubic, first, last, bend, missed, above))
        coarse = missed > _SHARE * tolerance
        if not coarse.any():
            break
        above = np.repeat(np.minimum(above, missed)[coarse], 2)
        cubic, first, last = cubic[coarse], first[coarse], last[coarse]
        middle = 0.5 * (first + last)
        cubic = np.repeat(cubic, 2)
        first, last = np.stack([first, middle], -1).ravel(), np.stack([middle, last], -1).ravel()
    *pieces, missed, above = (np.concatenate(each) for each in zip(*tested, strict=True))
    return Bisection(Pieces(*pieces), missed, above)


def _fit_arcs(
    cubics: Float64Array, first: Float64Array, last: Float64Array, *, arcs: bool
) -> tuple[Float64Array, Float64Array]:
    """Return the bend of the best arc for each stretch, and its maximum distance (m) from the curve."""
    share = np.linspace(0.0, 1.0, _CHECKS + 2)
    at = position(cubics, first[:, None] + (last - first)[:, None] * share)
    chord, offset = at[:, -1] - at[:, 0], at[:, 1:-1] - at[:, :1]
    length2 = np.maximum((chord**2).sum(axis=-1), _POINT**2)[:, None]
    bend = np.zeros(len(cubics))
    if arcs:
        u = (offset * chord[:, None]).sum(axis=-1) / length2
        v = (chord[:, None, 0] * offset[..., 1] - chord[:, None, 1] * offset[..., 0]) / length2
        q = u - u * u - v * v
        # tan of half the arc's angle, by least squares: the circle is tan (u - u² - v²) = v.
        tangent = (v * q).sum(axis=-1) / np.maximum((q * q).sum(axis=-1), 1e-300)
        bend = tangent / (1.0 + np.sqrt(1.0 + tangent * tangent))
        bend = np.clip(bend, -_MAX_BEND, _MAX_BEND)
    _, square = nearest_on_arc(chord[:, None], bend[:, None], offset)
    return bend, np.sqrt(square.max(axis=-1))


def nearest_on_arc(
    chord: Float64Array, bend: Float64Array, offset: Float64Array
) -> tuple[Float64Array, Float64Array]:
    """Return the nearest point of an arc: parameter t (0 … 1) and squared distance (m²).

    ``chord`` runs from the arc's start to its end, ``offset`` from its start to the point (m). ``bend`` is
    the tangent of a quarter of the arc's angle, positive to the left; see ``kernels/spline_arcs.clh``.
    """
    u, v, deviation, _ = _on_circle(chord, bend, offset)
    towards, beside = 1.0 - bend * bend + 4.0 * bend * v, u - 0.5
    t = 0.5 + beside * (1.0 - bend * bend) / np.maximum(towards, _CENTRE)
    t = np.where(towards < _CENTRE, np.where(beside < 0.0, -1.0, 2.0), t)
    foot = np.clip(t, 0.0, 1.0)
    square = np.where(foot == t, deviation * deviation, (u - foot) ** 2 + v * v)
    return foot, square * (chord**2).sum(axis=-1)


def signed_square(chord: Float64Array, bend: Float64Array, offset: Float64Array) -> Float64Array:
    """Return squared distances (m²) to arcs' whole circles, positive to the left; see `nearest_on_arc`."""
    *_, deviation, length2 = _on_circle(chord, bend, offset)
    return deviation * np.abs(deviation) * length2


def _on_circle(
    chord: Float64Array, bend: Float64Array, offset: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array, Float64Array]:
    """Return coordinates along and left of chords, distances to arcs' circles (chords), squared chords."""
    length2 = np.maximum((chord**2).sum(axis=-1), _POINT**2)
    u = (offset * chord).sum(axis=-1) / length2
    v = (chord[..., 0] * offset[..., 1] - chord[..., 1] * offset[..., 0]) / length2
    whole, g = 1.0 + bend * bend, 2.0 * bend * (u * u - u + v * v) + (1.0 - bend * bend) * v
    return u, v, 2.0 * g / (whole + np.sqrt(np.maximum(whole * whole + 8.0 * bend * g, 0.0))), length2


def arc_boxes(
    start: LatticeArray, chord: Float64Array, bend: Float64Array, radius: Float64Array, unit: float
) -> LatticeArray:
    """Return boxes (n, 4), lattice units, of all that is within a radius (m) of arcs."""
    end = start + np.rint(chord / unit).astype(np.int64)
    sagitta = 0.5 * np.abs(bend) * np.hypot(*chord.T)
    wide = np.ceil((radius + sagitta) / unit * (1 + 1e-5) + 2).astype(np.int64)[:, None]
    return np.concatenate([np.minimum(start, end) - wide, np.maximum(start, end) + wide], axis=1)


def valley_radius(river: River, ground: Float64Array) -> Float64Array:
    """Return how far (m) a river shapes the terrain on each side, at each point of its centreline, (m,).

    The deeper it lies below the terrain without rivers along the centreline, the wider the valley. A stream
    lies in a valley of the ground. In the water of a deep river a brook shapes its own channel alone.
    """
    cut = np.maximum(ground - river.centreline[:, 2], 0)
    width = np.maximum(river.centreline_width.astype(np.float64), LEAST_WIDTH)
    step = float(np.median(np.hypot(*np.diff(river.centreline[:, :2], axis=0).T)))
    # A valley does not follow the swings of its river's width.
    mean = gaussian_filter(width, _SWING_REACH * float(np.median(width)) / max(step, 1e-3), mode="reflect")
    floor = _MIN_WIDTHS * width if river.label == 0 else np.maximum(_FLOODPLAIN_WIDTHS * mean, _MIN_RADIUS)
    radius = floor + VALLEY_RUN_PER_DEPTH * cut
    sigma = max(float(np.median(radius)) / max(step, 1e-3) / 2, 1.0)
    smooth = rounded(gaussian_filter(radius, sigma, mode="reflect"))
    radius = np.maximum(np.minimum(smooth, _MAX_RADIUS), _MIN_WIDTHS * width)
    if river.bed_width is not None:
        arc = arc_length(river.centreline[:, :2])
        first = int(np.argmax(river.bed_width > river.centreline_width))
        before = np.clip((arc[first] - arc) / radius[first], 0.0, 1.0)
        radius = 0.5 * width + (radius - 0.5 * width) * before
    return radius


def typical_half_width(river: River) -> float:
    """Return the half width (m) by which distances from rivers are compared, in steps of 2^¼.

    One of all of the river, without natural variation, that hardly changes when the river is edited.
    """
    widths = river.width if river.mean_width is None else river.mean_width
    return 0.5 * math.exp2(round(4.0 * math.log2(float(np.median(widths)))) / 4.0)


@dataclass(frozen=True)
class ArcCentreline:
    """A river's centreline as arcs."""

    # (k, 8), ends of the arcs, upstream first: x, y (m), water surface (m), half width (m), depth (m), valley
    # radius (m), lean of the current and sway of the banks (`bend_lean`, `bank_sway`).
    points: Float64Array
    bend: Float64Array  # (k - 1,), see `sketchterrain.terrain.centrelines.nearest_on_arc`


def tolerance_cell(cell_size: float) -> float:
    """Return the cell size (m) that centrelines are flattened for.

    The finest cell times a power of two, rounded down.

    Few enough values that the arcs for all of them can be cached.
    """
    doublings = math.floor(math.log2(max(cell_size, FINEST_CELL) / FINEST_CELL) + 1e-9)
    return FINEST_CELL * 2.0 ** min(doublings, _MAX_DOUBLINGS)


@dataclass(frozen=True, eq=False)
class PreparedCentreline:
    """What flattening a river's centreline needs at every cell size; see `prepare_centreline`."""

    river: River
    line: Float64Array  # (n, 8), as `ArcCentreline.points`
    curve: Float64Array
    along: Float64Array
    anchors: BoolArray  # samples that are ends of arcs
    steep: BoolArray

    def __reduce__(self) -> tuple[Any, ...]:
        """Leave out what the samples repeat of the river."""
        radii = self.line[:, 5].copy()
        return _restored, (self.river, radii, self.curve, self.along, self.anchors, self.steep)


def prepare_centreline(
    river: River, radii: Float64Array, meeting: Float64Array | None = None
) -> PreparedCentreline:
    """Prepare a river's centreline with its valley radii for flattening.

    Points of the centreline where other rivers end (``meeting``, (n, 2), m) stay ends of arcs, so that both
    rivers have the same level there.
    """
    curve, along = _curve(river)
    line = _samples(river, radii)
    is_narrowed = line[:, 5] < 2.0 * _MIN_WIDTHS * line[:, 3]  # see `valley_radius`
    anchors = _profile_anchors(river, line, meetings_on(river, meeting)) | is_narrowed
    return PreparedCentreline(river, line, curve, along, anchors, _steep(river))


def _samples(river: River, radii: Float64Array) -> Float64Array:
    own = river.centreline_width
    # As wide as the river that it lies in, a brook has no banks there: they would be as high as that is deep.
    widths = (own if river.bed_width is None else np.maximum(own, river.bed_width)) / 2.0
    depths, line = river.centreline_depth.astype(np.float64), river.centreline
    form = line[:, :2], arc_length(line), own.astype(np.float64)
    sway = bank_sway(*form) * (river.mean_width is not None)
    return np.column_stack([line, widths, depths, radii, bend_lean(*form), sway])


def _restored(river: River, radii: Float64Array, *rest: Any) -> PreparedCentreline:
    return PreparedCentreline(river, _samples(river, radii), *rest)


_bisections = LRUCache(1 << 10, max_bytes=1 << 25)  # an edit moves few rivers


def flatten_to_arcs(
    course: PreparedCentreline, *, cell_size: float = FINEST_CELL, least: float = 0.0
) -> ArcCentreline:
    """Flatten a river's spline to arcs within 1 % of a cell (one of `TOLERANCE_CELLS`, m).

    ``least`` is the rounding (m) of arc ends: a finer tolerance would gain nothing.
    """
    curve, u, anchors = course.curve, course.along, course.anchors
    if float(course.river.centreline_width.max()) > 2.0 * cell_size:
        anchors = anchors | course.steep  # otherwise there is no channel for water to spill from
    cuts = np.union1d(u[anchors], np.arange(len(curve) + 1.0))
    cubic = np.minimum(cuts[:-1].astype(np.intp), len(curve) - 1)
    spans = cubic, cuts[:-1] - cubic, cuts[1:] - cubic
    finest, tolerance = (
        max(_CELL_SHARE * cell - 0.75 * least, 0.5 * _CELL_SHARE * cell) for cell in (FINEST_CELL, cell_size)
    )
    key = digest_of((curve, cuts, finest))
    pieces = _bisections.get_or_compute(key, lambda: bisect(curve, finest, spans=spans)).within(tolerance)
    at = np.append(pieces.cubic + pieces.first, float(len(curve)))
    points = at_lengths(course.line, u, at)
    between = np.flatnonzero(~np.isin(at, u))
    # Samples stay bit-equal, so that rivers that meet there share one point.
    points[between, :2] = position(curve[pieces.cubic[between]], pieces.first[between, None])[:, 0]
    return ArcCentreline(points, pieces.bend)


def _curve(river: River) -> tuple[Float64Array, Float64Array]:
    """Return the cubics of a river's spline, and the curve parameters of the centreline's points.

    Where the centreline is not the spline through its control points, as at the ends of a shortened course,
    it gets the spline through all of its points.
    """
    own = np.arange(len(river.centreline), dtype=np.float64)
    ends = {row: number for number, row in enumerate(_bytes_of(river.centreline))}
    controls = np.array([ends.get(row, -1) for row in _bytes_of(river.points)])
    if controls[0] != 0 or controls[-1] != own[-1] or (np.diff(controls) <= 0).any():
        return cubics(river.centreline[:, :2]), own
    u = np.interp(own, controls, np.arange(len(controls), dtype=np.float64))
    off = np.abs(catmull_rom(river.points[:, :2], u) - river.centreline[:, :2]).max(axis=1) >= _SAME
    other = np.isin(np.arange(len(controls) - 1), np.floor(u[off]))
    knots = np.union1d(controls, np.flatnonzero(other[np.minimum(u.astype(np.intp), len(other) - 1)]))
    number = np.searchsorted(controls, knots[:-1], side="right") - 1
    spline, dense = cubics(river.points[:, :2]), cubics(river.centreline[:, :2])
    curve = np.where(other[number][:, None, None], dense[knots[:-1]], spline[number])
    return curve, np.interp(own, knots, np.arange(len(knots), dtype=np.float64))


def _bytes_of(rows: Float64Array) -> list[bytes]:
    """Return the bytes of each row."""
    return list(np.ascontiguousarray(rows).view(f"V{rows.itemsize * rows.shape[1]}")[:, 0].tolist())


def _profile_anchors(river: River, line: Float64Array, anchors: npt.NDArray[np.intp]) -> BoolArray:
    """Return the centreline points needed for piecewise linear level, width, depth and valley radius."""
    width, depth = float(river.centreline_width.min()), float(river.centreline_depth.max())
    # The bed is a parabola: off its axis it is shallower by depth * (2 off / width)^2.
    tolerance = min(_WIDTH_SHARE * width, 0.5 * width * math.sqrt(_BED_TOLERANCE / depth))
    tolerance = max(tolerance, _MIN_TOLERANCE)
    # Levels must agree where waters meet; the valley radius only widens a blend.
    profile = line[:, 2:6] * np.array([20, 0.03, 20, 0.02]) / tolerance
    steps = np.hypot(*np.diff(line[:, :2], axis=0).T)
    return _douglas_peucker(np.concatenate([[0.0], np.cumsum(steps)]), profile, anchors)


def _steep(river: River) -> BoolArray:
    """Return where the water falls so much over its width that arcs must be short and even.

    The terrain beside it takes a weighted mean of the levels nearby; with long arcs on one side and short
    ones on the other it would lie below the water.
    """
    steps = np.hypot(*np.diff(river.centreline[:, :2], axis=0).T)
    fall = -np.diff(river.centreline[:, 2]) * river.centreline_width[1:]
    steep = fall > _STEEP_DEPTHS * river.centreline_depth[1:] * steps
    around = 2 * math.ceil(_STEEP_WIDTHS * float(river.centreline_width.max()) / float(np.median(steps))) + 1
    return np.asarray(maximum_filter1d(np.append(steep, steep[-1:]), around), dtype=np.bool_)


def meetings_on(river: River, meeting: Float64Array | None) -> npt.NDArray[np.intp]:
    """Return the indices, ascending, of the centreline's ends and of its points where another river ends."""
    line = river.centreline[:, 0] + 1j * river.centreline[:, 1]
    at = np.zeros(len(line), dtype=bool) if meeting is None else np.isin(line, meeting @ np.array([1, 1j]))
    at[[0, -1]] = True
    return np.flatnonzero(at)


def _douglas_peucker(arc: Float64Array, values: Float64Array, anchors: npt.NDArray[np.intp]) -> BoolArray:
    """Return which points to retain so that linear interpolation stays within 1 (Douglas & Peucker 1973)."""
    retained, columns = np.zeros(len(arc), dtype=bool), np.ascontiguousarray(values.T)
    retained[anchors] = True
    inner = np.arange(anchors[0], anchors[-1])
    while True:  # all stretches between retained points at once, each split where it deviates most
        ends = np.flatnonzero(retained)
        stretch = np.searchsorted(ends, inner, side="right") - 1
        first, last = ends[stretch], ends[stretch + 1]
        share = (arc[inner] - arc[first]) / np.maximum(arc[last] - arc[first], 1e-12)
        start = columns[:, first]
        straight = start + share * (columns[:, last] - start)
        deviation = np.abs(columns[:, inner] - straight).max(axis=0)
        begin = np.flatnonzero(np.diff(stretch, prepend=-1))
        most = np.repeat(np.maximum.reduceat(deviation, begin), np.diff(np.append(begin, len(inner))))
        worst = np.flatnonzero((deviation == most) & (deviation > 1.0))
        if len(worst) == 0:
            return retained
        _, where = np.unique(stretch[worst], return_index=True)
        retained[inner[worst[where]]] = True
        inner = inner[most > 1.0]  # the others are straight
