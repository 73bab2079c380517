"""Vector files as draped layers: what is stored, generalised, found and left out."""

import itertools
import subprocess
import sys

import numpy as np
import pyogrio
import pytest
import shapely

from sketchterrain.document.drapes import DrapeClass, DrapedLayer, draped_feature
from sketchterrain.drape.drapes import BUDGET, Drapes, Pick
from sketchterrain.drape.vector_store import open_table
from sketchterrain.features.items import AFTER, BEFORE, ENDS, FILL, POINT, STARTS, STROKE
from sketchterrain.features.levels import PIECE, RUN, parts_of, split_shapes, subdivided

EXTENT = 1000.0
FRAME = {"crs": "EPSG:32631", "east": 500_000.0, "north": 4_700_000.0}
CORNER = np.array([FRAME["east"], FRAME["north"]])
ALL = (-1e5, -1e5, 1e5, 1e5)


def write(path, shapes, fields=None, *, crs="EPSG:32631", corner=CORNER, **options):
    """Write shapes in metres of the sketch."""
    shapes = shapely.transform(np.array(shapes, object), lambda at: at + corner, include_z=False)
    return write_as_is(path, shapes, fields, crs=crs, **options)


def write_as_is(path, shapes, fields=None, *, crs="EPSG:32631", **options):
    driver = {".fgb": "FlatGeobuf", ".gpkg": "GPKG", ".geojson": "GeoJSON"}[path.suffix]
    if driver == "FlatGeobuf":
        options["layer_options"] = {"SPATIAL_INDEX": "NO"}
    fields = fields or {"number": np.arange(len(shapes))}
    wkb = shapely.to_wkb(np.array(shapes, object))
    values = [np.asarray(each) for each in fields.values()]
    with pytest.warns() if crs is None else Quiet():
        pyogrio.raw.write(
            path, wkb, values, list(fields), driver=driver, crs=crs, geometry_type="Unknown", **options
        )
    return path


class Quiet:
    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass


def opened(*layers, frame=FRAME, extent=EXTENT):
    layers = [each if isinstance(each, DrapedLayer) else layer(each) for each in layers]
    return Drapes.open(layers, frame, (extent, extent), extent)


def layer(path, **values):
    return DrapedLayer(str(path)).replace(**{"fill": "#00ff00", "unit": "m", **values})


def area_of(items, feature=None):
    """Return the sum of the signed areas of fills."""
    which = items.kind == FILL if feature is None else (items.kind == FILL) & (items.feature == feature)
    return sum(
        signed_area(items.points[a:b])
        for a, b in zip(items.first[:-1][which], items.first[1:][which], strict=True)
    )


def signed_area(ring):
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def strokes_of(items, feature):
    """Return the length of a feature's runs without the points before and after."""
    total = 0.0
    for at in np.flatnonzero((items.kind == STROKE) & (items.feature == feature)):
        run = items.points[items.first[at] : items.first[at + 1]]
        run = run[bool(items.ends[at] & BEFORE) : len(run) - bool(items.ends[at] & AFTER)]
        total += np.hypot(*np.diff(run, axis=0).T).sum()
    return total


def random_shapes(count, seed=0, size=10.0, extent=EXTENT):
    """Return lines, areas with holes and points in turn."""
    random = np.random.default_rng(seed)
    shapes = []
    for number in range(count):
        at = random.uniform(0.0, extent, 2)
        angle = np.sort(random.uniform(0.0, 2.0 * np.pi, 9))
        ring = at + size * random.uniform(0.5, 1.0, (9, 1)) * np.stack([np.cos(angle), np.sin(angle)], -1)
        if number % 3 == 0:
            shapes.append(shapely.LineString(at + np.cumsum(random.normal(0.0, size / 3.0, (9, 2)), axis=0)))
        elif number % 3 == 1:
            shapes.append(shapely.Polygon(ring))
        else:
            shapes.append(shapely.Point(at))
    return shapes


