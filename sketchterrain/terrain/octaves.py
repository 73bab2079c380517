"""Which octaves of noise a terrain has, and what a cell size leaves of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import numpy.typing as npt

from sketchterrain.features.hashing import hash_keys
from sketchterrain.terrain.lattice import QUADS, metres_per_unit

__all__ = [
    "FINEST_WAVELENGTH",
    "SKEW",
    "SKEW_OTHER",
    "SKEW_SAME",
    "STRIDES",
    "UNSKEW",
    "NoiseStack",
    "OctaveTable",
    "band_weight",
    "corner_table",
    "fits_patches",
    "octave_table",
    "whole_step_bits",
]

FINEST_WAVELENGTH = 0.5
"""Shortest noise wavelength, m: what samples 0.1 m apart show well."""

SKEW_SAME, SKEW_OTHER = 1399, 375
"""What a skewed coordinate, in units of 2^-10 lattice units, is the sum of: SAME x + OTHER y."""
STRIDES = (0x9E3779B1, 0x85EBCA77)
"""What a step from cell to cell adds to the hash, along u and along v."""

_SKEW_BITS = 10
SKEW = SKEW_OTHER / 2**_SKEW_BITS
UNSKEW = SKEW / (1 + 2 * SKEW)
"""How positions are skewed into a simplex lattice, and how vectors come back."""

# A lattice is shifted by so many bits of a cell: few enough that the last is a whole step of any tile that
# shows the octave, many enough that no two octaves line up.
_OFFSET_CELL_BITS = 11
_OFFSET_RANGE = np.uint64(1 << 22)
_MOST_BITS = 30  # of a cell in steps, so that a corner's and a vertex's sum fits 32 with its sign
_MOST_STEP_BITS = 22
_MOST_UNITS = (QUADS + 3) << _MOST_STEP_BITS  # along a patch: it and what reaches it span less than 2^31
_MOST_STEPS = (1 << _MOST_BITS) // (SKEW_SAME + SKEW_OTHER)


@dataclass(frozen=True)
class NoiseStack:
    """Octaves of one noise, each of half the wavelength of the one before.

    Attributes
    ----------
    name : str
        Also salts the hash, so that no two stacks look alike.
    wavelength : float
        Of the first octave, m; the nearest power of two lattice units is taken.
    gain : float
        Ratio of one octave's amplitude to the one before (persistence).
    most : int
        The most octaves; fewer where :data:`FINEST_WAVELENGTH` or the cell size ends the series.
    """

    name: str
    wavelength: float
    gain: float
    most: int = 32


@dataclass(frozen=True)
class OctaveTable:
    """Octaves of several stacks, one after another, as ``kernels/noise.clh`` reads them.

    Attributes
    ----------
    form : ndarray of int32, shape (n, 4)
        Shift (bits of a cell in skewed units), hash seed, quarter turn, 0.
    offset : ndarray of int64, shape (n, 2)
        Shift of the octave's lattice, skewed units.
    scale : ndarray of float64, shape (n, 2)
        Amplitude with the band limit; 1 / side of a cell, in lattice units.
    ranges : dict of str to (int, int)
        First and last (exclusive) octave of each stack.
    """

    form: npt.NDArray[np.int32]
    offset: npt.NDArray[np.int64]
    scale: npt.NDArray[np.float64]
    ranges: dict[str, tuple[int, int]]

    @cached_property
    def shifts(self) -> tuple[int, int]:
        """Bits of the smallest and of the largest cell in skewed units; 63 and 0 where there is no octave."""
        shift = self.form[:, 0]
        return int(shift.min(initial=63)), int(shift.max(initial=0))


def band_weight(wavelength: float, cell_size: float) -> float:
    """Return what samples ``cell_size`` apart keep of a wavelength: 0 up to two cells, 1 from four on."""
    if cell_size <= 0:
        return 1.0
    t = min(max(wavelength / cell_size / 2 - 1, 0.0), 1.0)
    return t * t * (3 - 2 * t)


def octave_table(
    stacks: Sequence[NoiseStack], *, extent: float, seed: int, cell_size: float = 0.0
) -> OctaveTable:
    """Return the octaves that samples ``cell_size`` metres apart can carry.

    The amplitudes of a whole stack sum to at most 1 (as gain^i (1 - gain)); octaves that would be
    weighted with 0 are left out.
    """
    return _octave_table(tuple(stacks), extent, seed, cell_size)


@lru_cache(maxsize=256)
def _octave_table(stacks: tuple[NoiseStack, ...], extent: float, seed: int, cell_size: float) -> OctaveTable:
    """Make a table, read-only, for it is kept."""
    form: list[tuple[int, int, int, int]] = []
    offset: list[list[int]] = []
    scale: list[tuple[float, float]] = []
    ranges: dict[str, tuple[int, int]] = {}
    unit = metres_per_unit(extent)
    for stack in stacks:
        first = len(form)
        top = round(np.log2(stack.wavelength / unit))
        for octave in range(stack.most):
            cell_bits = top - octave
            wavelength = 2.0**cell_bits * unit
            weight = band_weight(wavelength, cell_size)
            if cell_bits < 1 or wavelength < FINEST_WAVELENGTH or weight == 0:
                break
            shift = cell_bits + _SKEW_BITS
            words = hash_keys(seed, f"noise {stack.name}", octave, np.arange(3))
            form.append((shift, int(words[0] & np.uint64(0x7FFFFFFF)), octave & 1, 0))
            offset.append([int(word % _OFFSET_RANGE) << (shift - _OFFSET_CELL_BITS) for word in words[1:]])
            amplitude = weight * (1 - stack.gain) * stack.gain**octave
            scale.append((amplitude, 2.0**-cell_bits))
        ranges[stack.name] = (first, len(form))
    table = OctaveTable(
        np.array(form, dtype=np.int32).reshape(-1, 4),
        np.array(offset, dtype=np.int64).reshape(-1, 2),
        np.array(scale, dtype=np.float64).reshape(-1, 2),
        ranges,
    )
    for part in (table.form, table.offset, table.scale):
        part.flags.writeable = False
    return table


def whole_step_bits(octaves: OctaveTable) -> int:
    """Return the bits of the longest step, in lattice units, that every octave's shift is a multiple of."""
    return min(octaves.shifts[0], _MOST_STEP_BITS + _OFFSET_CELL_BITS) - _OFFSET_CELL_BITS


