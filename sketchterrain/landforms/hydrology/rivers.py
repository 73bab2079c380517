"""Rivers, lakes and mouths in the sea: centrelines with width, depth and a falling water level."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.document.edits import Edit
from sketchterrain.geometry.splines import arc_length
from sketchterrain.landforms.hydrology.conflicts import (
    Resolution,
    canyon_resolutions,
    label_mountains,
    mountain_crossings,
    resolve_conflicts,
)
from sketchterrain.landforms.hydrology.courses import RiverCourse, course_through, part_of_course
from sketchterrain.landforms.hydrology.lakes import (
    index_runs,
    mouth_lakes,
    painted_lakes,
    solve_lake_levels,
    with_deltas,
)
from sketchterrain.landforms.hydrology.layout import (
    heights_at,
    ranges_beyond_edge,
    separate_beyond_edge,
    shortened,
)
from sketchterrain.landforms.hydrology.river_shape import MIN_GRADIENT, Network, bank_height, build_network
from sketchterrain.landforms.hydrology.streams import is_stream
from sketchterrain.landforms.hydrology.vector_layout import lay_out_lines, lay_out_painted
from sketchterrain.landforms.hydrology.water_levels import LakeReach, build_rivers
from sketchterrain.landforms.placement.feature_types import LAYER_CODES, GroundHeight, Lake, River, smoothstep
from sketchterrain.landforms.placement.sea import sea_level
from sketchterrain.landforms.placement.shapes import label_shapes
from sketchterrain.schema.layers import id_of_vector
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


_STRAIT = 1 / 24  # of the sketch's extent: a river does not continue beyond a wider arm of the sea
_BEYOND_SHORE = 1 / 128  # of the extent, and at least …
_BEYOND_SHORE_WIDTHS = 3.0  # … of the river: how far a course continues into the sea
_ESTUARY_WIDTHS = 14.0  # length over which a river widens towards its mouth
_WIDENING = 1.0  # of its width, at its mouth
_TIDAL_WIDTHS = 4.0  # length before the shore over which the water is already at the level of the sea
_ACTIONS = frozenset({"move_point", "width", "delete"})


def targets_river(edit: Edit) -> bool:
    """Return whether an edit names a river, by its action or by the layer in the id."""
    return edit.action in ("move_point", "width") or (edit.feature or 0) >> 48 == LAYER_CODES["river"]


def targets_lake(edit: Edit) -> bool:
    """Return whether an edit names a lake, by the layer in the id."""
    return not targets_river(edit) and (edit.feature or 0) >> 48 == LAYER_CODES["lake"]


def apply_lake_edits(lakes: list[Lake], edits: Iterable[Edit]) -> tuple[list[Lake], tuple[str, ...]]:
    """Return the lakes that the user did not delete, and one line for each edit whose lake is missing."""
    known = {lake.id for lake in lakes}
    deleted: set[int] = set()
    orphans = []
    for edit in filter(targets_lake, edits):
        if edit.action != "delete":
            orphans.append(f"{edit.action} of lake {edit.feature}: a lake supports only delete")
        elif edit.feature not in known:
            orphans.append(f"delete of lake {edit.feature}: no such lake")
        else:
            deleted.add(edit.feature)
    return [lake for lake in lakes if lake.id not in deleted], tuple(orphans)


def apply_river_edits(
    courses: list[RiverCourse], edits: Iterable[Edit]
) -> tuple[list[RiverCourse], tuple[str, ...]]:
    """Apply the user's edits to courses (parents first); return one line for each that can't be applied.

    A tributary of a moved river follows it; one of a deleted river becomes a river of its own.
    """
    by_id = {course.id: course for course in courses}
    edits_by_river: dict[int, list[Edit]] = {}
    controls = {course.id: np.array(course.line[course.controls]) for course in courses}
    orphans = []
    for edit in filter(targets_river, edits):
        name = edit.feature or 0
        error = _edit_error(by_id.get(name), controls.get(name), edit)
        if error:
            orphans.append(f"{edit.action} of river {name}: {error}")
            continue
        edits_by_river.setdefault(name, []).append(edit)
        if edit.action == "move_point":
            controls[name][_control(controls[name], edit)] = edit.x, edit.y
    if not edits_by_river:
        return courses, tuple(orphans)
    after: dict[int, RiverCourse | None] = {}
    for course in courses:
        own = edits_by_river.get(course.id, [])
        if any(edit.action == "delete" for edit in own):
            after[course.id] = None
        else:
            parent = None if course.parent is None else after[course.parent.id]
            after[course.id] = _apply_edits(course, parent, own, controls[course.id])
    return [course for course in after.values() if course is not None], tuple(orphans)


def _control(points: npt.NDArray[np.float64], edit: Edit) -> int | None:
    """Return the control point of an edit: the nearest to its old position, within one interval."""
    if edit.from_x is None:
        return edit.index if edit.index is not None and edit.index < len(points) else None
    away = np.hypot(*(points - [edit.from_x, edit.from_y]).T)
    nearest = int(np.argmin(away))
    beside = np.hypot(*np.diff(points[max(nearest - 1, 0) : nearest + 2], axis=0).T)
    return nearest if away[nearest] <= beside.max() else None


def _edit_error(course: RiverCourse | None, points: npt.NDArray[np.float64] | None, edit: Edit) -> str | None:
    if course is None or points is None:
        return "no such river"
    if edit.action not in _ACTIONS:
        return f"a river supports only {', '.join(sorted(_ACTIONS))}"
    if edit.action == "move_point" and _control(points, edit) is None:
        if edit.from_x is not None:
            return f"no control point near ({edit.from_x:.0f}, {edit.from_y:.0f}) m"
        return f"no control point {edit.index}: the river has {len(points)}"
    return None


def _apply_edits(
    course: RiverCourse, parent: RiverCourse | None, edits: list[Edit], points: npt.NDArray[np.float64]
) -> RiverCourse:
    joint = -1
    if parent is course.parent and np.array_equal(points, course.line[course.controls]):
        joint = course.joint
    elif parent is not None:
        joint = parent.joint_near(points[-1])
        points[-1] = parent.line[joint]
    grows = course.grows
    if not np.array_equal(points, course.line[course.controls]):
        sized = np.column_stack([points, course.width[course.controls], course.depth[course.controls]])
        course = course_through(sized, course.id, course.label, parent=None, joint=-1, taper=course.taper)
    widths = [edit.width for edit in edits if edit.action == "width"]
    width = np.full_like(course.width, widths[-1]) if widths else course.width
    return replace(course, parent=parent, joint=joint, width=width, grows=grows or bool(widths))


@dataclass(frozen=True, eq=False)
class WaterLayout:
    """Where rivers and lakes are, before the ground drains to them: courses and outlines without levels."""

    courses: tuple[RiverCourse, ...]  # parents first
    lakes: tuple[Lake, ...]  # painted ones in reading order, with provisional levels
    orphans: tuple[str, ...]  # one line for each edit that could not be applied


@dataclass(frozen=True, eq=False)
class Hydrology:
    """Rivers and lakes of a sketch."""

    rivers: tuple[River, ...]  # sorted by id
    lakes: tuple[Lake, ...]  # painted ones in reading order, then those at river mouths beyond the sketch
    resolutions: tuple[Resolution, ...]  # one for each conflict between layers
    orphans: tuple[str, ...]  # one line for each edit that could not be applied
    # (m,) each, terrain height without rivers along each river's centreline, m
    grounds: tuple[Float64Array, ...]


def lay_out_water(sketch: Sketch, *, seed: int, ground: GroundHeight, run: Runner) -> WaterLayout:
    """Return the courses of rivers and the outlines of lakes.

    Touching regions of any label are one network, and so is an end painted a few pixels short of another
    river's middle. A dab no longer than wide becomes a short straight reach. The mouth is the end where the
    `ground` is lowest (a coarse one will do), preferably at the sketch's edge, beyond which a river goes on
    for about a third of the sketch. A loop becomes two arms that part at its top and meet at its bottom.
    """
    level = sea_level(sketch)
    lakes = painted_lakes(sketch, ground, run, seed=seed, sea_level=level)
    drawn = lay_out_lines(sketch, seed=seed, ground=ground, run=run)
    painted = lay_out_painted(sketch, drawn, seed=seed, ground=ground, run=run)
    edits = [edit for edit in sketch.edits if not is_stream(edit.feature or 0)]
    courses, orphans = apply_river_edits([*drawn, *painted], edits)
    lakes, _ = apply_lake_edits(lakes, sketch.edits)
    return WaterLayout(tuple(run(separate_beyond_edge, courses, sketch.size)), tuple(lakes), orphans)


def solve_water(
    sketch: Sketch,
    layout: WaterLayout,
    *,
    seed: int,
    ground: GroundHeight,
    run: Runner,
    streams: Sequence[RiverCourse] = (),
) -> Hydrology:
    """Return rivers and lakes with their water levels on the `ground` that drains to them.

    Along each centreline the water falls by at least 1e-4 m per metre; a tributary's last point is a point of
    its stem's. `streams` are unpainted, and join painted rivers or each other, parents first.
    """
    level = sea_level(sketch)
    own = [edit for edit in sketch.edits if is_stream(edit.feature or 0)]
    all_courses, orphans = apply_river_edits([*layout.courses, *streams], own)
    to_sea = CoursesToSea(all_courses)
    if level is not None and to_sea.courses:
        courses = to_sea.courses
        grounds = heights_at(ground, [course.line for course in courses])
        to_sea = run(end_in_sea, courses, grounds, level, sketch.extent)
    courses, grounds = _shortened(sketch, to_sea, ground, run)
    lakes = painted_lakes(sketch, ground, run, seed=seed, sea_level=level)
    lakes = with_deltas(lakes, courses, seed=seed, run=run)
    mouths = mouth_lakes(sketch, courses, seed=seed, at_sea=to_sea.at_sea)
    lakes, lake_orphans = apply_lake_edits([*lakes, *mouths], sketch.edits)
    mountains = run(label_mountains, sketch.layers["mountain"], hashed=False)
    cuts = [
        [each[:2] for each in mountain_crossings(sketch, mountains, course.line)] if course.label else []
        for course in courses
    ]
    rivers, lakes, grounds = _solve_levels(courses, grounds, cuts, lakes, run, level)
    painted = [river for river in rivers if river.label]  # they come first
    resolutions = resolve_conflicts(sketch, mountains, painted, grounds[: len(painted)], lakes)
    resolutions += canyon_resolutions(sketch, painted, run)
    if level is not None:
        resolutions += sea_resolutions(sketch, level, to_sea, painted, lakes)
    orphans = layout.orphans + orphans + lake_orphans
    return Hydrology(tuple(rivers), tuple(lakes), resolutions, orphans, tuple(grounds))


def _shortened(
    sketch: Sketch, to_sea: CoursesToSea, ground: GroundHeight, run: Runner
) -> tuple[list[RiverCourse], list[Float64Array]]:
    """Return courses that end beyond the sketch where the ground does not let them on, and its heights."""
    courses = to_sea.courses
    if not courses:
        return [], []
    grounds = heights_at(ground, [course.line for course in courses])
    level = sea_level(sketch)
    dry = grounds if level is None else [np.maximum(each, level) for each in grounds]
    ranges = ranges_beyond_edge(courses, dry, sketch.size, to_sea.at_sea)
    return run(shortened, courses, ranges), [
        each[slice(*part)] for each, part in zip(grounds, ranges, strict=True)
    ]


def _solve_levels(
    courses: list[RiverCourse],
    grounds: list[Float64Array],
    cuts: list[list[tuple[int, int]]],
    lakes: list[Lake],
    run: Runner,
    sea_level: float | None,
) -> tuple[list[River], list[Lake], list[Float64Array]]:
    """Solve water levels: return rivers sorted by id, lakes, and the terrain height along each river."""
    if not courses:
        return [], lakes, []
    run.reached(0.2)  # in a sketch of many rivers
    network = replace(run(build_network, courses), cuts=cuts)
    run.reached(0.7)
    rivers, filled = run(_levels, network, lakes, grounds, sea_level)
    order = sorted(range(len(rivers)), key=lambda number: rivers[number].id)
    return [rivers[number] for number in order], filled, [grounds[number] for number in order]


def _levels(
    network: Network, lakes: list[Lake], grounds: list[Float64Array], sea_level: float | None
) -> tuple[list[River], list[Lake]]:
    above, tides = grounds, []
    if sea_level is not None:
        above = above_sea(network, grounds, sea_level)
        tides = [tidal_reaches(*each, sea_level) for each in zip(network.courses, grounds, strict=True)]
    filled, levels = solve_lake_levels(lakes, network, above, tides)
    if sea_level is not None:  # sharp bends have lowered it by centimetres
        levels = [np.maximum(level, sea_level) for level in levels]
    return build_rivers(network, levels), filled


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
            part = replace(part, parent=parent, joint=joint)
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
    return replace(course, width=course.width * wide)


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
