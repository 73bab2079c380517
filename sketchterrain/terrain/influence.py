"""Radius of influence of an edit or a stroke: beyond it, every height is bit-equal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sketchterrain.placement.cache import PlacementCache
from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.placement.fill import Fill
from sketchterrain.placement.placement import placement_influence
from sketchterrain.terrain.centrelines import TOLERANCE_CELLS
from sketchterrain.terrain.edits import EditedFill
from sketchterrain.terrain.fill_changes import fill_influence
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_rivers, support_radii

if TYPE_CHECKING:
    from sketchterrain.terrain.recipe import TerrainRecipe

# Samples: the support of a field's spline, and the greatest displacement of its border.
_FIELD_MARGIN = 2 * math.sqrt(2) + 2


def influence(recipe: TerrainRecipe, *, stroke: bool = True) -> float:
    """Return the radius (m) beyond which a change inside the sketch has no effect.

    Use the greater of the radii before and after. Changes are, before and after: each painted shape, each
    edited feature, each river and lake whose course or level changed (which depend on the terrain all along a
    river), and each feature whose strength changed (overlapping features share their heights: ``balance``).
    After a ``stroke`` other features are placed again; after an edit they are not.
    """
    fill = recipe.fill.fill if isinstance(recipe.fill, EditedFill) else recipe.fill
    support = support_radii(recipe)
    places = dict.fromkeys(FEATURE_TYPES, 0.0)
    changes: list[tuple[float, str, float | None]] = []
    if stroke and isinstance(fill, Fill):
        places = placement_influence(fill.sketch, seed=fill.seed, cache=PlacementCache())
        changes += [(0.0, layer, None) for layer in fill.sketch.layers]
    distances = _water_supports(recipe)
    for code, name in enumerate(FEATURE_TYPES):
        radii = recipe.painted["radius"][recipe.painted["type"] == code]
        if radii.size:
            distances.append(places[name] + float(radii.max()) * support)
            changes.append((places[name], name, float(radii.max())))
    if isinstance(fill, Fill):
        distances.append(fill_influence(fill, changes, support=support))
    return max(distances, default=0.0) + 3 * metres_per_unit(recipe.extent)


def _water_supports(recipe: TerrainRecipe) -> list[float]:
    """Return the supports (m) of rivers, lakes and covers."""
    fields = [lake.shape for lake in recipe.lakes] + [cover.shape for cover in recipe.covers]
    distances = [_FIELD_MARGIN * field.spacing - float(field.inside.min()) for field in fields]
    if recipe.rivers:
        distances += [float(pack_rivers(recipe, cell).support.max()) * (1 + 1e-5) for cell in TOLERANCE_CELLS]
    return distances
