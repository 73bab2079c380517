"""Positions as integers: lattice units of extent/2^24 metres, counted from the world's origin."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

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
    """Return the side of a lattice unit in metres."""
    return extent / 2.0**LATTICE_BITS


def to_lattice(metres: npt.ArrayLike, extent: float) -> npt.NDArray[np.int64]:
    """Round positions to the lattice.

    Parameters
    ----------
    metres
        Coordinates in metres, any shape.
    extent
        Metres along the sketch's longer side.

    Returns
    -------
    ndarray of int64
        Coordinates in lattice units, of the same shape.

    Raises
    ------
    InputError
        If a coordinate is not finite or too far away (2^51 units) to be told apart from its neighbours.
    """
    units = np.asarray(metres, dtype=np.float64) / metres_per_unit(extent)
    if not np.all(np.abs(units) <= _FARTHEST_UNIT):  # also catches NaN
        farthest = _FARTHEST_UNIT * metres_per_unit(extent)
        raise InputError(f"coordinates must be finite and within ±{farthest:.3g} m of the origin")
    return np.asarray(np.rint(units), dtype=np.int64)


def finest_level(quads: int) -> int:
    """Return the level of the finest tiles that have so many quads along a side, a power of two."""
    return LATTICE_BITS - quads.bit_length() + 1


def level_step(level: int, quads: int = QUADS) -> int:
    """Return the distance between the vertices of a level's tiles, in lattice units.

    Parameters
    ----------
    level
        A tile is 2^(24 - level) lattice units wide, whatever its quads.
    quads
        Along a tile's side, a power of two.

    Raises
    ------
    InputError
        If there is no such level.
    """
    finest = finest_level(quads)
    if not COARSEST_LEVEL <= level <= finest:
        raise InputError(f"tile level must be {COARSEST_LEVEL} … {finest}, not {level}")
    return 1 << (finest - level)


def tile_axes(level: int, column: int, row: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the lattice coordinates of a tile's vertices and of one more vertex beyond each border.

    Returns
    -------
    x, y : ndarray of int64, shape (QUADS + 3,)
        x runs from west to east, y from north to south.
    """
    step = level_step(level)
    offsets = np.arange(-1, QUADS + 2, dtype=np.int64) * step
    return column * QUADS * step + offsets, (row + 1) * QUADS * step - offsets
