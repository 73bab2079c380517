"""Integer positions: lattice units of extent/2^24 metres from the world's origin."""

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import LatticeArray
from sketchterrain.errors import InputError

LATTICE_BITS = 24
QUADS = 64
"""Quads along a tile's side."""
COARSEST_LEVEL = -12

# Beyond it a skewed coordinate (times 1399) and its octave's offset could leave 64 bits.
_FARTHEST_UNIT = 2.0**51


def metres_per_unit(extent: float) -> float:
    """Return the side of a lattice unit (m)."""
    return extent / 2.0**LATTICE_BITS


def to_lattice(metres: npt.ArrayLike, extent: float) -> LatticeArray:
    """Round coordinates (m, any shape) to lattice units; InputError if not finite or beyond 2^51 units."""
    units = np.asarray(metres, dtype=np.float64) / metres_per_unit(extent)
    if not np.all(np.abs(units) <= _FARTHEST_UNIT):  # also catches NaN
        farthest = _FARTHEST_UNIT * metres_per_unit(extent)
        raise InputError(f"coordinates must be finite and within ±{farthest:.3g} m of the origin")
    return np.asarray(np.rint(units), dtype=np.int64)


def covered_places(first: LatticeArray, last: LatticeArray) -> tuple[LatticeArray, LatticeArray]:
    """Return columns and rows (k, 2) from a first to a last one of each of n ranges, and the ranges' numbers.

    The numbers come first, ascending.
    """
    most = (last - first).max(axis=0) + 1
    step = np.indices(tuple(most)).reshape(2, -1).T
    inside = np.all(step <= (last - first)[:, None], axis=-1)
    return np.nonzero(inside)[0], (first[:, None] + step)[inside]


def unique_places(place: LatticeArray) -> LatticeArray:
    """Return different columns and rows (n, 2), ascending."""
    low = place.min(axis=0)
    rows = int(np.ptp(place[:, 1])) + 1
    # As one number each: np.unique of rows is many times slower.
    number = np.unique((place[:, 0] - low[0]) * rows + (place[:, 1] - low[1]))
    return np.asarray(np.stack(np.divmod(number, rows), axis=-1) + low)


def finest_level(quads: int) -> int:
    """Return the level of the finest tiles with so many quads along a side, a power of two."""
    return LATTICE_BITS - quads.bit_length() + 1


def level_step(level: int, quads: int = QUADS) -> int:
    """Return the distance between vertices of a level's tiles, lattice units.

    Tiles are 2^(24 - level) wide.
    """
    finest = finest_level(quads)
    if not COARSEST_LEVEL <= level <= finest:
        raise InputError(f"expected a tile level of {COARSEST_LEVEL} … {finest}, got {level}")
    return 1 << (finest - level)
