"""Draped layers: keys, classes, edits of features, paths, undo; they are no part of the terrain."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from sketchterrain.document import drapes
from sketchterrain.document.drapes import (
    DRAPE,
    STYLE,
    DrapeClass,
    DrapedLayer,
    drape_problem,
    draped_feature,
    draped_layer,
    encode_edits,
    with_edits,
)
from sketchterrain.document.history import History
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import (
    MAX_FILE_BYTES,
    SETTINGS,
    load_sketch,
    pack_zip,
    read_zip,
    save_sketch,
)
from sketchterrain.document.toml_format import _toml_value, parse_settings, settings_text
from sketchterrain.errors import InputError
from sketchterrain.features.files import encode_table
from sketchterrain.generation.building import make_recipe
from sketchterrain.io.resources import preset_names
from sketchterrain.schema.parameters import defaults
from sketchterrain.ui.engine import channel

from .conftest import refusal, same
from .random_documents import random_document

LINE = shapely.LineString([(0.1, 1 / 3), (1e-9, -2.5e6), (4, 5), (6, 7)])
EDITS = {
    7: draped_feature(
        LINE, {"name": 'dotted "ways"' + "." * 400 + "\n", "a.b": 3, "length": 0.1, "x": None}, 7
    ),
    2: None,
    1 << 40: draped_feature(shapely.box(0, 0, 9, 9), {}, 1 << 40),
}


def layer(path: str = "/maps/trails.gpkg", **changes) -> DrapedLayer:
    classes = (DrapeClass("black", {"width": 4.0, "colour": "#000000"}), DrapeClass("", {"dash": "6 3"}))
    return DrapedLayer(path, {"by": "kind"}, {"width": 3}, classes, EDITS).replace(**changes)


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ('colour = "#000000"', "[[drape]] number 1: no path: expected path, sha256, table"),
        ('path = "a"\ncolr = "#000000"', "unknown key 'colr' = '#000000': expected path"),
        ('path = "a"\ncolr = "#000000"', "did you mean 'colour'?"),
        ('path = "a"\nwidth = -1', "drape.width = -1: expected a number from 0 to 10000"),
        ('path = "a"\nblend = "over"', "drape.blend = 'over': expected 'normal' or 'multiply'"),
        ('path = "a"\ndash = "6,3"', "drape.dash = '6,3': expected lengths as \"6 3\""),
        ('path = "a"\ncrs = "WGS"', "'WGS' is not a coordinate reference system"),
        ('path = "a"\nclass = 3', "class = 3: expected tables, each with [[drape.class]] above it"),
        ('path = "a"\n[[drape.class]]\nvalue = 3', "drape.class.value = 3: expected a text"),
        ('path = "a"\n[[drape.class]]\nwdth = 3', "unknown key 'wdth' = 3 in [[drape.class]]"),
        ('path = "a"\n[[drape.edit]]\nid = 3', "expected either a geometry or deleted = true"),
        ('path = "a"\n[[drape.edit]]\nid = -1\ndeleted = true', "drape.edit.id = -1: expected a whole"),
        ('path = "a"\n[[drape.edit]]\ndeleted = true', "drape.edit.id = None: expected a whole"),
        ('path = "a"\n[[drape.edit]]\nid = 1\ngeometry = "LINE (0 0)"', "drape.edit.geometry: expected WKT"),
        ('path = "a"\n[[drape.edit]]\nid = 1\ngeometry = 3', "drape.edit.geometry: expected WKT"),
        ('path = "a"\n[[drape.edit]]\nid = 1\ngeometry = "POINT EMPTY"', "expected points, lines or areas"),
        ('path = "a"\n[[drape.edit]]\nid = 1\ngeometry = "POINT (inf 0)"', "expected points, lines or areas"),
        ('path = "a"\n[[drape.edit]]\nid = 1\nwkt = "POINT (0 0)"', "unknown key 'wkt'"),
        ('path = "a"\n[[drape.edit]]\nid = 1\ndeleted = true\nproperties = 3', "expected a table"),
        (
            'path = "a"\n[[drape.edit]]\nid = 1\ngeometry = "POINT (0 0)"\nproperties.x = [1]',
            "expected a number or text",
        ),
        (
            'path = "a"\n' + 2 * "[[drape.edit]]\nid = 1\ndeleted = true\n",
            "two edits of feature 1: expected one",
        ),
        (64 * 'path = "a"\n[[drape]]\n' + 'path = "a"', "65 draped layers: expected at most 64"),
    ],
)
def test_invalid_layers_are_refused_in_one_line(folder, keys, problem):
    assert problem in refusal(folder(f"[[drape]]\n{keys}\n"))


def test_layers_are_written_and_read_without_a_difference():
    styled = dict.fromkeys(("colour", "fill", "label_colour"), "#12ab3f")
    for each in (layer(), DrapedLayer("b.tif"), layer(**styled, visible=0, opacity=0.25, crs="EPSG:4326")):
        text = settings_text(Sketch(drapes=(each,)))
        read = parse_settings(text.encode()).drapes
        assert with_edits(read, encode_edits([each])) == (each,)
        assert hash(each) == hash(read[0])
        assert pickle.loads(pickle.dumps(Sketch(drapes=(each,)))).drapes == (each,)  # noqa: S301
    assert dict(DrapedLayer("b.tif").style) == defaults(STYLE)
    assert {"path", *DrapedLayer("b.tif").values} == set(DRAPE)
    # Written by hand.
    inline = 'format = 2\n[[drape]]\npath = "a"\n[[drape.edit]]\nid = 1\ngeometry = "POINT (1 2)"\n'
    (read,) = parse_settings(f'{inline}properties = {{name = "x", n = 2}}'.encode()).drapes
    assert read.edits[1].properties == {"name": "x", "n": 2}
    assert read.edits[1].geometry == shapely.Point(1, 2)


def former_settings(sketch: Sketch, version: int) -> bytes:
    """Return the settings of a sketch as formats 1 and 2 had them, with edits of features as WKT."""
    lines = [settings_text(sketch.replace(drapes=())).replace("format = 2", f"format = {version}", 1)]
    for each in sketch.drapes:
        text = settings_text(Sketch(drapes=(each,)))
        lines.append(text[text.index("[[drape]]") :])
        for number, edit in each.edits.items():
            wkt = "" if edit is None else shapely.to_wkt(edit.geometry, rounding_precision=-1)
            lines += ["[[drape.edit]]", f"id = {number}"]
            lines.append("deleted = true" if edit is None else f"geometry = '{wkt}'")
            for name, value in () if edit is None else edit.properties.items():
                lines.append(f"properties.{_toml_value(name)} = {_toml_value(value)}")
    return "\n".join(lines).encode()


@pytest.mark.parametrize("version", [1, 2])
def test_edits_of_former_formats_are_converted_without_loss(tmp_path, version):
    rng = np.random.default_rng(version)
    for number, name in enumerate([*preset_names(), *[""] * 50]):
        document = random_document(rng, own_folder=tmp_path)
        drapes = (*document.drapes, layer())
        sketch = load_sketch(name).replace(drapes=drapes) if name else Sketch(drapes=drapes)
        place = tmp_path / f"{number}.sketch"
        save_sketch(sketch, place)
        files = read_zip(place, "")
        former = {**files, SETTINGS: former_settings(sketch, version)}
        del former["drapes.fgb"]
        (tmp_path / "former.sketch").write_bytes(pack_zip(former))
        converted = load_sketch(tmp_path / "former.sketch")
        assert converted.drapes == sketch.drapes
        if version == 2:
            same(converted, sketch)
        save_sketch(converted, tmp_path / "former.sketch")
        assert read_zip(tmp_path / "former.sketch", "")["drapes.fgb"] == files["drapes.fgb"]


def test_files_of_edits_that_do_not_fit_are_refused_in_one_line(tmp_path):
    folder = tmp_path / "valley"
    for layers, data, problem in (
        ((), encode_edits([layer()]), "drapes.fgb: expected edits of 0 draped layers"),
        ((layer(),), b"fgb", "drapes.fgb: not a whole FlatGeobuf file"),
        ((layer(),), encode_table("a", np.array([None]), {"id": np.array([1])}), "1 draped layers ('drape')"),
        ((layer(),), _edits([1, 1], ["{}", "{}"]), "two edits of feature 1"),
        ((layer(),), _edits([1], ["[]"]), "expected edits of 1 draped layers"),
        ((layer(),), _edits([-1], ["{}"]), "drape.edit.id = -1: expected a whole number"),
        ((layer(),), _edits([1], ['{"x": [1]}']), "expected a number or text"),
    ):
        save_sketch(Sketch(drapes=layers), folder)
        (folder / "drapes.fgb").write_bytes(data)
        assert problem in refusal(folder)


def _edits(ids, properties):
    columns = {"drape": np.ones(len(ids), int), "id": np.array(ids), "properties": tuple(properties)}
    return encode_table("drapes", np.full(len(ids), shapely.Point(1, 2)), columns)


def test_edits_have_plain_geometries_and_scale_with_the_sketch():
    assert draped_feature(shapely.Point(1, 2, 3), {}, 1).geometry == shapely.Point(1, 2)
    for bad in (shapely.GeometryCollection(), shapely.Point(0, np.nan)):
        with pytest.raises(InputError, match=r"drape\.edit\.geometry"):
            draped_feature(bad, {}, 1)
    twice = Sketch(drapes=(layer(),), extent=100.0).replace(extent=200.0).drapes[0]
    assert twice.edits[7].rings[0][3].tolist() == [12.0, 14.0]
    assert twice.edits[2] is None


def test_edits_are_limited_so_that_the_sketch_can_be_loaded(tmp_path, monkeypatch):
    share = 40
    monkeypatch.setattr(drapes, "MAX_EDIT_BYTES", drapes.MAX_EDIT_BYTES // share)
    vertices = np.random.default_rng(1).uniform(-1e6, 1e6, (drapes.MAX_EDIT_BYTES // 16 - 99, 2))
    longest = draped_feature(shapely.LineString(vertices), {}, 1)
    sketch = Sketch(drapes=(DrapedLayer("/a", edits={1: longest}),))
    save_sketch(sketch, tmp_path / "valley")
    assert share * (tmp_path / "valley/drapes.fgb").stat().st_size < MAX_FILE_BYTES
    same(load_sketch(tmp_path / "valley"), sketch)
    with pytest.raises(InputError, match="edits of draped layers that are not yet saved"):
        Sketch(drapes=(DrapedLayer("/a", edits={1: longest}),) * 2)


def test_a_missing_or_changed_file_is_named_and_its_path_is_relative_in_the_sketch(tmp_path):
    home = tmp_path / "valley"
    inside, outside = home / "trails.gpkg", tmp_path / "map.tif"
    home.mkdir()
    for path in (inside, outside):
        path.write_bytes(b"content of this test")
    sketch = Sketch(drapes=(draped_layer(inside, width=5.0, unit="m"), draped_layer(outside)))
    save_sketch(sketch, home)
    text = (home / "sketch.toml").read_text()
    assert 'path = "trails.gpkg"' in text
    assert f'path = "{outside}"' in text
    loaded = load_sketch(home)
    same(loaded, sketch)
    assert [drape_problem(each) for each in loaded.drapes] == ["", ""]
    assert all(each["sha256"] for each in loaded.drapes)
    inside.write_bytes(b"other content of it")
    outside.unlink()
    assert [drape_problem(each) for each in loaded.drapes] == [
        f"draped layer {inside}: its content has changed since it was added",
        f"draped layer {outside}: the file is missing",
    ]
    world = draped_layer(home)
    assert (world["sha256"], drape_problem(world)) == ("", "")
    with pytest.raises(InputError, match="the file is missing"):
        draped_layer(outside)
    with pytest.raises(InputError, match="did you mean 'colour'"):
        draped_layer(inside, colr="#000000")


def test_a_step_of_the_history_holds_only_the_edited_feature():
    many = {number: replace(EDITS[7], id=number) for number in range(500)}
    history = History(Sketch(drapes=(layer(), DrapedLayer("/b", edits=many))))
    before = history.bytes
    moved = draped_feature(LINE, {"name": "moved"}, 3)
    (first, second) = history.sketch.drapes
    sketch = history.sketch.replace(drapes=(first, second.replace(edits={**second.edits, 3: moved})))
    history.record("Move", sketch)
    assert history.bytes - before < 2048 + 73 * len(many) + 1000
    assert history.sketch.drapes[1].edits[4] is many[4]
    assert history.sketch.drapes[0] is first
    history.go_to(0)
    assert history.sketch.drapes[1].edits[3] == many[3]
    history.go_to(1)
    assert history.sketch.drapes == sketch.drapes


def test_the_terrain_is_the_same_with_layers():
    image = np.zeros((32, 32), np.uint8)
    image[8:20, 10:25] = 1
    sketch = Sketch(extent=512.0, layers={"mountain": image})
    draped = sketch.replace(drapes=(layer(),))
    assert pickle.dumps(make_recipe(draped)) == pickle.dumps(make_recipe(sketch))
    assert settings_text(sketch) in settings_text(draped)


def test_layers_go_through_a_channel_by_content():
    message = channel.ContentPickler(channel._Message({}))
    before = (layer(), layer("/b", opacity=0.5))
    message.dumps({"drapes": before})
    assert len(message.parts) == 2


def test_paths_of_a_zip_are_relative_to_its_folder(tmp_path):
    (tmp_path / "a.gpkg").write_bytes(b"x")
    save_sketch(Sketch(drapes=(draped_layer(tmp_path / "a.gpkg"),)), tmp_path / "valley.sketch")
    (tmp_path / "b").mkdir()
    for name in ("a.gpkg", "valley.sketch"):
        (tmp_path / name).rename(tmp_path / "b" / name)
    (found,) = load_sketch(tmp_path / "b" / "valley.sketch").drapes
    assert Path(found.path) == tmp_path / "b" / "a.gpkg"
