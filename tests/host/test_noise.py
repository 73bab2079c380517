"""Value noise along rows of points, and interpolation between nodes, against plain Python."""

import numpy as np
import pytest

from sketchterrain.host.library import host_function

MASK = 2**64 - 1


def mixed(state):
    """Return the finalizer of SplitMix64 in integers without bounds."""
    state = (state + 0x9E3779B97F4A7C15) & MASK
    state = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & MASK
    state = ((state ^ (state >> 27)) * 0x94D049BB133111EB) & MASK
    return state ^ (state >> 31)


def corner(key, column, row):
    """Return the noise at a corner of its cells, in [0, 1)."""
    return (mixed(mixed(key ^ mixed(column & MASK)) ^ (row & MASK)) >> 11) / 2**53


def value_noise(key, x, y, bits):
    """Return the noise at a point, by the bilinear mean of its cell's corners."""
    (column, u), (row, v) = divmod(x, 2**bits), divmod(y, 2**bits)
    u, v = (t * t * (3 - 2 * t) for t in (u / 2**bits, v / 2**bits))
    south, north = (
        (1 - u) * corner(key, column, row + k) + u * corner(key, column + 1, row + k) for k in (0, 1)
    )
    return 2 * ((1 - v) * south + v * north) - 1


def row_of_noise(key, x, step, y, bits, amplitude, count):
    row = np.zeros(count)
    host_function("value_noise_row")(key, x, step, y, bits, amplitude, row)
    return row


@pytest.mark.parametrize("count", [0, 1, 2, 7, 40])
def test_rows_of_value_noise_equal_the_noise_at_their_points(count):
    rng = np.random.default_rng(count)
    for bits, step in ((5, 1), (5, 7), (7, 16), (3, 8), (3, 100), (13, 4096)):
        x, y = (int(each) for each in rng.integers(-(2**50), 2**50, 2))
        key = int(rng.integers(0, 2**63)) * 2 + 1
        expected = [0.7 * value_noise(key, x + i * step, y, bits) for i in range(count)]
        found = row_of_noise(key, x, step, y, bits, 0.7, count)
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_value_noise_is_added_to_what_a_row_holds():
    row = np.arange(9.0)
    host_function("value_noise_row")(5, -3, 2, 8, 4, 0.5, row)
    np.testing.assert_array_equal(row, np.arange(9.0) + row_of_noise(5, -3, 2, 8, 4, 0.5, 9))


@pytest.mark.parametrize("bits", [1, 2, 3])
def test_nodes_are_interpolated_from_coarse_ones(bits):
    def field(x, y):  # which bilinear interpolation has no error for
        return 3.0 + 0.5 * x - 2.0 * y + 0.25 * x * y

    for column, row, rows, columns in ((0, 0, 1, 1), (-5, 3, 6, 11), (-8, -9, 2, 17)):
        south, west = row >> bits, column >> bits
        shape = ((row + rows - 1) >> bits) - south + 2, ((column + columns - 1) >> bits) - west + 2
        y, x = np.indices(shape)
        fine = np.empty((rows, columns))
        host_function("interpolated_nodes")(
            bits, column, row, field((west + x) * 2.0**bits, (south + y) * 2.0**bits), fine
        )
        y, x = np.indices(fine.shape)
        np.testing.assert_allclose(fine, field(column + x, row + y), rtol=0, atol=1e-12)
