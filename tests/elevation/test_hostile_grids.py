"""Grids as they come: voids, tags, datums, places and overlaps of every kind, up to the surface."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.elevation.surface import Heights
from sketchterrain.errors import InputError
from tests.elevation.conftest import FRAME as UTM
from tests.elevation.conftest import MakeGrid, ground, write

ROW, COLUMN = np.indices((60, 80)).astype(np.float64)
RELIEF = 600.0 + 40.0 * np.sin(ROW / 7.0) + 30.0 * np.cos(COLUMN / 9.0) + 2.0 * COLUMN


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


@pytest.mark.parametrize(
    ("frame", "crs", "place"),
    [
        # Over the antimeridian, into the zone on either side; longitudes beyond ±180.
        (("EPSG:32660", 7e5, 5e6), "EPSG:4326", (1e-3, 0.0, 179.96, 0.0, -1e-3, 45.2)),
        (("EPSG:32601", 2e5, 5e6), "EPSG:4326", (1e-3, 0.0, -180.04, 0.0, -1e-3, 45.2)),
        (("EPSG:3832", 3.3e6, 5e6), "EPSG:4326", (1e-3, 0.0, 179.96, 0.0, -1e-3, 45.2)),
        # At the poles.
        (("EPSG:3413", -3e3, -3e3), "EPSG:3413", (90.0, 0.0, -2000.0, 0.0, -90.0, 3000.0)),
        (("EPSG:3413", 0.0, -6e5), "EPSG:4326", (1e-2, 0.0, 20.0, 0.0, -1e-3, 85.0)),
        (("EPSG:3031", 0.0, 0.0), "EPSG:32761", (90.0, 0.0, 2e6, 0.0, -90.0, 2_003_000.0)),
        # A zone in the next one.
        (("EPSG:32633", 1.6e5, 5.1e6), "EPSG:32632", (30.0, 0.0, 720_000.0, 0.0, -30.0, 5.2e6)),
        (tuple(UTM), "EPSG:25832", (30.0, 0.0, 500_000.0, 0.0, -30.0, 5_210_000.0)),
        (tuple(UTM), "EPSG:3857", (44.0, 0.0, 1e6, 0.0, -44.0, 5_950_000.0)),
    ],
)
def test_antimeridian_poles_and_zone_borders(frame: Any, crs: str, place: Any) -> None:
    grid = ElevationGrid(RELIEF.astype(np.float32), place, 0.0, crs, SketchFrame(*frame))
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
