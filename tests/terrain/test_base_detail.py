"""Detail below real elevation: kernel against the host, bounds, strength, and what it restores of a DEM."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.detail_law import DetailLaw
from sketchterrain.io.resources import kernel_arguments
from sketchterrain.terrain.layers.base import BaseDetail, DetailScale
from sketchterrain.terrain.layers.layer import HostSite, Sampling, WorldSettings
from sketchterrain.terrain.noise import FINEST_CELL, ValueSlope, octave_table

WORLD = WorldSettings(20000.0, 3, 1.0)
LAW = DetailLaw(30.0, 2.0, 1.4, (0.9, 1.2, 0.8), 0.4)
KERNEL = """
__kernel void detail_at(int count, WORLD_ARGUMENTS, BASE_DETAIL_ARGUMENTS, __global const long2 *at,
                        __global const REAL *slope, __global const REAL *data, __global REAL *detail)
{
    const int i = get_global_id(0);
    if (i >= count) return;
    BASE_DETAIL_COLLECT
    const Octaves octaves = {octave_form, octave_offset, octave_scale};
    const ValueSlope z = {R(0), slope[2 * i], slope[2 * i + 1]};
    const DetailScale scale = {data[3 * i], data[3 * i + 1], data[3 * i + 2]};
    detail[i] = base_detail_at(octaves, *world, base_detail, lattice_point(at[i].s0, at[i].s1), z, scale);
}
"""


def sampling_of(detail: BaseDetail, cell: float, real: Any = np.float64) -> Sampling:
    tables = [
        octave_table([detail.stack(WORLD)], extent=WORLD.extent, seed=WORLD.seed, cell_size=size)
        for size in (cell, FINEST_CELL)
    ]
    return Sampling(WORLD, cell, *tables, np.dtype(real))


def points(count: int, seed: int = 1) -> tuple[Any, Any, ValueSlope, DetailScale]:
    """Return places, slopes of the data from level to cliffs, and scales of grids of 8 to 90 m."""
    rng = np.random.default_rng(seed)
    x, y = rng.integers(-(1 << 24), 1 << 25, (2, count))
    steep, bearing = 2.0 * rng.random(count) ** 2, 2 * np.pi * rng.random(count)
    z = ValueSlope(np.zeros(count), steep * np.cos(bearing), steep * np.sin(bearing))
    resolution = 36.0 * 10.0 ** rng.random(count)
    return x, y, z, DetailScale(resolution, 0.5 + rng.random(count), 3.0 + 6.0 * rng.random(count))


def on_device(context, with_kernel, detail: BaseDetail, cell: float, at) -> Float64Array:
    with_kernel("detail.cl", "layers/base_detail.clh", KERNEL)
    x, y, z, data = at
    sampling = sampling_of(detail, cell, context.real_dtype)
    units = {"metres_per_unit": sampling.unit, "units_per_metre": 1 / sampling.unit, "inverse_cell": 1 / cell}
    world = sampling.struct("world.clh", "World", units | {"mottle_first": 0, "mottle_last": 0})
    octaves = sampling.octaves
    arrays = detail.pack(sampling) | {
        "world": world,
        "octave_form": octaves.form,
        "octave_offset": octaves.offset,
        "octave_scale": octaves.scale.astype(context.real_dtype),
    }
    names = kernel_arguments("world.clh", "WORLD_ARGUMENTS")
    names += kernel_arguments("layers/base_detail.clh", "BASE_DETAIL_ARGUMENTS")
    real = [np.stack(each, axis=-1).astype(context.real_dtype) for each in (z[1:], data)]
    given = [*(arrays[name] for name in names), np.stack([x, y], axis=-1), *real]
    found = context.empty(len(x), context.real_dtype)
    context.launch("detail.cl", "detail_at", (len(x),), np.int32(len(x)), *map(context.upload, given), found)
    return np.asarray(context.download(found, len(x), context.real_dtype), np.float64)


@pytest.mark.parametrize("cell", [0.2, 4.0, 40.0])
def test_kernel_equals_the_host(context, double_context, with_kernel, cell) -> None:
    detail, at = BaseDetail(LAW), points(4000)
    expected = detail.heights(HostSite(sampling_of(detail, cell), *at[:2]), *at[2:])
    assert expected.std() > 0.5
    for device, tolerance in ((context, 3e-3), (double_context, 1e-4)):
        found = on_device(device, with_kernel, detail, cell, at)
        np.testing.assert_allclose(found, expected, atol=tolerance, rtol=0)


def test_heights_move_by_less_than_the_bound(context, with_kernel) -> None:
    x, y, z, data = points(3000)
    data = DetailScale(data.resolution, 20.0 * np.asarray(data.depth), data.bound)
    for found in (
        on_device(context, with_kernel, BaseDetail(LAW), 1.0, (x, y, z, data)),
        BaseDetail(LAW).heights(HostSite(sampling_of(BaseDetail(LAW), 1.0), x, y), z, data),
    ):
        assert (np.abs(found) <= data.bound).all()
        assert (np.abs(found) > 0.8 * np.asarray(data.bound)).any()


def test_there_is_none_at_strength_0_on_level_ground_and_where_nothing_was_lost(context, with_kernel) -> None:
    x, y, z, data = points(500)
    none = BaseDetail(LAW, strength=0.0)
    assert not on_device(context, with_kernel, none, 1.0, (x, y, z, data)).any()
    assert not none.heights(HostSite(sampling_of(none, 1.0), x, y), z, data).any()
    level = ValueSlope(z.value, 0.0 * z.east, 0.0 * z.north)
    assert not on_device(context, with_kernel, BaseDetail(LAW), 1.0, (x, y, level, data)).any()
    zero = DetailLaw(30.0)
    scale = BaseDetail(LAW).scale(zero, None, WORLD)
    at = (x, y, z, DetailScale(*(np.full(500, each) for each in scale)))
    assert not on_device(context, with_kernel, BaseDetail(zero), 1.0, at).any()


def test_detail_has_the_rms_that_was_lost_at_any_resolution() -> None:
    """Whatever the octaves' wavelengths are: on slopes where the square amplitude is 1."""
    detail = BaseDetail(replace(LAW, shape=(1.0, 1.0, 1.0)))
    x, y, z, _ = points(10000)
    z = ValueSlope(z.value, np.full(10000, 0.3), np.full(10000, -0.4))
    site = HostSite(sampling_of(detail, FINEST_CELL), x, y)
    for step in (30.0, 36.0, 43.0, 52.0):
        law = replace(detail.law, step=step, lost=1.5)
        found = detail.heights(site, z, detail.scale(law, None, WORLD))
        assert found.std() == pytest.approx(1.5, rel=0.1), step
        # A declared accuracy limits both.
        found = detail.heights(site, z, detail.scale(law, 1.0, WORLD))
        assert found.std() == pytest.approx(0.25, rel=0.1), step
        assert np.abs(found).max() < 1.0


