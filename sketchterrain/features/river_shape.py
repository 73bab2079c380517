"""What follows from the shapes of a network's courses alone: widths, confluences, bends."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.features.recent import IdentityKey
from sketchterrain.features.river_path import arc_length
from sketchterrain.features.river_profile import Bends, river_widths
from sketchterrain.features.water_memory import HydrologyCache

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.features.river_course import RiverCourse


_SHOWS = 0.25  # of two rivers' widths' mean: so near, the bed of one shows in the other's centreline


@dataclass(frozen=True, eq=False)
class Confluence:
    """Where a tributary's water overlaps the stem's: one pool of one level.

    Attributes
    ----------
    length : float
        Metres of the tributary above its end.
    above, below : float
        Metres of the stem above and below the joint.
    bed : (float, float)
        The same for where the stem's bed shows in the tributary's centreline: the two must be one there.
    """

    length: float
    above: float
    below: float
    bed: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Network:
    """Courses with what follows from their shapes alone.

    Attributes
    ----------
    courses : sequence of RiverCourse
        Parents before the courses that join them.
    parents : sequence of int
        Index of the course that each joins; -1 for none.
    arcs : sequence of (m,) float64
        Metres from each spring.
    widths : sequence of (m,) float64
        Metres, with tributaries counted and neighbours candidate_influence.
    confluences : sequence of Confluence or None
    bends : sequence of Bends
    cuts : sequence of sequences of (first, last)
        Runs of points in which neither water nor bed may lie above the straight line from the point before
        to the point after: valleys through mountains.
    """

    courses: Sequence[RiverCourse]
    parents: Sequence[int]
    arcs: Sequence[Float64Array]
    widths: Sequence[Float64Array]
    confluences: Sequence[Confluence | None]
    bends: Sequence[Bends]
    cuts: Sequence[Sequence[tuple[int, int]]]

    def joining(self, number: int) -> list[int]:
        """Return the indices of the courses that join one."""
        return [other for other, parent in enumerate(self.parents) if parent == number]


def build_network(
    courses: Sequence[RiverCourse],
    cuts: Sequence[Sequence[tuple[int, int]]],
    memory: HydrologyCache | None = None,
) -> Network:
    """Work out how wide rivers are, and where their waters overlap.

    Parameters
    ----------
    courses : sequence of RiverCourse
        Of any number of networks; parents before the courses that join them.
    cuts : sequence of sequences of (first, last)
        As in `Network`.
    memory : HydrologyCache, optional
        Of bends.
    """
    memory = HydrologyCache() if memory is None else memory
    number_of = {id(course): number for number, course in enumerate(courses)}
    parents = [-1 if course.parent is None else number_of[id(course.parent)] for course in courses]
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
    confluences: list[Confluence | None] = [
        None
        if parent < 0
        else _meeting(course, courses[parent], arcs[n], arcs[parent], widths[n], widths[parent])
        for n, (course, parent) in enumerate(zip(courses, parents, strict=True))
    ]
    widths = _beside_neighbours(courses, parents, arcs, widths, confluences)
    bends = [
        memory.parts.of(
            ("bends", IdentityKey(course), blake2b(width.tobytes()).digest()),
            partial(_bends, course.line, arc, width),
        )
        for course, arc, width in zip(courses, arcs, widths, strict=True)
    ]
    return Network(courses, parents, arcs, widths, confluences, bends, cuts)


def _bends(line: Float64Array, arc: Float64Array, width: Float64Array) -> Bends:
    """Find where the ground beside a river, up to 1.6 widths away, is nearest to a place further down."""
    ahead = np.diff(line, axis=0)
    across = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1) / np.hypot(*ahead.T)[:, None]
    count = len(line)
    fine = np.arange(4 * count - 3) / 4.0
    tree = cKDTree(np.stack([np.interp(fine, np.arange(count), line[:, i]) for i in (0, 1)], axis=-1))
    half = 0.5 * np.interp(fine, np.arange(count), width)
    upper, lower, off = [], [], []
    points = np.arange(count)
    # What lies beside a point turns from the piece before it to the one after it.
    for widths, normal in itertools.product(
        (-1.6, -1.5, -1.0, 1.0, 1.5, 1.6),
        (across[np.maximum(points - 1, 0)], across[np.minimum(points, count - 2)]),
    ):
        answer: Any = tree.query(line + widths * width[:, None] * normal)
        distance, found = (np.asarray(part) for part in answer)
        place = np.minimum((found + 1) / 4.0, count - 1.0)
        run = np.interp(place, points, arc) - arc
        below = np.flatnonzero((place > points + 0.25) & (run < 4.0 * width))
        upper.append(below)
        lower.append(place[below])
        off.append((distance / half[found])[below])
    return Bends(np.concatenate(upper), np.concatenate(lower), np.concatenate(off))


def _meeting(
    course: RiverCourse,
    parent: RiverCourse,
    arc: Float64Array,
    parent_arc: Float64Array,
    width: Float64Array,
    parent_width: Float64Array,
) -> Confluence:
    """Find the tributary's last run in which its water overlaps its parent's."""
    answer: Any = cKDTree(parent.line).query(course.line)
    distance, nearest = (np.asarray(part) for part in answer)
    overlap = distance < 0.55 * (width + parent_width[nearest])
    apart = np.flatnonzero(~overlap)
    first = int(apart[-1]) + 1 if len(apart) else 0
    along = parent_arc[nearest[first:]] - parent_arc[course.joint]
    margin = 0.5 * float(parent_width[course.joint]) + 0.5 * float(width[-1])
    shows = _SHOWS * np.sqrt(width * parent_width[nearest])[first:]
    shown = along[distance[first:] < shows]
    return Confluence(
        length=max(float(arc[-1] - arc[min(first, len(arc) - 1)]), margin),
        above=max(-float(along.min(initial=0.0)), 0.0) + margin,
        below=max(float(along.max(initial=0.0)), 0.0) + margin,
        bed=(
            max(-float(shown.min(initial=0.0)), 0.0) + float(shows[-1]),
            max(float(shown.max(initial=0.0)), 0.0) + float(shows[-1]),
        ),
    )


def _beside_neighbours(
    courses: Sequence[RiverCourse],
    parents: Sequence[int],
    arcs: Sequence[Float64Array],
    widths: Sequence[Float64Array],
    confluences: Sequence[Confluence | None],
) -> list[Float64Array]:
    """Narrow rivers where their waters would overlap elsewhere than where they meet."""
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
            # Further apart than this nobody is narrowed, so nobody farther is looked for.
            widest = 0.5 * float(widths[number].max() + widths[other].max())
            low, high = boxes[other]
            asked = _apart(number, other, parents, arcs, courses, confluences)
            asked &= ((course.line >= low - widest) & (course.line <= high + widest)).all(axis=1)
            if not asked.any():
                continue
            answer = tree.query(course.line[asked], distance_upper_bound=1.01 * widest)
            distance, nearest = (np.asarray(part) for part in answer)
            found = np.isfinite(distance)
            asked[asked], distance, nearest = found, distance[found], nearest[found]
            total = 0.5 * (widths[number][asked] + widths[other][nearest])
            counts = _apart(other, number, parents, arcs, courses, confluences)[nearest]
            scale = np.where(counts, np.clip(distance / total, 0.05, 1.0), 1.0)
            scales[number][asked] = np.minimum(scales[number][asked], scale)
    return [
        width * _softened(scale, arc, float(width.max()))
        for width, scale, arc in zip(widths, scales, arcs, strict=True)
    ]


def _apart(
    number: int,
    other: int,
    parents: Sequence[int],
    arcs: Sequence[Float64Array],
    courses: Sequence[RiverCourse],
    confluences: Sequence[Confluence | None],
) -> npt.NDArray[np.bool_]:
    """Points of a course that lie outside every confluence that it shares with the other one's family."""
    arc, away = arcs[number], np.ones(len(arcs[number]), dtype=np.bool_)
    own = confluences[number]
    if own is not None and (parents[number] == other or parents[other] == parents[number]):
        away &= arc < arc[-1] - own.length
    met = confluences[other]
    if met is not None and parents[other] == number:
        joint = arc[courses[other].joint]
        away &= (arc < joint - met.above) | (arc > joint + met.below)
    return away


def _softened(scale: Float64Array, arc: Float64Array, width: float) -> Float64Array:
    """Let a narrow place begin some widths before it and end some widths after it."""
    narrow = np.flatnonzero(scale < 1.0)
    if not len(narrow):
        return scale
    slope = 0.15 / width
    fore = np.minimum.accumulate(scale - slope * arc) + slope * arc
    back = np.minimum.accumulate((scale + slope * arc)[::-1])[::-1] - slope * arc
    return np.asarray(np.minimum(np.minimum(fore, back), 1.0))
