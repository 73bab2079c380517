"""The greatest height that features reach together around the centre of each, for given strengths."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.packing import noise_share, pack_world
from sketchterrain.terrain.reference_gullies import deepest_gullies, gullies
from sketchterrain.terrain.reference_noise import Slope
from sketchterrain.terrain.reference_relief import Rise

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.terrain.balance_places import Places
    from sketchterrain.terrain.packing import PackedWorld
    from sketchterrain.terrain.recipe import TerrainRecipe

    Reals = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]

_SAY = 0.1  # share of the sum of powers from which on a feature answers for the height of a place
_CELLS_ERODED = 512  # coarser: fine gullies raise no summit
_SLACK = 1e-6  # m, more than rounding


@dataclass(frozen=True, eq=False)
class Heights:
    """Heights at places around features of one type, which join as (Σ h⁴)^¼ or as (Σ h²)^½."""

    recipe: TerrainRecipe
    places: Places
    mountains: bool
    world: PackedWorld
    pair_of: Ints  # whose profile each pair is
    pair_at: Ints  # the place
    own: Reals  # power of each place's owner's profile
    traits: Reals  # (3, features): erosion, widest gully (m), say of noise
    depth: Reals  # how deep gullies may be around each feature, over 1 (m)

    @classmethod
    def of(cls, recipe: TerrainRecipe, places: Places, name: str) -> Heights:
        """Prepare what stays the same from round to round."""
        many = np.diff(places.start)
        pair_of, pair_owner = np.repeat(places.of, many), np.repeat(places.owner, many)
        pair_at = places.first[pair_owner] + places.place
        mountains = name == "mountain"
        own = np.zeros(len(places.at))
        mine = pair_of == pair_owner
        own[pair_at[mine]] = _power(places.profile[mine], mountains=mountains)
        features = places.features
        radius = features["radius"].astype(np.float64)
        erosion, gully = (features[key].astype(np.float64) for key in ("erosion", "gullies"))
        traits = np.stack([erosion, gully * radius, noise_share(recipe, radius)])
        world = pack_world(recipe, recipe.extent / _CELLS_ERODED, real=np.float64)
        edges = np.concatenate([[0], np.cumsum(np.bincount(places.owner))[:-1]])
        most = (np.maximum.reduceat(each[places.of], edges) for each in traits[:2])
        depth = deepest_gullies(world.scalars[0], world.octaves, *most)
        return cls(recipe, places, mountains, world, pair_of, pair_at, own, traits, depth)

    def reached(self, strength: Reals, chosen: npt.NDArray[np.intp], *, eroded: bool) -> Reals:
        """Return the greatest height (m) around chosen features, ascending, where each outweighs the others.

        Parameters
        ----------
        strength : (n,) float64
            Of all features.
        chosen : (k,) int
        eroded : bool
            With or without what erosion adds and takes.

        Returns
        -------
        (k,) float64, or 0 if it is less.
        """
        count = self.places.count[chosen]
        first = np.cumsum(count) - count
        rows, pairs, at = self._chosen(chosen, first)
        of, profile = self.pair_of[pairs], self.places.profile[pairs]
        power = _power(strength[of] * profile, mountains=self.mountains)
        total = np.bincount(at, power, minlength=len(rows))
        owner = np.repeat(chosen, count)
        counts = self.own[rows] * _power(strength, mountains=self.mountains)[owner] >= _SAY * total
        counts[first] = True
        safe = np.maximum(total, 1e-36)
        joined = np.sqrt(np.sqrt(safe)) if self.mountains else np.sqrt(safe)
        if self.mountains:
            say = np.bincount(at, power * self.traits[2][of], minlength=len(rows)) / safe
            plain = joined * (1 + say * self.places.noise[9, rows])
        else:
            plain = joined * self.places.noise[6, rows]
        plain = np.where(counts, plain, 0.0)
        highest = np.maximum.reduceat(plain, first)
        if not eroded or not self.depth[chosen].any():
            return np.asarray(highest)
        # Gullies lower by no more than their depth and raise by little more: elsewhere cannot be the top.
        near = counts & (plain >= np.repeat(highest - 2.0 * self.depth[chosen] - _SLACK, count))
        here = np.flatnonzero(near)
        plain[here] = self._eroded(strength, rows[here], near, (pairs, at), (safe, joined))
        return np.asarray(np.maximum.reduceat(np.where(near, plain, 0.0), first))

    def _chosen(
        self, chosen: npt.NDArray[np.intp], first: Ints
    ) -> tuple[Ints, npt.NDArray[np.intp] | slice, Ints]:
        """Places of chosen features, their pairs, and the place of each pair among these places."""
        places = self.places
        if len(chosen) == len(places.features):
            return np.arange(len(places.at)), slice(None), self.pair_at
        wanted = np.zeros(len(places.features), dtype=np.bool_)
        wanted[chosen] = True
        rows = np.flatnonzero(np.repeat(wanted, places.count))
        shift = np.zeros(len(places.features), dtype=np.int64)
        shift[chosen] = first - places.first[chosen]
        many = np.diff(places.start)
        pairs = np.flatnonzero(np.repeat(wanted[places.owner], many))
        return rows, pairs, self.pair_at[pairs] + np.repeat(shift[places.owner], many)[pairs]

    def _eroded(
        self,
        strength: Reals,
        rows: Ints,
        near: npt.NDArray[np.bool_],
        chosen: tuple[npt.NDArray[np.intp] | slice, Ints],
        joint: tuple[Reals, Reals],
    ) -> Reals:
        """Heights with gullies at the places that are near enough to the top."""
        pairs, at = chosen
        number = np.cumsum(near) - 1
        kept = np.flatnonzero(near[at])
        at = number[at[kept]]
        pairs = kept if isinstance(pairs, slice) else pairs[kept]
        safe, joined = (each[near] for each in joint)
        of, profile = self.pair_of[pairs], self.places.profile[pairs]
        h = strength[of] * profile
        weight = (h * h * h if self.mountains else h) * strength[of]

        def summed(values: Reals) -> Reals:
            return np.bincount(at, values, minlength=len(rows)).astype(np.float64)

        east, north = weight * self.places.east[pairs], weight * self.places.north[pairs]
        leans = (summed(east), summed(north))
        scale = joined / safe
        power = weight * profile
        erosion, widest, say = (summed(power * trait[of]) / safe for trait in self.traits)
        relief = self.places.relief(rows)
        share = relief.swell
        if self.mountains:
            trait = self.traits[2][of]
            tilts = (
                4 * (summed(part * trait) - say * lean) / safe
                for part, lean in zip((east, north), leans, strict=True)
            )
            share = relief.share(Slope(say, *tilts))
        plain = joined * share.value
        slopes = (
            lean * scale * share.value + joined * part for lean, part in zip(leans, share[1:], strict=True)
        )
        x, y = (to_lattice(self.places.at[rows, axis], self.recipe.extent) for axis in (0, 1))
        rise = Rise(Slope(plain, *slopes), erosion, widest)
        return np.asarray(plain + gullies(self.world.scalars[0], self.world.octaves, x, y, rise).value)


def _power(values: Reals, *, mountains: bool) -> Reals:
    square = values * values
    return square * square if mountains else square
