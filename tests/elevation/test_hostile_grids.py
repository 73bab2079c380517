"""Grids as they come: voids, tags, datums, places and overlaps of every kind, up to the surface."""

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
from rasterio.transform import Affine

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.elevation.surface import Heights
from sketchterrain.errors import InputError
from tests.elevation.conftest import MakeGrid, ground

DATA = Path(os.environ.get("SKETCHTERRAIN_DEMS", "no folder of real DEMs"))
UTM = SketchFrame("EPSG:32632", 500_000.0, 5_200_000.0)
ROW, COLUMN = np.indices((60, 80)).astype(np.float64)
RELIEF = 600.0 + 40.0 * np.sin(ROW / 7.0) + 30.0 * np.cos(COLUMN / 9.0) + 2.0 * COLUMN


def write(path: Path, heights: Any, crs: str | None = "EPSG:32632", **profile: Any) -> Path:
    transform = profile.pop("transform", Affine(30.0, 0.0, 500_100.0, 0.0, -30.0, 5_203_000.0))
    size = {"width": heights.shape[1], "height": heights.shape[0]}
    arguments = {"count": 1, "dtype": heights.dtype, "crs": crs, "transform": transform, **size, **profile}
    with rasterio.open(path, "w", driver="GTiff", **arguments) as file:
        file.write(heights, 1)
    return path


def surface(*grids: ElevationGrid, at: tuple[Any, Any]) -> Heights:
    """Return the finest surface of some grids."""
    work = Patchwork({each.id: each for each in map(build_patches, grids)})
    return work.surface(work.cover(0.0)).evaluate(*at)


def places(grid: ElevationGrid) -> tuple[Float64Array, Float64Array]:
    row, column = np.indices(grid.samples.shape).astype(np.float64)
    return grid.to_metres(column, row)


def assert_exact(*grids: ElevationGrid) -> None:
    """Each grid alone is interpolated, and has no height where it has voids."""
    for grid in grids:
        found, known = surface(grid, at=places(grid)), np.isfinite(grid.samples)
        covered = known & np.isfinite(found.height)
        assert np.abs(found.height - grid.samples)[covered].max() <= 1e-3
        assert not (found.weight > 0.0)[~known].any()
        assert covered.sum() > 0.5 * known.sum()


def test_voids_mixed_in_one_file_at_corners_and_sides(tmp_path: Path) -> None:
    heights = RELIEF.astype(np.float32)
    voids = np.zeros(heights.shape, bool)
    kinds = (-32768.0, 9999.0, 3.4e38, np.nan, -32767.0, -9999.0, -3.4e38, np.inf)
    corners = [np.s_[:5, :6], np.s_[:5, -6:], np.s_[-5:, :6], np.s_[-5:, -6:], np.s_[:3, 30:40]]
    for value, part in zip(
        kinds, [*corners, np.s_[20:24, 20:25], np.s_[40:43, 50:52], np.s_[30, 70]], strict=True
    ):
        heights[part] = value
        voids[part] = True
    heights[:, 0][~voids[:, 0]] = 0.0  # a collar
    grid = read_grid(write(tmp_path / "a.tif", heights, nodata=-9999.0), UTM)
    missing = np.isnan(grid.samples)
    assert missing[0].all() == voids[0].all()
    assert missing[:, 0].all()
    assert not missing[20:50, 10:75].any()  # small ones are filled
    assert np.abs(grid.samples - RELIEF)[20:50, 10:75].max() < 3.0
    assert len(grid.findings) >= 4
    assert_exact(grid)


def test_a_void_1406_samples_wide_shows_the_coarse_grid(make_grid: MakeGrid) -> None:
    coarse = make_grid(120.0, 60, 420, middle=(24_000.0, 8000.0), accuracy=8.0)
    fine = make_grid(30.0, 120, 1600, middle=(24_000.0, 8000.0))
    samples = fine.samples.copy()
    samples[30:90, 90:1496] = np.nan
    holed = replace(fine, samples=samples)
    assert_exact(holed)
    x, y = (each[60, 120:1460] for each in places(fine))
    assert np.isnan(surface(holed, at=(x, y)).height).all()
    found = surface(holed, coarse, at=(x, y))
    assert np.abs(found.height - ground(x, y)).max() < 60.0
    assert found.weight.min() == 1.0


