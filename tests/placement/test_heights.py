"""Heights of mountains and hills by their width."""

import numpy as np
import pytest

from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.document.toml_format import starter_sketch
from sketchterrain.io.resources import preset_names
from sketchterrain.landforms.placement.heights import built_height, shape_height
from sketchterrain.landforms.placement.placement import place
from sketchterrain.landforms.placement.shapes import label_shapes

PIXEL = 10.0


def discs(*radii):
    """Return an image with discs of label 1 in a row."""
    rows, columns = np.mgrid[:200, : 200 * len(radii)]
    far = [np.hypot(rows - 100, columns - 100 - 200 * index) - each for index, each in enumerate(radii)]
    return (np.min(far, axis=0) < 0.0).astype(np.uint8)


def highest(image, properties, *, layer="mountain", fidelity=0.8):
    """Return the height (m) of the highest feature of each disc, from west to east."""
    labels = {(layer, 1): properties}
    sketch = Sketch(extent=PIXEL * image.shape[1], layers={layer: image}, labels=labels, fidelity=fidelity)
    points = place(sketch, seed=1)
    disc = (points["x"] // (200 * PIXEL)).astype(int)
    return [float(points["strength"][disc == index].max()) for index in np.unique(disc)]


def test_great_heights_saturate_smoothly_at_their_limit():
    assert [built_height(500.0, 500.0, fidelity) for fidelity in (0.0, 0.5, 0.8, 0.9, 1.0)] == [500.0] * 5
    inradius = 300.0
    asked = np.linspace(1.0, 30000.0, 4000)
    built = np.array([built_height(each, inradius, 0.8) for each in asked])
    assert np.all(np.diff(built) > 0.0)
    assert built.max() < 1.33 * inradius
    assert built_height(301.0, inradius, 0.8) == pytest.approx(301.0, abs=0.02)
    assert built_height(1e6, inradius, 0.3, limit=3.0) == pytest.approx(900.0, rel=0.01)
    assert built_height(1e6, inradius, 0.3, limit=0.5) == pytest.approx(150.0)


def test_built_heights_grow_with_fidelity_without_a_jump():
    built = [built_height(2000.0, 300.0, fidelity) for fidelity in np.linspace(0.8, 1.0, 2001)]
    assert np.all(np.diff(built) >= 0.0)
    assert np.max(np.diff(built)) < 10.0
    assert built[-1] == 2000.0


def test_labels_without_a_height_are_as_high_as_each_shape_is_wide():
    for layer in ("mountain", "hill"):
        narrow, wide = highest(discs(20, 80), {}, layer=layer)
        assert narrow == pytest.approx(0.7 * 20 * PIXEL, rel=0.03)
        assert wide == pytest.approx(0.7 * 80 * PIXEL, rel=0.03)


def test_highest_feature_of_a_shape_has_its_built_height():
    inradii = [label_shapes("mountain", discs(each))[0].depth.max() * PIXEL for each in (20, 80)]
    for properties in ({"multitude": 1}, {"multitude": 20}, {"height_limit": 3.0}):
        for fidelity in (0.5, 0.9, 1.0):
            limit = properties.get("height_limit", 1.33)
            expected = [built_height(600.0, each, fidelity, limit) for each in inradii]
            found = highest(discs(20, 80), {"height": 600.0, **properties}, fidelity=fidelity)
            assert found == pytest.approx(expected)
    assert highest(discs(20), {"height": 600.0}, fidelity=1.0) == [600.0]


def test_no_preset_asks_for_more_than_its_shapes_can_carry():
    for sketch in [starter_sketch(), *map(load_sketch, preset_names())]:
        for layer in ("mountain", "hill"):
            for shape in label_shapes(layer, sketch.layers[layer]):
                inradius = shape.depth.max() * sketch.pixel_size
                if sketch.properties(layer, shape.label)["reach"] == "absolute":
                    continue
                height = shape_height(sketch.properties(layer, shape.label), inradius, sketch.fidelity)
                assert height.asked <= 1.33 * inradius, (sketch.name, shape.label)
                assert height.built >= 0.9 * height.asked, (sketch.name, shape.label)
