"""Mountains, hills and gullies with their slopes on the host, in NumPy float64.

See ``kernels/features.clh``, ``relief.clh`` and ``erosion.clh``.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.array_types import Float64Array, Int64Array, LatticeArray
from sketchterrain.io.resources import kernel_constants
from sketchterrain.placement.feature_types import hill_profile, hill_slope, mountain_profile, mountain_slope
from sketchterrain.terrain.noise import UNSKEW, OctaveTable, ValueSlope, fbm, fbm_slope, gradients, skewed
from sketchterrain.terrain.packing import SLOT_HILL, SLOT_MOUNTAIN, PackedFeatures

_TALUS, _WAVES, _PIVOT, _FEED, _CALM, _SHARP, _GENTLE, _ROUGH = kernel_constants(
    "relief.clh", "TALUS", "WAVES", "PIVOT", "FEED", "CALM", "SHARP", "GENTLE", "CRAG_STEEP"
)
_PIVOT *= 2.0**31  # the kernel multiplies gradients of 32-bit integers

(_HILL_SWELL,) = kernel_constants("relief.clh", "HILL_SWELL")


def deepest_gullies(
    w: np.void, octaves: OctaveTable, erosion: Float64Array, widest: Float64Array
) -> Float64Array:
    """Return the greatest depth (m) of `gullies`, from the greatest erosion and width (n,).

    They raise the terrain by at most 18 % of it.
    """
    steepest = 1 / (1 + _GENTLE / _TALUS) ** 2  # greatest weight of the slope
    depths = (_depth(w, octaves, i, erosion, widest) for i in range(*octaves.ranges["gully"]))
    return steepest * sum(depths, np.zeros(erosion.shape))


def _depth(
    w: np.void, octaves: OctaveTable, i: int, erosion: Float64Array, widest: Float64Array
) -> Float64Array:
    """Return the depth (m) of an octave's gullies where the slope has full weight."""
    t = np.clip((widest * (octaves.scale[i, 1] * w["units_per_metre"]) - 0.5) * 2, 0, 1)
    return np.asarray(w["gully_depth"] * octaves.scale[i, 0] * erosion * t * t * (3 - 2 * t))


def gullies(
    w: np.void, octaves: OctaveTable, x: LatticeArray, y: LatticeArray, rise: ErodibleHeight
) -> ValueSlope:
    """Return the height added by erosion, with its slope per metre for constant directions of the waves."""
    value, east_sum, north_sum = np.zeros((3, *x.shape))
    leans = [np.broadcast_to(part, x.shape) for part in rise.height[1:]]
    for i in range(*octaves.ranges["gully"]):
        whole = np.broadcast_to(_depth(w, octaves, i, rise.erosion, rise.widest), x.shape)
        here = whole > 0  # elsewhere nothing is added
        if not here.any():
            continue
        east = leans[0][here] + _FEED * east_sum[here]
        north = leans[1][here] + _FEED * north_sum[here]
        square = east * east + north * north
        across = _WAVES / np.sqrt(np.maximum(square, 1e-12))
        cosine, sine, weight = _waves(octaves, i, x[here], y[here], -north * across, east * across)
        even = 1 / np.sqrt(cosine**2 + sine**2 + _CALM * weight**2)
        v = cosine * even
        per_metre = octaves.scale[i, 1] * w["units_per_metre"]
        depth = whole[here] * square / ((square + _GENTLE**2) * (1 + square / _TALUS**2))
        value[here] += depth * (v + _SHARP * (v * v - 0.5))
        lean = depth * (1 + 2 * _SHARP * v) * -sine * even * 2 * np.pi * per_metre * across
        east_sum[here] -= lean * north
        north_sum[here] += lean * east
    return ValueSlope(value, east_sum, north_sum)


