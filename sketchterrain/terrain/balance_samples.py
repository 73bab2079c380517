"""Sample points around feature centres, paired with all features whose support contains them.

A pair's values depend on its point and its feature alone, so that after an edit only the pairs of changed
features are recomputed.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array, LatticeArray, StructuredArray
from sketchterrain.placement.feature_types import (
    flank,
    hill_profile,
    hill_slope,
    mountain_profile,
    mountain_slope,
)
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.layers.layer import effective_cell
from sketchterrain.terrain.layers.point_site import OutlineNoise, distance_to_crest
from sketchterrain.terrain.layers.points import noise_weight, outline_warp, support_radii
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.layers.relief_host import ReliefNoise, extend_by_spurs
from sketchterrain.terrain.noise import ValueSlope
from sketchterrain.terrain.recipe import TerrainRecipe

# Samples around a centre, as ridges may move the summit off the centre. Their number depends on the feature's
# own size alone, so that distant features never change it.
_POINTS = 240
_MIN_POINTS = 12
_WIDE = 0.04  # of the extent: radius from which a feature gets all points
_TOP = 0.35  # radii around the centre
_CELLS_PER_EXTENT = 4096
_GOLDEN_ANGLE = 2.399963229728653
_SHAPE_FIELDS = ("id", "x", "y", "radius", "peakiness", "erosion", "gullies")


def match_features(features: StructuredArray, others: StructuredArray) -> npt.NDArray[np.intp]:
    """Return each feature's index among others sorted by id if it has the same shape there, else -1.

    Strengths are ignored.
    """
    if len(others) == 0:
        return np.full(len(features), -1, dtype=np.intp)
    row = np.minimum(np.searchsorted(others["id"], features["id"]), len(others) - 1)
    same = np.ones(len(features), dtype=np.bool_)
    for key in _SHAPE_FIELDS:
        same &= features[key] == others[key][row]
    return np.where(same, row, -1)


@dataclass(frozen=True, eq=False)
class BalanceSamples:
    """Sample points around features of one type, paired with the features whose support contains them.

    An edge is an owner of points and a feature that may affect some of them; edges are sorted by owner, then
    by feature. Pairs are in the order of their edges.
    """

    features: StructuredArray
    first: Int64Array  # (n,) index of each feature's centre among the points
    count: Int64Array  # (n,) points of each feature
    at: Float64Array  # (points, 2), m
    noise: Float64Array  # (15, points) values and slopes of `ReliefNoise`: bends, swell, ridge, spur
    owner: Int64Array  # (edges,)
    feature: Int64Array  # (edges,)
    start: Int64Array  # (edges + 1,) index of each edge's first pair
    point: Int64Array  # (pairs,) point, counted from the owner's first
    profile: Float64Array  # (pairs,) height over strength
    east: Float64Array  # (pairs,) its slope per metre
    north: Float64Array
    settled: BoolArray  # (n,) owners whose points, edges and pairs are unchanged since the previous sampling
    origin: npt.NDArray[np.intp]  # (n,) index of each feature there; -1 for new ones

    @classmethod
    def sample(
        cls, recipe: TerrainRecipe, features: StructuredArray, name: str, before: BalanceSamples | None = None
    ) -> BalanceSamples:
        """Sample around features of a type and pair the points, reusing unchanged ones of `before`."""
        origin = match_features(features, features[:0] if before is None else before.features)
        count = _counts(recipe, features)
        first = np.cumsum(count) - count
        known = origin >= 0
        at, noise = np.zeros((int(count.sum()), 2)), np.zeros((15, int(count.sum())))
        if before is not None and known.any():
            new, old = _ranges(first[known], count[known]), _ranges(before.first[origin[known]], count[known])
            at[new], noise[:, new] = before.at[old], before.noise[:, old]
        if not known.all():
            rows = _ranges(first[~known], count[~known])
            at[rows] = _spiral(features[~known], count[~known])
            x, y = (to_lattice(at[rows, axis], recipe.extent) for axis in (0, 1))
            noise[:, rows] = _noise_rows(recipe, x, y)
        owner, feature = _edges(recipe, features)
        reused = np.full(len(owner), -1, dtype=np.int64)
        if before is not None and len(before.owner):
            keys = before.owner * len(before.features) + before.feature
            requested = np.where(
                known[owner] & known[feature], origin[owner] * len(before.features) + origin[feature], -1
            )
            row = np.minimum(np.searchsorted(keys, requested), len(keys) - 1)
            reused = np.where(keys[row] == requested, row, -1)
        fresh = reused < 0
        new_pairs = _pairs(recipe, features, name, (owner[fresh], feature[fresh]), (first, count, at, noise))
        start, pairs = _merge_pairs(before, reused, new_pairs)
        settled = known.copy()
        settled[owner[fresh]] = False
        if before is not None and known.any():
            edges = np.bincount(owner, minlength=len(features))
            edges_before = np.bincount(before.owner, minlength=len(before.features))
            settled[known] &= edges[known] == edges_before[origin[known]]
        return cls(features, first, count, at, noise, owner, feature, start, *pairs, settled, origin)

    def relief(self, rows: npt.NDArray[np.integer] | slice) -> ReliefNoise:
        """Return the noise that shapes mountains and hills at some of the points."""
        n = self.noise[:, rows]
        return ReliefNoise(*(ValueSlope(*n[i : i + 3]) for i in range(6, 15, 3)))


def _counts(recipe: TerrainRecipe, features: StructuredArray) -> Int64Array:
    size = features["radius"].astype(np.float64) / (_WIDE * recipe.extent)
    return np.clip(_POINTS * size * size, _MIN_POINTS, _POINTS).astype(np.int64)


def _spiral(features: StructuredArray, count: Int64Array) -> Float64Array:
    """Return points (m) around each centre, centre first, in a sunflower (Vogel) spiral."""
    owner = np.repeat(np.arange(len(features)), count)
    number = np.arange(len(owner)) - (np.cumsum(count) - count)[owner]
    spread = _TOP * features["radius"].astype(np.float64)[owner] * np.sqrt(number / count[owner])
    angle = _GOLDEN_ANGLE * number
    x = features["x"][owner] + spread * np.cos(angle)
    y = features["y"][owner] + spread * np.sin(angle)
    return np.stack([x, y], axis=-1)


def _noise_rows(recipe: TerrainRecipe, x: LatticeArray, y: LatticeArray) -> Float64Array:
    """Return the warp of outlines and the noise of relief at lattice positions, as in `BalanceSamples`."""
    sampling = recipe.sampling(effective_cell(recipe.extent / _CELLS_PER_EXTENT))
    warp = outline_warp(recipe.world.fidelity)
    outline = OutlineNoise.at(sampling.octaves, sampling.unit, x, y, warp=warp)
    relief = ReliefNoise.at(recipe[ReliefLayer].scale(recipe.world), sampling.octaves, outline, x, y)
    return np.stack(
        [part for slope in (*outline.bend, relief.swell, relief.ridge, relief.spur) for part in slope]
    )


def _edges(recipe: TerrainRecipe, features: StructuredArray) -> tuple[Int64Array, Int64Array]:
    """Return owners and the features whose support overlaps the circle of their points, sorted by both."""
    radius = features["radius"].astype(np.float64)
    centre = np.stack([features["x"], features["y"]], axis=-1)
    wide = radius * support_radii(recipe.world.fidelity)
    tree = cKDTree(centre)
    found = tree.query_ball_point(centre, _TOP * radius + float(wide.max()), return_sorted=True)
    owner = np.repeat(np.arange(len(features)), [len(near) for near in found])
    feature = np.fromiter(chain.from_iterable(found), dtype=np.int64, count=len(owner))
    away = np.hypot(*(centre[owner] - centre[feature]).T)
    near = away <= (_TOP * radius[owner] + wide[feature]) * (1 + 1e-9)
    return owner[near].astype(np.int64), feature[near]


def _pairs(
    recipe: TerrainRecipe,
    features: StructuredArray,
    name: str,
    edges: tuple[Int64Array, Int64Array],
    points: tuple[Int64Array, Int64Array, Float64Array, Float64Array],
) -> tuple[Int64Array, Int64Array, Float64Array, Float64Array, Float64Array]:
    """Return the pairs of some edges: the first of each edge, their points, profiles and slopes."""
    first, count, at, noise = points
    many = count[edges[0]]
    row, feature = _ranges(first[edges[0]], many), np.repeat(edges[1], many)
    radius = features["radius"].astype(np.float64)
    centre = np.stack([features["x"], features["y"]], axis=-1)
    offset = (at[row] - centre[feature]).T
    # Most candidate pairs lie outside the support: reject them first.
    support = radius * support_radii(recipe.world.fidelity) * (1 + 1e-9)
    near = np.flatnonzero((offset * offset).sum(axis=0) <= (support * support)[feature])
    edge, row, feature, offset = (
        np.repeat(np.arange(len(many)), many)[near],
        row[near],
        feature[near],
        offset[:, near],
    )
    n = noise[:, row]
    t, _ = distance_to_crest(offset, 1 / radius[feature], (ValueSlope(*n[:3]), ValueSlope(*n[3:6])))
    if name == "mountain":
        t = extend_by_spurs(t, ValueSlope(*n[12:]), noise_weight(radius, recipe.world)[feature])
        style = (features["peakiness"][feature].astype(np.float64), flank(recipe.world.fidelity))
        profile, slope = mountain_profile(t.value, *style), mountain_slope(t.value, *style)
    else:
        profile, slope = (
            hill_profile(t.value, flank(recipe.world.fidelity)),
            hill_slope(t.value, flank(recipe.world.fidelity)),
        )
    inside = profile > 0.0
    edge, profile, slope = edge[inside], profile[inside], slope[inside]
    start = np.concatenate([[0], np.cumsum(np.bincount(edge, minlength=len(many)))])
    east, north = slope * t.east[inside], slope * t.north[inside]
    return start, row[inside] - first[edges[0]][edge], profile, east, north


def _merge_pairs(
    before: BalanceSamples | None,
    reused: Int64Array,
    new_pairs: tuple[Int64Array, Int64Array, Float64Array, Float64Array, Float64Array],
) -> tuple[Int64Array, tuple[Int64Array, Float64Array, Float64Array, Float64Array]]:
    """Return each edge's first pair, and all pairs: those of reused edges from before, and the new ones."""
    if before is None or (reused < 0).all():
        return new_pairs[0], new_pairs[1:]
    old, fresh, more = before.start, reused < 0, len(before.point)
    begin, length = np.zeros((2, len(reused)), dtype=np.int64)
    begin[~fresh], length[~fresh] = old[reused[~fresh]], np.diff(old)[reused[~fresh]]
    begin[fresh], length[fresh] = new_pairs[0][:-1] + more, np.diff(new_pairs[0])
    start = np.concatenate([[0], np.cumsum(length)])
    rows = _ranges(begin, length)
    parts = zip((before.point, before.profile, before.east, before.north), new_pairs[1:], strict=True)
    point, profile, east, north = (np.concatenate(each)[rows] for each in parts)
    return start, (point, profile, east, north)


def _ranges(first: Int64Array, count: Int64Array) -> Int64Array:
    """Return ``first, first + 1, …`` for `count` numbers each, concatenated."""
    starts = np.cumsum(count) - count
    return np.asarray(np.arange(int(count.sum())) + np.repeat(first - starts, count))
