"""River shape: widths, longitudinal profiles, confluences and bends."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.geometry.hashing import rounded, value_noise
from sketchterrain.geometry.splines import arc_length, at_lengths
from sketchterrain.host.library import host_function
from sketchterrain.landforms.hydrology.courses import RiverCourse, smoothed
from sketchterrain.landforms.placement.feature_types import smoothstep
from sketchterrain.stages.runner import Runner

MIN_GRADIENT = 1e-4
"""Least gradient of water, m per m."""

_MAX_GRADIENT, _MIN_MAX_GRADIENT, _GRADIENT_DEPTHS = 0.6, 0.03, 1.2
_SPRING_WIDTH = 0.4  # of the label's width
_BEND_ROUNDS, _BEND_REACH = 60, 4.0  # reach in widths
_BANKS = (-1.6, -1.5, -1.0, 1.0, 1.5, 1.6)  # widths beside the river
_MAX_WIDENING = 2.0  # times the label's width, at most, at confluences
_SWING, _MOST_SWING = 0.6, 0.3  # contrast and greatest variation of widths and banks, shares of the width …
_SWING_WIDTHS = 3.0  # … with swings over about twice so many widths
_BEND_WIDENING = 0.15  # of the width in the sharpest bends, whose bars narrow crossings lack
_CHORD_WIDTHS = 1.5  # length of the chords by which a course's turn is measured
_SHARP_TURN = 0.5  # sine of their angle in a bend as sharp as meanders have: a radius of 3 widths
_SWING_STEP = 2.0**-8  # to which ratios are rounded
_END_WIDTHS = 4.0  # from a course's ends over which it gets its bends' shape


def river_widths(
    base: Float64Array, arc: Float64Array, taper: float, tributaries: list[tuple[int, float]]
) -> Float64Array:
    """Return the width (m) of a river along its centreline.

    At a confluence the squares of the widths add up, as drainage areas do (Leopold & Maddock 1953: width goes
    with the root of the discharge), up to twice the label's width `base`. It widens from 0.4 over `taper` (m;
    0: constant). `tributaries` are (index on the centreline, width in m).
    """
    grown = smoothstep(arc / taper) if taper > 0.0 else np.ones(len(arc))
    width = base * (_SPRING_WIDTH + (1.0 - _SPRING_WIDTH) * grown)
    for index, joining in sorted(tributaries):
        joined = smoothstep((arc - arc[index]) / (3.0 * max(joining, float(width[index]))))
        # From here on a tributary wider than its stem sets the width.
        wider = np.maximum(
            np.minimum(np.hypot(width, joining), _MAX_WIDENING * base), np.maximum(width, joining)
        )
        width = width + (wider - width) * joined
    return width


def bend_lean(line: Float64Array, arc: Float64Array, width: Float64Array) -> Float64Array:
    """Return -1 … 1 along a course (n, 2; m): how far its current leans to the left, as in right bends.

    Proportional to the curvature; none at the course's ends.
    """
    reach = _CHORD_WIDTHS * width
    ends = [at_lengths(line, arc, arc + far) for far in (-reach, reach)]
    (bx, by), (ax, ay) = (line - ends[0]).T, (ends[1] - line).T
    turn = (bx * ay - by * ax) / np.maximum(np.hypot(bx, by) * np.hypot(ax, ay), 1e-12)
    return rounded(np.clip(-turn / _SHARP_TURN, -1.0, 1.0) * _inside(arc, width))


def width_swing(line: Float64Array, arc: Float64Array, width: Float64Array) -> Float64Array:
    """Return the ratio of a natural river's width to its mean `width` (m) along a course: wider in bends.

    1 at the course's ends.
    """
    bends = _BEND_WIDENING * np.abs(bend_lean(line, arc, width))
    swing = 1.0 + _inside(arc, width) * (_swing("river width", line, width) + bends)
    return rounded(swing, _SWING_STEP)


def bank_sway(line: Float64Array, arc: Float64Array, width: Float64Array) -> Float64Array:
    """Return how far both banks are shifted to the left along a course, in half widths."""
    return rounded(_inside(arc, width) * _swing("river banks", line, width))


def _swing(stream: str, line: Float64Array, width: Float64Array) -> Float64Array:
    """Return noise at positions: an edit changes no other reach."""
    unit = _SWING_WIDTHS * math.ldexp(1.0, math.frexp(float(width.max()))[1])
    noise = _SWING * (2.0 * value_noise(0, stream, *(line / unit).T) - 1.0)
    return np.asarray(np.clip(noise, -_MOST_SWING, _MOST_SWING))


def _inside(arc: Float64Array, width: Float64Array) -> Float64Array:
    """Return 0 at a course's ends and 1 between."""
    return smoothstep(np.minimum(arc, arc[-1] - arc) / (_END_WIDTHS * width))


