"""Parts of detail bounds: what a cell size omits, and the greatest effects of features near a block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array


@dataclass(frozen=True)
class OmittedDetail:
    """Detail that one cell size omits anywhere; m unless noted."""

    ground: float  # of the ground's octaves
    hills: float  # of hills that are too small
    mountains: float
    crags: float  # of the roughness of bare rock
    crags_left: float  # resolved part of that roughness
    moved: bool  # hills or mountains themselves differ
    warp: float  # of multiplied noises, dimensionless
    ridge: float
    crest: float
    gullies: Float64Array  # (octaves,) at full erosion
    wavelengths: Float64Array  # (octaves,) of the gullies
    waves: Float64Array  # (styles,) unresolved share of the dunes' waves


@dataclass(frozen=True)
class BlockExtrema:
    """Greatest effects of the features near each of n blocks."""

    hill: Float64Array  # (n,) height without swell or gullies, m
    mountain: Float64Array
    hill_sum: Float64Array  # (n,) the same if all of them had their summit in the block, m
    mountain_sum: Float64Array
    erosion: Float64Array  # (n,) 0 … 1
    widest: Float64Array  # (n,) width of the widest gullies, m
    cover: Float64Array  # (n, styles) 0 … 1
    dune: Float64Array  # (n, styles) height of the highest dunes, m
