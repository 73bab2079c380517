"""Other ways to scatter points: all keep their distance and fill the square, and missing ones are named."""

from __future__ import annotations

import itertools
from typing import TYPE_CHECKING

import pytest
from scipy.spatial import cKDTree

from sketchterrain.benchmarks.baselines import bridson
from sketchterrain.benchmarks.baselines.phase_groups import PhaseGroups
from sketchterrain.benchmarks.baselines.problem import Absent
from sketchterrain.benchmarks.spectrum import SETS, SIDE, spectrum_of
from sketchterrain.terrain.poisson import GREATEST_DENSITY

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy as np
    import numpy.typing as npt

    from sketchterrain.benchmarks.baselines.bridson import Scatterer
    from sketchterrain.benchmarks.timing import TimedContext


def nearest(points: npt.NDArray[np.floating]) -> float:
    return float(cKDTree(points).query(points, k=2)[0][:, 1].min())


def test_phase_groups_keep_their_distance(context: TimedContext) -> None:
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


@pytest.mark.slow
def test_more_darts_fill_more(context: TimedContext) -> None:
    counts = [len(PhaseGroups(context, 128.0, 1.0, trials).points(1)) for trials in (1, 4, 12)]
    assert counts == sorted(counts)
    assert counts[2] > 0.88 * GREATEST_DENSITY * 128.0**2


@pytest.mark.slow
def test_the_thesis_needs_levels_and_turns_for_its_spectrum(context: TimedContext) -> None:
    def worst(levels: int, *, rounds: bool) -> float:
        groups = PhaseGroups(context, SIDE + 8.0, 1.0, 4, levels=levels, rounds=rounds)
        return spectrum_of([groups.points(seed) - 4.0 for seed in range(SETS)]).worst

    assert worst(1, rounds=False) > 0.0
    assert worst(3, rounds=True) < -12.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("make", "side"),
    [(bridson.in_numba, 64.0), (bridson.in_rust, 64.0), (bridson.in_node, 64.0), (bridson.in_scipy, 12.0)],
)
def test_scatterers_keep_their_distance(make: Callable[[], Scatterer | Absent], side: float) -> None:
    scatterer = make()
    if isinstance(scatterer, Absent):
        pytest.skip(scatterer.reason)
    taken, points = scatterer.scatter(side, 20, 5)
    assert taken.wall > 0.0
    assert ((points >= 0.0) & (points < side)).all()
    assert nearest(points) >= 1.0 - 1e-12
    assert len(points) > 0.8 * GREATEST_DENSITY * side**2


def test_absent_scatterers_say_how_to_get_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridson, "find_spec", lambda name: None)
    monkeypatch.delenv(bridson.NODE_MODULES, raising=False)
    monkeypatch.delenv(bridson.FASTER_POISSON, raising=False)
    missing = (
        (bridson.in_numba, "pip install numba"),
        (bridson.in_rust, bridson.FASTER_POISSON),
        (bridson.in_node, "n"),
    )
    for make, word in missing:
        absent = make()
        assert isinstance(absent, Absent)
        assert word in absent.reason
    monkeypatch.setattr(bridson.shutil, "which", lambda name: "node")
    absent = bridson.in_node()
    assert isinstance(absent, Absent)
    assert bridson.NODE_MODULES in absent.reason
