"""Commands on labels, properties and settings."""

import numpy as np
import pytest

from sketchterrain.document.label_layers import label_areas
from sketchterrain.document.sketch import TABLES, Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import InputError
from sketchterrain.schema.layers import LAYERS
from sketchterrain.schema.parameters import SKETCH
from sketchterrain.ui import commands
from sketchterrain.ui.commands import DECLARED, WORLD, set_setting, settings


@pytest.fixture
def sketch():
    mountain = np.zeros((6, 9), np.uint8)
    mountain[1:3, 2:5] = 1
    mountain[4, :] = 3
    return Sketch(layers={"mountain": mountain}, labels={("mountain", 2): {"height": 900.0}})


def test_areas_count_painted_pixels_and_labels_are_painted_or_declared(sketch):
    assert label_areas(sketch.layers["mountain"]) == {1: 6, 3: 9}
    image = np.random.default_rng(3).integers(0, 9, (1500, 1100), dtype=np.uint8)  # several blocks of rows
    assert label_areas(image) == {label: int((image == label).sum()) for label in range(1, 9)}
    assert commands.labels_of(sketch, "mountain") == (1, 2, 3)
    assert commands.labels_of(sketch, "hill") == ()


def test_a_new_label_is_the_smallest_free_one_and_survives_a_file(sketch, tmp_path):
    assert commands.free_label(sketch, "hill") == 1
    assert commands.free_label(sketch, "mountain") == 4
    more = commands.new_label(sketch, "mountain", 4)
    assert commands.labels_of(more, "mountain") == (1, 2, 3, 4)
    assert dict(more.properties("mountain", 4)) == dict(sketch.properties("mountain", 4))
    assert commands.new_label(more, "mountain", 4) is more
    assert commands.free_label(commands.delete_label(more, "mountain", 2), "mountain") == 2
    save_sketch(more, tmp_path / "a.sketch")
    assert ("mountain", 4) in load_sketch(tmp_path / "a.sketch").labels
    for label in range(4, 17):
        sketch = commands.new_label(sketch, "mountain", label)
    with pytest.raises(InputError, match="at most 16 labels"):
        commands.free_label(sketch, "mountain")


def test_properties_are_copied_set_and_reset(sketch):
    copied = commands.new_label(sketch, "mountain", 4, source=2)
    assert copied.properties("mountain", 4) == sketch.properties("mountain", 2)
    high = commands.set_property(copied, "mountain", 4, "height", 1200.0)
    assert high.properties("mountain", 4)["height"] == 1200.0
    assert high.properties("mountain", 2)["height"] == 900.0
    assert high.layers["mountain"] is sketch.layers["mountain"]
    assert commands.set_property(high, "mountain", 4, "height", 1200.0) is high
    low = commands.set_property(high, "mountain", 4, "height", None)
    assert low.properties("mountain", 4) == sketch.properties("mountain", 1)
    assert commands.set_property(low, "mountain", 4, "height", None) is low


def test_deleting_a_label_and_clearing_a_layer_keep_other_paint_and_properties(sketch):
    before = sketch.layers["mountain"].copy()
    gone = commands.delete_label(sketch, "mountain", 3)
    assert label_areas(gone.layers["mountain"]) == {1: 6}
    assert gone.labels == sketch.labels
    assert gone.layers["hill"] is sketch.layers["hill"]
    np.testing.assert_array_equal(sketch.layers["mountain"], before)
    assert commands.labels_of(commands.delete_label(sketch, "mountain", 2), "mountain") == (1, 3)
    assert commands.delete_label(sketch, "mountain", 9) is sketch
    clear = commands.clear_layer(sketch, "mountain")
    assert not clear.layers["mountain"].any()
    assert clear.labels == sketch.labels
    assert commands.clear_layer(clear, "mountain") is clear


def test_every_setting_can_be_set_and_reset_alone(sketch):
    assert list(DECLARED[WORLD]) == list(SKETCH)
    for table in [WORLD, *TABLES]:
        for name, parameter in DECLARED[table].items():
            texts = {"crs": "EPSG:25832", "vertical": "EPSG:5773"}
            text = texts.get(name, parameter.choices[-1] if parameter.choices else "other")
            value = text if parameter.kind is str else parameter.kind(parameter.high)
            if value == parameter.default:
                value = parameter.kind(parameter.low)
            changed = set_setting(sketch, table, name, value)
            assert settings(changed, table) == settings(sketch, table) | {name: value}, name
            assert set_setting(changed, table, name, value) is changed, name
            assert settings(set_setting(changed, table, name, None), table)[name] == parameter.default, name
    for layer, declaration in LAYERS.items():
        for key, parameter in declaration.parameters.items():
            commands.set_property(Sketch(), layer, 1, key, parameter.default)
