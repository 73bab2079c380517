"""Registry, timing, tables, small measures, and pictures of the documentation that benchmarks draw."""

import io
import math
import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from PIL import Image
from rich.console import Console

from sketchterrain.benchmarks import BENCHMARKS, figures
from sketchterrain.benchmarks.charts import CHARTS
from sketchterrain.benchmarks.effort import FULL, QUICK
from sketchterrain.benchmarks.kernel_times import WRITTEN
from sketchterrain.benchmarks.live import STAGES, _found, measure
from sketchterrain.benchmarks.registry import choose
from sketchterrain.benchmarks.report import Table, markdown, shown, terminal
from sketchterrain.benchmarks.timing import Lap, Launch, alternate, lap, spread
from sketchterrain.errors import InputError
from sketchterrain.io.resources import preset_names
from sketchterrain.schema.materials import BUILT_IN


def test_every_benchmark_describes_itself_and_charts_and_efforts_name_known_ones():
    for name, benchmark in BENCHMARKS.items():
        assert benchmark.name == name
        assert benchmark.surface
        assert benchmark.seed
        assert re.search(r"second|time|nanoseconds|Milliseconds", benchmark.method)
        assert "." in benchmark.method

    assert set(CHARTS) <= set(BENCHMARKS)
    for effort in (QUICK, FULL):
        assert effort.presets == preset_names()


def test_benchmarks_are_chosen_by_name_in_the_order_of_the_registry():
    assert [b.name for b in choose([])] == list(BENCHMARKS)
    assert [b.name for b in choose(["live", "culling", "live"])] == ["culling", "live"]
    with pytest.raises(InputError) as caught:
        choose(["culling", "nothing"])
    line = str(caught.value)
    assert "'nothing'" in line
    assert all(name in line for name in BENCHMARKS)
    assert "\n" not in line


_TIMED_BASELINES = ("bench.cl", "bench_bytes.cl", "poisson.cl", "splines.cl")


def test_every_kernel_is_timed():
    found = {
        name
        for file in (
            *(
                file
                for file in files("sketchterrain.kernels").iterdir()
                if file.name.endswith((".cl", ".clh"))
            ),
            *(files("sketchterrain.benchmarks.baselines").joinpath(name) for name in _TIMED_BASELINES),
        )
        for name in re.findall(
            r"\b__?kernel\s+(?:\w+(?:\(\(.*?\)\))?\s+)*?void\s+(\w+)", file.read_text(encoding="utf-8")
        )
    }
    # These decide on a device, and on how OpenGL gets what it writes; they make no terrain.
    assert found == set(WRITTEN) | {"self_test", "probe"}


TABLE = Table(
    "Speed",
    (
        {"method": "a|b", "rate": 1234.5, "p95_ms": 7.0, "seconds": [1.0], "odd": 1},
        {"method": "c", "rate": 0.01234, "more": 3},
    ),
    {"rate": "M/s"},
    hidden=("odd",),
)


def test_numbers_are_shown_with_three_significant_digits():
    cells = {None: "–", "word": "word", 7: "7", 0.0: "0", 1234.5: "1234", 12.345: "12.3", 0.98765: "0.988"}
    cells |= {0.001234: "0.00123", 0.0001234: "1.23e-04", -12.345: "-12.3", 2.5e6: "2.50e+06"}
    for cell, text in {**cells, float("nan"): "nan"}.items():
        assert shown(cell) == text, cell


def test_tables_as_markdown_and_in_the_terminal():
    assert markdown(TABLE).splitlines() == [
        "### Speed",
        "",
        "| method | M/s | 95 %, ms | more |",
        "| :--- | ---: | ---: | ---: |",
        "| a\\|b | 1234 | 7.00 | – |",
        "| c | 0.0123 | – | 3 |",
    ]
    stream = io.StringIO()
    Console(width=80, file=stream).print(terminal(TABLE))
    text = stream.getvalue()
    for word in ("Speed", "method", "a|b", "1234", "0.0123"):
        assert word in text


def test_spread_is_the_median_and_the_95th_percentile():
    known = ([*range(1, 102)], 51.0, 96.0), ([0.25], 0.25, 0.25), ([1.0] * 20, 1.0, 1.0)
    for samples, median, p95 in known:
        times = spread([float(each) for each in samples])
        assert (times.median, times.p95, times.count) == (median, p95, len(samples))
    assert spread([1.0] * 18 + [9.0] * 2).p95 > 1.0


