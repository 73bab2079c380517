"""Uplift of painted features on a raster, and its control while the ground is drained.

A feature raises a core, as far as its visible radius and the outline of its painted shape, and a collar
outside: foothills that stay below a quarter of its height, so that its outline stays where it was painted.
Mountains and hills add up; streams that come from elsewhere cut through them. Only a zone around features
drains anew: the ground beyond keeps its heights.

Heights follow from drainage alone: between two routings the uplift of every feature, then of every shape, is
scaled by how far its crest is from the height asked for, above the same network of valleys without its
layer's uplift.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import distance_transform_edt

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, Int32Array, Int64Array
from sketchterrain.host.library import host_function
from sketchterrain.landforms.drainage import (
    ROUNDS,
    DrainageInput,
    Drained,
    LevelSolver,
    at_level,
    coarsened,
    drain,
    on_network,
)
from sketchterrain.landforms.placement.feature_types import smoothstep
from sketchterrain.landforms.uplift import Outline, UpliftFeatures
from sketchterrain.stages.runner import Runner

COLLAR = 0.5  # width of the collar, visible radii
_ZONE = 1.2  # visible radii around features, beyond which the ground stays as it is
_CLEARANCE = 0.9  # visible radii, within which unpainted ground is calmed
_CALM = 0.7  # share of its uplift that it loses there, all of it on rock
_EDGE = 0.1  # half the width of the step between core and collar, visible radii
_FRONT = 0.3  # visible radii over which slopes grow from the collar's to the core's
_OUTSET = 0.16  # of the step beyond the outline: spurs that reach beyond it make up for valleys inside
# Over the mean slope from a feature's outline to its summit:
_CORE_UPLIFT, _COLLAR_UPLIFT = 2.0, 4.0
_COLLAR_SLOPE = 0.9 * 0.25 / COLLAR
_APRON, _APRON_RISE = 0.4, 0.9  # shares of it: at the collar's edge, and how much more at the core
_REPOSE, _EROSION_REPOSE, _HILL_BASE = 0.7, 0.2, 0.05  # tangents
_STEEPEST = 1.08  # over these, where the ground is least even
_PEAK = 0.5  # share of the uplift that peakiness moves from the outline to the summit
_UNEVEN = 0.35  # by how much uplift and slopes vary from place to place
# Hash keys, bits of the cells (mesh units) and amplitudes of the noise by which they do; the fine one sets in
# between two depths inside the outline (visible radii), which is to stay where it is, as rivers beside it.
_BROAD, _FINE = ((31, 9, 0.6), (32, 7, 0.5)), ((33, 6, 0.7), (34, 5, 0.4))
_FINE_FROM, _FINE_FULL = -0.1, 0.3
_FOREIGN = 1.5  # weight of drainage area from elsewhere: streams that come from there cut through features
_ROCK_DEPTH = 0.3  # visible radii inside the outline, where all is rock
_SUMMIT = 0.3  # visible radii inside the outline, beyond which ground counts as summit
ADJUST_SHARE = 0.7  # of what features lack: what they gain at a routing; at the last one, all
PASSES = 2  # adjustments of whole shapes, at the last routing

_LEVELS = 4
_OUTSIDE = -9.0
_NONE: Int64Array = np.zeros(0, np.int64)


class _Steepness(NamedTuple):
    """Slope of sides over the mean one from a feature's outline to its summit."""

    loose: float  # for a fidelity up to 0.8
    strict: float  # of 1: steep sides keep to their outlines
    erosion: float  # what full erosion adds

    def at(self, exact: float, erosion: Float64Array) -> Float64Array:
        return self.loose + exact * (self.strict - self.loose) + self.erosion * erosion


_STEEP, _STEEPEST_HILL = _Steepness(1.0, 1.4, 0.3), _Steepness(1.3, 1.8, 0.8)


@dataclass(frozen=True, eq=False)
class FeatureLayer:
    """Features of one layer on a raster: what they add to the ground at all levels, coarsest first."""

    members: Int64Array  # numbers of the features
    collar: tuple[Float64Array, ...]
    core: tuple[Float64Array, ...]  # scaled by the features' factors
    inside: tuple[Float64Array, ...]  # 0 … 1: what drains from here is their own
    target: Float64Array  # (rows, columns) of level 0: height (m) of a crest there
    region: Int32Array  # (rows, columns) of level 0: number of the painted shape, −1 outside
    owner: Int64Array  # the member nearest to its summit, −1 outside of all cores
    highest: Float64Array  # m, of each shape
    risen: BoolArray  # (rows, columns): where both heights are elevations


