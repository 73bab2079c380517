"""Rasters as draped layers: windows of any resolution in the sketch's frame."""

import os

import numpy as np
import pytest
import rasterio
from rasterio.enums import ColorInterp

from sketchterrain.document.drapes import DrapedLayer, draped_layer
from sketchterrain.drape.drapes import Drapes, Pick
from sketchterrain.io.disk_cache import stored_folder
from tests.drape.test_vector_sources import ALL, EXTENT, FRAME, opened

SIDE = 1000  # px, of a metre each


def from_origin(west, north, x, y):
    return rasterio.Affine(x, 0.0, west, 0.0, -y, north)


def picture(path, bands, *, crs=FRAME["crs"], transform=None, interp=None, colours=None, **options):
    bands = np.atleast_3d(bands) if np.ndim(bands) == 2 else bands
    bands = bands.transpose(2, 0, 1) if bands.shape[-1] == 1 else bands
    count, rows, columns = bands.shape
    transform = transform or from_origin(
        FRAME["east"], FRAME["north"] + EXTENT, EXTENT / columns, EXTENT / rows
    )
    profile = {"driver": "GTiff", "count": count, "height": rows, "width": columns, "dtype": bands.dtype}
    with rasterio.open(path, "w", crs=crs, transform=transform, **profile, **options) as file:
        file.write(bands)
        if interp:
            file.colorinterp = interp
        if colours:
            file.write_colormap(1, colours)
    return path


def source_of(path, **values):
    drapes = opened(DrapedLayer(str(path)).replace(**values))
    assert drapes.problems == ()
    return drapes.rasters(1.0)[0][1]


