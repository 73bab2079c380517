import math

import numpy as np

from sketchterrain.features import FEATURE, FEATURE_TYPES, place
from sketchterrain.features.rules import TYPES
from sketchterrain.sketch.document import Sketch

ROW, COLUMN = np.mgrid[:128, :128]


def disc(row: float, column: float, radius: float) -> np.ndarray:
    return (np.hypot(ROW - row, COLUMN - column) < radius).astype(np.uint8)


def sketch(fidelity: float = 0.8, **layers: np.ndarray) -> Sketch:
    return Sketch(extent=1280.0, fidelity=fidelity, layers=layers or {"hill": np.zeros((128, 128), np.uint8)})


def test_placed_features_are_sorted_painted_and_finite() -> None:
    empty = place(sketch(), seed=1)
    assert empty.dtype == FEATURE
    assert len(empty) == 0
    layers = {name: disc(40 + 10 * i, 40 + 12 * i, 15) for i, name in enumerate(FEATURE_TYPES)}
    placed = place(sketch(0.3, **layers), seed=3)
    assert np.all(np.diff(placed["id"].astype(object)) > 0)
    assert placed["painted"].all()
    assert set(placed["type"]) == {0, 1, 2, 3}
    for field in ("x", "y", "radius", "strength"):
        assert np.isfinite(placed[field]).all()
    np.testing.assert_array_equal(placed, place(sketch(0.3, **layers), seed=3))


def test_a_feature_moves_less_than_its_disc_allows_and_at_fidelity_one_not_at_all() -> None:
    for fidelity, painted in ((0.4, disc(60, 60, 30)), (1.0, disc(30, 80, 20))):
        placed = place(sketch(fidelity, hill=painted), seed=5)
        pixel = (placed["id"] & np.uint64(2**48 - 1)).astype(int)
        east, north = (pixel % 128 + 0.5) * 10, (128 - pixel // 128 - 0.5) * 10
        if fidelity == 1.0:
            np.testing.assert_allclose(placed["x"], east)
            np.testing.assert_allclose(placed["y"], north)
            continue
        moved = np.hypot(placed["x"] - east, placed["y"] - north)
        assert moved.max() > 0
        assert np.all(moved <= 0.5 * 0.6 * placed["radius"] / TYPES["hill"].reach + 1e-3)


def test_features_have_the_heights_and_properties_of_their_labels() -> None:
    painted = sketch(0.8, mountain=disc(60, 60, 30))
    assert place(painted, seed=1)["strength"].max() == 600.0
    steep = painted.replace(labels={("mountain", 1): {"height": 5000.0}})
    assert place(steep, seed=1)["strength"].max() <= 300 * math.tan(math.radians(70)) * 1.001

    labels = {
        ("dune", 2): {"height": 9.0, "wavelength": 77.0, "wind": 30.0},
        ("mountain", 1): {"peakiness": 0.9},
    }
    layers = {"dune": 2 * disc(30, 30, 20), "mountain": disc(90, 90, 20), "forest": disc(20, 100, 10)}
    placed = place(sketch(0.8, **layers).replace(labels=labels), seed=1)
    dunes, mountains, forests = (placed[placed["type"] == code] for code in (2, 0, 3))
    assert set(dunes["wavelength"]) == {77.0}
    assert set(dunes["wind"]) == {30.0}
    np.testing.assert_array_equal(mountains["peakiness"], np.float32(0.9))
    assert np.all((forests["strength"] > 0.5) & (forests["strength"] <= 1.0))


def test_painting_elsewhere_changes_nothing_here_and_mountains_keep_away_from_a_river() -> None:
    before = place(sketch(0.5, hill=disc(30, 30, 15)), seed=1)
    painted = disc(30, 30, 15) | 2 * disc(100, 100, 20)
    after = place(sketch(0.5, hill=painted, mountain=disc(100, 60, 12)), seed=1)
    np.testing.assert_array_equal(after[np.isin(after["id"], before["id"])], before)

    river = (np.abs(COLUMN - 60) < 2).astype(np.uint8)
    mountain = disc(64, 64, 30)
    alone = place(sketch(0.0, mountain=mountain), seed=1)
    shy = place(sketch(0.0, mountain=mountain, river=river), seed=1)
    assert np.abs(shy["x"] - 605).mean() > np.abs(alone["x"] - 605).mean()
