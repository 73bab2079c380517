"""Whatever is painted: no exception, no shape lost, nothing that is not a number."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from sketchterrain.features import FEATURE_TYPES, Fill, label_shapes, place, trace_rivers
from sketchterrain.features.profiles import shown_at
from sketchterrain.features.rules import LAYER_CODES, TYPES
from sketchterrain.features.shapes import EDGE_OVERHANG
from sketchterrain.sketch.document import Sketch

SIZES = st.tuples(st.integers(1, 14), st.integers(1, 14))
LEAST_RADIUS = 1.5  # px
LEAST_SHARE = 0.36  # of the label's strength, for which a feature's reach is worked out
LABELS = st.sampled_from([0, 0, 0, 1, 1, 2])


@st.composite
def sketches(draw: st.DrawFn) -> Sketch:
    size = draw(SIZES)
    names = draw(st.sets(st.sampled_from(sorted(LAYER_CODES)), min_size=1))
    layers = {name: draw(arrays.arrays(np.uint8, size, elements=LABELS)) for name in sorted(names)}
    extent = draw(st.sampled_from([1.0, 100.0, 4096.0, 1e6]))
    return Sketch(
        extent=extent, fidelity=draw(st.sampled_from([0.0, 0.5, 1.0])), layers=layers, density={"hill": 0.5}
    )


def rolling(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 10 * np.sin(x / 30) + 10 * np.cos(y / 40)


@settings(max_examples=25, deadline=None, derandomize=True)
@given(sketches(), st.integers(0, 2**63 - 1))
def test_any_sketch_keeps_its_shapes_and_is_finite(sketch: Sketch, seed: int) -> None:
    check(sketch, seed)


@pytest.mark.slow
@settings(max_examples=120, deadline=None, derandomize=True)
@given(sketches(), st.integers(0, 2**63 - 1))
def test_many_sketches_keep_their_shapes_and_are_finite(sketch: Sketch, seed: int) -> None:
    check(sketch, seed)


def check(sketch: Sketch, seed: int) -> None:
    placed = place(sketch, seed=seed)
    for name in TYPES:
        code = FEATURE_TYPES.index(name)
        own = placed[placed["type"] == code]
        pixels = (own["id"] & np.uint64(2**48 - 1)).astype(int)
        stands_on = np.zeros(sketch.layers[name].size, bool)
        stands_on[pixels] = True
        stands_on = stands_on.reshape(sketch.layers[name].shape)
        for shape in label_shapes(name, sketch.layers[name]):
            assert stands_on[shape.rows, shape.columns][shape.mask].any()
    for field in ("x", "y", "radius", "strength"):
        assert np.isfinite(placed[field]).all()
    assert np.all(placed["strength"] > 0)
    disc = max(max(sketch.width_px, sketch.height_px) * (0.5 + EDGE_OVERHANG), 1.0)
    for name, rule in TYPES.items():
        own = placed[placed["type"] == FEATURE_TYPES.index(name)]
        # As far as a quarter of its label shows, and no farther for being low.
        asked = sketch.properties(name, 1)["density" if name == "forest" else "height"]
        share = np.maximum(own["strength"] / asked, LEAST_SHARE)
        shown = shown_at(name, share, own["peakiness"].astype(float), sketch.fidelity)
        most = np.maximum(rule.reach * disc / shown, LEAST_RADIUS) * sketch.pixel_size
        assert np.all(own["radius"] <= most * (1 + 1e-6))

    rivers = trace_rivers(sketch, seed=seed, ground=rolling)
    assert len({river.id for river in rivers}) == len(rivers)
    for river in rivers:
        assert np.isfinite(river.centreline).all()
        assert np.all(np.diff(river.centreline[:, 2]) <= 0)
    networks = label_shapes("river", (sketch.layers["river"] > 0).astype(np.uint8))
    assert len(rivers) >= len(networks)

    found = Fill(sketch, placed, seed=seed).within(-2000.0, -2000.0, 6000.0, 6000.0)
    assert np.isfinite(found["strength"]).all()
