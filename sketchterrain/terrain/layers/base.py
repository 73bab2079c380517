"""The ground between features: fractal noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar

from sketchterrain.caching import LRUCache
from sketchterrain.terrain.layers.layer import (
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
)
from sketchterrain.terrain.noise import NOISE_PEAK, NoiseStack, ValueSlope, fbm, fbm_slope

if TYPE_CHECKING:
    from sketchterrain.terrain.culler import Culled

# The noise seldom leaves ±0.55 of its bound, so this brings the ground to about the requested relief.
_SPAN = 1.8


@dataclass(frozen=True, eq=False)
class BaseLayer(TerrainLayer):
    """The noise under all other layers."""

    name: ClassVar[str] = "base"

    relief: float  # m, range of heights
    wavelength: float  # m
    roughness: float  # amplitude ratio of successive octaves

    @property
    def half_relief(self) -> float:
        """Height (m) of the noise where it is 1."""
        return self.relief / 2 * _SPAN

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return the noise."""
        del world
        return (NoiseStack("ground", self.wavelength, self.roughness),)

    def pack(self, sampling: Sampling, cache: LRUCache) -> Packed:
        """Return the scalars."""
        del cache
        scalars = {"half_relief": self.half_relief} | sampling.ranges("ground")
        return Packed({"base_params": sampling.struct("layers/base.clh", "BaseParams", scalars)})

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add the octaves that are omitted."""
        del culled
        state.bound += self.half_relief * sampling.missing("ground")
        state.low -= self.half_relief * NOISE_PEAK
        state.high += self.half_relief * NOISE_PEAK
        state.scale += self.half_relief

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the noise."""
        noise = fbm(site.sampling.octaves, "ground", site.x, site.y)
        return replace(ground, height=self.half_relief * noise)

    def slopes(self, site: HostSite) -> ValueSlope:
        """Return the noise with its slope per metre."""
        noise = fbm_slope(site.sampling.octaves, "ground", site.x, site.y)
        per_metre = self.half_relief / site.sampling.unit
        return ValueSlope(self.half_relief * noise.value, per_metre * noise.east, per_metre * noise.north)
