"""From a sketch to a terrain: recipes built and rebuilt."""

from __future__ import annotations

import pickle
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.array_types import Bounds
from sketchterrain.compute.context import ComputeContext
from sketchterrain.generation.stages import STAGES
from sketchterrain.generation.terrain import Terrain
from sketchterrain.io.disk_cache import cached_bytes
from sketchterrain.io.resources import code_digest
from sketchterrain.landforms.hydrology.streams import joined_streams
from sketchterrain.landforms.painted_ground import Sources, drafted_ground, ground_without
from sketchterrain.roads.build import ROAD_LAYERS
from sketchterrain.schema.materials import MaterialTable
from sketchterrain.stages.digests import digest_of
from sketchterrain.stages.runner import Results, Runner
from sketchterrain.stages.table import Evaluation
from sketchterrain.terrain.host_heights import Ground
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.pads import PadsLayer
from sketchterrain.terrain.layers.relief import ReliefLayer, UnpaintedNodes
from sketchterrain.terrain.layers.roads import RoadsLayer
from sketchterrain.terrain.materials import material_defines
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


# Once such a block was free, glibc keeps 64 MB instead of returning the memory of each array to the system.
np.empty((1 << 25) - (1 << 16), np.uint8)

TERRAIN_KERNELS: Final = ("tiles.cl", "points.cl", "graded_poisson.cl")
"""Files of kernels of a terrain with plants; tiles from afar, and rasters of any size, use terrain.cl too."""

_STORED_BYTES: Final = 1 << 29  # of the last ten to thirty sketches


def stored_results() -> Results:
    """Return results of which those of stages that are `stored` are kept on disk for other processes.

    They are read back at once, so that their digests are the same in the process that computed them. Pickles
    are safe as compiled code is there: the folder is the user's own.
    """

    def on_disk(key: bytes, compute: Callable[[], Any]) -> Any:
        versions = sys.version, np.__version__, code_digest()
        content = cached_bytes(
            "stages", f"{key.hex()} {versions}", lambda: pickle.dumps(compute(), 5), max_bytes=_STORED_BYTES
        )
        return pickle.loads(content)  # noqa: S301

    return Results(on_disk=on_disk)


def build_kernels(context: ComputeContext, table: MaterialTable, files: Iterable[str]) -> None:
    """Build files of kernels for a sketch's materials on a thread, while the sketch is placed."""
    defines = material_defines(table)
    context.build_ahead([(file, () if file == "graded_poisson.cl" else defines) for file in files])


def build(
    sketch: Sketch,
    *,
    seed: int | None = None,
    device: str | ComputeContext | None = None,
    memory: Results | None = None,
    progress: Callable[[float], None] = lambda _: None,
) -> Terrain:
    """Place a sketch's features and open a device; no part of the terrain is computed yet.

    Parameters
    ----------
    sketch
    seed
        Overrides the sketch's own.
    device
        An open :class:`~sketchterrain.compute.context.ComputeContext`, or a selector as for
        :func:`~sketchterrain.compute.device.choose_device`.
    memory
        Results of stages of earlier terrains, of any sketch; they save time.
    progress
        Called with the completed share, 0 … 1.

    Raises
    ------
    DeviceError
        If there is no such device.
    """
    context = device if isinstance(device, ComputeContext) else ComputeContext(device)
    if seed is not None:
        sketch = sketch.replace(seed=seed)
    memory = Results() if memory is None else memory
    return Terrain(sketch, make_recipe(sketch, memory=memory, progress=progress), context, memory=memory)


def rebuild(
    terrain: Terrain,
    sketch: Sketch,
    *,
    checkpoint: Callable[[], None] = lambda: None,
    progress: Callable[[float], None] = lambda _: None,
) -> tuple[Terrain, list[Bounds]]:
    """Return the terrain of a changed sketch on the same device, and the areas where it may differ.

    Stages whose inputs are unchanged do not run again; the bits are those of `build`. Only tiles that the
    areas touch have changed, see :func:`~sketchterrain.terrain.recipe.changed_areas`. ``checkpoint``
    and ``progress`` are as for `make_recipe`.
    """
    recipe = make_recipe(sketch, memory=terrain.memory, checkpoint=checkpoint, progress=progress)
    return terrain.updated(sketch, recipe)