def test_features_come_back_as_they_were_in_each_format(tmp_path) -> None:
    shapes = [*random_shapes(30), shapely.MultiPolygon([shapely.box(0, 0, 9, 9), shapely.box(20, 0, 29, 9)])]
    names = np.array([None, *(f"n{k}" for k in range(1, 31))], object)
    for suffix in (".fgb", ".gpkg", ".geojson"):
        crs = "EPSG:4326" if suffix == ".geojson" else "EPSG:32631"
        inside = shapes if crs != "EPSG:4326" else [shapely.transform(s, _to_degrees) for s in shapes]
        fields = {"name": names, "size": np.arange(31) * 0.5, "count": np.arange(31)}
        path = write(
            tmp_path / f"map{suffix}", inside, fields, crs=crs, corner=CORNER * (suffix != ".geojson")
        )
        drapes = opened(path)
        assert drapes.problems == ()
        assert drapes.sources[0].facts["left_out"] == 0
        for number, shape in enumerate(shapes):
            table, values = drapes.table(0), {"name": names[number], "size": number / 2, "count": number}
            assert shapely.equals_exact(table.geometry(number), shape, 1e-6), (suffix, number)
            assert table.feature(number).properties == {k: v for k, v in values.items() if v is not None}
        assert drapes.features(0, ALL).tolist() == list(range(31))


def _to_degrees(points):
    from rasterio.warp import transform

    x, y = transform("EPSG:32631", "EPSG:4326", *(points + CORNER).T)
    return np.stack([x, y], axis=-1)


def test_items_are_in_drawing_order_with_fills_first(tmp_path) -> None:
    low = write(tmp_path / "low.fgb", random_shapes(60))
    high = write(tmp_path / "high.fgb", random_shapes(60, seed=1))
    edit = draped_feature(shapely.box(10, 10, 90, 90), {}, 4)
    items = opened(layer(low, edits={4: edit}), high).items((0, 0, EXTENT, EXTENT), 1.0)
    rank = np.array([1, 0, 2])[items.kind]
    keys = list(zip(items.layer.tolist(), items.feature.tolist(), rank.tolist(), strict=True))
    assert keys == sorted(keys)
    assert len(set(items.layer.tolist())) == 2
    assert set(items.kind.tolist()) == {STROKE, FILL, POINT}
    assert area_of(items.taken(items.layer == 0), 4) == pytest.approx(6400.0)


def test_items_near_a_box_are_those_of_brute_force(tmp_path) -> None:
    shapes = random_shapes(3000)
    drapes = opened(layer(write(tmp_path / "map.gpkg", shapes), width=6.0))
    tree = shapely.STRtree(shapes)
    random = np.random.default_rng(1)
    for _ in range(50):
        low = random.uniform(-50.0, EXTENT, 2)
        box = (*low, *(low + random.uniform(1.0, 200.0, 2)))
        for texel in (0.5, 4.0):
            found = set(drapes.items(box, texel).feature.tolist())
            touching = set(tree.query(shapely.box(*box), predicate="intersects").tolist())
            grown = shapely.box(
                box[0] - 7 - texel, box[1] - 7 - texel, box[2] + 7 + texel, box[3] + 7 + texel
            )
            near = set(tree.query(grown).tolist())
            assert touching <= found <= near


def test_runs_of_a_line_join_and_know_their_ends() -> None:
    points = np.cumsum(np.random.default_rng(2).normal(size=(3 * RUN + 8, 2)), axis=0)
    items, vertices = parts_of(split_shapes(np.array([shapely.LineString(points)]), np.array([7])), 0.0)
    length = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
    assert items["ends"].tolist() == [STARTS | AFTER, BEFORE | AFTER, BEFORE | AFTER, BEFORE | ENDS]
    for at, item in enumerate(items):
        run = vertices[item["first"] : item["first"] + item["count"]]
        first = at * RUN
        last = min(first + RUN, len(points) - 1)
        assert np.array_equal(run, points[max(first - 1, 0) : last + 2])
        assert item["along"] == pytest.approx(length[first])
    ring = shapely.Polygon(points[:40]).exterior
    items, vertices = parts_of(split_shapes(np.array([shapely.LineString(ring)]), np.array([0])), 0.0)
    assert items["ends"].tolist() == [BEFORE | AFTER]  # a closed line has no ends
    assert np.array_equal(vertices[0], vertices[-3])
    assert np.array_equal(vertices[-1], vertices[2])


