"""Hashes of integer positions and noise made of them, compiled; the same bits wherever they are asked for."""
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

from math import floor

import numpy as np
from numba import njit

compiled = njit(cache=True, nogil=True, error_model="numpy")
"""Decorator of what drains ground: without Python's lock, and dividing as NumPy does."""


@compiled
def mixed(state):
    """Return the finalizer of splitmix64, as `hash_keys` folds its keys."""
    state = state + np.uint64(0x9E3779B97F4A7C15)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return state ^ (state >> np.uint64(31))


@compiled
def hashed(key, column, row):
    """Return 64 hashed bits of a pair of integers."""
    return mixed(mixed(key ^ mixed(np.uint64(column))) ^ np.uint64(row))


@compiled
def unit(bits):
    """Return hashed bits as a number in [0, 1)."""
    return np.float64(bits >> np.uint64(11)) * 2.0**-53


@compiled
def value_noise(key, x, y, bits):
    """Return value noise in [−1, 1] at mesh units (integers) on cells of 2^bits units."""
    column, row = x >> bits, y >> bits
    scale = 1.0 / (1 << bits)
    u, v = (x - (column << bits)) * scale, (y - (row << bits)) * scale
    u, v = u * u * (3.0 - 2.0 * u), v * v * (3.0 - 2.0 * v)
    a, b = unit(hashed(key, column, row)), unit(hashed(key, column + 1, row))
    c, d = unit(hashed(key, column, row + 1)), unit(hashed(key, column + 1, row + 1))
    south, north = a + u * (b - a), c + u * (d - c)
    return 2.0 * (south + v * (north - south)) - 1.0


@compiled
def value_noise_row(key, x, step, y, bits, amplitude, row):
    """Add value noise times an amplitude to a row of points, `step` mesh units apart from (x, y) on."""
    north = y >> bits
    scale = 1.0 / (1 << bits)
    v = (y - (north << bits)) * scale
    v = v * v * (3.0 - 2.0 * v)
    start = 0
    while start < row.size:  # points of one cell of the noise at a time
        column = (x + start * step) >> bits
        stop = min((((column + 1) << bits) - x + step - 1) // step, row.size)
        a, b = unit(hashed(key, column, north)), unit(hashed(key, column + 1, north))
        c, d = unit(hashed(key, column, north + 1)), unit(hashed(key, column + 1, north + 1))
        part, first = row[start:stop], x + start * step - (column << bits)
        for i in range(part.size):
            u = (first + i * step) * scale
            u = u * u * (3.0 - 2.0 * u)
            low, high = a + u * (b - a), c + u * (d - c)
            part[i] += amplitude * (2.0 * (low + v * (high - low)) - 1.0)
        start = stop


@compiled
def _gradient(key, column, row, u, v):
    """Return the height at (u, v) of the slope that is hashed to a lattice point."""
    bits = hashed(key, column, row)
    east = np.float64(bits & np.uint64(0xFFFF)) * 2.0**-15 - 1.0
    north = np.float64((bits >> np.uint64(16)) & np.uint64(0xFFFF)) * 2.0**-15 - 1.0
    return east * u + north * v


@compiled
def gradient_noise(key, x, y):
    """Return gradient noise at a point of the unit lattice, about −0.7 … 0.7."""
    column, row = floor(x), floor(y)
    u, v = x - column, y - row
    a, b = _gradient(key, column, row, u, v), _gradient(key, column + 1, row, u - 1.0, v)
    c, d = _gradient(key, column, row + 1, u, v - 1.0), _gradient(key, column + 1, row + 1, u - 1.0, v - 1.0)
    s, t = u * u * u * (u * (6.0 * u - 15.0) + 10.0), v * v * v * (v * (6.0 * v - 15.0) + 10.0)
    south, north = a + s * (b - a), c + s * (d - c)
    return south + t * (north - south)
