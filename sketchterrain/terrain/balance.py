"""Strengths of overlapping features, solved so that together they reach the requested heights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array, StructuredArray
from sketchterrain.caching import LRUCache
from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.terrain.balance_samples import BalanceSamples
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.layers.layer import Sampling, WorldSettings, effective_cell
from sketchterrain.terrain.layers.points import noise_weight
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.layers.relief_host import ErodibleHeight, ReliefScale, deepest_gullies, gullies
from sketchterrain.terrain.noise import ValueSlope
from sketchterrain.terrain.recipe import TerrainRecipe

_DOMINANT_SHARE = 0.1  # of the sum of powers at a sample, from which a feature is responsible for its height
_CELLS_ERODED = 512  # an extent, coarse: fine gullies raise no summit
_SLACK = 1e-6  # m, above rounding

_ROUNDS = 12
_ERODED_ROUNDS = 4  # the last ones: erosion is a small correction
# A feature already lifted above its own height by its neighbours retains some strength of its own: more
# towards fidelity 1, where it may define part of the outline.
_MIN_SHARE = 0.02
_MIN_SHARE_AT_FIDELITY_1 = 0.6
_MISSED = 1.025  # highest point over the highest sample, on average over the presets


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights at sample points around features of one type, which join as (Σ h⁴)^¼ or as (Σ h²)^½."""

    recipe: TerrainRecipe
    samples: BalanceSamples
    mountains: bool
    sampling: Sampling
    scale: ReliefScale
    pair_feature: Int64Array  # feature of each pair
    pair_point: Int64Array  # sample of each pair
    own: Float64Array  # power of the profile of each sample's owner
    traits: Float64Array  # (3, features): erosion, widest gully (m), noise weight
    depth: Float64Array  # greatest depth of gullies around each feature (m)

    @classmethod
    def prepare(cls, recipe: TerrainRecipe, samples: BalanceSamples, name: str) -> Heights:
        """Prepare everything that is constant over the rounds."""
        many = np.diff(samples.start)
        pair_feature, pair_owner = np.repeat(samples.feature, many), np.repeat(samples.owner, many)
        pair_point = samples.first[pair_owner] + samples.point
        mountains = name == "mountain"
        own = np.zeros(len(samples.at))
        same = pair_feature == pair_owner
        own[pair_point[same]] = _power(samples.profile[same], mountains=mountains)
        features = samples.features
        radius = features["radius"].astype(np.float64)
        erosion, gully = (features[key].astype(np.float64) for key in ("erosion", "gullies"))
        traits = np.stack([erosion, gully * radius, noise_weight(radius, recipe.world)])
        sampling = recipe.sampling(effective_cell(recipe.extent / _CELLS_ERODED))
        scale = recipe[ReliefLayer].scale(recipe.world)
        edges = np.concatenate([[0], np.cumsum(np.bincount(samples.owner))[:-1]])
        most = (np.maximum.reduceat(each[samples.feature], edges) for each in traits[:2])
        depth = deepest_gullies(scale, sampling.octaves, *most)
        return cls(recipe, samples, mountains, sampling, scale, pair_feature, pair_point, own, traits, depth)

    def reached(
        self, strength: Float64Array, selected: npt.NDArray[np.intp], *, eroded: bool
    ) -> Float64Array:
        """Return the greatest height (m, ≥ 0) around selected features (ascending), where each dominates.

        ``strength`` is that of all features; ``eroded`` includes gullies.
        """
        count = self.samples.count[selected]
        first = np.cumsum(count) - count
        rows, pairs, at = self._select(selected, first)
        feature, profile = self.pair_feature[pairs], self.samples.profile[pairs]
        power = _power(strength[feature] * profile, mountains=self.mountains)
        total = np.bincount(at, power, minlength=len(rows))
        owner = np.repeat(selected, count)
        counts = self.own[rows] * _power(strength, mountains=self.mountains)[owner] >= _DOMINANT_SHARE * total
        counts[first] = True
        safe = np.maximum(total, 1e-36)
        joined = np.sqrt(np.sqrt(safe)) if self.mountains else np.sqrt(safe)
        if self.mountains:
            weight = np.bincount(at, power * self.traits[2][feature], minlength=len(rows)) / safe
            plain = joined * (1 + weight * self.samples.noise[9, rows])
        else:
            plain = joined * self.samples.noise[6, rows]
        plain = np.where(counts, plain, 0.0)
        highest = np.maximum.reduceat(plain, first)
        if not eroded or not self.depth[selected].any():
            return np.asarray(highest)
        # Gullies lower by no more than their depth and raise by little more: elsewhere cannot be the top.
        near = counts & (plain >= np.repeat(highest - 2.0 * self.depth[selected] - _SLACK, count))
        here = np.flatnonzero(near)
        plain[here] = self._eroded(strength, rows[here], near, (pairs, at), (safe, joined))
        return np.asarray(np.maximum.reduceat(np.where(near, plain, 0.0), first))

    def _select(
        self, selected: npt.NDArray[np.intp], first: Int64Array
    ) -> tuple[Int64Array, npt.NDArray[np.intp] | slice, Int64Array]:
        """Return the samples of selected features, their pairs, and each pair's index among these samples."""
        samples = self.samples
        if len(selected) == len(samples.features):
            return np.arange(len(samples.at)), slice(None), self.pair_point
        is_selected = np.zeros(len(samples.features), dtype=np.bool_)
        is_selected[selected] = True
        rows = np.flatnonzero(np.repeat(is_selected, samples.count))
        shift = np.zeros(len(samples.features), dtype=np.int64)
        shift[selected] = first - samples.first[selected]
        many = np.diff(samples.start)
        pairs = np.flatnonzero(np.repeat(is_selected[samples.owner], many))
        return rows, pairs, self.pair_point[pairs] + np.repeat(shift[samples.owner], many)[pairs]

    def _eroded(
        self,
        strength: Float64Array,
        rows: Int64Array,
        near: BoolArray,
        selected: tuple[npt.NDArray[np.intp] | slice, Int64Array],
        joint: tuple[Float64Array, Float64Array],
    ) -> Float64Array:
        """Return heights with gullies at samples near enough to the top."""
        pairs, at = selected
        number = np.cumsum(near) - 1
        inside = np.flatnonzero(near[at])
        at = number[at[inside]]
        pairs = inside if isinstance(pairs, slice) else pairs[inside]
        safe, joined = (each[near] for each in joint)
        feature, profile = self.pair_feature[pairs], self.samples.profile[pairs]
        h = strength[feature] * profile
        factor = (h * h * h if self.mountains else h) * strength[feature]

        def summed(values: Float64Array) -> Float64Array:
            return np.bincount(at, values, minlength=len(rows)).astype(np.float64)

        east, north = factor * self.samples.east[pairs], factor * self.samples.north[pairs]
        leans = (summed(east), summed(north))
        scale = joined / safe
        power = factor * profile
        erosion, widest, weight = (summed(power * trait[feature]) / safe for trait in self.traits)
        relief = self.samples.relief(rows)
        share = relief.swell
        if self.mountains:
            trait = self.traits[2][feature]
            tilts = (
                4 * (summed(part * trait) - weight * lean) / safe
                for part, lean in zip((east, north), leans, strict=True)
            )
            share = relief.mountain_factor(ValueSlope(weight, *tilts))
        plain = joined * share.value
        slopes = (
            lean * scale * share.value + joined * part for lean, part in zip(leans, share[1:], strict=True)
        )
        x, y = (to_lattice(self.samples.at[rows, axis], self.recipe.extent) for axis in (0, 1))
        rise = ErodibleHeight(ValueSlope(plain, *slopes), erosion, widest)
        return np.asarray(plain + gullies(self.scale, self.sampling.octaves, x, y, rise).value)


