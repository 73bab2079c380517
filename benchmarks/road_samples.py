"""Points along the roads of a network, with what their cross-section is there."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.roads.road_shapes import axis_points
from sketchterrain.roads.road_types import GROUND, Road

_TOLERANCE = 1e-3  # m


@dataclass(frozen=True, eq=False)
class RoadSamples:
    """Points at equal steps along each leg, one leg after the other."""

    roads: tuple[Road, ...]
    leg: Int64Array  # (n,)
    along: Float64Array  # (n,) m
    road: Int64Array  # (n,) number of the road that it is on
    at: Float64Array  # (n, 2) m
    height: Float64Array  # (n,) m, of the profile
    left: Float64Array  # (n, 2) normals
    half: Float64Array  # (n,) m
    whole: Float64Array  # (n,) m, with the shoulder
    crossfall: Float64Array  # (n, 2)

    @cached_property
    def inner(self) -> BoolArray:
        """(n − 1,) whether the next sample is on the same leg."""
        return np.asarray(np.diff(self.leg) == 0)

    @cached_property
    def structure(self) -> Int64Array:
        """(n,)."""
        return np.array([road.structure for road in self.roads])[self.road]

    @property
    def on_ground(self) -> BoolArray:
        """(n,)."""
        return np.asarray(self.structure == GROUND)

    def beside(self, offset: Float64Array) -> Float64Array:
        """Return positions and heights (n, 3) of the section at offsets (m) from the axis, to the left."""
        lean = np.where(offset > 0.0, *self.crossfall.T)
        return np.column_stack([self.at + self.left * offset[:, None], self.height + lean * np.abs(offset)])

    def limits(self, grades: Mapping[int, float]) -> Float64Array:
        """Return the limits of grade between samples and the next ones, (n − 1,), by a road's feature."""
        own = np.array([grades[road.id] for road in self.roads])[self.road]
        return np.asarray(np.maximum(own[:-1], own[1:]))

    def grades(self, height: Float64Array) -> Float64Array:
        """Return the grades of heights (n,) between samples and the next ones, (n − 1,); 0 between legs."""
        length = np.where(self.inner, np.diff(self.along), np.inf)
        return np.asarray(np.abs(np.diff(height)) / length)


def road_samples(roads: tuple[Road, ...], layer: str, step: float) -> RoadSamples:
    """Return points on the axes of a layer's roads, about `step` (m) apart."""
    roads = tuple(road for road in roads if road.layer == layer)
    found: list[tuple[Any, ...]] = []
    number = 0
    for leg, group in groupby(roads, key=lambda road: road.leg):
        parts = list(group)
        points = [axis_points(part, _TOLERANCE) for part in parts]
        known = [
            np.column_stack([each.position, each.left, each.half_width, each.shoulder, each.crossfall])
            for each in points
        ]
        along = np.concatenate([each.along for each in points])
        at = np.linspace(along[0], along[-1], max(round((along[-1] - along[0]) / step), 1) + 1)
        columns = np.column_stack([np.interp(at, along, column) for column in np.concatenate(known).T])
        own = number + np.searchsorted([part.along[0] for part in parts], at, side="right") - 1
        found.append((np.full(len(at), leg), at, own, columns))
        number += len(parts)
    leg, along, road, columns = (np.concatenate(each) for each in zip(*found, strict=True))
    left = columns[:, 3:5] / np.hypot(*columns[:, 3:5].T)[:, None]
    whole = columns[:, 5] + columns[:, 6]
    shape = columns[:, :2], columns[:, 2], left, columns[:, 5], whole, columns[:, 7:]
    return RoadSamples(roads, leg.astype(np.int64), along, road.astype(np.int64), *shape)
