"""Laps, rounds, their statistics, and the tiles that are timed."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.benchmarks.grounds import BARE, central_keys, open_ground, scattered_keys
from sketchterrain.benchmarks.timing import Lap, Launch, TimedContext, alternate, lap, spread


def test_spread_is_the_median_and_the_95th_percentile() -> None:
    for samples, median, p95 in (
        ([float(number) for number in range(1, 102)], 51.0, 96.0),
        ([0.25], 0.25, 0.25),
        ([1.0] * 20, 1.0, 1.0),
    ):
        times = spread(samples)
        assert (times.median, times.p95, times.count) == (median, p95, len(samples))
    outlier = spread([1.0] * 18 + [9.0] * 2)
    assert outlier.median == 1.0
    assert outlier.p95 > 1.0


def test_rivals_alternate_and_device_time_is_the_sum_of_the_launches() -> None:
    calls: list[str] = []

    def work(name: str) -> Lap:
        calls.append(name)
        return Lap(float(len(calls)))

    laps = alternate({"a": lambda: work("a"), "b": lambda: work("b")}, rounds=3)
    assert calls == list("ab" + "ab" + "ba" + "ab")
    assert [one.wall for one in laps["a"]] == [3.0, 6.0, 7.0]
    assert [one.wall for one in laps["b"]] == [4.0, 5.0, 8.0]

    one = Lap(1.0, (Launch("a", 8, 0.25), Launch("b", 8, 0.5)))
    assert one.device == 0.75
    assert lap(lambda: None).launches == ()


def test_context_counts_the_items_of_each_launch(context: TimedContext) -> None:
    sums = context.empty(8 * 8, np.float32)
    octaves = (
        context.upload(np.zeros((1, 4), np.int32)),
        context.upload(np.zeros((1, 2), np.int64)),
        context.upload(np.zeros((1, 2), np.float32)),
    )
    place = (context.upload(np.full((1, 4), 10, np.uint32)), np.int32(1), np.int32(8))

    def work() -> None:
        context.launch("bench.cl", "bench_fbm", (8, 8), *octaves, *place, sums)
        context.launch("bench.cl", "bench_fbm", (8, 4), *octaves, *place, sums)

    for _ in range(2):  # a lap forgets the launches before it
        one = context.lap(work)
        assert [(launch.kernel, launch.items) for launch in one.launches] == [
            ("bench_fbm", 64),
            ("bench_fbm", 32),
        ]
        assert one.device == pytest.approx(sum(launch.seconds for launch in one.launches))
        assert all(launch.seconds >= 0 for launch in one.launches)


def test_tiles_of_a_level_are_chosen_in_the_middle_or_at_random(context: TimedContext) -> None:
    assert central_keys(2, 4) == [(2, 1, 1), (2, 2, 1), (2, 1, 2), (2, 2, 2)]
    assert len(set(central_keys(5, 256))) == 256
    terrain = open_ground(BARE, context)
    keys = scattered_keys(6, 20, terrain, seed=1)
    assert keys == scattered_keys(6, 20, terrain, seed=1)
    assert len(set(keys)) == 20
    assert all(0 <= column < 64 and 0 <= row < 64 for _, column, row in keys)
    assert len(scattered_keys(1, 20, terrain, seed=1)) == 4