def _waves(
    octaves: OctaveTable, i: int, x: LatticeArray, y: LatticeArray, east: Float64Array, north: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Sum an octave's waves (turns per cell eastward and northward) over the corners around each point."""
    cell_u, cell_v, fu, fv = skewed(octaves, i, x, y)
    if octaves.form[i, 2]:
        east, north = north, -east
    lower = fu > fv
    sums = np.zeros((3, *x.shape))
    for iu, iv in ((0, 0), (lower.astype(np.int64), (~lower).astype(np.int64)), (1, 1)):
        du, dv = fu - iu, fv - iv
        d = np.stack([du, dv]) - (du + dv) * UNSKEW
        g = gradients(cell_u + iu, cell_v + iv, seed=int(octaves.form[i, 1]))
        weight = np.maximum(0.5 - (d * d).sum(axis=0), 0) ** 2
        angle = 2 * np.pi * (east * (d[0] - _PIVOT * g[0]) + north * (d[1] - _PIVOT * g[1]))
        sums += weight * np.stack([np.cos(angle), np.sin(angle), np.ones(x.shape)])
    return sums[0], sums[1], sums[2]


def crags(
    w: np.void,
    octaves: OctaveTable,
    x: LatticeArray,
    y: LatticeArray,
    east: Float64Array,
    north: Float64Array,
) -> Float64Array:
    """Return the roughness of bare rock on mountains of a slope."""
    square = east * east + north * north
    return np.asarray(w["crag_depth"] * square / (square + _ROUGH) * fbm(octaves, "crag", x, y))


@dataclass(frozen=True)
class ReliefNoise:
    """Noise that shapes mountains and hills at points; slopes are per metre."""

    bend: tuple[ValueSlope, ValueSlope]  # displacement of outlines eastward and northward, in radii
    swell: ValueSlope  # factor of the heights of hills
    ridge: ValueSlope  # share of height that narrow mountains gain or lose
    spur: ValueSlope  # outward displacement of the mountains' flanks by ridges, in radii

    def mountain_factor(self, weight: ValueSlope) -> ValueSlope:
        """Return the factor of the heights of mountains, for a weight of the noise."""
        return ValueSlope(
            1 + weight.value * self.ridge.value,
            weight.value * self.ridge.east + weight.east * self.ridge.value,
            weight.value * self.ridge.north + weight.north * self.ridge.value,
        )


@dataclass(frozen=True)
class ErodibleHeight:
    """Heights (m) with their slopes, and their erosion: strength and widest gully (m)."""

    height: ValueSlope
    erosion: Float64Array
    widest: Float64Array


@dataclass(frozen=True)
class SamplePoints:
    """Lattice positions, and the warp there."""

    x: LatticeArray
    y: LatticeArray
    unit: float
    bend: tuple[ValueSlope, ValueSlope]

    @cached_property
    def _metres(self) -> Float64Array:
        """Positions from the first one (m), (n, 2)."""
        return np.stack([self.x - self.x[:1], self.y - self.y[:1]], axis=-1) * self.unit

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._metres)

    def pairs_within_support(self, packed: PackedFeatures, slot: int) -> PointPairs:
        """Pair these positions with the features of a slot whose support contains them."""
        selected = np.flatnonzero(packed.slot == slot)
        if not (selected.size and self.x.size):
            return PointPairs(np.zeros(0, np.int64), np.zeros(0, np.int64))
        centre = (packed.at[selected] - [self.x[0], self.y[0]]) * self.unit
        wide = packed.support[selected] * (1 + 1e-9) + 1e-6
        found = self._tree.query_ball_point(centre, wide)
        count = [len(each) for each in found]
        point = np.fromiter(chain.from_iterable(found), dtype=np.int64, count=sum(count))
        return PointPairs(point, np.repeat(selected, count))

    def distance_to_crests(self, packed: PackedFeatures, pairs: PointPairs) -> tuple[ValueSlope, ValueSlope]:
        """Return the distances to features, as `distance_to_crest` does."""
        point, feature = pairs.point, pairs.feature
        offset = (
            np.stack([self.x[point] - packed.at[feature, 0], self.y[point] - packed.at[feature, 1]])
            * self.unit
        )
        east, north = (ValueSlope(*(part[point] for part in bend)) for bend in self.bend)
        return distance_to_crest(
            offset, packed["inverse_radius"][feature], (east, north), crest=_crest(packed, feature)
        )

    def summed(self, pairs: PointPairs, values: Float64Array) -> Float64Array:
        """Sum values of pairs at each position, in the order of the features."""
        return np.asarray(np.bincount(pairs.point, values, minlength=len(self.x)), dtype=np.float64)


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


def extend_by_spurs(t: ValueSlope, spur: ValueSlope, share: float | Float64Array) -> ValueSlope:
    """Return distances shortened by a share of the spurs.

    t - spur t(2 - t) up to one radius, t - spur beyond.
    """
    rest = np.maximum(1 - t.value, 0)
    far = share * (1 - rest * rest)
    gain = 1 - 2 * share * spur.value * rest
    return ValueSlope(
        np.maximum(t.value - spur.value * far, 0),
        t.east * gain - spur.east * far,
        t.north * gain - spur.north * far,
    )


