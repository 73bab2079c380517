"""Other ways to compute noise, tiles and points; blue noise where the answer is known."""

import itertools

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import cKDTree

from sketchterrain.benchmarks import points as blue_noise
from sketchterrain.benchmarks.baselines import noise, numba_noise
from sketchterrain.benchmarks.baselines import points as other_points
from sketchterrain.benchmarks.baselines.noise import Absent
from sketchterrain.benchmarks.baselines.points import PhaseGroups, throw_darts
from sketchterrain.benchmarks.baselines.thesis import SplineSampling, ThesisTiles
from sketchterrain.benchmarks.noise import NoiseGrid
from sketchterrain.benchmarks.point_methods import HIGHEST, LOWEST, SIDE, fill_of, room_of, spectrum_of
from sketchterrain.benchmarks.poisson_disk import TRIALS, PoissonDisk
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.vegetation.poisson_grids import GREATEST_DENSITY

SETS = 20
IDEAL = -10.0 * np.log10(SETS)
RADIUS = 1 << 14  # lattice units


def white(count: int) -> list[npt.NDArray[np.float64]]:
    rng = np.random.default_rng(5)
    return [rng.random((count, 2)) * SIDE for _ in range(SETS)]


@pytest.mark.soak
def test_points_by_chance_have_power_1_and_the_anisotropy_of_chance():
    found = spectrum_of(white(2800))
    middle, power, anisotropy = found.bands()
    assert len(middle) == 30
    assert middle[0] == LOWEST + 1 / 16
    assert middle[-1] == HIGHEST - 1 / 16
    np.testing.assert_allclose(power, 1.0, atol=0.03)
    np.testing.assert_allclose(anisotropy, IDEAL, atol=0.7)
    assert found.points == 2800


@pytest.mark.soak
def test_a_jittered_grid_is_found_out():
    rng = np.random.default_rng(6)
    corner = np.stack(np.mgrid[0:SIDE, 0:SIDE], axis=-1).reshape(-1, 2)
    found = spectrum_of([corner + 0.5 * rng.random(corner.shape) for _ in range(SETS)])
    assert found.worst > 10.0
    # The tallest peaks stand at one wave a cell, along both axes.
    assert found.worst_frequency == pytest.approx(1.0, abs=0.1)
    middle = found.plane.shape[0] // 2
    peaks = {(0, SIDE), (0, -SIDE), (SIDE, 0), (-SIDE, 0)}
    largest = np.argsort(found.plane.ravel())[-4:]
    places = zip(*np.unravel_index(largest, found.plane.shape), strict=True)
    assert {(int(row) - middle, int(column) - middle) for row, column in places} == peaks


def test_the_distance_is_the_unit_and_points_outside_the_square_do_not_count():
    sets = white(60)[:6]
    small, large = spectrum_of(sets), spectrum_of([points * 8.0 for points in sets], 8.0)
    np.testing.assert_allclose(small.power, large.power, rtol=1e-6)
    more = [np.concatenate([points, points + SIDE, points - SIDE]) for points in sets]
    assert spectrum_of(more).points == 60


def test_darts_keep_their_distance_and_leave_no_room():
    for side in (3.0, 17.3):
        darts = throw_darts(side, seed=11)
        tree = cKDTree(darts, boxsize=np.full(2, side))
        assert ((darts >= 0.0) & (darts < side)).all(), side
        assert tree.query(darts, k=2)[0][:, 1].min() >= 1.0, side
        places = np.random.default_rng(12).random((100_000, 2)) * side
        assert tree.query(places)[0].max() < 1.0, side
        np.testing.assert_array_equal(darts, throw_darts(side, seed=11))


@pytest.fixture(scope="module")
def darts() -> list[npt.NDArray[np.float64]]:
    return [throw_darts(SIDE + 8.0, seed=seed) for seed in range(SETS)]


@pytest.mark.slow
def test_darts_are_as_dense_as_is_known(darts):
    density = np.mean([len(points) for points in darts]) / (SIDE + 8.0) ** 2
    assert density == pytest.approx(GREATEST_DENSITY, rel=3e-3)


@pytest.mark.slow
def test_the_programs_points_have_the_spectrum_of_darts(context, darts):
    area = (0, 0, SIDE * RADIUS, SIDE * RADIUS)
    own = spectrum_of(
        [PoissonDisk(context, RADIUS, seed=seed).within(area).position for seed in range(SETS)], RADIUS
    )
    # A thrower that stops when it has as many.
    count = round(own.points * (SIDE + 8.0) ** 2 / SIDE**2)
    reference = spectrum_of([points[:count] for points in darts])
    assert reference.worst < IDEAL + 0.7
    assert own.worst < -11.0
    assert own.power_difference(reference) < 0.05


