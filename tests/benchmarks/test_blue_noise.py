"""The benchmark of scattered points: its measures where the answer is known, and what its tables compare."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sketchterrain.benchmarks import blue_noise, charts
from sketchterrain.benchmarks.baselines.dart_thrower import throw_darts
from sketchterrain.benchmarks.blue_noise import DARTS, GTX_580
from sketchterrain.benchmarks.point_ways import OURS, THESIS, TURNS, fill_of, room_of
from sketchterrain.terrain.poisson import GREATEST_DENSITY, TRIALS

if TYPE_CHECKING:
    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.outcome import Outcome
    from sketchterrain.benchmarks.timing import TimedContext


@pytest.fixture(scope="module")
def outcome(context: TimedContext, tiny: Effort) -> Outcome:
    return blue_noise.measure(context, tiny)


def rows(outcome: Outcome, table: int) -> list[Any]:
    return list(outcome.tables[table].rows)


def test_room_and_fill_of_known_points() -> None:
    inner = 16.0  # a side of 20 without two distances on either side
    room = room_of(np.array([[10.0, 10.0]]), 20.0, places=200_000, seed=1)
    assert room == pytest.approx(1.0 - np.pi / inner**2, abs=1e-3)
    # Points near the border do not count.
    grid = np.stack(np.meshgrid(np.arange(0.5, 20.0), np.arange(0.5, 20.0)), axis=-1).reshape(-1, 2)
    doubled = np.concatenate([grid, grid[grid[:, 0] < 2.0] + 0.1])
    assert fill_of(grid, 20.0) == pytest.approx(1.0 / GREATEST_DENSITY)
    assert fill_of(doubled, 20.0) == fill_of(grid, 20.0)


@pytest.mark.slow
def test_darts_fill_all_and_leave_no_room() -> None:
    darts = throw_darts(60.0, seed=4)
    assert room_of(darts, 60.0, places=50_000, seed=2) == 0.0
    assert fill_of(darts, 60.0) == pytest.approx(1.0, abs=0.02)
    fewer = darts[: len(darts) // 2]
    assert fill_of(fewer, 60.0) == pytest.approx(0.5, abs=0.03)
    assert room_of(fewer, 60.0, places=50_000, seed=2) > 0.15


@pytest.mark.slow
def test_table_6_1_compares_both_ways(outcome: Outcome, tiny: Effort) -> None:
    assert sorted(GTX_580) == [(r, k) for r in (1, 2, 4, 8) for k in (4, 8, 12)]
    assert (GTX_580[1, 4], GTX_580[8, 12]) == (8.03, 0.32)
    found = rows(outcome, 0)
    assert [(row["distance"], row["trials"]) for row in found] == [
        (r, k) for r in tiny.point_distances for k in tiny.point_trials
    ]
    for row in found:
        assert row["over_gtx"] == pytest.approx(row["million_per_s"] / row["gtx_million_per_s"])
        assert row["over_thesis"] > 0.0
        expected = GREATEST_DENSITY * (tiny.point_side / row["distance"]) ** 2
        assert 0.6 * expected < row["points"] < 1.1 * expected
        assert 0.6 * expected < row["thesis_points"] < 1.3 * expected


@pytest.mark.slow
def test_more_darts_leave_less_room(outcome: Outcome, tiny: Effort) -> None:
    ours = [row for row in rows(outcome, 1) if row["way"] == OURS]
    assert [row["trials"] for row in ours] == sorted({*tiny.room_trials, TRIALS})
    assert [row["trials"] for row in ours if row["note"]] == [TRIALS]
    room = [row["room"] for row in ours]
    assert room == sorted(room, reverse=True)
    assert room[0] > room[-1]
    fill = [row["fill"] for row in ours]
    assert fill == sorted(fill)


@pytest.mark.slow
def test_rivals_are_compared_with_as_full_a_set(outcome: Outcome) -> None:
    found = [row for row in rows(outcome, 1) if "median_ms" in row]
    ours = {row["trials"]: row for row in found if row["way"] == OURS}
    others = [row for row in found if row["way"] != OURS]
    assert {THESIS} < {row["way"] for row in others}
    for row in others:
        equal = ours[row["equal_trials"]]
        assert (equal["fill"] >= row["fill"]) == (row["note"] is None)
        # Slow ways are compared with the rounds that they took part in.
        shared = min(len(row["seconds"]), len(equal["seconds"]))
        ratio = np.median(row["seconds"][:shared]) / np.median(equal["seconds"][:shared])
        assert row["ours_over_it"] == pytest.approx(ratio * equal["points"] / row["points"])
    assert any(row["way"].startswith("scipy") and row["asked"] == 1000.0 for row in others)


@pytest.mark.slow
def test_the_default_leaves_less_than_a_percent_of_room_and_fills_nine_tenths(
    context: TimedContext,
) -> None:
    _, points = blue_noise.own(context, 128.0, TRIALS).run(3)
    assert room_of(points, 128.0, places=200_000, seed=5) < 0.01
    assert fill_of(points, 128.0) >= 0.90


@pytest.mark.slow
def test_spectra_begin_with_the_reference(outcome: Outcome, tiny: Effort) -> None:
    found = rows(outcome, 2)
    assert [row["way"] for row in found[:4]] == [DARTS, OURS, THESIS, TURNS]
    assert found[0]["fill"] == pytest.approx(1.0, abs=0.02)
    assert found[0]["power_difference"] == 0.0
    for row in found:
        assert row["sets"] == tiny.spectrum_sets
        assert len(row["frequency"]) == len(row["power"]) == len(row["anisotropy"]) == 30
        assert row["worst"] == max(row["anisotropy"])


@pytest.mark.slow
def test_many_points_are_timed_whole_and_by_launches(outcome: Outcome, tiny: Effort) -> None:
    found = rows(outcome, 3)
    assert [row["side"] for row in found[::2]] == list(tiny.point_sides)
    for row in found:
        assert row["points"] > 0.6 * GREATEST_DENSITY * row["side"] ** 2
        assert row["launch_million_per_s"] > row["million_per_s"] > 0.0


@pytest.mark.slow
def test_charts_show_what_was_asked(outcome: Outcome) -> None:
    pytest.importorskip("matplotlib")
    drawn = charts.draw("points", outcome)
    assert set(drawn) == {f"{name}.{kind}" for name in ("", "-room", "-spectra") for kind in ("png", "svg")}
    assert b"GTX 580" in drawn[".svg"]
    assert b"default" in drawn["-room.svg"]
