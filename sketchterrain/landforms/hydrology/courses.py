"""River courses: smoothed, evenly spaced centrelines with widths and depths, extended beyond the sketch."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.geometry.hashing import RATIO_STEP, STEP, gaussian_filter, hash_unit, rounded, value_noise
from sketchterrain.geometry.splines import arc_length, at_lengths, drop_repeats, sample_catmull_rom
from sketchterrain.landforms.hydrology.network import Reach, Skeleton, exit_normal
from sketchterrain.landforms.placement.user_features import pixel_id

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


EXTENSION_SHARE = 0.35
"""Length of a river's extension beyond the sketch's edge, as a share of the longer side."""

_WIDEST_EXIT = math.radians(50.0)  # between a river's heading beyond the edge and the normal
_WANDER = 0.5  # rad to either side


def smoothed(path: Float64Array, sigma: float) -> Float64Array:
    """Smooth a path with a Gaussian of `sigma` points; its ends are unchanged, bit for bit.

    Beyond its ends the path is continued point-symmetrically, so that it does not shrink.
    """
    pad = min(math.ceil(3.0 * sigma), len(path) - 1)
    if pad < 1:
        return path
    front, back = 2.0 * path[0] - path[pad:0:-1], 2.0 * path[-1] - path[-2 : -2 - pad : -1]
    whole = np.concatenate([front, path, back])
    smooth = gaussian_filter(whole, sigma, axes=(0,), truncate=3.0)[pad : pad + len(path)]
    smooth[[0, -1]] = path[[0, -1]]
    return smooth


def spaced(path: Float64Array, interval: float) -> Float64Array:
    """Resample a path at about `interval` (m), ends included; columns beyond x and y are interpolated."""
    arc = arc_length(path)
    count = max(round(float(arc[-1]) / interval), 1) + 1
    at = np.linspace(0.0, arc[-1], count)
    points = at_lengths(path, arc, at)
    points[[0, -1]] = path[[0, -1]]
    return points


def extend_path(
    path: Float64Array, normal: tuple[float, float], *, length: float, interval: float, seed: int, name: int
) -> Float64Array:
    """Return (k, 2) points that extend a river beyond the sketch's edge, wandering gently.

    It starts with the heading of the path's end and never turns back against `normal`, which points out of
    the sketch. `name` identifies the river in the hash.
    """
    arc = arc_length(path)
    back = path[np.searchsorted(arc, max(arc[-1] - 3.0 * interval, 0.0), side="left")]
    heading, out = path[-1] - back, math.atan2(normal[1], normal[0])
    off = math.atan2(heading[1], heading[0]) - out if heading.any() else 0.0
    off = math.remainder(off, 2.0 * math.pi)
    off = min(max(off, -_WIDEST_EXIT), _WIDEST_EXIT)
    step = np.arange(1, max(round(length / interval), 1) + 1, dtype=np.float64)
    swing = (
        2.0 * value_noise(seed, "river beyond the edge", step / 5.0, np.full_like(step, name % 2**40)) - 1.0
    )
    angle = out + off + _WANDER * swing * np.minimum(step / 6.0, 1.0)
    steps = interval * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return np.asarray(path[-1] + np.cumsum(steps, axis=0))


_DEPTH_POWER = 0.6  # exponent of depth over width along a river
_SMOOTH = 6.0  # px along the course
_MAX_EXCESS = 1.5  # px added to twice the distance to a stroke's border, at most
_MIN_WIDTH, _MAX_WIDTH = 0.5, 2000.0  # m


def painted_sizes(
    sketch: Sketch, skeleton: Skeleton, pixels: Int64Array, *, joins: bool = False
) -> tuple[Float64Array, Float64Array, int]:
    """Return smoothed widths and depths (n,), m, along a path (upstream first), and its most frequent label.

    From the labels, or from the stroke where a label's width is 0; there the label's depth is that of the
    stroke's mean width, and the depth follows the width. If it `joins` another river, its last pixels are
    that river's.
    """
    labels = sketch.layers["river"][skeleton.rows[pixels], skeleton.columns[pixels]]
    within = math.ceil(float(skeleton.depth[pixels[-1]])) + 1
    own = len(labels) - within if joins and within < len(labels) else len(labels)
    labels[own:] = labels[own - 1]
    main = int(np.argmax(np.bincount(labels, minlength=256)))
    widths, depths = np.zeros(len(pixels)), np.zeros(len(pixels))
    as_painted = np.zeros(len(pixels), dtype=np.bool_)
    for label in np.unique(labels):
        properties, here = sketch.properties("river", int(label)), labels == label
        widths[here], depths[here] = max(properties["width"], _MIN_WIDTH), properties["depth"]
        as_painted[here] = properties["width"] == 0.0
    if as_painted.any():
        stroke = stroke_widths(sketch, skeleton, pixels)
        stroke[own:] = stroke[own - 1]
        stroke = np.clip(smoothed(stroke[:, None], _SMOOTH)[:, 0], _MIN_WIDTH, _MAX_WIDTH)
        ratio = depth_ratio(stroke / stroke[as_painted].mean())
        widths, depths = np.where(as_painted, stroke, widths), np.where(as_painted, depths * ratio, depths)
    if labels.min() != labels.max():
        widths, depths = (gaussian_filter(each, _SMOOTH) for each in (widths, depths))
    return widths, depths, main


def depth_ratio(width_ratio: Float64Array) -> Float64Array:
    """Return the ratio of depths for a ratio of widths."""
    return rounded(width_ratio**_DEPTH_POWER, RATIO_STEP)


def stroke_widths(sketch: Sketch, skeleton: Skeleton, pixels: Int64Array) -> Float64Array:
    """Return the width (m) of the painted stroke at each pixel of a path: its area over its length.

    Twice the distance to the border alone is up to a pixel too little.
    """
    at = np.stack([skeleton.rows[pixels], skeleton.columns[pixels]], axis=-1)
    lower, upper = 2.0 * skeleton.depth[pixels], 2.0 * skeleton.depth[pixels] + _MAX_EXCESS
    margin = math.ceil(0.5 * float(upper.max()))
    low, high = np.maximum(at.min(axis=0) - margin, 0), at.max(axis=0) + margin + 1
    area = np.argwhere(sketch.layers["river"][low[0] : high[0], low[1] : high[1]] > 0) + low
    nearest = cKDTree(np.stack([skeleton.rows, skeleton.columns], axis=-1)).query(area)[1]
    count = np.bincount(nearest, minlength=len(skeleton.rows))[pixels].astype(np.float64)
    arc = arc_length(at.astype(np.float64))
    step = np.gradient(arc) if len(arc) > 1 else np.ones(1)
    count = np.minimum(count, upper * step)
    area_of, length = (gaussian_filter(each, _SMOOTH / 3.0) for each in (count, step))
    return np.asarray(np.clip(area_of / length, np.maximum(lower, 1.0), upper) * sketch.pixel_size)


LAKE_GAP = 3.0
"""Largest unintended gap (px) between a river's painted end and a lake."""
_MAX_SAMPLES = 64  # of a centreline between two control points
_SAGITTA_WIDTHS = 0.01


