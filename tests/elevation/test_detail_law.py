"""The law of detail: what it predicts of cut grids, smoothed and interpolated ones, voids, level ground."""

import math

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.array_types import Float64Array
from sketchterrain.elevation.build import build_patches
from sketchterrain.elevation.detail_law import DetailLaw, measure_detail, slope_terms
from sketchterrain.elevation.grids import ElevationGrid, SketchFrame
from sketchterrain.elevation.selection import Patchwork


def relief(side: int, seed: int = 1) -> Float64Array:
    """Return heights (m) in steps of 30 m whose spectrum steepens by the octave as that of real DEMs."""
    k = np.hypot(np.fft.fftfreq(side, 30.0)[:, None], np.fft.rfftfreq(side, 30.0))
    octaves = np.log2(np.maximum(k, 1e-9) * 1000.0)  # above a wave of 1 km
    octaves[0, 0] = -12.0
    power = 2.0 ** -(np.maximum(octaves, -4.0) * (3.9 + 0.25 * np.maximum(octaves, -4.0)))
    phases = np.fft.rfft2(np.random.default_rng(seed).normal(size=(side, side)))
    z = np.fft.irfft2(phases * np.sqrt(power))
    return z * 200.0 / z.std()


def grid_of(z: Float64Array, step: float) -> ElevationGrid:
    return ElevationGrid(z.astype(np.float32), (step, 0.0, 0.0, 0.0, -step, step * len(z)))


def cut(z: Float64Array, n: int) -> Float64Array:
    rows, columns = (side // n for side in z.shape)
    return z[: rows * n, : columns * n].reshape(rows, n, columns, n).mean(axis=(1, 3))


@pytest.mark.parametrize("n", [2, 4, 8])
def test_loss_of_a_cut_grid_is_predicted_from_it_alone(n: int) -> None:
    z = relief(512)
    law = measure_detail(grid_of(cut(z, n), 30.0 * n))
    patches = build_patches(grid_of(cut(z, n), 30.0 * n))
    surface = Patchwork({patches.id: patches})
    at = (np.arange(4.0 * n, 512 - 4 * n) + 0.5) * 30.0
    step = 30.0 * n
    x, y = np.meshgrid(at - 0.5 * step, step * (512 // n) - (at - 0.5 * step))
    smooth = surface.surface(surface.cover(0.0)).evaluate(x, y).height
    lost = (z[4 * n : 512 - 4 * n, 4 * n : 512 - 4 * n] - smooth).std()
    assert law.lost == pytest.approx(lost, rel=0.2)
    assert law.step == step


def test_octaves_grow_with_their_wavelengths_and_sum_to_what_was_lost() -> None:
    law = DetailLaw(30.0, 2.0, 1.3, (1.0, 1.0, 1.0), 0.4)
    waves = 0.5 * 2.0 ** np.arange(20.0)
    octaves = law.octave(waves)
    assert (np.diff(octaves) > 0.0).all()
    assert math.log2(law.lost_at(np.array(60.0)) / law.lost_at(np.array(30.0))) == pytest.approx(1.3)
    # Finer octaves than relief has left are as rough as ground is.
    assert octaves[0] == pytest.approx(0.006 * 0.4 * waves[0])
    assert not DetailLaw(30.0).octave(waves).any()


def test_interpolated_grids_are_measured_at_their_true_step() -> None:
    z = relief(256)
    plain = measure_detail(grid_of(z, 30.0))
    for times in (2, 4):
        fine = measure_detail(
            grid_of(ndimage.zoom(z, times, order=3, grid_mode=True, mode="nearest"), 30.0 / times)
        )
        assert fine.step == plain.step == 30.0
        assert fine.lost == pytest.approx(plain.lost, rel=0.35)


def test_shape_follows_slopes() -> None:
    """Ground that is rough on one half's slopes only, and never on a lake."""
    z, rng = relief(256), np.random.default_rng(2)
    slope = np.hypot(*np.gradient(ndimage.gaussian_filter(z, 6.0), 30.0))
    noise = ndimage.gaussian_filter(rng.normal(size=z.shape), 1.0)
    law = measure_detail(grid_of(ndimage.gaussian_filter(z, 3.0) + 60.0 * slope * noise, 30.0))
    gentle, steep = (slope_terms(np.array(s**2), law.slope) @ law.shape for s in (0.1, 0.5))
    assert steep > 3.0 * gentle
    assert slope_terms(np.array(0.0), law.slope) @ law.shape == 0.0


def test_voids_cliffs_and_degrees_hardly_matter() -> None:
    z = relief(256)
    plain = measure_detail(grid_of(z, 30.0))
    holes = z.copy()
    holes[60:90, 100:160] = np.nan
    holes[200:, :40] = np.nan
    assert measure_detail(grid_of(holes, 30.0)).lost == pytest.approx(plain.lost, rel=0.1)
    seam = z.copy()
    seam[:, 128:] += 500.0
    assert measure_detail(grid_of(seam, 30.0)).lost == pytest.approx(plain.lost, rel=0.5)
    frame = SketchFrame("EPSG:32632", 500_000.0, 5_200_000.0)
    place = (30.0 / 75_000, 0.0, 9.0, 0.0, -30.0 / 111_200, 47.5)
    degrees = measure_detail(ElevationGrid(z.astype(np.float32), place, crs="EPSG:4326", frame=frame))
    assert degrees.step == pytest.approx(30.0, rel=0.02)
    assert degrees.lost == pytest.approx(plain.lost, rel=0.02)


def test_nothing_is_added_to_level_and_to_tiny_grids() -> None:
    for z in (np.zeros((40, 50)), np.full((300, 300), 7.0), relief(64)[:9, :9], np.full((40, 40), np.nan)):
        assert measure_detail(grid_of(z, 30.0)).lost == 0.0


def test_large_grids_are_measured_by_parts() -> None:
    tiled = np.tile(relief(256), (4, 4))  # periodic
    assert measure_detail(grid_of(tiled, 30.0)).lost == pytest.approx(
        measure_detail(grid_of(tiled[:512, :512], 30.0)).lost, rel=0.1
    )