def bank_height(depth: float) -> float:
    """Return how far (m) the water of a river of a depth (m) lies below the terrain along it."""
    return 0.3 * depth + 0.5


def water_surface(
    ground: Float64Array, arc: Float64Array, *, width: float, depth: float, ceilings: list[tuple[int, float]]
) -> Float64Array:
    """Return the water level along a river, falling all the way, from the terrain `ground` (m) along it.

    Smoothed over about 20 widths, 0.3 depths and half a metre below the terrain, and not above the
    `ceilings`: (index, level in m) of tributaries.
    """
    spacing = max(float(arc[-1]) / max(len(arc) - 1, 1), 1e-9)
    sigma = min(6.0 * width / spacing, len(arc) / 4.0)
    target = _blurred(ground, sigma) - bank_height(depth)
    for index, level in ceilings:
        target[index:] = np.minimum(target[index:], level)
    falling = np.minimum.accumulate(target)
    falling = rounded(_blurred(falling, 0.5 * sigma))
    for index, level in ceilings:  # again, as the blur rounds their steps
        falling[index:] = np.minimum(falling[index:], level + MIN_GRADIENT * arc[index])
    falling = np.minimum.accumulate(falling)
    return np.asarray(falling - MIN_GRADIENT * arc)


def gradient_limit(width: Float64Array, depth: Float64Array) -> Float64Array:
    """Return the greatest gradient (m/m) of rivers of some widths and depths (m)."""
    return np.asarray(np.clip(_GRADIENT_DEPTHS * depth / width, _MIN_MAX_GRADIENT, _MAX_GRADIENT))


def limit_gradient(
    level: Float64Array, arc: Float64Array, *, width: Float64Array, depth: Float64Array
) -> Float64Array:
    """Limit the gradient, cutting gorges if need be: the wider and the shallower a river, the less it falls.

    At most 1.2 depths over a width, and 0.6 m per metre: beside a wide water surface that is steeper no bank
    is possible.
    """
    limit_per_metre = gradient_limit(width, depth)
    steps = 0.5 * (limit_per_metre[1:] + limit_per_metre[:-1]) * np.diff(arc)
    most = np.concatenate([[0.0], np.cumsum(steps)])
    limit = np.minimum.accumulate((level + most)[::-1])[::-1] - most
    return np.asarray(np.where(level > limit + 1e-9, limit, level))  # the end is bit-equal


def join_level(level: Float64Array, arc: Float64Array, *, end: float, width: float) -> Float64Array:
    """Bend a falling water level so that it ends exactly at `end` and still falls all the way.

    It is raised where it is lower; where it would end too high it falls over the last 30 widths.
    """
    left = arc[-1] - arc
    level = np.maximum(level, end + MIN_GRADIENT * left)
    approach = smoothstep(1.0 - left / max(min(30.0 * width, float(arc[-1])), 1e-9))
    level = level - (level[-1] - end) * approach
    level[-1] = end
    return np.asarray(np.minimum.accumulate(level))


