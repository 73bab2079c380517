"""Other ways to compute noise, tiles and points: they agree, and those missing on a machine are named."""

import itertools

import numpy as np
import numpy.typing as npt
import pytest
from scipy.spatial import cKDTree

from sketchterrain.benchmarks.baselines import noise, numba_noise, points
from sketchterrain.benchmarks.baselines.noise import Absent
from sketchterrain.benchmarks.baselines.points import PhaseGroups
from sketchterrain.benchmarks.baselines.thesis import Sampling, ThesisTiles
from sketchterrain.benchmarks.noise import NoiseGrid
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.vegetation.poisson_grids import GREATEST_DENSITY

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
    for module in (numba_noise, points):
        monkeypatch.setattr(module, "find_spec", lambda name: None)
    monkeypatch.setattr(noise.shutil, "which", lambda name: None)
    monkeypatch.setattr(noise, "find_library", lambda name: None)
    for name in (noise.VARIABLE, points.NODE_MODULES, points.FASTER_POISSON):
        monkeypatch.delenv(name, raising=False)
    for absent, word in (
        (noise.in_c(problem), "path"),
        (numba_noise.rival(problem), "sketchterrain[peers]"),
        (noise.in_fastnoise2(problem), noise.VARIABLE),
        (points.in_numba(), "sketchterrain[peers]"),
        (points.in_rust(), points.FASTER_POISSON),
        (points.in_node(), "n"),
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
        tiles.launch(Sampling(16, 5))
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
