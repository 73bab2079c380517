"""Relief of features and erosion on the host in float64."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.placement.feature_types import hill_profile, hill_slope, mountain_profile, mountain_slope
from sketchterrain.terrain.noise import UNSKEW, Slope, fbm, fbm_slope, gradients, skewed

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array, LatticeArray
    from sketchterrain.terrain.noise import OctaveTable
    from sketchterrain.terrain.packing import PackedFeatures


_TALUS = 2.1445069205095586
_WAVES, _PIVOT, _FEED, _CALM, _SHARP, _GENTLE, _ROUGH = 1.4, 2.2e-10 * 2.0**31, 0.55, 0.3, 0.35, 0.5, 0.7


def deepest_gullies(
    w: np.void, octaves: OctaveTable, erosion: Float64Array, widest: Float64Array
) -> Float64Array:
    """Return by how much (m) `gullies` lowers ground, at most, and raises it but for 18 %.

    Parameters
    ----------
    w, octaves
    erosion, widest : (n,) float64
        At most.
    """
    steepest = 1 / (1 + _GENTLE / _TALUS) ** 2  # the most that the slope's say can be
    depths = (_depth(w, octaves, i, erosion, widest) for i in range(*octaves.ranges["gully"]))
    return steepest * sum(depths, np.zeros(erosion.shape))


def _depth(
    w: np.void, octaves: OctaveTable, i: int, erosion: Float64Array, widest: Float64Array
) -> Float64Array:
    """Depth (m) of an octave's gullies where the slope has its full say."""
    t = np.clip((widest * (octaves.scale[i, 1] * w["units_per_metre"]) - 0.5) * 2, 0, 1)
    return np.asarray(w["gully_depth"] * octaves.scale[i, 0] * erosion * t * t * (3 - 2 * t))


def gullies(w: np.void, octaves: OctaveTable, x: LatticeArray, y: LatticeArray, rise: Rise) -> Slope:
    """Return what erosion adds to the height, with its slope per metre, the waves' directions held."""
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
    return Slope(value, east_sum, north_sum)


