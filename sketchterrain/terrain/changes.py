"""Areas changed by an edit, so that only their tiles are rebuilt."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.array_types import Bounds, StructuredArray
from sketchterrain.features import Fill
from sketchterrain.features.edits import EditedFill
from sketchterrain.features.fill_changes import fill_difference, merge_boxes, rows_only_in
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_features, support_radii
from sketchterrain.terrain.river_changes import river_areas
from sketchterrain.terrain.sameness import bit_equal

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.features import Cover, Lake, ShapeField
    from sketchterrain.terrain.recipe import TerrainRecipe


EVERYWHERE: Bounds = (-math.inf, -math.inf, math.inf, math.inf)
"""The whole world."""

_FIELD_MARGIN = 2  # samples: the support of a field's spline


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
    settings = (dict(recipe.ground), dict(recipe.climate), recipe.material_rules)
    return recipe.extent, recipe.seed, recipe.fidelity, settings, recipe.stacks, support_radii(recipe)


def _fills(old: TerrainRecipe, new: TerrainRecipe) -> tuple[StructuredArray, StructuredArray] | None:
    """Return the fill features that only the old or only the new recipe has; None if unknown."""
    if old.fill is new.fill or max(old.fill.max_radius, new.fill.max_radius) == 0:
        return old.painted[:0], new.painted[:0]
    if isinstance(old.fill, Fill | EditedFill) and isinstance(new.fill, Fill | EditedFill):
        return fill_difference(old.fill, new.fill)
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