def fits_patches(octaves: OctaveTable, step_bits: int, steps: int = QUADS + 3) -> bool:
    """Whether vertices can be told by 32 bits in every octave.

    Parameters
    ----------
    octaves
    step_bits
        Vertices are whole steps of 2^step_bits lattice units apart and from the origin.
    steps
        Along the side of a patch.
    """
    fine = steps <= _MOST_STEPS and octaves.shifts[1] - step_bits <= _MOST_BITS
    return fine and steps << step_bits <= _MOST_UNITS and step_bits <= whole_step_bits(octaves)


def corner_table(
    octaves: OctaveTable, corner: npt.NDArray[np.int64], step_bits: int
) -> npt.NDArray[np.uint32]:
    """Return where the corners of patches lie in each octave's lattice (``kernels/positions.clh``).

    Parameters
    ----------
    octaves
    corner
        South-west vertices, lattice units, whole steps, shape (patches, 2).
    step_bits
        Vertices are 2^step_bits lattice units apart; see :func:`fits_patches`.

    Returns
    -------
    ndarray of uint32, shape (patches, octaves, 4)
        Fractions along u and v in steps, hash of the cell, bits of a cell in steps.
    """
    x, y = corner[:, 0], corner[:, 1]
    plain = np.stack([SKEW_SAME * x + SKEW_OTHER * y, SKEW_OTHER * x + SKEW_SAME * y], axis=-1)
    turned = np.stack([SKEW_SAME * y - SKEW_OTHER * x, SKEW_OTHER * y - SKEW_SAME * x], axis=-1)
    shift, seed = octaves.form[:, 0].astype(np.int64), octaves.form[:, 1].astype(np.int64)
    skewed = np.where(octaves.form[:, 2, None] == 1, turned[:, None], plain[:, None]) + octaves.offset
    cell = skewed >> shift[:, None]
    fraction = (skewed - (cell << shift[:, None])) >> step_bits
    # Products wrap around 64 bits; only the last 32 count.
    strides = cell * np.array(STRIDES)
    hashed_cell = (strides.sum(axis=-1) + seed) & 0xFFFFFFFF
    bits = np.broadcast_to(shift - step_bits, hashed_cell.shape)
    return np.stack([fraction[..., 0], fraction[..., 1], hashed_cell, bits], axis=-1).astype(np.uint32)
