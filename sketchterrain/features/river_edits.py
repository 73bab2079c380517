"""What a person changed of rivers: control points, widths, rivers and lakes taken away.

It is done to courses, before any water flows, so that levels, widths at confluences and valleys follow.
"""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.river_course import drawn_course
from sketchterrain.features.rules import LAYER_CODES

if TYPE_CHECKING:
    from collections.abc import Iterable

    import numpy.typing as npt

    from sketchterrain.features.catalogue import Lake
    from sketchterrain.features.river_course import Course
    from sketchterrain.sketch import Edit

_ACTIONS = frozenset({"move_point", "width", "delete"})


def concerns_river(edit: Edit) -> bool:
    """Whether an edit names a river, by its action or by the layer in the id."""
    return edit.action in ("move_point", "width") or (edit.feature or 0) >> 48 == LAYER_CODES["river"]


def concerns_lake(edit: Edit) -> bool:
    """Whether an edit names a lake, by the layer in the id."""
    return not concerns_river(edit) and (edit.feature or 0) >> 48 == LAYER_CODES["lake"]


def kept_lakes(lakes: list[Lake], edits: Iterable[Edit]) -> tuple[list[Lake], tuple[str, ...]]:
    """Return the lakes that a person did not take away, and one line for each edit that finds none."""
    there = {lake.id for lake in lakes}
    taken: set[int] = set()
    orphans = []
    for edit in filter(concerns_lake, edits):
        if edit.action != "delete":
            orphans.append(f"{edit.action} of lake {edit.feature}: a lake has only delete")
        elif edit.feature not in there:
            orphans.append(f"delete of lake {edit.feature}: there is no such lake any more")
        else:
            taken.add(edit.feature)
    return [lake for lake in lakes if lake.id not in taken], tuple(orphans)


def edited_courses(courses: list[Course], edits: Iterable[Edit]) -> tuple[list[Course], tuple[str, ...]]:
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
    orphans = []
    for edit in filter(concerns_river, edits):
        problem = _problem(by_id.get(edit.feature or 0), edit)
        if problem:
            orphans.append(f"{edit.action} of river {edit.feature}: {problem}")
        else:
            wanted.setdefault(edit.feature or 0, []).append(edit)
    if not wanted:
        return courses, tuple(orphans)
    after: dict[int, Course | None] = {}
    for course in courses:
        own = wanted.get(course.id, [])
        if any(edit.action == "delete" for edit in own):
            after[course.id] = None
        else:
            parent = None if course.parent is None else after[course.parent.id]
            after[course.id] = _changed(course, parent, own)
    return [course for course in after.values() if course is not None], tuple(orphans)


def _problem(course: Course | None, edit: Edit) -> str | None:
    if course is None:
        return "there is no such river any more"
    if edit.action not in _ACTIONS:
        return f"a river has only {', '.join(sorted(_ACTIONS))}"
    if edit.index is not None and edit.index >= len(course.controls):
        return f"there is no control point {edit.index}, only {len(course.controls)} of them"
    return None


def _changed(course: Course, parent: Course | None, edits: list[Edit]) -> Course:
    points = np.array(course.line[course.controls])
    for edit in edits:
        if edit.action == "move_point":
            points[edit.index] = edit.x, edit.y
    joint = -1
    if parent is course.parent and np.array_equal(points, course.line[course.controls]):
        joint = course.joint
    elif parent is not None:
        joint = 1 + int(np.argmin(((parent.line[1:] - points[-1]) ** 2).sum(axis=1)))
        points[-1] = parent.line[joint]
    if not np.array_equal(points, course.line[course.controls]):
        course = _redrawn(course, points)
    widths = [edit.width for edit in edits if edit.action == "width"]
    width = np.full_like(course.width, widths[-1]) if widths else course.width
    return dataclasses.replace(course, parent=parent, joint=joint, width=width)


def _redrawn(course: Course, points: npt.NDArray[np.float64]) -> Course:
    sizes = (course.width[course.controls], course.depth[course.controls])
    return drawn_course(
        np.column_stack([points, *sizes]), course.id, course.label, parent=None, joint=-1, taper=course.taper
    )
