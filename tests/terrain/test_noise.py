"""Noise: kernels against the reference, slopes against differences, and even gradients."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.octaves import NoiseStack, fits_patches, octave_table
from sketchterrain.terrain.reference_noise import fbm_slope, gradients, ridged_slope

from .conftest import octave_arguments

if TYPE_CHECKING:
    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain.octaves import OctaveTable

EXTENT = 4096.0
SIDE = 96


def table(octaves: int = 8) -> OctaveTable:
    return octave_table([NoiseStack("n", 1024.0, 0.5, most=octaves)], extent=EXTENT, seed=7)


def on_device(
    context: ComputeContext, octaves: OctaveTable, corner: tuple[int, int], step_bits: int
) -> list[np.ndarray]:
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


def test_kernel_is_the_reference(context: ComputeContext, double_context: ComputeContext) -> None:
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
