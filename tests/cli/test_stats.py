"""`sketchterrain stats`: what a written world is like, for a person and for a program."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.world.opening import open_world


@pytest.fixture(scope="module")
def written(sketch, tmp_path_factory) -> Path:
    from sketchterrain.cli import main

    out = tmp_path_factory.mktemp("worlds") / "world.zarr"
    assert main(["world", str(sketch), "--cell", "1", "-o", str(out)]) == 0
    return out


def test_numbers_are_those_of_the_heights(call, written):
    told = json.loads(call("stats", written, "--json").out)
    stored = open_world(written)
    height = stored.read("height", 0, top=0, left=0, rows=told["rows"], columns=told["columns"])
    assert (told["columns"], told["rows"], told["cell"], told["area"]) == (513, 385, 1.0, 512.0 * 384.0)
    assert told["relief"]["minimum"] == float(height.min())
    assert told["relief"]["maximum"] == float(height.max())
    assert told["relief"]["mean"] == pytest.approx(height.mean(dtype=np.float64))
    assert told["relief"]["quantiles"]["0.5"] == pytest.approx(np.median(height), abs=0.01)
    assert math.fsum(told["slopes"]["shares"]) == pytest.approx(1.0)
    assert math.fsum(told["materials"].values()) == pytest.approx(1.0)
    assert told["hypsometry"]["share_above"][0] == 1.0
    assert told["hypsometry"]["share_above"][-1] == 0.0
    below = np.mean(height > told["hypsometry"]["heights"][5])
    assert told["hypsometry"]["share_above"][5] == pytest.approx(below, abs=1e-3)


def test_a_person_gets_bars(call, written):
    done = call("stats", written, "--level", 1)
    assert done.code == 0
    lines = done.out.splitlines()
    assert "level 1: 257 × 193 vertices 2 m apart" in lines[0]
    assert [line.split()[0] for line in lines if line[0] != " "][1:] == [
        "relief",
        "slopes",
        "hypsometry",
        "materials",
    ]
    assert max(line.count("█") for line in lines) == 40
    assert all(len(line) <= 110 for line in lines[1:])
