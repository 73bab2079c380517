"""Where plants keep off roads and pads, and the trees along roads."""

from __future__ import annotations

from functools import cached_property
from typing import Final

import numpy as np
import shapely
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array
from sketchterrain.roads.road_types import GROUND, TUNNEL, RoadNetwork, axis_points

_SPACING: Final = 2.0  # m between the points that stand for axes
_BARE_SHOULDER = 0.8  # of its width
_VERGE: Final = 1.5  # m from the shoulder to trees
_CORNER: Final = 15.0  # m from junctions without trees


class BuiltGround:
    """Roads, bridges and pads from above."""

    def __init__(self, network: RoadNetwork) -> None:
        self._network = network

    def is_near(self, at: Float64Array, beyond: float) -> BoolArray:
        """Return which positions (n, 2) are on a carriageway or pad, or within a distance (m) of it."""
        near = np.zeros(len(at), np.bool_)
        tree, half = self._axes
        if tree is not None:
            most = float(half.max()) + beyond
            away, nearest = (np.asarray(each) for each in tree.query(at, distance_upper_bound=most))
            found = np.isfinite(away)
            near[found] = away[found] < half[nearest[found]] + beyond
        if self._pads is not None:
            near[self._pads.query(shapely.points(at), predicate="dwithin", distance=beyond)[0]] = True
        return near

    @cached_property
    def _axes(self) -> tuple[cKDTree | None, Float64Array]:
        """Points of axes, and half the width there."""
        rows = []
        for road in self._network.roads:
            if road.structure != TUNNEL:
                points = axis_points(road, 0.5)
                count = max(int(np.ceil((points.along[-1] - points.along[0]) / _SPACING)), 1)
                points = points.at_distances(np.linspace(points.along[0], points.along[-1], count + 1))
                wide = points.half_width + _BARE_SHOULDER * points.shoulder
                rows.append(np.column_stack([points.position[:, :2], wide]))
        if not rows:
            return None, np.zeros(0)
        every = np.concatenate(rows)
        return cKDTree(every[:, :2]), every[:, 2]

    @cached_property
    def _pads(self) -> shapely.STRtree | None:
        pads = self._network.pads
        return shapely.STRtree([shapely.Polygon(pad.outline) for pad in pads]) if pads else None


def trees_along(network: RoadNetwork) -> Float64Array:
    """Return the positions (n, 2; m) of trees on both sides of roads that ask for them."""
    rows = []
    for road in network.roads:
        if road.structure != GROUND or road.trees <= 0.0:
            continue
        points = axis_points(road, 0.1)
        first, last = (
            end + sign * (_CORNER if ways > 2 else 0.0)
            for end, sign, ways in zip(points.along[[0, -1]], (1.0, -1.0), road.ends, strict=True)
        )
        along = np.arange(np.ceil(first / road.trees), np.floor(last / road.trees) + 1.0) * road.trees
        at = points.at_distances(along)
        out = at.half_width + at.shoulder + _VERGE
        rows += [at.beside(sign * out)[:, :2] for sign in (1.0, -1.0)]
    return np.concatenate([np.zeros((0, 2)), *rows])
