"""How a terrain is made: the stages from a sketch to its recipe, each after what it depends on.

Parameters are results of other stages; `sketch` has the fields named above alone; `run` runs parts of one.
Costs are CPU times, ms, means over the presets.
"""

from __future__ import annotations

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias

import numpy as np

from sketchterrain.array_types import StructuredArray
from sketchterrain.document.label_layers import LabelImage
from sketchterrain.document.material_rules import resolved_rules
from sketchterrain.document.rasters import content_digests
from sketchterrain.document.store import shown_files
from sketchterrain.elevation.base import BaseElevation, load_base
from sketchterrain.elevation.raster_reader import file_stamps
from sketchterrain.elevation.vertical import geoid_files
from sketchterrain.io.resources import code_digest
from sketchterrain.landforms.base_ground import BaseGround
from sketchterrain.landforms.edits import EditedPoints, apply_fill_edits, apply_painted_edits
from sketchterrain.landforms.hydrology.courses import RiverCourse
from sketchterrain.landforms.hydrology.drainage_constraints import course_slopes, lake_outlets, valley_floors
from sketchterrain.landforms.hydrology.rivers import Hydrology, WaterLayout, lay_out_water, solve_water
from sketchterrain.landforms.hydrology.streams import Flow, stream_courses
from sketchterrain.landforms.hydrology.vector_layout import vectors_painted
from sketchterrain.landforms.painted_ground import (
    COARSE,
    COARSE_LEVEL,
    FINE,
    NO_LAND,
    PaintedGround,
    PaintedLand,
    PaintedWater,
    Sources,
    data_heights,
    painted_flow,
    painted_ground,
)
from sketchterrain.landforms.placement.covers import create_covers
from sketchterrain.landforms.placement.feature_types import CLEARANCE
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.landforms.placement.placement import place
from sketchterrain.landforms.placement.plateaus import create_plateaus
from sketchterrain.landforms.placement.sea import Sea, create_sea
from sketchterrain.landforms.relief_fields import UnpaintedSettings
from sketchterrain.landforms.uplift import Outline, painted_outline, uplift_features
from sketchterrain.landuse.areas import LandUse, land_use
from sketchterrain.roads.build import ROAD_LAYERS, Floods, road_network
from sketchterrain.roads.road_types import RoadNetwork
from sketchterrain.schema.geology import Strata
from sketchterrain.schema.layers import (
    PAINTED_LAYERS,
    PATCH_LAYERS,
    POINT_LAYERS,
    VECTOR_LAYERS,
)
from sketchterrain.stages.digests import digest_of
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner
from sketchterrain.stages.table import StageTable
from sketchterrain.terrain.centrelines import valley_radius
from sketchterrain.terrain.host_heights import Ground
from sketchterrain.terrain.layers import layer_stack
from sketchterrain.terrain.layers.corridors import CorridorsLayer
from sketchterrain.terrain.layers.covers import CoversLayer
from sketchterrain.terrain.layers.lakes import LakesLayer
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import WorldSettings
from sketchterrain.terrain.layers.pads import PadsLayer
from sketchterrain.terrain.layers.plateaus import PlateausLayer
from sketchterrain.terrain.layers.relief import ReliefLayer, UnpaintedNodes
from sketchterrain.terrain.layers.roads import RoadsLayer
from sketchterrain.terrain.orthophotos import Orthophoto, orthophotos
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch

_PIXELS: Final = "extent", "size"
_ROAD_CELL: Final = 2.0  # m: cell size of the ground that roads are laid on

_Outlines: TypeAlias = dict[str, Outline | None]

STAGES: Final = StageTable()
"""All stages, in the order in which a terrain is made."""
_stage = STAGES.stage