def test_areas_in_pieces_keep_their_area_and_outlines() -> None:
    angle = np.linspace(0.0, 2.0 * np.pi, 20_001)[:-1]
    radius = 400.0 + 60.0 * np.sin(40.0 * angle) + np.random.default_rng(3).normal(0.0, 0.05, 20_000)
    shell = 500.0 + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    coast = shapely.Polygon(shell, [500.0 + 0.2 * (shell[::-1] - 500.0)])
    for tolerance in (0.0, 1.0, 16.0):
        items, points = parts_of(split_shapes(np.array([coast]), np.array([0])), tolerance)
        fills = items[items["kind"] == FILL]
        assert fills["count"].max() <= PIECE + 1
        rings = [points[each["first"] : each["first"] + each["count"]] for each in fills]
        assert all(np.array_equal(ring[0], ring[-1]) for ring in rings)
        rounded = (
            coast
            if not tolerance
            else shapely.transform(coast, lambda at, by=tolerance: np.rint(at / by) * by)
        )
        assert sum(map(signed_area, rings)) == pytest.approx(rounded.area, rel=1e-9)
        assert (
            points[items["first"][items["kind"] == STROKE][0]].tolist()
            in shapely.get_coordinates(rounded).tolist()
        )


def test_pieces_of_any_ring_have_its_winding_everywhere() -> None:
    random = np.random.default_rng(4)
    ring = random.uniform(0.0, 100.0, (1200, 2))  # crosses itself everywhere
    ring = np.concatenate([ring, ring[:1]])
    pieces = subdivided(ring)
    assert max(map(len, pieces)) <= PIECE + 1
    for x, y in random.uniform(0.0, 100.0, (50, 2)):
        edges = [np.stack([piece[:-1], piece[1:]], axis=1) for piece in (ring, *pieces)]
        assert turns(np.concatenate(edges[1:]), x, y) == turns(edges[0], x, y)


def turns(edges, x, y):
    """Return the winding number of rings, given their edges (n, 2, 2), about a place."""
    (u, v), (p, q) = edges[:, 0].T, edges[:, 1].T
    side = (p - u) * (y - v) - (q - v) * (x - u)
    return int(((v <= y) & (q > y) & (side > 0)).sum()) - int(((v > y) & (q <= y) & (side < 0)).sum())


def test_shared_borders_stay_shared_at_all_levels(tmp_path) -> None:
    random = np.random.default_rng(5)
    side, cell = 8, EXTENT / 8
    corners = np.stack(np.meshgrid(np.arange(side + 1.0), np.arange(side + 1.0)), axis=-1) * cell
    corners[1:-1, 1:-1] += random.uniform(-0.3, 0.3, (side - 1, side - 1, 2)) * cell

    def edge(a, b):  # the same vertices in either direction
        if tuple(a) > tuple(b):
            return edge(b, a)[::-1]
        noise = np.random.default_rng(abs(hash((*a, *b))) % 2**32)
        share = np.linspace(0.0, 1.0, 200)[:, None]
        return a + share * (b - a) + noise.normal(0.0, 0.4, (200, 2)) * (share * (1.0 - share) > 0.0)

    cells = []
    for row in range(side):
        for column in range(side):
            loop = [(row, column), (row, column + 1), (row + 1, column + 1), (row + 1, column), (row, column)]
            edges = [edge(corners[a], corners[b])[:-1] for a, b in itertools.pairwise(loop)]
            cells.append(shapely.Polygon(np.concatenate(edges)))
    _, table = open_table(layer(write(tmp_path / "parcels.fgb", cells)), FRAME, EXTENT)
    assert len(table.levels) > 4
    for level in table.levels:
        fills = [level.points[i["first"] : i["first"] + i["count"]] for i in level.items if i["kind"] == FILL]
        edges = np.concatenate([np.stack([ring[:-1], ring[1:]], axis=1) for ring in fills])
        places = random.uniform(0.1 * EXTENT, 0.9 * EXTENT, (100, 2))
        assert {turns(edges, *place) for place in places} == {1}  # no slivers, no overlaps


def test_generalisation_is_within_a_quarter_of_a_texel_and_loses_no_line(tmp_path) -> None:
    random = np.random.default_rng(6)
    lines = [
        shapely.LineString(random.uniform(0, EXTENT, 2) + np.cumsum(random.normal(0, s, (300, 2)), 0))
        for s in (0.2, 1, 5)
    ]
    lines += [
        shapely.LineString(random.uniform(0, EXTENT, 2) + np.array([[0.0, 0.0], [d, d / 3]]))
        for d in (0.5, 2.0, 8.0)
    ]
    drapes = opened(write(tmp_path / "lines.fgb", lines))
    for texel in (0.5, 2.0, 8.0, 32.0):
        items = drapes.items(ALL, texel)
        for number, line in enumerate(lines):
            if line.length < texel / 20.0:
                continue
            runs = np.flatnonzero(items.feature == number)
            assert len(runs), (texel, number)
            drawn = shapely.union_all(
                [shapely.LineString(items.points[items.first[k] : items.first[k + 1]]) for k in runs]
            )
            assert shapely.hausdorff_distance(drawn, line) <= texel / 4.0
    assert len(drapes.items(ALL, 32.0).points) < 0.5 * len(drapes.items(ALL, 0.1).points)


