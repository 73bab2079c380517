"""Where an edit changed rivers, found from their splines without flattening them.

The pieces of a river between two control points depend on the curve there, on the samples of the centreline
from the one control point to the other, and on what of these is kept: where all of that is the same, so are
the pieces for every cell size.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.centrelines import MAX_TOLERANCE, TOLERANCE_CELLS, PreparedCentreline
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import prepared_centrelines

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Bounds, Float64Array
    from sketchterrain.terrain.recipe import TerrainRecipe


_OVERLAP = 0.5  # of the smaller rectangle, beyond what joining two neighbours adds


def river_areas(old: TerrainRecipe, new: TerrainRecipe) -> list[Bounds]:
    """Return rectangles (west, south, east, north, m) outside of which rivers do the same in two recipes.

    Both are of one extent.
    """
    courses = [prepared_centrelines(recipe) for recipe in (old, new)]
    unit = metres_per_unit(new.extent)
    kept = {id(course) for _, course in courses[0]} & {id(course) for _, course in courses[1]}
    parts = [_parts([each for each in own if id(each[1]) not in kept], unit) for own in courses]
    found: dict[Bounds, None] = {}
    for own, others in (parts, parts[::-1]):
        run: Bounds | None = None
        for contents, box in own.items():
            if contents in others:
                continue
            joined = None if run is None else _joined(run, box)
            if joined is None and run is not None:
                found[run] = None
            run = box if joined is None else joined
        if run is not None:
            found[run] = None
    return list(found)


def _parts(
    courses: list[tuple[npt.NDArray[np.int64], PreparedCentreline]], unit: float
) -> dict[bytes, Bounds]:
    """Return what the pieces between two control points are made from, and where they have any effect."""
    parts: dict[bytes, Bounds] = {}
    for anchor, course in courses:
        first, last = _spans(course)
        samples = np.column_stack([course.along, course.line, course.anchors, course.steep])
        widest = float(course.river.centreline_width.max())
        whole = anchor.tobytes() + bytes(widest > 2.0 * cell for cell in TOLERANCE_CELLS)
        boxes = _boxes(course, first, last, margin=MAX_TOLERANCE + 3.0 * unit) + np.tile(anchor * unit, 2)
        for number, box in enumerate(boxes.tolist()):
            own = samples[first[number] : last[number] + 1].tobytes()
            parts[whole + course.curve[number].tobytes() + own] = (box[0], box[1], box[2], box[3])
    return parts


def _spans(course: PreparedCentreline) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """First and last sample of the centreline on each cubic of the spline, its two ends included."""
    number = np.arange(len(course.curve), dtype=np.float64)
    return (
        np.searchsorted(course.along, number, side="right") - 1,
        np.searchsorted(course.along, number + 1.0, side="left"),
    )


def _boxes(
    course: PreparedCentreline, first: npt.NDArray[np.intp], last: npt.NDArray[np.intp], *, margin: float
) -> Float64Array:
    """Rectangles (m, from the course's own origin) around each cubic, as wide as its river reaches."""
    c = course.curve
    # A cubic lies within the corners of its Bézier form.
    corners = np.stack(
        [c[..., 0], c[..., 0] + c[..., 1] / 3, c[..., 0] + (2 * c[..., 1] + c[..., 2]) / 3, c.sum(axis=-1)]
    )
    pairs = np.stack([first, np.minimum(last + 1, len(course.line) - 1)], axis=-1).ravel()
    reach = np.maximum(np.maximum.reduceat(course.line[:, 5], pairs)[::2], course.line[last, 5])
    wide = (reach * (1 + 1e-5) + margin)[:, None]
    return np.column_stack([corners.min(axis=0) - wide, corners.max(axis=0) + wide])


def _joined(one: Bounds, other: Bounds) -> Bounds | None:
    """Return one rectangle around two, if it is little larger than both."""
    around = (*map(min, one[:2], other[:2]), *map(max, one[2:], other[2:]))
    box = (around[0], around[1], around[2], around[3])
    alone = (_area(one), _area(other))
    return box if _area(box) <= sum(alone) - _OVERLAP * min(alone) else None


def _area(box: Bounds) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])
