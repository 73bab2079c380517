"""Elevation data and procedural ground of the painted region, and what painted features add to both.

Without features, the ground M = w z + (1 − w) u of elevation data z by their weight w and procedural ground u is
what it is: water flows over it, and leaves its depressions through their lowest pass, but erodes nothing. In
zones around features, heights are M + Δ. The solver of `drainage` builds Δ from zero at the border of the zones,
on lakes and on the sea, along the network by which the sum drains: valleys in it continue those of the data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import convolve1d, distance_transform_edt

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array
from sketchterrain.terrain.base_ground import BaseGround
from sketchterrain.terrain.drainage import DrainageInput, Drained, carved, confined, on_network, routed
from sketchterrain.terrain.drainage_rounds import LEAST_RISE, LEAST_SLOPE
from sketchterrain.terrain.painted_uplift import FeatureLayer, HeightControl, PaintedUplift

_THROUGH = 1.0  # circles of features: drainage area from elsewhere, from which on channels stay as they are
_EVEN, _CUTS = 1, 3  # times that the change is evened out, and that barriers are cut
_FLOOR, _FLOOR_SHARE = (
    4.0,
    0.2,
)  # r0 from valleys to where sides are as steep as elsewhere; how steep at first
_STEEP_SHARE = 0.5  # of the data's slope, by which slopes of features on top are less …
_LEAST_SHARE = 0.6  # … but not below this share of theirs


@dataclass(frozen=True, eq=False)
class BlendedLevel:
    """Ground of one level without features; arrays of shape (rows, columns)."""

    flow: Drained  # of M
    procedural: Float64Array  # (1 − w) u, m
    weight: Float32Array  # of the data, 0 … 1
    rock: Float32Array  # 0 … 1

    @property
    def unchanged(self) -> Drained:
        """Return the flow with the heights that features add where there are none."""
        return replace(self.flow, height=np.where(np.isnan(self.flow.height), np.nan, 0.0))

    def added(self, height: Float64Array) -> Float64Array:
        """Return what nodes hold where the ground has some heights (m): all but the data."""
        return self.procedural + (height - self.flow.height)


def blended_level(
    base: BaseGround, source: DrainageInput, cell: float, drained: Drained, rock: Float32Array
) -> BlendedLevel:
    """Return a level of the region with elevation data.

    Parameters
    ----------
    source, drained, rock : the procedural ground of the level, which obeys the constraints of water
    cell : spacing of level 0 (m)
    """
    data = base.window(source.level, source.origin[1], source.origin[0], *source.base.shape)
    procedural = (1.0 - data.weight.astype(np.float64)) * drained.height
    flow = routed(source, cell, data.weight * data.height + procedural)
    return BlendedLevel(flow, procedural, data.weight, rock + data.weight * (data.rock - rock))


def raised_level(
    source: DrainageInput, cell: float, ground: BlendedLevel, painted: PaintedUplift, index: int
) -> DrainageInput:
    """Return what a level with features is drained from in their zone, as a change of the ground.

    Parameters
    ----------
    source : with the slopes that features and water ask for
    painted, index : the features, and the number of the level
    """
    spacing = cell * 2.0**source.level
    height, flow, zone = ground.flow.height, ground.flow, painted.zone_of(index)
    passed = _THROUGH * np.pi * HeightControl(painted, cell).radius(index) ** 2
    foreign = flow.area * (1.0 - on_network(source, cell, flow).shares_from(zone.astype(np.float64)))
    change = confined(source, ground.unchanged, zone & (foreign < passed))
    slope = _slopes(height, spacing)
    repose = np.maximum(change.repose - _STEEP_SHARE * slope, _LEAST_SHARE * change.repose)
    away = spacing * distance_transform_edt(np.isnan(change.base) & (change.course < 0))
    repose *= np.clip(away / (_FLOOR * cell), _FLOOR_SHARE, 1.0)
    at = np.flatnonzero(change.course.ravel() >= 0)
    to, columns = change.course.ravel()[at], height.shape[1]
    far = spacing * np.hypot(at // columns - to // columns, at % columns - to % columns)
    fall = np.maximum((height.ravel()[at] - height.ravel()[to]) / far, 0.0)
    repose.ravel()[at] = np.maximum(change.repose.ravel()[at] - fall, LEAST_SLOPE)
    return replace(change, uplift=np.zeros_like(change.uplift), repose=repose, ground=height, least=None)


def changed(source: DrainageInput, ground: BlendedLevel) -> DrainageInput:
    """Return a whole level, drained as a change of the ground."""
    base = np.where(np.isnan(source.base), np.nan, 0.0)
    return replace(source, base=base, ground=ground.flow.height, least=None)


def raised(
    painted: PaintedUplift,
    index: int,
    ground: BlendedLevel,
    whole: DrainageInput,
    cell: float,
    drained: Drained,
    factors: Float64Array,
) -> tuple[Float64Array, list[Float64Array]]:
    """Return what features add to a level (m), and the parts of it that it loses without each layer.

    The change is even where the data have detail of their own. Barriers in it are cut through, and shapes are
    scaled to their heights.

    Parameters
    ----------
    whole : the level from `changed`
    drained, factors : from `drain_painted`
    """
    level, zone, layers = painted.ground[index], painted.zone_of(index), painted.layers
    solver = on_network(level, cell, drained)

    def risen(some: tuple[FeatureLayer, ...]) -> Float64Array:
        uplift = HeightControl(replace(painted, layers=some), cell, factors).uplift(index, solver)
        return _even(solver.heights(uplift), zone)

    control, change = HeightControl(painted, cell), risen(layers)
    others = [tuple(each for each in layers if each is not layer) for layer in layers]
    without = [np.minimum(risen(each), change) for each in others]
    for is_last in (False, True):
        gains = [control.gain(index, layer, change - own) for layer, own in zip(layers, without, strict=True)]
        parts = [gain * (change - own) for gain, own in zip(gains, without, strict=True)]
        change = change + sum(part - (change - own) for part, own in zip(parts, without, strict=True))
        without = [np.maximum(change - part, 0.0) for part in parts]
        if not is_last:
            steeper = replace(whole, repose=whole.repose * np.maximum.reduce(gains, initial=1.0))
            for _ in range(_CUTS):
                change = np.nan_to_num(carved(steeper, cell, _opened(change, whole, cell, ground)).height)
            without = [np.minimum(own, change) for own in without]
    change = _opened(change, whole, cell, ground)
    return change, [change - np.minimum(own, change) for own in without]


def _opened(change: Float64Array, whole: DrainageInput, cell: float, ground: BlendedLevel) -> Float64Array:
    """Return what features add without what dams the flow of the data, from closed depressions on."""
    data, change = ground.flow.height.ravel(), change.copy()
    flow = routed(replace(whole, ground=None), cell, ground.flow.height + change)
    total, to, path = flow.height.ravel(), flow.receiver.ravel(), ground.flow.receiver.ravel()
    for at in np.flatnonzero((to >= 0) & (total[to] > total) & (data[path] < data)).tolist():
        level, after = total[at], int(path[at])
        while after >= 0 and total[after] > level:
            level = max(level - LEAST_RISE, data[after])
            total[after] = level
            after = int(path[after])
    return np.where(np.isnan(ground.flow.height), change, total.reshape(change.shape) - ground.flow.height)


def _even(change: Float64Array, zone: BoolArray) -> Float64Array:
    """Return means (1 2 1) of heights inside of a zone."""
    change = np.nan_to_num(change)
    for axis in (0, 1):
        for _ in range(_EVEN):
            change = convolve1d(change, [0.25, 0.5, 0.25], axis, mode="nearest")
    return np.where(zone, change, 0.0)


def _slopes(height: Float64Array, spacing: float) -> Float64Array:
    """Return slopes (m/m) by central differences, 0 beside missing heights."""
    north, east = np.gradient(height, spacing)
    return np.asarray(np.nan_to_num(np.hypot(north, east)))
