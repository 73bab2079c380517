"""Vertical datums: converted by a geoid grid at hand, else told; EGM2008 in the Alps is the truth."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rasterio
import rasterio.warp

from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import Affine6, ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.offsets import corrections, measure_offsets
from sketchterrain.elevation.quirks import CleanedSamples
from sketchterrain.elevation.raster_reader import ELLIPSOID
from sketchterrain.elevation.vertical import convert_heights
from sketchterrain.errors import InputError

ALPS = Path(os.environ.get("SKETCHTERRAIN_DEMS", "")) / "egm2008_1_clip_alps.tif"
EGM96, EGM2008 = "EPSG:5773", "EPSG:3855"
UTM = SketchFrame("EPSG:32632", 500_000.0, 5_150_000.0)
PLACE: Affine6 = (30.0, 5.0, 500_000.0, 5.0, -30.0, 5_160_000.0)


@pytest.fixture
def no_geoids(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return an empty folder, the only one in which geoids are looked for."""
    monkeypatch.setattr("sketchterrain.elevation.vertical._proj_folders", lambda: iter([tmp_path]))
    return tmp_path


@pytest.fixture
def geoids(no_geoids: Path) -> Path:
    """Return a folder with EGM2008 in the Alps, and EGM96 made of it: 0.4 m higher."""
    if not ALPS.is_file():
        pytest.skip("no geoid")
    shutil.copy(ALPS, no_geoids / "us_nga_egm08_25.tif")
    with rasterio.open(ALPS) as file:
        values, profile = file.read(1), file.profile
    with rasterio.open(no_geoids / "us_nga_egm96_15.tif", "w", **profile) as file:
        file.write(values + np.float32(0.4), 1)
    return no_geoids


def grid(crs: str = "EPSG:32632", place: Affine6 = PLACE, vertical: str = "") -> ElevationGrid:
    samples = np.full((300, 400), 1000.0, np.float32)
    return ElevationGrid(samples, place, 0.0, crs, UTM, vertical=vertical)


def truth(each: ElevationGrid) -> np.ndarray:
    """Return EGM2008's height above the ellipsoid at a grid's samples, bilinear in its grid."""
    row, column = np.indices(each.samples.shape).astype(float)
    a, b, c, d, e, f = each.place
    x, y = a * column + b * row + c, d * column + e * row + f
    longitude, latitude = rasterio.warp.transform(each.crs, "EPSG:4326", x.ravel(), y.ravel())
    with rasterio.open(ALPS) as file:
        values, at = file.read(1), ~file.transform
    c, r = np.array(longitude) * at.a + at.c - 0.5, np.array(latitude) * at.e + at.f - 0.5
    i, j = np.floor(r).astype(int), np.floor(c).astype(int)
    u, v = c - j, r - i
    top = values[i, j] * (1 - u) + values[i, j + 1] * u
    below = values[i + 1, j] * (1 - u) + values[i + 1, j + 1] * u
    return np.asarray(top * (1 - v) + below * v).reshape(row.shape)


@pytest.mark.usefixtures("geoids")
def test_heights_are_converted_to_half_a_metre() -> None:
    degrees: Affine6 = (3e-4, 0.0, 9.0, 0.0, -3e-4, 46.6)
    for each in (grid(), grid("EPSG:4326", degrees)):
        n = truth(each)
        assert 45.0 < n.min() < n.max() < 56.0
        for source, target, expected in (
            (ELLIPSOID, EGM2008, 1000.0 - n),
            (EGM2008, ELLIPSOID, 1000.0 + n),
            (EGM96, EGM2008, np.full_like(n, 1000.4)),
            ("EPSG:4979", EGM96, 1000.0 - n - 0.4),
        ):
            found = convert_heights(each, target, source)
            assert np.abs(found.samples - expected).max() < 0.05, (source, target)
            assert found.vertical == target
            assert "converted to" in found.findings[-1]
    assert convert_heights(grid(), EGM96, EGM96).findings == ()


