"""Elevation data and procedural ground of the painted region, and what painted features add to both.

Without features, the ground M = w z + (1 − w) u of elevation data z by their weight w and procedural ground u is
what it is: water flows over it, and leaves its depressions through their lowest pass, but erodes nothing. In
zones around features, heights are M + Δ. The solver of `drainage` builds Δ from zero at the border of the zones,
on lakes and on the sea, along the network by which the sum drains: valleys in it continue those of the data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array
from sketchterrain.terrain.base_ground import BaseGround
from sketchterrain.terrain.drainage import DrainageInput, Drained, confined, on_network, routed
from sketchterrain.terrain.drainage_rounds import LEAST_SLOPE

_THROUGH = 600.0  # r0²: drainage area from outside of zones, from which on channels stay as they are
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


def raised_level(source: DrainageInput, cell: float, ground: BlendedLevel, zone: BoolArray) -> DrainageInput:
    """Return what a level with features is drained from in their zone, as a change of the ground.

    Parameters
    ----------
    source : with the slopes that features and water ask for
    """
    spacing = cell * 2.0**source.level
    height, flow = ground.flow.height, ground.flow
    foreign = flow.area * (1.0 - on_network(source, cell, flow).shares_from(zone.astype(np.float64)))
    change = confined(source, ground.unchanged, zone & (foreign < _THROUGH * cell * cell))
    slope = _slopes(height, spacing)
    repose = np.maximum(change.repose - _STEEP_SHARE * slope, _LEAST_SHARE * change.repose)
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


def _slopes(height: Float64Array, spacing: float) -> Float64Array:
    """Return slopes (m/m) by central differences, 0 beside missing heights."""
    north, east = np.gradient(height, spacing)
    return np.nan_to_num(np.hypot(north, east))