@dataclass(frozen=True, eq=False)
class PaintedUplift:
    """A region of ground with painted features, at all levels, coarsest first."""

    features: UpliftFeatures
    ground: tuple[DrainageInput, ...]  # calmed around features, slopes as great as features ask for
    layers: tuple[FeatureLayer, ...]
    rock: Float32Array  # 0 … 1: where mountains are
    zone: BoolArray  # (rows, columns) of level 0: what features change

    def zone_of(self, index: int) -> BoolArray:
        """Return the zone at the nodes of a level."""
        return at_level(self.zone, self.ground[index], self.ground[-1])


def painted_uplift(
    features: UpliftFeatures,
    ground: DrainageInput,
    cell: float,
    rock: Float32Array | None = None,
    outlines: Mapping[str, Outline] = MappingProxyType({}),
    run: Runner | None = None,
) -> PaintedUplift:
    """Return the uplift of painted features on top of a region's ground.

    Parameters
    ----------
    ground : level 0 of the region as it is unpainted; painted lakes and the sea are outlets (``base``),
        painted rivers are courses
    cell : spacing of level 0 (m)
    rock : share of rock, 0 … 1, of the unpainted ground
    outlines : painted shapes of mountains and hills, which features fill beyond their radii
    """
    run = Runner() if run is None else run
    shape = ground.base.shape
    centre = _centres(features, ground, cell)
    radius = np.maximum(features.radius / cell, 1.0)
    rock = np.zeros(shape, np.float32) if rock is None else rock
    near = _nearness(centre, radius, shape)
    strata = np.zeros(shape)
    calm = smoothstep((near + _CLEARANCE) / _CLEARANCE)
    uplift = ground.uplift * (1.0 - calm * (_CALM + (1.0 - _CALM) * rock))
    repose = ground.repose
    rock = rock * (1.0 - calm).astype(np.float32)
    layers = []
    for name in ("mountain", "hill"):
        members = np.flatnonzero((features.is_rock == (name == "mountain")) & (features.height > 0.0))
        if not len(members):
            continue
        part = features.of(members)
        # Numbers of shapes among those of all layers depend on the others.
        alone = part._replace(shape=part.region)
        found = run(_raised_by, alone, ground, cell, name, outlines.get(name), hashed=False)
        layers.append(replace(found.layer, members=members, highest=_highest(part)))
        below = 0.0 if repose is ground.repose else repose
        repose = np.where(found.inside, np.maximum(found.repose, below), repose)
        if found.rock is not None:
            bare, strata = found.rock
            rock = np.maximum(rock, bare).astype(np.float32)
    levels = pyramid(replace(ground, uplift=uplift, repose=np.maximum(repose, 0.3 * uplift), strata=strata))
    return PaintedUplift(features, levels, tuple(layers), rock.astype(np.float32), near > -_ZONE)


class _Raised(NamedTuple):
    """What features of one layer do to the nodes of level 0, (rows, columns)."""

    layer: FeatureLayer  # with no members
    inside: BoolArray
    repose: Float64Array
    rock: tuple[Float64Array, Float64Array] | None  # 0 … 1, of mountains: where it is bare, its strata