def make_recipe(
    sketch: Sketch,
    *,
    memory: Results | None = None,
    checkpoint: Callable[[], None] = lambda: None,
    progress: Callable[[float], None] = lambda _: None,
) -> TerrainRecipe:
    """Return the recipe of a sketch, in plain NumPy without a device.

    ``memory`` holds results of stages of earlier recipes, of any sketch; the bits are the same.
    ``checkpoint`` is called before each run of a function, ``progress`` with the share that is done, 0 … 1;
    they may raise to cancel.
    """
    recipe: TerrainRecipe = evaluation(sketch, memory, checkpoint, progress)["recipe"]
    return recipe


def evaluation(
    sketch: Sketch,
    memory: Results | None = None,
    checkpoint: Callable[[], None] = lambda: None,
    progress: Callable[[float], None] = lambda _: None,
) -> Evaluation:
    """Return the stages of a sketch's terrain, by name; see `make_recipe`."""
    return Evaluation(STAGES, sketch, Runner(memory, checkpoint), progress)


def draft_recipes(now: Evaluation, before: Evaluation) -> Iterator[TerrainRecipe]:
    """Yield quick recipes to show until a stroke's terrain is placed, with roads and land use as they were.

    First coarse changes of the ground as it was, with water as it was or, if that is painted, laid out on it;
    then the final ground and water. None where more than a stroke on one layer differs, or the ground as a
    whole.

    Parameters
    ----------
    before : of an earlier sketch
    """
    recipe: TerrainRecipe = before["recipe"]
    region: Sources = before["region"]
    ground, heights = recipe[ReliefLayer].painted, before["heights"]
    layers, others = now.sketch.layers, before.sketch.layers
    strokes = [name for name in layers if digest_of(layers[name]) != digest_of(others[name])]
    # What a first mountain changes of the surroundings waits for the final terrain.
    kinds = {
        digest_of((each["region"].settings, each["region"].base, each["dry"].world)) for each in (before, now)
    }
    if len(strokes) != 1 or len(kinds) > 1:
        return

    def draft(natural: TerrainRecipe) -> TerrainRecipe:
        built = natural.with_layers([recipe[kind] for kind in (LandUseLayer, PadsLayer, RoadsLayer)])
        return replace(built, network=recipe.network, orthophotos=recipe.orthophotos)

    if ground is not None and now["land"] is not before["land"]:
        old, new = ((each["land"], each["coarse_ground"].raster) for each in (before, now))
        drafted = drafted_ground(ground, old, new, region.settings.spacing)
        relief = ReliefLayer(UnpaintedNodes(region.beyond), drafted, region.base)
        heights = Ground(now["bare"].with_layers([relief]), heights.cell)
    kept = {"heights": heights, "plateaus": before["plateaus"]}
    if strokes[0] not in ("river", "lake"):
        kept |= {name: before[name] for name in ("waters", "corridors")}
        if heights is not before["heights"]:
            yield draft(now.supposing(kept)["natural"])
    elif (layout := now["layout"]) is not before["layout"]:
        kept["streams"] = joined_streams(before["streams"], layout.courses)
        yield draft(now.supposing(kept)["natural"])
    if now["surface"] is not before["surface"] and any(len(now.sketch.vectors[name]) for name in ROAD_LAYERS):
        yield draft(now["natural"])


def relief_without(sketch: Sketch, layer: str, memory: Results | None) -> ReliefLayer:
    """Return the drained ground without the uplift of a layer's painted features, on the same network."""
    run = Runner(memory)
    stages = Evaluation(STAGES, sketch, run)
    region, land = stages["region"], stages["land"]
    removed = land.features.is_rock if layer == "mountain" else ~land.features.is_rock
    raster = ground_without(region, stages["ground"], land, stages["water"], removed, run)
    return ReliefLayer(UnpaintedNodes(region.beyond), raster, region.base)
