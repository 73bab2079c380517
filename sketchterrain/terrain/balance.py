"""Strengths of overlapping features, so that together they reach the height each of them was asked for."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.features.profiles import hill_profile, mountain_profile
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.packing import support_radii
from sketchterrain.terrain.reference import relief_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features.catalogue import Points
    from sketchterrain.terrain.recipe import TerrainRecipe

    Reals = npt.NDArray[np.float64]

__all__ = ["balanced"]

_ROUNDS = 12
# A feature that its neighbours already lift above its own height keeps a little strength of its own: more
# towards fidelity 1, where it may have to hold a part of the border.
_LEAST_SHARE = 0.02
_LEAST_SHARE_HELD = 0.6
# Places around a centre where the height is looked for, as ridges may carry the highest point off the centre.
# How many depends on a feature's own size alone, so that far-away features never change it.
_PLACES = 240
_FEWEST_PLACES = 12
_WIDE = 0.04  # of the extent: ground radius from which on a feature gets all places
_TOP = 0.35  # radii around the centre
_POWER = {"mountain": 4, "hill": 2}  # of heights, by which they join (``kernels/features.clh``)
_SAY = 0.1  # share of the sum of powers from which on a feature answers for the height of a place
_MISSED = 1.025  # what the places miss of the highest point, on average over the presets
_CELLS_PER_EXTENT = 4096
_GOLDEN_ANGLE = 2.399963229728653


def balanced(recipe: TerrainRecipe, *, locked: npt.NDArray[np.bool_] | None = None) -> Points:
    """Return a recipe's painted features with the strengths of mountains and of hills solved for.

    Heights of one type add up as ``(sum h^p)^(1/p)`` and are then raised and lowered by
    ridges or swells. Fixed-point iteration: each strength is scaled by asked height over the greatest height
    that is reached around the feature's centre, where it outweighs the others.

    Parameters
    ----------
    recipe : TerrainRecipe
        Its painted features are sorted by id and have the strengths that are asked for.
    locked : (n,) bool, optional
        Which of them keep the strength that they have.
    """
    result = recipe.painted.copy()
    free = result["strength"] > 0
    if locked is not None:
        free &= ~locked
    for name in ("mountain", "hill"):
        chosen = np.flatnonzero(result["type"] == FEATURE_TYPES.index(name))
        if chosen.size:
            result["strength"][chosen] = _solved(recipe, result[chosen], free[chosen], name)
    return result


def _solved(recipe: TerrainRecipe, features: Points, free: npt.NDArray[np.bool_], name: str) -> Reals:
    places, owner, first = _places(recipe, features)
    at, of, height = _heights(recipe, features, places, name)
    power = _POWER[name]
    weight = height**power
    own = np.zeros(len(places))
    mine = owner[at] == of
    own[at[mine]] = weight[mine]
    asked = features["strength"].astype(np.float64)
    least = (_LEAST_SHARE + (_LEAST_SHARE_HELD - _LEAST_SHARE) * recipe.fidelity**8) * asked
    strength = asked.copy()
    for _ in range(_ROUNDS):
        total = np.bincount(at, weights=strength[of] ** power * weight, minlength=len(places))
        # Ground that mostly belongs to other features is theirs to judge, but for the centre.
        counts = own * strength[owner] ** power >= _SAY * total
        counts[first] = True
        highest = np.maximum.reduceat(np.where(counts, total, 0.0), first)
        reached = _MISSED * highest ** (1 / power)
        scale = asked / np.where(free, np.maximum(reached, 1e-3 * asked), 1.0)
        strength = np.where(free, np.maximum(strength * scale, least), asked)
    return strength


def _places(
    recipe: TerrainRecipe, features: Points
) -> tuple[Reals, npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return places (m) around each centre, whose they are, and the index of each feature's centre."""
    radius = features["radius"].astype(np.float64)
    size = radius / (_WIDE * recipe.extent)
    count = np.clip(_PLACES * size * size, _FEWEST_PLACES, _PLACES).astype(np.int64)
    owner = np.repeat(np.arange(len(features)), count)
    first = np.cumsum(count) - count
    number = np.arange(len(owner)) - first[owner]
    spread = _TOP * radius[owner] * np.sqrt(number / count[owner])
    angle = _GOLDEN_ANGLE * number
    x = features["x"][owner] + spread * np.cos(angle)
    y = features["y"][owner] + spread * np.sin(angle)
    return np.stack([x, y], axis=-1), owner, first


def _heights(
    recipe: TerrainRecipe, features: Points, places: Reals, name: str
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Reals]:
    """Pair places with features that reach them: place, feature, height per strength."""
    x, y = (to_lattice(places[:, axis], recipe.extent) for axis in (0, 1))
    relief = relief_of(recipe, x, y, cell_size=recipe.extent / _CELLS_PER_EXTENT)
    radius = features["radius"].astype(np.float64)
    centre = np.stack([features["x"], features["y"]], axis=-1)
    found = cKDTree(places).query_ball_point(centre, radius * support_radii(recipe))
    of = np.repeat(np.arange(len(features)), [len(near) for near in found])
    at = np.concatenate([np.asarray(near, dtype=np.int64) for near in found])
    bend = np.stack([each.value for each in relief.bend], axis=-1)
    offset = (places[at] - centre[of]) / radius[of, None] + bend[at]
    t = np.sqrt(np.sum(offset * offset, axis=1))
    if name == "mountain":
        peakiness = features["peakiness"][of].astype(np.float64)
        rest = np.maximum(1 - t, 0)
        t = np.maximum(t - relief.spur.value[at] * (1 - rest * rest), 0.0)
        height = mountain_profile(t, peakiness, recipe.flank) * relief.ridges.value[at]
    else:
        height = hill_profile(t, recipe.flank) * relief.swell.value[at]
    kept = height > 0.0
    return at[kept], of[kept], height[kept]
