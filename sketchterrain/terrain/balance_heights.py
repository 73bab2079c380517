"""Greatest height that overlapping features reach around each centre, for given strengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.packing import noise_weight, pack_world
from sketchterrain.terrain.reference_gullies import deepest_gullies, gullies
from sketchterrain.terrain.reference_noise import Slope
from sketchterrain.terrain.reference_relief import Rise

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array, Int64Array
    from sketchterrain.terrain.balance_places import Places
    from sketchterrain.terrain.packing import PackedWorld
    from sketchterrain.terrain.recipe import TerrainRecipe


_DOMINANT_SHARE = 0.1  # of the sum of powers at a sample, from which a feature is responsible for its height
_CELLS_ERODED = 512  # an extent, coarse: fine gullies raise no summit
_SLACK = 1e-6  # m, above rounding


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights at sample points around features of one type, which join as (Σ h⁴)^¼ or as (Σ h²)^½."""

    recipe: TerrainRecipe
    places: Places
    mountains: bool
    world: PackedWorld
    pair_of: Int64Array  # feature of each pair
    pair_at: Int64Array  # sample of each pair
    own: Float64Array  # power of the profile of each sample's owner
    traits: Float64Array  # (3, features): erosion, widest gully (m), noise weight
    depth: Float64Array  # greatest depth of gullies around each feature (m)

    @classmethod
    def prepare(cls, recipe: TerrainRecipe, places: Places, name: str) -> Heights:
        """Prepare everything that is constant over the rounds."""
        many = np.diff(places.start)
        pair_of, pair_owner = np.repeat(places.of, many), np.repeat(places.owner, many)
        pair_at = places.first[pair_owner] + places.place
        mountains = name == "mountain"
        own = np.zeros(len(places.at))
        same = pair_of == pair_owner
        own[pair_at[same]] = _power(places.profile[same], mountains=mountains)
        features = places.features
        radius = features["radius"].astype(np.float64)
        erosion, gully = (features[key].astype(np.float64) for key in ("erosion", "gullies"))
        traits = np.stack([erosion, gully * radius, noise_weight(recipe, radius)])
        world = pack_world(recipe, recipe.extent / _CELLS_ERODED, real=np.float64)
        edges = np.concatenate([[0], np.cumsum(np.bincount(places.owner))[:-1]])
        most = (np.maximum.reduceat(each[places.of], edges) for each in traits[:2])
        depth = deepest_gullies(world.scalars[0], world.octaves, *most)
        return cls(recipe, places, mountains, world, pair_of, pair_at, own, traits, depth)

    def reached(
        self, strength: Float64Array, selected: npt.NDArray[np.intp], *, eroded: bool
    ) -> Float64Array:
        """Return the greatest height (m, ≥ 0) around selected features (ascending), where each dominates.

        ``strength`` is that of all features; ``eroded`` includes gullies.
        """
        count = self.places.count[selected]
        first = np.cumsum(count) - count
        rows, pairs, at = self._select(selected, first)
        of, profile = self.pair_of[pairs], self.places.profile[pairs]
        power = _power(strength[of] * profile, mountains=self.mountains)
        total = np.bincount(at, power, minlength=len(rows))
        owner = np.repeat(selected, count)
        counts = self.own[rows] * _power(strength, mountains=self.mountains)[owner] >= _DOMINANT_SHARE * total
        counts[first] = True
        safe = np.maximum(total, 1e-36)
        joined = np.sqrt(np.sqrt(safe)) if self.mountains else np.sqrt(safe)
        if self.mountains:
            weight = np.bincount(at, power * self.traits[2][of], minlength=len(rows)) / safe
            plain = joined * (1 + weight * self.places.noise[9, rows])
        else:
            plain = joined * self.places.noise[6, rows]
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
        """Places of selected features, their pairs, and the place of each pair among these places."""
        places = self.places
        if len(selected) == len(places.features):
            return np.arange(len(places.at)), slice(None), self.pair_at
        wanted = np.zeros(len(places.features), dtype=np.bool_)
        wanted[selected] = True
        rows = np.flatnonzero(np.repeat(wanted, places.count))
        shift = np.zeros(len(places.features), dtype=np.int64)
        shift[selected] = first - places.first[selected]
        many = np.diff(places.start)
        pairs = np.flatnonzero(np.repeat(wanted[places.owner], many))
        return rows, pairs, self.pair_at[pairs] + np.repeat(shift[places.owner], many)[pairs]

    def _eroded(
        self,
        strength: Float64Array,
        rows: Int64Array,
        near: npt.NDArray[np.bool_],
        selected: tuple[npt.NDArray[np.intp] | slice, Int64Array],
        joint: tuple[Float64Array, Float64Array],
    ) -> Float64Array:
        """Heights with gullies at the places that are near enough to the top."""
        pairs, at = selected
        number = np.cumsum(near) - 1
        inside = np.flatnonzero(near[at])
        at = number[at[inside]]
        pairs = inside if isinstance(pairs, slice) else pairs[inside]
        safe, joined = (each[near] for each in joint)
        of, profile = self.pair_of[pairs], self.places.profile[pairs]
        h = strength[of] * profile
        factor = (h * h * h if self.mountains else h) * strength[of]

        def summed(values: Float64Array) -> Float64Array:
            return np.bincount(at, values, minlength=len(rows)).astype(np.float64)

        east, north = factor * self.places.east[pairs], factor * self.places.north[pairs]
        leans = (summed(east), summed(north))
        scale = joined / safe
        power = factor * profile
        erosion, widest, weight = (summed(power * trait[of]) / safe for trait in self.traits)
        relief = self.places.relief(rows)
        share = relief.swell
        if self.mountains:
            trait = self.traits[2][of]
            tilts = (
                4 * (summed(part * trait) - weight * lean) / safe
                for part, lean in zip((east, north), leans, strict=True)
            )
            share = relief.share(Slope(weight, *tilts))
        plain = joined * share.value
        slopes = (
            lean * scale * share.value + joined * part for lean, part in zip(leans, share[1:], strict=True)
        )
        x, y = (to_lattice(self.places.at[rows, axis], self.recipe.extent) for axis in (0, 1))
        rise = Rise(Slope(plain, *slopes), erosion, widest)
        return np.asarray(plain + gullies(self.world.scalars[0], self.world.octaves, x, y, rise).value)


def _power(values: Float64Array, *, mountains: bool) -> Float64Array:
    square = values * values
    return square * square if mountains else square
