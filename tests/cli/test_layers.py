"""``--layer`` and ``--drape-method``: draped layers of pictures, terrains and worlds."""

import json
from typing import Any

import numpy as np
import pyogrio
import pytest

import sketchterrain.jobs.pictures
from sketchterrain.app.arguments import DRAPE_METHODS, read_layers
from sketchterrain.document.store import load_sketch
from sketchterrain.errors import InputError
from sketchterrain.export.map.relief import fit_frame
from sketchterrain.export.map.sheet import _grid
from sketchterrain.render.draped import SCREEN_METHODS
from sketchterrain.world.stored_world import at_corner, draped_sketch, open_world


@pytest.fixture
def trail(tmp_path):
    line = {"type": "LineString", "coordinates": [[20.0, 20.0], [300.0, 250.0]]}
    crs = {"type": "name", "properties": {"name": "urn:ogc:def:crs:EPSG::25832"}}
    feature = {"type": "Feature", "properties": {"name": "Upper"}, "geometry": line}
    path = tmp_path / "trail, old.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "crs": crs, "features": [feature]}))
    return path


@pytest.fixture
def place(sketch, tmp_path):
    from sketchterrain.document.store import save_sketch

    save_sketch(load_sketch(sketch).replace(frame={"crs": "EPSG:25832"}), tmp_path / "place")
    return tmp_path / "place"


def test_options_follow_the_name_of_a_file_that_may_have_commas(tmp_path):
    for name in ("a.gpkg", "b, c.tif", "d,width=3.gpkg"):
        (tmp_path / name).write_bytes(name.encode())
        for text, values in (
            ("", {}),
            (",width=5", {"width": 5.0}),
            (",colour=#d03030,width=2,unit=m,visible=0", {"colour": "#d03030", "unit": "m", "visible": 0}),
            (",colour=,dash=6 3,width=1,width=4", {"colour": "", "dash": "6 3", "width": 4.0}),
        ):
            (layer,) = read_layers([f"{tmp_path / name}{text}"])
            assert layer.path == str(tmp_path / name)
            assert values.items() <= {**layer.values, **layer.style}.items()
    assert read_layers([]) == ()
    assert list(DRAPE_METHODS) == ["auto", "tiles", *SCREEN_METHODS]


def test_classes_follow_their_value(tmp_path):
    path = tmp_path / "a.gpkg"
    path.write_bytes(b"a")
    styles = "class=hard:colour=#000000;dash=6 3", "class=a b:width=5;unit=m", "class=c"
    (layer,) = read_layers([f"{path},by=difficulty,{','.join(styles)},width=4"])
    assert layer["by"] == "difficulty"
    assert layer.style["width"] == 4.0
    assert [(each.value, dict(each.style)) for each in layer.classes] == [
        ("hard", {"colour": "#000000", "dash": "6 3"}),
        ("a b", {"width": 5.0, "unit": "m"}),
        ("c", {}),
    ]
    for text, message in (
        ("class=hard:colour=#000000", "class= needs by="),
        ("by=a,class=hard:colour=red", "--layer .*colour"),
        ("by=a,class=hard:colr=#000000", "--layer .*colr"),
    ):
        with pytest.raises(InputError, match=message):
            read_layers([f"{path},{text}"])


@pytest.mark.slow
def test_maps_show_layers_in_the_grid_of_the_crs(call, place, trail, tmp_path):
    layer = f"{trail},colour=#ff00ff,width=8,by=name,class=Upper:dash=6 3"
    done = call("render", place, "--map", "-o", tmp_path / "a.svg", "--layer", layer)
    assert done.code == 0, done.err
    text = (tmp_path / "a.svg").read_text()
    assert "#ff00ff" in text
    assert "trail, old Upper" in text
    assert "of EPSG:25832" in text
    frame = {"crs": "EPSG:25832", "east": 600_030.0, "north": 5_200_070.0}
    east, north, step = _grid(fit_frame((400.0, 300.0), frame))
    assert step == 50.0
    assert np.array_equal((east + 600_030.0) % step, np.zeros(8))
    assert (east[0], north[0]) == (20.0, 30.0)


def test_pictures_show_the_sketchs_layers_and_those_of_the_command(call, place, trail, tmp_path, monkeypatch):
    asked: list[dict[str, Any]] = []

    def picture(terrain, **options):
        asked.append(options)
        return np.zeros((48, 64, 3), np.uint8)

    monkeypatch.setattr(sketchterrain.jobs.pictures, "render_picture", picture)
    plain = tmp_path / "notes.txt"
    plain.write_text("no layer")
    options = ("--layer", f"{trail},width=4", "--layer", plain, "--drape-method", "geometry")
    done = call("render", place, "-o", tmp_path / "a.png", "--size", "64x48", *options)
    assert done.code == 0, done.err
    assert [each.title for each in asked[0]["drapes"].layers] == ["trail, old", "notes"]
    assert asked[0]["drapes"].layers[0].style["width"] == 4.0
    assert asked[0]["drape_method"] == "geometry"
    (note,) = [line for line in done.err.splitlines() if line.startswith("sketchterrain: note: ")]
    assert "notes.txt" in note


def test_generate_writes_layers_with_heights(call, place, trail, tmp_path):
    done = call("generate", place, "-o", tmp_path / "out", "--size", 17, "--no-preview", "--layer", trail)
    assert done.code == 0, done.err
    meta, _, wkb, _ = pyogrio.raw.read(tmp_path / "out" / "drapes.gpkg")
    assert (meta["crs"], len(wkb)) == ("EPSG:25832", 1)
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert "drapes.gpkg" in report["files"]
    assert not [line for line in report["notes"] if "trail" in line]


def test_worlds_keep_layers_which_are_moved_to_their_corner(call, place, trail, tmp_path):
    store = tmp_path / "world.zarr"
    options = ("--cell", 8, "--bounds", "64,0,256,128", "--layer", trail)
    assert call("world", place, "-o", store, *options).code == 0
    world = open_world(store)
    more = draped_sketch(world, read_layers([str(trail)]))
    assert [each.title for each in more.drapes] == ["trail, old", "trail, old"]
    moved = at_corner(more, (world.west, world.north))
    assert (moved.frame["east"], moved.frame["north"]) == (world.west, world.north)
