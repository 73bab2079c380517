"""What an edit changed, as areas: so that only their tiles are built again."""

from __future__ import annotations

import dataclasses
import math
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.features import Fill
from sketchterrain.features.edits import EditedFill
from sketchterrain.features.fill_changes import fill_difference, merge_boxes, rows_only_in
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_features, support_radii
from sketchterrain.terrain.river_changes import river_areas

if TYPE_CHECKING:
    from collections.abc import Sequence

    from sketchterrain.features import Cover, Lake, ShapeField
    from sketchterrain.features.catalogue import Points
    from sketchterrain.terrain.recipe import TerrainRecipe

Box = tuple[float, float, float, float]

EVERYWHERE: Box = (-math.inf, -math.inf, math.inf, math.inf)
"""The whole world."""

_FIELD_MARGIN = 2  # samples around a field that its spline may read


def changed_areas(old: TerrainRecipe, new: TerrainRecipe) -> list[Box]:
    """Return where two terrains may differ; everywhere else every height and mask has the same bits.

    Parameters
    ----------
    old, new
        The recipes before and after an edit.

    Returns
    -------
    list of (west, south, east, north)
        Rectangles in metres, the borders included: empty if nothing changed, one without bounds if anything
        did that the whole world depends on (ground, climate, materials' rules, seed, extent, fidelity,
        densities). A tile's normals read one vertex beyond its border: widen the areas by the cell size to
        choose tiles.
    """
    if _of_the_world(old) != _of_the_world(new):
        return [EVERYWHERE]
    fills = _fills(old, new)
    if fills is None:
        return [EVERYWHERE]
    # What was of the fill and now is a person's own, unchanged, is in both.
    gone = np.concatenate([rows_only_in(old.painted, new.painted), fills[0]])
    come = np.concatenate([rows_only_in(new.painted, old.painted), fills[1]])
    boxes = _around_features(old, rows_only_in(gone, come)) + _around_features(new, rows_only_in(come, gone))
    for one, other in ((old, new), (new, old)):
        boxes += _around_fields(one.lakes, other.lakes)
        boxes += _around_fields(one.covers, other.covers)
    return merge_boxes([*boxes, *river_areas(old, new)])


def touches(areas: Sequence[Box], bounds: Box, *, margin: float = 0.0) -> bool:
    """Whether a rectangle (west, south, east, north, m), widened by a margin (m), meets any of the areas.

    A tile is the same as before unless its bounds, widened by its cell size, do.
    """
    west, south, east, north = bounds
    return any(
        w <= east + margin and e >= west - margin and s <= north + margin and n >= south - margin
        for w, s, e, n in areas
    )


def _of_the_world(recipe: TerrainRecipe) -> tuple[object, ...]:
    """Return what heights and masks depend on everywhere."""
    settings = (dict(recipe.ground), dict(recipe.climate), recipe.material_rules)
    return recipe.extent, recipe.seed, recipe.fidelity, settings, recipe.stacks, support_radii(recipe)


def _fills(old: TerrainRecipe, new: TerrainRecipe) -> tuple[Points, Points] | None:
    """Return the features that only the one or the other fill has; None if that cannot be told."""
    if old.fill is new.fill or max(old.fill.max_radius, new.fill.max_radius) == 0:
        return old.painted[:0], new.painted[:0]
    if isinstance(old.fill, Fill | EditedFill) and isinstance(new.fill, Fill | EditedFill):
        return fill_difference(old.fill, new.fill)
    return None


def _around_features(recipe: TerrainRecipe, features: Points) -> list[Box]:
    packed = pack_features(recipe, features, 0.0)
    at = packed.at * metres_per_unit(recipe.extent)
    return _boxes(at, at, packed.support)


def _around_fields(
    own: Sequence[Lake] | Sequence[Cover], others: Sequence[Lake] | Sequence[Cover]
) -> list[Box]:
    """Rectangles around the lakes or covers that are not among the others, bit for bit."""
    there = [_contents(each) for each in others]
    return [_field_box(each.shape) for each in own if _contents(each) not in there]


def _contents(value: Any) -> object:
    if dataclasses.is_dataclass(value):
        return tuple(_contents(getattr(value, each.name)) for each in dataclasses.fields(value))
    return (value.shape, value.tobytes()) if isinstance(value, np.ndarray) else value


def _field_box(field: ShapeField) -> Box:
    rows, columns = field.inside.shape
    margin = _FIELD_MARGIN * field.spacing
    east, north = field.west + (columns - 1) * field.spacing, field.south + (rows - 1) * field.spacing
    return field.west - margin, field.south - margin, east + margin, north + margin


def _boxes(low: Any, high: Any, reach: Any) -> list[Box]:
    sides = np.column_stack([low - reach[:, None], high + reach[:, None]])
    return [(float(w), float(s), float(e), float(n)) for w, s, e, n in sides]
