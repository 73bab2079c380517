import itertools

import numpy as np

from sketchterrain.features.shapes import label_shapes
from sketchterrain.features.user_features import mean_size, user_features

ROW, COLUMN = np.mgrid[:160, :240]


def blob() -> np.ndarray:
    angle = np.arctan2(ROW - 80, COLUMN - 110)
    return (np.hypot(ROW - 80, COLUMN - 110) < 45 + 8 * np.sin(3 * angle)).astype(np.uint8)


def stroke() -> np.ndarray:
    middle = 80 + 30 * np.sin(COLUMN / 40)
    return ((np.abs(ROW - middle) < 9) & (COLUMN > 10) & (COLUMN < 230)).astype(np.uint8)


def ring() -> np.ndarray:
    distance = np.hypot(ROW - 80, COLUMN - 110)
    return ((distance > 45) & (distance < 60)).astype(np.uint8)


def broken_up(picture: np.ndarray, layer: str = "hill", **settings) -> np.ndarray:
    settings = {"multitude": 1, "fidelity": 1.0, "seed": 7} | settings
    (shape,) = label_shapes(layer, picture)
    return user_features(shape, **settings)


def covered(features: np.ndarray, picture: np.ndarray) -> float:
    union = np.zeros(picture.shape, bool)
    for feature in features:
        distance = np.hypot(ROW - feature["row"], COLUMN - feature["column"])
        union |= distance < feature["disc"] + 0.5
    return float(union[picture > 0].mean())


def test_discs_cover_the_shape_as_the_fidelity_asks_and_stay_inside() -> None:
    for picture in (blob(), stroke(), ring()):
        for multitude in (1, 6):
            features = broken_up(picture, multitude=multitude)
            assert covered(features, picture) > 0.99
            assert len(features) < 130

    loose, near, exact = (broken_up(stroke(), fidelity=fidelity) for fidelity in (0.0, 0.8, 1.0))
    assert len(loose) < len(near) < len(exact)
    assert 0.6 <= covered(loose, stroke()) < covered(exact, stroke())
    assert covered(near, stroke()) > 0.85

    (shape,) = label_shapes("hill", blob())
    features = user_features(shape, multitude=4, fidelity=1.0, seed=1)
    depth = np.zeros(blob().shape)
    depth[shape.rows, shape.columns] = shape.depth
    assert np.all(features["disc"] <= np.maximum(depth[features["row"], features["column"]], 1.0))


def test_multitude_counts_the_summits_and_a_range_with_one_is_a_ridge() -> None:
    for multitude in (1, 2, 5, 12):
        assert broken_up(blob(), multitude=multitude)["summit"].sum() == multitude
    features = broken_up(blob(), multitude=8)
    summits = features[features["summit"]]
    row, column = summits["row"].astype(float), summits["column"].astype(float)
    distance = np.hypot(row[:, None] - row, column[:, None] - column) + 1e9 * np.eye(len(summits))
    assert distance.min() >= 0.9 * mean_size(int(blob().sum()), 8)

    features = broken_up(stroke(), "mountain", multitude=1)
    support = features[~features["summit"]]
    assert features["summit"].sum() == 1
    assert features["share"][features["summit"]] == 1.0
    assert support["share"].max() <= 0.85
    assert support["column"].min() < 30
    assert support["column"].max() > 210


def test_every_shape_yields_a_feature() -> None:
    pictures = (np.ones((1, 1)), np.ones((1, 200)), np.eye(50), np.ones((64, 64)), np.ones((2, 2)))
    for picture, fidelity in itertools.product(pictures, (0.0, 0.5, 1.0)):
        features = broken_up(picture.astype(np.uint8), multitude=20, fidelity=fidelity)
        assert features["summit"].sum() >= 1, (picture.shape, fidelity)
        assert len(np.unique(features["id"])) == len(features)
        assert np.all(features["id"] < 2**63)
        assert np.all(features["disc"] >= 1.0)
        assert np.all((features["share"] > 0) & (features["share"] <= 1.25))


def test_the_seed_alone_changes_the_features_and_a_dab_keeps_most_summits() -> None:
    first = broken_up(blob(), multitude=5)
    np.testing.assert_array_equal(first, broken_up(blob(), multitude=5))
    assert not np.array_equal(first["id"][:5], broken_up(blob(), multitude=5, seed=8)["id"][:5])

    picture = blob()
    dabbed = picture | (np.hypot(ROW - 80, COLUMN - 158) < 4).astype(np.uint8)
    before, after = (broken_up(each, multitude=8) for each in (picture, dabbed))
    kept = np.isin(before["id"][before["summit"]], after["id"][after["summit"]])
    assert kept.mean() >= 0.5
