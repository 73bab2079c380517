"""The table of benchmarks says what each one is, and none and no kernel is forgotten."""

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


def test_every_benchmark_names_surface_seed_and_method() -> None:
    assert list(BENCHMARKS) == [
        "kernels",
        "speed",
        "noise",
        "tiles",
        "culling",
        "parts",
        "features",
        "adherence",
        "sketch",
        "foliage",
        "points",
        "splines",
        "flight",
        "live",
        "pictures",
        "erosion",
        "meshes",
        "batch",
        "world",
        "packing",
        "trace",
        "accuracy",
    ]
    for name, benchmark in BENCHMARKS.items():
        assert benchmark.name == name
        assert benchmark.surface
        assert benchmark.seed
        assert re.search(r"second|time|nanoseconds|Milliseconds", benchmark.method)
        assert "." in benchmark.method


def test_no_name_means_all_and_names_run_once_in_the_tables_order() -> None:
    assert [b.name for b in choose([])] == list(BENCHMARKS)
    assert [b.name for b in choose(["tiles", "noise", "tiles"])] == ["noise", "tiles"]


def test_unknown_name_is_refused_with_the_list() -> None:
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


def test_charts_belong_to_benchmarks() -> None:
    assert set(CHARTS) <= set(BENCHMARKS)


@pytest.mark.parametrize("effort", [QUICK, FULL], ids=["quick", "full"])
def test_efforts_cover_every_preset(effort: object) -> None:
    assert getattr(effort, "presets") == preset_names()  # noqa: B009