def level_pool(level: Float64Array, arc: Float64Array, first: float, last: float) -> Float64Array:
    """Level the water between two arc lengths (m) at its height at the lower end.

    Upstream of the pool, over four times its length, the river falls as much as before and that much earlier.
    """
    first, last = max(first, 0.0), min(last, float(arc[-1]))
    if not first < last:
        return level
    start = max(first - 4.0 * (last - first), 0.0)
    earlier = last - (first - np.clip(arc, start, first)) * (last - start) / max(first - start, 1e-9)
    moved = np.interp(np.where(arc < first, earlier, last), arc, level)
    pool = float(np.interp(last, arc, level)) + MIN_GRADIENT * (last - arc)
    inside = (arc >= start) & (arc <= last)
    return np.asarray(np.where(inside, np.minimum(level, np.maximum(moved, pool)), level))


@dataclass(frozen=True, eq=False)
class Bends:
    """Points whose bank belongs to a point further down."""

    upper: npt.NDArray[np.intp]  # (k,) points of a centreline
    lower: Float64Array  # (k,) fractional point further down whose bank is beside each
    off: Float64Array  # (k,) distance of the bank from that point, in half widths there


def lower_in_bends(level: Float64Array, arc: Float64Array, bends: Bends, depth: Float64Array) -> Float64Array:
    """Lower the water above sharp bends, so that it is not above its own bank further down.

    A bank is up to a quarter of the `depth` (m) high, and less near the water's edge.
    """
    before = np.minimum(bends.lower.astype(np.intp), len(level) - 2)
    share = bends.lower - before
    same = before == bends.upper
    bank = np.minimum(0.25, 0.5 * smoothstep((bends.off - 1.0) / 0.8)) * depth[bends.upper]
    run = np.interp(bends.lower, np.arange(len(arc)), arc) - arc[bends.upper]
    bank = np.maximum(bank, 1.1 * MIN_GRADIENT * run)  # at least the fall of the water in between
    for _ in range(_BEND_ROUNDS if len(share) else 0):
        between = (1.0 - share) * level[before] + share * level[before + 1]
        # Within one piece the point further down falls with the point itself.
        most = np.where(same, level[before + 1] + bank / np.maximum(share, 1e-9), between + bank)
        if (level[bends.upper] <= most + 1e-6).all():
            break
        lowered = level + MIN_GRADIENT * arc
        np.minimum.at(lowered, bends.upper, most + MIN_GRADIENT * arc[bends.upper])
        lowered = np.minimum.accumulate(lowered) - MIN_GRADIENT * arc
        level = np.where(level > lowered + 1e-9, lowered, level)  # the rest is bit-equal
    return level


def _blurred(values: Float64Array, sigma: float) -> Float64Array:
    return smoothed(values[:, None], max(sigma, 1e-3))[:, 0]


_BED_RATIO = 0.25  # of the mean of two widths: within it one bed is visible in the other's centreline


@dataclass(frozen=True, eq=False)
class Confluence:
    """Overlap of a tributary's water with the stem's: one pool of one level; lengths in m."""

    length: float  # of the tributary above its end
    above: float  # of the stem above the joint
    below: float  # of the stem below the joint
    bed: tuple[float, float]  # the same for where the stem's bed is visible in the tributary's centreline
    nearest: npt.NDArray[np.intp]  # (m,) points of the stem nearest to the tributary's …
    off: Float64Array  # (m,) … and their distances, half widths of the stem


@dataclass(frozen=True, eq=False)
class Network:
    """Courses and what follows from their shapes alone."""

    courses: Sequence[RiverCourse]  # parents first
    parents: Sequence[int]  # index of the course that each joins, -1 for none
    arcs: Sequence[Float64Array]  # (m,) each, m from the spring
    widths: Sequence[Float64Array]  # (m,) each, m, with tributaries, swings and neighbours accounted for
    swings: Sequence[Float64Array]  # (m,) each, see `width_swing`; they do not change the depth
    confluences: Sequence[Confluence | None] = ()
    bends: Sequence[Bends] = ()
    # point runs (valleys through mountains) below the chord between the points before and after
    cuts: Sequence[Sequence[tuple[int, int]]] = ()

    def joining(self, number: int) -> list[int]:
        """Return the indices of the courses that join one."""
        return [other for other, parent in enumerate(self.parents) if parent == number]