@pytest.mark.soak
def test_levels_show_no_direction_either(context, darts):
    # One seed and many places: the world does not repeat itself.
    apart = 400 * RADIUS
    every, coarse = [], []
    world = PoissonDisk(context, RADIUS, seed=3, levels=1)
    for number in range(SETS):
        west = number * apart
        found = world.within((west, 0, west + 2 * SIDE * RADIUS, 2 * SIDE * RADIUS))
        place = found.position - (west, 0)
        every.append(place)
        coarse.append(place[found.level >= 1])
    for points, distance in ((every, RADIUS), (coarse, 2 * RADIUS)):
        spectrum = spectrum_of(points, distance)
        count = round(spectrum.points * (SIDE + 8.0) ** 2 / SIDE**2)
        reference = spectrum_of([thrown[:count] for thrown in darts])
        assert spectrum.worst < -11.0
        # Coarse points first, so neighbours stand a little otherwise than where darts come in any order.
        assert spectrum.power_difference(reference) < 0.2


def test_room_and_fill_of_known_points():
    inner = 16.0  # a side of 20 without two distances on either side
    room = room_of(np.array([[10.0, 10.0]]), 20.0, places=200_000, seed=1)
    assert room == pytest.approx(1.0 - np.pi / inner**2, abs=1e-3)
    # Points near the border do not count.
    grid = np.stack(np.meshgrid(np.arange(0.5, 20.0), np.arange(0.5, 20.0)), axis=-1).reshape(-1, 2)
    doubled = np.concatenate([grid, grid[grid[:, 0] < 2.0] + 0.1])
    assert fill_of(grid, 20.0) == pytest.approx(1.0 / GREATEST_DENSITY)
    assert fill_of(doubled, 20.0) == fill_of(grid, 20.0)


@pytest.mark.slow
def test_the_default_leaves_less_than_a_percent_of_room_and_fills_nine_tenths(context):
    _, points = blue_noise.own(context, 128.0, TRIALS).run(3)
    assert room_of(points, 128.0, places=200_000, seed=5) < 0.01
    assert fill_of(points, 128.0) >= 0.90


GRID_SIDE = 64


@pytest.fixture(scope="module")
def grid(context) -> NoiseGrid:
    grid = NoiseGrid(context, GRID_SIDE)
    grid.launch()
    return grid


@pytest.mark.parametrize(
    ("make", "bound"),
    [
        (noise.in_c, 0.0),
        (noise.in_numpy, 0.0),
        pytest.param(numba_noise.rival, 1e-6, marks=pytest.mark.slow),
        pytest.param(numba_noise.by_rows, 1e-6, marks=pytest.mark.slow),
    ],
)
def test_rivals_compute_the_same_sum(grid, make, bound):
    rival = make(grid.problem(2))
    if isinstance(rival, Absent):
        pytest.skip(rival.reason)
    found = rival.run()
    assert found.shape == (GRID_SIDE, GRID_SIDE)
    assert np.max(np.abs(found - grid.download())) <= bound


def test_missing_implementations_say_how_to_get_them(grid, monkeypatch):
    problem = grid.problem(1)
    for module in (numba_noise, other_points):
        monkeypatch.setattr(module, "find_spec", lambda name: None)
    monkeypatch.setattr(noise.shutil, "which", lambda name: None)
    monkeypatch.setattr(noise, "find_library", lambda name: None)
    for name in (noise.VARIABLE, other_points.NODE_MODULES, other_points.FASTER_POISSON):
        monkeypatch.delenv(name, raising=False)
    for absent, word in (
        (noise.in_c(problem), "path"),
        (numba_noise.rival(problem), "sketchterrain[peers]"),
        (noise.in_fastnoise2(problem), noise.VARIABLE),
        (other_points.in_numba(), "sketchterrain[peers]"),
        (other_points.in_rust(), other_points.FASTER_POISSON),
        (other_points.in_node(), "n"),
    ):
        assert isinstance(absent, Absent)
        assert word in absent.reason


@pytest.mark.slow
def test_thesis_tiles_meet_and_agree_with_their_double_build(context, world):
    keys = [(5, 16, 16), (5, 17, 16)]
    heights = {}
    for real in ("float", "double"):
        opened = TimedContext(str(context.device.index), real=real)
        tiles = ThesisTiles(world.recipe, opened, keys)
        tiles.launch(SplineSampling(16, 5))
        heights[real] = tiles.heights()
        west, east = heights[real]
        assert west.shape == (65, 65)
        assert np.max(np.abs(west[:, -1] - east[:, 0])) < 1e-2
    assert np.max(np.abs(heights["float"] - heights["double"])) < 1e-2


def nearest(points: npt.NDArray[np.floating]) -> float:
    return float(cKDTree(points).query(points, k=2)[0][:, 1].min())


def test_phase_groups_keep_their_distance(context):
    for levels, rounds, distance in itertools.product([1, 3], [False, True], [1.0, 8.0]):
        case = f"{levels} levels, rounds {rounds}, distance {distance}"
        groups = PhaseGroups(context, 96.0, distance, 4, levels=levels, rounds=rounds)
        first = groups.points(3)
        assert (first >= 0.0).all(), case
        assert (first < 96.0).all(), case
        assert nearest(first) >= distance * (1.0 - 1e-5), case
        assert len(first) > 0.8 * GREATEST_DENSITY * (96.0 / distance) ** 2, case
        # The counter's order differs from run to run, the set does not; and a run leaves nothing to the next.
        once, again, other = (
            {tuple(p) for p in found.tolist()} for found in (first, groups.points(3), groups.points(4))
        )
        assert once == again, case
        assert once.isdisjoint(other), case
