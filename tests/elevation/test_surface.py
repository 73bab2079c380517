"""The surface against its samples, its bound, and its smoothness; its oracle is in `tests/host`."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from sketchterrain.array_types import Float32Array, Float64Array
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame
from sketchterrain.elevation.mips import halved, level_shapes, padded
from sketchterrain.elevation.selection import Patchwork
from sketchterrain.elevation.surface import PatchSurface

MakeGrid = Callable[..., ElevationGrid]


def patchwork(*grids: ElevationGrid) -> Patchwork:
    parts = [build_patches(each) for each in grids]
    return Patchwork({each.id: each for each in parts})


def sample_points(grid: ElevationGrid) -> tuple[Float64Array, Float64Array]:
    row, column = np.indices(grid.samples.shape).astype(np.float64)
    return grid.to_metres(column, row)


def with_void(grid: ElevationGrid, *parts: tuple[slice, slice]) -> ElevationGrid:
    samples = grid.samples.copy()
    for part in parts:
        samples[part] = np.nan
    return replace(grid, samples=samples)


@pytest.mark.parametrize("degrees", [0.0, 31.0])
@pytest.mark.parametrize("size", [(4, 4), (9, 40), (29, 29), (30, 57), (100, 120)])
def test_single_grid_is_interpolated(make_grid: MakeGrid, size: tuple[int, int], degrees: float) -> None:
    grid = make_grid(rows=size[0], columns=size[1], degrees=degrees, offset=4000.0)
    work = patchwork(grid)
    found = work.surface(work.cover(0.0)).evaluate(*sample_points(grid))
    assert np.abs(found.height - grid.samples).max() <= 1e-3
    assert found.weight.min() > 0.0
    assert found.weight.max() <= 1.0


def test_grid_in_degrees_keeps_its_samples(make_grid: MakeGrid) -> None:
    base = make_grid(rows=150, columns=150)
    place = (3e-4, 0.0, 9.0, 0.0, -3e-4, 47.0)
    frame = SketchFrame("EPSG:32632", 500_000.0, 5_200_000.0)
    grid = replace(base, place=place, crs="EPSG:4326", frame=frame)
    assert not grid.is_affine
    work = patchwork(grid)
    assert (
        np.abs(work.surface(work.cover(0.0)).evaluate(*sample_points(grid)).height - grid.samples).max()
        < 1e-3
    )
    for error in (5.0, 20.0):
        found = work.surface(work.cover(error)).evaluate(*sample_points(grid))
        assert np.abs(found.height - grid.samples).max() <= error + 0.05  # maps of patches are quadratic
    x, y = sample_points(grid)
    patches, _ = work.rows(np.arange(len(work)))
    row, column = np.mgrid[0:28, 28:56]
    first = int(np.flatnonzero((patches.level == 0) & (patches.row == 0) & (patches.column == 1))[0])
    offset = x[row, column] - patches.centre[first, 0], y[row, column] - patches.centre[first, 1]
    steps = steps_of(patches.to_steps[first], *offset)
    assert np.abs(steps[0] - (column - 42)).max() < 0.03
    assert np.abs(steps[1] - (row - 14)).max() < 0.03


def test_uniform_covers_are_within_their_error(make_grid: MakeGrid) -> None:
    fine = make_grid(degrees=20.0, accuracy=0.5)
    fine = with_void(fine, np.s_[40:60, 50:75])
    coarse = make_grid(90.0, 90, 100, accuracy=2.0, offset=1.0)
    work = patchwork(fine, coarse)
    numbers = []
    for error in (2.5, 5.0, 10.0, 20.0, 40.0, 80.0):
        which = work.cover(error)
        numbers.append(len(which))
        found = work.surface(which).evaluate(*sample_points(coarse))
        assert (found.weight > 0.0).all()
        # Both grids are within `error` of the truth, which differs by accuracies from either's samples.
        assert np.abs(found.height - coarse.samples).max() <= error + 2.5
    assert numbers[-1] <= numbers[0] // 3
    alone = patchwork(fine)
    for error in (0.5, 3.0, 12.0):
        found = alone.surface(alone.cover(error)).evaluate(*sample_points(fine))
        spoken = found.weight > 0.0
        assert np.abs(found.height - fine.samples)[spoken & np.isfinite(fine.samples)].max() <= error


def steps_of(maps: Float64Array, x: Float64Array, y: Float64Array) -> Float64Array:
    return np.tensordot(maps, np.stack([np.ones_like(x), x, y, x * x, x * y, y * y]), axes=(1, 0))


@pytest.mark.parametrize("degrees", [0.0, 17.0, 45.0])
def test_second_derivative_is_continuous_across_seams(make_grid: MakeGrid, degrees: float) -> None:
    work = patchwork(
        make_grid(degrees=degrees, accuracy=0.1, offset=5.0), make_grid(120.0, 60, 60, accuracy=3.0)
    )
    surface = work.surface(work.cover(0.0))
    ends = np.array([5000.0, 5000.0]), np.array([7800.0, 5900.0])

    def jump(step: float) -> float:
        t = np.arange(0.0, float(np.hypot(*(ends[1] - ends[0]))), step)
        along = (ends[1] - ends[0]) / np.hypot(*(ends[1] - ends[0]))
        found = surface.evaluate(ends[0][0] + along[0] * t, ends[0][1] + along[1] * t)
        slope = along[0] * found.east + along[1] * found.north
        return float(np.abs(np.diff(np.diff(slope) / step)).max())

    jumps = [jump(each) for each in (1.0, 0.5, 0.25, 0.125)]
    assert all(other < 0.7 * one for one, other in itertools.pairwise(jumps)), jumps
    assert jumps[-1] < 0.2 * jumps[0], jumps


def test_weight_of_data_is_zero_beyond_rims_and_in_voids(make_grid: MakeGrid) -> None:
    grid = with_void(make_grid(rows=120, columns=120), np.s_[50:70, 50:70])
    work = patchwork(grid)
    surface: PatchSurface = work.surface(work.cover(0.0))

    def weight(column: float, row: float) -> float:
        x, y = grid.to_metres(np.array([column]), np.array([row]))
        return float(surface.evaluate(x, y).weight[0])

    assert (
        weight(-0.5, -0.5)
        == weight(0.0, 0.0)
        == weight(0.0, 20.0)
        == weight(20.0, 20.0)
        == weight(119.0, 119.0)
        == 1.0
    )
    assert 1.0 > weight(-0.7, 20.0) > weight(-1.2, 20.0) > 0.0
    assert weight(-1.5, 20.0) == weight(60.0, 60.0) == weight(300.0, 300.0) == 0.0
    assert 1.0 == weight(48.0, 60.0) > weight(49.7, 60.0) > 0.0


def test_tiles_side_by_side_leave_no_gap(make_grid: MakeGrid) -> None:
    """Tiles of areas, whose outermost samples are one step apart, and of points, which share a row."""
    whole = make_grid(rows=100, columns=120)
    a, _, c, _, e, f = whole.place
    for shared in (0, 1):
        parts = []
        for row, column in ((0, 0), (0, 60 - shared), (50 - shared, 0), (50 - shared, 60 - shared)):
            samples = whole.samples[row : row + 50, column : column + 60]
            parts.append(replace(whole, samples=samples, place=(a, 0.0, c + a * column, 0.0, e, f + e * row)))
        work = patchwork(*parts)
        surface = work.surface(work.cover(0.0))
        row, column = np.mgrid[45:55:0.25, 55:65:0.25]
        found = surface.evaluate(*whole.to_metres(column, row))
        alone = patchwork(whole)
        expected = alone.surface(alone.cover(0.0)).evaluate(*whole.to_metres(column, row))
        assert found.weight.min() == 1.0
        fade = work.rim_fade(300.0)
        assert fade.weight(*whole.to_metres(column, row)).min() > 1.0 - 1e-9
        sides = np.array([0.0, 60.0, 119.0, 60.0, 2.0]), np.array([50.0, 0.0, 50.0, 99.0, 50.0])
        x, y = whole.to_metres(*sides)
        assert np.abs(fade.weight(x, y)[:4]).max() < 0.01
        assert 0.0 < fade.weight(x, y)[4] < 0.5
        assert (
            np.abs(found.height - expected.height).max() < 2.0
        )  # steep waves of 300 m, extrapolated by a step


def test_coarse_grid_shows_through_a_large_void(make_grid: MakeGrid) -> None:
    fine = with_void(make_grid(accuracy=0.1, rows=120, columns=120, offset=50.0), np.s_[40:80, 40:80])
    coarse = make_grid(120.0, 60, 60, accuracy=3.0)
    work = patchwork(fine, coarse)
    surface = work.surface(work.cover(0.0))
    x, y = sample_points(coarse)
    found = surface.evaluate(x, y)
    middle = (np.abs(x - 5000.0) < 400.0) & (np.abs(y - 5000.0) < 400.0)
    assert np.abs(found.height - coarse.samples)[middle].max() < 1e-3
    assert (found.weight[10:-10, 10:-10] == 1.0).all()


def next_level(samples: Float32Array) -> Float32Array:
    return halved(padded(padded(samples, 0), 1)[2:], samples.shape[1])[: samples.shape[0] // 2 + 1]


def test_vertices_of_mips_stay_put() -> None:
    row, column = np.indices((41, 30)).astype(np.float32)
    plane = 3.0 * column - 2.0 * row
    level = next_level(plane)
    assert level.shape == (21, 16)
    expected = 6.0 * np.arange(16)[None, :] - 4.0 * np.arange(21)[:, None]
    assert np.allclose(level, expected, atol=1e-4)
    noise = np.random.default_rng(1).normal(size=(65, 65)).astype(np.float32)
    window = noise[9:12, 19:22] * np.outer([1, 2, 1], [1, 2, 1]) / 16.0
    assert next_level(noise)[5, 10] == pytest.approx(window.sum(), abs=1e-5)
    assert level_shapes(noise.shape) == [(65, 65), (33, 33), (17, 17)]
