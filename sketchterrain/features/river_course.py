"""The course of a reach: from skeleton pixels to a spline in the world, with the sizes its labels say."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.features.hashing import hash_unit
from sketchterrain.features.river_network import exit_normal
from sketchterrain.features.river_path import EXTENSION_SHARE, arc_length, extend_path, smoothed, spaced
from sketchterrain.features.river_sizes import painted_sizes
from sketchterrain.features.rounding import STEP, rounded
from sketchterrain.features.splines import drop_repeats, sample_catmull_rom
from sketchterrain.features.user_features import pixel_id

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from sketchterrain.features.river_network import Reach
    from sketchterrain.features.skeleton import Skeleton
    from sketchterrain.sketch.document import Sketch


LAKE_GAP = 3.0
"""Pixels between a river's painted end and a lake that a person does not mean."""
_MOST_SAMPLES = 64  # of a centreline between two control points
_SAGITTA_WIDTHS = 0.01


@dataclass(frozen=True, eq=False)
class RiverCourse:
    """A reach on its way to becoming a River, upstream first.

    Attributes
    ----------
    id, label : int
        As in River.
    parent : RiverCourse or None
        What it joins.
    joint : int
        Index on the parent's centreline; -1 without a parent.
    line : (m, 2) float64
        Centreline (m).
    controls : (n,) int
        Indices of the control points on the centreline.
    width, depth : (m,) float64
        What the labels say (m).
    taper : float
        Length (m) over which the river grows from its spring.
    grows : bool
        Whether it widens from its spring on and at confluences; not if it is as wide as painted.
    """

    id: int
    label: int
    parent: RiverCourse | None
    joint: int
    line: Float64Array
    controls: npt.NDArray[np.intp]
    width: Float64Array
    depth: Float64Array
    taper: float
    grows: bool = True


def pixel_positions(sketch: Sketch, skeleton: Skeleton, pixels: Int64Array) -> Float64Array:
    """Centres (m) of skeleton pixels, (n, 2)."""
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
    """Draw a reach as a spline, on beyond the sketch's edge where it leaves the sketch.

    An end painted up to a lake (its pixels' rows and columns: `lake`) is carried on into it.
    """
    pixels, loose = reach.pixels, 1.0 - sketch.fidelity
    interval = (4.0 + 4.0 * loose) * sketch.pixel_size
    path, joint = pixel_positions(sketch, skeleton, pixels), -1
    if parent is not None:
        joint = 1 + int(np.argmin(((parent.line[1:] - path[-1]) ** 2).sum(axis=1)))
        path[-1] = parent.line[joint]
    widths, depths, label = painted_sizes(sketch, skeleton, pixels, joins=parent is not None)
    drawn = np.column_stack([smoothed(path, 2.0 + 3.0 * loose), widths, depths])
    if lake is not None:
        drawn = _into_lake(drawn[::-1], sketch, skeleton, int(pixels[0]), lake)[::-1]
        if parent is None:
            drawn = _into_lake(drawn, sketch, skeleton, int(pixels[-1]), lake)
    points = spaced(drawn, interval)

    name = _id(sketch, skeleton, int(pixels[0]))
    size = (sketch.height_px, sketch.width_px)
    beyond = EXTENSION_SHARE * max(size) * sketch.pixel_size
    taper = float(arc_length(points)[-1]) / 3.0
    if parent is None and (out := exit_normal(skeleton, pixels, size)):
        points = _lengthened(points, out, length=beyond, interval=interval, seed=seed, name=2 * name)
    if out := exit_normal(skeleton, pixels[::-1], size):
        upstream = _lengthened(
            points[::-1], out, length=beyond, interval=interval, seed=seed, name=2 * name + 1
        )
        points, taper = upstream[::-1], beyond
    # Where a river joins another, its end is a point of the other's curve.
    own = len(points) - (parent is not None)
    points[:own, :2] = rounded(points[:own, :2], _step(sketch))
    course = course_through(points, name, label, parent=parent, joint=joint, taper=taper)
    return replace(course, grows=sketch.properties("river", label)["width"] > 0.0)


def dab_course(sketch: Sketch, skeleton: Skeleton, pixels: Int64Array, *, seed: int) -> RiverCourse:
    """Draw a short straight reach over a dab; which end is the spring is not yet known."""
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
    """Return what control points are rounded to (m): finer where a pixel is less than a quarter metre."""
    return min(STEP, math.ldexp(1.0, math.frexp(sketch.pixel_size)[1] - 9))


def reversed_course(course: RiverCourse) -> RiverCourse:
    """Return a dab's course the other way round."""
    return replace(
        course,
        line=course.line[::-1],
        controls=len(course.line) - 1 - course.controls[::-1],
        width=course.width[::-1],
        depth=course.depth[::-1],
    )


def _into_lake(
    drawn: Float64Array, sketch: Sketch, skeleton: Skeleton, end: int, lake: cKDTree
) -> Float64Array:
    """Carry a path on from its last point to a little within the shore, if that is as near as meant."""
    at = np.array([skeleton.rows[end], skeleton.columns[end]], dtype=np.float64)
    gap, nearest = lake.query(at)
    if not 0.0 < gap <= float(skeleton.depth[end]) + LAKE_GAP:
        return drawn
    ahead = (np.asarray(lake.data)[int(nearest)] - at) * (1.0 + 2.0 / gap)
    to_others = np.hypot(skeleton.rows - at[0] - ahead[0], skeleton.columns - at[1] - ahead[1])
    if to_others.min() < np.hypot(*ahead) - 1e-6:
        return drawn  # another reach lies between
    step = ahead * sketch.pixel_size
    more = np.array([step[1], -step[0], 0.0, 0.0])
    return np.concatenate([drawn, drawn[-1:] + more])


def _id(sketch: Sketch, skeleton: Skeleton, pixel: int) -> int:
    at = slice(pixel, pixel + 1)
    return int(pixel_id("river", skeleton.rows[at], skeleton.columns[at], sketch.width_px)[0])


def _lengthened(
    points: Float64Array, out: tuple[float, float], *, length: float, interval: float, seed: int, name: int
) -> Float64Array:
    """Carry a river on from its last point; width and depth stay what they were there."""
    more = extend_path(points[:, :2], out, length=length, interval=interval, seed=seed, name=name)
    sizes = np.broadcast_to(points[-1, 2:], (len(more), 2))
    return np.concatenate([points, np.column_stack([more, sizes])])


def course_through(
    points: Float64Array, name: int, label: int, *, parent: RiverCourse | None, joint: int, taper: float
) -> RiverCourse:
    """Sample the spline through points of x, y, width and depth."""
    points = drop_repeats(points, of=2)
    step = float(np.clip(0.5 * points[:, 2].min(), 2.0, 12.0))
    # A sketch of a continent has no more shape between two control points than one of a valley.
    spans = np.hypot(*np.diff(points[:, :2], axis=0).T)
    step = max(step, float(np.median(spans)) / _MOST_SAMPLES)
    # Where it bends sharply, closer: off its line by this much the bed is shallower by 0.4 ‰ of the depth.
    sagitta = _SAGITTA_WIDTHS * float(points[:, 2].min())
    line, u = sample_catmull_rom(points[:, :2], step, sagitta=sagitta, most=_MOST_SAMPLES)
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
