"""How features fall from their summits to their feet: the formulas of ``kernels/features.clh``, in NumPy.

Distances t are in ground radii. Only + - * / are used, so that the result is the same on every machine.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from sketchterrain.array_types import Float64Array

VISIBLE_SHARE: Final = 0.25
"""Share of its label's height at which a shape begins, to the eye and to the measure of adherence."""

_STEEPEST = 0.6  # added to the flank at fidelity 1
_LOOSE = 0.6  # fidelity up to which flanks are as gentle as they can be
_TIP = 0.12  # share of a radius over which a mountain's tip is rounded
_CUT_IN = 0.2  # how much farther a mountain reaches at fidelity 0, as valleys cut into its outline
_HALVINGS = 30


def flank(fidelity: float) -> float:
    """Return how much steeper than the plain cubic mountains and hills fall to their feet, 1 or more."""
    steep = max(fidelity - _LOOSE, 0.0) / (1.0 - _LOOSE)
    return 1.0 + _STEEPEST * steep * steep * steep


def cubic(t: Float64Array) -> Float64Array:
    """Return 2t³ - 3t² + 1: 1 at 0, 0 from 1 on."""
    s = np.minimum(t, 1.0)
    return np.asarray(2.0 * s**3 - 3.0 * s**2 + 1.0)


def hill_profile(t: Float64Array, steepness: float | Float64Array) -> Float64Array:
    """Return what a hill keeps of its height: all up to 1 - 1/steepness, then down to a hollow foot at 1.

    A round top, below it a slope that fades evenly into the ground, so that no edge tells where the foot is:
    nearly (1 - s)², but level at s = 0.
    """
    s = np.maximum(1.0 - steepness * (1.0 - np.minimum(t, 1.0)), 0.0)
    return np.asarray((1.0 - s) ** 2 * (1.0 + s * (2.0 + s * (1.4 * s - 3.0))))


def hill_slope(t: Float64Array, steepness: float | Float64Array) -> Float64Array:
    """Return how a hill's profile changes with the distance."""
    s = np.maximum(1.0 - steepness * (1.0 - np.minimum(t, 1.0)), 0.0)
    swell = 1.0 + s * (2.0 + s * (1.4 * s - 3.0))
    return np.asarray(steepness * (1.0 - s) * ((1.0 - s) * (2.0 + s * (4.2 * s - 6.0)) - 2.0 * swell))


def mountain_profile(
    t: Float64Array, peakiness: float | Float64Array, steepness: float | Float64Array
) -> Float64Array:
    """Return what a mountain keeps of its height: a hill's profile and a round tip (1 - t)², by peakiness."""
    share = 0.1 + 0.6 * peakiness
    tip = (1.0 - _rounded(t)) ** 2 / (1.0 - 0.5 * _TIP) ** 2
    return np.asarray((1.0 - share) * hill_profile(t, steepness) + share * tip)


def mountain_slope(
    t: Float64Array, peakiness: float | Float64Array, steepness: float | Float64Array
) -> Float64Array:
    """Return how a mountain's profile changes with the distance."""
    share = 0.1 + 0.6 * peakiness
    tip = -2.0 * (1.0 - _rounded(t)) * np.minimum(t / _TIP, 1.0) / (1.0 - 0.5 * _TIP) ** 2
    return np.asarray((1.0 - share) * hill_slope(t, steepness) + share * tip)


def _rounded(t: Float64Array) -> Float64Array:
    return np.where(t < _TIP, 0.5 * (t * t / _TIP + _TIP), np.minimum(t, 1.0))


def area_profile(t: Float64Array) -> Float64Array:
    """Return the cover of dunes or of a forest: full up to half a radius, then the cubic."""
    return cubic(np.maximum((t - 0.5) / 0.5, 0.0))


def visible_radius(name: str, share: Float64Array, peakiness: Float64Array, fidelity: float) -> Float64Array:
    """Return where a feature shows a quarter of its label's strength, in its ground radii.

    Parameters
    ----------
    name : str
        Type of feature.
    share : (n,) float64
        Its strength over its label's, more than a quarter.
    peakiness : (n,) float64
    fidelity : float
    """
    low, high = np.zeros(len(share)), np.ones(len(share))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        if name == "mountain":
            profile = mountain_profile(middle, peakiness, flank(fidelity))
        elif name == "hill":
            profile = hill_profile(middle, flank(fidelity))
        else:
            profile = area_profile(middle)
        above = share * profile > VISIBLE_SHARE
        low, high = np.where(above, middle, low), np.where(above, high, middle)
    # Valleys between ridges cut into an outline more than spurs add to it, less so near fidelity 1.
    return low / (1.0 + _CUT_IN * (1.0 - fidelity)) if name == "mountain" else low
