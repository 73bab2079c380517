"""River layout: from painted layers to courses, with mouths, and separation beyond the sketch."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.document.label_layers import LabelImage
from sketchterrain.errors import InputError
from sketchterrain.geometry.hashing import rounded
from sketchterrain.geometry.splines import arc_length
from sketchterrain.landforms.hydrology.courses import (
    LAKE_GAP,
    RiverCourse,
    dab_course,
    part_of_course,
    pixel_positions,
    reach_course,
    reversed_course,
)
from sketchterrain.landforms.hydrology.lakes import WaterPixels, lake_pixels
from sketchterrain.landforms.hydrology.network import (
    RiverEnd,
    Skeleton,
    close_gaps,
    exit_normal,
    longest_path,
    river_ends,
    sort_skeletons,
    split_into_reaches,
    thin_region,
)
from sketchterrain.landforms.placement.feature_types import GroundHeight
from sketchterrain.landforms.placement.sea import sea_level
from sketchterrain.landforms.placement.shapes import Region, find_regions
from sketchterrain.stages.digests import derive_digest
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


_CLEARANCE = 2.0  # of the two widths' mean


def separate_beyond_edge(courses: list[RiverCourse], size: tuple[float, float]) -> list[RiverCourse]:
    """Shorten the extensions beyond the sketch (`size`, m) so that no two rivers cross there.

    Parents come first; earlier courses take precedence.
    """
    left: dict[int, _Left] = {}
    for course in courses:
        head, tail = _beyond(course, size)
        first, last = 0, len(course.line)
        finished = [other for other, _ in left.values()]
        if tail < last:
            others = [*finished, *([part_of_course(course, 0, head)] if head > 1 else [])]
            last = tail + _free(course.line[tail:], course.width[tail:], others)
        if head > 0:
            upstream = _free(course.line[:head][::-1], course.width[:head][::-1], finished)
            first = head - upstream
        _shorten(course, min(first, last - 2), max(last, first + 2), left)
    return [course for course, _ in left.values()]


_Left: TypeAlias = tuple[RiverCourse, int]
"""What is left of a course, and the number of points removed at its head."""


def _shorten(course: RiverCourse, first: int, last: int, left: dict[int, _Left]) -> None:
    """Add the points of a course in a range that holds all joints to what is left of others, by id."""
    part = part_of_course(course, first, last)
    if course.parent is not None:
        parent, removed = left[course.parent.id]
        if parent is not course.parent:
            part = replace(part, parent=parent, joint=course.joint - removed)
    left[course.id] = part, first


def _beyond(course: RiverCourse, size: tuple[float, float]) -> tuple[int, int]:
    """Return the number of points before a river enters the sketch, and the first after it leaves.

    Points of a line count as in the sketch wherever they are.
    """
    if course.given is not None:
        return course.given
    inside = np.flatnonzero(((course.line >= 0.0) & (course.line <= np.array(size))).all(axis=1))
    return (int(inside[0]), int(inside[-1]) + 1) if len(inside) else (0, len(course.line))


def _free(line: Float64Array, width: Float64Array, others: list[RiverCourse]) -> int:
    """Return how many points of a river, from the sketch outward, keep clear of all other rivers."""
    free = len(line)
    for other in others:
        distance, nearest = cKDTree(other.line).query(line)
        close = distance < _CLEARANCE * 0.5 * (width + other.width[nearest]) + 2.0 * np.diff(
            arc_length(line[:2])
        )
        free = min(free, int(np.argmax(close))) if close.any() else free
    return free


_MAX_SINK, _MAX_CUT = 3.0, 15.0  # m: beyond the sketch; see `ranges_beyond_edge`


def ranges_beyond_edge(
    courses: Sequence[RiverCourse],
    grounds: Sequence[Float64Array],
    size: tuple[float, float],
    at_sea: Collection[int] = (),
) -> list[tuple[int, int]]:
    """Return the first point of each course and its last one, exclusive, that the ground (m) along it allows.

    Beyond the sketch (`size`, m) a river springs at the divide, and ends before it would cut through rising
    ground, unless it ends in the sea (`at_sea`: ids). Joints are left.
    """
    ranges = []
    for course, ground in zip(courses, grounds, strict=True):
        first, last = _allowed_range(ground, *_beyond(course, size))
        if course.parent is not None or course.id in at_sea:
            last = len(ground)
        joints = [
            other.joint for other in courses if other.parent is not None and other.parent.id == course.id
        ]
        first, last = min([first, *joints]), max([last, *(joint + 1 for joint in joints)])
        last = min(max(last, first + 2), len(ground))
        ranges.append((min(first, last - 2), last))
    return ranges


def _allowed_range(ground: Float64Array, head: int, tail: int) -> tuple[int, int]:
    """Return the range of points where the ground upstream of `head` rises and that from `tail` on falls."""
    first, last = 0, len(ground)
    if 0 < head < last:
        upstream = ground[head::-1]
        falls = np.flatnonzero(upstream < np.maximum.accumulate(upstream) - _MAX_SINK)
        if len(falls):
            first = head - int(np.argmax(upstream[: falls[0]]))
    if 0 < tail < last:
        downstream = ground[tail - 1 :]
        rises = np.flatnonzero(downstream > np.minimum.accumulate(downstream) + _MAX_CUT)
        if len(rises):
            last = tail + int(np.argmin(downstream[: rises[0]]))
    return first, last


def shortened(courses: Sequence[RiverCourse], ranges: Sequence[tuple[int, int]]) -> list[RiverCourse]:
    """Return the points of courses (parents first) in ranges that hold all joints."""
    left: dict[int, _Left] = {}
    for course, part in zip(courses, ranges, strict=True):
        _shorten(course, *part, left)
    return [course for course, _ in left.values()]


_EDGE_BONUS = (10.0, 0.02)
"""Preference for mouths at the sketch's edge: m, and m per metre of river."""

