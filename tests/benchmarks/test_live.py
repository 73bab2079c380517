"""The benchmark of live painting."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.benchmarks.live import STAGES, _found, measure, sketch_with_twenty_shapes
from sketchterrain.features.shapes import regions_of


def test_the_sketch_has_twenty_shapes_and_stages_add_up_to_the_whole():
    sketch = sketch_with_twenty_shapes()
    assert sketch.layers["river"].shape == (512, 512)
    assert sum(len(list(regions_of(image))) for image in sketch.layers.values()) == 20

    times = [(0.0, 0.01, 0.05, 0.06, 0.07, 0.1), (1.0, 1.03, 1.05, 1.06, 1.09, 1.2)]
    row = _found("strokes", times, [0.001, 0.004])
    assert row["updates"] == 2
    assert row["median_ms"] == pytest.approx(150.0)
    assert row["most_ms"] == pytest.approx(200.0)
    parts = sum(row[f"{stage}_ms".replace(" ", "_")] for stage in STAGES)
    assert parts == pytest.approx(np.mean(row["seconds"]) * 1e3)
    assert row["stall_ms"] == pytest.approx(4.0)


@pytest.mark.gl
@pytest.mark.slow
def test_painting_is_followed(tiny):
    (table,) = measure(None, tiny).tables
    strokes, dabs = table.rows
    assert strokes["updates"] >= 10
    assert dabs["updates"] >= 2
    for row in table.rows:
        assert 0.0 < row["median_ms"] <= row["p95_ms"] <= row["most_ms"]
