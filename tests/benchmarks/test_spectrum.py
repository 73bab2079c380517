"""Other ways to compute noise and points; the spectrum of the program's points."""

import numpy as np
import numpy.typing as npt
import pytest

from sketchterrain.benchmarks import points as blue_noise
from sketchterrain.benchmarks.baselines import noise
from sketchterrain.benchmarks.baselines import points as other_points
from sketchterrain.benchmarks.baselines.noise import Absent
from sketchterrain.benchmarks.baselines.points import throw_darts
from sketchterrain.benchmarks.noise import NoiseGrid
from sketchterrain.benchmarks.point_methods import SIDE, fill_of, room_of, spectrum_of
from sketchterrain.benchmarks.poisson_disk import TRIALS, PoissonDisk

SETS = 20
IDEAL = -10.0 * np.log10(SETS)
RADIUS = 1 << 14  # lattice units


@pytest.fixture(scope="module")
def darts() -> list[npt.NDArray[np.float64]]:
    return [throw_darts(SIDE + 8.0, seed=seed) for seed in range(SETS)]


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


@pytest.mark.parametrize("make", [noise.in_c, noise.in_numpy])
def test_rivals_compute_the_same_sum(grid, make):
    rival = make(grid.problem(2))
    if isinstance(rival, Absent):
        pytest.skip(rival.reason)
    found = rival.run()
    assert found.shape == (GRID_SIDE, GRID_SIDE)
    np.testing.assert_array_equal(found, grid.download())


def test_missing_implementations_say_how_to_get_them(grid, monkeypatch):
    problem = grid.problem(1)
    monkeypatch.setattr(other_points, "find_spec", lambda name: None)
    monkeypatch.setattr(noise.shutil, "which", lambda name: None)
    monkeypatch.setattr(noise, "find_library", lambda name: None)
    for name in (noise.VARIABLE, other_points.NODE_MODULES, other_points.FASTER_POISSON):
        monkeypatch.delenv(name, raising=False)
    for absent, word in (
        (noise.in_c(problem), "path"),
        (noise.in_fastnoise2(problem), noise.VARIABLE),
        (other_points.in_numba(), "sketchterrain[peers]"),
        (other_points.in_rust(), other_points.FASTER_POISSON),
        (other_points.in_node(), "n"),
    ):
        assert isinstance(absent, Absent)
        assert word in absent.reason
