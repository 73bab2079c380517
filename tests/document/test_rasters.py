"""Raster sources: keys, files that are missing or have changed, files stored in the sketch."""

import os
from dataclasses import replace
from pathlib import Path

import pytest

from sketchterrain.document import rasters
from sketchterrain.document.history import History
from sketchterrain.document.rasters import RasterSource, embedded, raster_problem, raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch, pack_sketch, save_sketch
from sketchterrain.document.toml_format import parse_settings, settings_text
from sketchterrain.errors import InputError
from tests.refusals import refused

from .conftest import refusal, same


@pytest.fixture
def dem(tmp_path) -> Path:
    path = tmp_path / "data" / "dem (ü).tif"
    path.parent.mkdir()
    path.write_bytes(b"heights")
    return path


@pytest.mark.parametrize(
    ("keys", "problem"),
    [
        ('role = "picture"', "number 1: no path: expected path, role, band, sha256"),
        ('path = ""', "raster.path = '': expected a path of 1 to 4096 characters"),
        (r'path = "a\u0000b"', r"raster.path = 'a\x00b': expected a path"),
        (f'path = "{"x" * 5000}"', "expected a path of 1 to 4096"),
        (f'path = "{"../" * 101}x"', "expected a path of 1 to 4096"),
        ("path = 3", "raster.path = 3: expected a path"),
        (
            'path = "a"\nrole = "heights"',
            "raster.role = 'heights': expected 'elevation' or 'orthophoto' or 'picture'",
        ),
        ('path = "a"\nrole = ["picture"]', "raster.role"),
        ('path = "a"\nband = 0', "raster.band = 0: expected a whole number from 1 to 65535"),
        ('path = "a"\nband = 1.0', "raster.band = 1.0"),
        ('path = "a"\nband = true', "raster.band = true"),
        ('path = "a"\nsha256 = "ABC"', "raster.sha256 = 'ABC': expected 64 hexadecimal digits"),
        ('path = "a"\naccuracy = -2', "raster.accuracy = -2: expected a number from -1 to 1000 m"),
        ('path = "a"\noffset = nan', "raster.offset = nan: expected a number from -12000 to 12000 m"),
        ('path = "a"\nvertical = "geoid"', "raster.vertical = 'geoid': expected a code as \"EPSG:5773\""),
        ('path = "a"\nvertical = "EPSG:25832"', "'EPSG:25832' is not a vertical datum"),
        ('path = "a"\nrol = "picture"', "unknown key 'rol' = 'picture': expected path"),
    ],
)
def test_invalid_sources_are_refused_in_one_line(folder, keys, problem):
    assert problem in refusal(folder(f"[[raster]]\n{keys}\n"))


def test_tables_are_expected_and_at_most_64(folder):
    assert "raster = 'dem.tif': expected tables" in refusal(folder('raster = "dem.tif"'))
    table = '[[raster]]\npath = "a.tif"\n'
    assert len(parse_settings(f"format = 2\n{64 * table}".encode()).rasters) == 64
    assert "65 rasters: expected at most 64" in refusal(folder(65 * table))
    for wrong in ("a.tif", 3, None):
        refused("rasters: expected RasterSource values", Sketch, rasters=(wrong,))
    refused("expected the name of a stored raster", RasterSource, "../sketch.toml", content=b"format = 2")


def test_paths_are_relative_inside_the_sketch_and_absolute_in_memory(tmp_path, dem):
    home = tmp_path / "valley"
    inside = home / "maps" / "a.png"
    inside.parent.mkdir(parents=True)
    inside.write_bytes(b"map")
    sketch = Sketch(rasters=(raster_source(dem, "elevation", band=2), raster_source(inside, "picture")))
    save_sketch(sketch, home)
    text = (home / "sketch.toml").read_text()
    assert 'path = "maps/a.png"' in text
    assert f'path = "{dem}"' in text
    same(load_sketch(home), sketch)
    home.rename(tmp_path / "moved")
    assert [each.path for each in load_sketch(tmp_path / "moved").rasters] == [
        str(dem),
        str(tmp_path / "moved/maps/a.png"),
    ]
    above = Sketch(rasters=(RasterSource("../data/dem (ü).tif"),))
    save_sketch(above, tmp_path / "moved")
    loaded = load_sketch(tmp_path / "moved")
    assert raster_problem(loaded.rasters[0]) == ""
    save_sketch(loaded, tmp_path / "moved")
    assert 'path = "../data/dem (ü).tif"' in (tmp_path / "moved/sketch.toml").read_text()


def test_a_missing_or_changed_source_is_named_and_kept(tmp_path, dem, monkeypatch):
    sketch = Sketch(rasters=(raster_source(dem, "elevation"),))
    place = tmp_path / "valley.sketch"
    save_sketch(sketch, place)
    stored = place.read_bytes()
    assert raster_problem(sketch.rasters[0]) == ""
    for change, problem in (
        (lambda: dem.write_bytes(b"HEIGHTS, others"), "its content has changed since it was added"),
        (dem.unlink, "the file is missing"),
        (dem.mkdir, "expected a file"),
    ):
        change()
        loaded = load_sketch(place)
        same(loaded, sketch)
        assert raster_problem(loaded.rasters[0]) == f"raster {dem}: {problem}"
        save_sketch(loaded, place)
        assert place.read_bytes() == stored
    refused("the file is missing", raster_source, tmp_path / "none.tif", "picture")
    odd = RasterSource("two\nlines" * 400)
    assert raster_problem(odd).isprintable()
    assert (
        raster_problem(RasterSource("/x", sha256="0" * 64, role="picture"))
        == "raster /x: the file is missing"
    )


