"""Mountains and hills as noise shapes them and erosion cuts them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from functools import cache
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.caching import LRUCache
from sketchterrain.io.resources import kernel_constants
from sketchterrain.placement.feature_types import flank, hill_profile, mountain_profile
from sketchterrain.terrain.layers.layer import (
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    smooth_rise,
)
from sketchterrain.terrain.layers.points import (
    NearPoints,
    PointsLayer,
    outline_warp,
    ridge_wavelength,
    spur_length,
)
from sketchterrain.terrain.layers.relief_host import (
    ErodibleHeight,
    ReliefNoise,
    ReliefScale,
    crags,
    gullies,
    hills,
    mountains,
    stack_heights,
)
from sketchterrain.terrain.noise import NOISE_PEAK, NoiseStack, ValueSlope, omitted_amplitudes

if TYPE_CHECKING:
    from sketchterrain.terrain.culler import Culled

_HEADER: Final = "layers/relief.clh"
_HILL_SWELL, _ROCK_HEIGHT, _INVERSE_ROCK_RANGE = kernel_constants(
    _HEADER, "HILL_SWELL", "ROCK_HEIGHT", "INVERSE_ROCK_RANGE"
)
# How far gullies and the roughness of bare rock go up and down, in wavelengths of their own.
_GULLY_DEPTH = 0.165
_CRAG_DEPTH = 0.05
_GULLY_PEAK = 1.25  # bound of an octave of gullies, over its depth
_GULLY_SLOPE = 13.0  # bound of its slope, over its depth and times its wavelength
_ROCK_OVER_SLOPE = 0.78  # greatest derivative of slope^2 / (slope^2 + 0.7), the roughness of rock
_TURNS = np.linspace(0.0, 1.0, 2049)

_ZERO = np.zeros(1)
_LEVEL = ErodibleHeight(ValueSlope(_ZERO, _ZERO, _ZERO), _ZERO, _ZERO)


@dataclass(frozen=True)
class _Omitted:
    """Detail that one cell size omits anywhere; m unless noted."""

    hills: float  # of hills that are too small
    mountains: float
    crags: float  # of the roughness of bare rock
    crags_left: float  # resolved part of that roughness
    moved: bool  # hills or mountains themselves differ
    warp: float  # of multiplied noises, dimensionless
    ridge: float
    gullies: Float64Array  # (octaves,) at full erosion
    wavelengths: Float64Array  # (octaves,) of the gullies


@dataclass(frozen=True, eq=False)
class ReliefLayer(TerrainLayer):
    """Mountains and hills among point features."""

    name: ClassVar[str] = "relief"

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return the noises of ridges, gullies and bare rock."""
        return (
            NoiseStack("ridge", ridge_wavelength(world.extent), 0.42, most=2),
            NoiseStack("gully", world.extent / 8, 0.45, most=9),
            NoiseStack("crag", world.extent / 512, 0.5),
        )

    def scale(self, world: WorldSettings) -> ReliefScale:
        """Return the strengths of the noises."""
        stacks = {stack.name: stack for stack in self.stacks(world)}
        return ReliefScale(
            ridge_depth=0.9 - 1.7 * max(world.fidelity - 0.8, 0.0),
            spur=spur_length(world.fidelity),
            gully_depth=_depth_scale(stacks["gully"], world.unit, _GULLY_DEPTH),
            crag_depth=_depth_scale(stacks["crag"], world.unit, _CRAG_DEPTH),
            units_per_metre=1 / world.unit,
        )

    def pack(self, sampling: Sampling, cache: LRUCache) -> Packed:
        """Return the scalars."""
        del cache
        scalars = asdict(self.scale(sampling.world)) | sampling.ranges("ridge", "gully", "crag")
        del scalars["units_per_metre"]
        return Packed({"relief_params": sampling.struct(_HEADER, "ReliefParams", scalars)})

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with hills and mountains upon it."""
        scale, octaves = self.scale(site.sampling.world), site.sampling.octaves
        eroded, mountain = self.eroded(site)
        rough = mountain * crags(scale, octaves, site.x, site.y, *eroded[1:])
        return replace(ground, height=ground.height + eroded.value + rough, mountain=mountain)

    def eroded(self, site: HostSite) -> tuple[ValueSlope, Float64Array]:
        """Return hills and mountains with their gullies, without crags, and the mask of mountains."""
        scale, octaves, points = self.scale(site.sampling.world), site.sampling.octaves, site.points
        noise = ReliefNoise.at(scale, octaves, points.noise, site.x, site.y)
        massif, weight = mountains(points, noise.spur)
        rise = stack_heights(
            stack_heights(_LEVEL, hills(points), noise.swell), massif, noise.mountain_factor(weight)
        )
        cut = gullies(scale, octaves, site.x, site.y, rise)
        height = ValueSlope(*(a + b for a, b in zip(rise.height, cut, strict=True)))
        return height, smooth_rise(massif.height.value, _ROCK_HEIGHT, 1 / _INVERSE_ROCK_RANGE)

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add features that are too small, and what omitted octaves move, swell and cut."""
        del culled
        near: NearPoints = state.near
        omitted = state.cache.get_or_compute(
            (self.name, sampling.cell), lambda: self._omitted(near.layer, sampling)
        )
        scale, warp = self.scale(sampling.world), outline_warp(sampling.world.fidelity)
        hill_slope, mountain_slope = _steepest_slopes(flank(sampling.world.fidelity))
        moved = near.hill_sum * hill_slope * np.sqrt(2) * warp * omitted.warp
        hills = (1 + _HILL_SWELL) * (moved + omitted.hills) + _HILL_SWELL * near.hill * omitted.warp
        depth = scale.ridge_depth
        bent = np.sqrt(2) * warp * omitted.warp * (1 + 2 * scale.spur * NOISE_PEAK)
        moved = near.mountain_sum * mountain_slope * (bent + scale.spur * omitted.ridge)
        mountains = (1 + depth * NOISE_PEAK) * (
            moved + omitted.mountains
        ) + depth * near.mountain * omitted.ridge
        # Octaves of gullies that features of such widths have, shape (n, octaves).
        across = np.clip((near.widest[:, None] / omitted.wavelengths - 0.5) * 2, 0, 1)
        resolved = across * across * (3 - 2 * across)
        cut = near.erosion * (resolved @ omitted.gullies)
        # The roughness that rock omits, and how far omitted gullies' slopes change the rest of it.
        slopes = _GULLY_SLOPE * near.erosion * (resolved @ (omitted.gullies / omitted.wavelengths))
        steeper = np.ones(len(slopes)) if omitted.moved else np.minimum(_ROCK_OVER_SLOPE * slopes, 1.0)
        rocky = smooth_rise(near.mountain, _ROCK_HEIGHT, 1 / _INVERSE_ROCK_RANGE)
        crags = rocky * (omitted.crags + steeper * omitted.crags_left)
        state.bound += hills + mountains + cut + crags
        state.low -= near.erosion * scale.gully_depth * _GULLY_PEAK
        state.high += (1 + _HILL_SWELL) * near.hill + (1 + depth * NOISE_PEAK) * near.mountain
        state.scale += near.hill + near.mountain

    def _omitted(self, points: PointsLayer, sampling: Sampling) -> _Omitted:
        full, resolved, cell = sampling.all_octaves, sampling.octaves, sampling.cell
        warp = max(sampling.missing("warp_u"), sampling.missing("warp_v"))
        ridge, scale = sampling.missing("ridge"), self.scale(sampling.world)
        hills, mountains = points.lost_height("hill", cell, 0.5), points.lost_height("mountain", cell, 0.25)
        # An octave of gullies follows the slopes that coarser ones left: from the first that differs, or from
        # the very first where the relief below differs, each counts once in full and once as resolved.
        amplitude, left = omitted_amplitudes(full, resolved, "gully")
        differs = amplitude > left
        moved = warp + ridge + hills + mountains > 0
        turned = (np.cumsum(differs) - differs > 0) | moved
        start, end = full.ranges["gully"]
        crag, crag_left = omitted_amplitudes(full, resolved, "crag")
        return _Omitted(
            hills=hills,
            mountains=mountains,
            crags=scale.crag_depth * float(np.sum(crag - crag_left)) * NOISE_PEAK,
            crags_left=scale.crag_depth * NOISE_PEAK * float(np.sum(crag_left)),
            moved=moved,
            warp=warp,
            ridge=ridge,
            gullies=scale.gully_depth * _GULLY_PEAK * np.where(turned, amplitude + left, amplitude - left),
            wavelengths=sampling.unit / full.scale[start:end, 1],
        )


def _depth_scale(noise: NoiseStack, unit: float, depth: float) -> float:
    """Return metres per amplitude of a stack whose octaves are each ``depth`` of their wavelength deep."""
    longest = 2.0 ** round(np.log2(noise.wavelength / unit)) * unit
    return float(depth * longest / (1 - noise.gain))


@cache
def _steepest_slopes(steepness: float) -> tuple[float, float]:
    """Return the steepest slopes of the profiles of hills and of mountains, over a radius."""
    hill = _steepest(hill_profile(_TURNS, steepness))
    return hill, max(_steepest(mountain_profile(_TURNS, peak, steepness)) for peak in (0.0, 1.0))


def _steepest(profile: Float64Array) -> float:
    return float(np.abs(np.diff(profile)).max() * (len(_TURNS) - 1))
