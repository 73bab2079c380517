"""The document and its signals; commands on labels, properties and settings."""

from pathlib import Path

import numpy as np
import pytest

from sketchterrain.document.label_layers import label_areas
from sketchterrain.document.sketch import TABLES, Sketch
from sketchterrain.document.store import load_sketch, save_sketch
from sketchterrain.errors import InputError
from sketchterrain.schema.layers import LAYERS, PAINTED_LAYERS
from sketchterrain.schema.parameters import SKETCH
from sketchterrain.ui import commands
from sketchterrain.ui.commands import DECLARED, WORLD, set_setting, settings

from .events import paint


@pytest.fixture
def emitted(document):
    """Names of emitted signals, in order, and painted boxes."""
    names: list[str] = []
    boxes: list[tuple] = []
    for name in ("live_changed", "sketch_changed", "history_changed", "saved_changed", "opened"):
        getattr(document, name).connect(lambda name=name: names.append(name))
    document.painted.connect(lambda layer, box: boxes.append((layer, box)))
    return names, boxes


def test_a_stroke_is_visible_at_once_and_one_step(document, emitted):
    names, boxes = emitted
    before = document.sketch
    draft = document.begin_draft("lake")
    for column in range(10):
        draft.image[5:9, column] = 3
        draft.touch((5, column, 9, column + 1))
    assert document.sketch is before
    assert document.layer("lake") is draft.image
    assert set(names) == {"live_changed"}
    assert boxes == [("lake", (5, column, 9, column + 1)) for column in range(10)]
    assert draft.box == (5, 0, 9, 10)
    draft.commit("Paint lakes")
    assert document.draft is None
    assert document.history.titles == ("Open", "Paint lakes")
    assert document.sketch.layers["lake"] is draft.image
    assert not draft.image.flags.writeable
    assert (document.sketch.layers["lake"][5:9, :10] == 3).all()
    assert all(
        document.sketch.layers[name] is before.layers[name] for name in PAINTED_LAYERS if name != "lake"
    )
    assert boxes[-1] == ("lake", (5, 0, 9, 10))


def test_undo_and_redo_report_the_changed_box(document, emitted):
    names, boxes = emitted
    before = document.sketch.layers["lake"].copy()
    paint(document, "lake", (100, 200, 120, 260), 9)
    after = document.sketch.layers["lake"].copy()
    for turn, wanted in ((document.undo, before), (document.redo, after)):
        del names[:], boxes[:]
        turn()
        assert boxes == [("lake", (100, 200, 120, 260))]
        assert names == ["sketch_changed", "history_changed", "saved_changed", "live_changed"]
        np.testing.assert_array_equal(document.sketch.layers["lake"], wanted)
    document.redo()
    assert names == ["sketch_changed", "history_changed", "saved_changed", "live_changed"]


def test_cancelled_and_ineffective_strokes_record_no_step(document, emitted):
    _, boxes = emitted
    before = document.sketch
    paint(document, "lake", (0, 0, 9, 9), title=None)
    document.draft.cancel()
    assert document.sketch is before
    assert document.layer("lake") is before.layers["lake"]
    assert boxes == [("lake", (0, 0, 9, 9))] * 2
    assert document.history.titles == ("Open",)

    paint(document, "lake", (0, 0, 9, 9))
    sketch = document.sketch
    paint(document, "lake", (2, 2, 7, 7))
    paint(document, "lake", (0, 0, 9, 9), title=None)
    document.begin_draft("lake").commit("Nothing")
    assert document.sketch is sketch
    assert document.history.titles == ("Open", "Paint")


def test_too_many_labels_are_refused_and_the_layer_is_as_before(document, emitted):
    _, boxes = emitted
    document.open(Sketch())
    for label in range(1, 17):
        paint(document, "hill", (label, 0, label + 1, 9), label)
    before = document.sketch
    with pytest.raises(InputError, match="17 labels, expected at most 16"):
        paint(document, "hill", (100, 0, 101, 9), 200)
    assert document.sketch is before
    assert document.draft is None
    assert boxes[-1] == ("hill", (100, 0, 101, 9))
    paint(document, "hill", (1, 0, 2, 9), 200)  # in place of label 1
    assert set(np.unique(document.sketch.layers["hill"])) == {0, *range(2, 17), 200}
    assert not document.sketch.layers["hill"].flags.writeable