def test_hostile_geometries_are_drawn_or_left_out(tmp_path) -> None:
    bow_tie = shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)])
    holed = shapely.Polygon(
        [(20, 0), (60, 0), (60, 40), (20, 40)], [[(30, 10), (50, 10), (50, 30), (30, 30)]]
    )
    shapes = [
        bow_tie,
        holed,
        None,
        shapely.Polygon(),
        shapely.GeometryCollection(
            [shapely.Point(70, 5), shapely.LineString([(70, 0), (80, 0)]), shapely.box(90, 0, 99, 9)]
        ),
        shapely.LineString([(100, 0, 5), (110, 0, 7), (110, 10, 9)]),
        shapely.MultiPoint([(120, 5), (125, 5), (130, 5)]),
        shapely.MultiPolygon([shapely.box(140, 0, 150, 10), shapely.box(160, 0, 170, 10)]),
        shapely.LineString([(180, 0), (180, 0)]),
        shapely.Point(1e9, 0),
    ]  # fmt: skip
    drapes = opened(write(tmp_path / "map.gpkg", shapes))
    items = drapes.items(ALL, 0.1)
    assert drapes.problems == ()
    assert drapes.notes[0] == "map: 1 of 10 features have no geometry, or are damaged"
    assert drapes.notes[1].startswith("map: 1 features left out")
    assert set(items.feature.tolist()) == {0, 1, 4, 5, 6, 7}
    assert area_of(items, 0) == pytest.approx(50.0)
    assert area_of(items, 1) == pytest.approx(holed.area)
    assert area_of(items, 7) == pytest.approx(200.0)
    signs = [
        signed_area(items.points[items.first[k] : items.first[k + 1]])
        for k in np.flatnonzero((items.feature == 1) & (items.kind == FILL))
    ]
    assert sorted(map(np.sign, signs)) == [-1.0, 1.0]
    assert sorted(items.kind[items.feature == 4].tolist()) == [STROKE, STROKE, FILL, POINT]
    assert strokes_of(items, 5) == pytest.approx(20.0)
    assert (items.feature == 6).sum() == 3
    empty = opened(write(tmp_path / "empty.fgb", []))
    assert empty.problems == ()
    assert not len(empty.items(ALL, 1.0).feature)
    assert empty.pick(1, 1, 1.0) is None


def test_degrees_are_longitude_first_and_cross_the_antimeridian(tmp_path) -> None:
    for suffix in (".gpkg", ".geojson", ".fgb"):
        path = write_as_is(tmp_path / f"point{suffix}", [shapely.Point(3.0, 42.4545)], crs="EPSG:4326")
        x, y = opened(path).table(0).feature(0).geometry.coords[0]
        assert x == pytest.approx(0.0, abs=1e-6)
        assert 0.0 < y < EXTENT
    lines = [
        shapely.LineString([(179.9, -17.0), (-179.9, -17.0)]),
        shapely.LineString([(179.9, -17.0), (180.1, -17.0)]),
    ]
    path = write_as_is(tmp_path / "fiji.gpkg", lines, crs="EPSG:4326")
    frame = {"crs": "EPSG:32760", "east": 800_000.0, "north": 8_110_000.0}
    first, second = (opened(path, frame=frame, extent=20_000.0).table(0).feature(k).geometry for k in (0, 1))
    assert first.length == pytest.approx(21_300, rel=0.01)
    assert shapely.equals_exact(first, second, 1e-3)
    # Vertices on the other side of the Earth have no place in UTM: areas around the sketch remain.
    world = shapely.Polygon([(-170, 89), (-170, -60), (3, -60), (170, -60), (170, 89), (3, 80)])
    drapes = opened(write_as_is(tmp_path / "world.gpkg", [world], crs="EPSG:4326"))
    assert drapes.problems == ()
    assert drapes.pick(500.0, 500.0, 1.0) == Pick(0, 0)


