"""Mouths in the sea: courses end where the ground falls below its level, and reach that level."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.document.layers import id_of_vector
from sketchterrain.landforms.hydrology.conflicts import Resolution
from sketchterrain.landforms.hydrology.courses import RiverCourse, arc_length, part_of_course
from sketchterrain.landforms.hydrology.lakes import index_runs
from sketchterrain.landforms.hydrology.river_shape import MIN_GRADIENT, Network, bank_height, smoothstep
from sketchterrain.landforms.hydrology.water_levels import LakeReach
from sketchterrain.landforms.placement.feature_types import LAYER_CODES, Lake, River
from sketchterrain.landforms.placement.shapes import label_shapes

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_STRAIT = 1 / 24  # of the sketch's extent: a river does not continue beyond a wider arm of the sea
_BEYOND_SHORE = 1 / 128  # of the extent, and at least …
_BEYOND_SHORE_WIDTHS = 3.0  # … of the river: how far a course continues into the sea
_ESTUARY_WIDTHS = 14.0  # length over which a river widens towards its mouth
_WIDENING = 1.0  # of its width, at its mouth
_TIDAL_WIDTHS = 4.0  # length before the shore over which the water is already at the level of the sea


class CoursesToSea(NamedTuple):
    """Courses that end at the coast."""

    courses: list[RiverCourse]  # parents first
    at_sea: frozenset[int] = frozenset()  # ids of those that end in the sea
    drowned: tuple[Float64Array, ...] = ()  # a position (m) of each painted course that lies in the sea
    beyond: frozenset[int] = frozenset()  # ids of those that were painted on beyond an arm of the sea


def end_in_sea(
    courses: Sequence[RiverCourse], grounds: Sequence[Float64Array], level: float, extent: float
) -> CoursesToSea:
    """Cut courses where they enter the sea; `grounds` (m,) each are terrain heights (m) along them.

    What lies downstream of an arm of the sea is left out, as is a head in the sea. A tributary that meets its
    parent in the sea becomes a river of its own. Courses without sea are the identical objects.
    """
    # By id: the new one, and the first and last point that are left.
    left: dict[int, tuple[RiverCourse | None, int, int]] = {}
    at_sea, beyond, drowned = set(), set(), []
    for course, ground in zip(courses, grounds, strict=True):
        first, last, mouth = _dry_part(course, ground < level, extent)
        if last - first < 2:
            left[course.id] = None, 0, 0
            if course.label:
                drowned.append(course.line[len(course.line) // 2])
            continue
        part = part_of_course(course, first, last)
        parent, joint = course.parent, course.joint
        if parent is not None:
            new, begin, end = left[parent.id]
            if new is None or mouth or not begin <= joint < end:
                parent, joint = None, -1
            else:
                parent, joint = new, joint - begin
        if parent is not course.parent or joint != course.joint:
            part = dataclasses.replace(part, parent=parent, joint=joint)
        if mouth:
            part = _widened(part)
            at_sea.add(course.id)
            if (ground[last:] > level).any():
                beyond.add(course.id)
        left[course.id] = part, first, last
    kept = [left[course.id][0] for course in courses]
    return CoursesToSea(
        [each for each in kept if each is not None], frozenset(at_sea), tuple(drowned), frozenset(beyond)
    )


def _dry_part(course: RiverCourse, wet: BoolArray, extent: float) -> tuple[int, int, bool]:
    """Return the first point of a course on land, its last one, exclusive, and whether it is in the sea."""
    arc, count = arc_length(course.line), len(wet)
    first = 0
    for start, stop in index_runs(wet):
        is_end = stop == count - 1
        if start == 0:
            first = count if is_end else stop
        elif is_end or arc[stop] - arc[start] > _STRAIT * extent:
            beyond = max(_BEYOND_SHORE * extent, _BEYOND_SHORE_WIDTHS * float(course.width[start]))
            return first, min(int(np.searchsorted(arc, arc[start] + beyond)), stop) + 1, True
    return first, count, False


def _widened(course: RiverCourse) -> RiverCourse:
    """Widen a course towards its mouth."""
    arc = arc_length(course.line)
    length = min(_ESTUARY_WIDTHS * float(course.width[-1]), 0.5 * float(arc[-1]))
    wide = 1.0 + _WIDENING * smoothstep((arc - arc[-1] + length) / length)
    return dataclasses.replace(course, width=course.width * wide)


def tidal_reaches(course: RiverCourse, ground: Float64Array, level: float) -> tuple[LakeReach, ...]:
    """Return the reach at the level of the sea (m) at a course's end, if that is in the sea."""
    runs = index_runs(ground < level)
    if not runs or runs[-1][1] != len(ground) - 1 or runs[-1][0] == 0:
        return ()
    first, last = runs[-1]
    arc = arc_length(course.line)
    tidal = _TIDAL_WIDTHS * float(course.width[first])
    shore = int(np.searchsorted(arc, arc[first] - min(tidal, 0.5 * float(arc[first]))))
    return (LakeReach(min(shore, first), first, last, level),)


def above_sea(network: Network, grounds: Sequence[Float64Array], level: float) -> list[Float64Array]:
    """Return heights (m) along courses, raised where water on them could not run down to the sea."""
    rest: list[float] = []  # m from each course's spring to the end of its stem
    raised = []
    for course, parent, arc, ground in zip(
        network.courses, network.parents, network.arcs, grounds, strict=True
    ):
        beyond = rest[parent] - float(network.arcs[parent][course.joint]) if parent >= 0 else 0.0
        rest.append(float(arc[-1]) + beyond)
        lowest = level + bank_height(float(course.depth.mean())) + MIN_GRADIENT * (rest[-1] + 1.0)
        raised.append(np.maximum(ground, lowest))
    return raised


def sea_resolutions(
    sketch: Sketch, level: float, to_sea: CoursesToSea, rivers: Sequence[River], lakes: Sequence[Lake]
) -> tuple[Resolution, ...]:
    """Describe where rivers end in the sea, and which paint in it is ignored, in one line each.

    `rivers` are sorted by id and counted from 1.
    """
    found = []
    for number, river in enumerate(rivers, 1):
        if river.id in to_sea.at_sea:
            x, y = (float(each) for each in river.centreline[-1, :2])
            more = "; its course beyond it is ignored" if river.id in to_sea.beyond else ""
            found.append(Resolution(f"river {number} ends in the sea: water at {level:.1f} m{more}", x, y))
    for x, y in to_sea.drowned:
        found.append(Resolution("a river painted in the sea is ignored", float(x), float(y)))
    laid = {lake.id for lake in lakes} | {edit.feature for edit in sketch.edits if edit.action == "delete"}
    for shape in label_shapes("lake", sketch.layers["lake"]):
        if LAYER_CODES["lake"] << 48 | shape.id not in laid:
            x, y = shape.centre[1] + 0.5, sketch.height_px - shape.centre[0] - 0.5
            at = (x * sketch.pixel_size, y * sketch.pixel_size)
            found.append(Resolution("a lake painted in the sea is ignored", *at))
    areas = sketch.vectors["lake"]
    for index, name in enumerate(areas.ids.tolist()):
        if id_of_vector("lake", name) not in laid:
            x, y = areas.ring(int(areas.parts[index])).mean(axis=0).tolist()
            found.append(Resolution("a lake drawn in the sea is ignored", x, y))
    return tuple(found)
