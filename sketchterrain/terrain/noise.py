"""Noise octaves on the integer lattice, and their evaluation on the host in float64."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple, TypeAlias

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.geometry.hashing import hash_keys
from sketchterrain.geometry.lattice import QUADS, metres_per_unit
from sketchterrain.io.resources import kernel_constants

FINEST_WAVELENGTH = 0.5
"""Shortest noise wavelength, m: well resolved by samples 0.1 m apart."""

FINEST_CELL = FINEST_WAVELENGTH / 4
"""Cell size that resolves every octave, m; finer ones give the same terrain."""

NOISE_PEAK = 1.01
"""Bound of |noise| in one octave: a simplex's corners give no more, each with its worst gradient."""

SKEW_SAME, SKEW_OTHER, *STRIDES = (
    int(value)
    for value in kernel_constants("positions.clh", "SKEW_SAME", "SKEW_OTHER", "STRIDE_U", "STRIDE_V")
)
"""Skewed coordinates (2^-10 lattice units) are SAME x + OTHER y; hash increments along u and v."""

_SKEW_BITS = 10
SKEW = SKEW_OTHER / 2**_SKEW_BITS
UNSKEW = SKEW / (1 + 2 * SKEW)
"""Skew of positions into a simplex lattice, and its inverse for vectors."""

# A lattice is shifted by a fraction of a cell with so many bits: few enough that the last is a whole step of
# any tile that resolves the octave, many enough that no two octaves line up.
_OFFSET_CELL_BITS = 11
_OFFSET_RANGE = np.uint64(1 << 22)
_MAX_BITS = 30  # of a cell in steps, so that a corner's and a vertex's sum fits 32 with its sign
_MAX_STEP_BITS = 22
_MAX_UNITS = (QUADS + 3) << _MAX_STEP_BITS  # along a patch: it and its support span less than 2^31
_MAX_STEPS = (1 << _MAX_BITS) // (SKEW_SAME + SKEW_OTHER)


@dataclass(frozen=True)
class NoiseStack:
    """Octaves of one noise, each with half the wavelength of the one before."""

    name: str  # also salts the hash, so that stacks are uncorrelated
    wavelength: float  # of the first octave, m, rounded to a power of two lattice units
    gain: float  # amplitude ratio of successive octaves (persistence)
    most: int = 32  # limit of octaves; FINEST_WAVELENGTH or the cell size may end the series earlier


@dataclass(frozen=True)
class OctaveTable:
    """Octaves of several stacks, concatenated, as ``kernels/noise.clh`` reads them."""

    form: npt.NDArray[np.int32]  # (n, 4) shift (bits of a cell in skewed units), hash seed, quarter turn, 0
    offset: LatticeArray  # (n, 2) shift of the octave's lattice, skewed units
    scale: Float64Array  # (n, 2) band-limited amplitude; 1 / side of a cell, in lattice units
    ranges: dict[str, tuple[int, int]]  # first and last (exclusive) octave of each stack

    @cached_property
    def shifts(self) -> tuple[int, int]:
        """Bits of the smallest and of the largest cell in skewed units; 63 and 0 without octaves."""
        shift = self.form[:, 0]
        return int(shift.min(initial=63)), int(shift.max(initial=0))


def band_weight(wavelength: float, cell_size: float) -> float:
    """Return the share of a wavelength that samples ``cell_size`` apart resolve.

    0 up to two cells, 1 from four on.
    """
    if cell_size <= 0:
        return 1.0
    t = min(max(wavelength / cell_size / 2 - 1, 0.0), 1.0)
    return t * t * (3 - 2 * t)


def octave_table(
    stacks: Sequence[NoiseStack], *, extent: float, seed: int, cell_size: float = 0.0
) -> OctaveTable:
    """Return the octaves that samples ``cell_size`` metres apart can resolve; those of weight 0 are omitted.

    The amplitudes of a whole stack sum to at most 1 (as gain^i (1 - gain)).
    """
    return _octave_table(tuple(stacks), extent, seed, cell_size)


@lru_cache(maxsize=256)
def _octave_table(stacks: tuple[NoiseStack, ...], extent: float, seed: int, cell_size: float) -> OctaveTable:
    """Return a read-only table, as it is cached."""
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
    """Return the bits of the longest step, in lattice units, that divides every octave's shift."""
    return min(octaves.shifts[0], _MAX_STEP_BITS + _OFFSET_CELL_BITS) - _OFFSET_CELL_BITS


def fits_patches(octaves: OctaveTable, step_bits: int, steps: int = QUADS + 3) -> bool:
    """Return whether vertices 2^step_bits lattice units apart fit 32 bits in every octave."""
    fine = steps <= _MAX_STEPS and octaves.shifts[1] - step_bits <= _MAX_BITS
    return fine and steps << step_bits <= _MAX_UNITS and step_bits <= whole_step_bits(octaves)


