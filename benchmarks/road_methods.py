"""Longitudinal profiles of roads: other programs' methods, re-implemented, and ADMM with limits of grade."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

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


_KNOTS, _LEAST_WINDOW = 30.0, 5.0  # m: maps4fs' 15 segments of 2 m, and half of its window
_ROUNDS, _SMOOTH, _PENALTY = 300, 300.0, 1e4  # of ADMM: weights of changes of grade and of the limit


@dataclass(frozen=True, eq=False)
class Problem:
    """Samples of roads with the ground below them."""

    samples: RoadSamples
    ground: Float64Array  # (n,) m
    heights: Callable[[Float64Array, Float64Array], Any]  # of the ground anywhere
    limits: Float64Array  # (n − 1,)
    vertices: Float64Array  # (k, 2) of the lines that were drawn, m

    @property
    def legs(self) -> list[tuple[int, int]]:
        """First and last sample of each leg."""
        breaks = np.flatnonzero(~self.samples.inner)
        return list(zip([0, *(breaks + 1)], [*breaks, len(self.ground) - 1], strict=True))

    @property
    def key(self) -> Float64Array:
        """(n,) length along each leg, ascending over all of them."""
        return np.asarray(self.samples.along + 1e6 * np.append(0.0, np.cumsum(~self.samples.inner)))


def _flattened(problem: Problem) -> Float64Array:
    """osgEarth: on its axis, a road is linear between the ground's heights at its vertices."""
    knots = np.unique(np.append(cKDTree(problem.samples.at).query(problem.vertices)[1], problem.legs))
    return np.asarray(np.interp(problem.key, problem.key[knots], problem.ground[knots]))


def _means(problem: Problem) -> Float64Array:
    """maps4fs: linear between means of the ground in squares, of about a road's width, every 30 m."""
    key, samples = problem.key, problem.samples
    pieces = [(key[a], key[b], int(np.ceil((key[b] - key[a]) / _KNOTS)) + 1) for a, b in problem.legs]
    at = np.concatenate([np.linspace(*each) for each in pieces])
    x, y, half = (np.interp(at, key, each) for each in (*samples.at.T, samples.half))
    step = np.maximum(_LEAST_WINDOW, 2.0 * half) * (2.0 / 3.0)
    square = [problem.heights(x + i * step, y + j * step) for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return np.interp(key, at, np.mean(square, axis=0))


def _box_filtered(problem: Problem) -> Float64Array:
    """Proland: means of samples, mirrored through the ends of a curve, and cubics; straight on bridges."""
    samples, result, known = problem.samples, problem.ground.copy(), problem.samples.on_ground
    for a, b in problem.legs:
        width = min(2.0 * float(samples.half[a]), 20.0)
        along, known[[a, b]] = samples.along[a : b + 1], True
        count = int(np.ceil((along[-1] - along[0]) / (20.0 * width / 6.0)))
        at, aside = np.linspace(along[0], along[-1], max(2, count)), max(1, int(width / 3.0))
        raw = np.interp(at, along, problem.ground[a : b + 1])
        around = np.lib.stride_tricks.sliding_window_view(
            np.pad(raw, aside, "reflect", reflect_type="odd"), 2 * aside + 1
        )
        smooth = around.mean(axis=1)
        result[a : b + 1] = CubicHermiteSpline(at, smooth, np.gradient(smooth, at))(along)
    return np.interp(problem.key, problem.key[known], result[known])


def _admm(problem: Problem) -> Float64Array:
    """Least squares of heights and changes of grade within the limits, bridges and tunnels free."""
    samples = problem.samples
    _, node = np.unique(samples.at @ np.array([1.0, 1j]), return_inverse=True)
    edge = np.flatnonzero(samples.inner)
    per_length = 1.0 / np.diff(samples.along)[edge]
    places = np.tile(np.arange(len(edge)), 2), np.append(node[edge], node[edge + 1])
    grade = coo_array((np.append(-per_length, per_length), places), (len(edge), node.max() + 1)).tocsr()
    following = np.flatnonzero(np.diff(edge) == 1)
    change = grade[following + 1] - grade[following]
    weight, wanted = np.full(grade.shape[1], 1e-6), np.zeros(grade.shape[1])
    weight[node[samples.on_ground]] = 1.0
    wanted[node] = problem.ground
    smooth = _SMOOTH * (change.T @ change) + _PENALTY * (grade.T @ grade)
    factors, limit = splu((diags_array(weight) + smooth).tocsc()), problem.limits[edge]
    height, within, dual = wanted, np.zeros(len(edge)), np.zeros(len(edge))
    for _ in range(_ROUNDS):
        height = factors.solve(weight * wanted + _PENALTY * (grade.T @ (within - dual)))
        within = np.clip(grade @ height + dual, -limit, limit)
        dual += grade @ height - within
    return np.asarray(height[node])


METHODS: Final[Mapping[str, Callable[[Problem], Float64Array]]] = {
    "draped": lambda problem: problem.ground,
    "osgEarth's flattening": _flattened,
    "maps4fs' means": _means,
    "Proland's filter": _box_filtered,
    "ADMM": _admm,
}
"""Heights (m) at samples by the name of the method."""
