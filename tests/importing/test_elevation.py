"""Sketches on real elevation: their place inside of the data, size, climate and sea."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from sketchterrain.document.rasters import RasterSource, raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.base import load_base
from sketchterrain.errors import InputError
from sketchterrain.importing.elevation import aligned, elevation_files, sketch_on_elevation, with_lakes
from sketchterrain.schema.layers import LAYERS
from sketchterrain.stages.runner import Runner
from tests.geo_files import write_raster

UTM = Affine(50.0, 0.0, 600_000.0, 0.0, -50.0, 5_270_000.0)


def dem(
    path: Path,
    transform: Affine = UTM,
    *,
    shape: tuple[int, int] = (80, 120),
    crs: str | None = "EPSG:25832",
    lowest: float = 800.0,
    void: Any = None,
) -> RasterSource:
    row, column = np.indices(shape)
    heights = (lowest + 40.0 * np.sin(row / 7.0) + 3.0 * column).astype(np.float32)
    if void is not None:
        heights[void] = -9999.0
    return raster_source(write_raster(path, heights, transform, crs, nodata=-9999.0), "elevation")


def corners(sketch: Sketch) -> np.ndarray:
    width, depth = sketch.size
    return np.array([[0.0, 0.0], [width, 0.0], [width, depth], [0.0, depth]])


def check_inside(sketch: Sketch) -> None:
    """The data have their whole weight everywhere in the sketch, corners included."""
    base = load_base(sketch, Runner())
    x, y = (np.linspace(0.0, side, 200) for side in sketch.size)
    grid = np.meshgrid(x, y)
    assert base.weight(*grid).min() > 1.0 - 1e-9
    assert np.isfinite(base.heights(*grid, 1.0).height).all()


def test_the_sketch_is_an_empty_rectangle_inside_of_the_data(tmp_path):
    source = dem(tmp_path / "alps.dem.tif")
    sketch, _ = sketch_on_elevation([source])
    check_inside(sketch)
    assert (sketch.name, sketch.frame["crs"], sketch.rasters) == ("alps", "EPSG:25832", (source,))
    assert 0.8 * 6000 < sketch.size[0] < 6000
    assert 0.8 * 4000 < sketch.size[1] < 4000
    assert not any(image.any() for image in sketch.layers.values())
    assert not any(sketch.density.values())
    assert {name for name, _ in sketch.labels} == set(LAYERS)
    assert sketch.coast["sea_level"] == -1e4
    assert 2000.0 < sketch.climate["tree_line"] < 2500.0
    assert sketch.climate["snow_line"] == sketch.climate["tree_line"] + 800.0
    assert sketch.weather["latitude"] == pytest.approx(47.55, abs=0.05)


def test_data_in_degrees_rotated_or_in_tiles_contain_the_sketch(tmp_path):
    degrees = Affine(1 / 1200, 0.0, 1.4, 0.0, -1 / 1200, 42.6)
    turned = UTM @ Affine.rotation(25)
    east, south = UTM @ Affine.translation(120, 0), UTM @ Affine.translation(0, 80)
    for name, crs, transforms in (
        ("degrees", "EPSG:4326", [degrees]),
        ("turned", "EPSG:25832", [turned]),
        ("corner", "EPSG:25832", [UTM, east, south]),
        ("mixed", "EPSG:25832", [UTM, turned]),
    ):
        sources = [dem(tmp_path / f"{name}{n}.tif", each, crs=crs) for n, each in enumerate(transforms)]
        sketch = sketch_on_elevation(sources)[0]
        check_inside(sketch)
        assert sketch.frame["crs"] == ("EPSG:32631" if name == "degrees" else crs), name
        if name == "corner":  # of an L, one of its arms
            assert max(sketch.size) > 7000.0


def test_extent_and_origin_choose_a_part(tmp_path):
    source = dem(tmp_path / "a.tif")
    whole = sketch_on_elevation([source])[0]
    part = sketch_on_elevation([source], extent=2000.0)[0]
    assert (part.size, part.width_px, part.height_px) == ((2000.0, 2000.0), 512, 512)
    middles = [
        np.array([each.frame["east"], each.frame["north"]]) + np.array(each.size) / 2
        for each in (whole, part)
    ]
    assert np.abs(middles[0] - middles[1]).max() < 2.0 * whole.pixel_size
    wide = sketch_on_elevation([source], extent=5000.0)[0]
    assert (wide.size[0], wide.size[1]) == (5000.0, pytest.approx(whole.size[1], abs=10.0))
    moved = sketch_on_elevation(
        [source], extent=1000.0, origin=(601_000.0, 5_267_000.0), vertical="EPSG:5773"
    )[0]
    frame = {"crs": "EPSG:25832", "east": 601_000.0, "north": 5_267_000.0, "vertical": "EPSG:5773"}
    assert moved.frame == frame
    other = sketch_on_elevation([source], crs="EPSG:25833")[0]
    assert other.frame["crs"] == "EPSG:25833"
    check_inside(other)


def test_pixels_are_steps_of_the_data_within_limits(tmp_path):
    for step, pixels in ((50.0, 512), (1000.0, 512)):
        source = dem(tmp_path / "a.tif", Affine(step, 0.0, 6e5, 0.0, -step, 5.27e6))
        assert sketch_on_elevation([source])[0].width_px == pixels
    source = dem(tmp_path / "fine.tif", shape=(700, 900))
    assert sketch_on_elevation([source])[0].pixel_size == pytest.approx(50.0, rel=0.01)


def test_low_rims_are_a_sea_and_small_voids_are_none(tmp_path):
    sketch, base = sketch_on_elevation([dem(tmp_path / "coast.tif", lowest=-60.0)])
    assert sketch.coast["sea_level"] == 0.0
    assert "heights of 0 m and less at the rim: taken for a sea, [coast] sea_level = 0" in base.findings
    holed, base = sketch_on_elevation([dem(tmp_path / "holed.tif", void=np.s_[30:40, 50:60])])
    assert sketch_on_elevation([dem(tmp_path / "whole.tif")])[0].size == holed.size
    assert any("filled" in line for line in base.findings)


def test_local_metres_have_no_climate(tmp_path):
    source = dem(tmp_path / "a.tif", Affine(2.0, 0.0, 40.0, 0.0, -2.0, 900.0), crs=None)
    sketch = sketch_on_elevation([source])[0]
    check_inside(sketch)
    assert (sketch.frame["crs"], sketch.climate["tree_line"], sketch.climate["snow_line"]) == ("", 1e4, 1e4)


def test_refusals(tmp_path):
    source = dem(tmp_path / "a.tif")
    strips = np.ones((80, 120), bool)
    strips[::30] = strips[1::30] = False  # two rows of samples each
    for call, problem in (
        (lambda: sketch_on_elevation([source], crs="EPSG:4326"), "is in degrees"),
        (lambda: sketch_on_elevation([source], origin=(0.0, 0.0)), "no elevation where the sketch would be"),
        (
            lambda: sketch_on_elevation([dem(tmp_path / "s.tif", void=strips)]),
            "s.tif: has voids everywhere",
        ),
    ):
        with pytest.raises(InputError, match=problem):
            call()
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match=r"no elevation in it: expected files \.tif"):
        elevation_files(tmp_path / "empty")
    (tmp_path / "notes.txt").write_text("no grid")
    assert elevation_files(tmp_path) == [tmp_path / "a.tif", tmp_path / "s.tif"]
    assert elevation_files(tmp_path / "notes.txt") == [tmp_path / "notes.txt"]


def test_offsets_of_overlapping_files_are_told_and_removed(tmp_path):
    here, above = dem(tmp_path / "a.tif"), dem(tmp_path / "b.tif", lowest=820.0)
    sketch, base = sketch_on_elevation([here, above])
    assert any(line.startswith("a.tif lies 20.0 m below b.tif") for line in base.findings)
    level = aligned(sketch)
    assert sorted(abs(each.offset) for each in level.rasters) == pytest.approx([0.0, 20.0], abs=0.1)
    assert not any("lies" in line for line in load_base(level, Runner()).findings)
    assert aligned(level).rasters == level.rasters


def test_level_areas_become_lakes(tmp_path):
    source = dem(tmp_path / "flat.tif")
    with rasterio.open(source.path, "r+") as file:
        heights = file.read(1)
        heights[30:45, 40:60] = 780.0
        file.write(heights, 1)
    sketch, _ = sketch_on_elevation([raster_source(Path(source.path), "elevation")])
    found, lines = with_lakes(sketch)
    assert len(found.vectors["lake"].ids) == 1
    assert lines == ("1 flattened lake of 0.749 km² in all",)
    assert with_lakes(found)[0].vectors["lake"].ids.size == 1