def _named(kind: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{kind}.{name}" for name in names)


_SHAPES: Final = tuple(each for each in VECTOR_LAYERS if each in PAINTED_LAYERS)


@_stage("layers", *_named("vectors", *_SHAPES), "labels.river", *_PIXELS, cost=7)
def painted(sketch: Sketch, run: Runner) -> dict[str, LabelImage]:
    """The label layers, with the vectors of each."""
    return vectors_painted(sketch, run)


@_stage("rasters", fresh=True)
def files(sketch: Sketch) -> Any:
    """What files of elevation and photographs contain now."""
    rasters = [each for each in sketch.rasters if each.role != "picture"]
    stamps = [file_stamps(Path(each.path)) for each in rasters if each.content is None]
    return content_digests(rasters), stamps, geoid_files()


@_stage("rasters", "frame", "base.margin", *_PIXELS, cost=60)
def elevation(sketch: Sketch, files: Any, run: Runner) -> BaseElevation | None:
    """Real elevation beneath the sketch."""
    del files
    return load_base(sketch, run)


_RAISED: Final = "mountain", "hill", "plateau"


@_stage(
    *("extent", "seed", "ground", "density.mountain", "density.hill", "climate.aridity"),
    *(*_named("painted", *_RAISED), *_named("labels", *_RAISED)),
    cost=4,
)
def unpainted(sketch: Sketch) -> UnpaintedSettings:
    """What unpainted ground depends on."""
    return UnpaintedSettings.from_sketch(sketch)


@_stage()
def region(unpainted: UnpaintedSettings, elevation: BaseElevation | None, run: Runner) -> Sources:
    """What the ground of the sketch is drained from, but for paint."""
    plain = unpainted.painted
    if elevation is None:
        return Sources(unpainted)
    return Sources(unpainted, run(BaseGround, elevation, plain.spacing, UnpaintedNodes(plain)))


@_stage(
    *_named("painted", *POINT_LAYERS, "river"),
    *_named("labels", *POINT_LAYERS),
    *("fidelity", "seed", *_PIXELS),
    stored=True,
    cost=75,
)
def placed(sketch: Sketch, run: Runner) -> StructuredArray:
    """Features of painted shapes."""
    return place(sketch, seed=sketch.seed, run=run)


@_stage("edits")
def points(sketch: Sketch, placed: StructuredArray) -> EditedPoints:
    """The same after the user's edits."""
    return apply_painted_edits(placed, sketch.edits)


@_stage(
    *_named("painted", *sorted({layer for _, layer in CLEARANCE})),
    *_named("labels", *PATCH_LAYERS),
    *("density", "seed", *_PIXELS),
    cost=8,
)
def fill(sketch: Sketch, points: EditedPoints, run: Runner) -> Fill:
    """Features of unpainted ground."""
    return Fill.from_sketch(sketch, points.points, seed=sketch.seed, run=run)


@_stage("edits", *_PIXELS)
def adopted(sketch: Sketch, fill: Fill) -> EditedPoints:
    """Those of them that the user changed."""
    return apply_fill_edits(fill, sketch.edits, size=sketch.size)


@_stage()
def features(points: EditedPoints, adopted: EditedPoints) -> StructuredArray:
    """All features that are not of the fill."""
    return np.concatenate([points.points, adopted.points])


@_stage("painted.sea", "labels.sea", "coast", "fidelity", *_PIXELS, stored=True, cost=15)
def sea(sketch: Sketch) -> Sea | None:
    """The sea and its coast."""
    return create_sea(sketch)


@_stage(*_named("painted", *_RAISED), "fidelity", *_PIXELS, stored=True, cost=65)
def outlines(sketch: Sketch, unpainted: UnpaintedSettings, run: Runner) -> _Outlines:
    """Outlines of painted shapes, by layer."""
    parts = {layer: part_of(sketch, f"layers.{layer}", "fidelity", *_PIXELS) for layer in _RAISED}
    return {layer: run(painted_outline, part, layer, unpainted.spacing) for layer, part in parts.items()}


@_stage(
    *_named("painted", "mountain", "hill"),
    *_named("labels", "mountain", "hill"),
    "fidelity",
    *_PIXELS,
    stored=True,
    cost=45,
)
def land(
    sketch: Sketch,
    features: StructuredArray,
    outlines: _Outlines,
    region: Sources,
    sea: Sea | None,
    run: Runner,
) -> PaintedLand:
    """What raises the ground."""
    data = None if region.base is None else data_heights(region, PaintedWater(sea=sea), run)
    known = {name: each for name in ("mountain", "hill") if (each := outlines[name]) is not None}
    return PaintedLand(uplift_features(sketch, features, run, data), known)


_COVERED: Final = ("layers.material", "labels.material", "materials", "fidelity", *_PIXELS)


@_stage(
    *("painted.material", "labels.material", "materials", "material_rules", "geology", "climate"),
    *("base.detail", "seed", "fidelity", *_PIXELS),
    cost=3,
)
def dry(
    sketch: Sketch,
    region: Sources,
    features: StructuredArray,
    fill: Fill,
    adopted: EditedPoints,
    sea: Sea | None,
    run: Runner,
) -> TerrainRecipe:
    """The terrain without its drained relief, plateaus, water and what lies on them."""
    layers = layer_stack(
        extent=sketch.extent,
        relief=ReliefLayer(UnpaintedNodes(region.beyond), None, region.base),
        painted=features,
        fill=replace(fill, replaced=adopted.replaced),
        covers=run(create_covers, part_of(sketch, *_COVERED)),
        sea=sea,
        detail=sketch.base["detail"],
        materials=sketch.material_table.names,
    )
    return TerrainRecipe(
        WorldSettings(sketch.extent, sketch.seed, sketch.fidelity),
        sketch.climate,
        layers,
        sketch.material_table,
        resolved_rules(sketch.material_rules),
        strata=Strata.from_settings(sketch.geology),
    )


@_stage()
def bare(dry: TerrainRecipe) -> TerrainRecipe:
    """The same without covers, rules and forests, on which heights do not depend."""
    return _height_recipe(dry)


@_stage(hashed=False, stored=True, cost=80)
def coarse_ground(region: Sources, land: PaintedLand, sea: Sea | None, run: Runner) -> PaintedGround:
    """Coarse ground, drained to the sea."""
    return painted_ground(region, land, PaintedWater(sea=sea), COARSE, run)


@_stage()
def coarse_heights(bare: TerrainRecipe, region: Sources, coarse_ground: PaintedGround) -> Ground:
    """Its heights."""
    return _heights(bare, region, coarse_ground, 1 << COARSE_LEVEL)


@_stage(stored=True, cost=200)
def featureless_heights(bare: TerrainRecipe, region: Sources, sea: Sea | None, run: Runner) -> Ground:
    """Those of coarse ground without features."""
    ground = run(painted_ground, region, NO_LAND, PaintedWater(sea=sea), COARSE, hashed=False)
    return _heights(bare, region, ground, 1 << COARSE_LEVEL)


_WATERS: Final = (
    *_named("layers", "lake", "river", "sea"),
    *_named("vectors", "lake", "river"),
    *_named("labels", "lake", "river"),
    *("coast", "edits", "fidelity", "seed", *_PIXELS),
)


@_stage(*_WATERS, stored=True, cost=300)
def layout(sketch: Sketch, coarse_heights: Ground, run: Runner) -> WaterLayout:
    """Courses of rivers and outlines of lakes."""
    return lay_out_water(sketch, seed=sketch.seed, ground=coarse_heights, run=run)


@_stage(stored=True, cost=50)
def water(
    featureless_heights: Ground, layout: WaterLayout, land: PaintedLand, sea: Sea | None
) -> PaintedWater:
    """What the ground drains to."""
    lakes = tuple(lake for lake in layout.lakes if lake.label)
    outlets = lake_outlets(lakes, layout.courses, featureless_heights)
    bare_slopes, slopes = course_slopes(layout.courses, featureless_heights, land.features.cover)
    floors = tuple(valley_floors(layout.courses, bare_slopes))
    return PaintedWater(layout.courses, slopes, floors, bare_slopes, lakes, outlets, sea)


@_stage(hashed=False, stored=True, cost=360)
def ground(region: Sources, land: PaintedLand, water: PaintedWater, run: Runner) -> PaintedGround:
    """The ground of the sketch, drained to its water."""
    return painted_ground(region, land, water, FINE, run)


@_stage(cost=5)
def heights(bare: TerrainRecipe, region: Sources, ground: PaintedGround) -> Ground:
    """Its heights."""
    return _heights(bare, region, ground)


@_stage(*_named("painted", "plateau", "river"), "labels.plateau", "fidelity", *_PIXELS, stored=True, cost=50)
def plateaus(sketch: Sketch, heights: Ground, run: Runner) -> PlateausLayer:
    """Plateaus on it."""
    return PlateausLayer(create_plateaus(sketch, heights, run))


@_stage(hashed=False, stored=True)
def flow(
    region: Sources, ground: PaintedGround, water: PaintedWater, outlines: _Outlines, run: Runner
) -> Flow:
    """How it drains between plateaus."""
    return painted_flow(region, ground, water, run, outlines["plateau"])


@_stage("climate.aridity", "seed", *_PIXELS, stored=True, cost=35)
def streams(
    sketch: Sketch, heights: Ground, flow: Flow, layout: WaterLayout, run: Runner
) -> list[RiverCourse]:
    """Unpainted rivers."""
    return stream_courses(
        flow,
        layout.courses,
        size=sketch.size,
        runoff=1.0 - float(sketch.climate["aridity"]),
        seed=sketch.seed,
        displaced=heights.displaced,
        run=run,
    )


@_stage(*_WATERS, *_named("layers", "mountain", "plateau"), stored=True, cost=500)
def waters(
    sketch: Sketch,
    heights: Ground,
    plateaus: PlateausLayer,
    layout: WaterLayout,
    streams: list[RiverCourse],
    run: Runner,
) -> Hydrology:
    """Rivers and lakes with their levels."""
    raised = replace(heights, recipe=heights.recipe.with_layers([plateaus]))
    return solve_water(sketch, layout, seed=sketch.seed, ground=raised, streams=streams, run=run)


@_stage("extent", stored=True, cost=170)
def corridors(sketch: Sketch, waters: Hydrology, run: Runner) -> CorridorsLayer:
    """Rivers and their valleys."""
    radii = [valley_radius(*each) for each in zip(waters.rivers, waters.grounds, strict=True)]
    return CorridorsLayer.of(waters.rivers, radii, sketch.extent, run)


@_stage()
def natural(
    dry: TerrainRecipe,
    heights: Ground,
    plateaus: PlateausLayer,
    waters: Hydrology,
    corridors: CorridorsLayer,
    points: EditedPoints,
    adopted: EditedPoints,
) -> TerrainRecipe:
    """The terrain without roads and land use."""
    layers = [heights.recipe[ReliefLayer], plateaus, LakesLayer(waters.lakes), corridors]
    orphans = (*points.orphans, *adopted.orphans, *waters.orphans)
    return replace(dry.with_layers(layers), resolutions=waters.resolutions, orphans=orphans)


@_stage()
def surface(natural: TerrainRecipe) -> Floods:
    """Heights without roads, and levels of floods on them."""
    ground = Ground(_height_recipe(natural), _ROAD_CELL)
    return Floods(natural.rivers, natural.lakes, natural.sea_level, ground)


@_stage(*_named("vectors", *ROAD_LAYERS), *_named("labels", *ROAD_LAYERS), stored=True, cost=450)
def roads(sketch: Sketch, surface: Floods, run: Runner) -> RoadNetwork:
    """Roads, railways, paths, pads and walls."""
    return road_network(sketch, surface.ground, surface, run)


@_stage("vectors.landuse", "labels.landuse")
def landuse(sketch: Sketch, run: Runner) -> LandUse:
    """Fields, meadows, forests and built-up land."""
    return land_use(sketch, run)


@_stage("rasters", "frame", *_PIXELS)
def photographs(sketch: Sketch, files: Any, run: Runner) -> tuple[Orthophoto, ...]:
    """Photographs of the ground."""
    del files
    return orthophotos(sketch, run)


@_stage()
def recipe(
    natural: TerrainRecipe,
    roads: RoadNetwork,
    landuse: LandUse,
    photographs: tuple[Orthophoto, ...],
    run: Runner,
) -> TerrainRecipe:
    """The terrain."""
    land = run(LandUseLayer, natural.materials.names, landuse)
    built = with_network(natural, roads, run)
    return replace(built.with_layers([land]), orthophotos=photographs)


def with_network(recipe: TerrainRecipe, network: RoadNetwork, run: Runner) -> TerrainRecipe:
    """Return a terrain with roads, pads and walls."""
    pads = run(PadsLayer, recipe.materials.names, network.pads)
    roads = run(RoadsLayer, recipe.materials.names, network.roads)
    return replace(recipe.with_layers([pads, roads]), network=network)


def fingerprint(sketch: Sketch, *options: object) -> str:
    """Return a digest of all that files of a sketch depend on but the device: they name and may contain it.

    Pictures beneath the paint, which only the window shows, and notes of reading it are left out.
    """
    program = version("sketchterrain"), code_digest()
    contents = files.function(sketch), shown_files(sketch)
    return digest_of((program, sketch.replace(notes=()), contents, options)).hex()


def _height_recipe(recipe: TerrainRecipe) -> TerrainRecipe:
    """Return a recipe of the same heights without what changes none."""
    layers = [CoversLayer(()), recipe.points.without_forests()]
    return replace(recipe.with_layers(layers), climate={}, material_rules=(), resolutions=(), orphans=())


def _heights(recipe: TerrainRecipe, region: Sources, ground: PaintedGround, nodes: int = 1) -> Ground:
    """Return heights of a recipe with a drained ground, at so many of its nodes."""
    relief = ReliefLayer(UnpaintedNodes(region.beyond), ground.raster, region.base)
    return Ground(recipe.with_layers([relief]), nodes * region.settings.spacing)