def test_files_are_hashed_once_until_they_change(dem, monkeypatch):
    hashed, original = [], rasters.hash_file
    monkeypatch.setattr(rasters, "hash_file", lambda path: hashed.append(path) or original(path))
    dem.write_bytes(b"of this test")
    source = raster_source(dem, "picture")
    assert len(hashed) == 1
    for _ in range(3):
        assert raster_problem(source) == ""
    os.utime(dem, (1, 1))
    assert raster_problem(source) == ""
    assert hashed == [dem, dem]


def test_stored_rasters_go_where_the_sketch_goes(tmp_path, dem):
    content = dem.read_bytes()
    source = raster_source(dem, "picture", embed=True)
    sketch = Sketch(rasters=(source, source, raster_source(dem, "elevation")))
    dem.unlink()
    places = [tmp_path / "folder", tmp_path / "zip.sketch", tmp_path / "again"]
    for before, place in zip([None, *places], places, strict=False):
        loaded = sketch if before is None else load_sketch(before)
        save_sketch(loaded, place)
        same(load_sketch(place), sketch)
        assert [bool(raster_problem(each)) for each in load_sketch(place).rasters] == [False, False, True]
    stored = tmp_path / "folder" / source.path
    assert source.path.startswith("dem_-")
    assert stored.read_bytes() == content
    recovery = tmp_path / "recovery.sketch"
    recovery.write_bytes(pack_sketch(sketch))
    same(load_sketch(recovery), sketch)

    others = [tmp_path / "folder" / name for name in ("mine.raster", "notes.txt", "dem.tif")]
    for path in others:
        path.write_bytes(b"mine")
    save_sketch(sketch.replace(rasters=()), tmp_path / "folder")
    assert not stored.exists()
    assert all(path.read_bytes() == b"mine" for path in others)
    assert load_sketch(tmp_path / "folder").rasters == ()


def test_a_stored_raster_that_is_missing_or_changed_keeps_its_entry(tmp_path, dem):
    source = raster_source(dem, "picture", embed=True)
    home = tmp_path / "valley"
    save_sketch(Sketch(rasters=(source,)), home)
    text, stored = (home / "sketch.toml").read_text(), home / source.path
    stored.write_bytes(b"other")
    loaded = load_sketch(home)
    assert (
        raster_problem(loaded.rasters[0])
        == f"raster {source.path}: its content has changed since it was added"
    )
    save_sketch(loaded, home)
    assert (stored.read_bytes(), (home / "sketch.toml").read_text()) == (b"other", text)
    stored.unlink()
    loaded = load_sketch(home)
    assert raster_problem(loaded.rasters[0]) == f"raster {stored}: the file is missing"
    stored.write_bytes(b"heights")  # it comes back while the sketch is open
    save_sketch(loaded, home)
    assert (home / "sketch.toml").read_text() == text
    same(load_sketch(home), Sketch(rasters=(source,)))


def test_stored_rasters_have_a_limit(tmp_path, dem, monkeypatch):
    monkeypatch.setattr(rasters, "MAX_EMBEDDED_BYTES", 1 << 20)
    dem.write_bytes(bytes((1 << 20) + 1))
    refused(r"dem .*: too large: expected at most 1 MiB", raster_source, dem, "picture", embed=True)
    dem.write_bytes(bytes(1 << 20))
    first = raster_source(dem, "picture", embed=True)
    Sketch(rasters=(first, first))  # one file
    (tmp_path / "b.tif").write_bytes(b"b")
    with pytest.raises(InputError, match="rasters stored in the sketch: too large: expected at most 1 MiB"):
        Sketch(rasters=(first, embedded(RasterSource(str(tmp_path / "b.tif")))))


def test_keys_of_elevation_are_stored_with_elevation_or_where_they_are_set():
    picture, grid = RasterSource("/map.tif"), RasterSource("/dem.tif", "elevation")
    assert not {"[base]", "offset"} & set(settings_text(Sketch(rasters=(picture,))).split())
    text = settings_text(Sketch(rasters=(picture, grid)))
    for key in (
        "[base]",
        "detail = 1.0",
        "margin = -1.0",
        "accuracy = -1.0",
        'vertical = ""',
        "offset = 0.0",
    ):
        assert text.count(key) == 1 + (key == 'vertical = ""'), key  # the frame has one
    moved = Sketch(rasters=(replace(picture, offset=2.0),), base={"detail": 0.5})
    assert (settings_text(moved).count("offset"), settings_text(moved).count("[base]")) == (1, 1)
    for sketch in (moved, Sketch(rasters=(replace(grid, accuracy=8, vertical="EPSG:5773", offset=-3.5),))):
        same(parse_settings(settings_text(sketch).encode()), sketch)


def test_rasters_are_undone_and_redone(dem):
    history = History(Sketch())
    linked, stored = raster_source(dem, "picture"), raster_source(dem, "elevation", embed=True)
    states = [(), (linked,), (linked, stored), (stored,)]
    for state in states[1:]:
        history.record("Rasters", history.sketch.replace(rasters=state))
    history.record("Nothing", history.sketch.replace(rasters=(raster_source(dem, "elevation", embed=True),)))
    assert len(history.titles) == 4
    for position in (3, 0, 2, 1, 3):
        history.go_to(position)
        assert history.sketch.rasters == states[position]
