import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sketchterrain.document.edits import ACTIONS, ADDED_BIT, MAX_EDITS, Edit
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import SETTINGS, file_limit
from sketchterrain.document.toml_format import parse_settings, settings_text
from sketchterrain.errors import InputError

HILL = Edit("add", type="hill", x=10.0, y=20.0, radius=30.0, strength=5.0)


def _value(parameter):
    if parameter.choices:
        return st.sampled_from(parameter.choices)
    if parameter.name == "strength":
        return st.floats(0.0, 1.0)  # what a forest can have too
    if parameter.kind is int:
        return st.integers(int(parameter.low), int(parameter.high))
    return st.floats(parameter.low, parameter.high)


def _edits(action):
    declared = ACTIONS[action]
    values = st.fixed_dictionaries(
        {name: _value(parameter) for name, parameter in declared.required.items()},
        optional={name: _value(parameter) for name, parameter in declared.optional.items()},
    ).filter(lambda given: ("from_x" in given) == ("from_y" in given))
    return st.builds(lambda feature, given: Edit(action, feature, **given), st.integers(0, 2**64 - 1), values)


@settings(max_examples=40)
@given(st.lists(st.sampled_from(list(ACTIONS)).flatmap(_edits), max_size=6))
def test_edits_round_trip_through_the_settings(edits):
    sketch = Sketch(edits=tuple(edits))
    again = parse_settings(settings_text(sketch).encode())
    assert again.edits == sketch.edits
    assert settings_text(again) == settings_text(sketch)


def test_refused_edits_and_the_largest_file():
    text = b'format = 1\n[[edit]]\naction = "move_point"\nfeature = 12\nindex = 3\nx = 5\ny = -2.5\n'
    assert parse_settings(text).edits == (Edit("move_point", 12, index=3, x=5.0, y=-2.5),)
    with pytest.raises(InputError, match=f"expected at most {MAX_EDITS}"):
        Sketch(edits=(HILL,) * (MAX_EDITS + 1))
    with pytest.raises(InputError, match="from_x and from_y"):
        Edit("move_point", 4, index=0, x=0.0, y=0.0, from_x=3.0)

    third = {name: parameter.high / 3 for name, parameter in ACTIONS["lock"].values.items()}
    lock = Edit("lock", 2**64 - 1, **(third | {"type": "mountain"}))
    text = settings_text(Sketch(edits=(lock,) * MAX_EDITS)).encode()
    assert len(text) < 0.6 * file_limit(SETTINGS)


def test_added_features_have_hashed_ids():
    again = Edit("add", type="hill", x=10, y=20, radius=30, strength=5)
    assert again == HILL
    assert HILL.feature == 8863291655238906495  # for ever
    assert HILL.feature & ADDED_BIT
    assert HILL.feature < 2**63
    assert dataclasses.replace(HILL, x=11.0).feature != HILL.feature


def test_edits_supersede_earlier_ones():
    sketch = Sketch().with_edit(Edit("move", 1, x=0.0, y=0.0)).with_edit(Edit("resize", 1, radius=5.0))
    sketch = sketch.with_edit(Edit("move", 1, x=9.0, y=9.0)).with_edit(Edit("move", 2, x=1.0, y=1.0))
    assert [(e.action, e.feature) for e in sketch.edits] == [("resize", 1), ("move", 1), ("move", 2)]
    points = Sketch()
    for index in (0, 1, 0):
        points = points.with_edit(Edit("move_point", 4, index=index, x=0.0, y=0.0))
    assert [edit.index for edit in points.edits] == [1, 0]
    # A control point that is named by where it was is another target each time.
    first = Edit("move_point", 4, index=0, x=5.0, y=5.0, from_x=0.0, from_y=0.0)
    onward = Edit("move_point", 4, index=0, x=9.0, y=9.0, from_x=5.0, from_y=5.0)
    assert Sketch().with_edit(first).with_edit(onward).edits == (first, onward)
    # Painting keeps edits.
    painted = sketch.replace(layers={"hill": np.ones((9, 9), np.uint8)})
    assert painted.edits == sketch.edits

    sketch = Sketch().with_edit(Edit("move", 1, x=0.0, y=0.0)).with_edit(Edit("delete", 1))
    assert sketch.edits == (Edit("delete", 1),)
    assert HILL.feature is not None
    added = sketch.with_edit(HILL).with_edit(Edit("resize", HILL.feature, radius=5.0))
    assert added.with_edit(Edit("delete", HILL.feature)).edits == sketch.edits