def test_coordinates_without_a_crs_are_those_of_the_frame_or_the_layers(tmp_path) -> None:
    path = write(tmp_path / "own.gpkg", [shapely.Point(10, 20)], crs=None)
    assert opened(path).table(0).feature(0).geometry.coords[0] == (10.0, 20.0)
    degrees = write_as_is(tmp_path / "degrees.gpkg", [shapely.Point(3.0, 42.4545)], crs=None)
    found = opened(layer(degrees, crs="EPSG:4326")).table(0).feature(0).geometry
    assert found.x == pytest.approx(0.0, abs=1e-6)
    local = {"crs": "", "east": 0.0, "north": 0.0}
    path = write(tmp_path / "metric.fgb", [shapely.Point(10, 20)])
    drapes = opened(path, frame=local)
    assert drapes.sources == (None,)
    assert len(drapes.problems) == 1
    assert "expected a sketch with a CRS" in drapes.problems[0]
    assert "\n" not in drapes.problems[0]


def test_files_that_cannot_be_read_are_one_line_each(tmp_path) -> None:
    good = write(tmp_path / "good.fgb", random_shapes(9))
    damaged = tmp_path / "damaged.gpkg"
    damaged.write_bytes(b"SQLite format 3\0" + bytes(500))
    notes = tmp_path / "notes.txt"
    notes.write_text("hello")
    table = layer(write(tmp_path / "map.gpkg", random_shapes(3), layer="roads"), table="rivers")
    cases = [layer(tmp_path / "missing.fgb"), layer(damaged), layer(notes), layer(tmp_path), table]
    drapes = opened(*cases, good)
    assert drapes.sources[:-1] == (None,) * 5
    assert drapes.sources[-1] is not None
    assert len(drapes.problems) == 5
    assert not any("\n" in each for each in drapes.problems)
    assert "rivers" in drapes.problems[4]
    assert "roads" in drapes.problems[4]
    assert len(drapes.items(ALL, 1.0).feature)


def test_other_tables_and_unknown_properties_are_noted(tmp_path) -> None:
    path = write(tmp_path / "map.gpkg", random_shapes(3), {"name": ["a", "b", "c"]}, layer="roads")
    write(path, random_shapes(3), layer="rivers", append=False)
    labelled = DrapeClass("a", {"label": "height"})
    notes = opened(layer(path, label="nane", by="kind", classes=(labelled,))).notes
    assert sorted(notes) == [
        "map: no property by = 'kind': expected name",
        "map: no property label = 'height': expected name",
        "map: no property label = 'nane': expected name; did you mean 'name'?",
        "map: of its tables 'roads' is shown; table= selects another: 'rivers'",
    ]
    assert opened(layer(path, table="roads", label="name", by="name")).notes == ()


def test_a_file_that_is_replaced_is_one_problem_and_stays_shown(tmp_path) -> None:
    path = write(tmp_path / "map.fgb", random_shapes(9))
    from sketchterrain.document.drapes import draped_layer

    for one in (layer(path), draped_layer(path, unit="m", fill="#00ff00")):
        drapes = opened(one)
        before = drapes.items(ALL, 1.0)
        content = path.read_bytes()
        write(path, random_shapes(4, seed=3))
        later = drapes.updated([one])
        assert len(later.problems) == 1
        assert "its content has changed since it was added" in later.problems[0]
        assert later.sources == drapes.sources
        for old, new in zip(before, later.items(ALL, 1.0), strict=True):
            assert np.array_equal(old, new)
        path.write_bytes(content)


def test_styles_follow_classes_and_visibility(tmp_path) -> None:
    path = write(
        tmp_path / "map.fgb",
        [shapely.LineString([(0, 10 * k), (100, 10 * k)]) for k in range(4)],
        {"kind": np.array(["path", "road", None, "road"], object), "rank": np.array([1.0, 2.5, 3.0, np.nan])},
    )
    classes = (DrapeClass("road", {"width": 8.0}), DrapeClass("path", {"colour": ""}))
    one = layer(path, by="kind", classes=classes, width=1.0)
    drapes = opened(one)
    items = drapes.items(ALL, 1.0)
    assert items.feature.tolist() == [1, 2, 3]  # paths have no colour
    widths = [drapes.styles[row].style["width"] for row in items.style]
    assert widths == [8.0, 1.0, 8.0]
    edit = draped_feature(shapely.LineString([(0, 10), (100, 10)]), {"kind": "other"}, 1)
    edited = drapes.updated([one.replace(edits={1: edit})])
    assert [edited.styles[row].style["width"] for row in edited.items(ALL, 1.0).style] == [1.0, 1.0, 8.0]
    ranks = opened(
        one.replace(by="rank", classes=(DrapeClass("3", {"width": 5.0}), DrapeClass("2.5", {"width": 6.0})))
    )
    assert [ranks.styles[row].style["width"] for row in ranks.items(ALL, 1.0).style] == [1.0, 6.0, 5.0, 1.0]
    assert not len(opened(one.replace(visible=0)).items(ALL, 1.0).feature)
    assert opened(one.replace(visible=0)).is_empty
    scaled = opened(one.replace(finest=2.0, coarsest=8.0))
    assert [len(scaled.items(ALL, texel).feature) > 0 for texel in (1.0, 2.0, 7.9, 8.0)] == [
        False,
        True,
        True,
        False,
    ]


