"""Land use of vector maps: tags, shared borders, order, and areas that nobody should draw."""

from __future__ import annotations

import math

import numpy as np
import pytest
import shapely

from sketchterrain.document.sketch import Sketch
from sketchterrain.importing.legend import feature_label, label_properties, relevant_tags
from sketchterrain.importing.vectors import sketch_from_vectors
from tests.geo_files import write_vectors


def used(sketch: Sketch) -> list[str]:
    return sketch.vector_texts("landuse", "use")


def test_tags_give_use_and_crop() -> None:
    for tags, source, expected in (
        ({"landuse": "farmland"}, "multipolygons", {}),
        ({"landuse": "vineyard"}, "multipolygons", {"crop": "vineyard"}),
        ({"landuse": "orchard", "crop": "wheat"}, "multipolygons", {"crop": "wheat"}),
        ({"landuse": "meadow"}, "multipolygons", {"use": "meadow"}),
        ({"natural": "grassland"}, "multipolygons", {"use": "meadow"}),
        ({"natural": "heath"}, "multipolygons", {"use": "meadow"}),
        ({"landuse": "forest"}, "multipolygons", {"use": "forest"}),
        ({"natural": "wood", "density": "0.3"}, "multipolygons", {"use": "forest", "density": 0.3}),
        ({"natural": "scrub"}, "multipolygons", {"use": "forest", "density": 0.25}),
        ({"landuse": "residential"}, "multipolygons", {"use": "built_up"}),
        ({"landuse": "farmyard"}, "multipolygons", {"use": "built_up"}),
        ({"fclass": "residential"}, "gis_osm_landuse_a_free_1", {"use": "built_up"}),
        ({"layer": "landuse", "use": "meadow", "direction": 30}, "map", {"use": "meadow", "direction": 30.0}),
    ):
        label = feature_label(relevant_tags(tags), source, None)
        assert label is not None
        assert label.layer == "landuse", tags
        assert label_properties("landuse", label.label) | label.properties == expected, tags
    for tags, source, layer in (
        ({"fclass": "residential"}, "gis_osm_roads_free_1", "road"),
        ({"landuse": "reservoir"}, "multipolygons", "lake"),
        ({"natural": "scree"}, "multipolygons", "material"),
        ({"layer": "forest"}, "multipolygons", "forest"),
    ):
        assert feature_label(tags, source, None).layer == layer, tags
    assert feature_label({"landuse": "military"}, "multipolygons", None) is None


def test_neighbours_share_their_borders_and_small_areas_are_on_top(tmp_path) -> None:
    rng = np.random.default_rng(4)
    corner = np.stack(np.meshgrid(*2 * [np.arange(7.0)]), axis=-1) + rng.uniform(-0.3, 0.3, (7, 7, 2))
    corner = 600_000.0 + 173.0 * corner
    cells = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=2)
    fields = shapely.polygons(cells.reshape(-1, 4, 2))
    pond, wood = (shapely.Point(corner[3, 3]).buffer(radius, quad_segs=4) for radius in (20.0, 60.0))
    holed = np.array([each - wood for each in fields], object)  # the wood fills a hole in four of them
    shapes = [pond, *holed, wood]
    path = write_vectors(tmp_path / "map.gpkg", shapes, {"landuse": ["meadow", *36 * ["farmland"], "forest"]})
    traced = sketch_from_vectors(path, size_px=64)
    layer = traced.sketch.vectors["landuse"]
    found = layer.shapes()
    assert layer.ids.tolist() == list(range(1, 39))
    assert (np.diff(shapely.area(found)) <= 0.0).all()
    assert used(traced.sketch)[-1] == "meadow"  # in the wood
    country = found[:-1]
    # What is rounded by half a step beside a corner of the other, where the wood cuts a border.
    assert shapely.area(country).sum() == pytest.approx(shapely.union_all(country).area, abs=0.1)
    whole = write_vectors(tmp_path / "fields.gpkg", fields, {"landuse": 36 * ["farmland"]})
    cells = sketch_from_vectors(whole, size_px=64).sketch.vectors["landuse"].shapes()
    assert shapely.coverage_is_valid(cells)
    assert shapely.area(cells).sum() == shapely.union_all(cells).area


