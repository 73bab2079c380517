"""Which octaves of noise a terrain has, and what a cell size leaves of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.hashing import hashed
from sketchterrain.terrain.lattice import metres_per_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

__all__ = ["FINEST_WAVELENGTH", "NoiseStack", "OctaveTable", "band_weight", "octave_table"]

FINEST_WAVELENGTH = 0.5
"""Shortest noise wavelength, m: what samples 0.1 m apart show well."""

_SKEW_BITS = 10
_FRACTION_BITS = 24
_OFFSET_RANGE = np.uint64(1 << 44)


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
        Amplitude with the band limit; 2^-(bits of the fraction).
    ranges : dict of str to (int, int)
        First and last (exclusive) octave of each stack.
    """

    form: npt.NDArray[np.int32]
    offset: npt.NDArray[np.int64]
    scale: npt.NDArray[np.float64]
    ranges: dict[str, tuple[int, int]]


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
            if cell_bits < 0 or wavelength < FINEST_WAVELENGTH or weight == 0:
                break
            shift = cell_bits + _SKEW_BITS
            words = hashed(seed, f"noise {stack.name}", octave, np.arange(3))
            form.append((shift, int(words[0] & np.uint64(0x7FFFFFFF)), octave & 1, 0))
            offset.append([int(word % _OFFSET_RANGE) for word in words[1:]])
            amplitude = weight * (1 - stack.gain) * stack.gain**octave
            scale.append((amplitude, 2.0 ** -min(shift, _FRACTION_BITS)))
        ranges[stack.name] = (first, len(form))
    return OctaveTable(
        np.array(form, dtype=np.int32).reshape(-1, 4),
        np.array(offset, dtype=np.int64).reshape(-1, 2),
        np.array(scale, dtype=np.float64).reshape(-1, 2),
        ranges,
    )
