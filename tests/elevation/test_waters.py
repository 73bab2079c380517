"""Flattened lakes and stepped rivers are found, with outlines; the sea, terraces and slopes are not."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.features.table import AREA, Feature, FeatureTable
from sketchterrain.importing.elevation import FlatWater, flat_waters, water_findings

DATA = Path(os.environ.get("SKETCHTERRAIN_DEMS", "no folder of real DEMs"))
STEP = 30.0
ROW, COLUMN = np.indices((200, 240)).astype(np.float64)


def grid(heights: Float64Array) -> ElevationGrid:
    place = (STEP, 0.0, 0.0, 0.0, -STEP, STEP * (len(heights) - 1))
    return ElevationGrid(heights.astype(np.float32), place)


def slope() -> Float64Array:
    return 400.0 + 0.37 * ROW + 1.13 * COLUMN + 5.0 * np.sin(ROW / 9.0) * np.cos(COLUMN / 11.0)


def polygon(water: FlatWater) -> shapely.Polygon:
    return shapely.Polygon(water.rings[0], water.rings[1:])


def test_a_lake_with_an_island_has_its_outline() -> None:
    heights = slope()
    distance = np.hypot(ROW - 100.0, COLUMN - 120.0)
    lake, island = distance < 40.0, distance < 10.0
    heights[lake] = heights.min() - 1.0
    heights[island] += 30.0
    (found,) = flat_waters(grid(heights))
    assert found.level == np.float32(slope().min() - 1.0)
    assert not found.is_river
    assert len(found.rings) == 2
    shape = polygon(found)
    assert shape.is_valid
    assert shape.area == pytest.approx(found.area)
    assert shape.area == pytest.approx(np.pi * (40.0**2 - 10.0**2) * STEP**2, rel=0.03)
    x, y = STEP * COLUMN, STEP * (199.0 - ROW)
    assert np.array_equal(shapely.contains_xy(shape, x, y), lake & ~island)
    assert water_findings([found]) == ("1 flattened lake of 4.24 km² in all",)
    layer = FeatureTable("lake").edited(add=[Feature(AREA, found.rings)])
    assert len(layer) == 1


def test_a_stepped_river_is_told_with_its_steps() -> None:
    heights = 800.0 + np.abs(COLUMN - 120.0 - 20.0 * np.sin(ROW / 30.0)) * 2.0 - 0.02 * ROW
    river = np.abs(COLUMN - 120.0 - 20.0 * np.sin(ROW / 30.0)) < 2.6
    heights[river] = 780.0 - 2.0 * (ROW[river] // 100)
    found = flat_waters(grid(heights))
    assert [(each.level, each.is_river, each.step) for each in found] == [
        (780.0, True, 2.0),
        (778.0, True, 2.0),
    ]
    assert all(polygon(each).is_valid for each in found)
    assert water_findings(found) == ("2 level reaches of rivers, in steps of 2 to 2 m",)


def test_what_is_no_water_is_not_found() -> None:
    assert flat_waters(grid(slope())) == []
    assert flat_waters(grid(np.round(slope() / 10.0) * 10.0)) == []  # terraces: lower ground on one side
    assert flat_waters(grid(np.full((50, 50), 7.0))) == []
    assert flat_waters(grid(np.maximum(slope() - 500.0, 0.0))) == []  # the sea
    pond = slope()
    pond[50:56, 50:56] = 300.0
    assert flat_waters(grid(pond)) == []  # 36 samples
    assert len(flat_waters(grid(pond), least=36)) == 1
    plateau = slope()
    plateau[80:120, 80:120] = 2000.0
    assert flat_waters(grid(plateau)) == []
    voids = slope()
    voids[80:120, 80:120] = np.nan
    assert flat_waters(grid(voids)) == []


def test_lakes_beside_voids_and_at_the_rim() -> None:
    heights = slope()
    heights[:30, 100:140] = 390.0
    heights[20:40, 110:130] = np.nan
    (found,) = flat_waters(grid(heights))
    assert polygon(found).is_valid
    moved = replace(grid(heights), place=(0.0, 20.0, 5.0, -20.0, 0.0, 9.0))  # rotated by 90°
    assert flat_waters(moved)[0].area == pytest.approx(found.area * (20.0 / STEP) ** 2)


@pytest.mark.skipif(not DATA.is_dir(), reason="no data")
def test_real_lakes() -> None:
    andorra = read_grid(DATA / "N42E001.hgt.zip", SketchFrame("EPSG:32631", 380_000.0, 4_700_000.0))
    (lake,) = flat_waters(andorra)  # the reservoir of Bouillouses
    assert lake.level == 2002.0
    assert lake.area == pytest.approx(0.63e6, rel=0.02)
    assert polygon(lake).is_valid
    bigtujunga = read_grid(
        DATA / "bigtujunga30m_utm11.tif", SketchFrame("EPSG:32611", 376_000.0, 3_788_000.0)
    )
    assert flat_waters(bigtujunga) == []


@pytest.mark.slow
@pytest.mark.skipif(not DATA.is_dir(), reason="no data")
def test_lakes_of_a_large_grid_beside_voids_are_valid_areas() -> None:
    frame = SketchFrame("EPSG:32621", 373_185.0, 8_000_000.0)
    found = flat_waters(read_grid(DATA / "cog_int16_voids.tif", frame))
    assert len(found) == 46
    assert all(polygon(each).is_valid for each in found)
    layer = FeatureTable("lake").edited(add=[Feature(AREA, each.rings) for each in found])
    assert len(layer) == 46
