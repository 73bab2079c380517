"""Noise and gullies: kernels against the host, slopes against differences; crests."""

import itertools

import numpy as np

from sketchterrain.terrain.evaluator import Evaluator
from sketchterrain.terrain.host_heights import host_samples, host_slope
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.layers.point_site import distance_to_crest
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.layers.relief_host import ErodibleHeight, gullies
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

from .conftest import feature, octave_arguments

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


HALF = np.array([0.5, 0.3])  # in radii of the flanks
CREST = (*HALF, 1 / (HALF @ HALF), 0.3)
STEP = 1e-4
LEVEL = (ValueSlope(0.0, 0.0, 0.0), ValueSlope(0.0, 0.0, 0.0))


def distance_at(x: np.ndarray, y: np.ndarray) -> tuple[ValueSlope, ValueSlope]:
    return distance_to_crest(np.stack([x, y]), 1 / 800, LEVEL, crest=CREST)


def test_slopes_of_crests_equal_differences() -> None:
    x, y = np.random.default_rng(1).uniform(-1600, 1600, (2, 4000))
    for number in (0, 1):
        here = distance_at(x, y)[number]
        for shift, slope in (((STEP, 0), here.east), ((0, STEP), here.north)):
            after = distance_at(x + shift[0], y + shift[1])[number].value
            before = distance_at(x - shift[0], y - shift[1])[number].value
            np.testing.assert_allclose((after - before) / (2 * STEP), slope, atol=1e-7)


def test_the_height_has_no_kink_where_the_crest_ends_and_is_round_without_one() -> None:
    end = 800 * HALF
    for beside in (-1e-6, 1e-6):
        x, y = (np.array([part * (1 + beside)]) for part in end)
        share = distance_at(x, y)[1]
        np.testing.assert_allclose(share.value, 1 - CREST[3], atol=1e-9)
        np.testing.assert_allclose([share.east, share.north], 0, atol=1e-7)
    x, y = np.random.default_rng(2).uniform(-1600, 1600, (2, 1000))
    away, share = distance_to_crest(np.stack([x, y]), 1 / 800, LEVEL)
    np.testing.assert_allclose(away.value, np.hypot(x, y) / 800, rtol=1e-14)
    assert (share.value == 1).all()
    assert not np.any([share.east, share.north])


UNIT = metres_per_unit(EXTENT)
SHARP = 0.35
MOST = 1 + SHARP / 2  # of an octave's depth


def mountain(**more: float) -> np.ndarray:
    return feature("mountain", 2000, 2000, 1400, 1000, peakiness=0.6, **more)


def grid(side: int, metres: float, *, x: float = 1000.0, y: float = 1200.0) -> tuple[np.ndarray, np.ndarray]:
    step = np.arange(side) * metres
    columns, rows = np.meshgrid(x + step, y + step)
    return tuple(np.rint(each.ravel() / UNIT).astype(np.int64) for each in (columns, rows))  # type: ignore[return-value]


def plane(
    recipe: TerrainRecipe, side: int, metres: float, slope: tuple[float, float], octaves: int
) -> ValueSlope:
    """The gullies of a plane."""
    table = octave_table([NoiseStack("gully", EXTENT / 16, 0.45, most=octaves)], extent=EXTENT, seed=5)
    x, y = grid(side, metres)
    ones = np.ones(x.shape)
    rise = ErodibleHeight(ValueSlope(ones, slope[0] * ones, slope[1] * ones), ones, 1e4 * ones)
    return gullies(recipe[ReliefLayer].scale(recipe.world), table, x, y, rise)


def test_gullies_run_down_the_gradient(make_recipe) -> None:
    """Along the slope of a plane the first gullies hardly change; across it they go up and down."""
    side, metres = 160, 8.0
    for bearing in (0, 30, 45, 75, 100, 161):
        down = np.array([np.cos(np.deg2rad(bearing)), np.sin(np.deg2rad(bearing))])
        cut = plane(make_recipe(), side, metres, tuple(0.8 * down), 1)
        rows, columns = np.gradient(cut.value.reshape(side, side), metres)
        along = columns * down[0] + rows * down[1]
        across = columns * down[1] - rows * down[0]
        assert np.mean(along**2) < 0.15 * np.mean(across**2), bearing
        assert cut.value.std() > 5, bearing
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


def test_gullies_are_isotropic(make_recipe) -> None:
    """Gullies are equally deep whatever the direction of the slope."""
    deep = [
        plane(make_recipe(), 128, 16.0, (0.8 * np.cos(a), 0.8 * np.sin(a)), 2).value.std()
        for a in np.linspace(0, np.pi, 9)[:-1]
    ]
    assert np.std(deep) < 0.08 * np.mean(deep)


def test_erosion_preserves_summits_and_feet(make_recipe) -> None:
    eroded, plain = (make_recipe(mountain(erosion=e, gullies=0.5), fidelity=1.0) for e in (1.0, 0.0))
    x, y = grid(120, 24.0, x=600, y=600)
    change = np.subtract(*(host_samples(each, x, y, cell_size=8.0).height for each in (eroded, plain)))
    slope = np.hypot(*host_slope(plain, x, y, cell_size=8.0)[1:])
    depth = 0.165 * EXTENT / 8 / (1 - 0.45)
    assert np.abs(change).max() < MOST * depth
    assert np.abs(change[slope < 0.1]).max() < 0.15 * np.abs(change).max()
    assert abs(change.mean()) < 0.15 * np.abs(change).max()


