"""Undo history against a list of past sketches."""

import tracemalloc

import numpy as np
import pytest

from sketchterrain.document.edits import Edit
from sketchterrain.document.history import History, ImageChange
from sketchterrain.document.sketch import Sketch
from sketchterrain.schema.layers import PAINTED_LAYERS


def values(sketch):
    """Return a copy of a sketch's values."""
    layers = {name: image.copy() for name, image in sketch.layers.items()}
    return {**{k: v for k, v in vars(sketch).items() if k != "layers"}, "layers": layers}


def assert_is(sketch, expected):
    for key, value in expected.items():
        if key == "layers":
            for name, image in value.items():
                np.testing.assert_array_equal(sketch.layers[name], image)
        else:
            assert getattr(sketch, key) == value


def painted(sketch, rng, *, layers=1):
    """Labels in boxes, single pixels and noise, on some layers."""
    changed = {}
    for name in rng.choice(PAINTED_LAYERS, layers, replace=False):
        image = sketch.layers[str(name)].copy()
        for _ in range(int(rng.integers(1, 4))):
            top, left = (int(rng.integers(0, side)) for side in image.shape)
            height, width = (int(rng.choice([1, 5, 70, 300])) for _ in "hw")
            part = image[top : top + height, left : left + width]
            part[:] = rng.integers(0, 5) if rng.random() < 0.7 else rng.integers(0, 5, part.shape)
        changed[str(name)] = image
    return sketch.replace(layers={**sketch.layers, **changed})


def another(sketch, rng):
    """Return a sketch after a random user action."""
    match int(rng.integers(6)):
        case 0:
            return sketch.replace(seed=int(rng.integers(1000)))
        case 1:
            return sketch.replace(
                labels={**sketch.labels, ("hill", int(rng.integers(1, 9))): {"height": 50.0}}
            )
        case 2:
            return sketch.with_edit(Edit("delete", int(rng.integers(99))))
        case 3 if rng.random() < 0.3:
            shape = (int(rng.integers(50, 300)), int(rng.integers(50, 300)))
            return sketch.replace(
                layers={name: rng.integers(0, 3, shape).astype(np.uint8) for name in sketch.layers}
            )
        case _:
            return painted(sketch, rng, layers=int(rng.integers(1, 4)))


@pytest.mark.parametrize(
    "seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 8))]
)
def test_random_undo_and_redo_restores_every_sketch(seed):
    rng = np.random.default_rng(seed)
    first = painted(Sketch(layers={"hill": np.zeros((200, 333), dtype=np.uint8)}), rng, layers=4)
    history, known, held = History(first), [values(first)], []
    for _ in range(120):
        act = rng.random()
        before = values(history.sketch)
        if act < 0.5:
            sketch = another(history.sketch, rng)
            merge = "drag" if rng.random() < 0.3 else None
            steps, position = len(history.titles), history.position
            history.record("Step", sketch, merge=merge)
            if history.position < position:  # a drag back to its start
                known[position:] = []
            elif history.position == position and len(history.titles) == steps:  # merged, or nothing changed
                known[position] = values(sketch)
            else:
                known[position + 1 :] = [values(sketch)]
        else:
            position = int(np.clip(history.position + rng.integers(-4, 5), 0, len(known) - 1))
            layers = dict(history.sketch.layers)
            boxes = history.go_to(position)
            for name, image in history.sketch.layers.items():
                if name not in boxes:
                    assert image is layers[name]
                elif image.shape == layers[name].shape:
                    top, left, bottom, right = boxes[name]
                    outside = before["layers"][name] != image
                    outside[top:bottom, left:right] = False
                    assert not outside.any()
        if rng.random() < 0.1:
            held.append(history.sketch)  # referenced elsewhere
        assert history.position < len(history.titles) == len(known)
        assert_is(history.sketch, known[history.position])
    for position in rng.permutation(len(known)):
        history.go_to(int(position))
        assert_is(history.sketch, known[position])


def test_a_step_keeps_its_key():
    history = History(Sketch())
    saved = history.sketch.replace(seed=7)
    history.record("Seed", saved)
    key = history.key
    history.record("Name", saved.replace(name="Alps"))
    assert history.key != key
    assert history.go_to(1) == {}
    assert history.key == key
    history.record("Seed", saved.replace(seed=8))
    assert history.key != key
    # An equal sketch is no step.
    current, titles = history.sketch, history.titles
    copies = {name: image.copy() for name, image in current.layers.items()}
    assert history.record("Nothing", current.replace(seed=current.seed, layers=copies)) == {}
    assert history.titles == titles
    assert history.sketch is current


