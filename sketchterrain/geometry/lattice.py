"""Integer positions: lattice units of extent/2^24 metres from the world's origin."""

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import LatticeArray
from sketchterrain.errors import InputError

LATTICE_BITS = 24
QUADS = 64
"""Quads along a tile's side."""
COARSEST_LEVEL = -12
FINEST_LEVEL = LATTICE_BITS - QUADS.bit_length() + 1
"""The level whose vertices are one lattice unit apart, of tiles of QUADS quads."""

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
