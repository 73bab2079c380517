"""Distance from a crest and how it sags: their slopes, against differences."""

from __future__ import annotations

import numpy as np

from sketchterrain.terrain.reference_noise import Slope
from sketchterrain.terrain.reference_relief import approached

HALF = np.array([0.5, 0.3])  # in radii of the flanks
CREST = (*HALF, 1 / (HALF @ HALF), 0.3)
STEP = 1e-4
LEVEL = (Slope(0.0, 0.0, 0.0), Slope(0.0, 0.0, 0.0))


def seen(x: np.ndarray, y: np.ndarray) -> tuple[Slope, Slope]:
    return approached(np.stack([x, y]), 1 / 800, LEVEL, crest=CREST)


def test_slopes_are_those_of_differences() -> None:
    x, y = np.random.default_rng(1).uniform(-1600, 1600, (2, 4000))
    for number in (0, 1):
        here = seen(x, y)[number]
        for shift, slope in (((STEP, 0), here.east), ((0, STEP), here.north)):
            after = seen(x + shift[0], y + shift[1])[number].value
            before = seen(x - shift[0], y - shift[1])[number].value
            np.testing.assert_allclose((after - before) / (2 * STEP), slope, atol=1e-7)


def test_the_height_has_no_kink_where_the_crest_ends_and_is_round_without_one() -> None:
    end = 800 * HALF
    for beside in (-1e-6, 1e-6):
        x, y = (np.array([part * (1 + beside)]) for part in end)
        keep = seen(x, y)[1]
        np.testing.assert_allclose(keep.value, 1 - CREST[3], atol=1e-9)
        np.testing.assert_allclose([keep.east, keep.north], 0, atol=1e-7)
    x, y = np.random.default_rng(2).uniform(-1600, 1600, (2, 1000))
    away, keep = approached(np.stack([x, y]), 1 / 800, LEVEL)
    np.testing.assert_allclose(away.value, np.hypot(x, y) / 800, rtol=1e-14)
    assert (keep.value == 1).all()
    assert not np.any([keep.east, keep.north])
