"""Edits of draped features, and the files that they are saved in."""

import subprocess
import sys
from contextlib import suppress

import numpy as np
import pyogrio
import pytest
import shapely

from sketchterrain.document.drapes import draped_layer
from sketchterrain.drape.saving import save_layer
from sketchterrain.errors import InputError
from sketchterrain.features import edits
from sketchterrain.features.picking import nearest_place
from sketchterrain.features.table import AREA, Feature
from tests.drape.test_vector_sources import opened, random_shapes, write, write_as_is

HOLED = shapely.Polygon([(0, 0), (40, 0), (40, 40), (0, 40)], [[(10, 10), (20, 10), (20, 20), (10, 20)]])
SEVERAL = shapely.MultiPolygon([HOLED, shapely.box(60, 0, 90, 30)])


@pytest.fixture
def drapes(tmp_path):
    shapes = [
        shapely.LineString([(0, 0), (10, 0), (20, 10)]),
        HOLED,
        SEVERAL,
        shapely.MultiPoint([(1, 1), (5, 5)]),
        shapely.MultiLineString([[(0, 0), (9, 0)], [(0, 5), (9, 5), (9, 9)]]),
        shapely.Polygon([(0, 0), (10, 10), (10, 0), (0, 10)]),
    ]
    path = write(tmp_path / "map.gpkg", shapes, {"name": np.array(list("abcdef"), object)})
    return opened(draped_layer(path, unit="m", fill="#00ff00"))


@pytest.fixture
def table(drapes):
    return drapes.table(0)


def shape(table, number):
    return table.geometry(number)


def test_features_are_moved_rotated_and_scaled_with_their_parts_and_holes(table) -> None:
    for change in (
        lambda at: at @ np.array([[0.0, 1.0], [-1.0, 0.0]]) + 5.0,
        lambda at: at * (2.0, 0.5),
        lambda at: at - np.array([3.0, -4.0]),
    ):
        for number in range(6):
            before = shape(table, number)
            moved = edits.with_places(table, number, change(np.concatenate(table.feature(number).rings)))
            after = shape(moved, number)
            assert shapely.equals_exact(after, shapely.transform(before, change), 1e-9)
            assert shapely.get_num_geometries(after) == shapely.get_num_geometries(before)


def test_each_vertex_can_be_moved_inserted_and_deleted(table) -> None:
    for number in range(5):
        before = np.concatenate(table.feature(number).rings)
        for vertex in range(len(before)):
            places = before + (np.arange(len(before)) == vertex)[:, None] * (0.5, 0.25)
            moved = edits.with_places(table, number, places)
            assert np.array_equal(np.concatenate(moved.feature(number).rings), places)
            with suppress(InputError):  # a hole would lie outside
                fewer = edits.delete_vertex(table, number, vertex)
                assert len(np.concatenate(fewer.feature(number).rings)) < len(before)
    line = shape(edits.insert_vertices(table, 0, [0], [(5.0, 1.0)]), 0)
    assert list(line.coords)[:3] == [(0, 0), (5, 1), (10, 0)]
    for number, (x, y), more in ((1, (20.0, 15.0), 0.0), (2, (75.0, -5.0), 75.0)):
        feature = table.feature(number)
        _, after, _ = nearest_place(table, feature, x, y)
        longer = edits.insert_vertices(table, number, [after], [(x, y)])
        assert shape(longer, number).area == shape(table, number).area + more
        assert sum(map(len, longer.feature(number).rings)) == sum(map(len, feature.rings)) + 1
    assert shape(edits.delete_vertex(table, 3, 0), 3).equals(shapely.MultiPoint([(5, 5)]))
    fewer = edits.delete_vertex(edits.delete_vertex(table, 1, 4), 1, 4)
    assert len(fewer.feature(1).rings) == 1  # a hole of two corners is none


def test_edits_that_are_no_features_are_one_line_each(drapes, table) -> None:
    def moved(vertex, place):
        places = np.concatenate(table.feature(1).rings)
        places[vertex] = place
        return edits.with_places(table, 1, places)

    crossed = np.concatenate(table.feature(5).rings)
    for change in (
        lambda: moved(1, (-30.0, 20.0)),  # crosses itself
        lambda: moved(0, (np.nan, 0.0)),
        lambda: edits.delete_vertex(table, 1, 99),
        lambda: table.edited(add=[Feature(AREA, (crossed,))]),
        lambda: table.edited([1]).feature(1),
        lambda: drapes.table(0).feature(77),
        lambda: edits.insert_vertices(table, 3, [0], [(1.0, 1.0)]),
        lambda: edits.split_line(table, 4, 1),  # of two parts
    ):
        with pytest.raises(InputError) as error:
            change()
        assert "\n" not in str(error.value)


