"""Rounding keeps multiples, breaks no tie by a last bit, and reaches rivers; the blur is SciPy's."""

from __future__ import annotations

import numpy as np
from scipy import ndimage

from sketchterrain.features.rounding import STEP, gaussian_filter, rounded
from sketchterrain.sketch import load_sketch
from sketchterrain.terrain import make_recipe


def test_rounding_keeps_multiples_and_takes_halves_one_way() -> None:
    number = np.arange(-5000, 5000)
    multiples, halves = number * STEP, (number + 0.5) * STEP
    np.testing.assert_array_equal(rounded(multiples), multiples)
    for nearly in (np.nextafter(halves, -np.inf), halves, np.nextafter(halves, np.inf)):
        np.testing.assert_array_equal(rounded(nearly), multiples)
    values = np.random.default_rng(1).uniform(-1e4, 1e4, 1000)
    assert np.abs(rounded(values) - values).max() < 0.54 * STEP


def test_the_blur_is_scipys() -> None:
    values = np.random.default_rng(2).normal(size=(40, 60))
    for sigma in (0.001, 0.7, 3.0, 50.0):
        expected = ndimage.gaussian_filter(values, sigma, mode="nearest")
        np.testing.assert_allclose(gaussian_filter(values, sigma, axes=(0, 1)), expected, atol=1e-10)
        expected = ndimage.gaussian_filter1d(values, sigma, axis=0, mode="reflect", truncate=3.0)
        blurred = gaussian_filter(values, sigma, axes=(0,), mode="reflect", truncate=3.0)
        np.testing.assert_allclose(blurred, expected, atol=1e-10)


def test_control_points_are_multiples_of_the_step() -> None:
    recipe = make_recipe(load_sketch("valley_river"))
    assert recipe.rivers
    ends = {river.centreline[-1, :2].tobytes() for river in recipe.rivers}
    for river in recipe.rivers:
        own = np.array([point for point in river.points[:, :2] if point.tobytes() not in ends])
        np.testing.assert_array_equal(rounded(own), own)