@dataclass(frozen=True, eq=False)
class RiverCourse:
    """Course of a reach, upstream first: a River without water."""

    id: int
    label: int
    parent: RiverCourse | None  # the course that it joins
    joint: int  # index on the parent's centreline, or -1
    line: Float64Array  # (m, 2) centreline, m
    controls: npt.NDArray[np.intp]  # (n,) indices of the control points on the centreline
    width: Float64Array  # (m,) by the labels, m
    depth: Float64Array  # (m,) by the labels, m
    taper: float  # m over which the river widens from its spring
    grows: bool = True  # widens from its spring and at confluences, unless it is as wide as painted
    given: tuple[int, int] | None = None  # first point and last one, exclusive, that a line gave it

    def joint_near(self, at: Float64Array) -> int:
        """Return the number of the point, not the spring, at which a tributary that ends at `at` joins it."""
        return 1 + int(np.argmin(((self.line[1:] - at) ** 2).sum(axis=1)))


def pixel_positions(sketch: Sketch, skeleton: Skeleton, pixels: Int64Array) -> Float64Array:
    """Return centres (m) of skeleton pixels, (n, 2)."""
    x = (skeleton.columns[pixels] + 0.5) * sketch.pixel_size
    y = (sketch.height_px - skeleton.rows[pixels] - 0.5) * sketch.pixel_size
    return np.stack([x, y], axis=-1)


