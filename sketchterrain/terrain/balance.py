"""Strengths of overlapping features, so that together they reach the height each of them was asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.features import FEATURE_TYPES

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features.catalogue import Points

__all__ = ["balanced"]

_ROUNDS = 12
# A feature that its neighbours already lift above its own height keeps a little strength of its own.
_LEAST_SHARE = 0.02


def balanced(features: Points, *, locked: npt.NDArray[np.bool_] | None = None) -> Points:
    """Return the features with the strengths of mountains and of hills solved for.

    Heights of one type add up as ``(sum h^4)^(1/4)`` (``kernels/features.clh``). Fixed-point iteration: each
    strength is scaled by asked height over reached height at the feature's centre.

    Parameters
    ----------
    features : array of FEATURE
        Sorted by id.
    locked : (n,) bool, optional
        Which ones keep the strength that they have.
    """
    result = features.copy()
    free = features["strength"] > 0
    if locked is not None:
        free &= ~locked
    for name in ("mountain", "hill"):
        chosen = np.flatnonzero(features["type"] == FEATURE_TYPES.index(name))
        if chosen.size > 1:
            result["strength"][chosen] = _solved(features[chosen], free[chosen], has_tip=name == "mountain")
    return result


def _solved(features: Points, free: npt.NDArray[np.bool_], *, has_tip: bool) -> npt.NDArray[np.float64]:
    asked = features["strength"].astype(np.float64)
    centre = np.stack([features["x"], features["y"]], axis=-1)
    radius = features["radius"].astype(np.float64)
    pairs = cKDTree(centre).query_pairs(float(radius.max()), output_type="ndarray")
    at, of = np.concatenate([pairs, pairs[:, ::-1]]).T
    # In one order, however the tree was built: what is far away must not change a sum's last bit.
    order = np.lexsort((of, at))
    at, of = at[order], of[order]
    t = np.minimum(np.hypot(*(centre[at] - centre[of]).T) / radius[of], 1)
    profile = 2 * t**3 - 3 * t**2 + 1
    if has_tip:
        share = 0.1 + 0.6 * features["peakiness"][of].astype(np.float64)
        profile = (1 - share) * profile + share * (1 - t) ** 2
    strength = asked.copy()
    for _ in range(_ROUNDS):
        others = np.bincount(at, weights=(strength[of] * profile) ** 4, minlength=len(asked))
        reached = np.sqrt(np.sqrt(strength**4 + others))
        solved = np.maximum(strength * asked / np.where(free, reached, 1), _LEAST_SHARE * asked)
        strength = np.where(free, solved, asked)
    return strength
