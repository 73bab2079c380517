"""Vector layers: what is refused, each in one printable line, and files of other programs."""

import io
from dataclasses import replace

import numpy as np
import pyogrio
import pytest
import shapely

from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features.files import decode_vectors, encode_vectors
from sketchterrain.features.table import AREA, LINE, POINT, Feature, FeatureTable
from sketchterrain.landuse.areas import land_use

FRAME = Sketch(frame={"crs": "EPSG:25832"}).frame
PATH = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [20.0, 20.0], [30.0, 30.0]])
TWO_LINES = {
    "vertices": PATH,
    "rings": np.array([0, 3, 5]),
    "parts": np.array([0, 1, 2]),
    "kinds": np.array([LINE, LINE]),
    "ids": np.array([7, 2]),
    "labels": np.array([1, 255]),
}


def refusal(layer="river", **changes) -> str:
    """Return the one line with which two lines that differ in some arrays are refused."""
    with pytest.raises(InputError) as caught:
        FeatureTable(layer, **TWO_LINES | changes)
    assert caught.value.exit_code == 3
    assert str(caught.value).isprintable()
    return str(caught.value)


def with_vertex(x, y):
    return np.concatenate([PATH[:1], [[x, y]], PATH[2:]])


def area(*rings) -> FeatureTable:
    features = [Feature(AREA, tuple(np.array(ring, float) for ring in rings))]
    return FeatureTable("lake").edited(add=features)


@pytest.mark.parametrize("vertex", [(np.nan, 0.0), (0.0, np.inf), (1.1e7, 0.0), (0.0, -np.inf)])
def test_vertices_are_numbers_within_reach(vertex):
    problem = refusal(vertices=with_vertex(*vertex))
    assert problem.startswith("river: vertex ")
    assert problem.endswith("expected numbers, at most 1e+07 m away")


def test_arrays_have_the_types_and_lengths_of_their_meaning():
    vertices = "vertices of river: expected numbers (m, 2), got "
    lengths = "vectors of river: their arrays do not match in length"
    whole = "expected whole numbers (n,), got "
    for changes, problem in (
        ({"vertices": PATH.ravel()}, f"{vertices}float64 (10,)"),
        ({"vertices": np.zeros((5, 3))}, f"{vertices}float64 (5, 3)"),
        ({"vertices": PATH.astype(str)}, vertices),
        ({"vertices": PATH.astype(object)}, f"{vertices}object (5, 2)"),
        ({"vertices": PATH + 1j}, f"{vertices}complex128 (5, 2)"),
        ({"rings": np.array([0, 2.5, 5])}, f"river: rings: {whole}float64 (3,)"),
        ({"rings": np.array([0, 6, 5])}, lengths),
        ({"rings": np.array([1, 3, 5])}, lengths),
        ({"rings": np.array([0, 3, 4])}, lengths),
        ({"rings": np.array([], int)}, lengths),
        ({"parts": np.array([0, 2, 2])}, lengths),
        ({"parts": np.array([0, 3, 2])}, lengths),
        ({"parts": np.array([0, 1])}, lengths),
        ({"ids": np.array([1])}, lengths),
        ({"labels": np.array([1, 1, 1])}, lengths),
        ({"kinds": np.array([LINE])}, lengths),
    ):
        assert refusal(**changes).startswith(problem), changes


def test_ids_are_unique_and_positive():
    for ids in ([0, 1], [-1, 1], [3, 3], [1, 1 << 31]):
        assert refusal(ids=np.array(ids)) == "river: expected unique ids from 1 to 2147483647"
    for ids in ([1.5, 2.0], [np.nan, 1.0], ["a", "b"], [[1, 2]], [True, False], [None, 1]):
        assert refusal(ids=np.array(ids)).startswith("river: ids: expected whole numbers (n,), got "), ids
    assert FeatureTable("river", **TWO_LINES).ids.tolist() == [7, 2]


def test_labels_are_from_1_to_255():
    assert refusal(labels=np.array([0, 1])) == "river: expected labels from 1 to 255"
    for labels in ([256, 1], [-1, 1], [1 << 40, 1]):
        assert refusal(labels=np.array(labels)) == "river: labels: expected numbers from 0 to 255"
    for labels in ([1.5, 1.0], ["1", "2"]):
        assert "labels: expected whole numbers" in refusal(labels=np.array(labels))


