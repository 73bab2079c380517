"""Registry, timing, tables, small measures, and pictures of the documentation that benchmarks draw."""

import io
import math
import re
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
from sketchterrain.benchmarks.registry import choose
from sketchterrain.benchmarks.report import Table, markdown, terminal
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