def corner_table(octaves: OctaveTable, corner: LatticeArray, step_bits: int) -> npt.NDArray[np.uint32]:
    """Return the position of patch corners (patches, 2) in each octave's lattice (``kernels/positions.clh``).

    Corners are south-west vertices in lattice units, multiples of 2^step_bits; see :func:`fits_patches`.
    Result: (patches, octaves, 4), fractions along u and v in steps, hash of the cell, bits of a cell in
    steps.
    """
    x, y = corner[:, 0], corner[:, 1]
    plain = np.stack([SKEW_SAME * x + SKEW_OTHER * y, SKEW_OTHER * x + SKEW_SAME * y], axis=-1)
    turned = np.stack([SKEW_SAME * y - SKEW_OTHER * x, SKEW_OTHER * y - SKEW_SAME * x], axis=-1)
    shift, seed = octaves.form[:, 0].astype(np.int64), octaves.form[:, 1].astype(np.int64)
    skewed = np.where(octaves.form[:, 2, None] == 1, turned[:, None], plain[:, None]) + octaves.offset
    cell = skewed >> shift[:, None]
    fraction = (skewed - (cell << shift[:, None])) >> step_bits
    # Products wrap around 64 bits; only the low 32 matter.
    strides = cell * np.array(STRIDES)
    hashed_cell = (strides.sum(axis=-1) + seed) & 0xFFFFFFFF
    bits = np.broadcast_to(shift - step_bits, hashed_cell.shape)
    return np.stack([fraction[..., 0], fraction[..., 1], hashed_cell, bits], axis=-1).astype(np.uint32)


def omitted_amplitudes(
    full: OctaveTable, resolved: OctaveTable, stack: str
) -> tuple[Float64Array, Float64Array]:
    """Return the amplitudes of a stack's octaves, and what a coarser cell size leaves of them, shape (n,)."""
    first, last = full.ranges[stack]
    amplitude = full.scale[first:last, 0]
    left = resolved.scale[slice(*resolved.ranges[stack]), 0]
    return amplitude, np.concatenate([left, np.zeros(last - first - len(left))])


class ValueSlope(NamedTuple):
    """A value and its slope eastward and northward; arrays of one shape."""

    value: Float64Array
    east: Float64Array
    north: Float64Array


def fbm(octaves: OctaveTable, stack: str, x: LatticeArray, y: LatticeArray) -> Float64Array:
    """Return a stack's sum of octaves at lattice positions."""
    total = np.zeros(x.shape)
    for i in range(*octaves.ranges[stack]):
        total += octaves.scale[i, 0] * octave_noise(octaves, i, x, y)
    return total


def fbm_slope(octaves: OctaveTable, stack: str, x: LatticeArray, y: LatticeArray) -> ValueSlope:
    """Return a stack's sum of octaves with its slope per lattice unit."""
    total = np.zeros((3, *x.shape))
    for i in range(*octaves.ranges[stack]):
        amplitude, inverse = octaves.scale[i]
        value, along, across = np.zeros((3, *x.shape))
        for (dx, dy), (gx, gy), fade in simplex_corners(octaves, i, x, y):
            ramp, fourth = gx * dx + gy * dy, fade**4
            steepness = 8 * fade**3 * ramp
            value += fourth * ramp
            along += fourth * gx - steepness * dx
            across += fourth * gy - steepness * dy
        slopes = (-across, along) if octaves.form[i, 2] else (along, across)
        octave = 70 * value, *(inverse * (70 * slope) for slope in slopes)
        for part, more in zip(total, octave, strict=True):
            part += amplitude * more
    return ValueSlope(*total)


def octave_noise(octaves: OctaveTable, i: int, x: LatticeArray, y: LatticeArray) -> Float64Array:
    """Return the noise of one octave, -1 … 1."""
    total = np.zeros(x.shape)
    for (dx, dy), (gx, gy), fade in simplex_corners(octaves, i, x, y):
        total += fade**4 * (gx * dx + gy * dy)
    return 70 * total


_Pair: TypeAlias = tuple[Float64Array, Float64Array]


def simplex_corners(
    octaves: OctaveTable, i: int, x: LatticeArray, y: LatticeArray
) -> Iterator[tuple[_Pair, _Pair, Float64Array]]:
    """Yield the offsets from corners of an octave's simplices around positions, in cells along its lattice.

    With each corner come its gradient, and 0.5 less the square of the distance, at least 0.
    """
    shift, seed, turn, _ = (int(word) for word in octaves.form[i])
    if turn:  # the lattice's axes are the world's north and west
        x, y = y, -x
    u = SKEW_SAME * x + SKEW_OTHER * y + octaves.offset[i, 0]
    v = SKEW_OTHER * x + SKEW_SAME * y + octaves.offset[i, 1]
    cell_u, cell_v = u >> shift, v >> shift
    fu, fv = (u - (cell_u << shift)) / 2.0**shift, (v - (cell_v << shift)) / 2.0**shift
    lower = (fu > fv).astype(np.int64)
    for iu, iv in ((0, 0), (lower, 1 - lower), (1, 1)):
        du, dv = fu - iu, fv - iv
        skew = (du + dv) * UNSKEW
        dx, dy = du - skew, dv - skew
        gradient = gradients(cell_u + iu, cell_v + iv, seed=seed)
        yield (dx, dy), gradient, np.maximum(0.5 - (dx * dx + dy * dy), 0)


def gradients(cell_u: LatticeArray, cell_v: LatticeArray, *, seed: int) -> _Pair:
    """Return the gradients at corners of cells, components in [-1, 1)."""
    word = cell_u * STRIDES[0] + cell_v * STRIDES[1] + seed
    h = (word & 0xFFFFFFFF).astype(np.uint32)
    h ^= h >> np.uint32(15)
    h *= np.uint32(0x735A2D97)
    h ^= h >> np.uint32(15)
    both = (word.view(np.int32).astype(np.float64) for word in (h, h << np.uint32(16)))
    east, north = (part * 2.0**-31 for part in both)
    return east, north