def test_layers_take_their_kinds_of_features_only():
    for kind in (POINT, 3, 255):
        assert refusal(kinds=np.array([LINE, kind])) == "river feature 2: expected line or area"
    assert refusal("lake") == "lake feature 7: expected area"
    assert refusal(kinds=np.array([-1, 1])) == "river: kinds: expected numbers from 0 to 255"
    assert "kinds: expected whole numbers" in refusal(kinds=np.array([1.0, 1.0]))
    for layer in ("hill", "rivers", "", "two\nlines", None, 3):
        expected = "expected a vector layer, river, lake, road, railway, path, pad, wall, landuse, powerline"
        assert refusal(layer).endswith(expected)
    one_of_two = {"parts": np.array([0, 2])}
    one_of_two |= {key: TWO_LINES[key][:1] for key in ("kinds", "ids", "labels")}
    assert refusal(**one_of_two) == "river feature 7: expected one part, unless it is an area"
    for wrong in ({"river": FeatureTable("lake")}, {"river": None}, {"a\nb": FeatureTable("river")}):
        with pytest.raises(InputError, match=r"^vectors of .*: expected a FeatureTable of that name$"):
            Sketch(vectors=wrong)


def test_repeated_vertices_are_refused():
    expected = "feature 7: expected a line of two vertices or more, none twice in a row"
    for vertex in ((0.0, 0.0), (10.0, 10.0), (0.0004, -0.0004)):  # rounded to 1/1024 m
        assert refusal(vertices=with_vertex(*vertex)) == f"river {expected}"
    assert refusal(rings=np.array([0, 1, 5])) == f"river {expected}"
    assert refusal(rings=np.array([0, 0, 5])) == f"river {expected}"
    FeatureTable("river", **TWO_LINES | {"vertices": PATH[[0, 1, 0, 1, 0]]})  # to and fro is a line

    square = [[0, 0], [9, 0], [9, 9], [0, 9]]
    for ring in (square[:2], [square[0], *square], [*square[:3], square[2]], square[:1] * 4):
        with pytest.raises(
            InputError,
            match="lake feature 1: expected an area of three vertices or more, none twice in a row",
        ):
            area(ring)


def test_areas_do_not_touch_themselves():
    square = [[0, 0], [90, 0], [90, 90], [0, 90]]
    hole = np.array([[30, 30], [60, 30], [60, 60], [30, 60]])
    assert len(area(square, hole, hole[::-1] * 0.5)) == 1
    for rings in (
        ([[0, 0], [90, 90], [90, 0], [0, 90]],),  # a bow tie
        ([*square, square[0]],),  # closed twice
        ([[0, 0], [90, 0], [90, 90], [45, 0], [0, 90]],),  # its border touches itself
        ([[0, 0], [90, 0], [50, 0]],),  # without an area
        (square, hole + 50),  # a hole across the border
        (square, hole + 500),  # a hole outside
        (square, hole, hole + 10),  # holes that overlap
        (square, square),  # no ground left
    ):
        with pytest.raises(InputError) as caught:
            area(*rings)
        assert str(caught.value).isprintable()
        assert str(caught.value).startswith("lake feature 1: expected an area"), rings


def test_properties_have_the_types_of_their_declaration():
    for values, got in (
        (("wide", ""), "width = 'wide': expected a number from 0 to 2000 m"),
        (np.array([np.nan, -5.0]), "width = -5.0: expected a number from 0 to 2000 m"),
        (np.array([np.inf, 1.0]), "width = inf: expected a number"),
        (np.array([1, 10_000]), "width = 10000: expected a number"),
    ):
        assert got in refusal(columns={"width": values})
    for values in (np.array([0.5, np.nan]), np.array([2, 0]), np.array([0, -1])):
        assert "expected a whole number from 0 to 1" in refusal(columns={"smooth": values})
    road = FeatureTable.from_shapes("road", shapely.linestrings([[(0, 0), (9, 0)], [(0, 5), (9, 5)]]))
    for columns, got in (
        ({"structure": ("bridge", "ferry")}, "road feature 2: structure = 'ferry': expected 'automatic' or"),
        ({"structure": np.zeros(2)}, "road feature 1: structure = 0.0: expected 'automatic' or 'ground' or"),
        ({"surface": np.zeros(2)}, "road feature 1: surface = 0.0: expected 'grass' or"),
        ({"lanes": np.array([np.nan, 1.5])}, "road feature 2: lanes = 1.5: expected a whole number"),
    ):
        with pytest.raises(InputError) as caught:
            replace(road, columns=columns)
        assert str(caught.value).startswith(got)
    paved = {"road": replace(road, columns={"surface": ("", "lava"), "structure": ("tunnel", "")})}
    with pytest.raises(InputError, match="road feature 2: surface = 'lava': expected 'grass' or"):
        Sketch(vectors=paved)
    assert Sketch(vectors=paved, materials={"lava": {}}).vectors["road"].feature(2).properties == {
        "surface": "lava"
    }
    for values in (
        np.zeros((2, 2)),
        np.array([True, False]),
        np.zeros(2, complex),
        np.array(["x", None], object),
        np.array(["x", "y"]),
        np.array(["2020", "2021"], "datetime64[D]"),
        ["x", "y"],
        ("x", None),
        None,
    ):
        problem = refusal(columns={"note": values})
        assert problem == "river: property note: expected an array of numbers (n,), or a tuple of texts"
    for texts in (("a\0b", ""), ("\ud800", "")):
        assert "property note: expected texts without NUL" in refusal(columns={"note": texts})
    assert "expected numbers from -9223" in refusal(columns={"note": np.full(2, 2**63, np.uint64)})
    assert refusal(columns={"note": np.zeros(3)}) == "river: property note: expected 2 values, got 3"
    for name in ("", "id", "label", "x" * 61, "two\nlines", "\ud800", 3, None):
        assert refusal(columns={name: np.zeros(2)}).endswith("expected another name"), name
    many = {f"p{number}": np.zeros(2) for number in range(61)}
    assert refusal(columns=many) == "river: 61 properties: expected at most 60"