@pytest.mark.parametrize(
    ("tag", "value", "expected"),
    [(None, -32768, 0), (0, -32768, 0), (-9999, -32768, 0), (-32768, -32768, 0), (700, -32768, 1)],
)
def test_wrong_and_missing_tags(tmp_path: Path, tag: float | None, value: int, expected: int) -> None:
    heights = np.round(RELIEF).astype(np.int16)
    heights[30:34, 40:45] = value
    grid = read_grid(write(tmp_path / "a.tif", heights, nodata=tag), UTM)
    assert (np.nanmin(grid.samples), np.nanmax(grid.samples)) > (400.0, 400.0)
    assert np.abs(grid.samples - RELIEF)[30:34, 40:45].max() < 20.0
    told = [each for each in grid.findings if "no data" in each]
    assert len(told) == 1 + expected  # a tag that hides heights is told


def test_negative_heights_and_the_deepest_places(tmp_path: Path) -> None:
    for base in (-430.0, -3000.0, -10_900.0, 8000.0):
        grid = read_grid(write(tmp_path / "a.tif", (RELIEF - 700.0 + base).astype(np.float32)), UTM)
        assert np.isfinite(grid.samples).all()
        assert grid.findings == ()


@pytest.mark.parametrize("quantum", [1.0, 0.5])
def test_steps_of_integers_and_of_half_metres_are_told_and_kept(tmp_path: Path, quantum: float) -> None:
    gentle = np.round((500.0 + 0.04 * ROW + 0.03 * COLUMN + np.sin(ROW / 9.0)) / quantum) * quantum
    grid = read_grid(write(tmp_path / "a.tif", gentle.astype(np.float32)), UTM)
    assert np.array_equal(grid.samples, gentle.astype(np.float32))
    assert any(f"steps of {quantum:g} m" in each for each in grid.findings)
    assert_exact(grid)


@pytest.mark.parametrize(
    ("frame", "crs", "place"),
    [
        # Over the antimeridian, into the zone on either side; longitudes beyond ±180.
        (
            SketchFrame("EPSG:32660", 700_000.0, 5_000_000.0),
            "EPSG:4326",
            (1e-3, 0.0, 179.96, 0.0, -1e-3, 45.2),
        ),
        (
            SketchFrame("EPSG:32601", 200_000.0, 5_000_000.0),
            "EPSG:4326",
            (1e-3, 0.0, -180.04, 0.0, -1e-3, 45.2),
        ),
        (
            SketchFrame("EPSG:3832", 3_300_000.0, 5_000_000.0),
            "EPSG:4326",
            (1e-3, 0.0, 179.96, 0.0, -1e-3, 45.2),
        ),
        # At the poles.
        (SketchFrame("EPSG:3413", -3000.0, -3000.0), "EPSG:3413", (90.0, 0.0, -2000.0, 0.0, -90.0, 3000.0)),
        (SketchFrame("EPSG:3413", 0.0, -600_000.0), "EPSG:4326", (1e-2, 0.0, 20.0, 0.0, -1e-3, 85.0)),
        (SketchFrame("EPSG:3031", 0.0, 0.0), "EPSG:32761", (90.0, 0.0, 2e6, 0.0, -90.0, 2_003_000.0)),
        # A zone in the next one.
        (
            SketchFrame("EPSG:32633", 160_000.0, 5_100_000.0),
            "EPSG:32632",
            (30.0, 0.0, 720_000.0, 0.0, -30.0, 5.2e6),
        ),
        (UTM, "EPSG:25832", (30.0, 0.0, 500_000.0, 0.0, -30.0, 5_210_000.0)),
        (UTM, "EPSG:3857", (44.0, 0.0, 1e6, 0.0, -44.0, 5_950_000.0)),
    ],
)
def test_antimeridian_poles_and_zone_borders(frame: SketchFrame, crs: str, place: Any) -> None:
    grid = ElevationGrid(RELIEF.astype(np.float32), place, 0.0, crs, frame)
    x, y = places(grid)
    spacing = np.hypot(np.diff(x, axis=1), np.diff(y, axis=1))
    assert spacing.max() < 1.7 * spacing.min()  # no jump
    column, row = grid.to_samples(x, y)
    turn = 360.0 / place[0]  # GDAL wraps longitudes
    assert np.abs((column - COLUMN + 0.5 * turn) % turn - 0.5 * turn).max() < 1e-3
    assert np.abs(row - ROW).max() < 1e-3
    assert_exact(grid)


