from __future__ import annotations

import numpy as np
from scipy import ndimage

from sketchterrain.features import PaintedDistance


def test_few_places_and_many_get_the_bits_of_a_distance_map() -> None:
    for share in (0.0, 0.002, 0.1, 0.9, 1.0):
        rng = np.random.default_rng(3)
        mask = rng.random((40, 70)) < share
        x, y = rng.uniform(-100, 600, 5000), rng.uniform(-100, 400, 5000)
        distance = PaintedDistance(mask, 7.3)
        few = [PaintedDistance(mask, 7.3)(x[i : i + 9], y[i : i + 9]) for i in range(0, 5000, 9)]
        few = np.concatenate(few)
        assert few.tobytes() == distance(x, y).tobytes() == distance(x, y).tobytes()
        if not mask.any():
            assert np.isinf(few).all()
            continue
        inside = (x >= 0) & (x < 70 * 7.3) & (y > 0) & (y <= 40 * 7.3)
        exact = ndimage.distance_transform_edt(~mask)
        column, row = (x[inside] / 7.3).astype(int), (40 - y[inside] / 7.3).astype(int)
        np.testing.assert_allclose(few[inside], 7.3 * exact[row, column], rtol=1e-6)


def test_distances_outside_the_map_are_bounded_by_the_true_ones() -> None:
    painted = np.zeros((10, 20), bool)
    painted[2, 3] = True
    distance = PaintedDistance(painted, 10.0)
    x, y = np.array([35.0, 75.0, 35.0, -100.0, 35.0]), np.array([75.0, 75.0, 15.0, 75.0, 200.0])
    np.testing.assert_allclose(distance(x, y)[:3], [0.0, 40.0, 60.0])
    true = np.hypot(x - 35, y - 75)
    assert np.all(distance(x, y) <= true + 5.0)
    assert np.all(distance(x, y)[3:] > 100)
    assert np.isinf(PaintedDistance(~np.ones((4, 4), bool), 1.0)(x, y)).all()
