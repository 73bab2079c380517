"""Dune fields: asymmetric waves in areas that point features mark."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import ClassVar, Final

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray, StructuredArray
from sketchterrain.geometry.box_index import content_items
from sketchterrain.io.resources import kernel_constants
from sketchterrain.terrain.layers.layer import (
    ITEMS,
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    smooth_rise,
)
from sketchterrain.terrain.layers.points import SLOT_DUNE, outline_warp
from sketchterrain.terrain.noise import NoiseStack, band_weight, fbm

_HEADER: Final = "layers/dunes.clh"
_CREST_SHIFT, _LEVEL, _VIGOUR_MIN, _VIGOUR_RANGE, _VIGOUR_START, _WINDWARD, _LEE = kernel_constants(
    _HEADER, "CREST_SHIFT", "DUNE_LEVEL", "VIGOUR_MIN", "VIGOUR_RANGE", "VIGOUR_START", "WINDWARD", "LEE"
)
(_FRACTION_BITS,) = (int(bits) for bits in kernel_constants("world.clh", "FRACTION_BITS"))
_DIRECTION_BITS = 11
_CREST_SHARE = 1 / 8  # of the extent: wavelength of the crests
_MAX_CREST = 1260.0  # m
_EDGE_SLOPE = 3.0  # of an area's profile, over a radius
_SLOPE, _VIGOUR_SLOPE = 9.1, 1.05


@dataclass(frozen=True, eq=False)
class DunesLayer(TerrainLayer):
    """Dunes of some styles, where the points' layer has features of them."""

    name: ClassVar[str] = "dunes"

    styles: tuple[tuple[float, float], ...] = field(metadata=ITEMS)  # (wavelength in m, wind in degrees)

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return the noise of the crests."""
        return (NoiseStack("crest", min(world.extent * _CREST_SHARE, _MAX_CREST), 0.42, most=4),)

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return the styles."""
        del world
        nowhere = np.zeros((len(self.styles), 2), np.int64)
        return content_items([np.array(style).tobytes() for style in self.styles], nowhere, nowhere)

    def boxes(self, rows: StructuredArray, world: WorldSettings) -> LatticeArray:
        """Return none: features of a style are items of the points' layer."""
        del rows, world
        return np.zeros((0, 4), np.int64)

    def pack(self, sampling: Sampling) -> Packed:
        """Return the scalars and the styles."""
        scalars = {"styles": len(self.styles)} | sampling.ranges("crest")
        params = sampling.struct(_HEADER, "DuneParams", scalars)
        return Packed({"dune_params": params, "dune_styles": self._pack_styles(sampling)})

    def _pack_styles(self, sampling: Sampling) -> StructuredArray:
        empty = dict.fromkeys(("east", "north", "unused", "unit", "visible"), 0) | {
            "period_bits": _FRACTION_BITS
        }
        rows = []
        for wavelength, wind in self.styles:
            # Crests run across the wind. Scale the direction so that a wavelength is a power of two.
            units = wavelength / sampling.unit
            bits = int(np.ceil(np.log2(units))) + _DIRECTION_BITS
            bits = max(bits, _FRACTION_BITS)
            scale = 2.0**bits / units
            towards = np.deg2rad(wind + 180)
            rows.append(
                {
                    "east": round(np.sin(towards) * scale),
                    "north": round(np.cos(towards) * scale),
                    "period_bits": bits,
                    "unused": 0,
                    "unit": 2.0**-_FRACTION_BITS,
                    "visible": band_weight(wavelength, sampling.cell),
                }
            )
        return sampling.struct(_HEADER, "DuneStyle", *(rows or [empty]))

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add waves and crests that are not resolved, and what the omitted warp moves."""
        del culled
        near = state.near
        waves = np.array([1 - band_weight(length, sampling.cell) for length, _ in self.styles])
        warp = max(sampling.missing("warp_u"), sampling.missing("warp_v"))
        wave = waves * (1 - _LEVEL)
        wave = wave + (1 - waves) * (_SLOPE * _CREST_SHIFT + _VIGOUR_SLOPE) * sampling.missing("crest")
        moved = np.minimum(_EDGE_SLOPE * np.sqrt(2) * outline_warp(sampling.world.fidelity) * warp, 1.0)
        state.bound += np.sum(near.dune * (near.cover * np.minimum(wave, 1.0) + moved), axis=-1)
        state.high += near.dune.sum(axis=-1)

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with dunes upon it."""
        if not self.styles:
            return ground
        height, dune = ground.height, ground.dune
        crest = fbm(site.sampling.octaves, "crest", site.x, site.y)
        styles = self._pack_styles(replace(site.sampling, real=np.dtype(np.float64)))
        for number in range(len(self.styles)):
            cover, amplitude = site.points.areas(SLOT_DUNE + number)
            height = height + cover * amplitude * _pattern(styles[number], site.x, site.y, crest)
            dune = np.maximum(dune, cover)
        return replace(ground, height=height, dune=dune)


def _pattern(style: np.void, x: LatticeArray, y: LatticeArray, crest: Float64Array) -> Float64Array:
    bits = int(style["period_bits"])
    phase = x * style["east"] + y * style["north"]
    t = (phase & ((1 << bits) - 1)) / 2.0**bits + _CREST_SHIFT * crest
    t = t - np.floor(t)
    up = t / _WINDWARD
    lee = np.maximum(1 - (t - _WINDWARD) / _LEE, 0)
    profile = np.where(t < _WINDWARD, up * up * (2 - up), lee**2)
    pattern = profile * (_VIGOUR_MIN + _VIGOUR_RANGE * smooth_rise(crest, _VIGOUR_START, 1))
    return np.asarray(_LEVEL + (pattern - _LEVEL) * style["visible"])