_SURROUNDINGS = 1 / 16  # extents
_RING = np.array(
    [(0, 0), (1, 0), (0, 1), (-1, 0), (0, -1), (0.7, 0.7), (-0.7, 0.7), (-0.7, -0.7), (0.7, -0.7)]
)

_MAX_DAB = 2.0  # px; a shorter skeleton is a dab, however thin
_MARGIN = 4  # px around a river beyond its border, for the widths of its strokes


_READ: Final = ("layers.river", "labels.river", "extent", "size", "fidelity")
_Outline: TypeAlias = RiverCourse | tuple[RiverEnd, ...]
"""A dab's course, or the ends of a longer river."""


def lay_out_rivers(
    sketch: Sketch, *, seed: int, ground: GroundHeight, run: Runner, water: WaterPixels | None = None
) -> list[RiverCourse]:
    """Return the courses of all painted networks, parents first.

    Ends beside `water` lead into it; by default it is that of painted lakes.
    """
    networks = _networks(sketch, seed, run)
    if not networks:
        return []
    image = sketch.layers["river"]
    rivers = [each[1:] for each in networks if isinstance(each[2], tuple)]
    closed = run(close_gaps, image, rivers, LAKE_GAP)
    if closed is not None:
        sketch = sketch.replace(layers={**sketch.layers, "river": closed})
        networks = _networks(sketch, seed, run)
    if water is None:
        water = run(lake_pixels, sketch.layers["lake"])
    found = end_heights(sketch, ground, [_end_positions(*each) for each in networks])
    return [
        course
        for network, heights in run.steps(list(zip(networks, found, strict=True)))
        for course in _courses(sketch, network, heights, seed, water, run)
    ]