def reach_course(
    sketch: Sketch,
    skeleton: Skeleton,
    reach: Reach,
    parent: RiverCourse | None,
    *,
    seed: int,
    lake: cKDTree | None = None,
) -> RiverCourse:
    """Return a reach as a spline, extended beyond the sketch's edge where it leaves the sketch.

    An end painted close to a lake (`lake`: its pixels' rows and columns) is extended into it.
    """
    pixels, loose = reach.pixels, 1.0 - sketch.fidelity
    interval = (4.0 + 4.0 * loose) * sketch.pixel_size
    path, joint = pixel_positions(sketch, skeleton, pixels), -1
    if parent is not None:
        joint = parent.joint_near(path[-1])
        path[-1] = parent.line[joint]
    widths, depths, label = painted_sizes(sketch, skeleton, pixels, joins=parent is not None)
    sized_path = np.column_stack([smoothed(path, 2.0 + 3.0 * loose), widths, depths])
    if lake is not None:
        sized_path = _extend_into_lake(sized_path[::-1], sketch, skeleton, int(pixels[0]), lake)[::-1]
        if parent is None:
            sized_path = _extend_into_lake(sized_path, sketch, skeleton, int(pixels[-1]), lake)
    points = spaced(sized_path, interval)

    name = _id(sketch, skeleton, int(pixels[0]))
    size = (sketch.height_px, sketch.width_px)
    beyond = EXTENSION_SHARE * max(size) * sketch.pixel_size
    taper = float(arc_length(points)[-1]) / 3.0
    if parent is None and (out := exit_normal(skeleton, pixels, size)):
        points = _extend_river(points, out, length=beyond, interval=interval, seed=seed, name=2 * name)
    if out := exit_normal(skeleton, pixels[::-1], size):
        upstream = _extend_river(
            points[::-1], out, length=beyond, interval=interval, seed=seed, name=2 * name + 1
        )
        points, taper = upstream[::-1], beyond
    # At a confluence the end is a point of the stem's curve.
    own = len(points) - (parent is not None)
    points[:own, :2] = rounded(points[:own, :2], _step(sketch))
    course = course_through(points, name, label, parent=parent, joint=joint, taper=taper)
    return replace(course, grows=sketch.properties("river", label)["width"] > 0.0)


def dab_course(sketch: Sketch, skeleton: Skeleton, pixels: Int64Array, *, seed: int) -> RiverCourse:
    """Return a short straight reach over a dab; which end is the spring is decided later."""
    path = pixel_positions(sketch, skeleton, pixels)
    name = _id(sketch, skeleton, int(np.min(pixels)))
    heading = path[-1] - path[0]
    if not heading.any():
        angle = 2.0 * np.pi * float(hash_unit(seed, "dab", name))
        heading = np.array([np.cos(angle), np.sin(angle)])
    heading /= np.hypot(*heading)
    widths, depths, label = painted_sizes(sketch, skeleton, pixels)
    half = max(0.5 * float(skeleton.depth[pixels].max()), 1.0) * sketch.pixel_size
    half += 0.5 * float(arc_length(path)[-1])
    positions = 0.5 * (path[0] + path[-1]) + np.array([[-half], [0.0], [half]]) * heading
    positions = rounded(positions, _step(sketch))
    sizes = np.broadcast_to([widths.mean(), depths.mean()], (3, 2))
    return course_through(np.column_stack([positions, sizes]), name, label, parent=None, joint=-1, taper=half)


