"""Water levels and beds of a river network, consistent where reaches meet."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.landforms.hydrology.courses import RiverCourse, depth_ratio
from sketchterrain.landforms.hydrology.river_shape import (
    MIN_GRADIENT,
    Confluence,
    Network,
    bank_sway,
    join_level,
    level_pool,
    limit_gradient,
    lower_in_bends,
    water_surface,
)
from sketchterrain.landforms.placement.feature_types import River, smoothstep

_MAX_GROWTH = 2.0  # widening that still deepens a river, times the label's width
_ROUNDS = 8
_MIN_DEPTH = 0.05  # m, of water
_DEEPER = 0.005  # m: a bed that leans in a bend is no parabola: half of this is above it
_DEEPEST = 0.6  # widths: a tributary's bed goes no deeper to meet its stem's but in the stem's water


@dataclass(frozen=True, eq=False)
class LakeReach:
    """Run of a course in or beside a lake."""

    shore: int  # point where the lake's rim begins: from here on no water is above the lake
    first: int  # first point inside the lake; if the course only passes by, where it leaves the rim
    last: int  # last point inside the lake; `first` - 1 if the course only passes by
    level: float  # m


def solve_water_levels(
    network: Network, grounds: Sequence[Float64Array], still: Sequence[Sequence[LakeReach]]
) -> list[Float64Array]:
    """Return water levels from the springs down: falling all the way, never above tributaries, flat in lakes.

    `grounds` (m,) each are terrain heights (m) along the centrelines, `still` the lake reaches, upstream
    first.
    """
    courses, arcs = network.courses, network.arcs
    levels: list[Float64Array] = list(grounds)
    for number in reversed(range(len(courses))):
        course, joining = courses[number], network.joining(number)
        level = water_surface(
            grounds[number],
            arcs[number],
            width=float(course.width.mean()),
            depth=float(course.depth.mean()),
            ceilings=[(courses[other].joint, float(levels[other][-1])) for other in joining],
        )
        level = limit_gradient(level, arcs[number], width=network.widths[number], depth=course.depth)
        levels[number] = _through_lakes(level, arcs[number], still[number], float(course.width.mean()))
    return levels


def join_water_levels(network: Network, falling: Sequence[Float64Array]) -> list[Float64Array]:
    """Join tributaries to their stems; level pools at confluences and bends; cut through mountains."""
    courses, arcs, levels = network.courses, network.arcs, list(falling)
    for number, course in enumerate(courses):
        arc, parent, meeting = arcs[number], network.parents[number], network.confluences[number]
        level = levels[number]
        if parent >= 0 and meeting is not None:
            width = float(course.width.mean())
            level = join_level(level, arc, end=float(levels[parent][course.joint]), width=width)
            level = level_pool(level, arc, float(arc[-1]) - meeting.length, float(arc[-1]))
        level = limit_gradient(level, arc, width=network.widths[number], depth=course.depth)
        level = _confine(network, number, level)
        # From the mouth upward: a pool shifts the fall above it upstream.
        for other in sorted(network.joining(number), key=lambda each: -courses[each].joint):
            confluence = network.confluences[other]
            if confluence is not None:
                joint = float(arc[courses[other].joint])
                level = level_pool(level, arc, joint - confluence.above, joint + confluence.below)
        level = _confine(network, number, level)
        levels[number] = _below_chord(level, arc, network.cuts[number])
    return levels


def _confine(network: Network, number: int, level: Float64Array) -> Float64Array:
    """Lower water that no bank confines: in sharp bends, and where they make it fall too steeply."""
    course, arc = network.courses[number], network.arcs[number]
    for _ in range(_ROUNDS):
        previous = level
        level = lower_in_bends(level, arc, network.bends[number], course.depth)
        level = limit_gradient(level, arc, width=network.widths[number], depth=course.depth)
        if np.array_equal(level, previous):
            break
    return level


def _through_lakes(
    level: Float64Array, arc: Float64Array, still: Sequence[LakeReach], width: float
) -> Float64Array:
    for lake in still:
        level = level.copy()
        rim = slice(lake.shore, lake.first)
        if lake.shore < lake.first and level[lake.shore] > lake.level:
            first = min(lake.first, len(arc) - 1)
            level[rim] = np.minimum(level[rim], lake.level + MIN_GRADIENT * (arc[first] - arc[rim]))
            if lake.shore > 0:
                above = slice(0, lake.shore + 1)
                level[above] = join_level(level[above], arc[above], end=float(level[lake.shore]), width=width)
        level[lake.first : lake.last + 1] = lake.level
        level[lake.last + 1 :] = np.minimum(level[lake.last + 1 :], lake.level)
    return np.asarray(np.minimum.accumulate(level))


def _below_chord(values: Float64Array, arc: Float64Array, runs: Sequence[tuple[int, int]]) -> Float64Array:
    """Lower each run to the chord between the points before and after it."""
    for first, last in runs:
        if first > 0 and last < len(values) - 1:
            ends = [first - 1, last + 1]
            inside = slice(first, last + 1)
            chord = np.interp(arc[inside], arc[ends], values[ends])
            values = values.copy()
            values[inside] = np.minimum(values[inside], chord)
    return values


def build_rivers(network: Network, levels: Sequence[Float64Array]) -> list[River]:
    """Return each reach with its bed: never rising, and the stem's own where a tributary ends."""
    beds: list[Float64Array] = []
    rivers = []
    for number, (course, width, swing, level) in enumerate(
        zip(network.courses, network.widths, network.swings, levels, strict=True)
    ):
        depth = course.depth * depth_ratio(np.minimum(width / swing / course.width, _MAX_GROWTH))
        bed = np.minimum.accumulate(level - depth)
        parent, meeting = network.parents[number], network.confluences[number]
        bed_width = width
        if parent >= 0 and meeting is not None:
            end, arc = float(beds[parent][course.joint]), network.arcs[number]
            bed = np.maximum(bed, end)
            if level[-1] - end > _DEEPEST * width[-1]:
                under, deep = _in_stem(network, number, meeting)
                at = meeting.nearest[under]
                depth = (levels[parent] - beds[parent])[at] * deep + _DEEPER
                bed[under] = np.minimum(bed[under], levels[parent][at] - depth)
                bed_width = width.copy()
                bed_width[under] = np.maximum(width[under], network.widths[parent][at])
            else:
                bed += (end - bed) * smoothstep((arc - arc[-1] + 2.0 * meeting.length) / meeting.length)
        bed = _level_bed(network, number, np.minimum.accumulate(bed))
        bed = _below_chord(bed, network.arcs[number], network.cuts[number])
        bed = np.minimum(bed, level - _MIN_DEPTH)
        beds.append(bed)
        river = _create_river(course, width, swing, level, level - bed)
        rivers.append(river if bed_width is width else replace(river, bed_width=bed_width.astype(np.float32)))
    return rivers


