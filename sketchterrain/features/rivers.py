"""Rivers: from what was painted to centrelines with width, depth and a falling water level."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.features.contradictions import crossings, mountain_numbers, resolutions
from sketchterrain.features.lakes import lake_pixels, mouth_lakes, painted_lakes, settled
from sketchterrain.features.river_beyond import kept_apart
from sketchterrain.features.river_course import (
    LAKE_GAP,
    Course,
    dab_course,
    pixel_positions,
    reach_course,
    turned,
)
from sketchterrain.features.river_edits import edited_courses, kept_lakes
from sketchterrain.features.river_gaps import without_gaps
from sketchterrain.features.river_network import exit_normal, longest_path, reaches_to, river_ends
from sketchterrain.features.river_shape import network_of
from sketchterrain.features.river_water import rivers_of
from sketchterrain.features.skeleton import skeletons

if TYPE_CHECKING:
    from scipy.spatial import cKDTree

    from sketchterrain.features.catalogue import Lake, River
    from sketchterrain.features.contradictions import Resolution
    from sketchterrain.features.river_network import RiverEnd
    from sketchterrain.features.skeleton import Skeleton
    from sketchterrain.sketch.document import Sketch

Floats = npt.NDArray[np.float64]
Ground: TypeAlias = Callable[[Floats, Floats], npt.NDArray[np.floating[Any]]]

_EDGE_BONUS = (10.0, 0.02)
"""A mouth at the sketch's edge may lie this much higher: metres, and metres for each metre of river."""

_LONGEST_DAB = 2.0  # px; so short a skeleton is a dab, however thin


def trace_rivers(sketch: Sketch, *, seed: int, ground: Ground) -> tuple[River, ...]:
    """Trace the rivers that were painted.

    Painted regions of any label that touch are one network, and so is an end painted a few pixels short of
    another river's middle. A dab that is no longer than it is wide, even
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
        ``ground(x, y)``: height (m) of the land without rivers, for 1-D float64 arrays of positions (m). It
        is called twice: for all ends, then for all centrelines.

    Returns
    -------
    tuple of River, sorted by id. Along each centreline the water level falls by at least 1e-4 m a metre; a
    tributary's last point is a point of the centreline that it joins, z included.

    Raises
    ------
    InputError
        If `ground` returns something of another shape, or not finite.
    """
    return trace_waters(sketch, seed=seed, ground=ground).rivers


@dataclass(frozen=True, eq=False)
class Waters:
    """Rivers, lakes, and what was decided about them.

    Attributes
    ----------
    rivers : tuple of River
        Sorted by id.
    lakes : tuple of Lake
        Painted ones in reading order, then those in which rivers end beyond the sketch.
    resolutions : tuple of Resolution
        One line for each contradiction between layers, and where; see `contradictions`.
    orphans : tuple of str
        One line for each edit that found nothing to change.
    grounds : tuple of (m,) float64
        Height (m) of the ground without rivers along each river's centreline.
    """

    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...]
    resolutions: tuple[Resolution, ...]
    orphans: tuple[str, ...]
    grounds: tuple[Floats, ...]


def trace_waters(sketch: Sketch, *, seed: int, ground: Ground) -> Waters:
    """Trace rivers as `trace_rivers` does, and lay out the lakes that they run through and end in.

    `ground` is called once more, for the shores of all lakes.
    """
    lakes = painted_lakes(sketch, ground)
    courses = _laid_out(sketch, seed, ground)
    courses, orphans = edited_courses(courses, sketch.edits)
    courses = kept_apart(courses, sketch.size)
    lakes, lost = kept_lakes([*lakes, *mouth_lakes(sketch, courses, seed=seed)], sketch.edits)
    rivers, lakes, grounds = _with_water(sketch, courses, lakes, ground)
    decided = resolutions(sketch, mountain_numbers(sketch), rivers, grounds, lakes)
    return Waters(tuple(rivers), tuple(lakes), decided, orphans + lost, tuple(grounds))


def _laid_out(sketch: Sketch, seed: int, ground: Ground) -> list[Course]:
    """Draw the courses of all networks, parents first, before a person's edits."""
    found, outlines = _networks(sketch, seed)
    if not found:
        return []
    rivers = [(bone, each) for bone, each in zip(found, outlines, strict=True) if isinstance(each, tuple)]
    closed = without_gaps(sketch.layers["river"], rivers, LAKE_GAP)
    if closed is not None:
        sketch = sketch.replace(layers={**sketch.layers, "river": closed})
        found, outlines = _networks(sketch, seed)
    lake = lake_pixels(sketch)
    positions = [_end_positions(sketch, *each) for each in zip(found, outlines, strict=True)]
    courses: list[Course] = []
    for skeleton, outline, heights in zip(found, outlines, _heights(ground, positions), strict=True):
        if isinstance(outline, Course):
            courses.append(outline if heights[0] >= heights[1] else turned(outline))
        else:
            mouth = _mouth(sketch, skeleton, outline, heights, lake)
            courses.extend(_courses(sketch, skeleton, mouth, seed, lake))
    return courses


