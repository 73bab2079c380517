"""A batch that is killed at any moment, again and again, ends with the files of one that never was."""

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.benchmarks.batch_kills import differences, killed
from sketchterrain.sketch import Sketch, save_sketch

SEEDS, SIZE = 6, 129


@pytest.fixture
def sketch(tmp_path) -> Path:
    mountain, forest = (np.zeros((32, 32), np.uint8) for _ in range(2))
    mountain[4:10, 20:28] = 1
    forest[18:28, 4:14] = 1
    layers = {"mountain": mountain, "forest": forest}
    save_sketch(Sketch(extent=512.0, layers=layers), tmp_path / "hill")
    return tmp_path / "hill"


@pytest.mark.parametrize(
    "most", [pytest.param(2, marks=pytest.mark.slow), pytest.param(6, marks=pytest.mark.soak)]
)
def test_killed_and_resumed_to_the_same_bytes(sketch, tmp_path, most):
    words = [str(sketch), "--seeds", f"1-{SEEDS}", "--size", str(SIZE), "--no-preview"]
    command = [sys.executable, "-m", "sketchterrain", "batch", *words]
    whole = subprocess.run(
        [*command, "-o", tmp_path / "whole"], capture_output=True, check=False, timeout=300
    )
    assert whole.returncode == 0, whole.stderr
    kills = killed(
        words, tmp_path / "killed", kills=most, longest=5.0, chance=random.Random(1), timeout=300.0
    )
    assert len(kills) <= most
    assert differences(tmp_path / "whole", tmp_path / "killed") == []


@pytest.mark.parametrize(
    "way",
    [
        pytest.param(signal.SIGINT, marks=pytest.mark.slow),
        pytest.param(signal.SIGTERM, marks=pytest.mark.soak),
    ],
)
def test_a_signal_ends_it_with_130_and_leaves_nothing_half_written(way, sketch, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "sketchterrain", "batch", str(sketch), "-o", str(out)]
    command += ["--seeds", "1-500", "--size", "129", "--no-preview"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    assert process.stderr is not None
    assert any(line.startswith("[3/500]") for line in process.stderr)
    os.kill(process.pid, way)
    rest = process.communicate(timeout=120)[1]
    assert process.returncode == 130, rest
    assert rest.splitlines()[-1] == "sketchterrain: error: interrupted"
    assert "Traceback" not in rest
    assert not [path for path in out.rglob("*") if path.name.startswith(".")]
    done = {path.parent.name for path in out.rglob("report.json")}
    assert {path.name for path in (out / "hill").iterdir()} == done
    assert 3 <= len(done) < 500
