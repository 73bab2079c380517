"""Noise: kernels against the reference, slopes against differences, even gradients; crests."""

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.terrain.octaves import NoiseStack, OctaveTable, fits_patches, octave_table
from sketchterrain.terrain.reference_noise import Slope, fbm_slope, gradients, ridged, ridged_slope
from sketchterrain.terrain.reference_relief import approached

from .conftest import octave_arguments

EXTENT = 4096.0
SIDE = 96


def table(octaves: int = 8) -> OctaveTable:
    return octave_table([NoiseStack("n", 1024.0, 0.5, most=octaves)], extent=EXTENT, seed=7)


def on_device(context, octaves, corner, step_bits) -> list[np.ndarray]:
    """Value and slopes of a patch whose south-west vertex is ``corner``, in steps."""
    real = context.real_dtype
    out = [context.empty(SIDE * SIDE, real) for _ in range(3)]
    context.launch(
        "bench.cl",
        "bench_fbm_slope",
        (SIDE, SIDE),
        *octave_arguments(context, octaves, corner, step_bits),
        np.int32(SIDE),
        *out,
    )
    return [context.download(buffer, (SIDE, SIDE), real) for buffer in out]


def test_kernel_is_the_reference(context, double_context) -> None:
    octaves = table()
    steps = np.arange(SIDE, dtype=np.int64)
    unit_slope = 0.5 / (1 << 15)  # of the finest octave
    corners = ((0, 0), (-70_001, 12_345), (3 * 10**9, -(10**9)))
    for corner, step_bits in itertools.product(corners, (2, 9, 13)):
        assert fits_patches(octaves, step_bits)
        x, y = np.meshgrid((corner[0] + steps) << step_bits, (corner[1] + steps) << step_bits)
        expected = fbm_slope(octaves, "n", x, y)
        # A fraction keeps 24 bits of a cell; slopes are that much less exact.
        for opened, tolerance in ((context, 1e-6), (double_context, 3e-7)):
            value, east, north = on_device(opened, octaves, corner, step_bits)
            np.testing.assert_allclose(value, expected.value, atol=tolerance, rtol=0)
            np.testing.assert_allclose(east, expected.east, atol=4 * tolerance * unit_slope, rtol=0)
            np.testing.assert_allclose(north, expected.north, atol=4 * tolerance * unit_slope, rtol=0)
    # 1024 m is 2^22 units, 2^32 skewed: that does not fit 32 bits.
    assert not fits_patches(octaves, 1)
    assert not fits_patches(octaves, 23)


def test_slopes_are_the_slopes_of_the_values() -> None:
    """Of ridged noise everywhere but at creases and where a weight is clamped: few places."""
    octaves = table()
    rng = np.random.default_rng(4)
    x, y = rng.integers(-(1 << 30), 1 << 30, (2, 2000))
    check_slopes(lambda dx, dy: fbm_slope(octaves, "n", x + dx, y + dy), 6)
    rng = np.random.default_rng(5)
    x, y = rng.integers(-(1 << 24), 1 << 24, (2, 2000))
    east, north = rng.normal(0, 1e5, (2, 2000))
    check_slopes(lambda dx, dy: ridged_slope(octaves, "n", x + dx, y + dy, east, north), 4, share=0.97)


def check_slopes(sample, bits: int, share: float = 1.0) -> None:
    """Central differences over a step h are off by h² times a third derivative."""
    h = 1 << bits
    here = sample(0, 0)
    east = (sample(h, 0).value - sample(-h, 0).value) / (2 * h)
    north = (sample(0, h).value - sample(0, -h).value) / (2 * h)
    for slope, difference in ((here.east, east), (here.north, north)):
        near = np.abs(slope - difference) < 1e-4 * np.abs(slope).max()
        assert near.mean() >= share


def test_no_pattern_shows_in_the_gradients() -> None:
    """Their power is spread evenly over all directions and lengths of waves: no mode stands out."""
    cell = np.arange(512, dtype=np.int64)
    gx, gy = gradients(*np.meshgrid(cell, cell), seed=12345)
    for part in (gx, gy, gx * gy, np.abs(gx) + np.abs(gy)):
        power = np.abs(np.fft.fft2(part - part.mean())) ** 2 / part.size / part.var()
        # Of white noise the greatest of 512² modes is about ln(512²) = 12.5; a pattern has hundreds.
        assert power.max() < 60
        assert abs(power[:16, :16].mean() - 1) < 0.3
    assert abs(np.corrcoef(gx.ravel(), gy.ravel())[0, 1]) < 0.01


