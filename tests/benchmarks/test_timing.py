"""Laps, rounds and what is said of them."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.benchmarks.timing import Lap, Launch, TimedContext, alternate, lap, spread


def test_spread_of_known_samples() -> None:
    times = spread([float(number) for number in range(1, 102)])
    assert (times.median, times.p95, times.count) == (51.0, 96.0, 101)


def test_spread_of_one_sample() -> None:
    times = spread([0.25])
    assert (times.median, times.p95, times.count) == (0.25, 0.25, 1)


def test_outlier_moves_the_percentile_but_not_the_median() -> None:
    calm, disturbed = spread([1.0] * 20), spread([1.0] * 18 + [9.0] * 2)
    assert calm.median == disturbed.median == 1.0
    assert disturbed.p95 > calm.p95


def test_rivals_warm_up_once_and_then_alternate() -> None:
    calls: list[str] = []

    def work(name: str) -> Lap:
        calls.append(name)
        return Lap(float(len(calls)))

    laps = alternate({"a": lambda: work("a"), "b": lambda: work("b")}, rounds=3)
    assert calls == list("ab" + "ab" + "ba" + "ab")
    assert [one.wall for one in laps["a"]] == [3.0, 6.0, 7.0]
    assert [one.wall for one in laps["b"]] == [4.0, 5.0, 8.0]


def test_device_time_is_the_sum_of_the_launches() -> None:
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