def _power(values: Float64Array, *, mountains: bool) -> Float64Array:
    square = values * values
    return square * square if mountains else square


@dataclass(frozen=True, eq=False)
class _Solution:
    """Iterations for one type: sample points, and the strengths and heights of each round.

    ``inputs`` are everything it depends on besides ``world``: the features, and which of them are free.
    """

    world: WorldSettings
    inputs: bytes
    samples: BalanceSamples
    strengths: list[Float64Array]
    heights: list[Float64Array]


def solve_strengths(
    recipe: TerrainRecipe,
    *,
    locked: BoolArray | None = None,
    memory: LRUCache | None = None,
    checkpoint: Callable[[], None] = lambda: None,
) -> StructuredArray:
    """Return a recipe's painted features, sorted by id, with solved strengths of mountains and hills.

    Heights of one type add up as ``(Σ h^p)^(1/p)`` and are then modulated by noise and erosion. Fixed-point
    iteration: each strength is scaled by the requested height over the greatest height around the feature's
    centre, where it dominates. ``locked`` (n,) features retain their strength. ``memory`` saves time, no bit
    depends on it. ``checkpoint`` is called between rounds; it may raise to cancel.
    """
    memory = LRUCache() if memory is None else memory
    result = recipe.points.painted.copy()
    free = result["strength"] > 0
    if locked is not None:
        free &= ~locked
    for name in ("mountain", "hill"):
        selected = np.flatnonzero(result["type"] == FEATURE_TYPES.index(name))
        if selected.size:
            last = memory.get(("strengths", name))
            solution = _solve(recipe, result[selected], free[selected], name, last, checkpoint)
            result["strength"][selected] = solution.strengths[-1]
            memory.store(("strengths", name), solution)
    return result


