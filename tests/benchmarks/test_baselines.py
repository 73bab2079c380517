"""Other ways to compute noise and tiles: they agree, and those missing on a machine are named."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pytest

from sketchterrain.benchmarks.baselines import c_noise, fastnoise2, numba_noise, numpy_noise
from sketchterrain.benchmarks.baselines.problem import Absent, in_threads
from sketchterrain.benchmarks.baselines.thesis import Sampling, ThesisTiles
from sketchterrain.benchmarks.grounds import BARE, central_keys, open_ground
from sketchterrain.benchmarks.noise import NoiseGrid
from sketchterrain.benchmarks.timing import TimedContext

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.benchmarks.baselines.problem import NoiseProblem, Rival

SIDE = 64


@pytest.fixture(scope="module")
def grid(context: TimedContext) -> NoiseGrid:
    grid = NoiseGrid(context, SIDE)
    grid.launch()
    return grid


@pytest.mark.parametrize(
    ("make", "bound"),
    [(c_noise.rival, 0.0), (numpy_noise.rival, 0.0), (numba_noise.rival, 1e-6), (numba_noise.by_rows, 1e-6)],
)
def test_rivals_compute_the_same_sum(
    grid: NoiseGrid, make: Callable[[NoiseProblem], Rival | Absent], bound: float
) -> None:
    rival = make(grid.problem(2))
    if isinstance(rival, Absent):
        pytest.skip(rival.reason)
    found = rival.run()
    assert found.shape == (SIDE, SIDE)
    assert np.max(np.abs(found - grid.download())) <= bound


def test_fastnoise2_fills_the_grid(grid: NoiseGrid) -> None:
    rival = fastnoise2.rival(grid.problem(2))
    if isinstance(rival, Absent):
        pytest.skip(rival.reason)
    found = rival.run()
    assert found.shape == (SIDE, SIDE)
    assert np.ptp(found) > 0.1
    assert np.all(np.abs(found) < 2)


def test_missing_implementations_say_how_to_get_them(
    grid: NoiseGrid, monkeypatch: pytest.MonkeyPatch
) -> None:
    problem = grid.problem(1)
    monkeypatch.setattr(c_noise.shutil, "which", lambda name: None)
    monkeypatch.setattr(numba_noise, "find_spec", lambda name: None)
    monkeypatch.setattr(fastnoise2, "find_library", lambda name: None)
    monkeypatch.delenv(fastnoise2.VARIABLE, raising=False)
    absent = [module.rival(problem) for module in (c_noise, numba_noise, fastnoise2)]
    assert all(isinstance(one, Absent) for one in absent)
    reasons = [one.reason for one in absent if isinstance(one, Absent)]
    assert "path" in reasons[0]
    assert "pip install numba" in reasons[1]
    assert fastnoise2.VARIABLE in reasons[2]
    monkeypatch.undo()
    monkeypatch.setenv(fastnoise2.VARIABLE, __file__)  # no library
    rival = fastnoise2.rival(problem)
    assert isinstance(rival, Absent)
    assert "does not work" in rival.reason


def test_bands_cover_every_row_and_the_thesis_works_without_features(context: TimedContext) -> None:
    seen: list[int] = []
    in_threads(lambda first, last: seen.extend(range(first, last)), side=7, threads=3)
    assert sorted(seen) == list(range(7))

    tiles = ThesisTiles(open_ground(BARE, context).recipe, context, central_keys(3, 4))
    tiles.launch(Sampling(8, 1))
    found = tiles.heights()
    assert np.all(np.isfinite(found))
    assert np.ptp(found) > 1.0


def test_thesis_tiles_meet_and_agree_with_their_double_build(context: TimedContext) -> None:
    keys = [(5, 16, 16), (5, 17, 16)]
    heights = {}
    for real in ("float", "double"):
        opened = TimedContext(str(context.device.index), real=real)
        tiles = ThesisTiles(open_ground("valley_river", opened).recipe, opened, keys)
        tiles.launch(Sampling(16, 5))
        heights[real] = tiles.heights()
        west, east = heights[real]
        assert west.shape == (65, 65)
        assert np.max(np.abs(west[:, -1] - east[:, 0])) < 1e-2
    assert np.max(np.abs(heights["float"] - heights["double"])) < 1e-2
