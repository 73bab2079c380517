"""Rivers beyond the sketch's edge: each stops before it would run into another one."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.features.river_path import arc_length

if TYPE_CHECKING:
    from sketchterrain.features.river_course import RiverCourse


_CLEARANCE = 2.0  # of the two widths' mean


def separate_beyond_edge(courses: list[RiverCourse], size: tuple[float, float]) -> list[RiverCourse]:
    """Shorten what runs on beyond the sketch so that no two rivers cross there.

    Parameters
    ----------
    courses : list of RiverCourse
        Parents before the courses that join them; an earlier course goes before a later one.
    size : (float, float)
        Metres eastward and northward that the sketch covers.

    Returns
    -------
    list of RiverCourse
        In the same order; joints and parents are those of the new ones. Those left as they are are the very
        same objects.
    """
    done: list[RiverCourse] = []
    now: dict[
        int, tuple[RiverCourse, int]
    ] = {}  # by the old course: the new one, and how many points its head lost
    for course in courses:
        head, tail = _beyond(course.line, size)
        first, last = 0, len(course.line)
        if tail < last:
            others = [*done, *([_part(course, 0, head)] if head > 1 else [])]
            last = tail + _free(course.line[tail:], course.width[tail:], others)
        if head > 0:
            upstream = _free(course.line[:head][::-1], course.width[:head][::-1], done)
            first = head - upstream
        part = _part(course, min(first, last - 2), max(last, first + 2))
        if part.parent is not None:
            parent, lost = now[id(course.parent)]
            if parent is not part.parent or lost:
                part = dataclasses.replace(part, parent=parent, joint=course.joint - lost)
        now[id(course)] = part, min(first, last - 2)
        done.append(part)
    return done


def _beyond(line: Float64Array, size: tuple[float, float]) -> tuple[int, int]:
    """Count the points before a river enters the sketch; and find the first one after it has left it."""
    inside = np.flatnonzero(((line >= 0.0) & (line <= np.array(size))).all(axis=1))
    return (int(inside[0]), int(inside[-1]) + 1) if len(inside) else (0, len(line))


def _free(line: Float64Array, width: Float64Array, others: list[RiverCourse]) -> int:
    """Count the points of a river, from the sketch outward, that keep clear of all other rivers."""
    free = len(line)
    for other in others:
        distance, nearest = cKDTree(other.line).query(line)
        close = distance < _CLEARANCE * 0.5 * (width + other.width[nearest]) + 2.0 * np.diff(
            arc_length(line[:2])
        )
        free = min(free, int(np.argmax(close))) if close.any() else free
    return free


def _part(course: RiverCourse, first: int, last: int) -> RiverCourse:
    if first == 0 and last == len(course.line):
        return course
    controls = course.controls[(course.controls > first) & (course.controls < last - 1)] - first
    return dataclasses.replace(
        course,
        line=course.line[first:last],
        controls=np.concatenate([[0], controls, [last - first - 1]]),
        width=course.width[first:last],
        depth=course.depth[first:last],
    )
