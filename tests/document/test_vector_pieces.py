"""Large layers: edits share pieces, and equal layers made afresh; their history and areas of land use."""

from __future__ import annotations

import dataclasses
import pickle

import numpy as np
import pytest

from sketchterrain.document.history import History
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features import edits as edits
from sketchterrain.features.table import AREA, Feature, FeatureTable
from sketchterrain.landuse.areas import land_use

from .random_documents import content_of

SIDE = 40  # fields along a side
STEP = 100.0  # m
STEPS = 250  # of a history


@pytest.fixture(scope="module")
def fields() -> FeatureTable:
    """Return a jittered grid of fields that share their corners."""
    rng = np.random.default_rng(5)
    corner = STEP * np.stack(np.meshgrid(np.arange(SIDE + 1), np.arange(SIDE + 1)), axis=-1)
    corner = corner + rng.uniform(-0.2, 0.2, corner.shape) * STEP
    ring = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=2)
    count = SIDE * SIDE
    return FeatureTable(
        "landuse",
        ring.reshape(-1, 2),
        np.arange(count + 1) * 4,
        np.arange(count + 1),
        np.full(count, AREA, np.uint8),
        np.arange(1, count + 1),
        np.ones(count, np.uint8),
        {
            "use": tuple(rng.choice(["field", "meadow", ""], count).tolist()),
            "direction": np.where(rng.random(count) < 0.5, np.nan, 45.0),
            "lot": np.arange(count),
        },
    )


def fresh(layer: FeatureTable) -> FeatureTable:
    """Return an equal layer that is checked as a whole."""
    return FeatureTable(layer.layer, *layer._arrays, dict(layer.columns))


def random_edit(rng: np.random.Generator, layer: FeatureTable) -> FeatureTable:
    name = int(rng.choice(layer.ids))
    feature = layer.feature(name)
    (x, y), index = feature.rings[0][0].tolist(), int(rng.integers(len(feature.rings[0])))
    match int(rng.integers(6)):
        case 0:
            return edits.move_node(layer, (x, y), (x + 7.0, y - 3.0))
        case 1:
            place = 0.5 * (feature.rings[0][index] + np.roll(feature.rings[0], -1, axis=0)[index])
            return edits.insert_vertices(layer, name, [index], [place])
        case 2:
            return edits.delete_vertex(layer, name, index)
        case 3:
            return edits.set_value(layer, name, "crop", str(rng.choice(["maize", "wheat"])))
        case 4:
            return layer.edited(remove=[name])
        case _:
            ring = np.array([[-60.0, 0.0], [-10.0, 0.0], [-30.0, 40.0]]) - rng.integers(1000)
            return layer.edited(add=[Feature(AREA, (ring,), 2, {"use": "forest"})])


