"""Crests: of unpainted mountains only, by their ids alone."""

from __future__ import annotations

import numpy as np

from sketchterrain.features.catalogue import FEATURE, FEATURE_TYPES
from sketchterrain.features.crests import crests


def points(kind: str, *, painted: bool, count: int = 2000) -> np.ndarray:
    rows = np.zeros(count, FEATURE)
    rows["id"] = (1 << 63) + np.arange(count, dtype=np.uint64)
    rows["type"], rows["painted"] = FEATURE_TYPES.index(kind), painted
    return rows


def test_only_unpainted_mountains_have_crests() -> None:
    for kind in FEATURE_TYPES:
        assert not crests(points(kind, painted=True)).any()
        assert crests(points(kind, painted=False)).any() == (kind == "mountain")


def test_crests_have_all_lengths_and_directions_and_leave_room_for_flanks() -> None:
    east, north = crests(points("mountain", painted=False)).T
    length = np.hypot(east, north)
    assert length.min() >= 0.15
    assert length.max() <= 0.45
    assert abs(length.mean() - 0.3) < 0.01
    turn = np.arctan2(north, east) / np.pi
    assert np.histogram(turn, 8, (0, 1))[0].min() > 200


def test_a_mountain_that_is_moved_or_seen_among_others_keeps_its_crest() -> None:
    all_of_them = points("mountain", painted=False)
    moved = all_of_them[700:701].copy()
    moved["x"], moved["radius"] = 5000.0, 3.0
    np.testing.assert_array_equal(crests(moved), crests(all_of_them)[700:701])