@pytest.mark.usefixtures("geoids")
def test_a_wrong_declaration_is_told_by_the_offset_from_another_grid() -> None:
    rows, columns = np.indices((300, 400))
    relief = (1000.0 + 30.0 * np.sin(rows / 20.0) + 20.0 * np.cos(columns / 30.0)).astype(np.float32)
    right = replace(grid(), samples=relief, name="right.tif")
    ellipsoidal = replace(convert_heights(right, ELLIPSOID, EGM2008), name="wrong.tif", vertical="")
    for declared, lines in ((ELLIPSOID, 0), (EGM2008, 1), ("", 1)):
        found = convert_heights(ellipsoidal, EGM2008, declared)
        parts = [build_patches(each) for each in (found, right)]
        (offset,) = measure_offsets(parts)
        told = offset.finding(parts, ["wrong.tif", "right.tif"])
        assert len(told) == lines
        assert all(
            "wrong.tif lies 5" in each and "as if one were above the ellipsoid" in each for each in told
        )
        assert corrections(parts, [offset])[0] == pytest.approx(0.0, abs=0.5 if not lines else 60.0)


@pytest.mark.usefixtures("geoids")
def test_grids_read_by_rows_are_shifted_alike() -> None:
    whole = grid()
    by_rows = replace(whole, samples=CleanedSamples(lambda *rows: held(whole, rows), whole.shape, 30.0))
    expected, found = (convert_heights(each, EGM2008, ELLIPSOID) for each in (whole, by_rows))
    assert not isinstance(found.samples, np.ndarray)
    assert found.samples[37:90].tobytes() == expected.samples[37:90].tobytes()
    assert (found.id, found.found) == (expected.id, expected.found)


def held(grid: ElevationGrid, rows: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    part = grid.samples[slice(*rows)].copy()
    return part, np.ones(part.shape, bool)


def test_what_is_not_converted_is_told(no_geoids: Path) -> None:
    found = convert_heights(grid(), EGM2008, ELLIPSOID)
    assert np.array_equal(found.samples, grid().samples)
    assert found.findings == (
        "heights above the ellipsoid not converted to EGM2008 height (PROJ has no us_nga_egm08_25.tif): off "
        "by up to 107 m",
    )
    assert "off by up to 10 m" in convert_heights(grid(), EGM2008, EGM96).findings[0]
    assert "no vertical datum declared" in convert_heights(grid(), EGM2008).findings[0]
    assert "the sketch has no vertical datum" in convert_heights(grid(vertical=EGM96), "").findings[0]
    assert convert_heights(grid(), "").findings == ()
    if ALPS.is_file():
        shutil.copy(ALPS, no_geoids / "us_nga_egm08_25.tif")
        far = grid("EPSG:4326", (1e-3, 0.0, -120.0, 0.0, -1e-3, 40.0))
        assert "no geoid grid covers it" in convert_heights(far, EGM2008, ELLIPSOID).findings[0]
    local = ElevationGrid(grid().samples, PLACE)
    assert "no place on Earth" in convert_heights(local, EGM2008, ELLIPSOID).findings[0]
    with pytest.raises(InputError, match="vertical datum"):
        convert_heights(grid(), "EPSG:4326")


@pytest.mark.usefixtures("geoids")
def test_the_datum_of_a_file_is_read_and_a_wrong_declaration_told(tmp_path: Path) -> None:
    profile = {"driver": "GTiff", "width": 40, "height": 30, "count": 1, "dtype": "float32"}
    at = rasterio.Affine(30.0, 0.0, 500_000.0, 0.0, -30.0, 5_160_000.0)
    for crs, expected in (("EPSG:32632+5773", EGM96), ("EPSG:32632", "")):
        with rasterio.open(tmp_path / "a.tif", "w", crs=crs, transform=at, **profile) as file:
            file.write(np.full((30, 40), 500.0, np.float32), 1)
        found = read_grid(tmp_path / "a.tif", UTM)
        assert (found.vertical, found.crs, found.is_affine) == (expected, "EPSG:32632", True)
    found = convert_heights(grid(vertical=EGM96), EGM2008, ELLIPSOID)
    assert "above the ellipsoid as declared, not EGM96 height as in its file" in found.findings[0]
    assert found.samples.mean() < 960.0