def test_random_edits_equal_fresh_layers(fields):
    rng = np.random.default_rng(11)
    layer = fields
    for _ in range(120):
        before, layer = layer, random_edit(rng, layer)
        assert len(layer.pieces) > 4
        assert len(set(layer.pieces) - set(before.pieces)) <= 6
    again = fresh(layer)  # it has whole and valid features, and unique ids
    sent = pickle.loads(pickle.dumps(layer))  # noqa: S301
    assert content_of(again) == content_of(layer) == content_of(sent)
    assert (len(layer), layer.vertex_count) == (len(again), len(again.vertices))
    for name in layer.ids[:: len(layer) // 20].tolist():
        one, other = layer.feature(name), again.feature(name)
        assert (one.label, one.properties) == (other.label, other.properties)
    with pytest.raises(InputError, match="feature 1000000: expected one that the layer has"):
        layer.feature(10**6)


def test_edits_keep_places_and_the_rest_of_the_layer(fields):
    names = [3, 700, SIDE * SIDE]
    layer = fields.edited(names, [fields.feature(700)])
    assert layer.ids.tolist() == [each for each in fields.ids.tolist() if each not in (names[0], names[2])]
    assert layer.columns["lot"].dtype == np.int64
    whole = fields.edited(add=[Feature(AREA, (fields.ring(0) - 200.0,), 1, {"lot": 0.5})])
    assert (whole.columns["lot"][:-1] == fields.columns["lot"]).all()
    assert (whole.columns["lot"][-1], whole.columns["use"][-1]) == (0.5, "")
    assert whole.ids[-1] == SIDE * SIDE + 1
    assert not len(fields.edited(remove=fields.ids.tolist()))


def test_edits_refuse_what_a_layer_refuses(fields):
    bow_tie = np.array([[0.0, 0.0], [9.0, 9.0], [9.0, 0.0], [0.0, 9.0]])
    with pytest.raises(InputError, match="landuse feature 1601: expected an area that does not touch itself"):
        fields.edited(add=[Feature(AREA, (bow_tie,))])
    with pytest.raises(InputError, match="id 40: expected unique ids"):
        fields.edited(add=[Feature(AREA, (fields.ring(0),), id=40)])
    with pytest.raises(InputError, match="crop = 'hops': expected"):
        edits.set_value(fields, 5, "crop", "hops")
    corner = tuple(fields.ring(SIDE + 1)[0].tolist())
    with pytest.raises(InputError, match="does not touch itself"):
        edits.move_node(fields, corner, (corner[0] + 5.0 * STEP, corner[1]))


def test_steps_keep_what_they_changed(fields):
    history = History(Sketch(extent=SIDE * STEP, vectors={"landuse": fields}))
    rng = np.random.default_rng(3)
    for number in range(STEPS):
        layer = history.sketch.vectors["landuse"]
        x, y = layer.feature(int(rng.integers(1, SIDE * SIDE))).rings[0][0].tolist()
        moved = edits.move_node(layer, (x, y), (x + 0.5, y))
        assert moved.vertices is not None  # as a canvas reads it
        history.record(f"Move {number}", history.sketch.replace(vectors={"landuse": moved}))
    assert len(history.titles) == STEPS + 1
    assert history.bytes < STEPS / 5 * fields.nbytes  # an edit changes one or two of 6 pieces
    joined = sum("vertices" in step.settings["vectors"]["landuse"].__dict__ for step in history._steps)
    assert joined == 2  # the first and the last
    last = content_of(history.sketch.vectors["landuse"])
    history.go_to(0)
    assert history.sketch.vectors["landuse"] is fields
    history.go_to(STEPS)
    assert (
        content_of(history.sketch.vectors["landuse"])
        == last
        == content_of(fresh(history.sketch.vectors["landuse"]))
    )


def test_land_use_of_an_edited_layer_equals_a_fresh_one(fields):
    sketch = Sketch(
        extent=SIDE * STEP, vectors={"landuse": fields}, labels={("landuse", 2): {"use": "forest"}}
    )
    before, rng, layer = land_use(sketch), np.random.default_rng(8), fields
    for _ in range(12):
        layer = random_edit(rng, layer)
        areas = land_use(sketch.replace(vectors={"landuse": layer}))
        again = land_use(sketch.replace(vectors={"landuse": fresh(layer)}))
        for name in (each.name for each in dataclasses.fields(areas)):
            assert getattr(areas, name).tobytes() == getattr(again, name).tobytes(), name
        removed, added = areas.difference(before)
        for one, other in zip((removed, added), again.difference(land_use(sketch)), strict=True):
            assert one.tolist() == other.tolist()
        sent = pickle.loads(pickle.dumps(areas))  # noqa: S301
        assert sent.edges.tobytes() == again.edges.tobytes()
    relabelled = land_use(sketch.replace(labels={("landuse", 1): {"use": "built_up"}}))
    assert (relabelled.use != before.use).any()


def test_land_use_is_sorted_by_id_whatever_the_order_of_the_features(fields):
    rng = np.random.default_rng(2)
    shuffled = fields._taken(rng.permutation(len(fields)))
    one, other = (
        land_use(Sketch(extent=SIDE * STEP, vectors={"landuse": each})) for each in (fields, fresh(shuffled))
    )
    for name in ("ids", "use", "first", "edges"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
