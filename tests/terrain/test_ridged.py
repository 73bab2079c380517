"""Ridged noise on the device is what NumPy float64 says it is, and its slopes too."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from sketchterrain import resources
from sketchterrain.compute import ComputeContext, list_devices
from sketchterrain.terrain.reference_noise import ridged, ridged_slope

from .conftest import octave_arguments
from .test_noise import SIDE, table

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

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
def ridges(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[ComputeContext], np.ndarray]]:
    """Value, value again and its slopes over a patch, on a device."""
    source = resources.source
    monkeypatch.setattr(
        resources,
        "source",
        lambda name: source("bench.cl") + KERNEL if name == "ridges.cl" else source(name),
    )

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


def test_ridged_is_the_reference(
    context: ComputeContext, double_context: ComputeContext, ridges: Callable[[ComputeContext], np.ndarray]
) -> None:
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


def test_all_devices_ridge_bit_for_bit(ridges: Callable[[ComputeContext], np.ndarray]) -> None:
    first, *others = (ridges(ComputeContext(device)) for device in list_devices())
    for other in others:
        np.testing.assert_array_equal(first, other)