def test_casings_lie_beneath_all_lines_of_a_layer(tmp_path) -> None:
    cross = [shapely.LineString(each) for each in ([(0, 500), (900, 500)], [(500, 0), (500, 900)])]
    path = write(tmp_path / "lines.fgb", cross, {"rank": np.array(["a", "b"], object)})
    classes = (DrapeClass("b", {"casing": ""}),)
    cased = layer(path, width=6.0, dash="9 9", casing="#102030", casing_width=2.0, by="rank", classes=classes)
    drapes = opened(cased)
    items = drapes.items(ALL, 0.5)
    styles = [drapes.styles[number] for number in items.style.tolist()]
    assert items.feature.tolist() == [0, 0, 1]
    assert [each.style["colour"] for each in styles] == ["#102030", "#e03131", "#e03131"]
    assert [each.width(1.0) for each in styles] == [10.0, 6.0, 6.0]
    assert [len(each.dashes) for each in styles] == [0, 2, 2]
    assert drapes.pick(200.0, 504.5, 0.01) == Pick(0, 0)  # a casing is a part of its line
    both = opened(cased.replace(classes=()))
    assert both.picks(504.5, 500.0, 0.01)[:2] == [Pick(0, 0), Pick(0, 1)]  # beneath the other line
    assert both.pick(500.0, 500.0, 0.01) == Pick(0, 1)
    assert len(opened(cased.replace(casing="")).items(ALL, 0.5).feature) == 2


def test_changed_boxes_are_those_of_what_changed(tmp_path) -> None:
    shapes = random_shapes(90)
    one, other = (
        layer(write(tmp_path / "a.fgb", shapes), width=2.0),
        layer(write(tmp_path / "b.fgb", shapes[:9])),
    )
    drapes = opened(one, other)
    same = drapes.updated([one.replace(title="x", label="name"), other])
    assert not len(same.changed_boxes(drapes))
    assert same.sources == drapes.sources
    moved = shapely.transform(shapes[1], lambda at: at + 100.0)
    edited = drapes.updated([one.replace(edits={1: draped_feature(moved, {}, 1)}), other])
    boxes = edited.changed_boxes(drapes)
    expected = np.array([moved.bounds, shapes[1].bounds]) + np.array([-2.0, -2.0, 2.0, 2.0])
    assert np.allclose(boxes, expected)
    assert np.allclose(drapes.changed_boxes(edited)[::-1], expected)
    assert np.allclose(drapes.without((0, 1)).changed_boxes(drapes), expected[1:])
    restyled = drapes.updated([one.replace(colour="#123456"), other]).changed_boxes(drapes)
    whole = shapely.total_bounds(np.array(shapes)) + np.array([-2.0, -2.0, 2.0, 2.0])
    assert len(restyled)
    assert np.allclose(restyled, whole)
    assert len(drapes.updated([other, one]).changed_boxes(drapes)) == 4
    assert len(drapes.updated([one]).changed_boxes(drapes)) == 1
    hidden = drapes.updated([one.replace(visible=0), other])
    assert len(hidden.changed_boxes(drapes)) == 1
    assert not len(hidden.updated([one.replace(visible=0, colour="#123456"), other]).changed_boxes(hidden))


