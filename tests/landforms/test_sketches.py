"""The painted sketches: valid, with mountains no higher than wide."""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, label, maximum

from sketchterrain.document.sketch import Sketch, labels_in

from .sketches import SKETCHES


@cache
def painted(name: str, seed: int) -> Sketch:
    return SKETCHES[name](seed)


def steepest(sketch: Sketch) -> float:
    """Return the greatest height of a mountain or hill over the inradius of its shape within the image."""
    ratios = [0.0]
    for layer in ("mountain", "hill"):
        image = sketch.layers[layer]
        for number in labels_in(image):
            height = sketch.properties(layer, number)["height"]
            shape = np.pad(image == number, 1)
            shapes, count = label(shape, np.ones((3, 3)))
            inradii = maximum(distance_transform_edt(shape), shapes, range(1, count + 1)) - 0.5
            ratios.append(height / (inradii.min() * sketch.pixel_size))
    return max(ratios)


@pytest.mark.slow
def test_sketches_are_valid_and_only_the_childs_mountains_are_higher_than_their_inradius():
    for name in SKETCHES:
        first = painted(name, 0)
        assert 256 <= min(first.width_px, first.height_px) <= max(first.width_px, first.height_px) <= 512
        assert 3000 <= first.extent <= 12000
        for layer, image in first.layers.items():
            unused = {number for where, number in first.labels if where == layer} - set(labels_in(image))
            assert not unused, (name, layer, unused)
        for seed in range(3):
            sketch = painted(name, seed)
            assert (steepest(sketch) > 1.0) == (name == "childs_drawing"), (name, seed)
            assert sketch.labels == first.labels, name
        assert any((image != sketch.layers[layer]).any() for layer, image in first.layers.items()), name


def test_a_seed_paints_the_same_sketch_again():
    first, again = painted("childs_drawing", 0), SKETCHES["childs_drawing"](0)
    assert all(np.array_equal(first.layers[layer], again.layers[layer]) for layer in first.layers)
