"""Longitudinal profiles of roads: other programs' methods, re-implemented, and ADMM with limits of grade."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicHermiteSpline
from scipy.sparse import coo_array, diags_array
from scipy.sparse.linalg import splu
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array
from sketchterrain.benchmarks.road_samples import RoadSamples

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