def test_areas_that_cannot_be_drawn_are_repaired_or_left_out_and_nothing_else(tmp_path) -> None:
    def ring(*places):
        return shapely.Polygon(places)

    square = shapely.box(0, 0, 100, 100)
    cases = {
        "plain": square,
        "bow-tie": ring((200, 0), (300, 100), (300, 0), (200, 100)),
        "sliver": ring((400, 0), (500, 0.004), (500, 0)),
        "collapsed sliver": ring((400, 50), (500, 50.0002), (500, 50)),
        "hole at a vertex": shapely.Polygon(
            [(600, 0), (700, 0), (700, 100), (600, 100)], [[(600, 0), (640, 20), (620, 40)]]
        ),
        "hole along its border": shapely.Polygon(
            [(800, 0), (900, 0), (900, 100), (800, 100)], [[(800, 20), (840, 20), (800, 60)]]
        ),
        "hole outside": shapely.Polygon(
            [(0, 200), (100, 200), (100, 300), (0, 300)], [[(200, 200), (210, 200), (205, 210)]]
        ),
        "no size": ring((200, 200), (300, 200), (200, 200)),
        "one point": ring((250, 250), (250, 250), (250, 250)),
        "repeated vertices": ring((400, 200), (400, 200), (500, 200), (500, 300), (500, 300), (400, 300)),
        "twice": square,
        "spike": ring((600, 200), (700, 200), (700, 300), (700, 380), (700, 300), (600, 300)),
        "several": shapely.MultiPolygon([shapely.box(0, 400, 50, 450), shapely.box(100, 400, 150, 450)]),
    }
    tags = {"landuse": len(cases) * ["farmland"], "name": list(cases)}
    path = write_vectors(tmp_path / "map.gpkg", list(cases.values()), tags)
    traced = sketch_from_vectors(path, size_px=64, bounds=(-100, -100, 1000, 500))
    layer = traced.sketch.vectors["landuse"]
    names, found = np.array(layer.columns["name"]), layer.shapes()
    area = {name: float(shapely.area(found[names == name]).sum()) for name in names}
    assert set(cases) - set(area) == {"no size", "one point", "collapsed sliver"}
    expected = {
        **dict.fromkeys(("plain", "twice", "repeated vertices", "spike"), 10_000.0),
        "bow-tie": 5_000.0,
        "sliver": 0.2,
        "several": 5_000.0,
        "hole at a vertex": 9_400.0,
        "hole along its border": 9_200.0,
    }
    for name, size in expected.items():
        assert area[name] == pytest.approx(size, abs=0.05), name
    assert area["hole outside"] >= 10_000.0
    assert (names == "bow-tie").sum() == (names == "several").sum() == 2
    (note,) = [note for note in traced.notes if note.startswith("areas that cross themselves")]
    assert note.endswith("repaired")
    (skipped,) = [note for note in traced.notes if note.startswith("skipped")]
    assert "1 that collapse to a point" in skipped
    assert "2 with areas of less than three corners" in skipped


def test_rows_of_trees_are_painted_and_areas_beyond_a_margin_are_cut(tmp_path) -> None:
    line = shapely.LineString([(100, 500), (900, 500)])
    shapes = [line, shapely.box(-9000, 0, 400, 400)]
    path = write_vectors(
        tmp_path / "map.gpkg", shapes, {"landuse": 2 * ["forest"], "width": [40.0, math.nan]}
    )
    sketch = sketch_from_vectors(path, size_px=100, bounds=(0, 0, 1000, 1000)).sketch
    assert sketch.layers["forest"][48:52, 12:88].all()
    (area,) = sketch.vectors["landuse"].shapes()
    assert area.bounds == (-500.0, 0.0, 400.0, 400.0)
    assert used(sketch) == ["forest"]
