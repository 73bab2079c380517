"""Parts of detail bounds: what a cell size omits, and the greatest effects of features near a block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Reals = npt.NDArray[np.float64]


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
    gullies: Reals  # (octaves,) at full erosion
    wavelengths: Reals  # (octaves,) of the gullies
    waves: Reals  # (styles,) unresolved share of the dunes' waves


@dataclass(frozen=True)
class BlockExtrema:
    """Greatest effects of the features near each of n blocks."""

    hill: Reals  # (n,) height without swell or gullies, m
    mountain: Reals
    hill_sum: Reals  # (n,) the same if all of them had their summit in the block, m
    mountain_sum: Reals
    erosion: Reals  # (n,) 0 … 1
    widest: Reals  # (n,) width of the widest gullies, m
    cover: Reals  # (n, styles) 0 … 1
    dune: Reals  # (n, styles) height of the highest dunes, m
