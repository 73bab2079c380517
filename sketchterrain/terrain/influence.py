"""How far an edit or a stroke can matter: farther away, every height keeps its bits."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from sketchterrain.features import FEATURE_TYPES, Fill
from sketchterrain.features.edits import EditedFill
from sketchterrain.features.fill_reach import fill_influence
from sketchterrain.features.memory import PlacementCache
from sketchterrain.features.placement import placement_influence
from sketchterrain.terrain.centrelines import TOLERANCE_CELLS
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import pack_rivers, support_radii

if TYPE_CHECKING:
    from sketchterrain.terrain.recipe import TerrainRecipe

# Samples around a field that its spline may read, and by how many its border may be moved.
_FIELD_MARGIN = 2 * math.sqrt(2) + 2


def influence(recipe: TerrainRecipe, *, stroke: bool = True) -> float:
    """Return how far (m) a change can matter, from the recipe's own radii and from the rules.

    Farther away from what was changed inside the sketch, every height keeps its bits. Take the greater of the
    distances before and after. What was changed is, before and after: each shape that was painted on, each
    feature that was edited, each river and lake whose course or level is another one (these depend on all of
    the ground on a river's way), and each feature whose strength is another one (features that overlap, one
    after another, reach their heights together: ``balance``).

    Parameters
    ----------
    recipe
        Of a sketch; one that was made otherwise has nothing that looks around.
    stroke
        Whether something was painted. Other features then look anew for their places; edits they do not heed.
    """
    fill = recipe.fill.fill if isinstance(recipe.fill, EditedFill) else recipe.fill
    support = support_radii(recipe)
    places = dict.fromkeys(FEATURE_TYPES, 0.0)
    changes: list[tuple[float, str, float | None]] = []
    if stroke and isinstance(fill, Fill):
        places = placement_influence(fill.sketch, seed=fill.seed, memory=PlacementCache())
        changes += [(0.0, layer, None) for layer in fill.sketch.layers]
    far = _around_waters(recipe)
    for code, name in enumerate(FEATURE_TYPES):
        radii = recipe.painted["radius"][recipe.painted["type"] == code]
        if radii.size:
            far.append(places[name] + float(radii.max()) * support)
            changes.append((places[name], name, float(radii.max())))
    if isinstance(fill, Fill):
        far.append(fill_influence(fill, changes, support=support))
    return max(far, default=0.0) + 3 * metres_per_unit(recipe.extent)


def _around_waters(recipe: TerrainRecipe) -> list[float]:
    """How far (m) from rivers, lakes and covers the ground or its material is theirs."""
    fields = [lake.shape for lake in recipe.lakes] + [cover.shape for cover in recipe.covers]
    far = [_FIELD_MARGIN * field.spacing - float(field.inside.min()) for field in fields]
    if recipe.rivers:
        far += [float(pack_rivers(recipe, cell).reach.max()) * (1 + 1e-5) for cell in TOLERANCE_CELLS]
    return far
