import itertools

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.landforms.placement.feature_types import CLEARANCE, FEATURE_TYPES, SPACING
from sketchterrain.landforms.placement.fill import Fill
from sketchterrain.landforms.placement.placement import PaintedDistance, place
from sketchterrain.schema.layers import PATCH_LAYERS

DENSITY = {"mountain": 0.05, "hill": 0.6, "dune": 0.1, "forest": 3.0}
"""Ranges of mountains and hills are uplifted ground, not features."""


def fill(density=None, *, seed=5, **layers):
    layers = layers or {"hill": np.zeros((64, 64), np.uint8)}
    sketch = Sketch(extent=4096.0, density=density or DENSITY, layers=layers)
    return Fill.from_sketch(sketch, place(sketch, seed=seed), seed=seed)


@pytest.mark.parametrize("origin", [(0.0, 0.0), (-1e9 - 0.3, 1e9 + 0.7)])
def test_a_rectangle_and_its_parts_contain_the_same_features(origin):
    west, south = origin
    ground = fill()
    whole = ground.within(west, south, west + 6000, south + 6000)
    assert len(whole) > 50
    xs, ys = (itertools.pairwise(np.array([0, 137.1, 1500, 4800, 6000]) + start) for start in origin)
    boxes = [(west, south, east, north) for (west, east), (south, north) in itertools.product(xs, ys)]
    together = np.concatenate([fill().within(*box) for box in reversed(boxes)])
    np.testing.assert_array_equal(together[np.argsort(together["id"])], whole)
    # Ids are unique, sorted and marked.
    assert np.all(np.diff(whole["id"].astype(object)) > 0)
    assert np.all(whole["id"] >= 2**63)
    assert not whole["painted"].any()


def test_density_and_spacing_follow_the_rules():
    for name, density in (("dune", 0.1), ("forest", 100.0)):
        side = float(np.sqrt(3000 / density)) * 1000
        found = fill({name: density}).within(1e5, 1e5, 1e5 + side, 1e5 + side)
        assert len(found) == pytest.approx(3000, rel=0.15), (name, density)
    found = fill().within(1e5, 0.0, 2e5, 1e5)
    for code, name in enumerate(FEATURE_TYPES):
        expected = DENSITY[name] * 1e4 if name in PATCH_LAYERS else 0
        assert (found["type"] == code).sum() == pytest.approx(expected, rel=0.15), name

    found = fill().within(0, 0, 20_000, 20_000)
    distance = np.hypot(found["x"][:, None] - found["x"], found["y"][:, None] - found["y"])
    radii = found["radius"][:, None].astype(float) + found["radius"]
    for (first, second), factor in SPACING.items():
        one, other = (found["type"] == FEATURE_TYPES.index(name) for name in (first, second))
        pair = one[:, None] & other
        np.fill_diagonal(pair, val=False)
        assert np.all(distance[pair] >= factor * radii[pair] * (1 - 1e-9)), (first, second)


def test_the_fill_keeps_clear_of_painted_layers():
    row, column = np.mgrid[:64, :64]
    layers = {
        "mountain": (np.hypot(row - 20, column - 20) < 10).astype(np.uint8),
        "river": (np.abs(column - 45) < 2).astype(np.uint8),
    }
    found = fill({"dune": 8.0, "forest": 8.0}, **layers).within(-500, -500, 4600, 4600)
    assert len(found) > 20
    for layer, painted in layers.items():
        distance = PaintedDistance(painted > 0, 64.0)(found["x"], found["y"])
        for code, name in ((2, "dune"), (3, "forest")):
            of_type = found["type"] == code
            assert np.all(distance[of_type] > CLEARANCE[name, layer] * found["radius"][of_type])


def test_the_difference_of_two_fills_is_what_only_one_has():
    row, column = np.mgrid[:64, :64]
    box = (-2000.0, -2000.0, 6000.0, 6000.0)
    painted = {name: np.zeros((64, 64), np.uint8) for name in ("hill", "forest", "river")}
    before, everything = fill(**painted), fill(**painted).within(*box)
    for name, radius in (("hill", 6), ("forest", 4), ("river", 2)):
        painted[name] = (np.hypot(row - 30, column - 40) < radius).astype(np.uint8)
        after = fill(**painted)
        rows = [{each.tobytes() for each in found} for found in (everything, after.within(*box))]
        removed, added = ({each.tobytes() for each in found} for found in before.difference(after))
        assert (removed, added) == (rows[0] - rows[1], rows[1] - rows[0]), name
        assert removed, name
    assert before.difference(fill(seed=6, **painted)) is None


def test_small_features_are_filtered_and_no_density_gives_none():
    sketch = Sketch()
    nothing = Fill.from_sketch(sketch, place(sketch, seed=1), seed=1)
    assert nothing.max_radius == 0.0
    assert len(nothing.within(-1e6, -1e6, 1e6, 1e6)) == 0
    ground = fill()
    assert len(ground.within(-1e12, -1e12, 1e12, 1e12, min_radius=ground.max_radius * 1.01)) == 0
    for box in ((0, 0, np.nan, 1), (0, 0, np.inf, 1), (1, 0, 0, 1), (0, 1, 1, 0)):
        with pytest.raises(InputError, match="expected finite bounds"):
            ground.within(*box)

    ground = fill()
    everything = ground.within(0, 0, 20_000, 20_000)
    large = ground.within(0, 0, 20_000, 20_000, min_radius=300.0)
    np.testing.assert_array_equal(large, everything[everything["radius"] >= 300.0])
    assert 0 < len(large) < len(everything)
    assert everything["radius"].max() <= ground.max_radius
