"""Noise in plain NumPy float64: what ``kernels/noise.clh`` is measured against."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from sketchterrain.terrain.octaves import SKEW, SKEW_OTHER, SKEW_SAME, STRIDES, UNSKEW

if TYPE_CHECKING:
    from sketchterrain.array_types import Float64Array, LatticeArray
    from sketchterrain.terrain.octaves import OctaveTable


_RIDGE_WEIGHT = 1.5
_RIDGE_EDGE = 0.125


class Slope(NamedTuple):
    """A value and its slope eastward and northward, per lattice unit; arrays of one shape."""

    value: Float64Array
    east: Float64Array
    north: Float64Array


def simplex(u: LatticeArray, v: LatticeArray, shift: int, seed: int) -> Slope:
    """Return noise at skewed positions, a cell being 2^shift, with its slope over a cell."""
    cell_u, cell_v = u >> shift, v >> shift
    fu = (u - (cell_u << shift)) / 2.0**shift
    fv = (v - (cell_v << shift)) / 2.0**shift
    return _simplex_in(cell_u, cell_v, fu, fv, seed)


def fbm(octaves: OctaveTable, stack: str, x: LatticeArray, y: LatticeArray) -> Float64Array:
    """Return a stack's sum of octaves at lattice positions."""
    return fbm_slope(octaves, stack, x, y).value


def fbm_slope(octaves: OctaveTable, stack: str, x: LatticeArray, y: LatticeArray) -> Slope:
    """Return a stack's sum of octaves with its slope."""
    total = Slope(*np.zeros((3, *x.shape)))
    for i in range(*octaves.ranges[stack]):
        noise = _octave(octaves, i, x, y, 0.0, 0.0)
        total = Slope(*(part + octaves.scale[i, 0] * more for part, more in zip(total, noise, strict=True)))
    return total


def ridged(
    octaves: OctaveTable,
    stack: str,
    x: LatticeArray,
    y: LatticeArray,
    east: Float64Array,
    north: Float64Array,
) -> Float64Array:
    """Return a stack's ridged multifractal at positions bent by (east, north) lattice units."""
    return ridged_slope(octaves, stack, x, y, east, north).value


def ridged_slope(
    octaves: OctaveTable,
    stack: str,
    x: LatticeArray,
    y: LatticeArray,
    east: Float64Array,
    north: Float64Array,
) -> Slope:
    """Return the same with its slope at the bent position."""
    total, slopes = np.zeros(x.shape), np.zeros((2, *x.shape))
    weight, weight_slopes = np.ones(x.shape), np.zeros((2, *x.shape))
    for i in range(*octaves.ranges[stack]):
        noise = _octave(octaves, i, x, y, east, north)
        size = np.abs(noise.value)
        near = size < _RIDGE_EDGE
        edge = 1 - np.where(near, 0.5 * (size * size / _RIDGE_EDGE + _RIDGE_EDGE), size)
        lean = np.where(edge > 0, -np.sign(noise.value) * np.where(near, size / _RIDGE_EDGE, 1), 0)
        edge = np.maximum(edge, 0)
        ridge = edge**2
        ridge_slopes = 2 * edge * lean * np.stack(noise[1:])
        amplitude = octaves.scale[i, 0]
        total += amplitude * ridge * weight
        slopes += amplitude * (ridge_slopes * weight + ridge * weight_slopes)
        weight = np.minimum(_RIDGE_WEIGHT * ridge, 1)
        weight_slopes = np.where(weight < 1, _RIDGE_WEIGHT, 0) * ridge_slopes
    return Slope(total, *slopes)


def skewed(
    octaves: OctaveTable,
    i: int,
    x: LatticeArray,
    y: LatticeArray,
    east: Float64Array | float = 0.0,
    north: Float64Array | float = 0.0,
) -> tuple[LatticeArray, LatticeArray, Float64Array, Float64Array]:
    """Return the cells of an octave's lattice that places bent by (east, north) lie in, and the fractions."""
    shift, _, turn, _ = (int(word) for word in octaves.form[i])
    inverse = octaves.scale[i, 1]
    if turn:  # the lattice's own directions are the world's north and west
        x, y, east, north = y, -x, north, -np.asarray(east)
    u = SKEW_SAME * x + SKEW_OTHER * y + octaves.offset[i, 0]
    v = SKEW_OTHER * x + SKEW_SAME * y + octaves.offset[i, 1]
    cell_u, cell_v = u >> shift, v >> shift
    both = (east + north) * SKEW
    fu = (u - (cell_u << shift)) / 2.0**shift + (east + both) * inverse
    fv = (v - (cell_v << shift)) / 2.0**shift + (north + both) * inverse
    whole_u, whole_v = (np.floor(f).astype(np.int64) for f in (fu, fv))
    return cell_u + whole_u, cell_v + whole_v, fu - whole_u, fv - whole_v


def _octave(
    octaves: OctaveTable,
    i: int,
    x: LatticeArray,
    y: LatticeArray,
    east: Float64Array | float,
    north: Float64Array | float,
) -> Slope:
    noise = _simplex_in(*skewed(octaves, i, x, y, east, north), int(octaves.form[i, 1]))
    slopes = (-noise.north, noise.east) if octaves.form[i, 2] else noise[1:]
    return Slope(noise.value, *(octaves.scale[i, 1] * slope for slope in slopes))


def _simplex_in(
    cell_u: LatticeArray, cell_v: LatticeArray, fu: Float64Array, fv: Float64Array, seed: int
) -> Slope:
    lower = fu > fv
    total, slopes = np.zeros(fu.shape), np.zeros((2, *fu.shape))
    for iu, iv in ((0, 0), (lower.astype(np.int64), (~lower).astype(np.int64)), (1, 1)):
        du, dv = fu - iu, fv - iv
        d = np.stack([du, dv]) - (du + dv) * UNSKEW
        g = gradients(cell_u + iu, cell_v + iv, seed=seed)
        fade = np.maximum(0.5 - (d * d).sum(axis=0), 0)
        ramp = (g * d).sum(axis=0)
        total += fade**4 * ramp
        slopes += fade**4 * g - 8 * fade**3 * ramp * d
    return Slope(70 * total, *(70 * slopes))


def gradients(cell_u: LatticeArray, cell_v: LatticeArray, *, seed: int) -> Float64Array:
    """Return the gradients at corners of cells, each part in [-1, 1); shape (2, …)."""
    word = cell_u * STRIDES[0] + cell_v * STRIDES[1] + seed
    h = (word & 0xFFFFFFFF).astype(np.uint32)
    h ^= h >> np.uint32(15)
    h *= np.uint32(0x735A2D97)
    h ^= h >> np.uint32(15)
    return np.stack([h.astype(np.int32), (h << np.uint32(16)).astype(np.int32)]) / 2.0**31
