from __future__ import annotations

import numpy as np
import pytest
from scipy import ndimage

from sketchterrain.features import PaintedDistance


@pytest.mark.parametrize("share", [0.0, 0.002, 0.1, 0.9, 1.0])
def test_few_places_and_many_get_the_bits_of_a_distance_map(share: float) -> None:
    rng = np.random.default_rng(3)
    mask = rng.random((40, 70)) < share
    x, y = rng.uniform(-100, 600, 5000), rng.uniform(-100, 400, 5000)
    distance = PaintedDistance(mask, 7.3)
    few = np.concatenate([PaintedDistance(mask, 7.3)(x[i : i + 9], y[i : i + 9]) for i in range(0, 5000, 9)])
    assert few.tobytes() == distance(x, y).tobytes() == distance(x, y).tobytes()
    if not mask.any():
        assert np.isinf(few).all()
        return
    inside = (x >= 0) & (x < 70 * 7.3) & (y > 0) & (y <= 40 * 7.3)
    exact = ndimage.distance_transform_edt(~mask)
    column, row = (x[inside] / 7.3).astype(int), (40 - y[inside] / 7.3).astype(int)
    np.testing.assert_allclose(few[inside], 7.3 * exact[row, column], rtol=1e-6)