def test_edits_share_the_store_and_undo_is_bit_equal(tmp_path) -> None:
    one = layer(write(tmp_path / "map.gpkg", random_shapes(300)))
    drapes = opened(one)
    before = drapes.items(ALL, 0.5)
    new = draped_feature(shapely.box(0, 0, 50, 50), {"number": 7}, 300)
    edits = {4: None, 300: new}
    edited = drapes.updated([one.replace(edits=edits)])
    found = edited.items(ALL, 0.5)
    assert 4 not in found.feature
    assert area_of(found, 300) == pytest.approx(2500.0)
    assert edited.sources[0].facts is drapes.sources[0].facts
    assert edited.table(0).feature(300).properties == {"number": 7}
    assert edited.table(0).next_id == 301
    assert edited.features(0, ALL).tolist() == [*range(4), *range(5, 301)]
    kept = dict(edited.sources[0]._parts)
    again = edited.updated([one.replace(edits={**edits, 5: None})])
    again.items(ALL, 0.5)
    found = again.sources[0]._parts
    assert all(found[key] is parts for key, parts in kept.items())  # only the touched feature is rebuilt
    assert {name for name, _ in found} == {4, 5, 300}
    undone = again.updated([one])
    for old, now in zip(before, undone.items(ALL, 0.5), strict=True):
        assert np.array_equal(old, now)
    only = edited.only((0, 300), 0.5)
    assert set(only.feature.tolist()) == {300}
    assert area_of(only) == pytest.approx(2500.0)
    assert not len(edited.only((0, 4), 0.5).feature)


def test_picks_the_topmost_feature(tmp_path) -> None:
    ground = [
        shapely.box(0, 0, 500, 500),
        shapely.Polygon(
            [(600, 0), (900, 0), (900, 300), (600, 300)], [[(650, 50), (850, 50), (850, 250), (650, 250)]]
        ),
    ]
    roads = [
        shapely.LineString([(0, 100), (1000, 100)]),
        shapely.LineString([(100, 0), (100, 1000)]),
        shapely.Point(300, 300),
    ]
    low, high = (
        layer(write(tmp_path / "low.fgb", ground)),
        layer(write(tmp_path / "high.fgb", roads), width=20.0),
    )
    drapes = opened(low, high)
    assert drapes.pick(50, 105, 0.1) == Pick(1, 0)
    assert drapes.pick(50, 111, 0.1) == Pick(0, 0)
    assert drapes.pick(100, 100, 0.1) == Pick(1, 1)  # the later one lies above
    assert drapes.picks(50, 112, 4.0) == [
        Pick(0, 0),
        Pick(1, 0, 2.0),
    ]  # drawn there, then near
    assert drapes.pick(550, 112, 4.0) == Pick(1, 0, 2.0)
    assert drapes.pick(550, 123, 4.0) is None
    assert drapes.pick(307, 306, 0.1) == Pick(1, 2)
    assert drapes.pick(750, 150, 0.1) is None
    assert drapes.pick(620, 200, 0.1) == Pick(0, 1)
    outline = opened(low.replace(fill=""))
    assert outline.pick(250, 250, 0.1) is None
    assert outline.pick(250, 499.5, 0.1) == Pick(0, 0)
    assert drapes.updated([low, high.replace(visible=0)]).pick(50, 105, 0.1) == Pick(0, 0)
    assert drapes.updated([low, high.replace(coarsest=0.05)]).pick(50, 105, 0.1) == Pick(0, 0)
    assert drapes.updated([high, low]).pick(50, 105, 0.1) == Pick(1, 0)
    coast = 300.0 + 200.0 * np.stack([np.cos(a := np.linspace(0, 2 * np.pi, 5000)[:-1]), np.sin(a)], -1)
    pieces = opened(layer(write(tmp_path / "coast.fgb", [shapely.Polygon(coast)])))
    random = np.random.default_rng(8)
    for x, y in random.uniform(0, 600, (200, 2)):
        distance = np.hypot(x - 300, y - 300)
        if abs(distance - 200) > 3:
            assert pieces.pick(x, y, 0.5) == (Pick(0, 0) if distance < 200 else None)


def test_the_line_under_the_cursor_goes_before_later_ones_beside_it(tmp_path) -> None:
    apart = 1.0 + np.array([1.0, 2.0, 3.0])  # px from one middle to the next: 1 px wide, 1 to 3 px apart
    for texel in (0.2, 3.0):
        y = 500.0 + texel * np.append(0.0, np.cumsum(apart))
        lines = [shapely.LineString([(0.0, each), (1000.0, each)]) for each in y.tolist()]
        drapes = opened(layer(write(tmp_path / f"{texel}.fgb", lines), width=1.0, unit="px"))
        for number, middle in enumerate(y.tolist()):
            for off in (-0.4, 0.0, 0.4):
                assert drapes.pick(400.0, middle + off * texel, texel)[:2] == (0, number)
        between = drapes.picks(400.0, float(y[2] + 1.2 * texel), texel)
        assert [each.feature for each in between] == [2, 3]
        assert between[0].distance == pytest.approx(0.7 * texel)


