"""Every benchmark once, as small as possible, and the `bench` command: reports, never how long it took."""

import contextlib
import io
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sketchterrain.app.cli import main
from sketchterrain.benchmarks import BENCHMARKS, batches, charts, command, pictures, run, worlds
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.report import Tables
from sketchterrain.benchmarks.splines import SEED
from sketchterrain.benchmarks.timing import TimedContext
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import save_sketch
from sketchterrain.errors import DeviceError, InputError

BEST = 0.4
"""The best quality of pictures here; the program's own takes three times as long."""
DEFAULT = ("splines",)
SOAK = ("accuracy", "batch", "drapes", "elevation", "flight", "landforms", "live", "pictures")
SOAK += ("roads", "scale", "speed")
"""Benchmarks of the default tier, and those that take 8 to 450 s; all others are slow."""


class Outcomes(dict[str, Tables]):
    """Of each benchmark, measured when a test wants it: tests of several processes share the work."""

    def __init__(self, context: TimedContext, effort: Effort, small: Path) -> None:
        super().__init__()
        self._given, self._small = (context, replace(effort, view_presets=(str(small),))), small

    def __missing__(self, name: str) -> Tables:
        with pytest.MonkeyPatch.context() as patch:
            for module in (batches, pictures, worlds):
                patch.setattr(module, "run_program", reported)
            patch.setattr(batches, "SKETCH", str(self._small))
            patch.setattr(pictures, "BEST", BEST)
            patch.setattr(worlds, "SKETCH", str(self._small))
            self[name] = BENCHMARKS[name].measure(*self._given)
        return self[name]


def reported(words: Sequence[str]) -> dict[str, Any]:
    """Run a command here, since the start of a process would take most of the time; return its report."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        assert main(words) == 0
    report: dict[str, Any] = json.loads(printed.getvalue())
    return report


@pytest.fixture(scope="module")
def outcomes(context, tiny, tmp_path_factory) -> dict[str, Tables]:
    small = tmp_path_factory.mktemp("sketches") / "small"
    save_sketch(Sketch(extent=256.0, layers={"mountain": np.eye(32, dtype=np.uint8)}), small)
    return Outcomes(context, tiny, small)


def by_tier(names: Iterable[str], default: Sequence[str] = ()) -> list[Any]:
    """Return the names of benchmarks as parameters with the mark of their tier."""
    marks = {name: pytest.mark.soak if name in SOAK else pytest.mark.slow for name in names}
    return [name if name in default else pytest.param(name, marks=mark) for name, mark in marks.items()]


def rows(outcome: Tables, table: int = 0) -> list[Any]:
    return list(outcome[table].rows)


@pytest.mark.parametrize("name", by_tier(BENCHMARKS, DEFAULT))
def test_every_shown_value_is_there_and_finite(outcomes, name):
    for table in outcomes[name]:
        assert table.rows
        assert {*table.headings} <= {*table.keys}
        for row in table.rows:
            assert all(math.isfinite(v) for v in row.values() if isinstance(v, float))
            assert all(len(v) >= 2 for v in row.values() if isinstance(v, list))


@pytest.mark.soak
def test_the_live_picture_has_the_shape_of_the_still(outcomes):
    (view,) = rows(outcomes["live"], 1)
    assert 0.0 < view["first_s"] < view["still_s"]
    opening, whole, *strokes = rows(outcomes["live"], 2)
    for seen in (opening, whole):  # after a second, in which machines differ; see render/test_live_shape
        assert seen["columns"] > 90.0
        assert 0.0 < seen["water"] <= 1.0
        assert seen["rate"] > 0.0
    assert strokes


@pytest.mark.parametrize("name", by_tier(charts.CHARTS))
def test_charts_are_pictures(outcomes, name):
    pytest.importorskip("matplotlib")
    pictures = charts.draw(name, outcomes[name])
    assert pictures[".png"].startswith(b"\x89PNG")
    assert b"<svg" in pictures[".svg"]
    if name == "splines":  # the same code draws all of them
        assert pictures == charts.draw(name, outcomes[name])


@pytest.fixture(autouse=True)
def _small(monkeypatch, tiny) -> None:
    monkeypatch.setattr(command, "QUICK", tiny)


def test_a_run_prints_json(capsys):
    assert run(["splines"], output=None, quick=True, device=None, as_json=True) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == 1
    assert found["rounds"] == 2
    assert found["about"]["command"] == "sketchterrain bench splines --quick -o DIR"
    (splines,) = found["benchmarks"]
    assert (splines["name"], splines["seed"]) == ("splines", str(SEED))
    assert splines["tables"][0]["rows"]


@pytest.mark.slow
def test_a_run_writes_report_data_and_charts(tmp_path, capsys):
    pytest.importorskip("matplotlib")
    target = tmp_path / "new" / "result"
    assert run(["culling", "splines"], output=target, quick=True, device=None, as_json=False) == 0
    assert sorted(path.name for path in target.iterdir()) == [
        "bench.json",
        "bench.md",
        "culling.png",
        "culling.svg",
        "splines.png",
        "splines.svg",
    ]
    page = (target / "bench.md").read_text(encoding="utf-8")
    for part in (
        "## splines",
        "## culling",
        "![culling](culling.png)",
        "2 rounds",
        "Seed: ",
        "| driver |",
        "pyopencl",
    ):
        assert part in page
    assert str(tmp_path) not in page + (target / "bench.json").read_text(encoding="utf-8")
    assert capsys.readouterr().out.strip() == str(target / "bench.md")


def test_invalid_names_devices_and_folders_are_refused(tmp_path):
    target = tmp_path / "file"
    target.write_text("kept")
    for name, device, output, error, line in (
        # before a device is opened
        ("nothing", "no such device", None, InputError, "no benchmark 'nothing'"),
        ("splines", "no such device", None, DeviceError, "no such device"),
        ("splines", None, target, InputError, "expected a folder to write into"),
    ):
        with pytest.raises(error, match=line):
            run([name], output=output, quick=True, device=device, as_json=False)
    assert target.read_text() == "kept"
