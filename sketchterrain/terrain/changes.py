"""Areas where two recipes differ, so that an edit rebuilds only their tiles."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, Float64Array, LatticeArray, StructuredArray
from sketchterrain.placement.differences import merge_boxes, rows_only_in
from sketchterrain.placement.feature_types import Cover, Lake, ShapeField
from sketchterrain.placement.fill import Fill
from sketchterrain.terrain.centrelines import MAX_TOLERANCE, TOLERANCE_CELLS, PreparedCentreline
from sketchterrain.terrain.kernel_arguments import bit_equal
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_features, prepared_centrelines, support_radii
from sketchterrain.terrain.recipe import TerrainRecipe

EVERYWHERE: Bounds = (-math.inf, -math.inf, math.inf, math.inf)
"""The whole world."""

_FIELD_MARGIN = 2  # samples: the support of a field's spline
_OVERLAP = 0.5  # of the smaller rectangle, required to join two


def changed_areas(old: TerrainRecipe, new: TerrainRecipe) -> list[Bounds]:
    """Return rectangles (west, south, east, north, m) outside which two terrains are bit-equal.

    Empty if nothing changed; `EVERYWHERE` if anything global did (ground, climate, material rules, seed,
    extent, fidelity, densities). A tile's normals read one vertex beyond its border: widen the areas by the
    cell size to select tiles.
    """
    if _global_key(old) != _global_key(new):
        return [EVERYWHERE]
    fills = _fills(old, new)
    if fills is None:
        return [EVERYWHERE]
    # A fill feature that an edit made a painted one, unchanged, is in both.
    removed = np.concatenate([rows_only_in(old.painted, new.painted), fills[0]])
    added = np.concatenate([rows_only_in(new.painted, old.painted), fills[1]])
    boxes = _around_features(old, rows_only_in(removed, added)) + _around_features(
        new, rows_only_in(added, removed)
    )
    for one, other in ((old, new), (new, old)):
        boxes += _around_fields(one.lakes, other.lakes)
        boxes += _around_fields(one.covers, other.covers)
    return merge_boxes([*boxes, *river_areas(old, new)])


def touches(areas: Sequence[Bounds], bounds: Bounds, *, margin: float = 0.0) -> bool:
    """Return whether a rectangle (west, south, east, north, m), widened by a margin, overlaps any area.

    A tile is unchanged unless its bounds, widened by its cell size, do.
    """
    west, south, east, north = bounds
    return any(
        w <= east + margin and e >= west - margin and s <= north + margin and n >= south - margin
        for w, s, e, n in areas
    )


def _global_key(recipe: TerrainRecipe) -> tuple[object, ...]:
    """Return everything that heights and masks depend on everywhere."""
    settings = (dict(recipe.ground), dict(recipe.climate), recipe.materials, recipe.material_rules)
    return recipe.extent, recipe.seed, recipe.fidelity, settings, recipe.stacks, support_radii(recipe)


def _fills(old: TerrainRecipe, new: TerrainRecipe) -> tuple[StructuredArray, StructuredArray] | None:
    """Return the fill features that only the old or only the new recipe has; None if unknown."""
    if old.fill is new.fill or max(old.fill.max_radius, new.fill.max_radius) == 0:
        return old.painted[:0], new.painted[:0]
    if isinstance(old.fill, Fill) and isinstance(new.fill, Fill):
        return old.fill.difference(new.fill)
    return None


def _around_features(recipe: TerrainRecipe, features: StructuredArray) -> list[Bounds]:
    packed = pack_features(recipe, features, 0.0)
    at, support = packed.at * metres_per_unit(recipe.extent), packed.support[:, None]
    sides = np.column_stack([at - support, at + support])
    return [(float(w), float(s), float(e), float(n)) for w, s, e, n in sides]


def _around_fields(
    own: Sequence[Lake] | Sequence[Cover], others: Sequence[Lake] | Sequence[Cover]
) -> list[Bounds]:
    """Return rectangles around the lakes or covers that are not bit-equal to any of the others."""
    return [_field_box(each.shape) for each in own if not any(bit_equal(each, other) for other in others)]


def _field_box(field: ShapeField) -> Bounds:
    rows, columns = field.inside.shape
    margin = _FIELD_MARGIN * field.spacing
    east, north = field.west + (columns - 1) * field.spacing, field.south + (rows - 1) * field.spacing
    return field.west - margin, field.south - margin, east + margin, north + margin


def river_areas(old: TerrainRecipe, new: TerrainRecipe) -> list[Bounds]:
    """Return rectangles (west, south, east, north, m) outside which rivers are the same, for one extent.

    The arcs of a river between two control points depend on the curve there, on the samples of the centreline
    from one control point to the other, and on which of these are ends of arcs: where all of these are
    bit-equal, so are the arcs for every cell size.
    """
    courses = [prepared_centrelines(recipe) for recipe in (old, new)]
    unit = metres_per_unit(new.extent)
    unchanged = {id(course) for _, course in courses[0]} & {id(course) for _, course in courses[1]}
    spans = [_parts([each for each in own if id(each[1]) not in unchanged], unit) for own in courses]
    areas: dict[Bounds, None] = {}
    for own, others in (spans, spans[::-1]):
        run: Bounds | None = None
        for contents, box in own.items():
            if contents in others:
                continue
            joined = None if run is None else _joined(run, box)
            if joined is None and run is not None:
                areas[run] = None
            run = box if joined is None else joined
        if run is not None:
            areas[run] = None
    return list(areas)


def _parts(courses: list[tuple[LatticeArray, PreparedCentreline]], unit: float) -> dict[bytes, Bounds]:
    """Return the inputs of the arcs between two control points, and the box of their support."""
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
    """Return the first and last sample of the centreline on each cubic of the spline, both ends included."""
    number = np.arange(len(course.curve), dtype=np.float64)
    return (
        np.searchsorted(course.along, number, side="right") - 1,
        np.searchsorted(course.along, number + 1.0, side="left"),
    )


def _boxes(
    course: PreparedCentreline, first: npt.NDArray[np.intp], last: npt.NDArray[np.intp], *, margin: float
) -> Float64Array:
    """Return rectangles (m, relative to the centreline's source) around each cubic, as wide as the valley."""
    c = course.curve
    # A cubic is within the corners of its Bézier form.
    corners = np.stack(
        [c[..., 0], c[..., 0] + c[..., 1] / 3, c[..., 0] + (2 * c[..., 1] + c[..., 2]) / 3, c.sum(axis=-1)]
    )
    pairs = np.stack([first, np.minimum(last + 1, len(course.line) - 1)], axis=-1).ravel()
    radius = np.maximum(np.maximum.reduceat(course.line[:, 5], pairs)[::2], course.line[last, 5])
    wide = (radius * (1 + 1e-5) + margin)[:, None]
    return np.column_stack([corners.min(axis=0) - wide, corners.max(axis=0) + wide])


def _joined(one: Bounds, other: Bounds) -> Bounds | None:
    """Return one rectangle around two, if it is little larger than both."""
    around = (*map(min, one[:2], other[:2]), *map(max, one[2:], other[2:]))
    box = (around[0], around[1], around[2], around[3])
    alone = (_area(one), _area(other))
    return box if _area(box) <= sum(alone) - _OVERLAP * min(alone) else None


def _area(box: Bounds) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])
