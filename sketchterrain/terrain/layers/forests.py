"""Forests: a mask of where trees stand, by areas that point features mark."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np

from sketchterrain.io.resources import kernel_constants
from sketchterrain.terrain.layers.layer import HostSamples, HostSite, TerrainLayer, smooth_rise
from sketchterrain.terrain.layers.points import SLOT_FOREST
from sketchterrain.terrain.noise import fbm

_RAGGED, _START, _INVERSE_RANGE = kernel_constants(
    "layers/forests.clh", "FOREST_RAGGED", "FOREST_START", "INVERSE_FOREST_RANGE"
)
(COVER_NOISE_CONTRAST,) = kernel_constants("world.clh", "COVER_NOISE_CONTRAST")
COVER_NOISE: Final = "mottle"
"""Noise of the ground cover, which salts its hashes."""


@dataclass(frozen=True, eq=False)
class ForestsLayer(TerrainLayer):
    """The mask of forests; it changes no height."""

    name: ClassVar[str] = "forests"

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with the mask."""
        if not site.masks:
            return ground
        cover, share = site.points.areas(SLOT_FOREST)
        noise = COVER_NOISE_CONTRAST * fbm(site.sampling.octaves, COVER_NOISE, site.x, site.y)
        forest = (
            share
            * smooth_rise(cover + _RAGGED * noise, _START, 1 / _INVERSE_RANGE)
            * smooth_rise(cover, 0, 1 / _INVERSE_RANGE)
        )
        return replace(ground, forest=np.asarray(forest))
