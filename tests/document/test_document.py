"""Sketches as immutable, checked values."""

import dataclasses
import pickle

import numpy as np
import pytest

from sketchterrain.document.edits import Edit
from sketchterrain.document.label_layers import labels_in
from sketchterrain.document.sketch import TABLES, Sketch
from sketchterrain.document.toml_format import parse_settings, settings_text
from sketchterrain.schema.layers import PAINTED_LAYERS
from tests.refusals import refused

from .conftest import same


def _image(height, width, label=0):
    return np.full((height, width), label, dtype=np.uint8)


def test_defaults_and_extent():
    sketch = Sketch()
    assert (sketch.width_px, sketch.height_px) == (512, 512)
    assert list(sketch.layers) == list(PAINTED_LAYERS)
    assert not any(image.any() for image in sketch.layers.values())
    for key, table in TABLES.items():
        assert getattr(sketch, key) == {name: parameter.default for name, parameter in table.items()}
    assert not sketch.labels

    for height, width, size in ((100, 200, (4000, 2000)), (200, 50, (1000, 4000))):
        sketch = Sketch(extent=4000, layers={"hill": _image(height, width)})
        assert sketch.size == size
        assert sketch.pixel_size == 20.0
        assert all(image.shape == (height, width) for image in sketch.layers.values())


def test_sketches_are_immutable_and_share_unchanged_layers():
    mine = _image(4, 4, 1)
    sketch = Sketch(layers={"hill": mine}, labels={("hill", 1): {"height": 10}})
    mine[:] = 2
    assert (sketch.layers["hill"] == 1).all()
    with pytest.raises(ValueError, match="read-only"):
        sketch.layers["hill"][0, 0] = 3
    with pytest.raises(ValueError, match="read-only"):
        sketch.layers["dune"][0, 0] = 3
    with pytest.raises(dataclasses.FrozenInstanceError):
        sketch.seed = 3

    sketch = Sketch(layers={"hill": _image(4, 4, 1)})
    other = sketch.replace(seed=9)
    assert (other.seed, sketch.seed) == (9, 0)
    assert all(other.layers[name] is sketch.layers[name] for name in PAINTED_LAYERS)
    refused("fidelity = 2: expected a number from 0 to 1", sketch.replace, fidelity=2)


def test_properties_have_defaults():
    sketch = Sketch(labels={("mountain", 2): {"height": 900}, ("material", 2): {"material": "snow"}})
    assert sketch.properties("mountain", 2) == {
        "height": 900.0,
        "height_limit": 1.33,
        "peakiness": 0.5,
        "erosion": 0.7,
        "strata": 0.25,
        "multitude": 1,
        "reach": "added",
    }
    assert sketch.properties("mountain", np.uint8(1))["height"] == 0.0  # automatic
    assert isinstance(sketch.properties("mountain", 2)["multitude"], int)
    assert sketch.properties("material", 2) == {"material": "snow", "strength": 1.0}
    assert sketch.properties("material", 1)["material"] == "rock"
    refused(r"unknown layer 'mountin'.*did you mean 'mountain'", sketch.properties, "mountin", 1)
    for label in (0, 256, True, 1.0, "1"):
        refused("a label from 1 to 255", sketch.properties, "mountain", label)

    sketch = Sketch(labels={("river", 2): {}, ("mountain", 9): {}, ("river", 1): {}})
    assert list(sketch.labels) == [("mountain", 9), ("river", 1), ("river", 2)]


_REFUSED = [
    ({"density": {"hil": 1}}, "unknown key 'hil' = 1 in .density.: .*did you mean 'hill'"),
    ({"labels": {("hill", 0): {}}}, "expected a label from 1 to 255"),
    ({"labels": {("pond", 1): {}}}, "unknown layer 'pond'"),
    ({"material_rules": ("snow",)}, "expected RuleChange values, got 'snow'"),
    ({"edits": ("move",)}, "edits: expected Edit values, got 'move'"),
    ({"layers": {"hill": [[0]]}}, "expected a uint8 array .height, width., got list"),
    ({"layers": {"hill": np.zeros((2, 2))}}, "got float64"),
    ({"layers": {"hill": _image(0, 2)}}, "sides of 1 to 16384 px"),
    ({"layers": {"hill": _image(1, 16385)}}, "16385×1 px: expected sides of 1 to 16384 px"),
    ({"layers": {"hill": _image(2, 2), "dune": _image(2, 3)}}, "layer dune is 3×2 px .* 2×2 px"),
    ({"layers": {"hill": np.arange(18, dtype=np.uint8)[None]}}, "antialiased: it has 17 labels"),
]


def test_refused_values_name_the_key():
    for changes, message in _REFUSED:
        refused(message, Sketch, **changes)


def test_labels_in_large_and_transposed_images():
    image = np.zeros((3000, 1000), dtype=np.uint8)
    assert labels_in(image) == ()
    image[2999, 999], image[0, 0], image[1500, 3] = 255, 7, 1
    assert labels_in(image) == (1, 7, 255)
    assert labels_in(image.T) == (1, 7, 255)


def test_pickled_sketches_are_small_and_equal():
    sketch = Sketch(
        name="Ben",
        layers={"hill": _image(3, 5, 1), "river": np.eye(3, 5, dtype=np.uint8)},
        labels={("hill", 1): {"height": 10}},
        look={"rock": {"colour": "#102030"}},
        edits=(Edit("delete", 7),),
        climate={"aridity": 0.5},
    )
    other = pickle.loads(pickle.dumps(sketch))  # noqa: S301
    same(other, sketch)
    assert list(other.layers) == list(PAINTED_LAYERS)
    for image in other.layers.values():
        with pytest.raises(ValueError, match="read-only"):
            image[0, 0] = 3
    for each in (sketch, other):
        for mapping in (each.layers, each.labels, each.density, each.labels["hill", 1], each.look):
            with pytest.raises(TypeError):
                mapping["hill"] = 1
    assert other.replace(seed=4).layers["river"] is other.layers["river"]
    large = {name: np.zeros((512, 512), np.uint8) for name in ("hill", "river")}
    large["hill"][40:300, 100:200] = 1
    large["river"][:, 250:253] = 1
    assert len(pickle.dumps(Sketch(layers=large))) < 8000


def test_look_has_only_given_values_in_order_of_materials():
    look = {"sand": {"size": 9.0}, "grass": {"colour": "#3f6B2a", "roughness": 0.5, "bump": 0.0}}
    sketch = Sketch(look=look)
    assert dict(sketch.look) == look
    assert list(sketch.look) == ["grass", "sand"]
    assert parse_settings(settings_text(sketch).encode()).look == sketch.look
    assert "look" not in settings_text(Sketch())
