"""Strengths of overlapping features, so that together they reach the height each of them was asked for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.terrain.balance_heights import Heights
from sketchterrain.terrain.balance_places import Places

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.features.catalogue import Points
    from sketchterrain.terrain.recipe import TerrainRecipe

    Reals = npt.NDArray[np.float64]
    Flags = npt.NDArray[np.bool_]

_ROUNDS = 12
_ERODED_ROUNDS = 4  # the last ones: erosion is little beside the rest
# A feature that its neighbours already lift above its own height keeps a little strength of its own: more
# towards fidelity 1, where it may have to hold a part of the border.
_LEAST_SHARE = 0.02
_LEAST_SHARE_HELD = 0.6
_MISSED = 1.025  # what the places miss of the highest point, on average over the presets


@dataclass(frozen=True, eq=False)
class _Solution:
    """How strengths of one type were found: places, and the strengths and heights of each round.

    `asked` is all that it depends on beside the world: the features, and which of them are free.
    """

    world: tuple[float, int, float]
    asked: bytes
    places: Places
    strengths: list[Reals]
    heights: list[Reals]


@dataclass
class BalanceMemory:
    """How strengths were found the last time; several threads may share it.

    What a feature reaches in one round depends on the strengths, in that round, of the features that reach
    it: where these are the same to the bit, so is what it reaches. So a change moves on by one neighbour a
    round, and the rest is remembered.
    """

    last: dict[str, _Solution] = field(default_factory=dict)


def balanced(
    recipe: TerrainRecipe,
    *,
    locked: npt.NDArray[np.bool_] | None = None,
    memory: BalanceMemory | None = None,
    checkpoint: Callable[[], None] | None = None,
) -> Points:
    """Return a recipe's painted features with the strengths of mountains and of hills solved for.

    Heights of one type add up as ``(sum h^p)^(1/p)`` and are then raised and lowered by
    noise and erosion. Fixed-point iteration: each strength is scaled by asked height over the greatest height
    that is reached around the feature's centre, where it outweighs the others.

    Parameters
    ----------
    recipe : TerrainRecipe
        Its painted features are sorted by id and have the strengths that are asked for.
    locked : (n,) bool, optional
        Which of them keep the strength that they have.
    memory : BalanceMemory, optional
        From the last time. It saves time; the bits are the same.
    checkpoint : callable, optional
        Called every now and then; it may raise to abandon the work.
    """
    memory = BalanceMemory() if memory is None else memory
    result = recipe.painted.copy()
    free = result["strength"] > 0
    if locked is not None:
        free &= ~locked
    for name in ("mountain", "hill"):
        chosen = np.flatnonzero(result["type"] == FEATURE_TYPES.index(name))
        if chosen.size:
            last = memory.last.get(name)
            solution = _solved(recipe, result[chosen], free[chosen], name, last, checkpoint)
            result["strength"][chosen] = solution.strengths[-1]
            memory.last[name] = solution
    return result


def _solved(
    recipe: TerrainRecipe,
    features: Points,
    free: Flags,
    name: str,
    last: _Solution | None,
    checkpoint: Callable[[], None] | None,
) -> _Solution:
    world = (recipe.extent, recipe.seed, recipe.fidelity)
    last = None if last is None or last.world != world else last
    all_asked = features.tobytes() + free.tobytes()
    if last is not None and last.asked == all_asked:
        return last
    places = Places.around(recipe, features, name, None if last is None else last.places)
    heights_of = Heights.of(recipe, places, name)
    asked = features["strength"].astype(np.float64)
    least = (_LEAST_SHARE + (_LEAST_SHARE_HELD - _LEAST_SHARE) * recipe.fidelity**8) * asked
    strengths, heights = [asked], []
    for round_ in range(_ROUNDS):
        if checkpoint is not None:
            checkpoint()
        strength, reached = strengths[-1], np.zeros(len(features))
        stale = np.ones(len(features), dtype=np.bool_)
        if last is not None:
            stale = _stale(places, strength, last.strengths[round_])
            reached[~stale] = last.heights[round_][places.origin[~stale]]
        if stale.any():
            eroded = round_ >= _ROUNDS - _ERODED_ROUNDS
            reached[stale] = heights_of.reached(strength, np.flatnonzero(stale), eroded=eroded)
        heights.append(reached)
        scale = asked / np.where(free, np.maximum(_MISSED * reached, 1e-3 * asked), 1.0)
        strengths.append(np.where(free, np.maximum(strength * scale, least), asked))
    return _Solution(world, all_asked, places, strengths, heights)


def _stale(places: Places, strength: Reals, before: Reals) -> Flags:
    """Which features may reach another height than before: something that reaches them is another."""
    known = places.origin >= 0
    other = ~known
    other[known] = strength[known] != before[places.origin[known]]
    edges = np.concatenate([[0], np.cumsum(np.bincount(places.owner, minlength=len(strength)))[:-1]])
    return np.asarray(~places.settled | np.logical_or.reduceat(other[places.of], edges))