def _step(sketch: Sketch) -> float:
    """Return the rounding step of control points (m): finer where a pixel is less than a quarter metre."""
    return min(STEP, math.ldexp(1.0, math.frexp(sketch.pixel_size)[1] - 9))


def reversed_course(course: RiverCourse) -> RiverCourse:
    """Return a dab's course reversed."""
    return replace(
        course,
        line=course.line[::-1],
        controls=len(course.line) - 1 - course.controls[::-1],
        width=course.width[::-1],
        depth=course.depth[::-1],
    )


def _extend_into_lake(
    sized_path: Float64Array, sketch: Sketch, skeleton: Skeleton, end: int, lake: cKDTree
) -> Float64Array:
    """Extend a path from its last point to just inside the shore, if the gap is small enough."""
    at = np.array([skeleton.rows[end], skeleton.columns[end]], dtype=np.float64)
    gap, nearest = lake.query(at)
    if not 0.0 < gap <= float(skeleton.depth[end]) + LAKE_GAP:
        return sized_path
    ahead = (np.asarray(lake.data)[int(nearest)] - at) * (1.0 + 2.0 / gap)
    to_others = np.hypot(skeleton.rows - at[0] - ahead[0], skeleton.columns - at[1] - ahead[1])
    if to_others.min() < np.hypot(*ahead) - 1e-6:
        return sized_path  # another reach is between
    step = ahead * sketch.pixel_size
    more = np.array([step[1], -step[0], 0.0, 0.0])
    return np.concatenate([sized_path, sized_path[-1:] + more])


def _id(sketch: Sketch, skeleton: Skeleton, pixel: int) -> int:
    at = slice(pixel, pixel + 1)
    return int(pixel_id("river", skeleton.rows[at], skeleton.columns[at], sketch.width_px)[0])


def _extend_river(
    points: Float64Array, out: tuple[float, float], *, length: float, interval: float, seed: int, name: int
) -> Float64Array:
    """Extend a river from its last point; width and depth stay constant."""
    more = extend_path(points[:, :2], out, length=length, interval=interval, seed=seed, name=name)
    sizes = np.broadcast_to(points[-1, 2:], (len(more), 2))
    return np.concatenate([points, np.column_stack([more, sizes])])


def course_through(
    points: Float64Array,
    name: int,
    label: int,
    *,
    parent: RiverCourse | None,
    joint: int,
    taper: float,
    resolved: float | None = None,
) -> RiverCourse:
    """Sample the spline through points of x, y, width and depth.

    Samples are for rivers of the width `resolved` (m), by default the least one.
    """
    points = drop_repeats(points, of=2)
    resolved = float(points[:, 2].min()) if resolved is None else resolved
    step = float(np.clip(0.5 * resolved, 2.0, 12.0))
    # Large sketches have no more detail between two control points than small ones.
    spans = np.hypot(*np.diff(points[:, :2], axis=0).T)
    step = max(step, float(np.median(spans)) / _MAX_SAMPLES)
    # Finer in sharp bends: this deviation changes the bed by 0.4 ‰ of the depth.
    sagitta = _SAGITTA_WIDTHS * resolved
    line, u = sample_catmull_rom(points[:, :2], step, sagitta=sagitta, most=_MAX_SAMPLES)
    number = np.arange(len(points))
    return RiverCourse(
        id=name,
        label=label,
        parent=parent,
        joint=joint,
        line=line,
        controls=np.flatnonzero(u == np.floor(u)),
        width=np.interp(u, number, points[:, 2]),
        depth=np.interp(u, number, points[:, 3]),
        taper=taper,
    )


def part_of_course(course: RiverCourse, first: int, last: int) -> RiverCourse:
    """Return the points of a course from `first` up to `last`, exclusive."""
    if first == 0 and last == len(course.line):
        return course
    controls = course.controls[(course.controls > first) & (course.controls < last - 1)] - first
    return replace(
        course,
        line=course.line[first:last],
        controls=np.concatenate([[0], controls, [last - first - 1]]),
        width=course.width[first:last],
        depth=course.depth[first:last],
        given=course.given and (max(course.given[0] - first, 0), min(course.given[1], last) - first),
    )
