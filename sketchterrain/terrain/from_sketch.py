"""From a sketch to a recipe, and from a recipe to a terrain."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.compute import ComputeContext
from sketchterrain.features import Fill, place
from sketchterrain.features.covers import create_covers
from sketchterrain.features.edits import EditedFill, EditedPoints, apply_fill_edits, apply_painted_edits
from sketchterrain.features.memory import PlacementCache
from sketchterrain.features.rivers import trace_hydrology
from sketchterrain.sketch import resolved_rules
from sketchterrain.terrain.balance import StrengthCache, solve_strengths
from sketchterrain.terrain.centrelines import valley_radius
from sketchterrain.terrain.changes import changed_areas
from sketchterrain.terrain.dry_ground import DryTerrain, DryTerrainCache
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.terrain import Terrain

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.array_types import Bounds, StructuredArray
    from sketchterrain.sketch import Sketch


def build(
    sketch: Sketch,
    *,
    seed: int | None = None,
    device: str | ComputeContext | None = None,
    memory: PlacementCache | None = None,
) -> Terrain:
    """Place a sketch's features and open a device; no part of the terrain is computed yet.

    Parameters
    ----------
    sketch
    seed
        Overrides the sketch's own.
    device
        An open :class:`~sketchterrain.compute.ComputeContext`, or a selector as for
        :func:`~sketchterrain.compute.choose_device`.
    memory
        Cache of earlier terrains built in this thread, of any sketch; it saves time.

    Raises
    ------
    DeviceError
        If there is no such device.
    """
    context = device if isinstance(device, ComputeContext) else ComputeContext(device)
    if seed is not None:
        sketch = sketch.replace(seed=seed)
    memory = PlacementCache() if memory is None else memory
    return Terrain(sketch, make_recipe(sketch, memory=memory), context, memory=memory)


def rebuild(
    terrain: Terrain, sketch: Sketch, *, checkpoint: Callable[[], None] | None = None
) -> tuple[Terrain, list[Bounds]]:
    """Return the terrain of a changed sketch on the same device, and the areas where it may differ.

    Cached placement is reused; the bits are those of `build`. Only tiles that the areas touch have changed,
    see :func:`~sketchterrain.terrain.changed_areas`. ``checkpoint`` is as for `make_recipe`.
    """
    recipe = make_recipe(sketch, memory=terrain.memory, checkpoint=checkpoint)
    areas = changed_areas(terrain.recipe, recipe)
    return terrain.updated(sketch, recipe, areas), areas


def make_recipe(
    sketch: Sketch, *, memory: PlacementCache | None = None, checkpoint: Callable[[], None] | None = None
) -> TerrainRecipe:
    """Place the features of a sketch, in plain NumPy without a device.

    Edits come between placing and filling, so that the fill avoids moved features. Rivers come last: they
    follow the terrain that the other features form. ``memory`` caches earlier recipes, of any sketch; the
    bits are the same. ``checkpoint`` is called between steps; it may raise to cancel, which leaves the cache
    valid.
    """
    memory = PlacementCache() if memory is None else memory
    if checkpoint is None:

        def checkpoint() -> None: ...

    placed = place(sketch, seed=sketch.seed, memory=memory, checkpoint=checkpoint)
    painted = apply_painted_edits(placed, sketch.edits)
    fill = Fill(sketch, painted.points, seed=sketch.seed, memory=memory)
    adopted = apply_fill_edits(fill, sketch.edits, size=sketch.size)
    dry = TerrainRecipe(
        extent=sketch.extent,
        seed=sketch.seed,
        fidelity=sketch.fidelity,
        ground=sketch.ground,
        climate=sketch.climate,
        painted=painted.points,
        fill=EditedFill(fill, adopted.replaced) if adopted.replaced.size else fill,
        covers=create_covers(sketch, memory=memory),
        material_rules=resolved_rules(sketch.material_rules),
    )
    checkpoint()
    strong = _solved_features(dry, painted, memory, checkpoint)
    dry = replace(dry, painted=np.concatenate([strong, adopted.points]))
    terrain = DryTerrain(dry, memory.part(DryTerrainCache))
    waters = trace_hydrology(sketch, seed=sketch.seed, ground=terrain, memory=memory, checkpoint=checkpoint)
    terrain.store()
    return replace(
        dry,
        rivers=waters.rivers,
        valley_radii=tuple(valley_radius(*each) for each in zip(waters.rivers, waters.grounds, strict=True)),
        lakes=waters.lakes,
        resolutions=waters.resolutions,
        orphans=(*painted.orphans, *adopted.orphans, *waters.orphans),
    )


def _solved_features(
    dry: TerrainRecipe, edited: EditedPoints, memory: PlacementCache, checkpoint: Callable[[], None]
) -> StructuredArray:
    """Return the features with solved strengths, and locked ones with their own."""
    asked = replace(dry, painted=edited.unlocked)
    solved = solve_strengths(
        asked, locked=edited.lock_only, memory=memory.part(StrengthCache), checkpoint=checkpoint
    )
    points = edited.points.copy()
    points["strength"] = np.where(edited.locked, points["strength"], solved["strength"])
    return points
