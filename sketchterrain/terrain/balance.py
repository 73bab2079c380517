"""Strengths of overlapping features, so that together they reach the height each of them was asked for."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.features.profiles import hill_profile, hill_slope, mountain_profile, mountain_slope
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.packing import noise_share, pack_world, support_radii
from sketchterrain.terrain.reference import relief_of
from sketchterrain.terrain.reference_noise import Slope
from sketchterrain.terrain.reference_relief import Relief, Rise, approached, carried, gullies

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features.catalogue import Points
    from sketchterrain.terrain.recipe import TerrainRecipe

    Reals = npt.NDArray[np.float64]

__all__ = ["balanced"]

_ROUNDS = 12
_ERODED_ROUNDS = 4  # the last ones: erosion is little beside the rest
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
_CELLS_ERODED = 512  # coarser: fine gullies raise no summit
_GOLDEN_ANGLE = 2.399963229728653


def balanced(recipe: TerrainRecipe, *, locked: npt.NDArray[np.bool_] | None = None) -> Points:
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
    around = _Around.paired(recipe, features, places, name)
    mine = owner[around.at] == around.of
    own = np.zeros(len(places))
    own[around.at[mine]] = around.profile[mine] ** around.power
    asked = features["strength"].astype(np.float64)
    least = (_LEAST_SHARE + (_LEAST_SHARE_HELD - _LEAST_SHARE) * recipe.fidelity**8) * asked
    strength = asked.copy()
    for round_ in range(_ROUNDS):
        total = around.total(strength)
        # Ground that mostly belongs to other features is theirs to judge, but for the centre.
        counts = own * strength[owner] ** around.power >= _SAY * total
        counts[first] = True
        height = around.height(strength, total, eroded=round_ >= _ROUNDS - _ERODED_ROUNDS)
        reached = _MISSED * np.maximum.reduceat(np.where(counts, height, 0.0), first)
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


@dataclass(frozen=True)
class _Around:
    """Places paired with the features of one type that reach them.

    Attributes
    ----------
    at, of : (n,) int64
        Place and feature of each pair.
    profile, east, north : (n,) float64
        Height per strength, and its slope per metre.
    relief : Relief
        What noise makes of the joined heights, at each place.
    traits : (features, 3) float64
        Erosion, the widest gully (m) and the say of noise of each feature.
    """

    recipe: TerrainRecipe
    x: npt.NDArray[np.int64]
    y: npt.NDArray[np.int64]
    power: int
    at: npt.NDArray[np.int64]
    of: npt.NDArray[np.int64]
    profile: Reals
    east: Reals
    north: Reals
    relief: Relief
    traits: Reals

    @classmethod
    def paired(cls, recipe: TerrainRecipe, features: Points, places: Reals, name: str) -> _Around:
        """Pair places (m) with the features whose support reaches them."""
        x, y = (to_lattice(places[:, axis], recipe.extent) for axis in (0, 1))
        relief = relief_of(recipe, x, y, cell_size=recipe.extent / _CELLS_PER_EXTENT)
        radius = features["radius"].astype(np.float64)
        centre = np.stack([features["x"], features["y"]], axis=-1)
        found = cKDTree(places).query_ball_point(centre, radius * support_radii(recipe))
        of = np.repeat(np.arange(len(features)), [len(near) for near in found])
        at = np.concatenate([np.asarray(near, dtype=np.int64) for near in found])
        bend = tuple(Slope(*(part[at] for part in each)) for each in relief.bend)
        t, _ = approached((places[at] - centre[of]).T, 1 / radius[of], (bend[0], bend[1]))
        if name == "mountain":
            t = carried(t, Slope(*(part[at] for part in relief.spur)), noise_share(recipe, radius)[of])
            style = (features["peakiness"][of].astype(np.float64), recipe.flank)
            profile, slope = mountain_profile(t.value, *style), mountain_slope(t.value, *style)
        else:
            profile, slope = hill_profile(t.value, recipe.flank), hill_slope(t.value, recipe.flank)
        kept = profile > 0.0
        east, north = slope * t.east, slope * t.north
        erosion, gully = (features[key].astype(np.float64) for key in ("erosion", "gullies"))
        return cls(
            recipe,
            x,
            y,
            _POWER[name],
            at[kept],
            of[kept],
            profile[kept],
            east[kept],
            north[kept],
            relief,
            np.stack([erosion, gully * radius, noise_share(recipe, radius)], axis=-1),
        )

    def total(self, strength: Reals) -> Reals:
        """Sum of powers of the heights at each place."""
        return self._sum((strength[self.of] * self.profile) ** self.power)

    def height(self, strength: Reals, total: Reals, *, eroded: bool) -> Reals:
        """Height (m) at each place, with or without what erosion adds and takes."""
        joined = np.maximum(total, 1e-36) ** (1 / self.power)
        weight = (strength[self.of] * self.profile) ** (self.power - 1) * strength[self.of]
        slopes = (self._sum(weight * part) / joined ** (self.power - 1) for part in (self.east, self.north))
        height = Slope(joined, *slopes)
        safe = np.maximum(total, 1e-36)
        erosion, widest, say = (
            self._sum(weight * self.profile * trait) / safe for trait in self.traits[self.of].T
        )
        share = self.relief.swell
        if self.power == _POWER["mountain"]:
            own = weight * self.traits[self.of, 2]
            leans = (
                4 * (self._sum(own * part) - say * self._sum(weight * part)) / safe
                for part in (self.east, self.north)
            )
            share = self.relief.share(Slope(say, *leans))
        plain = joined * share.value
        if not eroded or not self.traits[:, 0].any():
            return np.asarray(plain)
        leaning = (
            slope * share.value + joined * lean for slope, lean in zip(height[1:], share[1:], strict=True)
        )
        world = pack_world(self.recipe, self.recipe.extent / _CELLS_ERODED, real=np.float64)
        rise = Rise(Slope(plain, *leaning), erosion, widest)
        return np.asarray(plain + gullies(world.scalars[0], world.octaves, self.x, self.y, rise).value)

    def _sum(self, values: Reals) -> Reals:
        return np.asarray(np.bincount(self.at, weights=values, minlength=len(self.x)), np.float64)