def build_network(courses: Sequence[RiverCourse], run: Runner) -> Network:
    """Compute river widths, confluences and bends, without cuts; `courses` have parents first."""
    number_of = {course.id: number for number, course in enumerate(courses)}
    parents = [-1 if course.parent is None else number_of[course.parent.id] for course in courses]
    arcs = [arc_length(course.line) for course in courses]
    widths: list[Float64Array] = [course.width for course in courses]
    for number in reversed(range(len(courses))):
        course = courses[number]
        tributaries = [
            (courses[other].joint, float(widths[other][-1]))
            for other, parent in enumerate(parents)
            if parent == number
        ]
        if course.grows:
            widths[number] = river_widths(course.width, arcs[number], course.taper, tributaries)
    swings = [
        width_swing(course.line, arc, width) if course.grows and course.label else np.ones(len(arc))
        for course, arc, width in zip(courses, arcs, widths, strict=True)
    ]
    widths = [width * swing for width, swing in zip(widths, swings, strict=True)]
    network = Network(courses, parents, arcs, widths, swings)
    network = replace(network, confluences=[_confluence(network, number) for number in range(len(courses))])
    widths = _narrow_neighbours(network)
    bends = [
        run(_bends, course.line, arc, width) for course, arc, width in zip(courses, arcs, widths, strict=True)
    ]
    return replace(network, widths=widths, bends=bends)


def _bends(line: Float64Array, arc: Float64Array, width: Float64Array) -> Bends:
    """Return where the bank of a river, up to 1.6 widths away, is nearest to a point further down."""
    ahead = np.diff(line, axis=0)
    across = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1) / np.hypot(*ahead.T)[:, None]
    # The normal at a point turns from the piece before it to the one after it.
    points = np.arange(len(line))
    normals = np.stack([across[np.maximum(points - 1, 0)], across[np.minimum(points, len(line) - 2)]])
    most = 2 * len(_BANKS) * len(line)
    upper, lower, off = np.empty(most, np.int64), np.empty(most), np.empty(most)
    scratch = np.empty((4 * len(line), 2))
    given = (np.ascontiguousarray(each, np.float64) for each in (line, arc, width, normals, _BANKS))
    count = host_function("nearest_below")(*given, _BEND_REACH, upper, lower, off, scratch)
    return Bends(upper[:count], lower[:count], off[:count])


def _confluence(network: Network, number: int) -> Confluence | None:
    """Return a tributary's last run in which its water overlaps its parent's; None of a stem."""
    stem = network.parents[number]
    if stem < 0:
        return None
    course, arc, width = network.courses[number], network.arcs[number], network.widths[number]
    parent, parent_arc, parent_width = network.courses[stem], network.arcs[stem], network.widths[stem]
    result: Any = cKDTree(parent.line).query(course.line)
    distance, nearest = (np.asarray(part) for part in result)
    reach, upper = 0.55 * (width + parent_width[nearest]), nearest
    # Points of the stem farther apart than both are wide: all of a piece is level.
    ahead, length = np.diff(parent.line, axis=0), np.diff(parent_arc)
    for piece in np.clip([nearest - 1, nearest], 0, len(length) - 1):
        offset = course.line - parent.line[piece]
        share = np.clip((offset * ahead[piece]).sum(axis=1) / length[piece] ** 2, 0.0, 1.0)
        gap = np.hypot(*(offset - share[:, None] * ahead[piece]).T)
        beside = (gap < reach) & (distance >= reach) & (length[piece] > 2.0 * reach)
        distance, upper = np.where(beside, gap, distance), np.where(beside, piece, upper)
    apart = np.flatnonzero(distance >= reach)
    first = int(apart[-1]) + 1 if len(apart) else 0
    along = parent_arc[upper[first:]] - parent_arc[course.joint]
    margin = 0.5 * float(parent_width[course.joint]) + 0.5 * float(width[-1])
    bed_range = _BED_RATIO * np.sqrt(width * parent_width[nearest])[first:]
    in_bed = along[distance[first:] < bed_range]
    return Confluence(
        length=max(float(arc[-1] - arc[min(first, len(arc) - 1)]), margin),
        above=max(-float(along.min(initial=0.0)), 0.0) + margin,
        below=max(float(along.max(initial=0.0)), 0.0) + margin,
        bed=(
            max(-float(in_bed.min(initial=0.0)), 0.0) + float(bed_range[-1]),
            max(float(in_bed.max(initial=0.0)), 0.0) + float(bed_range[-1]),
        ),
        nearest=nearest,
        off=distance / (0.5 * parent_width[nearest]),
    )