def _waves(
    octaves: OctaveTable, i: int, x: LatticeArray, y: LatticeArray, east: Float64Array, north: Float64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Sum an octave's waves (turns a cell eastward and northward) over the corners around each place."""
    cell_u, cell_v, fu, fv = skewed(octaves, i, x, y)
    if octaves.form[i, 2]:
        east, north = north, -east
    lower = fu > fv
    sums = np.zeros((3, *x.shape))
    for iu, iv in ((0, 0), (lower.astype(np.int64), (~lower).astype(np.int64)), (1, 1)):
        du, dv = fu - iu, fv - iv
        d = np.stack([du, dv]) - (du + dv) * UNSKEW
        g = gradients(cell_u + iu, cell_v + iv, seed=int(octaves.form[i, 1]))
        say = np.maximum(0.5 - (d * d).sum(axis=0), 0) ** 2
        angle = 2 * np.pi * (east * (d[0] - _PIVOT * g[0]) + north * (d[1] - _PIVOT * g[1]))
        sums += say * np.stack([np.cos(angle), np.sin(angle), np.ones(x.shape)])
    return sums[0], sums[1], sums[2]


def crags(
    w: np.void,
    octaves: OctaveTable,
    x: LatticeArray,
    y: LatticeArray,
    east: Float64Array,
    north: Float64Array,
) -> Float64Array:
    """Return what the roughness of bare rock adds to mountains of a slope."""
    square = east * east + north * north
    return np.asarray(w["crag_depth"] * square / (square + _ROUGH) * fbm(octaves, "crag", x, y))


_MOUNTAIN, _HILL = 0, 1
_HILL_SWELL = 0.4


@dataclass(frozen=True)
class Relief:
    """What noise makes of mountains and hills at points; slopes are per metre.

    Attributes
    ----------
    bend : (Slope, Slope)
        How far outlines are bent eastward and northward, in radii.
    swell : Slope
        What the heights of hills are multiplied by.
    ridge : Slope
        By what share narrow mountains gain or lose height.
    spur : Slope
        How far ridges carry the mountains' flanks outward, in radii.
    """

    bend: tuple[Slope, Slope]
    swell: Slope
    ridge: Slope
    spur: Slope

    def share(self, say: Slope) -> Slope:
        """Return what the heights of mountains are multiplied by, where noise has some say."""
        return Slope(
            1 + say.value * self.ridge.value,
            say.value * self.ridge.east + say.east * self.ridge.value,
            say.value * self.ridge.north + say.north * self.ridge.value,
        )


@dataclass(frozen=True)
class Rise:
    """Heights (m) with their slopes, and what erosion does to them: its strength and its widest gully (m)."""

    height: Slope
    erosion: Float64Array
    widest: Float64Array


@dataclass(frozen=True)
class Site:
    """LatticeArray positions, and what noise makes of features there."""

    x: LatticeArray
    y: LatticeArray
    unit: float
    bend: tuple[Slope, Slope]

    @cached_property
    def _metres(self) -> Float64Array:
        """Positions from the first one (m), (n, 2)."""
        return np.stack([self.x - self.x[:1], self.y - self.y[:1]], axis=-1) * self.unit

    @cached_property
    def _tree(self) -> cKDTree:
        return cKDTree(self._metres)

    def reached(self, packed: PackedFeatures, slot: int) -> Reached:
        """Pair these positions with the features of a slot that may reach them."""
        chosen = np.flatnonzero(packed.slot == slot)
        if not (chosen.size and self.x.size):
            return Reached(np.zeros(0, np.int64), np.zeros(0, np.int64))
        centre = (packed.at[chosen] - [self.x[0], self.y[0]]) * self.unit
        wide = packed.support[chosen] * (1 + 1e-9) + 1e-6
        found = self._tree.query_ball_point(centre, wide)
        count = [len(each) for each in found]
        place = np.fromiter(chain.from_iterable(found), dtype=np.int64, count=sum(count))
        return Reached(place, np.repeat(chosen, count))

    def approach(self, packed: PackedFeatures, pairs: Reached) -> tuple[Slope, Slope]:
        """See features from these positions, as `approached` does."""
        place, of = pairs.place, pairs.of
        offset = np.stack([self.x[place] - packed.at[of, 0], self.y[place] - packed.at[of, 1]]) * self.unit
        east, north = (Slope(*(part[place] for part in bend)) for bend in self.bend)
        return approached(offset, packed.shape[of, 0], (east, north), crest=packed.shape[of, 8:].T)

    def summed(self, pairs: Reached, values: Float64Array) -> Float64Array:
        """Sum values of pairs at each position, in the order of the features."""
        return np.asarray(np.bincount(pairs.place, values, minlength=len(self.x)), dtype=np.float64)


class Reached(NamedTuple):
    """Pairs of positions and features, by index, in the order of the features."""

    place: npt.NDArray[np.int64]
    of: npt.NDArray[np.int64]


def approached(
    offset: Float64Array,
    inverse_radius: float | Float64Array,
    bend: tuple[Slope, Slope],
    *,
    crest: Float64Array | tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
) -> tuple[Slope, Slope]:
    """See a feature from places at offsets (m), shape (2, n), from its centre.

    Returns
    -------
    away : Slope
        Distance from its crest, in radii; slopes are per metre.
    keep : Slope
        Share of its height that the crest has at the nearest place.
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
    keep = 1 - crest[3] * u * u * (2 - u * u)
    return Slope(t, *per_metre(dx * back, dy * back)), Slope(keep, *per_metre(sag * crest[0], sag * crest[1]))


def carried(t: Slope, spur: Slope, share: float | Float64Array) -> Slope:
    """Distance that a share of the spurs shortens: t - spur t(2 - t) up to one radius, t - spur beyond."""
    rest = np.maximum(1 - t.value, 0)
    far = share * (1 - rest * rest)
    gain = 1 - 2 * share * spur.value * rest
    return Slope(
        np.maximum(t.value - spur.value * far, 0),
        t.east * gain - spur.east * far,
        t.north * gain - spur.north * far,
    )


def relief_noise_at(w: np.void, octaves: OctaveTable, x: LatticeArray, y: LatticeArray) -> Relief:
    """Return what noise makes of mountains and hills at lattice positions of shape (n,)."""
    per_metre = float(w["units_per_metre"])
    east, north = (_warp(octaves, name, x, y, per_metre) for name in ("warp_u", "warp_v"))
    noise = fbm_slope(octaves, "ridge", x, y)
    ridge = Slope(noise.value, per_metre * noise.east, per_metre * noise.north)
    warp, depth = float(w["warp"]), float(w["ridge_depth"])
    return Relief(
        bend=(_times(east, warp), _times(north, warp)),
        swell=_over_one(_times(east, _HILL_SWELL)),
        ridge=_times(ridge, depth),
        spur=_times(ridge, float(w["spur"])),
    )


def _warp(octaves: OctaveTable, name: str, x: LatticeArray, y: LatticeArray, per_metre: float) -> Slope:
    noise = fbm_slope(octaves, name, x, y)
    keep = np.where(np.abs(noise.value) < 1, per_metre, 0)
    return Slope(np.clip(noise.value, -1, 1), noise.east * keep, noise.north * keep)


def _times(slope: Slope, by: float) -> Slope:
    return Slope(*(part * by for part in slope))


def _over_one(slope: Slope) -> Slope:
    return Slope(1 + slope.value, *slope[1:])


def mountains(packed: PackedFeatures, site: Site, spur: Slope) -> tuple[Rise, Slope]:
    """Join the mountains as (Σ h⁴)^¼, and tell how much noise has a say in them."""
    pairs = site.reached(packed, _MOUNTAIN)
    shape = packed.shape[pairs.of].T
    strength, peakiness, flank = shape[1:4]
    away, keep = site.approach(packed, pairs)
    t = carried(away, Slope(*(part[pairs.place] for part in spur)), shape[6])
    profile = strength * mountain_profile(t.value, peakiness, flank)
    h = keep.value * profile
    lean = keep.value * strength * mountain_slope(t.value, peakiness, flank)
    leans = h**3 * np.stack([lean * t.east + profile * keep.east, lean * t.north + profile * keep.north])
    parts = np.concatenate([h[None] ** 4, leans])
    parts = np.concatenate([parts, parts[:1] * shape[4:6], parts * shape[6]])
    return joined_mountains(np.stack([site.summed(pairs, part) for part in parts]))


def joined_mountains(sums: Float64Array) -> tuple[Rise, Slope]:
    """Return the rise, and the say of noise, from sums over mountains.

    Parameters
    ----------
    sums : (8, n) float64
        Of h⁴, of h³ times the slope of h (2), of h⁴ times erosion and times the widest gully, and of the
        first three times the say of noise.
    """
    total = np.maximum(sums[0], 1e-36)
    say = sums[5] / total
    rise = Rise(Slope(*(sums[:3] * total**-0.75)), *(sums[3:5] / total))
    return rise, Slope(say, *(4 * (sums[6:] - say * sums[1:3]) / total))


def hills(packed: PackedFeatures, site: Site) -> Rise:
    """Join the hills as (Σ h²)^½."""
    pairs = site.reached(packed, _HILL)
    shape = packed.shape[pairs.of].T
    strength, flank = shape[1], shape[3]
    t, _ = site.approach(packed, pairs)
    h = strength * hill_profile(t.value, flank)
    lean = h * strength * hill_slope(t.value, flank)
    parts = (h**2, lean * t.east, lean * t.north, h**2 * shape[4], h**2 * shape[5])
    sums = np.stack([site.summed(pairs, part) for part in parts])
    total = np.maximum(sums[0], 1e-18)
    return Rise(Slope(*(sums[:3] * total**-0.5)), *(sums[3:] / total))


def risen(a: Rise, b: Rise, share: Slope) -> Rise:
    """One rise upon another, whose heights are multiplied by a share."""
    height = Slope(
        a.height.value + b.height.value * share.value,
        a.height.east + b.height.east * share.value + b.height.value * share.east,
        a.height.north + b.height.north * share.value + b.height.value * share.north,
    )
    say, other = np.maximum(a.height.value, 0), np.maximum(b.height.value, 0)
    part = other / np.maximum(say + other, 1e-9)
    return Rise(height, a.erosion + (b.erosion - a.erosion) * part, a.widest + (b.widest - a.widest) * part)
