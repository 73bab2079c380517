"""The painted region of the drained ground.

It is drained to rivers, lakes and the sea without features, then anew in zones around features, to the ground
as it was. Barriers that are left where water leaves the zones are cut through. Over elevation data, nodes
hold what is added to them: see `blended_ground`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from scipy.ndimage import map_coordinates, maximum_filter

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array
from sketchterrain.landforms.base_ground import BaseGround
from sketchterrain.landforms.blended_ground import (
    BlendedLevel,
    RaisedParts,
    blended_level,
    painted_nodes,
    raised,
    raised_level,
)
from sketchterrain.landforms.drainage import (
    BARE_ROUNDS,
    DrainageInput,
    Drained,
    at_level,
    carved,
    confined,
    drain,
    ramped,
    routed,
)
from sketchterrain.landforms.hydrology.courses import RiverCourse
from sketchterrain.landforms.hydrology.drainage_constraints import (
    DrainageConstraints,
    NodeRaster,
    drainage_constraints,
)
from sketchterrain.landforms.hydrology.streams import Flow
from sketchterrain.landforms.node_raster import DrainedRaster, PaintedNodes
from sketchterrain.landforms.painted_uplift import (
    PaintedUplift,
    drain_painted,
    height_without,
    painted_uplift,
    pyramid,
)
from sketchterrain.landforms.placement.feature_types import GroundHeight, Lake
from sketchterrain.landforms.placement.sea import Sea
from sketchterrain.landforms.relief_fields import UnpaintedSettings
from sketchterrain.landforms.unpainted import unpainted_ground
from sketchterrain.landforms.uplift import NO_FEATURES, Outline, UpliftFeatures
from sketchterrain.stages.runner import Runner

COARSE_LEVEL = 2
"""The finest level of ground that is drained to lay out rivers and lakes."""
FINE = len(BARE_ROUNDS)
"""Levels of the ground."""
COARSE = FINE - COARSE_LEVEL
"""Those that are drained to lay out rivers and lakes."""
_DRAFT_CHANGE, _LEAST_CHANGE = 0.3, 0.04  # nodes: changes that drafts show, and the least ones around them
_DRAFT_MARGIN = 4  # coarse nodes around them
_DRAFT_REACH = 5.0  # radii around changed features, beyond which drafts keep the ground
_DRY_NODE = np.zeros((1, 1), np.uint8)
_NO_NODES = PaintedNodes(
    0, 0, np.full((1, 1), np.nan, np.float32), _DRY_NODE, _DRY_NODE, np.zeros((1, 1), np.float32)
)


@dataclass(frozen=True, eq=False)
class Sources:
    """What the painted region is drained from, but for paint."""

    beyond: UnpaintedSettings  # of unpainted ground, with its surroundings
    base: BaseGround | None = None

    @cached_property
    def settings(self) -> UnpaintedSettings:
        """The settings of unpainted ground where it is painted: without surroundings."""
        return self.beyond.painted


@dataclass(frozen=True, eq=False)
class PaintedWater:
    """Water that the painted region drains to."""

    courses: tuple[RiverCourse, ...] = ()  # parents first
    slopes: tuple[Float64Array, ...] = ()  # greatest slope at each point of each course
    floors: tuple[Float64Array, ...] = ()  # half the width of the valley's floor there, m
    bare_slopes: tuple[Float64Array, ...] = ()  # on ground without paint
    lakes: tuple[Lake, ...] = ()
    outlets: Float64Array | None = None  # (n, 2) where each lake overflows, m
    sea: Sea | None = None

    @cached_property
    def bare(self) -> PaintedWater:
        """It on ground without paint."""
        return replace(self, slopes=self.bare_slopes, bare_slopes=())

    @cached_property
    def unsloped(self) -> PaintedWater:
        """It without slopes."""
        return replace(self, slopes=(), bare_slopes=())


@dataclass(frozen=True, eq=False)
class PaintedGround:
    """The painted region as it is drained; with its network of flow and its features' factors."""

    raster: DrainedRaster
    network: Drained
    factors: Float64Array
    finest: Drained  # with barriers cut through, and with elevation data
    parts: RaisedParts  # what layers of features add to elevation data


