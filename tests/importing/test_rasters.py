"""Raster sources: their area, and pictures resampled to a sketch."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from affine import Affine
from PIL import Image

from sketchterrain.document.rasters import RasterSource, embedded
from sketchterrain.document.sketch import Sketch
from sketchterrain.elevation.pictures import read_picture
from sketchterrain.errors import InputError
from sketchterrain.generation.building import build
from sketchterrain.importing.elevation import raster_area
from tests.geo_files import write_raster

RED, GREEN = (200, 30, 40, 255), (20, 180, 60, 255)
UTM = {"crs": "EPSG:25832", "east": 600000.0, "north": 5269000.0}
UPRIGHT = Affine(10.0, 0.0, 600000.0, 0.0, -10.0, 5270000.0)


@pytest.fixture
def written(tmp_path):
    """Write bands (n, rows, columns), and return the source of the file."""

    def write(bands, crs, transform, **options):
        path = tmp_path / f"{len(list(tmp_path.iterdir()))}.tif"
        return RasterSource(str(write_raster(path, bands, transform, crs, **options)))

    return write


@pytest.fixture
def halves(written):
    """A picture of 2 × 1 km, red in the west, green in the east."""
    bands = np.empty((3, 100, 200), np.uint8)
    bands[:, :, :100], bands[:, :, 100:] = (np.array(c[:3])[:, None, None] for c in (RED, GREEN))
    return lambda crs="EPSG:25832", at=UPRIGHT: written(bands, crs, at, photometric="RGB")


def colour_at(picture, x, y):
    """Return the colour at a position of the sketch (m); None outside of the picture."""
    west, south, east, north = picture.box
    rows, columns = picture.pixels.shape[:2]
    if not (west <= x < east and south <= y < north):
        return None
    row, column = int((north - y) / (north - south) * rows), int((x - west) / (east - west) * columns)
    return tuple(picture.pixels[row, column].tolist())


def test_areas_are_metric(halves, written):
    area = raster_area(halves())
    assert (area.frame, area.size) == (UTM, (2000.0, 1000.0))
    assert raster_area(halves(None)) is None
    degrees = raster_area(halves("EPSG:4326", Affine(0.0001, 0.0, 9.0, 0.0, -0.0001, 48.0)))
    assert degrees.frame["crs"] == "EPSG:32632"
    assert degrees.size == pytest.approx((1492.0, 1112.0), abs=1.0)
    assert raster_area(halves("EPSG:3857")).frame["crs"] == "EPSG:32631"  # its metres are no metres
    for each in (area, degrees):
        Sketch(frame=each.frame, extent=max(each.size))


def test_orthophotos_colour_the_ground(halves, tmp_path) -> None:
    """Where they lie, and without a change of a height; one that is missing is left out."""
    frame = UTM | {"east": 600500.0, "north": 5268500.0}
    source = replace(halves(), role="orthophoto")
    bare = Sketch(frame=frame, extent=4000.0)
    sketch = bare.replace(rasters=(source, RasterSource(str(tmp_path / "none.tif"), "orthophoto")))
    terrain, plain = build(sketch), build(bare)
    assert plain.appearance.is_empty
    window = terrain.appearance.window(100.0, 600.0, cell=(100.0, 100.0), columns=18, rows=1)[0]
    assert (window[:3, 0] > 2 * window[:3, 1]).all()  # red
    assert (window[6:13, 1] > 2 * window[6:13, 0]).all()
    assert (window[[0, 3, 6, 12], 3] > 250).all()
    assert (window[16:, 3] == 0).all()
    x, y = np.random.default_rng(1).uniform(0, 4000, (2, 50))
    np.testing.assert_array_equal(terrain.heights(x, y), plain.heights(x, y))


def test_pictures_lie_where_their_georeference_says(halves):
    sketch = Sketch(frame=UTM | {"east": 600500.0, "north": 5268500.0}, extent=4000.0)
    for source in (halves(), embedded(halves()), halves(None), halves("EPSG:32632")):
        picture = read_picture(source, sketch)
        assert picture.box == pytest.approx((0.0, 500.0, 1500.0, 1500.0), abs=0.01)
        assert picture.pixels.shape == (512, 768, 4)
        for x, y, colour in ((100, 600, RED), (480, 1400, RED), (520, 600, GREEN), (1400, 1400, GREEN)):
            assert colour_at(picture, x, y) == colour
        assert colour_at(picture, 1600, 600) is None


def test_rotated_and_flipped_pictures_are_upright(halves):
    flipped = read_picture(halves(None, Affine(10, 0, 0, 0, 10, 0)), Sketch(extent=2000.0))
    assert [colour_at(flipped, x, 500) for x in (900, 1100)] == [RED, GREEN]
    turned = read_picture(halves(None, Affine(0, 10, 0, 10, 0, 0)), Sketch(extent=2000.0))
    assert turned.box == (0.0, 0.0, 1000.0, 2000.0)
    assert [colour_at(turned, 500, y) for y in (900, 1100)] == [RED, GREEN]
    slanted = read_picture(halves(None, Affine(8, 6, 0, 6, -8, 800)), Sketch(extent=3000.0))
    assert colour_at(slanted, 10, 10)[3] == 0  # beside it
    assert colour_at(slanted, 700, 800) == RED


def test_pictures_without_georeference_cover_the_sketch(tmp_path):
    image = Image.new("RGB", (40, 20), RED[:3])
    image.paste(GREEN[:3], (20, 0, 40, 20))
    indexed = image.quantize(2)
    sketch = Sketch(extent=1000.0, layers={"hill": np.zeros((300, 600), np.uint8)}, frame=UTM)
    for name, each in (("a.png", image), ("b.png", indexed), ("c.webp", image)):
        each.save(tmp_path / name, **({"lossless": True} if name == "c.webp" else {}))
        picture = read_picture(RasterSource(str(tmp_path / name)), sketch)
        assert picture.box == (0.0, 0.0, 1000.0, 500.0), name
        assert [colour_at(picture, x, 250) for x in (490, 510)] == [RED, GREEN], name


def test_values_are_stretched_over_their_range_and_absent_ones_are_clear(written):
    values = np.linspace(-500.0, 1500.0, 400, dtype=np.float32).reshape(1, 20, 20)
    values[0, :5] = -9999.0
    values[0, 5, 0] = np.nan
    source = written(np.concatenate([0 * values, values]), None, Affine(50, 0, 0, 0, -50, 1000), nodata=-9999)
    picture = read_picture(RasterSource(source.path, band=2), Sketch(extent=1000.0))
    shown = picture.pixels[..., 3] == 255
    assert shown.mean() == pytest.approx(0.7475, abs=0.01)
    assert (picture.pixels[shown, 0].min(), picture.pixels[shown, 0].max()) == (0, 255)
    assert not picture.pixels[:500, :, 3].any()
    constant = written(np.full((1, 4, 4), 7, np.uint16), None, Affine(50, 0, 0, 0, -50, 200))
    assert not read_picture(constant, Sketch(extent=1000.0)).pixels[..., :3].any()


def test_a_large_picture_is_read_at_the_resolution_of_the_canvas(written):
    bands = np.zeros((1, 4096, 4096), np.uint8)
    bands[:, ::2] = 255
    picture = read_picture(written(bands, None, Affine(1, 0, 0, 0, -1, 4096)), Sketch(extent=4096.0))
    assert picture.pixels.shape == (2048, 2048, 4)
    assert set(np.unique(picture.pixels[..., 0])) <= {127, 128}


def test_what_cannot_be_shown_is_one_line(tmp_path, halves):
    (tmp_path / "notes\n.txt").write_text("no picture")
    whole = halves()
    (tmp_path / "cut.tif").write_bytes(Path(whole.path).read_bytes()[:20000])
    sketch = Sketch(frame=UTM)
    for source, where, problem in (
        (RasterSource(str(tmp_path / "none.tif")), sketch, "the file is missing"),
        (RasterSource("/vsicurl/http://localhost:9/a.tif"), sketch, "the file is missing"),
        (RasterSource(str(tmp_path)), sketch, "expected a file"),
        (RasterSource(str(tmp_path / "notes\n.txt")), sketch, "cannot be read as a raster"),
        (RasterSource(str(tmp_path / "cut.tif")), sketch, "cannot be read as a raster"),
        (RasterSource("a-00000000.raster", content=b""), sketch, "cannot be read as a raster"),
        (RasterSource(whole.path, band=4), sketch, "band = 4: expected 1 to 3"),
        (whole, Sketch(), "expected a sketch with a CRS, [frame] has none"),
        (whole, Sketch(frame=UTM | {"east": 700000.0}), "expected a picture inside the sketch"),
    ):
        with pytest.raises(InputError) as caught:
            read_picture(source, where)
        assert problem in str(caught.value)
        assert str(caught.value).startswith("raster ")
        assert str(caught.value).isprintable()
