"""From a sketch to a recipe, and from a recipe to a terrain one can ask."""

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
from sketchterrain.terrain.balance import BalanceMemory, balanced
from sketchterrain.terrain.centrelines import valley_reach
from sketchterrain.terrain.changes import changed_areas
from sketchterrain.terrain.dry_ground import DryGround, GroundMemory
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.terrain import Terrain

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.features.catalogue import Points
    from sketchterrain.sketch import Sketch
    from sketchterrain.terrain.changes import Box


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
        In place of the sketch's own.
    device
        An open :class:`~sketchterrain.compute.ComputeContext`, or a selector as for
        :func:`~sketchterrain.compute.choose_device`.
    memory
        Of terrains built before in this thread, of this or of any other sketch: it saves time.

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
) -> tuple[Terrain, list[Box]]:
    """Return the terrain of a changed sketch on the same device, and where it may differ.

    What the terrain remembers of its placing is used again, and the bits are those of `build`.

    Parameters
    ----------
    terrain
        Before.
    sketch
        After.
    checkpoint
        As for `make_recipe`.

    Returns
    -------
    terrain : Terrain
    areas : list of (west, south, east, north)
        As :func:`~sketchterrain.terrain.changed_areas` says them: only tiles that these touch are other ones.
    """
    recipe = make_recipe(sketch, memory=terrain.memory, checkpoint=checkpoint)
    areas = changed_areas(terrain.recipe, recipe)
    return terrain.after(sketch, recipe, areas), areas


def make_recipe(
    sketch: Sketch, *, memory: PlacementCache | None = None, checkpoint: Callable[[], None] | None = None
) -> TerrainRecipe:
    """Place the features of a sketch; plain NumPy, no device is needed.

    A person's edits come between placing and filling, so that the fill keeps clear of what they moved.
    Rivers come last: they run down the ground that the other features make.

    Parameters
    ----------
    sketch
    memory
        Of recipes made before, of this or of any other sketch. It saves time; the bits are the same.
    checkpoint
        Called between the steps of the work. It may raise to abandon it: the memory stays good.
    """
    memory = PlacementCache() if memory is None else memory
    checkpoint = _go_on if checkpoint is None else checkpoint
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
    strong = _with_strengths(dry, painted, memory, checkpoint)
    dry = replace(dry, painted=np.concatenate([strong, adopted.points]))
    ground = DryGround(dry, memory.part(GroundMemory))
    waters = trace_hydrology(sketch, seed=sketch.seed, ground=ground, memory=memory, checkpoint=checkpoint)
    ground.remember()
    return replace(
        dry,
        rivers=waters.rivers,
        river_reach=tuple(valley_reach(*each) for each in zip(waters.rivers, waters.grounds, strict=True)),
        lakes=waters.lakes,
        resolutions=waters.resolutions,
        orphans=(*painted.orphans, *adopted.orphans, *waters.orphans),
    )


def _go_on() -> None:
    """Never abandon the work."""


def _with_strengths(
    dry: TerrainRecipe, edited: EditedPoints, memory: PlacementCache, checkpoint: Callable[[], None]
) -> Points:
    """Return the features with their strengths solved for, the locked ones with their own."""
    asked = replace(dry, painted=edited.unlocked)
    solved = balanced(
        asked, locked=edited.lock_only, memory=memory.part(BalanceMemory), checkpoint=checkpoint
    )
    points = edited.points.copy()
    points["strength"] = np.where(edited.locked, points["strength"], solved["strength"])
    return points