def _raised_by(
    part: UpliftFeatures, ground: DrainageInput, cell: float, name: str, outline: Outline | None, run: Runner
) -> _Raised:
    is_rock, shape = name == "mountain", ground.base.shape
    broad, fine = (
        run(_unevenness, ground.origin, shape, octaves, hashed=False) for octaves in (_BROAD, _FINE)
    )
    region, exact = np.full(shape, -1, np.int32), 0.0
    if outline is not None:
        region, exact = outline.region_at(ground.origin, shape), outline.exactness
    position, owner, means = _features_at(
        _centres(part, ground, cell),
        np.maximum(part.radius / cell, 1.0),
        np.stack([part.height, part.peakiness, part.erosion, part.radius, part.strata], axis=-1),
        (part.region, region),
    )
    inside = position > _OUTSIDE
    height, peakiness, erosion, wide, layered = np.ascontiguousarray(np.moveaxis(means, -1, 0))
    if outline is not None:
        inset = outline.depth_at(ground.origin, shape)
        within = np.minimum(inset / np.maximum(wide, cell), position + outline.filling)
        position = np.where(inside, np.maximum(position, within), _OUTSIDE)
    slope = np.where(inside, height / np.maximum(wide, 1e-9), 0.0)
    core = smoothstep((position + _OUTSET + _EDGE) / (2.0 * _EDGE))
    collar = smoothstep((position + COLLAR) / COLLAR) * (1.0 - core)
    rise = np.clip(position, 0.0, 1.0)
    uneven = broad + fine * smoothstep((position - _FINE_FROM) / (_FINE_FULL - _FINE_FROM))
    uneven = 1.0 + _UNEVEN * uneven
    peak = 1.0 + _PEAK * (peakiness - 0.5) * (2.0 * rise - 1.0)
    sides = _side_slopes(position, slope, erosion, exact, is_rock=is_rock)
    foot = smoothstep((position + COLLAR) / (0.6 * COLLAR))
    ramp = _STEEPEST * np.minimum(uneven, 1.0) * sides
    repose = np.maximum(ground.repose * (1.0 - core) * (1.0 - foot), ramp)
    risen = (owner >= 0) & (part.summit > -np.inf)[owner]
    # Data that lie higher at the foot of a slope are not what rises.
    owner = np.where(risen & (position < _SUMMIT), -1, owner)
    collar, raised = _COLLAR_UPLIFT * slope * collar, _CORE_UPLIFT * slope * core * peak * uneven
    collars, cores = _coarsened_fields(collar, raised, ground)
    insides, _ = _coarsened_fields(np.where(inside, core, 0.0), ground.repose, ground)
    target = np.where(risen, part.summit[owner], height)
    layer = FeatureLayer(
        *(_NONE, collars, cores, insides, target, region, owner, part.height, risen & (owner >= 0))
    )
    rock = None
    if is_rock:
        bare = np.where(inside, smoothstep(position / _ROCK_DEPTH), 0.0)
        rock = bare, np.where(inside, layered * core, 0.0)
    return _Raised(layer, inside, repose, rock)


def _side_slopes(
    position: Float64Array, slope: Float64Array, erosion: Float64Array, exact: float, *, is_rock: bool
) -> Float64Array:
    """Return slopes of sides, and of the apron below, by the mean slope from the outline to the summit."""
    steep = np.maximum(_REPOSE + _EROSION_REPOSE * erosion, _STEEP.at(exact, erosion) * slope)
    if not is_rock:
        steep = np.minimum(steep, _STEEPEST_HILL.at(exact, erosion) * slope + _HILL_BASE)
    front = smoothstep((position + _OUTSET + _EDGE) / _FRONT)
    apron = _COLLAR_SLOPE * slope * (_APRON + _APRON_RISE * smoothstep((position + COLLAR) / COLLAR))
    return np.asarray(apron * (1.0 - front) + steep * front)


def _centres(
    features: UpliftFeatures, level: DrainageInput, cell: float
) -> tuple[Float64Array, Float64Array]:
    """Return columns and rows of the features among the nodes of level 0."""
    return features.x / cell - level.origin[1], features.y / cell - level.origin[0]


def _highest(features: UpliftFeatures) -> Float64Array:
    """Return the greatest height (m) of the features of each shape."""
    highest = np.full(int(features.shape.max()) + 1, 1e-9)
    top = np.where(np.isinf(features.summit), features.height, features.summit)
    np.maximum.at(highest, features.shape, top)
    return highest


def pyramid(finest: DrainageInput) -> tuple[DrainageInput, ...]:
    """Return all levels of a region, coarsest first."""
    levels = [finest]
    while len(levels) < _LEVELS:
        levels.append(coarsened(levels[-1]))
    return tuple(reversed(levels))


def _coarsened_fields(first: Float64Array, second: Float64Array, finest: DrainageInput) -> Any:
    """Return two fields, each at all levels, coarsest first."""
    levels = pyramid(replace(finest, uplift=first, repose=second))
    return zip(*((each.uplift, each.repose) for each in levels), strict=True)


