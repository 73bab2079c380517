"""From a sketch to a terrain: recipes built and rebuilt."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.array_types import Bounds, Float64Array, StructuredArray
from sketchterrain.caching import IdentityKey, LRUCache
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.geology import Strata
from sketchterrain.document.material_rules import resolved_rules
from sketchterrain.elevation.base import load_base
from sketchterrain.hydrology.courses import RiverCourse
from sketchterrain.hydrology.drainage_constraints import course_slopes, lake_outlets, valley_floors
from sketchterrain.hydrology.lakes import GroundHeight
from sketchterrain.hydrology.rivers import WaterLayout, lay_out_water, solve_water
from sketchterrain.hydrology.streams import stream_courses
from sketchterrain.hydrology.vector_layout import with_vectors_painted
from sketchterrain.landuse.areas import land_use
from sketchterrain.placement.covers import create_covers
from sketchterrain.placement.fill import Fill
from sketchterrain.placement.placement import place
from sketchterrain.placement.plateaus import create_plateaus
from sketchterrain.placement.sea import Sea, create_sea
from sketchterrain.roads.build import ROAD_LAYERS, has_roads, road_network
from sketchterrain.roads.waters import flood_levels
from sketchterrain.terrain.base_ground import BaseGround
from sketchterrain.terrain.centrelines import valley_radius
from sketchterrain.terrain.edits import apply_fill_edits, apply_painted_edits
from sketchterrain.terrain.host_heights import HostTerrain
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.layers import layer_stack
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.layers.dunes import DunesLayer
from sketchterrain.terrain.layers.lakes import LakesLayer
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import WorldSettings
from sketchterrain.terrain.layers.pads import PadsLayer
from sketchterrain.terrain.layers.plateaus import PlateausLayer
from sketchterrain.terrain.layers.relief import ReliefLayer, UnpaintedNodes
from sketchterrain.terrain.layers.roads import RoadsLayer
from sketchterrain.terrain.layers.sea import SeaLayer
from sketchterrain.terrain.node_raster import DrainedRaster
from sketchterrain.terrain.noise import FINEST_CELL
from sketchterrain.terrain.orthophotos import orthophotos
from sketchterrain.terrain.painted_ground import (
    COARSE_LEVEL,
    PaintedLand,
    PaintedWater,
    RegionSources,
    data_heights,
    drafted_ground,
    ground_without,
    painted_flow,
    painted_ground,
)
from sketchterrain.terrain.recipe import TerrainRecipe
from sketchterrain.terrain.relief_fields import UnpaintedSettings
from sketchterrain.terrain.terrain import Terrain
from sketchterrain.terrain.uplift import Outline, painted_outline, uplift_features

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_NATURAL: Final = "terrain without roads"
_ON_TOP: Final = {*ROAD_LAYERS, "landuse"}  # layers that change the terrain of the others last
_ROAD_CELL = 2.0  # m: cell size of the ground that roads are laid on
_CELLS_PER_EXTENT = 256  # Rivers follow the terrain at this coarse cell size, without its small features.


def build(
    sketch: Sketch,
    *,
    seed: int | None = None,
    device: str | ComputeContext | None = None,
    memory: LRUCache | None = None,
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
        Cache of earlier terrains built in this thread, of any sketch; it saves time.

    Raises
    ------
    DeviceError
        If there is no such device.
    """
    context = device if isinstance(device, ComputeContext) else ComputeContext(device)
    if seed is not None:
        sketch = sketch.replace(seed=seed)
    memory = LRUCache() if memory is None else memory
    return Terrain(sketch, make_recipe(sketch, memory=memory), context, memory=memory)


def rebuild(
    terrain: Terrain, sketch: Sketch, *, checkpoint: Callable[[], None] = lambda: None
) -> tuple[Terrain, list[Bounds]]:
    """Return the terrain of a changed sketch on the same device, and the areas where it may differ.

    Cached placement is reused; the bits are those of `build`. Only tiles that the areas touch have changed,
    see :func:`~sketchterrain.terrain.changes.changed_areas`. ``checkpoint`` is as for `make_recipe`.
    """
    return terrain.updated(sketch, make_recipe(sketch, memory=terrain.memory, checkpoint=checkpoint))


