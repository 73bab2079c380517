"""Registry of the benchmarks: every one describes itself, every kernel is timed."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest

from sketchterrain.benchmarks import BENCHMARKS
from sketchterrain.benchmarks.charts import CHARTS
from sketchterrain.benchmarks.effort import FULL, QUICK
from sketchterrain.benchmarks.kernel_times import WRITTEN
from sketchterrain.benchmarks.registry import choose
from sketchterrain.errors import InputError
from sketchterrain.resources import preset_names


def test_every_benchmark_describes_itself_and_charts_and_efforts_name_known_ones() -> None:
    for name, benchmark in BENCHMARKS.items():
        assert benchmark.name == name
        assert benchmark.surface
        assert benchmark.seed
        assert re.search(r"second|time|nanoseconds|Milliseconds", benchmark.method)
        assert "." in benchmark.method

    assert set(CHARTS) <= set(BENCHMARKS)
    for effort in (QUICK, FULL):
        assert effort.presets == preset_names()


def test_benchmarks_are_chosen_by_name_in_the_order_of_the_registry() -> None:
    assert [b.name for b in choose([])] == list(BENCHMARKS)
    assert [b.name for b in choose(["tiles", "noise", "tiles"])] == ["noise", "tiles"]
    with pytest.raises(InputError) as caught:
        choose(["noise", "nothing"])
    line = str(caught.value)
    assert "'nothing'" in line
    assert all(name in line for name in BENCHMARKS)
    assert "\n" not in line


def test_every_kernel_is_timed() -> None:
    found = {
        name
        for file in files("sketchterrain.kernels").iterdir()
        if file.name.endswith((".cl", ".clh"))
        for name in re.findall(
            r"\b__?kernel\s+(?:\w+(?:\(\(.*?\)\))?\s+)*?void\s+(\w+)", file.read_text(encoding="utf-8")
        )
    }
    # These decide on a device, and on how OpenGL gets what it writes; they make no terrain.
    assert found == set(WRITTEN) | {"self_test", "probe"}