KERNEL = """
__kernel void ridges(__global const int4 *octave_form, __global const long2 *octave_offset,
                     __global const REAL2 *octave_scale, __global const uint4 *octave_corner,
                     int octave_count, int side, REAL bend_east, REAL bend_north, __global REAL *out)
{
    const Octaves octaves = {octave_form, octave_offset, octave_scale, octave_corner, octave_count};
    const int column = get_global_id(0);
    const int row = get_global_id(1);
    const Place p = place_of(0, 0, 0, column, row, 0);
    const int count = side * side;
    __global REAL *at = out + row * side + column;
    const Slope s = ridged_slope(octaves, 0, octave_count, p, bend_east, bend_north);
    at[0] = ridged(octaves, 0, octave_count, p, bend_east, bend_north);
    at[count] = s.value;
    at[2 * count] = s.east;
    at[3 * count] = s.north;
}
"""
STEP_BITS = 9
CORNER = (-70_001, 12_345)
BEND = (70_000.0, -41_000.5)  # lattice units


@pytest.fixture
def ridges(with_kernel) -> Callable[[ComputeContext], np.ndarray]:
    """Value, value again and its slopes over a patch, on a device."""
    with_kernel("ridges.cl", "bench.cl", KERNEL)

    def run(context: ComputeContext) -> np.ndarray:
        real, octaves = context.real_dtype, table()
        out = context.empty((4, SIDE, SIDE), real)
        context.launch(
            "ridges.cl",
            "ridges",
            (SIDE, SIDE),
            *octave_arguments(context, octaves, CORNER, STEP_BITS),
            np.int32(SIDE),
            *map(real.type, BEND),
            out,
        )
        return context.download(out, (4, SIDE, SIDE), real)

    return run


def test_ridged_is_the_reference(context, double_context, ridges) -> None:
    steps = np.arange(SIDE, dtype=np.int64)
    x, y = np.meshgrid((CORNER[0] + steps) << STEP_BITS, (CORNER[1] + steps) << STEP_BITS)
    bend = (np.full(x.shape, value) for value in BEND)
    east, north = bend
    expected = ridged_slope(table(), "n", x, y, east, north)
    np.testing.assert_allclose(ridged(table(), "n", x, y, east, north), expected.value, atol=1e-12)
    unit_slope = 0.5 / (1 << 15)  # of the finest octave
    for opened, tolerance in ((context, 3e-6), (double_context, 1e-6)):
        value, again, to_east, to_north = ridges(opened)
        np.testing.assert_array_equal(value, again)
        np.testing.assert_allclose(value, expected.value, atol=tolerance, rtol=0)
        np.testing.assert_allclose(to_east, expected.east, atol=8 * tolerance * unit_slope, rtol=0)
        np.testing.assert_allclose(to_north, expected.north, atol=8 * tolerance * unit_slope, rtol=0)


def test_all_devices_ridge_bit_for_bit(ridges) -> None:
    first, *others = (ridges(ComputeContext(device)) for device in list_devices())
    for other in others:
        np.testing.assert_array_equal(first, other)


HALF = np.array([0.5, 0.3])  # in radii of the flanks
CREST = (*HALF, 1 / (HALF @ HALF), 0.3)
STEP = 1e-4
LEVEL = (Slope(0.0, 0.0, 0.0), Slope(0.0, 0.0, 0.0))


def seen(x: np.ndarray, y: np.ndarray) -> tuple[Slope, Slope]:
    return approached(np.stack([x, y]), 1 / 800, LEVEL, crest=CREST)


def test_slopes_are_those_of_differences() -> None:
    x, y = np.random.default_rng(1).uniform(-1600, 1600, (2, 4000))
    for number in (0, 1):
        here = seen(x, y)[number]
        for shift, slope in (((STEP, 0), here.east), ((0, STEP), here.north)):
            after = seen(x + shift[0], y + shift[1])[number].value
            before = seen(x - shift[0], y - shift[1])[number].value
            np.testing.assert_allclose((after - before) / (2 * STEP), slope, atol=1e-7)


def test_the_height_has_no_kink_where_the_crest_ends_and_is_round_without_one() -> None:
    end = 800 * HALF
    for beside in (-1e-6, 1e-6):
        x, y = (np.array([part * (1 + beside)]) for part in end)
        keep = seen(x, y)[1]
        np.testing.assert_allclose(keep.value, 1 - CREST[3], atol=1e-9)
        np.testing.assert_allclose([keep.east, keep.north], 0, atol=1e-7)
    x, y = np.random.default_rng(2).uniform(-1600, 1600, (2, 1000))
    away, keep = approached(np.stack([x, y]), 1 / 800, LEVEL)
    np.testing.assert_allclose(away.value, np.hypot(x, y) / 800, rtol=1e-14)
    assert (keep.value == 1).all()
    assert not np.any([keep.east, keep.north])