def test_occupied_boxes_are_those_with_features(tmp_path) -> None:
    shapes = random_shapes(300, extent=300.0)
    drapes = opened(layer(write(tmp_path / "map.fgb", shapes), width=1.0))
    corners = np.stack(np.meshgrid(np.arange(40.0), np.arange(40.0)), -1).reshape(-1, 2) * 25.0
    boxes = np.concatenate([corners, corners + 25.0], axis=1)
    tree = shapely.STRtree(shapes)
    touched = np.array([len(tree.query(shapely.box(*box), predicate="intersects")) > 0 for box in boxes])
    found = drapes.occupied(boxes)
    assert found[touched].all()
    assert found.mean() < 0.5
    edit = draped_feature(shapely.Point(910, 910), {}, 500)
    far = np.array([[900.0, 900.0, 925.0, 925.0]])
    layers = [drapes.layers[0].replace(edits={500: edit})]
    assert not drapes.occupied(far)[0]
    assert drapes.updated(layers).occupied(far)[0]


COAST = """
import sys, resource
from pathlib import Path
from tests.drape.test_vector_sources import opened
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
drapes = opened(Path(sys.argv[1]), extent=20_000.0)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) >> 10)
"""


@pytest.mark.parametrize(
    "count",
    [
        20_000,
        pytest.param(100_000, marks=pytest.mark.slow),
        pytest.param(1_000_000, marks=pytest.mark.soak),
    ],
)
def test_a_long_coastline_is_stored_in_bounded_pieces(tmp_path, count) -> None:
    extent = 20_000.0
    angle = np.linspace(0.0, 2.0 * np.pi, count + 1)[:-1]
    random = np.random.default_rng(9)
    radius = (
        8000.0
        + np.cumsum(random.normal(0.0, 1.0, count)) * np.sin(0.5 * angle) ** 2
        + random.normal(0.0, 0.02, count)
    )
    shell = 10_000.0 + radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    coast = shapely.Polygon(shell)
    path = write(tmp_path / "coast.fgb", [coast])
    if count == 1_000_000:
        run = subprocess.run(
            [sys.executable, "-c", COAST, str(path)], capture_output=True, text=True, check=True
        )
        assert float(run.stdout) < 1200.0  # MiB
    drapes = opened(path, extent=extent)
    items = drapes.items(ALL, 0.001)
    valid = shapely.make_valid(coast, method="structure").area
    assert np.diff(items.first).max() <= PIECE + 1
    assert area_of(items) == pytest.approx(valid, rel=1e-9)
    near = drapes.items((17_900.0, 9_900.0, 18_100.0, 10_100.0), 0.2)
    assert len(near.points) < 0.05 * count


@pytest.mark.slow
def test_the_budget_holds_over_many_windows(tmp_path) -> None:
    import rasterio

    path = tmp_path / "picture.tif"
    profile = {
        "driver": "GTiff",
        "width": 3000,
        "height": 3000,
        "count": 3,
        "dtype": "uint8",
        "crs": FRAME["crs"],
    }
    transform = rasterio.Affine(1 / 3, 0.0, FRAME["east"], 0.0, -1 / 3, FRAME["north"] + EXTENT)
    with rasterio.open(path, "w", transform=transform, **profile) as file:
        file.write(np.random.default_rng(0).integers(0, 255, (3, 3000, 3000), np.uint8))
    drapes = opened(
        path, layer(write(tmp_path / "map.fgb", random_shapes(3000)), by="number", classes=(DrapeClass("7"),))
    )
    random = np.random.default_rng(1)
    for _ in range(200):
        west, north = random.uniform(0.0, EXTENT, 2)
        texel = 2.0 ** random.uniform(-3.0, 3.0)
        drapes.rasters(texel)[0][1].pixels(west, north, texel, 192, 192)
        drapes.items((west, north - 192 * texel, west + 192 * texel, north), texel)
        assert drapes.nbytes <= BUDGET
    assert drapes.nbytes > BUDGET // 4