def end_heights(
    sketch: Sketch, ground: GroundHeight, groups: Sequence[Float64Array]
) -> list[tuple[Float64Array, Float64Array]]:
    """Return heights (m) at each group of positions (n, 2), and the means of nine positions around each.

    The means tell springs from mouths.
    """
    around = [(at[:, None] + _RING * _SURROUNDINGS * sketch.extent).reshape(-1, 2) for at in groups]
    found = heights_at(ground, [*groups, *around])
    means = [near.reshape(-1, len(_RING)).mean(axis=1) for near in found[len(groups) :]]
    return list(zip(found, means, strict=False))


def heights_at(ground: GroundHeight, groups: Sequence[Float64Array]) -> list[Float64Array]:
    """Return terrain heights at groups of positions, rounded to 1/1024 m; InputError if invalid."""
    at = np.concatenate(groups)
    heights = np.asarray(ground(at[:, 0].copy(), at[:, 1].copy()), dtype=np.float64)
    if heights.shape != (len(at),) or not np.isfinite(heights).all():
        raise InputError(f"expected {len(at)} finite ground heights, got shape {heights.shape} or not finite")
    return np.split(rounded(heights), np.cumsum([len(group) for group in groups])[:-1])


def _networks(sketch: Sketch, seed: int, run: Runner) -> list[tuple[Sketch, Skeleton, _Outline]]:
    """Return the skeletons of painted rivers, each with the part of the sketch that it depends on."""
    river, found = part_of(sketch, *_READ), []
    for skeleton in run(_skeletons, river):
        part = river.replace(layers={"river": _surroundings(sketch.layers["river"], skeleton)})
        found.append((part, skeleton, run(_outline, part, skeleton, seed)))
    return found


@lru_cache(maxsize=4)
def _blank(size: tuple[int, int]) -> LabelImage:
    blank = np.zeros(size, np.uint8)
    blank.flags.writeable = False
    return blank


def _surroundings(image: LabelImage, skeleton: Skeleton) -> LabelImage:
    """Return an image with the pixels from which a river has its labels and widths."""
    margin = int(skeleton.depth.max()) + _MARGIN
    top, left = (max(int(at.min()) - margin, 0) for at in (skeleton.rows, skeleton.columns))
    box = top, left, int(skeleton.rows.max()) + margin + 1, int(skeleton.columns.max()) + margin + 1
    near = np.zeros_like(image)
    near[top : box[2], left : box[3]] = image[top : box[2], left : box[3]]
    near.flags.writeable = False
    derive_digest(near, _blank(image.shape), box)
    return near


def _skeletons(sketch: Sketch, run: Runner) -> tuple[Skeleton, ...]:
    image = sketch.layers["river"]
    widths = _label_widths(sketch)
    return sort_skeletons(
        run(_skeleton, region, image[region.rows, region.columns], image.shape, widths, sketch.pixel_size)
        for region in find_regions((image > 0).astype(np.uint8))
    )


def _skeleton(
    region: Region, window: LabelImage, size: tuple[int, int], widths: Float64Array, pixel_size: float
) -> Skeleton:
    """Return the skeleton of a region; the weight of rivers that are as wide as painted is their width."""
    skeleton = thin_region(region, widths[np.where(region.mask, window, 0)], size)
    painted = 2.0 * skeleton.depth * pixel_size
    return replace(skeleton, weight=np.where(skeleton.weight > 0, skeleton.weight, painted))


def _label_widths(sketch: Sketch) -> Float64Array:
    """Return the width (m) of each label, to find main stems; 0 is as painted."""
    widths = np.ones(256)
    for label in np.unique(sketch.layers["river"]):
        if label > 0:
            widths[label] = sketch.properties("river", int(label))["width"]
    return widths


def _outline(sketch: Sketch, skeleton: Skeleton, seed: int) -> _Outline:
    path = longest_path(skeleton)
    steps = np.hypot(np.diff(skeleton.rows[path]), np.diff(skeleton.columns[path]))
    if float(steps.sum()) <= max(2.0 * float(skeleton.depth[path].max()), _MAX_DAB):
        return dab_course(sketch, skeleton, path, seed=seed)
    return river_ends(skeleton)