class HeightControl:
    """Uplift of painted features at each level, scaled until their crests reach their heights."""

    def __init__(
        self, painted: PaintedUplift, cell: float, factors: Float64Array | None = None, routings: int = 0
    ) -> None:
        self._painted, self._routings = painted, routings
        features, finest = painted.features, painted.ground[-1]
        self._centre = _centres(features, finest, cell)
        self._radius = np.maximum(features.radius / cell, 1.0)
        self.factors = np.ones(len(features.x)) if factors is None else factors

    def uplift(self, index: int, solver: LevelSolver) -> Float64Array:
        """Return the uplift of a level on its present network."""
        parts = self._parts(index, self._shares(index, solver))
        return np.asarray(self._painted.ground[index].uplift + sum(parts))

    def adjusted(self, index: int, solver: LevelSolver) -> Float64Array:
        """Return the uplift of a level on its present network, adjusted for features and then for shapes."""
        shares = self._shares(index, solver)
        parts = self._parts(index, shares)
        self._routings -= 1
        is_last = self._routings == 0
        for number in range(1 + PASSES * is_last):
            self._adjust(index, solver, parts, whole=number > 0, share=1.0 if is_last else ADJUST_SHARE)
            parts = self._parts(index, shares)
        return np.asarray(self._painted.ground[index].uplift + sum(parts))

    def _shares(self, index: int, solver: LevelSolver) -> list[Float64Array]:
        """Return how much each layer raises streams: those that come from elsewhere cut through it."""
        own = [solver.shares_from(layer.inside[index]) for layer in self._painted.layers]
        return [each / (each + _FOREIGN * (1.0 - each) + 1e-9) for each in own]

    def _adjust(
        self, index: int, solver: LevelSolver, parts: Sequence[Float64Array], *, whole: bool, share: float
    ) -> None:
        """Build the heights of a level and scale its features by a share of what they lack.

        Each feature is scaled on its own, or, as `whole`, all those of a shape together.
        """
        painted, ground = self._painted, self._painted.ground[index].uplift
        _, start, step = self._place(index)
        height = solver.heights(ground + sum(parts))
        for layer, part in zip(painted.layers, parts, strict=True):
            without = solver.heights(ground + np.maximum(sum(parts) - part, 0.0))
            factors, effect = self.factors[layer.members], height - without
            aims = layer.target, self._below(layer, index), layer.owner, np.arange(len(factors)), 1e-3
            if whole:
                aims = self._shape_aims(layer, index, layer.owner)
            _adjust_factors(effect, aims, start, step, factors, share)
            self.factors[layer.members] = factors

    def gain(self, index: int, layer: FeatureLayer, effect: Float64Array) -> Float64Array:
        """Return by how much a layer's effect (m) at a level falls short of its shapes' heights."""
        _, start, step = self._place(index)
        nearest = distance_transform_edt(layer.owner < 0, return_distances=False, return_indices=True)
        aims, gains = self._shape_aims(layer, index, layer.owner[tuple(nearest)]), np.ones(len(layer.members))
        _adjust_factors(np.ascontiguousarray(effect), aims, start, step, gains, 1.0)
        return self._spread(layer, index, gains)

    def _shape_aims(self, layer: FeatureLayer, index: int, owner: Int64Array) -> tuple[Any, ...]:
        """Return the aims of `_adjust_factors` for whole shapes."""
        shape = self._painted.features.shape[layer.members]
        return layer.highest[shape[owner]], self._below(layer, index), owner, shape, 0.0

    def radius(self, index: int) -> Float64Array:
        """Return the radius (m) of features near the nodes of a level, at least 1."""
        radius = self._painted.features.radius
        found = [self._spread(each, index, radius[each.members]) for each in self._painted.layers]
        return np.asarray(np.maximum.reduce(found, initial=1.0))

    def _below(self, layer: FeatureLayer, index: int) -> Float64Array:
        """Return the height (m) of the ground at a level's nodes where heights are elevations, else 0."""
        level = self._painted.ground[index]
        if level.ground is None:
            return np.zeros(level.base.shape)
        return np.where(at_level(layer.risen, level, self._painted.ground[-1]), level.ground, 0.0)

    def _parts(self, index: int, shares: Sequence[Float64Array]) -> list[Float64Array]:
        """Return what each layer adds to a level."""
        layers = self._painted.layers
        factors = [self._spread(each, index, self.factors[each.members]) for each in layers]
        return [
            share * (layer.collar[index] + layer.core[index] * factor)
            for layer, share, factor in zip(layers, shares, factors, strict=True)
        ]

    def _spread(self, layer: FeatureLayer, index: int, factors: Float64Array) -> Float64Array:
        """Return the means of factors of a layer's members at the nodes of a level."""
        level, start, step = self._place(index)
        centre = self._centre[0][layer.members], self._centre[1][layer.members]
        regions = self._painted.features.region[layer.members], layer.region
        mean, scratch = np.zeros(level.base.shape), np.zeros(level.base.shape)
        given = *centre, self._radius[layer.members], factors, *regions, *start, step
        host_function("mean_factors")(*given, mean, scratch)
        return mean

    def _place(self, index: int) -> tuple[DrainageInput, tuple[int, int], int]:
        """Return a level, its first node among those of level 0, and its spacing."""
        level, first = self._painted.ground[index], self._painted.ground[-1].origin
        step = 1 << level.level
        return level, (level.origin[0] * step - first[0], level.origin[1] * step - first[1]), step


