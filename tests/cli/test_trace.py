"""`trace`: outputs and refusals."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from sketchterrain.document.store import load_sketch
from sketchterrain.schema.layers import LAYERS
from tests.geo_files import write_vectors

RIVERS = Path(__file__).parent.parent / "data" / "openstreetmap" / "valira_d_orient.osm"


@pytest.fixture
def island(tmp_path):
    """A map of 90×60 px: mountains north-west, a river along the south, paper."""
    pixels = np.full((60, 90, 3), 255, np.uint8)
    pixels[5:30, 5:40] = (139, 90, 43)
    pixels[50:53] = (56, 116, 196)
    Image.fromarray(pixels).save(tmp_path / "island.png")
    return tmp_path / "island.png"


def test_coloured_map_becomes_a_sketch(call, island, tmp_path):
    done = call(
        *("trace", island, "-o", tmp_path / "a", "--extent", 9000, "--seed", 7, "--name", "Isle"),
        *("--preview", tmp_path / "p.png"),
    )
    assert done.code == 0, done.err
    sketch = load_sketch(tmp_path / "a")
    assert (sketch.name, sketch.extent, sketch.seed) == ("Isle", 9000.0, 7)
    assert np.array_equal(np.argwhere(sketch.layers["mountain"])[[0, -1]], [[5, 5], [29, 39]])
    assert sketch.layers["river"][50:53].all()
    assert "#8b5a2b is mountain 1 (16.2%)" in done.out
    assert f"sketch: {tmp_path / 'a'}" in done.out
    with Image.open(tmp_path / "p.png") as picture:
        assert picture.size == (2 * 90 + 8, 60)
        assert picture.convert("RGB").getpixel((98 + 10, 10)) == (140, 92, 70)


def test_zip_output_and_json(call, island, tmp_path):
    done = call("trace", island, "-o", tmp_path / "a.sketch", "--size", 45, "--json")
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert data["size"] == {"width": 45, "height": 30}
    assert data["layers"] == {"mountain": [1], "river": [1]}
    assert data["colours"][1] == {
        "rgb": "#8b5a2b",
        "share": pytest.approx(0.162, abs=1e-3),
        "layer": "mountain",
        "label": 1,
    }
    assert data["shares"] == {"sure": 1.0, "taken": 0.0, "unknown": 0.0}
    assert load_sketch(tmp_path / "a.sketch").width_px == 45


def test_legend_options_and_river_width(call, island, tmp_path):
    (tmp_path / "legend.toml").write_text('[[colour]]\nrgb = "#8b5a2b"\nlayer = "dune"\nlabel = 3\n')
    for number, (legend, layer, labels) in enumerate(
        (
            (("--colour", "dune.3=#8b5a2b"), "dune", {0, 3}),
            (("--colours", tmp_path / "legend.toml"), "dune", {0, 3}),
            (("--colour", "lake=#3874c4", "--rivers-up-to", 6), "river", {0, 1}),
        )
    ):
        done = call("trace", island, "-o", tmp_path / str(number), *legend)
        assert done.code == 0, done.err
        layers = load_sketch(tmp_path / str(number)).layers
        assert [name for name, image in layers.items() if image.any()] == [layer]
        assert set(np.unique(layers[layer])) == labels


def test_preview_never_overwrites_source_or_sketch(call, island, tmp_path):
    picture, folder, new = island.read_bytes(), tmp_path / "layers", tmp_path / "new"
    folder.mkdir()
    new.mkdir()
    (folder / "lake.png").write_bytes(picture)
    for source, preview in ((island, island), (folder, folder / "lake.png"), (island, new / "mountain.png")):
        done = call("trace", source, "-o", new, "--preview", preview)
        assert done.code == 3
        assert "expected another place than" in done.error
    assert island.read_bytes() == (folder / "lake.png").read_bytes() == picture
    assert not any(new.iterdir())


def test_existing_outputs_and_unknown_formats_are_refused(call, island, tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "mine.txt").write_text("mine")
    (tmp_path / "a.sketch").write_text("mine")
    (tmp_path / "map.tif").write_bytes(b"<VRTDataset></VRTDataset>")
    for source, name, code, part in (
        (island, "full", 3, "expected a new"),
        (island, "a.sketch", 3, "expected a new"),
        (island, "island.png/a", 1, "cannot be written"),
        (tmp_path / "map.tif", "b", 3, "expected a PNG, JPEG, TIFF or WebP picture, an OpenRaster file"),
    ):
        done = call("trace", source, "-o", tmp_path / name)
        assert (done.code, part in done.error) == (code, True), done.error
    assert (tmp_path / "a.sketch").read_text() == "mine"
    assert [path.name for path in (tmp_path / "full").iterdir()] == ["mine.txt"]
    assert not (tmp_path / "b").exists()


def geojson(geometry, crs="EPSG:25832", **properties):
    """Return the text of a file with one feature."""
    feature = {"type": "Feature", "properties": properties, "geometry": geometry}
    system = {"type": "name", "properties": {"name": crs}}
    return json.dumps({"type": "FeatureCollection", "crs": system, "features": [feature]})


def test_unusable_vectors_are_refused_in_one_line(call, tmp_path):
    zigzag = np.stack([np.arange(100_001), np.arange(100_001) % 2], axis=-1)
    texts = {"waterway": ["river"], "name": ["Inn"]}
    write_vectors(tmp_path / "long.fgb", [shapely.LineString(zigzag)], texts, crs="EPSG:25832")
    line = {"type": "LineString", "coordinates": [[0, 0], [9, 9]]}
    for text, part in (
        ("", "river 'Inn': 100001 vertices: expected at most 100000"),
        (geojson({"type": "Point", "coordinates": [5, 5]}, waterway="river"), "(1 that are points of areas)"),
        (geojson(line, waterway="river").replace("9, 9", "NaN, 9"), "no usable feature (1 with"),
        (geojson(line, "EPSG:77777", waterway="river"), "'EPSG:77777' is not a coordinate reference system"),
    ):
        path = tmp_path / ("a.json" if text else "long.fgb")
        (tmp_path / "a.json").write_text(text)
        done = call("trace", path, "-o", tmp_path / "new", "--layer", "river")
        assert done.code == 3, part
        assert part in done.error, done.error
        assert not (tmp_path / "new").exists(), part


def test_crossing_areas_are_repaired_and_mentioned(call, tmp_path):
    bow = {"type": "Polygon", "coordinates": [[[0, 0], [900, 900], [900, 0], [0, 900], [0, 0]]]}
    (tmp_path / "a.json").write_text(geojson(bow, natural="water"))
    done = call("trace", tmp_path / "a.json", "-o", tmp_path / "new", "--json")
    assert done.code == 0, done.err
    data = json.loads(done.out)
    assert data["vectors"] == {"lake": 2}
    assert "areas that cross themselves (1): repaired" in data["notes"]


def test_openstreetmap_becomes_vectors_with_a_preview(call, tmp_path):
    done = call("trace", RIVERS, "-o", tmp_path / "a", "--preview", tmp_path / "p.png", "--size", 128)
    assert done.code == 0, done.err
    assert "used: 18 lines as river, 1 area as river, 7 areas as lake" in done.out
    assert sorted(each.name for each in (tmp_path / "a").glob("*.fgb")) == ["lake.fgb", "river.fgb"]
    with Image.open(tmp_path / "p.png") as picture:
        colours = {colour for _, colour in picture.getcolors()}
    assert {LAYERS["river"].colour, LAYERS["lake"].colour} < colours
