"""Positions on the host with the point features near them: pairs, distances, and the warp of outlines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.landforms.placement.feature_types import area_profile
from sketchterrain.terrain.noise import OctaveTable, fbm

if TYPE_CHECKING:
    from sketchterrain.terrain.layers.points import PackedFeatures


@dataclass(frozen=True)
class PointSite:
    """Lattice positions with the features near them and the warp of their outlines."""

    x: LatticeArray
    y: LatticeArray
    unit: float
    packed: PackedFeatures
    octaves: OctaveTable
    warp: float  # greatest displacement of outlines, in radii

    @cached_property
    def _metres(self) -> Float64Array:
        """Positions from the first one (m), (n, 2)."""
        return np.stack([self.x - self.x[:1], self.y - self.y[:1]], axis=-1) * self.unit

    @cached_property
    def _bend(self) -> tuple[Float64Array, ...]:
        """Displacement of outlines eastward and northward, in radii."""
        noises = (fbm(self.octaves, name, self.x, self.y) for name in ("warp_u", "warp_v"))
        return tuple(self.warp * np.clip(noise, -1, 1) for noise in noises)

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._metres)

    def pairs_within_support(self, slot: int) -> PointPairs:
        """Pair these positions with the features of a slot whose support contains them."""
        packed = self.packed
        selected = np.flatnonzero(packed.slot == slot)
        if not (selected.size and self.x.size):
            return PointPairs(np.zeros(0, np.int64), np.zeros(0, np.int64))
        centre = (packed.at[selected] - [self.x[0], self.y[0]]) * self.unit
        wide = packed.support[selected] * (1 + 1e-9) + 1e-6
        found = self._tree.query_ball_point(centre, wide)
        count = [len(each) for each in found]
        point = np.fromiter(chain.from_iterable(found), dtype=np.int64, count=sum(count))
        return PointPairs(point, np.repeat(selected, count))

    def distances(self, pairs: PointPairs) -> Float64Array:
        """Return the distances of positions from features' centres, in radii."""
        packed, point, feature = self.packed, pairs.point, pairs.feature
        scale = self.unit * packed["inverse_radius"][feature]
        east, north = (bend[point] for bend in self._bend)
        dx = (self.x[point] - packed.at[feature, 0]) * scale + east
        dy = (self.y[point] - packed.at[feature, 1]) * scale + north
        return np.asarray(np.hypot(dx, dy))

    def summed(self, pairs: PointPairs, values: Float64Array) -> Float64Array:
        """Sum values of pairs at each position, in the order of the features."""
        return np.asarray(np.bincount(pairs.point, values, minlength=len(self.x)), dtype=np.float64)

    def areas(self, slot: int) -> tuple[Float64Array, Float64Array]:
        """Return the cover of an area type, 0 … 1, and the cover-weighted mean of its strength."""
        pairs = self.pairs_within_support(slot)
        cover = area_profile(self.distances(pairs))
        strength = self.packed["feature_strength"][pairs.feature]
        total, weights, strengths = (self.summed(pairs, each) for each in (cover**4, cover, cover * strength))
        mean = np.where(weights > 1e-6, strengths / np.maximum(weights, 1e-6), 0)
        return np.minimum(np.sqrt(np.sqrt(total)), 1), mean


class PointPairs(NamedTuple):
    """Pairs of positions and features, by index, in the order of the features."""

    point: LatticeArray
    feature: LatticeArray