def test_merged_steps():
    history = History(Sketch())
    for seed in range(1, 20):
        history.record("Drag", history.sketch.replace(seed=seed), merge="a")
    history.record("Drag", history.sketch.replace(seed=99), merge="b")
    assert history.titles == ("Open", "Drag", "Drag")
    history.go_to(1)
    assert history.sketch.seed == 19
    history.record("Drag", history.sketch.replace(seed=5), merge="a")  # after an undo it is another drag
    assert history.titles == ("Open", "Drag", "Drag")
    history.go_to(1)
    assert history.sketch.seed == 19
    history.go_to(0)
    assert history.sketch.seed == 0

    history = History(Sketch())
    history.record("Name", history.sketch.replace(name="Alps"))
    before = history.sketch
    for seed in (1, 2, 3):
        history.record("Drag", before.replace(seed=seed), merge="a")
    history.record("Drag", before, merge="a")
    assert (history.titles, history.position) == (("Open", "Name"), 1)
    assert history.sketch is before
    for seed in (4, 5):
        history.record("Drag", before.replace(seed=seed), merge="a")
    assert history.titles == ("Open", "Name", "Drag")
    history.go_to(1)
    assert (history.sketch.seed, history.sketch.name) == (0, "Alps")


def test_steps_and_memory_are_limited():
    rng = np.random.default_rng(4)
    history = History(Sketch(), most_bytes=300_000)
    known = []
    for step in range(40):
        image = rng.integers(0, 9, (512, 512)).astype(np.uint8)
        image[rng.integers(60, 200) :] = 0
        history.record(
            f"Noise {step}", history.sketch.replace(layers={**history.sketch.layers, "hill": image})
        )
        known.append(image)
        assert history.bytes <= 300_000 or len(history.titles) == 2
    assert 2 <= len(history.titles) < 12
    for position in range(len(history.titles) - 1, -1, -1):
        history.go_to(position)
        number = 40 - len(history.titles) + position
        assert history.titles[position] == f"Noise {number}"
        np.testing.assert_array_equal(history.sketch.layers["hill"], known[number])

    history = History(Sketch(), most_steps=5)
    for seed in range(1, 30):
        history.record(f"Seed {seed}", history.sketch.replace(seed=seed))
    assert history.titles == tuple(f"Seed {seed}" for seed in range(24, 30))
    for position in (-1, 6):
        with pytest.raises(IndexError, match="expected 0 to 5"):
            history.go_to(position)
    history.go_to(0)
    assert history.sketch.seed == 24


def test_layer_changes_are_reversible_with_tight_boxes():
    rng = np.random.default_rng(5)
    for _ in range(60):
        shape = tuple(int(n) for n in rng.integers(1, 260, 2))
        before = np.repeat(rng.integers(0, 3, (shape[0], 1)), shape[1], axis=1).astype(np.uint8)
        after = before.copy()
        top, left = (int(rng.integers(0, side)) for side in shape)
        after[top : top + int(rng.integers(1, 99)), left : left + int(rng.integers(1, 99))] += 1
        change = ImageChange.between(before, after)
        rows, columns = ((before != after).any(axis=axis).nonzero()[0] for axis in (1, 0))
        assert change.box == (rows[0], columns[0], rows[-1] + 1, columns[-1] + 1)
        np.testing.assert_array_equal(change.apply(before.copy()), after)
        np.testing.assert_array_equal(change.revert(after.copy()), before)
        hinted = ImageChange.between(before, after, within=change.box)
        assert (hinted.box, hinted.bytes) == (change.box, change.bytes)
        assert ImageChange.between(after, after.copy()) is None
    before = np.zeros((128, 128), dtype=np.uint8)
    after = before.copy()
    after[60:70, 5:90] = 4
    assert ImageChange.between(before, after).new_labels == {4}
    assert ImageChange.between(after, before).new_labels == set()


def test_stroke_on_a_large_sketch_is_a_small_step():
    image = np.zeros((4096, 4096), dtype=np.uint8)
    history = History(Sketch(layers={"hill": image}))
    after = image.copy()
    after[1000:1200, 500:3000] = 1
    sketch = history.sketch.replace(layers={**history.sketch.layers, "hill": after})
    tracemalloc.start()
    history.record("Paint", sketch)
    assert tracemalloc.get_traced_memory()[1] < 1 << 20  # no array of the whole image
    tracemalloc.stop()
    assert history.bytes < 30_000
