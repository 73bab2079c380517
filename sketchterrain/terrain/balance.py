"""Strengths of overlapping features, solved so that together they reach each feature's requested height."""

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

    from sketchterrain.array_types import BoolArray, Float64Array, StructuredArray
    from sketchterrain.terrain.recipe import TerrainRecipe


_ROUNDS = 12
_ERODED_ROUNDS = 4  # the last ones: erosion is a small correction
# A feature already lifted above its own height by its neighbours retains some strength of its own: more
# towards fidelity 1, where it may define part of the outline.
_MIN_SHARE = 0.02
_MIN_SHARE_AT_FIDELITY_1 = 0.6
_MISSED = 1.025  # highest point over the highest sample, on average over the presets


@dataclass(frozen=True, eq=False)
class _Solution:
    """Iterations for one type: sample points, and the strengths and heights of each round.

    ``inputs`` are everything it depends on besides ``world``: the features, and which of them are free.
    """

    world: tuple[float, int, float]
    inputs: bytes
    places: Places
    strengths: list[Float64Array]
    heights: list[Float64Array]


@dataclass
class StrengthCache:
    """The previous solution by type; several threads may share it.

    The height a feature reaches in one round depends only on that round's strengths of the features whose
    support overlaps it: where these are bit-equal, so is the height. A change propagates by one neighbour a
    round; the rest is reused.
    """

    last: dict[str, _Solution] = field(default_factory=dict)


def solve_strengths(
    recipe: TerrainRecipe,
    *,
    locked: npt.NDArray[np.bool_] | None = None,
    memory: StrengthCache | None = None,
    checkpoint: Callable[[], None] | None = None,
) -> StructuredArray:
    """Return a recipe's painted features, sorted by id, with solved strengths of mountains and hills.

    Heights of one type add up as ``(Σ h^p)^(1/p)`` and are then modulated by noise and erosion. Fixed-point
    iteration: each strength is scaled by the requested height over the greatest height around the feature's
    centre, where it dominates. ``locked`` (n,) features retain their strength. ``memory`` saves time, no bit
    depends on it. ``checkpoint`` is called between rounds; it may raise to cancel.
    """
    memory = StrengthCache() if memory is None else memory
    result = recipe.painted.copy()
    free = result["strength"] > 0
    if locked is not None:
        free &= ~locked
    for name in ("mountain", "hill"):
        selected = np.flatnonzero(result["type"] == FEATURE_TYPES.index(name))
        if selected.size:
            last = memory.last.get(name)
            solution = _solve(recipe, result[selected], free[selected], name, last, checkpoint)
            result["strength"][selected] = solution.strengths[-1]
            memory.last[name] = solution
    return result


def _solve(
    recipe: TerrainRecipe,
    features: StructuredArray,
    free: BoolArray,
    name: str,
    last: _Solution | None,
    checkpoint: Callable[[], None] | None,
) -> _Solution:
    world = (recipe.extent, recipe.seed, recipe.fidelity)
    last = None if last is None or last.world != world else last
    inputs = features.tobytes() + free.tobytes()
    if last is not None and last.inputs == inputs:
        return last
    places = Places.sample(recipe, features, name, None if last is None else last.places)
    heights_of = Heights.prepare(recipe, places, name)
    requested = features["strength"].astype(np.float64)
    least = (_MIN_SHARE + (_MIN_SHARE_AT_FIDELITY_1 - _MIN_SHARE) * recipe.fidelity**8) * requested
    strengths, heights = [requested], []
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
        scale = requested / np.where(free, np.maximum(_MISSED * reached, 1e-3 * requested), 1.0)
        strengths.append(np.where(free, np.maximum(strength * scale, least), requested))
    return _Solution(world, inputs, places, strengths, heights)


def _stale(places: Places, strength: Float64Array, before: Float64Array) -> BoolArray:
    """Return which features may reach another height than before, because a neighbour's strength changed."""
    known = places.origin >= 0
    other = ~known
    other[known] = strength[known] != before[places.origin[known]]
    edges = np.concatenate([[0], np.cumsum(np.bincount(places.owner, minlength=len(strength)))[:-1]])
    return np.asarray(~places.settled | np.logical_or.reduceat(other[places.of], edges))