def _solve(
    recipe: TerrainRecipe,
    features: StructuredArray,
    free: BoolArray,
    name: str,
    last: _Solution | None,
    checkpoint: Callable[[], None],
) -> _Solution:
    """Return the iterations for one type, as far as possible from those of the last recipe.

    The height a feature reaches in one round depends only on that round's strengths of the features whose
    support overlaps it: where these are bit-equal, so is the height. A change propagates by one neighbour a
    round; the rest is reused.
    """
    last = None if last is None or last.world != recipe.world else last
    inputs = features.tobytes() + free.tobytes()
    if last is not None and last.inputs == inputs:
        return last
    samples = BalanceSamples.sample(recipe, features, name, None if last is None else last.samples)
    heights_of = Heights.prepare(recipe, samples, name)
    requested = features["strength"].astype(np.float64)
    least = (_MIN_SHARE + (_MIN_SHARE_AT_FIDELITY_1 - _MIN_SHARE) * recipe.world.fidelity**8) * requested
    strengths, heights = [requested], []
    for round_ in range(_ROUNDS):
        checkpoint()
        strength, reached = strengths[-1], np.zeros(len(features))
        stale = np.ones(len(features), dtype=np.bool_)
        if last is not None:
            stale = _stale(samples, strength, last.strengths[round_])
            reached[~stale] = last.heights[round_][samples.origin[~stale]]
        if stale.any():
            eroded = round_ >= _ROUNDS - _ERODED_ROUNDS
            reached[stale] = heights_of.reached(strength, np.flatnonzero(stale), eroded=eroded)
        heights.append(reached)
        scale = requested / np.where(free, np.maximum(_MISSED * reached, 1e-3 * requested), 1.0)
        strengths.append(np.where(free, np.maximum(strength * scale, least), requested))
    return _Solution(recipe.world, inputs, samples, strengths, heights)


def _stale(samples: BalanceSamples, strength: Float64Array, before: Float64Array) -> BoolArray:
    """Return which features may reach another height than before, because a neighbour's strength changed."""
    known = samples.origin >= 0
    other = ~known
    other[known] = strength[known] != before[samples.origin[known]]
    edges = np.concatenate([[0], np.cumsum(np.bincount(samples.owner, minlength=len(strength)))[:-1]])
    return np.asarray(~samples.settled | np.logical_or.reduceat(other[samples.feature], edges))