def test_octaves_below_two_cells_are_omitted(make_recipe, context) -> None:
    """Full detail differs by at most the depths of the omitted octaves."""
    recipe = make_recipe(
        mountain(erosion=1.0, gullies=0.5), ground={"relief": 0.0, "wavelength": 1600.0, "roughness": 0.45}
    )
    x, y = grid(60, 40.0)
    evaluator = Evaluator(recipe, context)
    whole, _ = evaluator.points(x, y, cell_size=0.0)
    for cell in (4.0, 16.0, 64.0):
        octaves, all_of_them = (recipe.sampling(size).octaves for size in (cell, FINEST_CELL))
        resolved = octaves.scale[slice(*octaves.ranges["gully"])]
        assert np.all(UNIT / resolved[:, 1] > 2 * cell)
        scale = recipe[ReliefLayer].scale(recipe.world)
        lost = 0.0
        for stack, most in (("gully", MOST), ("crag", 1.0)):
            first, last = octaves.ranges[stack]
            tail = all_of_them.scale[slice(*all_of_them.ranges[stack]), 0].sum()
            depth = getattr(scale, f"{stack}_depth")
            lost += most * depth * (tail - octaves.scale[first:last, 0].sum())
        part, _ = evaluator.points(x, y, cell_size=cell)
        # Crags weigh the slope of all gullies, so that what is lost of these matters to them too.
        assert np.abs(whole - part).max() <= 1.5 * lost + 1e-3


def differences(recipe, context, x, y, step) -> np.ndarray:
    """Slopes eastward and northward by central differences over ``step`` m each way, cells of 8 m."""
    evaluator, units = Evaluator(recipe, context), round(step / UNIT)
    found = []
    for dx, dy in ((units, 0), (0, units)):
        ahead, behind = (evaluator.points(x + s * dx, y + s * dy, cell_size=8.0)[0] for s in (1, -1))
        found.append((ahead - behind) / (2 * units * UNIT))
    return np.stack(found)


def test_slopes_of_the_terrain_equal_differences(make_recipe, double_context) -> None:
    """Without gullies exactly: through warp, profiles, joins, and noise."""
    recipe = make_recipe(
        mountain(),
        feature("mountain", 2900, 2500, 900, 700, peakiness=0.1),
        feature("hill", 900, 2900, 700, 200),
        feature("hill", 1200, 2500, 600, 150),
    )
    x, y = grid(60, 45.0, x=300, y=300)
    analytic = np.stack(host_slope(recipe, x, y, cell_size=8.0)[1:])
    error = np.abs(analytic - differences(recipe, double_context, x, y, 0.25))
    assert np.percentile(error, 99) < 1e-3
    assert error.max() < 0.02  # where two curves of a profile meet
    # Those of gullies are close enough to steer by.
    recipe = make_recipe(mountain(erosion=0.7, gullies=0.5))
    x, y = grid(60, 45.0, x=700, y=700)
    analytic = np.stack(host_slope(recipe, x, y, cell_size=8.0)[1:])
    true = differences(recipe, double_context, x, y, 0.25)
    assert np.corrcoef(analytic.ravel(), true.ravel())[0, 1] > 0.7


def test_without_erosion_there_are_no_gullies(make_recipe, context) -> None:
    x, y = grid(64, 40.0, x=600, y=600)
    none, without = (
        Evaluator(make_recipe(mountain(erosion=0.0, gullies=width)), context).points(x, y, cell_size=4.0)[0]
        for width in (0.0, 0.5)
    )
    np.testing.assert_array_equal(none, without)
    recipe = make_recipe(mountain())
    still = ErodibleHeight(ValueSlope(*np.ones((3, *x.shape))), np.zeros(x.shape), np.full(x.shape, 1e4))
    scale, octaves = recipe[ReliefLayer].scale(recipe.world), recipe.sampling(4.0).octaves
    assert not np.any(np.stack(gullies(scale, octaves, x, y, still)))


def test_heights_are_finite(make_recipe, context) -> None:
    """At centres and borders, of the smallest and the steepest, and where many overlap."""
    steep = {"erosion": 1.0, "gullies": 1.0}
    sizes = ((0.1, 1.0), (40, 1.0), (900, 0.0), (900, 1.0))
    rows = [feature("mountain", 2048, 2048, radius, 9000, peakiness=p, **steep) for radius, p in sizes]
    recipe = make_recipe(*rows, *(feature("hill", 2048, 2048, 300, h, **steep) for h in (0.0, 1e-6, 2000)))
    near = np.rint((2048 + np.linspace(-1000, 1000, 401)) / UNIT).astype(np.int64)
    x, y = (each.ravel() for each in np.meshgrid(near, near[::40]))
    for cell in (0.0, 8.0, 64.0):
        height, masks = Evaluator(recipe, context).points(x, y, cell_size=cell)
        assert np.isfinite(height).all()
        assert np.isfinite(masks).all()
