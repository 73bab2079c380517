"""What is sent of a document, and that a mirror of it is the document."""

from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.ui.engine.sketch_updates import SketchMirror, UpdateMaker, settings_of
from sketchterrain.ui.models.document import Document


@pytest.fixture
def document(qapp):
    return Document(Sketch(layers={"hill": np.zeros((40, 60), np.uint8)}))


@pytest.fixture
def maker(document):
    made = UpdateMaker(document)
    made.start(lambda: None)
    yield made
    made.stop()


def same(sketch: Sketch, document: Document) -> bool:
    layers = all(np.array_equal(sketch.layers[name], document.layer(name)) for name in LAYERS)
    return layers and settings_of(sketch) == settings_of(document.sketch)


def paint(document, layer, rng, *, commit=True):
    draft = document.begin_draft(layer)
    top, left = int(rng.integers(0, 30)), int(rng.integers(0, 50))
    bottom, right = top + int(rng.integers(1, 10)), left + int(rng.integers(1, 10))
    draft.image[top:bottom, left:right] = rng.integers(0, 4)
    draft.touch((top, left, bottom, right))
    if commit:
        draft.commit("Paint")


def test_the_first_update_holds_everything_and_a_stroke_its_box_only(document, maker) -> None:
    update, fresh = maker.next()
    assert fresh
    assert set(update.layers) == set(LAYERS)
    assert update.shape == (40, 60)

    maker.next()
    draft = document.begin_draft("mountain")
    draft.image[10:12, 20:25] = 1
    draft.touch((10, 20, 12, 25))
    update, fresh = maker.next()
    assert not fresh
    assert list(update.layers) == ["mountain"]
    assert update.layers["mountain"].pixels.shape == (2, 5)
    draft.image[10:12, 20:25] = 2  # the stroke goes on: what was sent stays
    assert (update.layers["mountain"].pixels == 1).all()


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 4))])
def test_a_mirror_follows_strokes_undo_settings_and_other_documents(document, maker, seed):
    rng = np.random.default_rng(seed)
    mirror = SketchMirror()
    mirror.apply(maker.next()[0])
    for turn in range(60):
        choice = int(rng.integers(0, 7))
        if choice <= 2:
            paint(document, str(rng.choice(list(LAYERS))), rng, commit=choice > 0)
        elif choice == 3:
            document.undo()
        elif choice == 4:
            document.redo()
        elif choice == 5:
            document.do("Set seed", document.sketch.replace(seed=int(rng.integers(0, 99))))
        elif turn % 3 == 0:
            side = int(rng.integers(30, 70))
            document.open(Sketch(layers={"hill": np.ones((side, 60), np.uint8)}))
        if rng.random() < 0.5:
            mirror.apply(maker.next()[0])
    mirror.apply(maker.next()[0])
    assert same(mirror.sketch(), document)


def test_a_mirror_of_a_mirror_follows_too(document, maker):
    rng = np.random.default_rng(9)
    first, second = SketchMirror(), SketchMirror()
    for _ in range(20):
        paint(document, str(rng.choice(list(LAYERS))), rng)
        first.apply(maker.next()[0])
        if rng.random() < 0.4:
            second.apply(first.changes())
    second.apply(first.changes())
    assert same(second.sketch(), document)
    assert second.version == first.version


def test_what_stays_as_it_was_stays_the_same_array(document, maker):
    mirror = SketchMirror()
    mirror.apply(maker.next()[0])
    before = mirror.sketch()
    draft = document.begin_draft("mountain")
    draft.image[3:5, 3:5] = 1
    draft.touch((3, 3, 5, 5))
    mirror.apply(maker.next()[0])
    stroke = mirror.sketch()
    assert stroke.layers["hill"] is before.layers["hill"]
    assert stroke.layers["mountain"] is not before.layers["mountain"]
    draft.commit("Paint mountains")
    update, _ = maker.next()
    mirror.apply(update)
    assert mirror.sketch().layers["mountain"] is stroke.layers["mountain"]


def test_nothing_is_told_after_stop(document):
    told = []
    maker = UpdateMaker(document)
    maker.start(lambda: told.append(1))
    paint(document, "hill", np.random.default_rng(0))
    assert told
    maker.stop()
    told.clear()
    paint(document, "hill", np.random.default_rng(5))
    assert told == []
