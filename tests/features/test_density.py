from __future__ import annotations

import numpy as np

from sketchterrain.features.density import DensityField, cubic


def test_density_agrees_with_the_plain_sum() -> None:
    rng = np.random.default_rng(2)
    points, sizes, values = rng.random((200, 2)) * 100, rng.random(200) + 0.5, rng.random(200)
    at, radius = rng.random((50, 2)) * 100, rng.random(50) * 30 + 1
    weight = cubic(np.linalg.norm(at[:, None] - points, axis=-1) / radius[:, None]) * sizes
    field = DensityField(points, sizes)
    np.testing.assert_allclose(field.total(at, radius), weight.sum(1), atol=1e-12)
    np.testing.assert_allclose(
        field.mean(values, at, radius),
        (weight * values).sum(1) / np.maximum(weight.sum(1), 1e-300),
        atol=1e-12,
    )
    assert cubic(np.array([0.0, 0.5, 1.0, 2.0])).tolist() == [1.0, 0.5, 0.0, 0.0]


def test_empty_fields_and_empty_queries() -> None:
    field = DensityField(np.zeros((0, 2)), np.zeros(0))
    assert field.total(np.ones((3, 2)), np.ones(3)).tolist() == [0.0, 0.0, 0.0]
    assert field.mean(np.zeros(0), np.ones((2, 2)), np.ones(2), default=4.0).tolist() == [4.0, 4.0]
    assert DensityField(np.ones((1, 2)), np.ones(1)).total(np.zeros((0, 2)), np.zeros(0)).shape == (0,)


def test_groups_of_places_have_the_same_bits_as_each_place() -> None:
    rng = np.random.default_rng(4)
    field = DensityField(rng.random((300, 2)) * 100, rng.random(300) + 0.5)
    places, radius = rng.random((40, 1, 2)) * 100 + rng.normal(0, 4, (40, 8, 2)), rng.random(40) * 20 + 1
    each = field.total(places.reshape(-1, 2), np.repeat(radius, 8)).reshape(40, 8)
    np.testing.assert_array_equal(field.around(places, radius), each)