def _narrow_neighbours(network: Network) -> list[Float64Array]:
    """Return widths, less where the waters of rivers would overlap away from confluences."""
    courses, widths = network.courses, network.widths
    boxes = [
        (course.line.min(axis=0) - width.max(), course.line.max(axis=0) + width.max())
        for course, width in zip(courses, widths, strict=True)
    ]
    trees = [cKDTree(course.line) for course in courses]
    scales: list[Float64Array] = [np.ones(len(course.line)) for course in courses]
    for number, course in enumerate(courses):
        for other, tree in enumerate(trees):
            if other == number or (boxes[number][0] > boxes[other][1]).any():
                continue
            if (boxes[number][1] < boxes[other][0]).any():
                continue
            # Beyond this distance nothing is narrowed.
            widest = 0.5 * float(widths[number].max() + widths[other].max())
            low, high = boxes[other]
            checked = _apart(network, number, other)
            checked &= ((course.line >= low - widest) & (course.line <= high + widest)).all(axis=1)
            if not checked.any():
                continue
            result = tree.query(course.line[checked], distance_upper_bound=1.01 * widest)
            distance, nearest = (np.asarray(part) for part in result)
            found = np.isfinite(distance)
            checked[checked], distance, nearest = found, distance[found], nearest[found]
            total = 0.5 * (widths[number][checked] + widths[other][nearest])
            counts = _apart(network, other, number)[nearest]
            scale = np.where(counts, np.clip(distance / total, 0.05, 1.0), 1.0)
            scales[number][checked] = np.minimum(scales[number][checked], scale)
    return [
        width * _smooth_transition(scale, arc, float(width.max()))
        for width, scale, arc in zip(widths, scales, network.arcs, strict=True)
    ]


def _apart(network: Network, number: int, other: int) -> npt.NDArray[np.bool_]:
    """Return which points of a course lie outside its confluences with the other one's family."""
    arc, parents = network.arcs[number], network.parents
    away, own = np.ones(len(arc), dtype=np.bool_), network.confluences[number]
    if own is not None and (parents[number] == other or parents[other] == parents[number]):
        away &= arc < arc[-1] - own.length
    met = network.confluences[other]
    if met is not None and parents[other] == number:
        joint = arc[network.courses[other].joint]
        away &= (arc < joint - met.above) | (arc > joint + met.below)
    return away


def _smooth_transition(scale: Float64Array, arc: Float64Array, width: float) -> Float64Array:
    """Let a narrow place begin some widths before it and end some widths after it."""
    narrow = np.flatnonzero(scale < 1.0)
    if not len(narrow):
        return scale
    slope = 0.15 / width
    fore = np.minimum.accumulate(scale - slope * arc) + slope * arc
    back = np.minimum.accumulate((scale + slope * arc)[::-1])[::-1] - slope * arc
    return np.asarray(np.minimum(np.minimum(fore, back), 1.0))
