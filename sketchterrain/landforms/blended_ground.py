"""Elevation data and procedural ground of the painted region, and what painted features add to both.

Without features, the ground M = w z + (1 − w)(u + e) of elevation data z by their weight w, procedural ground
u and what continues the data, e, is what it is: water flows over it, and leaves its depressions through their
lowest pass, but erodes nothing.
In zones around features, heights are M + Δ. The solver of `drainage` builds Δ from zero at the border of the
zones, on lakes, on the sea and in valleys through which much water comes from elsewhere, along the network by
which the sum drains: valleys in it continue those of the data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import convolve1d, distance_transform_edt

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.landforms.base_ground import BaseGround
from sketchterrain.landforms.drainage import (
    LEAST_RISE,
    LEAST_SLOPE,
    DrainageInput,
    Drained,
    at_level,
    carved,
    confined,
    on_network,
    routed,
)
from sketchterrain.landforms.node_raster import GroundBeside, PaintedNodes
from sketchterrain.landforms.painted_uplift import FeatureLayer, HeightControl, PaintedUplift
from sketchterrain.landforms.wetness import wetness

_THROUGH = 0.5  # circles of features: drainage area from elsewhere, from which on channels stay as they are
_CUTS, _SHALLOW = 3, 1.0  # times that barriers are cut, and depth (m) of depressions that stay
_FLOOR = 4.0  # r0 from valleys to where sides are as steep as elsewhere
_FLOOR_SHARE = 0.2  # of that slope at the valley
_STEEP_SHARE = 0.5  # of the data's slope, by which slopes of features on top are less …
_LEAST_SHARE = 0.6  # … but not below this share of theirs

RaisedParts = Sequence[tuple[FeatureLayer, Float64Array]]
"""Heights (m) that layers of features add at the nodes of a level."""


@dataclass(frozen=True, eq=False)
class BlendedLevel:
    """Ground of one level without features; arrays of shape (rows, columns)."""

    flow: Drained  # of M
    beside: GroundBeside  # u + e
    procedural: Float64Array  # (1 − w)(u + e), m
    weight: Float32Array  # of the data, 0 … 1
    rock: Float32Array  # 0 … 1

    @property
    def unchanged(self) -> Drained:
        """Return the flow with the heights that features add where there are none."""
        return replace(self.flow, height=np.where(np.isnan(self.flow.height), np.nan, 0.0))


def blended_level(
    base: BaseGround, source: DrainageInput, cell: float, drained: Drained, rock: Float32Array
) -> BlendedLevel:
    """Return a level with elevation data over procedural ground, which obeys the constraints of water."""
    data = base.window(source.level, source.origin[1], source.origin[0], *source.base.shape)
    height = drained.height + data.around
    procedural = (1.0 - data.weight.astype(np.float64)) * height
    flow = routed(source, cell, data.weight * data.height + procedural)
    return BlendedLevel(
        flow, GroundBeside(base, height), procedural, data.weight, rock + data.weight * (data.rock - rock)
    )


def raised_level(
    source: DrainageInput, cell: float, ground: BlendedLevel, painted: PaintedUplift, index: int
) -> DrainageInput:
    """Return what a level with features is drained from in their zone, as a change of the ground."""
    spacing = cell * 2.0**source.level
    height, flow, zone = ground.flow.height, ground.flow, painted.zone_of(index)
    passed = _THROUGH * np.pi * HeightControl(painted, cell).radius(index) ** 2
    core = np.maximum.reduce([layer.inside[index] for layer in painted.layers], initial=0.0)
    foreign = flow.area * (
        1.0 - on_network(source, cell, flow).shares_from(np.broadcast_to(core, zone.shape))
    )
    change = confined(source, ground.unchanged, zone & (foreign < passed))
    slope = np.nan_to_num(np.hypot(*np.gradient(height, spacing)))
    repose = np.maximum(change.repose - _STEEP_SHARE * slope, _LEAST_SHARE * change.repose)
    away = spacing * distance_transform_edt(np.isnan(change.base) & (change.course < 0))
    repose *= np.clip(away / (_FLOOR * cell), _FLOOR_SHARE, 1.0)
    at = np.flatnonzero(change.course.ravel() >= 0)
    to, columns = change.course.ravel()[at], height.shape[1]
    far = spacing * np.hypot(at // columns - to // columns, at % columns - to % columns)
    fall = np.maximum((height.ravel()[at] - height.ravel()[to]) / far, 0.0)
    repose.ravel()[at] = np.maximum(change.repose.ravel()[at] - fall, LEAST_SLOPE)
    return replace(change, uplift=np.zeros_like(change.uplift), repose=repose, ground=height, least=None)


def raised(
    painted: PaintedUplift,
    index: int,
    source: DrainageInput,
    cell: float,
    ground: BlendedLevel,
    drained: Drained,
    factors: Float64Array,
) -> tuple[Float64Array, RaisedParts]:
    """Return what features add to a level (m), scaled to their heights, and what of it each layer does."""
    layers, control = painted.layers, HeightControl(painted, cell)
    dry = painted.zone_of(index) & np.isnan(source.base) & (source.repose > 0.0)
    solver = on_network(painted.ground[index], cell, drained)

    def risen(some: tuple[FeatureLayer, ...]) -> Float64Array:
        uplift = HeightControl(replace(painted, layers=some), cell, factors).uplift(index, solver)
        change = np.nan_to_num(solver.heights(uplift))
        for axis in (0, 1):  # The data have the detail.
            change = convolve1d(change, [0.25, 0.5, 0.25], axis, mode="nearest")
        return np.where(dry, change, 0.0)

    change = risen(layers)
    own = [np.maximum(change - risen(tuple(e for e in layers if e is not each)), 0.0) for each in layers]
    height, base = ground.flow.height, np.where(np.isnan(source.base), np.nan, 0.0)
    for cuts in (_CUTS, 0, 0):
        gains = [control.gain(index, *each) for each in zip(layers, own, strict=True)]
        parts = [gain * each for gain, each in zip(gains, own, strict=True)]
        change = change + sum(parts) - sum(own)
        repose = source.repose * np.maximum.reduce(gains)
        for _ in range(cuts):
            opened = _opened(change, source, cell, ground)
            away = distance_transform_edt(opened > change - _SHALLOW)
            repose = repose * np.clip(away / _FLOOR, _FLOOR_SHARE, 1.0)
            whole = replace(source, base=base, repose=repose, ground=height)
            change = np.nan_to_num(carved(whole, cell, opened).height)
        own = [np.minimum(each, change) for each in parts]
    change = _opened(change, source, cell, ground, everywhere=True)
    return change, [(layer, np.minimum(each, change)) for layer, each in zip(layers, own, strict=True)]


def _opened(
    change: Float64Array,
    source: DrainageInput,
    cell: float,
    ground: BlendedLevel,
    *,
    everywhere: bool = False,
) -> Float64Array:
    """Return what features add, cut along the data's valleys where only these can drain, or everywhere."""
    data, path = ground.flow.height.ravel(), ground.flow.receiver.ravel()
    flow = routed(source, cell, ground.flow.height + change)
    total, to = flow.height.ravel(), flow.receiver.ravel()
    for at in np.flatnonzero((to >= 0) & (total[to] > total)).tolist():
        level, after, lowest = total[at], int(to[at]), total[at]
        while after >= 0 and total[after] > level:
            lowest = max(lowest, data[after])
            after = int(to[after])
        is_blocked = lowest > level + _SHALLOW
        way = path if is_blocked else to
        after = int(way[at]) if is_blocked or everywhere else -1
        while after >= 0 and total[after] > level:
            level = max(level - LEAST_RISE, data[after])
            total[after] = level
            after = int(way[after])
    return np.nan_to_num(total - data).reshape(change.shape)


def painted_nodes(
    drained: Drained, uplift: PaintedUplift, number: int, cell: float, blended: Sequence[BlendedLevel] = ()
) -> PaintedNodes:
    """Return the nodes of a level; `cell` is the spacing (m) of level 0."""
    source = uplift.ground[number]
    rock, height = at_level(uplift.rock, source, uplift.ground[-1]), drained.height
    for ground in blended:
        rock = np.maximum(rock, ground.rock)
        height = ground.procedural + (height - ground.flow.height)
    wet = wetness(drained.height, drained.area, cell * 2.0**source.level, cell)
    shares = [np.rint(255 * np.clip(each, 0.0, 1.0)).astype(np.uint8) for each in (rock, wet)]
    return PaintedNodes(
        source.origin[1],
        source.origin[0],
        height.astype(np.float32),
        shares[0],
        shares[1],
        drained.area.astype(np.float32),
    )