@dataclass(frozen=True, eq=False)
class PaintedLand:
    """Features that raise the painted region, and the outlines of their shapes by layer."""

    features: UpliftFeatures
    outlines: Mapping[str, Outline]

    def changed_near(self, before: PaintedLand, nodes: PaintedNodes, cell: float) -> BoolArray:
        """Return whether coarse nodes are near features or outlines that differ from those before."""
        step, shape = 1 << COARSE_LEVEL, nodes.height.shape
        origin, finest = (step * nodes.row, step * nodes.column), (step * shape[0], step * shape[1])
        near = np.zeros(shape, np.bool_)
        for name in {*self.outlines, *before.outlines}:
            depths = [
                land.outlines[name].depth_at(origin, finest)[::step, ::step] > 0.0
                for land in (self, before)
                if name in land.outlines
            ]
            near |= np.logical_xor.reduce(depths)
        near = np.asarray(maximum_filter(near, 2 * _DRAFT_MARGIN + 1))
        rows, columns = np.ogrid[: shape[0], : shape[1]]
        x, y = (step * cell * each for each in (nodes.column + columns, nodes.row + rows))
        for east, north, radius, *_ in self.features.rows() ^ before.features.rows():
            near |= np.hypot(x - east, y - north) < _DRAFT_REACH * radius
        return near

    def without(self, removed: BoolArray) -> PaintedLand:
        """Return it with features that raise nothing."""
        height = np.where(removed, 0.0, self.features.height)
        return replace(self, features=self.features._replace(height=height))


NO_LAND: Final = PaintedLand(NO_FEATURES, {})


def data_heights(region: Sources, water: PaintedWater, run: Runner) -> GroundHeight:
    """Return heights (m) of the region with elevation data and without features, by its coarse nodes."""
    level = run(blended_ground, region, water.bare, COARSE, hashed=False)[-1]
    source = run(unpainted_levels, region.settings, hashed=False)[0][COARSE - 1]
    raster, nodes = _raster(source, region.settings.spacing), np.nan_to_num(level.flow.height)

    def heights(x: Float64Array, y: Float64Array) -> Float64Array:
        at = (y - raster.south) / raster.spacing, (x - raster.west) / raster.spacing
        found: Float64Array = map_coordinates(nodes, at, order=1, mode="nearest")
        return found

    return heights


def drafted_ground(
    ground: DrainedRaster,
    before: tuple[PaintedLand, DrainedRaster],
    after: tuple[PaintedLand, DrainedRaster],
    cell: float,
) -> DrainedRaster:
    """Return the painted region with the changes from coarse ground `before` to that `after` added.

    Small changes and those far from changed features are left out: coarse valleys move there, and no tile is
    to be drawn again. `cell` is the spacing (m) of level 0.
    """
    (land, coarse), (new_land, new_coarse) = before, after
    nodes, old, new = ground.levels[0], coarse.levels[COARSE_LEVEL], new_coarse.levels[COARSE_LEVEL]
    change = np.nan_to_num(new.height.astype(np.float64) - old.height)
    near = maximum_filter(np.abs(new.rock.astype(np.float64) - old.rock) > 0, 2 * _DRAFT_MARGIN + 1)
    near |= maximum_filter(np.abs(change) > _DRAFT_CHANGE * cell, 2 * _DRAFT_MARGIN + 1)
    near &= new_land.changed_near(land, old, cell)
    change[~near | (np.abs(change) < _LEAST_CHANGE * cell)] = 0.0
    rows, columns = (
        (first + np.arange(count)) / (1 << COARSE_LEVEL) - start
        for first, count, start in zip(
            (nodes.row, nodes.column), nodes.height.shape, (old.row, old.column), strict=True
        )
    )
    at = np.meshgrid(rows, columns, indexing="ij")
    height = nodes.height + map_coordinates(change, at, order=1, mode="nearest")
    harder = map_coordinates(new.rock.astype(np.float64) - old.rock, at, order=1, mode="nearest")
    rock = np.clip(np.rint(nodes.rock + harder), 0, 255).astype(np.uint8)
    return DrainedRaster.from_drained(
        [replace(nodes, height=height.astype(np.float32), rock=rock)], ground.beside
    )


