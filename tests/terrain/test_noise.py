"""Noise and gullies: kernels against the host, slopes against differences."""

import itertools

import numpy as np

from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.terrain.layers.layer import HostSite
from sketchterrain.terrain.layers.relief import ReliefLayer, gullies
from sketchterrain.terrain.noise import (
    FINEST_CELL,
    NoiseStack,
    OctaveTable,
    ValueSlope,
    fbm_slope,
    fits_patches,
    gradients,
    octave_table,
)
from sketchterrain.terrain.recipe import TerrainRecipe

from .conftest import octave_arguments

EXTENT = 4096.0
SIDE = 96


def table(octaves: int = 8) -> OctaveTable:
    return octave_table([NoiseStack("n", 1024.0, 0.5, most=octaves)], extent=EXTENT, seed=7)


def on_device(context, octaves, corner, step_bits) -> list[np.ndarray]:
    """Return value and slopes of a patch whose south-west vertex is ``corner``, in steps."""
    real, given = context.real_dtype, octave_arguments(context, octaves, corner, step_bits)
    out = [context.empty(SIDE * SIDE, real) for _ in range(3)]
    context.launch("baselines/bench.cl", "bench_fbm_slope", (SIDE, SIDE), *given, np.int32(SIDE), *out)
    return [context.download(buffer, (SIDE, SIDE), real) for buffer in out]


def test_kernel_equals_host_noise(context, double_context) -> None:
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


def test_slopes_of_noise_equal_differences() -> None:
    octaves = table()
    rng = np.random.default_rng(4)
    x, y = rng.integers(-(1 << 30), 1 << 30, (2, 2000))

    def sample(dx: int, dy: int) -> ValueSlope:
        return fbm_slope(octaves, "n", x + dx, y + dy)

    h, here = 1 << 6, sample(0, 0)
    # Central differences over a step h are off by h² times a third derivative.
    east = (sample(h, 0).value - sample(-h, 0).value) / (2 * h)
    north = (sample(0, h).value - sample(0, -h).value) / (2 * h)
    for slope, difference in ((here.east, east), (here.north, north)):
        assert (np.abs(slope - difference) < 1e-4 * np.abs(slope).max()).all()


def test_gradients_have_a_white_spectrum() -> None:
    """Their power is even over all directions and wavelengths: no mode stands out."""
    cell = np.arange(512, dtype=np.int64)
    gx, gy = gradients(*np.meshgrid(cell, cell), seed=12345)
    for part in (gx, gy, gx * gy, np.abs(gx) + np.abs(gy)):
        power = np.abs(np.fft.fft2(part - part.mean())) ** 2 / part.size / part.var()
        # Of white noise the greatest of 512² modes is about ln(512²) = 12.5; a pattern has hundreds.
        assert power.max() < 60
        assert abs(power[:16, :16].mean() - 1) < 0.3
    assert abs(np.corrcoef(gx.ravel(), gy.ravel())[0, 1]) < 0.01


UNIT = metres_per_unit(EXTENT)


def grid(side: int, metres: float, *, x: float = 1000.0, y: float = 1200.0) -> tuple[np.ndarray, np.ndarray]:
    step = np.arange(side) * metres
    columns, rows = np.meshgrid(x + step, y + step)
    return tuple(np.rint(each.ravel() / UNIT).astype(np.int64) for each in (columns, rows))  # type: ignore[return-value]


def plane(
    recipe: TerrainRecipe, side: int, metres: float, slope: tuple[float, float], octaves: int
) -> ValueSlope:
    """The gullies of a plane."""
    table = octave_table([NoiseStack("gully", EXTENT / 16, 0.45, most=octaves)], extent=EXTENT, seed=5)
    site = HostSite(recipe.sampling(FINEST_CELL), *grid(side, metres))
    ones = np.ones(site.x.shape)
    rise = ValueSlope(ones, slope[0] * ones, slope[1] * ones)
    return gullies(recipe[ReliefLayer].scale(recipe.world), table, site, rise, ones)


def test_gullies_run_down_the_gradient(make_recipe) -> None:
    """Along the slope of a plane the first gullies hardly change; across it they go up and down."""
    side, metres, deep = 160, 8.0, []
    for bearing in (0, 30, 45, 75, 100, 161):
        down = np.array([np.cos(np.deg2rad(bearing)), np.sin(np.deg2rad(bearing))])
        cut = plane(make_recipe(), side, metres, tuple(0.8 * down), 1)
        rows, columns = np.gradient(cut.value.reshape(side, side), metres)
        along = columns * down[0] + rows * down[1]
        across = columns * down[1] - rows * down[0]
        assert np.mean(along**2) < 0.15 * np.mean(across**2), bearing
        deep.append(cut.value.std())
    assert min(deep) > 0.5
    assert np.std(deep) < 0.1 * np.mean(deep)  # whatever the direction
    # A level plane keeps its height to the bit.
    assert not np.any(np.stack(plane(make_recipe(), 16, 50.0, (0.0, 0.0), 4)))


def test_finer_gullies_turn_into_wider_ones(make_recipe) -> None:
    """They run down the sides of the wider gullies: no more straight down the plane."""
    side, metres = 160, 2.0
    alone, both = (plane(make_recipe(), side, metres, (0.8, 0.0), count).value for count in (1, 2))
    fine = (both - alone).reshape(side, side)
    rows, columns = np.gradient(fine, metres)
    turned = np.mean(columns**2) / np.mean(rows**2)
    assert 0.1 < turned < 1


def test_slopes_of_splines_equal_differences(make_recipe) -> None:
    """The slope that gullies follow is that of the displaced nodes."""
    recipe = make_recipe()
    x, y = grid(60, 45.0)
    units = round(0.25 / UNIT)

    def smooth(dx: int, dy: int) -> ValueSlope:
        return recipe[ReliefLayer].smooth(HostSite(recipe.sampling(8.0), x + dx * units, y + dy * units))[0]

    here = smooth(0, 0)
    for slope, ahead, behind in ((here.east, (1, 0), (-1, 0)), (here.north, (0, 1), (0, -1))):
        difference = (smooth(*ahead).value - smooth(*behind).value) / (2 * units * UNIT)
        np.testing.assert_allclose(slope, difference, atol=2e-3)