def make_recipe(
    sketch: Sketch, *, memory: LRUCache | None = None, checkpoint: Callable[[], None] = lambda: None
) -> TerrainRecipe:
    """Place the features of a sketch, in plain NumPy without a device.

    Edits come between placing and filling, so that the fill avoids moved features. Rivers and lakes are laid
    out on coarse ground, the ground is drained to them, and their levels follow from it. ``memory`` caches
    earlier recipes, of any sketch; the bits are the same. ``checkpoint`` is called between steps; it may
    raise to cancel, which leaves the cache valid.
    """
    memory = LRUCache() if memory is None else memory
    return recipe_of_plan(sketch, plan_terrain(sketch, memory, checkpoint), memory, checkpoint)


def recipe_of_plan(
    sketch: Sketch, plan: TerrainPlan, memory: LRUCache, checkpoint: Callable[[], None] = lambda: None
) -> TerrainRecipe:
    """Return the recipe of a sketch from its plan; see `make_recipe`."""
    last = memory.get(_NATURAL)
    if last is None or last.plan is not plan or not _differ_in_roads(last.sketch, sketch):
        last = _Natural(sketch, plan, _natural_recipe(sketch, plan, memory, checkpoint))
        memory.store(_NATURAL, last)
    return with_land_use(sketch, with_roads(sketch, last.recipe, memory), memory)


@dataclass(frozen=True, eq=False)
class _Natural:
    """The last terrain without roads, pads and land use, which changes of these do not affect."""

    sketch: Sketch
    plan: TerrainPlan
    recipe: TerrainRecipe


def _differ_in_roads(one: Sketch, other: Sketch) -> bool:
    """Return whether two sketches have the same terrain without roads, pads and land use."""
    layers = (one.layers[name] is other.layers[name] for name in one.layers)
    vectors = (one.vectors[name] is other.vectors[name] for name in set(one.vectors) - _ON_TOP)

    def labels(sketch: Sketch) -> dict[tuple[str, int], Any]:
        return {key: dict(values) for key, values in sketch.labels.items() if key[0] not in _ON_TOP}

    rest = [each.name for each in fields(one) if each.name not in ("layers", "vectors", "labels")]
    return (
        all((*layers, *vectors))
        and labels(one) == labels(other)
        and all(getattr(one, name) == getattr(other, name) for name in rest)
    )


def with_land_use(sketch: Sketch, recipe: TerrainRecipe, memory: LRUCache) -> TerrainRecipe:
    """Return a terrain with the land use of its sketch, and the photographs beneath it."""
    layer = LandUseLayer(recipe.materials.names, land_use(sketch))
    return replace(recipe.with_layers([layer]), orthophotos=orthophotos(sketch, memory))


def with_roads(sketch: Sketch, recipe: TerrainRecipe, memory: LRUCache) -> TerrainRecipe:
    """Return a terrain with the roads, pads and walls of its sketch."""
    if not has_roads(sketch):
        return recipe
    terrain = HostTerrain(recipe)

    def ground(x: Float64Array, y: Float64Array) -> Float64Array:
        at = (to_lattice(each, recipe.extent) for each in (x, y))
        return terrain.heights(*at, cell_size=_ROAD_CELL)

    waters = partial(flood_levels, recipe.rivers, recipe.lakes, recipe.sea_level, ground)
    network = road_network(sketch, ground, waters, memory, recipe)
    names = recipe.materials.names
    roads = memory.get_or_compute(
        ("layer of roads", names, IdentityKey(network.roads)), lambda: RoadsLayer(names, network.roads)
    )
    return replace(recipe.with_layers([PadsLayer(names, network.pads), roads]), network=network)


def _natural_recipe(
    sketch: Sketch, plan: TerrainPlan, memory: LRUCache, checkpoint: Callable[[], None]
) -> TerrainRecipe:
    """Return the recipe without roads and pads."""
    relief = _relief(plan.region, painted_ground(plan.region, plan.land, plan.water))
    dry, bare = (each.with_layers([relief]) for each in (plan.dry, plan.bare))
    checkpoint()
    plateaus = PlateausLayer(create_plateaus(with_vectors_painted(sketch, memory), _ground(bare), memory))
    ground = _ground(bare.with_layers([plateaus]))
    checkpoint()
    waters = solve_water(
        sketch,
        plan.layout,
        seed=sketch.seed,
        ground=ground,
        cache=memory,
        streams=_streams(sketch, plan, bare, memory),
        checkpoint=checkpoint,
    )
    radii = [valley_radius(*each) for each in zip(waters.rivers, waters.grounds, strict=True)]
    corridors = CorridorsLayer.of(waters.rivers, radii, sketch.extent, memory)
    return replace(
        dry.with_layers([plateaus, LakesLayer(waters.lakes), corridors]),
        resolutions=waters.resolutions,
        orphans=(*plan.orphans, *waters.orphans),
    )