def changed(drapes):
    """Return the layer with an edit of each kind, and what its features are then."""
    table = drapes.table(0)
    number = table.next_id
    table = edits.with_places(table, 4, np.concatenate(table.feature(4).rings) + 5.0)
    for name, value in {"name": "renamed", "count": None, "note": 1.5}.items():
        table = edits.set_value(table, 7, name, value)
    new = Feature.from_geometry(shapely.box(1, 2, 3, 4), {"name": "new", "count": 99})
    table = table.edited([2]).edited(add=[new])
    assert number in table
    new = drapes.updated([drapes.layers[0].replace(edits=table.edits)])
    ids = [each for each in range(number + 1) if each != 2]
    return new, [new.table(0).feature(each) for each in ids]


def test_layers_are_saved_and_read_back_in_each_format(tmp_path) -> None:
    names = np.array(["a", None, *"cdefghijkl"], object)
    fields = {"name": names, "count": np.arange(12, dtype=np.int32), "share": np.linspace(0, 1, 12)}
    path = write(tmp_path / "map.fgb", random_shapes(12), fields)
    content = path.read_bytes()
    drapes, features = changed(opened(draped_layer(path, unit="m", colour="#010203")))
    for suffix in (".gpkg", ".fgb", ".geojson"):
        saved = save_layer(drapes, 0, tmp_path / f"saved{suffix}")
        assert not saved.edits
        assert saved.style == drapes.layers[0].style
        found = opened(saved)
        assert found.problems == ()
        assert found.table(0).next_id == len(features)
        for number, feature in enumerate(features):
            again = found.table(0).feature(number)
            assert shapely.hausdorff_distance(again.geometry, feature.geometry) < 1e-4, (suffix, number)
            assert again.properties == feature.properties, (suffix, number)
        info = pyogrio.read_info(saved.path)
        assert info["crs"] == ("EPSG:4326" if suffix == ".geojson" else "EPSG:32631")
    assert path.read_bytes() == content
    assert drapes.sources[0].problem(drapes.layers[0]) == ""
    over = save_layer(drapes, 0, path)  # the source itself
    assert opened(over).table(0).next_id == len(features)
    assert path.read_bytes() != content


def test_other_tables_of_a_geopackage_and_heights_are_kept(tmp_path) -> None:
    path = tmp_path / "map.gpkg"
    heights = [
        shapely.LineString([(500000, 4700000, 7), (500010, 4700000, 8)]),
        shapely.Point(500003, 4700003, 9),
    ]
    write_as_is(path, heights, layer="first")
    write(path, random_shapes(5), layer="second", append=True)
    write(path, random_shapes(7), layer="third", append=True)
    drapes = opened(draped_layer(path))
    table = edits.with_places(drapes.table(0), 0, np.array([(0.0, 0.0), (20.0, 0.0)]))
    saved = save_layer(drapes.updated([drapes.layers[0].replace(edits=table.edits)]), 0, path)
    tables = {
        str(name): pyogrio.read_info(path, layer=name)["features"] for name, _ in pyogrio.list_layers(path)
    }
    assert tables == {"first": 2, "second": 5, "third": 7}
    assert saved["table"] == "first"
    _, _, wkb, _ = pyogrio.raw.read(path, layer="first")
    line, point = shapely.from_wkb(wkb)
    assert [*line.coords] == [(500000, 4700000, 7), (500020, 4700000, 8)]
    assert point.z == 9.0
    assert opened(saved).table(0).feature(0).geometry.length == 20.0