def test_folded_and_uneven_grids_at_a_pole_are_one_line() -> None:
    for place in ((1.0, 0.0, -180.0, 0.0, -0.01, 90.0), (1e-2, 0.0, 20.0, 0.0, -1e-3, 89.9)):
        grid = ElevationGrid(RELIEF.astype(np.float32), place, 0.0, "EPSG:4326", SketchFrame("EPSG:3413"))
        with pytest.raises(InputError, match="too near to a pole") as raised:
            build_patches(grid)
        assert str(raised.value).isprintable()


def test_a_metre_inset_in_a_coarse_grid(make_grid: MakeGrid) -> None:
    coarse = make_grid(90.0, 60, 60, accuracy=8.0)
    inset = make_grid(1.0, 37, 50, degrees=12.0, accuracy=0.1)
    x, y = (each[8:-8, 8:-8] for each in places(inset))
    found = surface(coarse, inset, at=(x, y))
    assert np.abs(found.height - ground(x, y)).max() < 0.2
    assert_exact(inset)
    axis = np.linspace(-300.0, 300.0, 4001)
    line = surface(coarse, inset, at=(5000.0 + axis, 5000.0 + 0.3 * axis))
    assert np.abs(np.diff(line.height)).max() < 0.5  # no step at its rim
    assert line.weight.min() == 1.0


@pytest.mark.skipif(not DATA.is_dir(), reason="no data")
def test_the_real_metre_inset() -> None:
    inset = read_grid(
        DATA / "kootenai_1m.asc", SketchFrame("EPSG:32611", 556_000.0, 5_394_000.0), crs="EPSG:32611"
    )
    assert inset.samples.shape == (37, 50)
    assert_exact(inset)


def test_the_same_grid_twice_and_one_inside_another(make_grid: MakeGrid) -> None:
    grid = make_grid()
    at = places(grid)
    again = ElevationGrid(grid.samples.copy(), grid.place, name="other.tif")
    once, twice = surface(grid, at=at), surface(grid, again, at=at)
    assert np.array_equal(once.height, twice.height)
    a, b, c, d, e, f = grid.place
    inner = ElevationGrid(grid.samples[20:80, 20:100], (a, b, c + 20 * (a + b), d, e, f + 20 * (d + e)))
    both = surface(grid, inner, at=at)
    assert np.abs(both.height - grid.samples).max() < 1e-3


def test_a_constant_offset_becomes_a_smooth_step(make_grid: MakeGrid) -> None:
    coarse, fine = make_grid(30.0, accuracy=4.0), make_grid(30.0, 40, 40, offset=20.0, accuracy=1.0)
    axis = np.arange(-1500.0, 1500.0, 5.0)
    x, y = 5000.0 + axis, np.full(axis.shape, 5003.0)
    rise = surface(coarse, fine, at=(x, y)).height - ground(x, y)
    assert rise.min() > -0.5
    assert rise.max() < 20.5
    assert np.abs(np.diff(rise)).max() < 1.0


def test_spikes_are_told_and_kept(tmp_path: Path) -> None:
    heights = RELIEF.astype(np.float32)
    heights[20, 30], heights[40, 50] = 8000.0, -400.0
    grid = read_grid(write(tmp_path / "a.tif", heights), UTM)
    assert grid.samples[20, 30] == 8000.0
    assert any(each.startswith("2 spikes") for each in grid.findings)
    assert_exact(grid)
