"""Gullies: they run downhill, keep what is level, are limited to what cells can carry, and have slopes."""

import numpy as np

from sketchterrain.terrain import TerrainRecipe
from sketchterrain.terrain.evaluation import Evaluator
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.octaves import NoiseStack, octave_table
from sketchterrain.terrain.packing import pack_world
from sketchterrain.terrain.reference import reference_ground, reference_slope
from sketchterrain.terrain.reference_gullies import gullies
from sketchterrain.terrain.reference_noise import Slope
from sketchterrain.terrain.reference_relief import Rise

from .conftest import feature

EXTENT = 4096.0
UNIT = metres_per_unit(EXTENT)
SHARP = 0.35
MOST = 1 + SHARP / 2  # of an octave's depth


def mountain(**more: float) -> np.ndarray:
    return feature("mountain", 2000, 2000, 1400, 1000, peakiness=0.6, **more)


def grid(side: int, metres: float, *, x: float = 1000.0, y: float = 1200.0) -> tuple[np.ndarray, np.ndarray]:
    step = np.arange(side) * metres
    columns, rows = np.meshgrid(x + step, y + step)
    return tuple(np.rint(each.ravel() / UNIT).astype(np.int64) for each in (columns, rows))  # type: ignore[return-value]


def plane(recipe: TerrainRecipe, side: int, metres: float, slope: tuple[float, float], octaves: int) -> Slope:
    """The gullies of a plane."""
    world = pack_world(recipe, 0.5, real=np.float64)
    table = octave_table([NoiseStack("gully", EXTENT / 16, 0.45, most=octaves)], extent=EXTENT, seed=5)
    x, y = grid(side, metres)
    ones = np.ones(x.shape)
    rise = Rise(Slope(ones, slope[0] * ones, slope[1] * ones), ones, 1e4 * ones)
    return gullies(world.scalars[0], table, x, y, rise)


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


def test_no_direction_of_the_lattice_shows(make_recipe) -> None:
    """Gullies are as deep whichever way the plane leans."""
    deep = [
        plane(make_recipe(), 128, 16.0, (0.8 * np.cos(a), 0.8 * np.sin(a)), 2).value.std()
        for a in np.linspace(0, np.pi, 9)[:-1]
    ]
    assert np.std(deep) < 0.08 * np.mean(deep)


def test_summits_and_feet_stay(make_recipe) -> None:
    eroded, plain = (make_recipe(mountain(erosion=e, gullies=0.5), fidelity=1.0) for e in (1.0, 0.0))
    x, y = grid(120, 24.0, x=600, y=600)
    change = (
        reference_ground(eroded, x, y, cell_size=8.0).height
        - reference_ground(plain, x, y, cell_size=8.0).height
    )
    slope = np.hypot(*reference_slope(plain, x, y, cell_size=8.0)[1:])
    depth = 0.165 * EXTENT / 8 / (1 - 0.45)
    assert np.abs(change).max() < MOST * depth
    assert np.abs(change[slope < 0.1]).max() < 0.15 * np.abs(change).max()
    assert abs(change.mean()) < 0.15 * np.abs(change).max()


def test_octaves_below_two_cells_are_left_out(make_recipe, context) -> None:
    """No octave below two cells; full detail is off by no more than the depths of those left out."""
    recipe = make_recipe(
        mountain(erosion=1.0, gullies=0.5), ground={"relief": 0.0, "wavelength": 1600.0, "roughness": 0.45}
    )
    x, y = grid(60, 40.0)
    evaluator = Evaluator(recipe, context)
    whole, _ = evaluator.points(x, y, cell_size=0.0)
    for cell in (4.0, 16.0, 64.0):
        world = pack_world(recipe, cell, real=np.float64)
        kept = world.octaves.scale[slice(*world.octaves.ranges["gully"])]
        assert np.all(UNIT / kept[:, 1] > 2 * cell)
        all_of_them = pack_world(recipe, 0.0, real=np.float64).octaves
        lost = 0.0
        for stack, most in (("gully", MOST), ("crag", 1.0)):
            first, last = world.octaves.ranges[stack]
            tail = all_of_them.scale[slice(*all_of_them.ranges[stack]), 0].sum()
            depth = float(world.scalars[0][f"{stack}_depth"])
            lost += most * depth * (tail - world.octaves.scale[first:last, 0].sum())
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


def test_slopes_are_the_slopes_of_the_heights(make_recipe, double_context) -> None:
    """Without gullies exactly: through warp, profiles, joins, and noise."""
    recipe = make_recipe(
        mountain(),
        feature("mountain", 2900, 2500, 900, 700, peakiness=0.1),
        feature("hill", 900, 2900, 700, 200),
        feature("hill", 1200, 2500, 600, 150),
    )
    x, y = grid(60, 45.0, x=300, y=300)
    analytic = np.stack(reference_slope(recipe, x, y, cell_size=8.0)[1:])
    error = np.abs(analytic - differences(recipe, double_context, x, y, 0.25))
    assert np.percentile(error, 99) < 1e-3
    assert error.max() < 0.02  # where two curves of a profile meet


def test_slopes_of_gullies_are_close_enough_to_steer_by(make_recipe, double_context) -> None:
    recipe = make_recipe(mountain(erosion=0.7, gullies=0.5))
    x, y = grid(60, 45.0, x=700, y=700)
    analytic = np.stack(reference_slope(recipe, x, y, cell_size=8.0)[1:])
    true = differences(recipe, double_context, x, y, 0.25)
    assert np.corrcoef(analytic.ravel(), true.ravel())[0, 1] > 0.7


def test_no_erosion_is_no_gullies_to_the_bit(make_recipe, context) -> None:
    x, y = grid(64, 40.0, x=600, y=600)
    none, without = (
        Evaluator(make_recipe(mountain(erosion=0.0, gullies=width)), context).points(x, y, cell_size=4.0)[0]
        for width in (0.0, 0.5)
    )
    np.testing.assert_array_equal(none, without)
    world = pack_world(make_recipe(mountain()), 4.0, real=np.float64)
    still = Rise(Slope(*np.ones((3, *x.shape))), np.zeros(x.shape), np.full(x.shape, 1e4))
    assert not np.any(np.stack(gullies(world.scalars[0], world.octaves, x, y, still)))


def test_heights_are_finite(make_recipe, context) -> None:
    """At centres and borders, of the smallest and the steepest, and where many stand on one place."""
    rows = [
        feature("mountain", 2048, 2048, radius, strength, peakiness=peak, erosion=1.0, gullies=1.0)
        for radius, strength, peak in ((0.1, 9000, 1.0), (40, 9000, 1.0), (900, 9000, 0.0), (900, 9000, 1.0))
    ]
    rows += [
        feature("hill", 2048, 2048, 300, height, erosion=1.0, gullies=1.0) for height in (0.0, 1e-6, 2000)
    ]
    recipe = make_recipe(*rows)
    near = np.rint((2048 + np.linspace(-1000, 1000, 401)) / UNIT).astype(np.int64)
    x, y = (each.ravel() for each in np.meshgrid(near, near[::40]))
    for cell in (0.0, 8.0, 64.0):
        height, masks = Evaluator(recipe, context).points(x, y, cell_size=cell)
        assert np.isfinite(height).all()
        assert np.isfinite(masks).all()
