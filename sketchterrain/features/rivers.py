"""Rivers: from what was painted to centrelines with width, depth and a falling water level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt
from scipy import ndimage

from sketchterrain.errors import InputError
from sketchterrain.features.catalogue import River
from sketchterrain.features.hashing import unit
from sketchterrain.features.river_course import BEYOND, arc_length, run_on, smoothed, spaced
from sketchterrain.features.river_network import Reach, exit_normal, reaches_to, river_ends
from sketchterrain.features.river_profile import joined_to, surface_along, width_along
from sketchterrain.features.skeleton import Skeleton, skeletons
from sketchterrain.features.splines import sample_catmull_rom, without_repeats
from sketchterrain.features.user_features import pixel_id

if TYPE_CHECKING:
    from sketchterrain.sketch.document import Sketch

Floats = npt.NDArray[np.float64]
Ground = Callable[[Floats, Floats], npt.NDArray[np.floating[Any]]]

_DEPTH_POWER = 0.6  # how depth follows width along a river


@dataclass(eq=False)
class _Course:
    """A reach on its way to becoming a River: where it runs, what its labels say, what it joins."""

    id: int
    label: int
    parent: int  # index among the courses; -1: a main stem
    joint: int  # index on the parent's centreline
    points: Floats  # (n, 2) m
    line: Floats  # (m, 2) m, the centreline
    u: Floats  # (m,) where on the spline
    width: Floats  # (m,) m, what the labels say
    depth: Floats  # (m,) m
    taper: float  # m
    controls: npt.NDArray[np.intp]  # indices of the control points on the centreline


def trace_rivers(sketch: Sketch, *, seed: int, ground: Ground) -> tuple[River, ...]:
    """Trace the rivers that were painted.

    Painted regions of any label that touch are one network. A dab that is no longer than it is wide, even
    one pixel, becomes a short straight reach. The mouth is the lowest end, and rather one at the sketch's
    edge; a river that reaches the edge runs on beyond it for about a third of the sketch. A loop becomes two
    arms that part at its top and meet at its bottom.

    Parameters
    ----------
    sketch : Sketch
        The document; its own seed is not looked at.
    seed : int
        Seed of the terrain.
    ground : callable
        ``ground(x, y)``: height (m) of the land without rivers, for float64 arrays of positions (m).

    Returns
    -------
    tuple of River, sorted by id. Along each centreline the water level falls by at least 1e-4 m a metre; a
    tributary's last point is a point of the centreline that it joins, z included.

    Raises
    ------
    InputError
        If `ground` returns something of another shape, or not finite.
    """
    courses: list[_Course] = []
    for skeleton in skeletons(sketch.layers["river"] > 0):
        courses.extend(_courses(sketch, skeleton, seed, ground, first=len(courses)))
    if not courses:
        return ()
    lines = np.concatenate([course.line for course in courses])
    heights = np.split(_heights(ground, lines), np.cumsum([len(course.line) for course in courses])[:-1])
    return tuple(sorted(_with_water(courses, heights), key=lambda river: river.id))


def _heights(ground: Ground, at: Floats) -> Floats:
    heights = np.asarray(ground(at[:, 0].copy(), at[:, 1].copy()), dtype=np.float64)
    if heights.shape != (len(at),) or not np.isfinite(heights).all():
        raise InputError(f"expected {len(at)} finite ground heights, got shape {heights.shape} or not finite")
    return heights


def _world(sketch: Sketch, skeleton: Skeleton, pixels: npt.NDArray[np.int64]) -> Floats:
    x = (skeleton.columns[pixels] + 0.5) * sketch.pixel_size
    y = (sketch.height_px - skeleton.rows[pixels] - 0.5) * sketch.pixel_size
    return np.stack([x, y], axis=-1)


def _courses(sketch: Sketch, skeleton: Skeleton, seed: int, ground: Ground, *, first: int) -> list[_Course]:
    """Lay out one network, parents first; `first` is the index that its first course will have."""
    reaches = reaches_to(skeleton, _mouth(sketch, skeleton, ground))
    stem = reaches[0].pixels
    if _length(skeleton, stem) <= 2.0 * float(skeleton.depth[stem].max()):
        return [_dab(sketch, skeleton, stem, seed, ground)]
    courses: list[_Course] = []
    for reach in reaches:
        courses.append(_course(sketch, skeleton, reach, courses, seed, first))
    return courses


def _length(skeleton: Skeleton, pixels: npt.NDArray[np.int64]) -> float:
    return float(np.hypot(np.diff(skeleton.rows[pixels]), np.diff(skeleton.columns[pixels])).sum())


def _mouth(sketch: Sketch, skeleton: Skeleton, ground: Ground) -> int:
    """Choose the lowest end; one at the sketch's edge may lie 10 m and 2 % of the river's length higher."""
    ends = river_ends(skeleton)
    heights = _heights(ground, _world(sketch, skeleton, ends))
    if len(ends) > 1 and len(skeleton.ends()) > 0:
        for number, end in enumerate(ends):
            stem = reaches_to(skeleton, int(end))[0].pixels
            if exit_normal(skeleton, stem, (sketch.height_px, sketch.width_px)):
                heights[number] -= 10.0 + 0.02 * sketch.pixel_size * _length(skeleton, stem)
    return int(ends[np.argmin(heights)])


def _course(
    sketch: Sketch, skeleton: Skeleton, reach: Reach, before: list[_Course], seed: int, first: int
) -> _Course:
    pixel_size, pixels = sketch.pixel_size, reach.pixels
    loose = 1.0 - sketch.fidelity
    interval = (4.0 + 4.0 * loose) * pixel_size
    path, joint = _world(sketch, skeleton, pixels), -1
    if reach.parent >= 0:
        parent = before[reach.parent].line
        joint = 1 + int(np.argmin(((parent[1:] - path[-1]) ** 2).sum(axis=1)))
        path[-1] = parent[joint]
    widths, depths, label = _painted_sizes(sketch, skeleton, pixels)
    points = spaced(np.column_stack([smoothed(path, 2.0 + 3.0 * loose), widths, depths]), interval)

    ident = _id(sketch, skeleton, int(pixels[0]))
    size, longer = (sketch.height_px, sketch.width_px), max(sketch.height_px, sketch.width_px) * pixel_size
    taper = arc_length(points)[-1] / 3.0
    if reach.parent < 0 and (normal := exit_normal(skeleton, pixels, size)):
        more = run_on(points[:, :2], normal, length=BEYOND * longer, interval=interval, seed=seed, name=ident)
        points = _lengthened(points, more)
    if normal := exit_normal(skeleton, pixels[::-1], size):
        more = run_on(
            points[::-1, :2], normal, length=BEYOND * longer, interval=interval, seed=seed, name=ident + 1
        )
        points = _lengthened(points[::-1], more)[::-1]
        taper = BEYOND * longer
    return _drawn(
        points, ident, label, reach.parent + first if reach.parent >= 0 else -1, joint, float(taper)
    )


def _dab(
    sketch: Sketch, skeleton: Skeleton, pixels: npt.NDArray[np.int64], seed: int, ground: Ground
) -> _Course:
    """Lay a short straight reach over a dab, falling with the ground."""
    path = _world(sketch, skeleton, pixels)
    ident = _id(sketch, skeleton, int(np.min(pixels)))
    heading = path[-1] - path[0]
    if not heading.any():
        angle = 2.0 * np.pi * float(unit(seed, "dab", ident))
        heading = np.array([np.cos(angle), np.sin(angle)])
    heading /= np.hypot(*heading)
    widths, depths, label = _painted_sizes(sketch, skeleton, pixels)
    half = 0.5 * _length(skeleton, pixels) + max(0.5 * float(skeleton.depth[pixels].max()), 1.0)
    centre = 0.5 * (path[0] + path[-1])
    steps = np.linspace(-half, half, 3)[:, None] * sketch.pixel_size
    ends = _heights(ground, np.stack([centre - steps[2] * heading, centre + steps[2] * heading]))
    if ends[0] < ends[1]:
        heading = -heading
    sizes = np.broadcast_to([widths.mean(), depths.mean()], (3, 2))
    points = np.column_stack([centre + steps * heading, sizes])
    return _drawn(points, ident, label, -1, -1, float(half * sketch.pixel_size))


def _id(sketch: Sketch, skeleton: Skeleton, pixel: int) -> int:
    at = slice(pixel, pixel + 1)
    return int(pixel_id("river", skeleton.rows[at], skeleton.columns[at], sketch.width_px)[0])


def _painted_sizes(
    sketch: Sketch, skeleton: Skeleton, pixels: npt.NDArray[np.int64]
) -> tuple[Floats, Floats, int]:
    """Width and depth (m) that the labels along a path say, smoothed; and the label of most of it."""
    labels = sketch.layers["river"][skeleton.rows[pixels], skeleton.columns[pixels]]
    main = int(np.argmax(np.bincount(labels, minlength=256)))
    widths, depths = np.zeros(len(pixels)), np.zeros(len(pixels))
    for label in np.unique(labels):
        properties = sketch.properties("river", int(label))
        widths[labels == label], depths[labels == label] = properties["width"], properties["depth"]
    if labels.min() != labels.max():
        widths, depths = (ndimage.gaussian_filter1d(each, 6.0, mode="nearest") for each in (widths, depths))
    return widths, depths, main


def _lengthened(points: Floats, more: Floats) -> Floats:
    """Append positions; width and depth stay what they were at the end."""
    sizes = np.broadcast_to(points[-1, 2:], (len(more), points.shape[1] - 2))
    return np.concatenate([points, np.column_stack([more, sizes])])


def _drawn(points: Floats, ident: int, label: int, parent: int, joint: int, taper: float) -> _Course:
    points = points[np.concatenate([[True], (np.diff(points[:, :2], axis=0) != 0.0).any(axis=1)])]
    step = float(np.clip(0.5 * points[:, 2].min(), 2.0, 12.0))
    line, u = sample_catmull_rom(without_repeats(points[:, :2]), step)
    number = np.arange(len(points))
    return _Course(
        id=ident,
        label=label,
        parent=parent,
        joint=joint,
        points=points[:, :2],
        line=line,
        u=u,
        width=np.interp(u, number, points[:, 2]),
        depth=np.interp(u, number, points[:, 3]),
        taper=taper,
        controls=np.flatnonzero(u == np.floor(u)),
    )


def _with_water(courses: list[_Course], grounds: list[Floats]) -> list[River]:
    """Widths and levels, tributaries first; then down from each stem so that levels meet at confluences."""
    arcs = [arc_length(course.line) for course in courses]
    widths: list[Floats] = [course.width for course in courses]
    levels: list[Floats] = [np.zeros(0)] * len(courses)
    joining: list[list[int]] = [[] for _ in courses]
    for number, course in enumerate(courses):
        if course.parent >= 0:
            joining[course.parent].append(number)
    for number in reversed(range(len(courses))):
        course = courses[number]
        tributaries = [(courses[other].joint, other) for other in joining[number]]
        widths[number] = width_along(
            course.width,
            arcs[number],
            course.taper,
            [(at, float(widths[other][-1])) for at, other in tributaries],
        )
        levels[number] = surface_along(
            grounds[number],
            arcs[number],
            width=float(course.width.mean()),
            depth=float(course.depth.mean()),
            ceilings=[(at, float(levels[other][-1])) for at, other in tributaries],
        )
    for number, course in enumerate(courses):
        if course.parent >= 0:
            end = float(levels[course.parent][course.joint])
            levels[number] = joined_to(
                levels[number], arcs[number], end=end, width=float(course.width.mean())
            )
    return [_river(*each) for each in zip(courses, widths, levels, strict=True)]


def _river(course: _Course, width: Floats, level: Floats) -> River:
    depth = course.depth * (width / course.width) ** _DEPTH_POWER
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
    )
