"""Positions on the host with the point features near them: pairs, distances, and the warp of outlines."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array, Int64Array, LatticeArray
from sketchterrain.placement.feature_types import area_profile
from sketchterrain.terrain.layers.layer import scaled_slope
from sketchterrain.terrain.noise import OctaveTable, ValueSlope, fbm_slope

if TYPE_CHECKING:
    from sketchterrain.terrain.layers.points import PackedFeatures


@dataclass(frozen=True)
class OutlineNoise:
    """Warp of outlines at points; slopes are per metre."""

    swell: ValueSlope  # noise of the warp eastward, -1 … 1
    bend: tuple[ValueSlope, ValueSlope]  # displacement of outlines eastward and northward, in radii

    @classmethod
    def at(
        cls, octaves: OctaveTable, unit: float, x: LatticeArray, y: LatticeArray, *, warp: float
    ) -> OutlineNoise:
        """Return the noise at lattice positions of shape (n,)."""
        east, north = (_warp(octaves, name, x, y, 1 / unit) for name in ("warp_u", "warp_v"))
        return cls(east, (scaled_slope(east, warp), scaled_slope(north, warp)))


def _warp(octaves: OctaveTable, name: str, x: LatticeArray, y: LatticeArray, per_metre: float) -> ValueSlope:
    noise = fbm_slope(octaves, name, x, y)
    inside = np.where(np.abs(noise.value) < 1, per_metre, 0)
    return ValueSlope(np.clip(noise.value, -1, 1), noise.east * inside, noise.north * inside)


@dataclass(frozen=True)
class PointSite:
    """Lattice positions with the features near them and the warp there."""

    x: LatticeArray
    y: LatticeArray
    unit: float
    packed: PackedFeatures
    noise: OutlineNoise

    @cached_property
    def _metres(self) -> Float64Array:
        """Positions from the first one (m), (n, 2)."""
        return np.stack([self.x - self.x[:1], self.y - self.y[:1]], axis=-1) * self.unit

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

    def distance_to_crests(self, pairs: PointPairs) -> tuple[ValueSlope, ValueSlope]:
        """Return the distances to features, as `distance_to_crest` does."""
        packed, point, feature = self.packed, pairs.point, pairs.feature
        offset = (
            np.stack([self.x[point] - packed.at[feature, 0], self.y[point] - packed.at[feature, 1]])
            * self.unit
        )
        east, north = (ValueSlope(*(part[point] for part in bend)) for bend in self.noise.bend)
        return distance_to_crest(
            offset, packed["inverse_radius"][feature], (east, north), crest=_crest(packed, feature)
        )

    def summed(self, pairs: PointPairs, values: Float64Array) -> Float64Array:
        """Sum values of pairs at each position, in the order of the features."""
        return np.asarray(np.bincount(pairs.point, values, minlength=len(self.x)), dtype=np.float64)

    def areas(self, slot: int) -> tuple[Float64Array, Float64Array]:
        """Return the cover of an area type, 0 … 1, and the cover-weighted mean of its strength."""
        pairs = self.pairs_within_support(slot)
        cover = area_profile(self.distance_to_crests(pairs)[0].value)
        strength = self.packed["feature_strength"][pairs.feature]
        total, weights, strengths = (self.summed(pairs, each) for each in (cover**4, cover, cover * strength))
        mean = np.where(weights > 1e-6, strengths / np.maximum(weights, 1e-6), 0)
        return np.minimum(np.sqrt(np.sqrt(total)), 1), mean


def _crest(packed: PackedFeatures, of: Int64Array) -> Float64Array:
    """Return the crest of features: half of it eastward and northward, 1 / its length², its sag; (4, n)."""
    names = ("crest_east", "crest_north", "inverse_crest_square", "crest_sag")
    return np.stack([packed[name][of] for name in names])


class PointPairs(NamedTuple):
    """Pairs of positions and features, by index, in the order of the features."""

    point: LatticeArray
    feature: LatticeArray


def distance_to_crest(
    offset: Float64Array,
    inverse_radius: float | Float64Array,
    bend: tuple[ValueSlope, ValueSlope],
    *,
    crest: Float64Array | tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
) -> tuple[ValueSlope, ValueSlope]:
    """Return the distance (in radii) to a feature's crest at offsets (m), (2, n), and its share of height.

    Slopes are per metre; the share is that of the nearest point of the crest, which sags towards its ends.
    """
    east, north = bend
    dx, dy = offset[0] * inverse_radius + east.value, offset[1] * inverse_radius + north.value
    u = np.clip((dx * crest[0] + dy * crest[1]) * crest[2], -1, 1)
    dx, dy = dx - u * crest[0], dy - u * crest[1]
    t = np.sqrt(dx * dx + dy * dy)

    def per_metre(x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
        return (
            x * (inverse_radius + east.east) + y * north.east,
            x * east.north + y * (inverse_radius + north.north),
        )

    back = 1 / np.maximum(t, 1e-12)
    sag = -4 * crest[3] * u * (1 - u * u) * crest[2]
    crest_share = 1 - crest[3] * u * u * (2 - u * u)
    return ValueSlope(t, *per_metre(dx * back, dy * back)), ValueSlope(
        crest_share, *per_metre(sag * crest[0], sag * crest[1])
    )
