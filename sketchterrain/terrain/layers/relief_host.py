"""Mountains, hills and gullies with their slopes on the host, in NumPy float64.

See ``kernels/layers/relief.clh`` and ``erosion.clh``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.io.resources import kernel_constants
from sketchterrain.placement.feature_types import hill_profile, hill_slope, mountain_profile, mountain_slope
from sketchterrain.terrain.layers.layer import scaled_slope
from sketchterrain.terrain.layers.point_site import OutlineNoise, PointSite
from sketchterrain.terrain.layers.points import SLOT_HILL, SLOT_MOUNTAIN
from sketchterrain.terrain.noise import UNSKEW, OctaveTable, ValueSlope, fbm, fbm_slope, gradients, skewed

_TALUS, _WAVES, _PIVOT, _FEED, _CALM, _SHARP, _GENTLE, _ROUGH = kernel_constants(
    "layers/relief.clh", "TALUS", "WAVES", "PIVOT", "FEED", "CALM", "SHARP", "GENTLE", "CRAG_STEEP"
)
_PIVOT *= 2.0**31  # the kernel multiplies gradients of 32-bit integers

(_HILL_SWELL,) = kernel_constants("layers/relief.clh", "HILL_SWELL")


@dataclass(frozen=True)
class ReliefScale:
    """Strengths of the noises that shape relief."""

    ridge_depth: float  # share of its height that a mountain gains or loses, at most
    spur: float  # radii that ridges carry flanks outward, at most
    gully_depth: float  # m, of an octave of gullies, over its amplitude
    crag_depth: float  # m, the same of the roughness of bare rock
    units_per_metre: float  # lattice units


def deepest_gullies(
    scale: ReliefScale, octaves: OctaveTable, erosion: Float64Array, widest: Float64Array
) -> Float64Array:
    """Return the greatest depth (m) of `gullies`, from the greatest erosion and width (n,).

    They raise the terrain by at most 18 % of it.
    """
    steepest = 1 / (1 + _GENTLE / _TALUS) ** 2  # greatest weight of the slope
    depths = (_depth(scale, octaves, i, erosion, widest) for i in range(*octaves.ranges["gully"]))
    return steepest * sum(depths, np.zeros(erosion.shape))


def _depth(
    scale: ReliefScale, octaves: OctaveTable, i: int, erosion: Float64Array, widest: Float64Array
) -> Float64Array:
    """Return the depth (m) of an octave's gullies where the slope has full weight."""
    t = np.clip((widest * (octaves.scale[i, 1] * scale.units_per_metre) - 0.5) * 2, 0, 1)
    return np.asarray(scale.gully_depth * octaves.scale[i, 0] * erosion * t * t * (3 - 2 * t))


def gullies(
    scale: ReliefScale, octaves: OctaveTable, x: LatticeArray, y: LatticeArray, rise: ErodibleHeight
) -> ValueSlope:
    """Return the height added by erosion, with its slope per metre for constant directions of the waves."""
    value, east_sum, north_sum = np.zeros((3, *x.shape))
    leans = [np.broadcast_to(part, x.shape) for part in rise.height[1:]]
    for i in range(*octaves.ranges["gully"]):
        whole = np.broadcast_to(_depth(scale, octaves, i, rise.erosion, rise.widest), x.shape)
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
        per_metre = octaves.scale[i, 1] * scale.units_per_metre
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
    scale: ReliefScale,
    octaves: OctaveTable,
    x: LatticeArray,
    y: LatticeArray,
    east: Float64Array,
    north: Float64Array,
) -> Float64Array:
    """Return the roughness of bare rock on mountains of a slope."""
    square = east * east + north * north
    return np.asarray(scale.crag_depth * square / (square + _ROUGH) * fbm(octaves, "crag", x, y))


@dataclass(frozen=True)
class ReliefNoise:
    """Noise that shapes mountains and hills at points; slopes are per metre."""

    swell: ValueSlope  # factor of the heights of hills
    ridge: ValueSlope  # share of height that narrow mountains gain or lose
    spur: ValueSlope  # outward displacement of the mountains' flanks by ridges, in radii

    @classmethod
    def at(
        cls, scale: ReliefScale, octaves: OctaveTable, outline: OutlineNoise, x: LatticeArray, y: LatticeArray
    ) -> ReliefNoise:
        """Return the noise at lattice positions of shape (n,), where outlines have a warp."""
        noise, per_metre = fbm_slope(octaves, "ridge", x, y), scale.units_per_metre
        ridge = ValueSlope(noise.value, per_metre * noise.east, per_metre * noise.north)
        east = outline.swell
        swell = ValueSlope(1 + _HILL_SWELL * east.value, _HILL_SWELL * east.east, _HILL_SWELL * east.north)
        return cls(swell, scaled_slope(ridge, scale.ridge_depth), scaled_slope(ridge, scale.spur))

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


def mountains(points: PointSite, spur: ValueSlope) -> tuple[ErodibleHeight, ValueSlope]:
    """Join the mountains as (Σ h⁴)^¼; return also the weight of noise."""
    pairs = points.pairs_within_support(SLOT_MOUNTAIN)
    strength, peakiness, flank, erosion, widest, noise = (
        points.packed[name][pairs.feature]
        for name in (
            "feature_strength",
            "feature_peakiness",
            "feature_flank",
            "feature_erosion",
            "widest_gully",
            "noise_weight",
        )
    )
    away, crest_share = points.distance_to_crests(pairs)
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


def hills(points: PointSite) -> ErodibleHeight:
    """Join the hills as (Σ h²)^½."""
    pairs = points.pairs_within_support(SLOT_HILL)
    strength, flank, erosion, widest = (
        points.packed[name][pairs.feature]
        for name in ("feature_strength", "feature_flank", "feature_erosion", "widest_gully")
    )
    t, _ = points.distance_to_crests(pairs)
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
