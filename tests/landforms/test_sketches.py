"""The painted sketches: valid, saved and loaded, with mountains no higher than wide."""

from functools import cache

import numpy as np
import pytest
from scipy.ndimage import distance_transform_edt, label, maximum

from sketchterrain.document.sketch import Sketch, labels_in
from sketchterrain.document.store import load_sketch, save_sketch

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


@pytest.mark.parametrize("name", SKETCHES)
def test_sketch_is_saved_and_loaded_unchanged(name, tmp_path):
    sketch = painted(name, 0)
    save_sketch(sketch, tmp_path / name)
    loaded = load_sketch(tmp_path / name)
    assert 256 <= min(sketch.width_px, sketch.height_px) <= max(sketch.width_px, sketch.height_px) <= 512
    assert 3000 <= sketch.extent <= 12000
    assert (loaded.name, loaded.extent, loaded.labels) == (sketch.name, sketch.extent, sketch.labels)
    for layer, image in sketch.layers.items():
        assert np.array_equal(loaded.layers[layer], image), layer
        unused = {number for where, number in sketch.labels if where == layer} - set(labels_in(image))
        assert not unused, (layer, unused)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_only_the_childs_mountains_are_higher_than_their_inradius(seed):
    for name in SKETCHES:
        assert (steepest(painted(name, seed)) > 1.0) == (name == "childs_drawing"), name


def test_another_seed_paints_the_same_sketch_with_another_hand():
    for name, paint in SKETCHES.items():
        first, again, other = painted(name, 0), paint(0), painted(name, 1)
        assert all(np.array_equal(first.layers[layer], again.layers[layer]) for layer in first.layers), name
        assert any(not np.array_equal(first.layers[layer], other.layers[layer]) for layer in first.layers), (
            name
        )
        assert first.labels == other.labels, name
