"""What bounds of lost detail are made of: what a cell size leaves out, and what stands near a block."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    Reals = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Tail:
    """What one cell size leaves out, wherever it is; metres unless said otherwise.

    Attributes
    ----------
    ground, hills, mountains, crags : float
        Of the ground's octaves; of hills and mountains that are too small; of bare rock.
    crags_left : float
        What is left of bare rock's roughness.
    moved : bool
        Whether hills or mountains themselves differ.
    warp, ridge, crest : float
        Of those noises, which are multiplied with something: without a unit.
    gullies : ndarray, shape (octaves,)
        Of each octave, at full erosion.
    wavelengths : ndarray, shape (octaves,)
        Of the gullies.
    waves : ndarray, shape (styles,)
        Share of the dunes' waves that is not shown.
    """

    ground: float
    hills: float
    mountains: float
    crags: float
    crags_left: float
    moved: bool
    warp: float
    ridge: float
    crest: float
    gullies: Reals
    wavelengths: Reals
    waves: Reals


@dataclass(frozen=True)
class Near:
    """What the features that reach blocks can be there at most; arrays a block.

    Attributes
    ----------
    hill, mountain : ndarray, shape (n,)
        Their height without swell or gullies, m.
    hill_sum, mountain_sum : ndarray, shape (n,)
        The same as if all of them had their summit in the block, m.
    erosion, widest : ndarray, shape (n,)
        0 … 1; width of the widest gullies, m.
    cover, dune : ndarray, shape (n, styles)
        0 … 1; height of the highest dunes, m.
    """

    hill: Reals
    mountain: Reals
    hill_sum: Reals
    mountain_sum: Reals
    erosion: Reals
    widest: Reals
    cover: Reals
    dune: Reals