def test_tables_of_features_of_several_parts_stay_such(tmp_path) -> None:
    several = [shapely.MultiPolygon([shapely.box(x, 4700000, x + 9, 4700009)]) for x in (500000, 500020)]
    path = tmp_path / "map.gpkg"
    options = {"driver": "GPKG", "geometry_type": "MultiPolygon", "crs": "EPSG:32631"}
    pyogrio.raw.write(path, shapely.to_wkb(several), [np.arange(2)], ["number"], **options)
    drapes = opened(draped_layer(path))
    table = edits.delete_vertex(drapes.table(0), 0, 1).edited(add=[Feature.from_geometry(HOLED, {})])
    saved = save_layer(drapes.updated([drapes.layers[0].replace(edits=table.edits)]), 0, path)
    assert pyogrio.read_info(path)["geometry_type"] == "MultiPolygon"
    _, _, wkb, _ = pyogrio.raw.read(path)
    assert [each.geom_type for each in shapely.from_wkb(wkb)] == ["MultiPolygon"] * 3
    assert [opened(saved).table(0).feature(number).kind for number in range(3)] == [AREA] * 3


def test_a_layer_that_cannot_be_saved_leaves_every_file_as_it_was(tmp_path) -> None:
    path = write(tmp_path / "map.gpkg", random_shapes(5))
    drapes = opened(draped_layer(path))
    content = path.read_bytes()
    bad = drapes.layers[0].replace(edits=edits.set_value(drapes.table(0), 1, "number", "many").edits)
    (tmp_path / "sketch").mkdir()
    (tmp_path / "sketch/sketch.toml").touch()
    local = opened(draped_layer(write(tmp_path / "own.fgb", random_shapes(2), crs=None)))
    for what, target, reason in (
        (drapes.updated([bad]), path, "number"),
        (drapes, tmp_path / "map.xyz", "expected a name with .gpkg"),
        (local, tmp_path / "map.geojson", "CRS"),
        (drapes, tmp_path / "missing" / "map.gpkg", "map.gpkg"),
        (drapes, tmp_path / "sketch" / "map.fgb", "holds a sketch.toml"),
    ):
        with pytest.raises(Exception, match=reason) as error:
            save_layer(what, 0, target)
        assert "\n" not in str(error.value)
    assert path.read_bytes() == content
    assert sorted(each.name for each in tmp_path.iterdir()) == ["map.gpkg", "own.fgb", "sketch"]
    write(path, random_shapes(3))
    with pytest.raises(InputError, match="has changed"):
        save_layer(drapes, 0, path)


SAVES = """
import itertools, os, signal, sys
from pathlib import Path
import numpy as np
from sketchterrain.document.drapes import draped_layer
from sketchterrain.drape import saving
from sketchterrain.features import edits
from tests.document.save_until_killed import count_calls
from tests.drape.test_vector_sources import ALL, opened
path, content = Path(sys.argv[1]), Path(sys.argv[1]).read_bytes()
saving._BATCH = 100

def save(moment):
    # Return the status of a save that is killed at a call, and the number of calls of one that is not.
    path.write_bytes(content)
    read, write = os.pipe()
    if child := os.fork():
        os.close(write)
        status = os.waitpid(child, 0)[1]
        with open(read) as stream:
            count = stream.read()
        return status, count
    drapes, calls = opened(draped_layer(path)), itertools.count()
    table = drapes.table(0)
    moved = np.concatenate(table.feature(0).rings) + 1.0
    layer = drapes.layers[0].replace(edits=edits.with_places(table, 0, moved).edits)
    drapes = drapes.updated([layer])
    count_calls(lambda: next(calls) == moment and os.kill(os.getpid(), signal.SIGKILL))
    saving.save_layer(drapes, 0, path)
    sys.setprofile(None)
    os.write(write, str(next(calls)).encode())
    os._exit(0)

save(-1)
assert len(opened(draped_layer(path)).features(0, ALL)) == 300  # what is kept of it is, from then on
for moment in np.linspace(0, int(save(-1)[1]) - 1, 25).astype(int).tolist():
    status, _ = save(moment)
    whole = len(opened(draped_layer(path)).features(0, ALL)) == 300
    print(status == signal.SIGKILL, whole, path.read_bytes() == content)
"""


@pytest.mark.slow
def test_a_save_that_is_killed_leaves_the_old_or_the_new_file(tmp_path) -> None:
    path = write(tmp_path / "map.gpkg", random_shapes(300))
    run = subprocess.run([sys.executable, "-c", SAVES, str(path)], capture_output=True, text=True, check=True)
    killed, whole, old = zip(*(line.split() for line in run.stdout.splitlines()), strict=True)
    assert len(killed) == 25
    assert {*killed, *whole} == {"True"}
    assert list(old) == sorted(old, reverse=True)
    assert set(old) == {"True", "False"}
