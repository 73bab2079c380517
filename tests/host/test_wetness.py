"""The loop of wetness against the old recurrences in plain Python."""

import numpy as np
import pytest

from sketchterrain.landforms.wetness import wetness

FINEST = 20.0


def around(values, j, i, reach=1):
    for q in range(max(j - reach, 0), min(j + reach + 1, values.shape[0])):
        for p in range(max(i - reach, 0), min(i + reach + 1, values.shape[1])):
            yield q, p


def expected_wetness(z, area, spacing):
    rows, columns = z.shape
    index = np.full(z.shape, np.nan)
    for j, i in np.ndindex(z.shape):
        falls = [(z[j, i] - z[q, p]) / np.hypot(q - j, p - i) for q, p in around(z, j, i) if (q, p) != (j, i)]
        slope = max([spacing / 32.0, *(fall for fall in falls if fall == fall)]) / spacing
        ratio = max((area[j, i] - spacing**2 + FINEST**2) / (FINEST * spacing), 1.0) / slope
        exponent = np.floor(np.log2(ratio))
        index[j, i] = exponent + ratio / 2.0**exponent - 1.0 if z[j, i] == z[j, i] else np.nan

    def raise_to(j, i, q, p):
        if 0 <= q < rows and 0 <= p < columns:
            way = spacing * np.hypot(q - j, p - i)
            left = index[q, p] - (0.5 * way + 12.0 * max(z[j, i] - z[q, p], 0.0)) / FINEST
            index[j, i] = left if left > index[j, i] else index[j, i]

    for step in (1, -1, 1, -1):
        for j in range(rows)[::step]:
            for i in range(columns):
                for p in (i - 1, i, i + 1):
                    raise_to(j, i, j - step, p)
            for i in range(columns)[::step]:
                raise_to(j, i, j, i - step)
    wet = np.zeros(z.shape)
    for j, i in np.argwhere(z == z):
        near = [(index[q, p], (2 - abs(q - j)) * (2 - abs(p - i))) for q, p in around(z, j, i)]
        values, weights = np.array([each for each in near if each[0] == each[0]]).T
        wet[j, i] = np.clip((np.average(values, weights=weights) - 7.0) / 6.0, 0.0, 1.0)
    return wet


@pytest.mark.parametrize("shape", [(0, 3), (1, 1), (1, 2), (2, 5), (9, 7)])
@pytest.mark.parametrize("spacing", [20.0, 80.0])
def test_wetness_is_that_of_its_recurrences(shape, spacing):
    random = np.random.default_rng(shape[0])
    z = np.round(random.normal(size=shape).cumsum(0), 1)
    z[random.random(shape) < 0.1] = np.nan
    area = FINEST**2 * 2.0 ** random.uniform(0.0, 14.0, shape) + spacing**2
    found = wetness(z, area, spacing, FINEST)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, expected_wetness(z, area, spacing), atol=1e-6)