def ramps(side=SIDE):
    rows, columns = np.indices((side, side))
    return np.stack([columns * 255 // side, rows * 255 // side, 0 * rows + 7]).astype(np.uint8)


def test_windows_are_the_pixels_at_their_own_resolution(tmp_path) -> None:
    bands = np.random.default_rng(0).integers(0, 255, (3, SIDE, SIDE), np.uint8)
    source = source_of(picture(tmp_path / "own.tif", bands))
    assert source.box.tolist() == [0.0, 0.0, EXTENT, EXTENT]
    assert source.pixel == 1.0
    found = source.pixels(100.0, EXTENT - 200.0, 1.0, 64, 32)
    assert found.shape == (32, 64, 4)
    assert (found[..., 3] == 255).all()
    assert np.array_equal(found[..., :3], bands[:, 200:232, 100:164].transpose(1, 2, 0))
    over = source.pixels(-32.0, EXTENT + 32.0, 1.0, 64, 64)
    assert (over[:32, :, 3] == 0).all()
    assert (over[:, :32, 3] == 0).all()
    assert (over[32:, 32:, 3] == 255).all()
    assert not source.pixels(5000.0, 500.0, 1.0, 8, 8).any()


def test_coarse_windows_are_means_with_and_without_overviews(tmp_path) -> None:
    bands = np.random.default_rng(1).integers(0, 255, (3, SIDE, SIDE), np.uint8)
    plain, tiled = (
        picture(tmp_path / name, bands, tiled=True, blockxsize=256, blockysize=256)
        for name in ("a.tif", "b.tif")
    )
    with rasterio.open(tiled, "r+") as file:
        file.build_overviews([2, 4], rasterio.enums.Resampling.average)
    mean = bands.reshape(3, 125, 8, 125, 8).mean(axis=(2, 4)).transpose(1, 2, 0)
    for path in (plain, tiled):
        found = source_of(path).pixels(0.0, EXTENT, 8.0, 125, 125)
        assert np.abs(found[..., :3] - mean).max() <= 2.0, path
    # Neighbouring windows agree where they overlap.
    source = source_of(tiled)
    wide, east = source.pixels(0.0, 800.0, 3.0, 128, 64), source.pixels(192.0, 800.0, 3.0, 64, 64)
    assert np.abs(wide[4:-4, 68:-4].astype(int) - east[4:-4, 4:-4]).max() <= 1


def test_large_rasters_get_overviews_in_the_cache_and_stay_untouched(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("sketchterrain.drape.raster_source._PLAIN", 512 * 512)
    path = picture(tmp_path / "large.tif", ramps(2048))
    before = path.read_bytes(), sorted(each.name for each in tmp_path.iterdir())
    source = source_of(path)
    assert source._overviews == [1, 4, 8, 16]
    coarse = source.pixels(0.0, EXTENT, EXTENT / 64, 64, 64)
    assert np.abs(coarse[..., 0].astype(int) - (np.arange(64) * 255 // 64 + 2)).max() <= 3
    assert (path.read_bytes(), sorted(each.name for each in tmp_path.iterdir())) == before


def test_palettes_alpha_nodata_and_depths_become_colours(tmp_path) -> None:
    half = np.zeros((SIDE, SIDE), np.uint8)
    half[:, 1::2] = 3
    colours = {0: (200, 0, 0, 255), 3: (0, 100, 0, 255)}
    indexed = source_of(picture(tmp_path / "palette.tif", half, colours=colours))
    assert indexed.pixels(10.0, 900.0, 1.0, 4, 1)[0].tolist() == [[200, 0, 0, 255], [0, 100, 0, 255]] * 2
    mean = indexed.pixels(0.0, 900.0, 2.0, 50, 50)  # colours are mixed, not indices
    assert np.abs(mean.reshape(-1, 4).mean(axis=0) - [100, 50, 0, 255]).max() < 8

    clear = np.concatenate(
        [ramps(), np.where(np.indices((SIDE, SIDE))[1] < 500, 0, 128)[None].astype(np.uint8)]
    )
    rgb = (ColorInterp.red, ColorInterp.green, ColorInterp.blue, ColorInterp.alpha)
    found = source_of(picture(tmp_path / "alpha.tif", clear, interp=rgb)).pixels(0.0, 500.0, 10.0, 100, 1)[0]
    assert (found[:49, 3] == 0).all()
    assert np.abs(found[52:, 3].astype(int) - 128).max() <= 1

    heights = np.linspace(1000, 5000, SIDE * SIDE).reshape(SIDE, SIDE).astype(np.uint16)
    heights[:100] = 0
    source = source_of(picture(tmp_path / "deep.tif", heights, nodata=0))
    found = source.pixels(0.0, EXTENT, 10.0, 100, 100)
    assert (found[:9, :, 3] == 0).all()
    assert (found[11:, :, 3] == 255).all()
    assert np.ptp(found[11:, :, 0].astype(int)) > 220
    assert (np.diff(found[11:, 50, 0].astype(int)) >= 0).all()
    inner = source.pixels(100.0, 500.0, 10.0, 10, 10)  # one range for all windows
    assert np.array_equal(inner, found[50:60, 10:20])

    values = np.linspace(-1.0, 1.0, SIDE * SIDE).reshape(SIDE, SIDE).astype(np.float32)
    values[:, :200] = np.nan
    found = source_of(picture(tmp_path / "float.tif", values)).pixels(0.0, EXTENT, 10.0, 100, 100)
    assert (found[:, :19, 3] == 0).all()
    assert (found[:, 21:, 3] == 255).all()
    assert found[2, 50, 0] < 20
    assert found[97, 50, 0] > 235


def test_rasters_in_other_systems_lie_in_their_place(tmp_path) -> None:
    degrees = from_origin(2.98, 42.47, 0.00005, 0.00005)
    path = picture(tmp_path / "degrees.tif", ramps(1200), crs="EPSG:4326", transform=degrees)
    source = source_of(path)
    found = source.pixels(0.0, 300.0, 1.0, 1, 1)[0, 0]  # 3° east is the frame's west
    assert abs(int(found[0]) - (3.0 - 2.98) / 0.00005 * 255 / 1200) <= 2
    with pytest.warns(rasterio.errors.NotGeoreferencedWarning):
        unplaced = picture(tmp_path / "plain.tif", ramps(), crs=None, transform=rasterio.Affine.identity())
    source = source_of(unplaced)
    assert source.box.tolist() == [0.0, 0.0, EXTENT, EXTENT]
    assert source.pixels(500.0, 500.0, 1.0, 1, 1)[0, 0].tolist() == [*ramps()[:, 500, 500].tolist(), 255]
    own = from_origin(FRAME["east"] + 100.0, FRAME["north"] + 300.0, 1.0, 1.0)
    assert source_of(picture(tmp_path / "own.tif", ramps(100), crs=None, transform=own)).box[0] == 100.0
    local = {"crs": "", "east": 0.0, "north": 0.0}
    refused = Drapes.open([DrapedLayer(str(path))], local, (EXTENT, EXTENT), EXTENT)
    assert refused.sources == (None,)
    assert "expected a sketch with a CRS" in refused.problems[0]


def test_rasters_are_picked_and_change_as_a_whole(tmp_path) -> None:
    bands = ramps()
    drapes = opened(DrapedLayer(str(picture(tmp_path / "map.tif", bands))))
    assert drapes.pick(500.0, 500.0, 1.0) == Pick(0, -1)
    assert drapes.pick(-5.0, 500.0, 1.0) is None
    assert not len(drapes.items(ALL, 1.0).feature)
    assert drapes.features(0, ALL).size == 0
    assert drapes.occupied(np.array([[10, 10, 20, 20], [2000, 10, 2010, 20]], float)).tolist() == [
        True,
        False,
    ]
    faded = drapes.updated([drapes.layers[0].replace(opacity=0.5)])
    assert faded.sources == drapes.sources
    hashed = opened(draped_layer(tmp_path / "map.tif"))
    os.utime(tmp_path / "map.tif", (1, 1))  # the same content
    assert hashed.pick(500.0, 500.0, 1.0) == Pick(0, -1)
    os.utime(tmp_path / "map.tif", ns=(1, drapes.sources[0]._stamp[1]))
    assert len(faded.changed_boxes(drapes)) == 2
    picture(tmp_path / "map.tif", bands[:, :500])
    source = drapes.rasters(1.0)[0][1]
    assert not source.pixels(10.0, 900.0, 1.0, 8, 8).any()  # not those of another picture
    later = drapes.updated(drapes.layers)
    assert len(later.problems) == 1
    assert "has changed" in later.problems[0]
    damaged = tmp_path / "damaged.tif"
    damaged.write_bytes((tmp_path / "map.tif").read_bytes()[:100])
    band = DrapedLayer(str(tmp_path / "map.tif")).replace(band=9)
    for layer in (DrapedLayer(str(damaged)), band, DrapedLayer(str(tmp_path / "missing.tif"))):
        bad = opened(layer)
        assert bad.sources == (None,)
        assert len(bad.problems) == 1
        assert "\n" not in bad.problems[0]


def test_folders_are_built_once_and_the_oldest_are_discarded(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    built = []

    def build(folder):
        built.append(folder)
        (folder / "content").write_bytes(bytes(100))

    first = stored_folder("test", "a", build, max_bytes=250)
    assert stored_folder("test", "a", build, max_bytes=250) == first
    assert len(built) == 1
    os.utime(first, (1, 1))
    others = [stored_folder("test", name, build, max_bytes=250) for name in "bcd"]
    assert not first.exists()
    assert [each.exists() for each in others] == [True] * 3
    with pytest.raises(ZeroDivisionError):
        stored_folder("test", "e", lambda _: 1 // 0)
    assert not list((tmp_path / "sketchterrain").glob(".*"))
    (others[0] / "complete").unlink()  # as of a build by a version before
    assert stored_folder("test", "b", build, max_bytes=1000) == others[0]
    assert len(built) == 5