def test_layers_have_limits(monkeypatch):
    monkeypatch.setattr("sketchterrain.features.table.MAX_FEATURE_VERTICES", 2)
    assert refusal() == "river feature 7: expected at most 2 vertices a line or border"
    monkeypatch.setattr("sketchterrain.features.table.MAX_VERTICES", 4)
    assert refusal().startswith("river: 5 vertices: expected at most ")


def test_files_of_other_programs_are_refused_in_one_line():
    line = shapely.LineString(PATH)
    whole = encode_vectors(FeatureTable("river", **TWO_LINES, columns={"note": ("a", "")}), FRAME)

    def written(shapes, *, crs="EPSG:25832", **columns):
        stream = io.BytesIO()
        values = [np.array(column) for column in columns.values()]
        pyogrio.raw.write(
            stream,
            shapely.to_wkb(np.array(shapes, dtype=object)),
            values,
            list(columns),
            driver="FlatGeobuf",
            geometry_type="Unknown",
            crs=crs,
        )
        return stream.getvalue()

    assert decode_vectors(written([line]), "river", FRAME).ids.tolist() == [1]
    for data, problem in (
        (b"", "expected a FlatGeobuf file"),
        (b"PK\x03\x04", "expected a FlatGeobuf file"),
        (whole[:40], "not a whole FlatGeobuf file"),
        (written([shapely.MultiLineString([PATH, PATH + 50])]), "not features of several lines"),
        (written([shapely.Point(1, 1)]), "river feature 1: expected line or area"),
        (written([line], crs="EPSG:4326"), "its CRS is EPSG:4326: expected that of the sketch, EPSG:25832"),
        (written([line], id=[1.5]), "property id: expected whole numbers"),
        (written([line], label=[0]), "property label: expected whole numbers from 1 to 255"),
        (written([line], label=["a"]), "property label: expected whole numbers"),
        (written([line, line], id=[4, 4]), "river: expected unique ids"),
        (written([line], width=["wide"]), "width = 'wide': expected a number"),
    ):
        with pytest.raises(InputError) as caught:
            decode_vectors(data, "river", FRAME)
        assert problem in str(caught.value)
        assert str(caught.value).isprintable()


def test_areas_of_land_use_that_nobody_should_draw():
    square = [(0, 0), (10, 0), (10, 10), (0, 10)]
    refused = {
        "does not touch itself": (
            [[(0, 0), (10, 10), (10, 0), (0, 10)]],  # a bow-tie
            [square, [(0, 2), (4, 2), (0, 6)]],  # a hole along its border
            [square, [(20, 20), (22, 20), (20, 22)]],  # a hole outside
            [[(0, 0), (10, 0), (10, 10), (10, 15), (10, 10), (0, 10)]],  # a spike
            [[(0, 0), (10, 0), (5, 0)]],  # without a size
        ),
        "three vertices or more, none twice in a row": (
            [[(0, 0), (10, 0)]],
            [[(0, 0), (10, 0), (10, 0), (10, 10)]],
            [[(0, 0), (10, 0), (10, 10), (0, 0)]],  # its first vertex again
            [[(0, 0), (0.0001, 0), (10, 10)]],  # equal when rounded
        ),
    }
    for reason, cases in refused.items():
        for rings in cases:
            feature = Feature(AREA, tuple(np.array(ring, float) for ring in rings))
            with pytest.raises(InputError, match=f"landuse feature 1: expected an area .*{reason}"):
                FeatureTable("landuse").edited(add=[feature])
    allowed = (
        [[(0, 0), (1000, 0), (500, 1 / 1024)]],  # a sliver
        [square, [(0, 0), (4, 2), (2, 4)]],  # a hole that touches its border at a vertex
        [square],
        [square],  # once more
    )
    features = [Feature(AREA, tuple(np.array(ring, float) for ring in rings)) for rings in allowed]
    layer = FeatureTable("landuse").edited(add=features)
    areas = land_use(Sketch(vectors={"landuse": layer}))
    x, y, to_x, to_y = areas.edges.T
    signed = np.add.reduceat(0.5 * (x * to_y - y * to_x), areas.first[:-1])
    assert signed.tolist() == [1000 / 2048, 94.0, 100.0, 100.0]