def draft_recipe(plan: TerrainPlan, before: TerrainPlan, recipe: TerrainRecipe) -> TerrainRecipe | None:
    """Return a quick recipe to show while a stroke goes on: coarse changes of the ground, water as it was.

    None where the ground changes by nothing but water, or as a whole.

    Parameters
    ----------
    before, recipe : an earlier terrain of the same sketch
    """
    ground = recipe[ReliefLayer].painted
    region = before.region  # what a first mountain changes of the surroundings waits for the final terrain
    was, now = ((each.region.settings, each.region.base, each.dry.world) for each in (before, plan))
    if was != now or ground is None or plan.land.key() == before.land.key():
        return None
    old, new = ((each.land, each.coarse_ground) for each in (before, plan))
    relief = _relief(region, drafted_ground(ground, old, new, region.settings.spacing))
    draft = plan.dry.with_layers(
        [relief, *(recipe[kind] for kind in (PlateausLayer, LakesLayer, CorridorsLayer, SeaLayer))]
    )
    draft = draft.with_layers([recipe[kind] for kind in (LandUseLayer, PadsLayer, RoadsLayer)])
    return replace(draft, network=recipe.network, orthophotos=recipe.orthophotos)


def _streams(sketch: Sketch, plan: TerrainPlan, recipe: TerrainRecipe, memory: LRUCache) -> list[RiverCourse]:
    """Return the courses of streams."""
    octaves = recipe.sampling(FINEST_CELL).octaves
    plateaus = _outline(sketch, "plateau", plan.region.settings.spacing, memory)
    return stream_courses(
        painted_flow(plan.region, plan.land, plan.water, plateaus),
        plan.layout.courses,
        size=sketch.size,
        runoff=1.0 - float(sketch.climate["aridity"]),
        seed=sketch.seed,
        displaced=lambda at: recipe[ReliefLayer].displaced(at, recipe.world, octaves),
        cache=memory,
    )


def relief_without(sketch: Sketch, layer: str, memory: LRUCache) -> ReliefLayer:
    """Return the drained ground without the uplift of a layer's painted features, on the same network."""
    plan = plan_terrain(sketch, memory)
    removed = plan.land.features.is_rock if layer == "mountain" else ~plan.land.features.is_rock
    return _relief(plan.region, ground_without(plan.region, plan.land, plan.water, removed))


@dataclass(frozen=True, eq=False)
class TerrainPlan:
    """What a terrain is drained from: placed features, and rivers and lakes laid out on coarse ground."""

    dry: TerrainRecipe
    bare: TerrainRecipe  # without covers and rules, on which heights do not depend
    region: RegionSources
    land: PaintedLand
    coarse_ground: DrainedRaster
    layout: WaterLayout
    water: PaintedWater
    orphans: tuple[Any, ...]