def painted_flow(
    region: Sources, ground: PaintedGround, water: PaintedWater, run: Runner, plateaus: Outline | None = None
) -> Flow:
    """Return how the painted region drains, level 0; plateaus and elevation data bar streams."""
    finest = ground.finest
    source = run(unpainted_levels, region.settings, hashed=False)[0][-1]
    constraints = _limits(source, region.settings.spacing, water, run)
    wet = (constraints.course >= 0) | (constraints.slope <= 0.0)
    wet |= ~np.isnan(constraints.base) & np.isnan(source.base)
    barred = np.zeros(wet.shape, np.bool_)
    if plateaus is not None:
        barred = plateaus.depth_at(source.origin, wet.shape) > -region.settings.spacing
    for each in run(blended_ground, region, water.bare, FINE, hashed=False)[3:]:
        barred |= each.weight > 0.0
    raster = _raster(source, region.settings.spacing)
    return Flow(
        raster, finest.height, finest.area, finest.receiver, wet, barred, lake=constraints.slope <= 0.0
    )


def ground_without(
    region: Sources,
    ground: PaintedGround,
    land: PaintedLand,
    water: PaintedWater,
    removed: BoolArray,
    run: Runner,
) -> DrainedRaster:
    """Return the painted region without the uplift of some features, on the network drained with all."""
    cell = region.settings.spacing
    blended = run(blended_ground, region, water.bare, FINE, hashed=False)
    uplift = _uplift(region, land.without(removed), water, FINE, run)
    if blended:
        own = sum(part for layer, part in ground.parts if removed[layer.members].all())
        drained = replace(ground.finest, height=ground.finest.height - own)
    else:
        height = height_without(uplift, ground.network, ground.factors, cell)
        drained = replace(ground.network, height=height)
    beside = blended[-1].beside if blended else None
    return DrainedRaster.from_drained([painted_nodes(drained, uplift, 3, cell, blended[3:])], beside)


def painted_ground(
    region: Sources, land: PaintedLand, water: PaintedWater, count: int, run: Runner
) -> PaintedGround:
    """Return the painted region as it is drained, on the `count` coarsest levels; finer ones are empty."""
    cell, blended = region.settings.spacing, run(blended_ground, region, water.bare, count, hashed=False)
    bare = [each.unchanged for each in blended]
    bare = bare or run(bare_ground, region.settings, water.bare, count, hashed=False)
    uplift = _uplift(region, land, water, count, run)
    drained, factors = drain_painted(uplift, cell, bare)
    finest = blended[-1].flow if blended else drained[-1]
    parts: RaisedParts = ()
    if drained[-1] is not bare[-1]:
        ground = _wet(region.settings, water, count, run)[-1]
        ground = replace(ground, repose=np.maximum(ground.repose, uplift.ground[count - 1].repose))
        if blended:
            change, parts = raised(uplift, count - 1, ground, cell, blended[-1], drained[-1], factors)
            finest = routed(ground, cell, finest.height + change)
        else:
            finest = carved(ground, cell, finest.height)
    nodes = painted_nodes(finest, uplift, count - 1, cell, blended[-1:])
    beside = blended[-1].beside if blended else None
    raster = DrainedRaster.from_drained([_NO_NODES] * (FINE - count) + [nodes], beside)
    return PaintedGround(raster, drained[-1], factors, finest, parts)


def _uplift(
    region: Sources, land: PaintedLand, water: PaintedWater, count: int, run: Runner
) -> PaintedUplift:
    """Return the uplift of features on ground that is drained around them and to water."""
    (unpainted, rock), cell = run(unpainted_levels, region.settings, hashed=False), region.settings.spacing
    blended = run(blended_ground, region, water.bare, count, hashed=False)
    bare = [] if blended else run(bare_ground, region.settings, water.bare, count, hashed=False)
    rock = np.zeros_like(rock) if blended else rock
    uplift = run(painted_uplift, land.features, unpainted[-1], cell, rock, land.outlines, hashed=False)
    levels = []
    for k, (ground, before) in enumerate(zip(uplift.ground[:count], unpainted, strict=False)):
        constraints = _limits(unpainted[k], cell, water, run)
        built = np.any([layer.inside[k] > 0.0 for layer in uplift.layers], axis=0)
        if blended:
            obeyed = _obeyed(ground, constraints, built | (blended[k].weight >= 1.0))
            levels.append(raised_level(obeyed, cell, blended[k], uplift, k))
        else:
            obeyed = _obeyed(replace(ground, least=before.least), constraints, built)
            levels.append(confined(obeyed, bare[k], uplift.zone_of(k)))
    return replace(uplift, ground=(*levels, *uplift.ground[count:]))