def _in_stem(network: Network, number: int, meeting: Confluence) -> tuple[slice, Float64Array]:
    """Return the last points of a tributary, in its stem's water, and the stem's share of its depth there."""
    parent = network.parents[number]
    line, arc, width = network.courses[parent].line, network.arcs[parent], network.widths[parent]
    sway = (
        np.abs(bank_sway(line, arc, width)) if (network.swings[parent] != 1.0).any() else np.zeros(len(arc))
    )
    share = np.maximum(1.0 - np.square(meeting.off / (1.0 + sway[meeting.nearest])), 0.0)
    under = slice(len(share) - (int(np.argmax(share[::-1] == 0.0)) or len(share)), None)
    return under, share[under]


def _level_bed(network: Network, number: int, bed: Float64Array) -> Float64Array:
    """Level a river's bed at confluences: else the tributaries' would rise at their ends to meet it."""
    arc = network.arcs[number]
    # From the mouth upward, as for levels.
    for other in sorted(network.joining(number), key=lambda each: -network.courses[each].joint):
        meeting, joint = network.confluences[other], float(arc[network.courses[other].joint])
        if meeting is not None:
            bed = level_pool(bed, arc, joint - meeting.bed[0], joint + meeting.bed[1])
    return bed


def _create_river(
    course: RiverCourse, width: Float64Array, swing: Float64Array, level: Float64Array, depth: Float64Array
) -> River:
    line = np.column_stack([course.line, level])
    widths, depths = width.astype(np.float32), depth.astype(np.float32)
    return River(
        id=course.id,
        label=course.label,
        points=line[course.controls],
        width=widths[course.controls],
        depth=depths[course.controls],
        centreline=line,
        centreline_width=widths,
        centreline_depth=depths,
        mean_width=(width / swing).astype(np.float32)[course.controls] if (swing != 1.0).any() else None,
    )