def plan_terrain(
    sketch: Sketch, memory: LRUCache, checkpoint: Callable[[], None] = lambda: None
) -> TerrainPlan:
    """Place the features of a sketch and lay out its water; see `make_recipe`."""
    last: _Natural | None = memory.get(_NATURAL)
    if last is not None and _differ_in_roads(last.sketch, sketch):
        return last.plan
    given, sketch = sketch, with_vectors_painted(sketch, memory)
    placed = place(sketch, seed=sketch.seed, cache=memory, checkpoint=checkpoint)
    painted = apply_painted_edits(placed, sketch.edits)
    fill = Fill.from_sketch(sketch, painted.points, seed=sketch.seed, cache=memory)
    adopted = apply_fill_edits(fill, sketch.edits, size=sketch.size)
    world = WorldSettings(sketch.extent, sketch.seed, sketch.fidelity)
    beyond = UnpaintedSettings.from_sketch(sketch)
    settings = beyond.painted
    region = RegionSources(beyond, memory, _base_ground(sketch, settings, memory))
    dry = TerrainRecipe(
        world,
        sketch.climate,
        layer_stack(
            extent=sketch.extent,
            relief=_relief(region),
            painted=painted.points,
            fill=replace(fill, replaced=adopted.replaced),
            covers=create_covers(sketch, cache=memory),
            sea=create_sea(sketch, cache=memory),
            detail=sketch.base["detail"],
            materials=sketch.material_table.names,
        ),
        sketch.material_table,
        resolved_rules(sketch.material_rules),
        strata=Strata.from_settings(sketch.geology),
    )
    checkpoint()
    points = replace(dry.points, painted=np.concatenate([painted.points, adopted.points]))
    dry = dry.with_layers([points, DunesLayer(points.dune_styles)])
    bare = replace(dry.with_layers([CoversLayer(())]), climate={}, material_rules=())
    sea = create_sea(sketch, cache=memory)
    land = _painted_land(sketch, points.painted, region, sea)
    checkpoint()

    coarse = painted_ground(region, land, PaintedWater(sea=sea), coarse=True)
    first = _ground(bare.with_layers([_relief(region, coarse)]), 1 << COARSE_LEVEL)
    checkpoint()
    layout = lay_out_water(given, seed=sketch.seed, ground=first, cache=memory, checkpoint=checkpoint)
    lakes = tuple(lake for lake in layout.lakes if lake.label)
    checkpoint()
    bare_land = PaintedLand(land.features.of(np.zeros(0, np.int64)), {})
    without = painted_ground(region, bare_land, PaintedWater(sea=sea), coarse=True)
    without_features = _ground(bare.with_layers([_relief(region, without)]), 1 << COARSE_LEVEL)
    outlets = lake_outlets(lakes, layout.courses, without_features)
    bare_slopes, slopes = course_slopes(layout.courses, without_features, land.features.cover)
    floors = tuple(valley_floors(layout.courses, bare_slopes))
    water = PaintedWater(layout.courses, slopes, floors, bare_slopes, lakes, outlets, sea)
    orphans = (*painted.orphans, *adopted.orphans)
    return TerrainPlan(dry, bare, region, land, coarse, layout, water, orphans)


def _base_ground(sketch: Sketch, settings: UnpaintedSettings, memory: LRUCache) -> BaseGround | None:
    """Return the elevation data of a sketch at nodes; None without any."""
    base = load_base(sketch, memory)
    if base is None:
        return None
    ground = BaseGround(base, settings.spacing, UnpaintedNodes(settings))
    return memory.get_or_compute(("base ground", ground), lambda: ground)


def _relief(region: RegionSources, painted: DrainedRaster | None = None) -> ReliefLayer:
    return ReliefLayer(UnpaintedNodes(region.beyond), painted, region.base)


def _painted_land(
    sketch: Sketch, points: StructuredArray, region: RegionSources, sea: Sea | None
) -> PaintedLand:
    cell, memory = region.settings.spacing, region.memory
    outlines = {layer: _outline(sketch, layer, cell, memory) for layer in ("mountain", "hill")}
    found = {layer: outline for layer, outline in outlines.items() if outline is not None}
    data = None if region.base is None else data_heights(region, PaintedWater(sea=sea))
    return PaintedLand(uplift_features(sketch, points, memory, data), found)


def _outline(sketch: Sketch, layer: str, cell: float, memory: LRUCache) -> Outline | None:
    key = ("outline", IdentityKey(sketch.layers[layer]), cell, sketch.pixel_size, sketch.fidelity)
    return memory.get_or_compute(key, partial(painted_outline, sketch, layer, cell, memory))


def _ground(recipe: TerrainRecipe, cells: int = 1) -> GroundHeight:
    """Return the heights of a recipe without rivers and lakes, at `cells` of the raster."""
    terrain = HostTerrain(recipe)

    def heights(x: Float64Array, y: Float64Array) -> Float64Array:
        at = (to_lattice(each, recipe.extent) for each in (x, y))
        return terrain.heights(*at, cell_size=cells * recipe.extent / _CELLS_PER_EXTENT)

    return heights