def relief_noise_at(w: np.void, octaves: OctaveTable, x: LatticeArray, y: LatticeArray) -> ReliefNoise:
    """Return the noise that shapes mountains and hills at lattice positions of shape (n,)."""
    per_metre = float(w["units_per_metre"])
    east, north = (_warp(octaves, name, x, y, per_metre) for name in ("warp_u", "warp_v"))
    noise = fbm_slope(octaves, "ridge", x, y)
    ridge = ValueSlope(noise.value, per_metre * noise.east, per_metre * noise.north)
    warp, depth = float(w["warp"]), float(w["ridge_depth"])
    return ReliefNoise(
        bend=(_times(east, warp), _times(north, warp)),
        swell=ValueSlope(1 + _HILL_SWELL * east.value, _HILL_SWELL * east.east, _HILL_SWELL * east.north),
        ridge=_times(ridge, depth),
        spur=_times(ridge, float(w["spur"])),
    )


def _warp(octaves: OctaveTable, name: str, x: LatticeArray, y: LatticeArray, per_metre: float) -> ValueSlope:
    noise = fbm_slope(octaves, name, x, y)
    inside = np.where(np.abs(noise.value) < 1, per_metre, 0)
    return ValueSlope(np.clip(noise.value, -1, 1), noise.east * inside, noise.north * inside)


def _times(slope: ValueSlope, by: float) -> ValueSlope:
    return ValueSlope(*(part * by for part in slope))


def mountains(
    packed: PackedFeatures, points: SamplePoints, spur: ValueSlope
) -> tuple[ErodibleHeight, ValueSlope]:
    """Join the mountains as (Σ h⁴)^¼; return also the weight of noise."""
    pairs = points.pairs_within_support(packed, SLOT_MOUNTAIN)
    strength, peakiness, flank, erosion, widest, noise = (
        packed[name][pairs.feature]
        for name in (
            "feature_strength",
            "feature_peakiness",
            "feature_flank",
            "feature_erosion",
            "widest_gully",
            "noise_weight",
        )
    )
    away, crest_share = points.distance_to_crests(packed, pairs)
    t = extend_by_spurs(away, ValueSlope(*(part[pairs.point] for part in spur)), noise)
    profile = strength * mountain_profile(t.value, peakiness, flank)
    h = crest_share.value * profile
    lean = crest_share.value * strength * mountain_slope(t.value, peakiness, flank)
    leans = h**3 * np.stack(
        [lean * t.east + profile * crest_share.east, lean * t.north + profile * crest_share.north]
    )
    parts = np.concatenate([h[None] ** 4, leans])
    parts = np.concatenate([parts, parts[:1] * np.stack([erosion, widest]), parts * noise])
    return join_mountains(np.stack([points.summed(pairs, part) for part in parts]))


def join_mountains(sums: Float64Array) -> tuple[ErodibleHeight, ValueSlope]:
    """Return the joined height and the weight of noise from sums (8, n) over mountains.

    The sums are of h⁴, of h³ times the slope of h (2), of h⁴ times erosion and times the widest gully, and of
    the first three times the weight of noise.
    """
    total = np.maximum(sums[0], 1e-36)
    weight = sums[5] / total
    rise = ErodibleHeight(ValueSlope(*(sums[:3] * total**-0.75)), *(sums[3:5] / total))
    return rise, ValueSlope(weight, *(4 * (sums[6:] - weight * sums[1:3]) / total))


def hills(packed: PackedFeatures, points: SamplePoints) -> ErodibleHeight:
    """Join the hills as (Σ h²)^½."""
    pairs = points.pairs_within_support(packed, SLOT_HILL)
    strength, flank, erosion, widest = (
        packed[name][pairs.feature]
        for name in ("feature_strength", "feature_flank", "feature_erosion", "widest_gully")
    )
    t, _ = points.distance_to_crests(packed, pairs)
    h = strength * hill_profile(t.value, flank)
    lean = h * strength * hill_slope(t.value, flank)
    parts = (h**2, lean * t.east, lean * t.north, h**2 * erosion, h**2 * widest)
    sums = np.stack([points.summed(pairs, part) for part in parts])
    total = np.maximum(sums[0], 1e-18)
    return ErodibleHeight(ValueSlope(*(sums[:3] * total**-0.5)), *(sums[3:] / total))


def stack_heights(a: ErodibleHeight, b: ErodibleHeight, share: ValueSlope) -> ErodibleHeight:
    """Return one height upon another, which is multiplied by a share."""
    height = ValueSlope(
        a.height.value + b.height.value * share.value,
        a.height.east + b.height.east * share.value + b.height.value * share.east,
        a.height.north + b.height.north * share.value + b.height.value * share.north,
    )
    below, above = np.maximum(a.height.value, 0), np.maximum(b.height.value, 0)
    part = above / np.maximum(below + above, 1e-9)
    return ErodibleHeight(
        height, a.erosion + (b.erosion - a.erosion) * part, a.widest + (b.widest - a.widest) * part
    )
