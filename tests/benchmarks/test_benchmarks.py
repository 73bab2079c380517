"""Every benchmark once, as small as possible: what it reports, never how long it took."""

from __future__ import annotations

import contextlib
import io
import json
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from sketchterrain.benchmarks import BENCHMARKS, batches, charts, pictures, worlds
from sketchterrain.benchmarks.accuracy import DOUBLE, FLOAT, NUMPY
from sketchterrain.benchmarks.choices import SUBJECTS
from sketchterrain.benchmarks.grounds import BARE
from sketchterrain.benchmarks.kernel_times import WRITTEN
from sketchterrain.benchmarks.outcome import Outcome
from sketchterrain.cli import main
from sketchterrain.sketch import Sketch, save_sketch
from sketchterrain.terrain.plant import STOREYS

if TYPE_CHECKING:
    from collections.abc import Sequence
    from pathlib import Path

    from sketchterrain.benchmarks.effort import Effort
    from sketchterrain.benchmarks.timing import TimedContext


BEST = 0.4
"""The best quality of pictures here; the program's own takes three times as long."""
DEFAULT = ("noise", "splines")
"""Benchmarks of the default tier."""


class Outcomes(dict[str, Outcome]):
    """Of each benchmark, measured when a test wants it: tests of several processes share the work."""

    def __init__(self, context: TimedContext, effort: Effort, small: Path) -> None:
        super().__init__()
        self._given, self._small = (context, effort), small

    def __missing__(self, name: str) -> Outcome:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(batches, "_run", commanded)
            patch.setattr(batches, "SKETCH", str(self._small))
            patch.setattr(pictures, "BEST", BEST)
            patch.setattr(worlds, "_run", written)
            patch.setattr(worlds, "SKETCH", str(self._small))
            self[name] = BENCHMARKS[name].measure(*self._given)
        return self[name]


def commanded(words: Sequence[str]) -> None:
    """Do here what the benchmark does in a process of its own, whose start would take most of the time."""
    assert main(words) == 0