def drain_painted(
    painted: PaintedUplift, cell: float, bare: Sequence[Drained], *, rounds: Sequence[int] = ROUNDS
) -> tuple[list[Drained], Float64Array]:
    """Drain a region with its painted features so that they reach their heights; coarsest level first.

    Returns the factors of the features, too.

    Parameters
    ----------
    bare : levels of the region without features, coarsest first; levels that are missing are left out
    """
    levels = len(bare)
    control = HeightControl(painted, cell, routings=sum(rounds[:levels]))
    if not painted.layers:
        return list(bare), control.factors
    drained = drain(painted.ground[:levels], cell, rounds[:levels], onto=bare, raise_ground=control.adjusted)
    return drained, control.factors


def height_without(
    painted: PaintedUplift, drained: Drained, factors: Float64Array, cell: float
) -> Float64Array:
    """Return the heights (m) of level 0 with the uplift of some features, on the network drained with all.

    Parameters
    ----------
    painted : with the features that stay
    drained, factors : level 0 and factors from `drain_painted` with all of them
    """
    solver = on_network(painted.ground[-1], cell, drained)
    if painted.layers:
        control = HeightControl(painted, cell, factors)
        solver.set_uplift(control.uplift(len(painted.ground) - 1, solver))
    solver.settle()
    return solver.result().height


def _unevenness(
    origin: tuple[int, int], shape: tuple[int, int], octaves: Sequence[tuple[int, int, float]]
) -> Float64Array:
    """Return noise of short wavelengths, about −1 … 1, at nodes of level 0."""
    noise = np.zeros(shape)
    for octave in octaves:
        host_function("uneven_noise")(*origin, *octave, noise)
    return noise


def _nearness(
    centre: tuple[Float64Array, Float64Array], radius: Float64Array, shape: tuple[int, int]
) -> Float64Array:
    """Return the greatest depth inside any feature over its radius, negative outside."""
    near = np.full(shape, _OUTSIDE)
    host_function("feature_nearness")(*centre, radius, _ZONE, near)
    return near


def _features_at(
    centre: tuple[Float64Array, Float64Array],
    radius: Float64Array,
    values: Float64Array,
    regions: tuple[Int64Array, Int32Array],
) -> tuple[Float64Array, Int64Array, Float64Array]:
    """Return, at nodes, where they lie in features and weighted means of these.

    Depth inside the outline of any feature over its radius, negative outside; the deepest feature; means of
    values (n, m).
    """
    shape = regions[1].shape
    found = np.empty(shape), np.empty(shape, np.int64), np.zeros((*shape, values.shape[1]))
    host_function("features_at")(*centre, radius, values, *regions, _OUTSIDE, *found, np.zeros((4, *shape)))
    return found


def _adjust_factors(
    effect: Float64Array,
    aims: tuple[Any, ...],
    start: tuple[int, int],
    step: int,
    factors: Float64Array,
    share: float,
) -> None:
    """Scale the factors of groups of features by how far their highest crests are from their aims.

    Crests have the effects that quadratic B-splines read at nodes; NaN beside missing ones.

    `aims` are heights (m) that crests have at nodes, the ground below them, the feature at each node, the
    group of each feature, and the least rise (m) that counts.
    """
    target, below, owner, group, least = aims
    given = effect, below, target, owner, group, least, *start, step, share
    host_function("adjust_factors")(*given, factors, np.empty(int(group.max()) + 1))