def blended_ground(region: Sources, water: PaintedWater, count: int, run: Runner) -> list[BlendedLevel]:
    """Return levels of the region with elevation data, coarsest first; none without."""
    base, cell = region.base, region.settings.spacing
    if base is None:
        return []
    levels, rock = run(unpainted_levels, region.settings, hashed=False)
    # Its water has no slopes of its own: data give them.
    bare = run(bare_ground, region.settings, water.bare, count, hashed=False)
    return [
        blended_level(base, source, cell, drained, at_level(rock, source, levels[-1]))
        for source, drained in zip(_wet(region.settings, water, count, run), bare, strict=True)
    ]


def bare_ground(settings: UnpaintedSettings, water: PaintedWater, count: int, run: Runner) -> list[Drained]:
    """Return levels of the region with water but without features, coarsest first."""
    return drain(_wet(settings, water, count, run), settings.spacing, BARE_ROUNDS[:count])


def _wet(settings: UnpaintedSettings, water: PaintedWater, count: int, run: Runner) -> list[DrainageInput]:
    """Return levels of the region without features, obeying the constraints of water; coarsest first."""
    levels = run(unpainted_levels, settings, hashed=False)[0][:count]
    return [_obeyed(each, _limits(each, settings.spacing, water, run)) for each in levels]


def unpainted_levels(settings: UnpaintedSettings) -> tuple[tuple[DrainageInput, ...], Float32Array]:
    """Return what levels of the painted region are drained from without paint, coarsest first; its rock."""
    ground = unpainted_ground(settings)
    region = ground.painted_region(0)
    shape = region.inside.shape
    fields = ground.uplift(0, region.column, region.row, *shape)
    rain = np.where(region.inside, settings.spacing**2, 0.0)
    free = np.full(shape, -1, np.int32)
    origin = (region.row, region.column)
    source = DrainageInput(fields.uplift, fields.repose, rain, region.border, region.inside, free, origin, 0)
    return tuple(ramped(each, settings.spacing) for each in pyramid(source)), fields.rock


def _limits(source: DrainageInput, cell: float, water: PaintedWater, run: Runner) -> DrainageConstraints:
    found: DrainageConstraints = run(_constraints, source, cell, water.unsloped, hashed=False)
    return found.limited(water.slopes)


def _constraints(source: DrainageInput, cell: float, water: PaintedWater) -> DrainageConstraints:
    sea = water.sea
    return drainage_constraints(
        _raster(source, cell),
        source.base,
        source.domain,
        water.courses,
        floors=water.floors,
        lakes=water.lakes,
        outlets=water.outlets,
        coast=None if sea is None else sea.coast,
        sea_level=0.0 if sea is None else sea.level,
    )


def _raster(source: DrainageInput, cell: float) -> NodeRaster:
    """Return where the nodes of a level are."""
    spacing, (row, column) = cell * 2.0**source.level, source.origin
    return NodeRaster(column * spacing, row * spacing, spacing, source.base.shape)


def _obeyed(
    source: DrainageInput, water: DrainageConstraints, built: BoolArray | None = None
) -> DrainageInput:
    """Return a level that obeys the constraints of water; features are `built` on valley floors, too."""
    least = None if source.least is None else np.where(water.course < 0, source.least, -np.inf)
    floor = water.floor if built is None else np.where(built, np.inf, water.floor)
    repose = np.minimum(source.repose, np.minimum(water.slope, floor))
    return replace(source, course=water.course, base=water.base, repose=repose, least=least)