def _networks(sketch: Sketch, seed: int) -> tuple[tuple[Skeleton, ...], list[Course | tuple[RiverEnd, ...]]]:
    """Find the skeletons of what was painted, and of each the dab's course or the ends."""
    found = tuple(
        replace(each, weight=np.where(each.weight > 0, each.weight, 2.0 * each.depth * sketch.pixel_size))
        for each in skeletons(sketch.layers["river"] > 0, _label_widths(sketch))
    )
    return found, [_dab_or_ends(sketch, skeleton, seed) for skeleton in found]


def _label_widths(sketch: Sketch) -> Floats:
    """Width (m) that each pixel's label says: wider rivers are main stems; 0 is as painted."""
    widths = np.ones(256)
    for label in np.unique(sketch.layers["river"]):
        if label > 0:
            widths[label] = sketch.properties("river", int(label))["width"]
    return widths[sketch.layers["river"]]


def _heights(ground: Ground, groups: list[Floats]) -> list[Floats]:
    """Ask for the ground at groups of positions, all at once."""
    at = np.concatenate(groups)
    heights = np.asarray(ground(at[:, 0].copy(), at[:, 1].copy()), dtype=np.float64)
    if heights.shape != (len(at),) or not np.isfinite(heights).all():
        raise InputError(f"expected {len(at)} finite ground heights, got shape {heights.shape} or not finite")
    return np.split(heights, np.cumsum([len(group) for group in groups])[:-1])


def _dab_or_ends(sketch: Sketch, skeleton: Skeleton, seed: int) -> Course | tuple[RiverEnd, ...]:
    path = longest_path(skeleton)
    steps = np.hypot(np.diff(skeleton.rows[path]), np.diff(skeleton.columns[path]))
    if float(steps.sum()) <= max(2.0 * float(skeleton.depth[path].max()), _LONGEST_DAB):
        return dab_course(sketch, skeleton, path, seed=seed)
    return river_ends(skeleton)


def _end_positions(sketch: Sketch, skeleton: Skeleton, outline: Course | tuple[RiverEnd, ...]) -> Floats:
    if isinstance(outline, Course):
        return outline.line[[0, -1]]
    return pixel_positions(sketch, skeleton, np.array([end.pixel for end in outline]))


def _mouth(
    sketch: Sketch, skeleton: Skeleton, ends: tuple[RiverEnd, ...], heights: Floats, lake: cKDTree | None
) -> int:
    """Choose the end farthest along the label's flow; or the lowest, rather in a lake or at the edge."""
    flow = _flow(sketch, skeleton)
    at = np.array([end.pixel for end in ends])
    if flow is not None:
        return ends[int(np.argmax(pixel_positions(sketch, skeleton, at) @ flow))].pixel
    length = max(end.length for end in ends) * sketch.pixel_size
    bonus = _EDGE_BONUS[0] + _EDGE_BONUS[1] * length
    size = (sketch.height_px, sketch.width_px)
    favoured = np.array([exit_normal(skeleton, end.lead, size) is not None for end in ends])
    if lake is not None:
        places = np.stack([skeleton.rows[at], skeleton.columns[at]], axis=-1)
        favoured |= lake.query(places)[0] <= skeleton.depth[at] + LAKE_GAP
    return ends[int(np.argmin(heights - bonus * favoured))].pixel


def _flow(sketch: Sketch, skeleton: Skeleton) -> Floats | None:
    """Direction (east, north) in which the label of most of a network says it runs; None: downhill."""
    labels = sketch.layers["river"][skeleton.rows, skeleton.columns]
    said = float(sketch.properties("river", int(np.argmax(np.bincount(labels))))["flow"])
    towards = np.deg2rad(said)
    return None if said < 0.0 else np.array([np.sin(towards), np.cos(towards)])


def _courses(sketch: Sketch, skeleton: Skeleton, mouth: int, seed: int, lake: cKDTree | None) -> list[Course]:
    """Lay out one network, parents first."""
    courses: list[Course] = []
    for reach in reaches_to(skeleton, mouth):
        parent = courses[reach.parent] if reach.parent >= 0 else None
        courses.append(reach_course(sketch, skeleton, reach, parent, seed=seed, lake=lake))
    return courses


def _with_water(
    sketch: Sketch, courses: list[Course], lakes: list[Lake], ground: Ground
) -> tuple[list[River], list[Lake], list[Floats]]:
    """Let water flow: rivers sorted by id, lakes at their levels, and the ground along each river."""
    if not courses:
        return [], lakes, []
    grounds = _heights(ground, [course.line for course in courses])
    mountains = mountain_numbers(sketch)
    cuts = [
        [(run.first, run.last) for run in crossings(sketch, mountains, course.line)] for course in courses
    ]
    network = network_of(courses, cuts)
    filled, levels = settled(lakes, network, grounds)
    rivers = rivers_of(network, levels)
    order = sorted(range(len(rivers)), key=lambda number: rivers[number].id)
    return [rivers[number] for number in order], filled, [grounds[number] for number in order]