def test_octaves_set_in_smoothly_where_the_resolution_changes() -> None:
    """From grid to grid: steps of the detail, and of its slope, fall with those of the resolution."""
    detail, jumps = BaseDetail(LAW), []
    for count in (1000, 2000, 4000):
        at = np.full(count, 123456789)
        z = ValueSlope(*(np.full(count, each) for each in (0.0, 0.3, 0.2)))
        data = DetailScale(np.linspace(30.0, 600.0, count), np.ones(count), np.full(count, 50.0))
        found = detail.heights(HostSite(sampling_of(detail, FINEST_CELL), at, at), z, data)
        jumps.append((np.abs(np.diff(found)).max(), np.abs(np.diff(found, 2)).max()))
    (one, bend), (half, half_bend), (quarter, quarter_bend) = jumps
    assert half < 0.6 * one
    assert quarter < 0.6 * half
    assert half_bend < 0.35 * bend
    assert quarter_bend < 0.35 * half_bend


@pytest.mark.parametrize("cell", [0.5, 8.0, 30.0, 200.0])
def test_omitted_detail_is_bounded(cell) -> None:
    detail, (x, y, z, data) = BaseDetail(LAW), points(3000)
    full, coarse = sampling_of(detail, FINEST_CELL), sampling_of(detail, cell)
    exact = detail.heights(HostSite(full, x, y), z, data)
    for turned, slope in ((False, z), (True, ValueSlope(z.value, -z.north, 0.5 * z.east))):
        bound, most = detail.omitted(coarse, data, np.full(len(x), turned))
        assert (np.abs(exact - detail.heights(HostSite(coarse, x, y), slope, data)) <= bound).all()
        assert (np.abs(exact) <= most).all()
    same, _ = detail.omitted(full, data, np.zeros(len(x), bool))
    assert not same.any()
