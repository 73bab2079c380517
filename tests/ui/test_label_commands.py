"""Labels, properties and settings: what the commands make of a sketch."""

import numpy as np
import pytest

from sketchterrain.document.parameters import LAYERS, SKETCH, TABLES
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import InputError
from sketchterrain.ui.commands import settings as labels
from sketchterrain.ui.commands.settings import WORLD, declared, reset_setting, set_setting, settings


@pytest.fixture
def sketch():
    mountain = np.zeros((6, 9), np.uint8)
    mountain[1:3, 2:5] = 1
    mountain[4, :] = 3
    return Sketch(layers={"mountain": mountain}, labels={("mountain", 2): {"height": 900.0}})


def test_areas_count_every_painted_pixel_and_labels_are_painted_or_declared(sketch):
    assert labels.label_areas(sketch.layers["mountain"]) == {1: 6, 3: 9}
    assert labels.label_areas(sketch.layers["hill"]) == {}
    # More than one block of rows.
    image = np.random.default_rng(3).integers(0, 9, (1500, 1100), dtype=np.uint8)
    assert labels.label_areas(image) == {label: int((image == label).sum()) for label in range(1, 9)}

    assert labels.labels_of(sketch, "mountain") == (1, 2, 3)
    assert labels.labels_of(sketch, "hill") == ()


def test_a_new_label_is_the_smallest_free_one_and_survives_a_file(sketch, tmp_path):
    assert labels.free_label(sketch, "hill") == 1
    label = labels.free_label(sketch, "mountain")
    assert label == 4
    more = labels.new_label(sketch, "mountain", label)
    assert labels.labels_of(more, "mountain") == (1, 2, 3, 4)
    assert dict(more.properties("mountain", 4)) == dict(sketch.properties("mountain", 4))
    assert labels.new_label(more, "mountain", label) is more
    assert labels.free_label(labels.delete_label(more, "mountain", 2), "mountain") == 2

    save_sketch(labels.new_label(sketch, "mountain", 4), tmp_path / "a.sketch")
    assert ("mountain", 4) in load_sketch(tmp_path / "a.sketch").labels

    for _ in range(13):
        sketch = labels.new_label(sketch, "mountain", labels.free_label(sketch, "mountain"))
    with pytest.raises(InputError, match="at most 16 labels"):
        labels.free_label(sketch, "mountain")


def test_a_copied_label_has_the_same_properties_which_are_set_and_reset(sketch):
    copied = labels.copy_label(sketch, "mountain", 4, source=2)
    assert copied.properties("mountain", 4) == sketch.properties("mountain", 2)
    again = labels.set_property(copied, "mountain", 4, "height", 10.0)
    assert again.properties("mountain", 2)["height"] == 900.0

    high = labels.set_property(sketch, "mountain", 1, "height", 1200.0)
    assert high.properties("mountain", 1)["height"] == 1200.0
    assert high.layers["mountain"] is sketch.layers["mountain"]
    assert labels.set_property(high, "mountain", 1, "height", 1200.0) is high
    low = labels.reset_property(high, "mountain", 1, "height")
    assert low.properties("mountain", 1) == sketch.properties("mountain", 1)
    assert labels.reset_property(low, "mountain", 1, "height") is low


def test_deleting_a_label_and_clearing_a_layer_keep_other_paint_and_properties(sketch):
    before = sketch.layers["mountain"].copy()
    gone = labels.delete_label(sketch, "mountain", 3)
    assert labels.label_areas(gone.layers["mountain"]) == {1: 6}
    assert gone.labels == sketch.labels
    assert gone.layers["hill"] is sketch.layers["hill"]
    np.testing.assert_array_equal(sketch.layers["mountain"], before)
    assert labels.labels_of(labels.delete_label(sketch, "mountain", 2), "mountain") == (1, 3)
    assert labels.delete_label(sketch, "mountain", 9) is sketch

    clear = labels.clear_layer(sketch, "mountain")
    assert not clear.layers["mountain"].any()
    assert clear.labels == sketch.labels
    assert labels.clear_layer(clear, "mountain") is clear


def test_every_setting_can_be_set_and_reset(sketch):
    for table in [WORLD, *TABLES]:
        for name, parameter in declared(table).items():
            value = "other" if parameter.kind is str else parameter.kind(parameter.high)
            if value == parameter.default:
                value = parameter.kind(parameter.low)
            changed = set_setting(sketch, table, name, value)
            assert settings(changed, table)[name] == value, table
            others = {key: each for key, each in settings(changed, table).items() if key != name}
            wanted = {key: each for key, each in settings(sketch, table).items() if key != name}
            assert others == wanted, table
            assert set_setting(changed, table, name, value) is changed, table
            assert settings(reset_setting(changed, table, name), table)[name] == parameter.default, table

    assert list(declared(WORLD)) == list(SKETCH)
    assert all(
        labels.set_property(Sketch(), name, 1, key, parameter.default)
        for name, layer in LAYERS.items()
        for key, parameter in layer.parameters.items()
    )
