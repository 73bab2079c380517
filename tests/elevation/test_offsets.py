"""Offsets between overlapping grids are measured, told, and removed on request; half a cell is told."""

import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame, read_grid
from sketchterrain.elevation.offsets import GridOffset, corrections, measure_offsets
from sketchterrain.elevation.patches import GridPatches
from tests.elevation.conftest import MakeGrid

DATA = Path(os.environ.get("SKETCHTERRAIN_DEMS", "no folder of real DEMs"))


def patches(grids: Sequence[ElevationGrid]) -> list[GridPatches]:
    return [build_patches(each) for each in grids]


def measure(grids: Sequence[ElevationGrid]) -> list[GridOffset]:
    return measure_offsets(patches(grids))


def told(found: GridOffset, grids: Sequence[ElevationGrid]) -> tuple[str, ...]:
    return found.finding(patches(grids), [each.name for each in grids])


def removed(grids: Sequence[ElevationGrid], offsets: list[GridOffset]) -> list[float]:
    return corrections(patches(grids), offsets)


def test_an_offset_is_measured_and_removed(make_grid: MakeGrid) -> None:
    coarse = replace(make_grid(90.0, 60, 60), name="b.tif")
    for step, offset, degrees in ((10.0, 19.8, 17.0), (30.0, -3.0, 45.0), (90.0, 20.0, 0.0)):
        fine = replace(make_grid(step, 90, 90, degrees=degrees, offset=offset), name="a.tif")
        for grids in ([fine, coarse], [coarse, fine]):
            (found,) = measure(grids)
            sign = 1.0 if grids[0] is fine else -1.0
            assert found.height == pytest.approx(sign * offset, abs=0.5)
            assert found.shift == (0.0, 0.0)
            (text,) = told(found, grids)
            first, second = (each.name for each in grids)
            side = "above" if sign * offset > 0.0 else "below"
            assert text.startswith(f"{first} lies {abs(found.height):.1f} m {side} {second} (median of ")
            moved = removed(grids, [found])  # the finer one stays: both are as accurate
            assert moved[grids.index(fine)] == (0.0 if step < 90.0 else moved[grids.index(fine)])
            again = [replace(g, samples=g.samples + np.float32(d)) for g, d in zip(grids, moved, strict=True)]
            assert abs(measure(again)[0].height) < 0.01


def test_the_most_accurate_grid_stays_and_chains_follow(make_grid: MakeGrid) -> None:
    grids = [
        make_grid(30.0, 60, 60, middle=(5000.0 + 1000.0 * k, 5000.0), offset=10.0 * k, accuracy=each)
        for k, each in enumerate((3.0, 1.0, 2.0))
    ]
    far = make_grid(30.0, middle=(90_000.0, 0.0), offset=77.0)
    moved = removed([*grids, far], measure([*grids, far]))
    assert moved == pytest.approx([10.0, 0.0, -10.0, 0.0], abs=0.2)
    assert removed([far], measure([far])) == [0.0]
    assert removed([], []) == []


def test_equal_grids_and_noise_are_not_told(make_grid: MakeGrid) -> None:
    grid = make_grid(accuracy=0.5)
    noisy = grid.samples + np.random.default_rng(1).normal(0.1, 2.0, grid.samples.shape).astype(np.float32)
    for other in (grid, replace(grid, samples=noisy), make_grid(10.0, 50, 37, degrees=30.0)):
        (found,) = measure([grid, other])
        assert told(found, [grid, other]) == ()


@pytest.mark.parametrize(("step", "angle"), [(30.0, 20.0), (90.0, 0.0)])
def test_half_a_cell_is_told(make_grid: MakeGrid, step: float, angle: float) -> None:
    fine, coarse = make_grid(30.0, degrees=angle), make_grid(step, 40, 40)
    a, b, c, d, e, f = coarse.place
    for right, down in ((0.5, 0.5), (0.0, -0.5)):
        east, north = a * right + b * down, d * right + e * down
        wrong = replace(coarse, place=(a, b, c + east, d, e, f + north))
        for grids, sign in (([wrong, fine], 1.0), ([fine, wrong], -1.0)):
            (found,) = measure(grids)
            assert found.shift == pytest.approx((sign * east, sign * north), abs=1.0)
            assert any("half a cell off" in each for each in told(found, grids))


def test_surface_beside_terrain_model_and_overlaps_beside_voids(make_grid: MakeGrid) -> None:
    terrain, surface = make_grid(30.0), make_grid(30.0, offset=0.0)
    trees = np.where(np.random.default_rng(2).random(surface.samples.shape) < 0.7, 18.0, 0.0)
    surface = replace(surface, samples=(surface.samples + trees).astype(np.float32), name="surface")
    (found,) = measure([surface, terrain])
    assert found.height == pytest.approx(18.0, abs=0.1)
    holes = terrain.samples.copy()
    holes[20:60, 20:90] = np.nan
    (found,) = measure([surface, replace(terrain, samples=holes)])
    assert found.height == pytest.approx(18.0, abs=0.1)
    assert 9000 < found.samples <= terrain.samples.size - 40 * 70
    assert measure([terrain, make_grid(middle=(50_000.0, 0.0))]) == []


@pytest.mark.skipif(not DATA.is_dir(), reason="no data")
def test_real_overlaps() -> None:
    frame = SketchFrame("EPSG:32613", 400_000.0, 4_400_000.0)
    front = [read_grid(DATA / f"srtmgl3_front_range_{n}.asc", frame, crs="EPSG:4326") for n in "ab"]
    (found,) = measure(front)
    assert (found.height, found.spread) == pytest.approx((0.0, 0.0), abs=1e-4)
    assert told(found, front) == ()
    ground = read_grid(DATA / "bigtujunga30m_utm11.tif", SketchFrame("EPSG:32611", 376_000.0, 3_788_000.0))
    rows, columns = (slice(200, 420) for _ in range(2))
    inset = ElevationGrid(
        ground.samples[rows, columns] + 20.0, moved(ground, 200, 200), 0.5, ground.crs, ground.frame
    )
    (found,) = measure([inset, ground])
    assert found.height == 20.0
    half = replace(inset, place=moved(ground, 200.5, 200.5))
    (found,) = measure([half, ground])
    assert math.isclose(found.shift[0], 15.0, abs_tol=0.1)
    assert math.isclose(found.shift[1], -15.0, abs_tol=0.1)


def moved(grid: ElevationGrid, row: float, column: float) -> tuple[float, float, float, float, float, float]:
    a, b, c, d, e, f = grid.place
    return a, b, c + a * column + b * row, d, e, f + d * column + e * row