def test_rivals_alternate_and_device_time_is_the_sum_of_the_launches():
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


def test_context_counts_the_items_of_each_launch(context):
    sums = context.empty(8 * 8, np.float32)
    octaves = (
        context.upload(np.zeros((1, 4), np.int32)),
        context.upload(np.zeros((1, 2), np.int64)),
        context.upload(np.zeros((1, 2), np.float32)),
    )
    place = (context.upload(np.full((1, 4), 10, np.uint32)), np.int32(1), np.int32(8))

    def work() -> None:
        context.launch("baselines/bench.cl", "bench_fbm", (8, 8), *octaves, *place, sums)
        context.launch("baselines/bench.cl", "bench_fbm", (8, 4), *octaves, *place, sums)

    for _ in range(2):  # a lap forgets the launches before it
        one = context.lap(work)
        assert [(launch.kernel, launch.items) for launch in one.launches] == [
            ("bench_fbm", 64),
            ("bench_fbm", 32),
        ]
        assert one.device == pytest.approx(sum(launch.seconds for launch in one.launches))
        assert all(launch.seconds >= 0 for launch in one.launches)


def test_stages_of_live_painting_add_up_to_the_whole():
    times = [(0.0, 0.01, 0.05, 0.07, 0.1), (1.0, 1.03, 1.05, 1.09, 1.2)]
    row = _found("strokes", times, drafts=[0.03, 0.04, 0.05], stalls=[0.001, 0.004])
    found = [row[name] for name in ("updates", "strokes", "draft_ms", "median_ms", "most_ms", "stall_ms")]
    assert found == pytest.approx([3, 2, 40.0, 150.0, 200.0, 4.0])
    parts = sum(row[f"{stage}_ms".replace(" ", "_")] for stage in STAGES)
    assert parts == pytest.approx(np.mean(row["seconds"]) * 1e3)


@pytest.mark.gl
@pytest.mark.soak
def test_painting_is_followed(tiny):
    table, *_ = measure(None, replace(tiny, view_presets=()))
    strokes, dabs = table.rows
    assert strokes["updates"] >= 10
    assert dabs["updates"] >= dabs["strokes"] >= 2
    for row in table.rows:
        assert 0.0 < row["median_ms"] <= row["p95_ms"] <= row["most_ms"]


def pixels_of(path: Path) -> npt.NDArray[np.int64]:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB")).astype(np.int64)


@pytest.mark.soak
def test_pictures_of_methods_are_drawn(tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setattr(figures, "_RASTER_SIDE", 33)
    assert figures.main(["methods", str(tmp_path)]) == 0
    names = {f"{name}.png" for name in figures.METHODS}
    assert {path.name for path in tmp_path.iterdir()} == names
    for name in names:
        assert pixels_of(tmp_path / name).std() > 10, name


@pytest.mark.slow
def test_every_material_is_in_the_picture(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "_TEXTURE_SIDE", 64)
    assert figures.main(["textures", str(tmp_path)]) == 0
    picture = pixels_of(tmp_path / "textures.jpg")
    rows = math.ceil(len(BUILT_IN.layers) / 3)
    assert picture.shape == (350 * rows, 1920, 3)
    panels = picture.reshape(rows, 350, 3, 640, 3)[:, 30:].std(axis=(1, 3)).reshape(3 * rows, 3)
    assert (panels[: len(BUILT_IN.layers)] > 3.0).all()


@pytest.mark.gl
@pytest.mark.soak
def test_a_row_of_plants_is_drawn_for_each_level(tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "SIZE", (240, 40))
    monkeypatch.setattr(figures, "LEAVES", (10.0, 0.05))
    assert figures.main(["trees", str(tmp_path)]) == 0
    pixels = pixels_of(tmp_path / "trees.jpg")
    assert pixels.shape == (80, 240, 3)
    fine, coarse = pixels[:40], pixels[40:]
    assert fine.std() > 15
    assert coarse.mean() == pytest.approx(fine.mean(), rel=0.1)
    # Where plants stand is dark before the sky.
    assert np.corrcoef(fine[8:20].mean(axis=(0, 2)), coarse[8:20].mean(axis=(0, 2)))[0, 1] > 0.7
