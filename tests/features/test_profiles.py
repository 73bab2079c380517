from __future__ import annotations

import numpy as np
import pytest

from sketchterrain.features.profiles import SHOWN, flank, hill_profile, mountain_profile, shown_at

T = np.linspace(0.0, 1.0, 2001)


def test_hills_and_mountains_fall_from_one_to_exactly_zero() -> None:
    for fidelity in (0.0, 0.8, 0.9, 1.0):
        for profile in (hill_profile(T, flank(fidelity)), mountain_profile(T, 0.5, flank(fidelity))):
            assert profile[0] == pytest.approx(1.0)
            assert profile[-1] == 0.0
            assert np.all(np.diff(profile) <= 1e-12), fidelity
        assert np.all(hill_profile(np.array([1.0, 1.5, 9.0]), flank(fidelity)) == 0.0)


def test_a_hill_has_a_round_top_and_a_slope_that_fades_evenly() -> None:
    slope = -np.gradient(hill_profile(T, 1.0), T)
    assert slope[0] == pytest.approx(0.0, abs=0.02)
    foot = T > 0.6  # from a quarter of the height down
    line = np.polyval(np.polyfit(T[foot], slope[foot], 1), T[foot])
    assert np.abs(slope[foot] - line).max() < 0.04 * slope.max()


def test_a_feature_shows_a_quarter_of_its_label_where_it_is_said_to() -> None:
    share = np.array([0.36, 0.6, 1.0])
    at = shown_at("hill", share, np.zeros(3), 0.8)
    assert share * hill_profile(at, flank(0.8)) == pytest.approx(np.full(3, SHOWN), abs=1e-6)
    sharp = shown_at("mountain", share, np.array([0.0, 0.5, 1.0]), 1.0)
    assert share * mountain_profile(sharp, np.array([0.0, 0.5, 1.0]), flank(1.0)) == pytest.approx(
        np.full(3, SHOWN), abs=1e-6
    )
