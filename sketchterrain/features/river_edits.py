"""What a person changed of rivers: control points, widths, rivers and lakes taken away.

It is done to courses, before any water flows, so that levels, widths at confluences and valleys follow.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.river_course import course_through
from sketchterrain.features.rules import LAYER_CODES
from sketchterrain.sketch import Edit

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy.typing as npt

    from sketchterrain.features.catalogue import Lake, River
    from sketchterrain.features.river_course import RiverCourse

_ACTIONS = frozenset({"move_point", "width", "delete"})


def targets_river(edit: Edit) -> bool:
    """Whether an edit names a river, by its action or by the layer in the id."""
    return edit.action in ("move_point", "width") or (edit.feature or 0) >> 48 == LAYER_CODES["river"]


def targets_lake(edit: Edit) -> bool:
    """Whether an edit names a lake, by the layer in the id."""
    return not targets_river(edit) and (edit.feature or 0) >> 48 == LAYER_CODES["lake"]


def apply_lake_edits(lakes: list[Lake], edits: Iterable[Edit]) -> tuple[list[Lake], tuple[str, ...]]:
    """Return the lakes that a person did not take away, and one line for each edit that finds none."""
    there = {lake.id for lake in lakes}
    taken: set[int] = set()
    orphans = []
    for edit in filter(targets_lake, edits):
        if edit.action != "delete":
            orphans.append(f"{edit.action} of lake {edit.feature}: a lake has only delete")
        elif edit.feature not in there:
            orphans.append(f"delete of lake {edit.feature}: there is no such lake any more")
        else:
            taken.add(edit.feature)
    return [lake for lake in lakes if lake.id not in taken], tuple(orphans)


def apply_river_edits(
    courses: list[RiverCourse], edits: Iterable[Edit]
) -> tuple[list[RiverCourse], tuple[str, ...]]:
    """Return courses as a person changed them, and one line for each edit that finds nothing to change.

    A tributary of a river that moved follows it; one of a river that was taken away becomes a river of its
    own.

    Parameters
    ----------
    courses
        Parents before those that join them.
    edits
        In the order in which they are done; those of other features are passed over.
    """
    by_id = {course.id: course for course in courses}
    wanted: dict[int, list[Edit]] = {}
    controls = {course.id: np.array(course.line[course.controls]) for course in courses}
    orphans = []
    for edit in filter(targets_river, edits):
        name = edit.feature or 0
        problem = _problem(by_id.get(name), controls.get(name), edit)
        if problem:
            orphans.append(f"{edit.action} of river {name}: {problem}")
            continue
        wanted.setdefault(name, []).append(edit)
        if edit.action == "move_point":
            controls[name][_control(controls[name], edit)] = edit.x, edit.y
    if not wanted:
        return courses, tuple(orphans)
    after: dict[int, RiverCourse | None] = {}
    for course in courses:
        own = wanted.get(course.id, [])
        if any(edit.action == "delete" for edit in own):
            after[course.id] = None
        else:
            parent = None if course.parent is None else after[course.parent.id]
            after[course.id] = _changed(course, parent, own, controls[course.id])
    return [course for course in after.values() if course is not None], tuple(orphans)


def move_edit(river: River, index: int, *, x: float, y: float) -> Edit:
    """Return the edit that moves a control point, named by where it is: it is found again in a changed river.

    Parameters
    ----------
    river
        As it is now.
    index
        Which of its `points`.
    x, y
        Where the point shall be (m).
    """
    from_x, from_y = (float(each) for each in river.points[index, :2])
    return Edit("move_point", river.id, index=index, x=x, y=y, from_x=from_x, from_y=from_y)


def _control(points: npt.NDArray[np.float64], edit: Edit) -> int | None:
    """Return which control point an edit means: the nearest to where it was, within one interval."""
    if edit.from_x is None:
        return edit.index if edit.index is not None and edit.index < len(points) else None
    away = np.hypot(*(points - [edit.from_x, edit.from_y]).T)
    nearest = int(np.argmin(away))
    beside = np.hypot(*np.diff(points[max(nearest - 1, 0) : nearest + 2], axis=0).T)
    return nearest if away[nearest] <= beside.max() else None


def _problem(course: RiverCourse | None, points: npt.NDArray[np.float64] | None, edit: Edit) -> str | None:
    if course is None or points is None:
        return "there is no such river any more"
    if edit.action not in _ACTIONS:
        return f"a river has only {', '.join(sorted(_ACTIONS))}"
    if edit.action == "move_point" and _control(points, edit) is None:
        if edit.from_x is not None:
            return f"there is no control point near ({edit.from_x:.0f}, {edit.from_y:.0f}) m any more"
        return f"there is no control point {edit.index}, only {len(points)} of them"
    return None


def _changed(
    course: RiverCourse, parent: RiverCourse | None, edits: list[Edit], points: npt.NDArray[np.float64]
) -> RiverCourse:
    joint = -1
    if parent is course.parent and np.array_equal(points, course.line[course.controls]):
        joint = course.joint
    elif parent is not None:
        joint = 1 + int(np.argmin(((parent.line[1:] - points[-1]) ** 2).sum(axis=1)))
        points[-1] = parent.line[joint]
    grows = course.grows
    if not np.array_equal(points, course.line[course.controls]):
        course = _redrawn(course, points)
    widths = [edit.width for edit in edits if edit.action == "width"]
    width = np.full_like(course.width, widths[-1]) if widths else course.width
    return dataclasses.replace(course, parent=parent, joint=joint, width=width, grows=grows or bool(widths))


def _redrawn(course: RiverCourse, points: npt.NDArray[np.float64]) -> RiverCourse:
    sizes = (course.width[course.controls], course.depth[course.controls])
    return course_through(
        np.column_stack([points, *sizes]), course.id, course.label, parent=None, joint=-1, taper=course.taper
    )