def _end_positions(sketch: Sketch, skeleton: Skeleton, outline: _Outline) -> Float64Array:
    if isinstance(outline, RiverCourse):
        return outline.line[[0, -1]]
    return pixel_positions(sketch, skeleton, np.array([end.pixel for end in outline]))


def _mouth(
    sketch: Sketch,
    skeleton: Skeleton,
    ends: tuple[RiverEnd, ...],
    heights: Float64Array,
    means: Float64Array,
    lake: WaterPixels | None,
) -> int:
    """Return the end farthest along the label's flow, or the lowest: in the sea, else a lake or the edge.

    On land it is the one with the lowest surroundings (`means`, m): at the foot of mountains rivers spring.
    """
    at = np.array([end.pixel for end in ends])
    size = (sketch.height_px, sketch.width_px)
    preferred = np.array([exit_normal(skeleton, end.lead, size) is not None for end in ends])
    if lake is not None:
        pixels = np.stack([skeleton.rows[at], skeleton.columns[at]], axis=-1)
        preferred |= lake.tree.query(pixels)[0] <= skeleton.depth[at] + LAKE_GAP
    length = max(end.length for end in ends) * sketch.pixel_size
    positions, flow = pixel_positions(sketch, skeleton, at), _flow(sketch, skeleton)
    return ends[best_mouth(sketch, positions, flow, heights, means, preferred, length)].pixel


def best_mouth(
    sketch: Sketch,
    at: Float64Array,
    flow: float,
    heights: Float64Array,
    means: Float64Array,
    preferred: BoolArray,
    length: float,
) -> int:
    """Return which end of a network is its mouth; see `_mouth`.

    Parameters
    ----------
    at : (n, 2) positions of the ends, m
    flow : azimuth (°) that the network flows to, below 0 downhill
    heights, means : (n,) terrain at the ends, and around them, m
    preferred : (n,) ends in a lake or at the sketch's edge
    length : of the network's main stem, m
    """
    if flow >= 0.0:
        angle = np.deg2rad(flow)
        return int(np.argmax(at @ np.array([np.sin(angle), np.cos(angle)])))
    sea = sea_level(sketch)
    if sea is not None and heights.min() < sea:
        return int(np.argmin(heights))
    bonus = _EDGE_BONUS[0] + _EDGE_BONUS[1] * length
    return int(np.argmin(means - bonus * preferred))


def _flow(sketch: Sketch, skeleton: Skeleton) -> float:
    """Return the azimuth (°) that a network's main label flows to, below 0 downhill."""
    labels = sketch.layers["river"][skeleton.rows, skeleton.columns]
    return float(sketch.properties("river", int(np.argmax(np.bincount(labels))))["flow"])


def _courses(
    sketch: Sketch,
    network: tuple[Sketch, Skeleton, _Outline],
    heights: tuple[Float64Array, Float64Array],
    seed: int,
    lake: WaterPixels | None,
    run: Runner,
) -> list[RiverCourse]:
    """Lay out one network, parents first; `heights` (m) are those of its ends and of their surroundings."""
    part, skeleton, outline = network
    if isinstance(outline, RiverCourse):
        return [outline if heights[0][0] >= heights[0][1] else run(reversed_course, outline)]
    mouth = _mouth(sketch, skeleton, outline, *heights, lake)
    courses: list[RiverCourse] = run(_reaches, part, skeleton, mouth, seed, lake)
    return courses


def _reaches(
    sketch: Sketch, skeleton: Skeleton, mouth: int, seed: int, lake: WaterPixels | None
) -> list[RiverCourse]:
    courses: list[RiverCourse] = []
    for reach in split_into_reaches(skeleton, mouth):
        parent = courses[reach.parent] if reach.parent >= 0 else None
        tree = None if lake is None else lake.tree
        courses.append(reach_course(sketch, skeleton, reach, parent, seed=seed, lake=tree))
    return courses