def written(words: Sequence[str]) -> dict[str, Any]:
    """Write a world here, and return what the program tells of it."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        assert main(words) == 0
    found: dict[str, Any] = json.loads(told.getvalue())
    return found


@pytest.fixture(scope="module")
def outcomes(
    context: TimedContext, tiny: Effort, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Outcome]:
    small = tmp_path_factory.mktemp("sketches") / "small"
    save_sketch(Sketch(extent=256.0, layers={"mountain": np.eye(32, dtype=np.uint8)}), small)
    return Outcomes(context, tiny, small)


def rows(outcome: Outcome, table: int = 0) -> list[Any]:
    return list(outcome.tables[table].rows)


@pytest.mark.parametrize(
    "name", [name if name in DEFAULT else pytest.param(name, marks=pytest.mark.slow) for name in BENCHMARKS]
)
def test_every_shown_value_is_there_and_finite(outcomes: dict[str, Outcome], name: str) -> None:
    for table in outcomes[name].tables:
        assert table.rows
        for column in table.columns:
            assert any(column.key in row for row in table.rows), column.key
        for row in table.rows:
            assert all(math.isfinite(v) for v in row.values() if isinstance(v, float))
            assert all(len(v) >= 2 for v in row.values() if isinstance(v, list))


@pytest.mark.slow
def test_every_kernel_was_timed_with_its_bytes(outcomes: dict[str, Outcome]) -> None:
    found = rows(outcomes["kernels"])
    assert {row["kernel"] for row in found} == set(WRITTEN)
    assert {row["ground"] for row in found if row["kernel"] == "patches"} == {BARE, "valley_river"}
    for row in found:
        rate = row["million_items_per_s"] * WRITTEN[row["kernel"]] * 1e-3
        assert row["gigabytes_per_s"] == pytest.approx(rate)
        assert row["p95_ms"] >= row["median_ms"]


def test_noise_kernel_agrees_with_numpy(outcomes: dict[str, Outcome]) -> None:
    kernel, download, numpy = rows(outcomes["noise"])
    assert kernel["worst"] == download["worst"] < 1e-5
    assert numpy["of_numpy"] == 1.0


@pytest.mark.slow
def test_batches_larger_than_the_ground_are_left_out(outcomes: dict[str, Outcome]) -> None:
    assert [(row["ground"], row["batch"]) for row in rows(outcomes["tiles"])] == [(BARE, 1), (BARE, 4)]


@pytest.mark.slow
def test_parts_are_those_of_the_ground(outcomes: dict[str, Outcome]) -> None:
    found = rows(outcomes["parts"])
    assert [row["part"] for row in found] == [
        *("mountain", "hill", "forest", "erosion"),
        *("lakes", "rivers", "rules"),
    ]
    assert all(row["tiles"] == 1 for row in found)


@pytest.mark.slow
def test_features_report_each_stage(outcomes: dict[str, Outcome]) -> None:
    found = {row["stage"]: row["found"] for row in rows(outcomes["features"])}
    assert list(found) == ["shapes", "darts", "place", "rivers", "recipe"]
    assert found["recipe"] == found["place"] + found["rivers"]
    assert found["darts"] == found["place"] >= found["shapes"] > 0


@pytest.mark.slow
def test_plants_are_counted_by_storey(outcomes: dict[str, Outcome], tiny: Effort) -> None:
    found = rows(outcomes["foliage"])
    assert [row["storey"] for row in found] == list(STOREYS) * len(tiny.presets)
    assert any(row["plants"] > 0 for row in found)
    for row in found:
        assert row["thousand_plants_per_s"] == pytest.approx(row["plants"] / row["median_ms"])
        assert row["hectares_per_s"] == pytest.approx((row["side"] / 100.0) ** 2 / row["median_ms"] * 1e3)


@pytest.mark.slow
def test_errors_of_float_exceed_those_of_double(outcomes: dict[str, Outcome]) -> None:
    found = rows(outcomes["accuracy"])
    assert {row["method"] for row in found} == {FLOAT, DOUBLE, NUMPY}
    for level in {row["level"] for row in found}:
        single, double = (
            next(r for r in found if r["method"] == m and r["level"] == level) for m in (FLOAT, DOUBLE)
        )
        assert 0 < single["height_p99_mm"] <= single["height_mm"] < 10.0
        assert double["normal_p99_deg"] < single["normal_p99_deg"] < 0.1
        assert 0 <= single["material"] < 1e-2


@pytest.mark.slow
def test_every_choice_has_one_way_that_is_used(outcomes: dict[str, Outcome]) -> None:
    found = rows(outcomes["accuracy"], 1)
    assert list(dict.fromkeys(row["subject"] for row in found)) == list(SUBJECTS)
    for subject in SUBJECTS:
        assert sum(row["chosen"] == "yes" for row in found if row["subject"] == subject) == 1
    error = {(row["subject"], row["choice"]): row["error"] for row in found}
    assert error["octaves", "all octaves"] == 0.0
    assert error["octaves", "cells of 16 m"] > error["octaves", "cells of 4 m"] > 0
    assert error["normals", "analytic"] < error["normals", "differences, 1 m"]
    assert error["precision", "float64"] < error["precision", "float32"] < 1.0
    assert error["culling", "all of the reach"] == 0.0


@pytest.mark.slow
def test_flight_compares_every_way_at_every_setting(outcomes: dict[str, Outcome], tiny: Effort) -> None:
    points, generation, drawn, reached, first = (rows(outcomes["flight"], table) for table in range(5))
    measured = [row for row in points if "most_px" in row]
    for row in measured:
        assert 0 < row["most_px"] <= row["worst_px"]
        assert row["triangles"] > 0
    for way in {row["way"] for row in measured}:
        coarse, fine = sorted((r for r in measured if r["way"] == way), key=lambda r: r["triangles"])
        assert fine["most_px"] <= coarse["most_px"]
    assert {row["way"] for row in reached} == {row["way"] for row in measured}
    settings = len(tiny.flight_own_pixels) + len(tiny.flight_factors)
    assert len(generation) == settings * len(tiny.flight_quads)
    assert len(first) == 3 * len(tiny.flight_quads)
    assert len(drawn) == 1
    for row in generation:
        assert 0 <= row["updating_ms"] <= row["worst_ms"]
        assert len(row["seconds"]) == tiny.flight_frames


@pytest.mark.slow
def test_pictures_are_compared_with_the_best(outcomes: dict[str, Outcome], tiny: Effort) -> None:
    qualities, parts = (rows(outcomes["pictures"], table) for table in range(2))
    assert [row["number"] for row in qualities] == [*tiny.picture_numbers, BEST]
    assert qualities[-1]["still_difference"] == 0.0
    assert all(row["still_difference"] > 0.0 for row in qualities[:-1])
    assert all(row["still_ms"] > 0.0 and row["moving_ms"] > 0.0 for row in qualities)
    assert [row["part"] for row in parts] == list(tiny.picture_parts)
    assert all(row["difference"] >= 0.0 for row in parts)


@pytest.mark.slow
def test_packing_shows_what_worlds_use_among_other_ways(outcomes: dict[str, Outcome]) -> None:
    found = rows(outcomes["packing"])
    for layer in ("height", "normal", "materials"):
        mine = [row for row in found if row["layer"] == layer]
        assert [bool(row["used"]) for row in mine].count(True) == 1
        assert len(mine) > 4
    steps = rows(outcomes["packing"], 1)
    assert [row["share"] for row in steps] == sorted((row["share"] for row in steps), reverse=True)
    assert steps[0]["share"] == 1 > steps[1]["share"]


@pytest.mark.slow
@pytest.mark.parametrize("name", charts.CHARTS)
def test_charts_are_pictures(outcomes: dict[str, Outcome], name: str) -> None:
    pytest.importorskip("matplotlib")
    pictures = charts.draw(name, outcomes[name])
    assert pictures[".png"].startswith(b"\x89PNG")
    assert b"<svg" in pictures[".svg"]
    assert pictures == charts.draw(name, outcomes[name])
