"""Edits of vector layers: nodes, vertices, splitting, joining, text."""

import numpy as np
import pytest

from sketchterrain.errors import InputError
from sketchterrain.features import edits as edits
from sketchterrain.features.table import AREA, LINE, Feature, FeatureTable


def line(*points, **properties):
    return Feature(LINE, (np.array(points, float),), 1, properties)


def area(*rings):
    return Feature(AREA, tuple(np.array(ring, float) for ring in rings))


def places(layer, name, ring=0):
    return [tuple(place) for place in layer.feature(name).rings[ring].tolist()]


@pytest.fixture
def rivers():
    """Two rivers that meet at (10, 0), and a third one elsewhere."""
    return FeatureTable("river").edited(
        add=[
            line((0, 0), (5, 1), (10, 0), smooth=1, name="Inn"),
            line((20, 5), (10, 0), width=4.5),
            line((0, 50), (9, 50)),
        ]
    )


def square(west, south, side):
    return [(west, south), (west + side, south), (west + side, south + side), (west, south + side)]


def test_a_node_moves_in_every_feature_and_snaps_to_another(rivers):
    moved = edits.move_node(rivers, (10.0, 0.0), (11.0, 3.0))
    assert places(moved, 1)[-1] == places(moved, 2)[-1] == (11.0, 3.0)
    assert moved.feature(1).properties == {"smooth": 1, "name": "Inn"}
    joined = edits.move_node(rivers, (0.0, 50.0), (10.0, 0.0))
    assert len([*joined.features_at(10.0, 0.0)]) == 3
    # Onto its neighbour: the vertex is one, and a line of one vertex is no line.
    assert places(edits.move_node(rivers, (5.0, 1.0), (10.0, 0.0)), 1) == [(0.0, 0.0), (10.0, 0.0)]
    assert edits.move_node(rivers, (0.0, 50.0), (9.0, 50.0)).ids.tolist() == [1, 2]


def test_vertices_are_inserted_and_deleted(rivers):
    more = edits.insert_vertices(rivers, 1, [1], [[7.0, 2.0]])
    assert places(more, 1) == [(0, 0), (5, 1), (7, 2), (10, 0)]
    assert places(more, 2) == places(rivers, 2)
    fewer = edits.delete_vertex(more, 1, 2)
    np.testing.assert_array_equal(fewer.vertices, rivers.vertices)
    gone = edits.delete_vertex(rivers, 2, 0)  # of the line of two
    assert gone.ids.tolist() == [1, 3]
    assert places(gone, 3) == places(rivers, 3)
    there_and_back = FeatureTable("river").edited(add=[line((0, 0), (5, 0), (0, 0), (9, 9))])
    assert places(edits.delete_vertex(there_and_back, 1, 1), 1) == [(0, 0), (9, 9)]


def test_deleting_from_areas_deletes_holes_then_the_area():
    lakes = FeatureTable("lake").edited(
        add=[area(square(0, 0, 100), [(10, 10), (20, 10), (20, 20)]), area(square(200, 0, 10))]
    )
    no_hole = edits.delete_vertex(lakes, 1, 5)
    assert len(no_hole.feature(1).rings) == 1
    assert places(no_hole, 2) == square(200, 0, 10)
    triangle = edits.delete_vertex(no_hole, 1, 0)
    assert len(places(triangle, 1)) == 3
    assert edits.delete_vertex(triangle, 1, 0).ids.tolist() == [2]
    with pytest.raises(InputError, match="touch itself"):
        edits.move_node(lakes, (0.0, 0.0), (90.0, 120.0))
    # First and last vertex of a border become one.
    assert places(edits.move_node(lakes, (200.0, 10.0), (200.0, 0.0)), 2) == [(210, 0), (210, 10), (200, 0)]


def test_a_split_line_is_joined_again(rivers):
    split = edits.split_line(rivers, 1, 1)
    assert places(split, 1) == [(0, 0), (5, 1)]
    last = int(split.ids[-1])
    assert places(split, last) == [(5, 1), (10, 0)]
    assert split.feature(last).properties == rivers.feature(1).properties
    assert places(edits.join_lines(split, 1), 1) == places(rivers, 1)
    for index in (0, 2, 9):
        with pytest.raises(InputError, match="between its ends"):
            edits.split_line(rivers, 1, index)


def test_joining_reverses_the_other_line_as_needed(rivers):
    joined = edits.join_lines(rivers, 1)
    assert places(joined, 1) == [(0, 0), (5, 1), (10, 0), (20, 5)]
    assert joined.feature(1).properties == {"smooth": 1, "name": "Inn"}
    assert joined.ids.tolist() == [1, 3]
    assert places(edits.join_lines(rivers, 2), 2) == [(20, 5), (10, 0), (5, 1), (0, 0)]
    back = edits.reverse_line(rivers, 1)
    assert places(back, 1) == [(10, 0), (5, 1), (0, 0)]
    assert places(edits.join_lines(back, 1), 1) == [(20, 5), (10, 0), (5, 1), (0, 0)]
    # Of two at one end the straighter; at the active end if that is shared.
    more = rivers.edited(add=[line((10, 0), (20, -4.5)), line((0, 0), (-3, -3))])
    assert places(edits.join_lines(more, 1, 2), 1)[-1] == (20, -4.5)
    assert places(edits.join_lines(more, 1, 0), 1)[0] == (-3, -3)
    with pytest.raises(InputError, match="shares an end"):
        edits.join_lines(rivers, 3)


def test_values_are_set_and_removed(rivers):
    wide = edits.set_value(rivers, 1, "width", 40.0)
    assert wide.feature(1).properties == {"smooth": 1, "name": "Inn", "width": 40.0}
    assert edits.set_value(wide, 1, "width", None).feature(1).properties == rivers.feature(1).properties
    assert edits.set_value(wide, 1, "label", 3).feature(1).label == 3
    with pytest.raises(InputError, match="width"):
        edits.set_value(rivers, 1, "width", -4.0)


def test_text_round_trip_is_exact(rivers):
    third = edits.on_grid([1.0 / 3.0, 1e6 / 7.0])
    rivers = rivers.edited(add=[line(third, (2.5, 1), note="å", width=0.1), area(square(30, 30, 9))])
    name, features = edits.from_text(
        edits.to_text("river", [rivers.feature(each) for each in rivers.ids.tolist()])
    )
    assert name == "river"
    copy = FeatureTable("river").edited(add=features)
    for each in rivers.ids.tolist():
        one, other = rivers.feature(each), copy.feature(each)
        assert (one.kind, one.label, one.properties) == (other.kind, other.label, other.properties)
        for ring, same in zip(one.rings, other.rings, strict=True):
            np.testing.assert_array_equal(ring, same)
    beside = edits.moved(features[0], 3.0, -2.0)
    assert (beside.rings[0][0].tolist(), beside.id) == ([3.0, -2.0], 0)


@pytest.mark.parametrize(
    "text",
    [
        *("", "{}", "[]", "null", "[[[[", '{"sketchterrain": "river", "features": 3}'),
        '{"sketchterrain": "river", "features": []}',
        '{"sketchterrain": "river", "features": [{"geometry": {"type": "Polygon", "coordinates": [[0]]}}]}',
        edits.to_text("lake", [area(square(0, 0, 9))]).replace("lake", "river2"),
        edits.to_text("lake", [area(square(0, 0, 9))]).replace("9.0", "NaN"),
        edits.to_text("lake", [area(square(0, 0, 9))]).replace("9.0", "[9]"),
    ],
)
def test_other_text_is_refused(text):
    with pytest.raises(InputError):
        edits.from_text(text)