def test_modified_follows_undo_late_saves_and_recovery(document, emitted):
    path = Path("valley.sketch")
    assert not document.is_modified
    paint(document, "lake", (0, 0, 9, 9))
    assert document.is_modified
    saving = document.state
    paint(document, "lake", (20, 0, 29, 9))
    document.mark_saved(saving, path)  # after a later change
    assert (document.path, document.is_modified) == (path, True)
    document.undo()
    assert not document.is_modified
    document.undo()
    assert document.is_modified
    document.redo()
    assert not document.is_modified
    document.open(Sketch())
    document.mark_saved(saving, Path("other.sketch"))  # of the sketch before
    assert (document.path, document.is_modified) == (None, False)
    document.do("Seed", document.sketch.replace(seed=5))
    document.undo()
    assert not document.is_modified

    names, _ = emitted
    paint(document, "lake", (0, 0, 9, 9))
    sketch = document.sketch
    document.open(sketch, Path("here"), modified=True)
    assert document.is_modified
    assert names.count("opened") == 2
    assert document.history.titles == ("Open",)
    document.open(sketch, Path("here"))
    assert not document.is_modified


def test_merged_steps_are_one_and_an_equal_sketch_none(document, emitted):
    names, boxes = emitted
    key = object()
    for seed in range(20, 30):
        document.do("Set seed", document.sketch.replace(seed=seed), merge=key)
    assert document.history.titles == ("Open", "Set seed")
    assert not boxes
    del names[:]
    document.do("Set seed", document.sketch.replace(seed=29))
    document.do("Set seed", document.sketch)
    assert names == []


SEEDS = [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 6))]


@pytest.mark.parametrize("seed", SEEDS)
def test_redrawing_only_reported_boxes_equals_every_layer(document, seed):
    rng = np.random.default_rng(seed)
    document.open(Sketch(layers={"hill": np.zeros((150, 210), dtype=np.uint8)}))
    mirror: dict[str, np.ndarray] = {}
    live_changes = []

    def redraw_all():
        mirror.update({name: document.layer(name).copy() for name in PAINTED_LAYERS})

    def redraw(layer: str, box: tuple):
        image = document.layer(layer)
        if mirror[layer].shape != image.shape:
            mirror[layer] = np.full(image.shape, 255, dtype=np.uint8)
        top, left, bottom, right = box
        mirror[layer][top:bottom, left:right] = image[top:bottom, left:right]

    redraw_all()
    document.opened.connect(redraw_all)
    document.painted.connect(redraw)
    document.live_changed.connect(lambda: live_changes.append(None))
    for _ in range(150):
        before = {name: document.layer(name).copy() for name in PAINTED_LAYERS}
        emitted = len(live_changes)
        layer = str(rng.choice(list(PAINTED_LAYERS)))
        image = document.sketch.layers[layer]
        top, left = (int(rng.integers(0, side)) for side in image.shape)
        box = (top, left, min(top + 90, image.shape[0]), min(left + 90, image.shape[1]))
        match int(rng.integers(8)):
            case 0 | 1:
                paint(document, layer, box, int(rng.integers(4)), title=None)
            case 2 if document.draft is not None:
                document.draft.commit("Paint")
            case 3 if document.draft is not None:
                document.draft.cancel()
            case 4:
                document.undo()
            case 5:
                document.redo()
            case 6:
                document.go_to(int(rng.integers(len(document.history.titles))))
            case 7 if rng.random() < 0.2:
                shape = tuple(int(n) for n in rng.integers(50, 300, 2))
                layers = {name: rng.integers(0, 2, shape).astype(np.uint8) for name in PAINTED_LAYERS}
                document.do("Resize", document.sketch.replace(layers=layers), merge="a")
            case _:
                layers = {**document.sketch.layers, layer: 0 * image}
                document.do("Clear", document.sketch.replace(layers=layers))
        changed = False
        for name in PAINTED_LAYERS:
            np.testing.assert_array_equal(mirror[name], document.layer(name))
            changed |= not np.array_equal(before[name], document.layer(name))
        assert not changed or len(live_changes) > emitted


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
