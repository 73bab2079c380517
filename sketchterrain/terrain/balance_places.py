"""Places around the centres of features, paired with all features that reach them.

What a place is to a feature depends on the two alone, so that after a stroke only the pairs of what changed
are worked out anew.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import chain
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.features.profiles import hill_profile, hill_slope, mountain_profile, mountain_slope
from sketchterrain.terrain.lattice import to_lattice
from sketchterrain.terrain.packing import noise_share, support_radii
from sketchterrain.terrain.reference import relief_of
from sketchterrain.terrain.reference_noise import Slope
from sketchterrain.terrain.reference_relief import Relief, approached, carried

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features.catalogue import Points
    from sketchterrain.terrain.recipe import TerrainRecipe

    Reals = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]
    Flags = npt.NDArray[np.bool_]

# Places around a centre where the height is looked for, as ridges may carry the highest point off the centre.
# How many depends on a feature's own size alone, so that far-away features never change it.
_PLACES = 240
_FEWEST_PLACES = 12
_WIDE = 0.04  # of the extent: ground radius from which on a feature gets all places
_TOP = 0.35  # radii around the centre
_CELLS_PER_EXTENT = 4096
_GOLDEN_ANGLE = 2.399963229728653
_SHAPE_FIELDS = ("id", "x", "y", "radius", "peakiness", "erosion", "gullies")


def same_features(features: Points, others: Points) -> npt.NDArray[np.intp]:
    """Return where each feature stands, with the same shape, among others sorted by id; -1 where it does not.

    Strengths are not looked at.
    """
    if len(others) == 0:
        return np.full(len(features), -1, dtype=np.intp)
    row = np.minimum(np.searchsorted(others["id"], features["id"]), len(others) - 1)
    same = np.ones(len(features), dtype=np.bool_)
    for key in _SHAPE_FIELDS:
        same &= features[key] == others[key][row]
    return np.where(same, row, -1)


@dataclass(frozen=True, eq=False)
class Places:
    """Places around features of one type, and the pairs of these places with the features that reach them.

    Pairs stand in the order of their edges; an edge is an owner of places and a feature that may reach some
    of them, in the order of the owners and, for each, of the features.

    Attributes
    ----------
    features : (n,) array of FEATURE
    first, count : (n,) int64
        Index of each feature's centre among the places, and how many places it owns.
    at : (places, 2) float64
        Metres.
    noise : (15, places) float64
        The values and slopes of `Relief`: bends, swell, ridge, spur.
    owner, of : (edges,) int64
    start : (edges + 1,) int64
        Index of each edge's first pair.
    place : (pairs,) int64
        Counted from the owner's first one.
    profile, east, north : (pairs,) float64
        Height per strength, and its slope per metre.
    settled : (n,) bool
        Which owners have the places, edges and pairs that they had in what this was made from.
    origin : (n,) int
        Where each feature stood there; -1 for new ones.
    """

    features: Points
    first: Ints
    count: Ints
    at: Reals
    noise: Reals
    owner: Ints
    of: Ints
    start: Ints
    place: Ints
    profile: Reals
    east: Reals
    north: Reals
    settled: Flags
    origin: npt.NDArray[np.intp]

    @classmethod
    def around(
        cls, recipe: TerrainRecipe, features: Points, name: str, before: Places | None = None
    ) -> Places:
        """Lay places around features of a type and pair them; from `before` comes what is the same there."""
        origin = same_features(features, features[:0] if before is None else before.features)
        count = _counts(recipe, features)
        first = np.cumsum(count) - count
        known = origin >= 0
        at, noise = np.zeros((int(count.sum()), 2)), np.zeros((15, int(count.sum())))
        if before is not None and known.any():
            new, old = _ranges(first[known], count[known]), _ranges(before.first[origin[known]], count[known])
            at[new], noise[:, new] = before.at[old], before.noise[:, old]
        if not known.all():
            rows = _ranges(first[~known], count[~known])
            at[rows] = _laid(features[~known], count[~known])
            x, y = (to_lattice(at[rows, axis], recipe.extent) for axis in (0, 1))
            noise[:, rows] = _rows(relief_of(recipe, x, y, cell_size=recipe.extent / _CELLS_PER_EXTENT))
        owner, of = _edges(recipe, features)
        reused = np.full(len(owner), -1, dtype=np.int64)
        if before is not None and len(before.owner):
            keys = before.owner * len(before.features) + before.of
            wanted = np.where(known[owner] & known[of], origin[owner] * len(before.features) + origin[of], -1)
            row = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
            reused = np.where(keys[row] == wanted, row, -1)
        fresh = reused < 0
        made = _pairs(recipe, features, name, (owner[fresh], of[fresh]), (first, count, at, noise))
        start, pairs = _merged(before, reused, made)
        settled = known.copy()
        settled[owner[fresh]] = False
        if before is not None and known.any():
            edges = np.bincount(owner, minlength=len(features))
            edges_before = np.bincount(before.owner, minlength=len(before.features))
            settled[known] &= edges[known] == edges_before[origin[known]]
        return cls(features, first, count, at, noise, owner, of, start, *pairs, settled, origin)

    def relief(self, rows: npt.NDArray[np.integer] | slice) -> Relief:
        """Return what noise makes of the joined heights at some of the places."""
        n = self.noise[:, rows]
        parts = [Slope(*n[i : i + 3]) for i in range(0, 15, 3)]
        return Relief((parts[0], parts[1]), parts[2], parts[3], parts[4])


def _counts(recipe: TerrainRecipe, features: Points) -> Ints:
    size = features["radius"].astype(np.float64) / (_WIDE * recipe.extent)
    return np.clip(_PLACES * size * size, _FEWEST_PLACES, _PLACES).astype(np.int64)


def _laid(features: Points, count: Ints) -> Reals:
    """Places (m) around each centre, which comes first: a sunflower's seeds."""
    owner = np.repeat(np.arange(len(features)), count)
    number = np.arange(len(owner)) - (np.cumsum(count) - count)[owner]
    spread = _TOP * features["radius"].astype(np.float64)[owner] * np.sqrt(number / count[owner])
    angle = _GOLDEN_ANGLE * number
    x = features["x"][owner] + spread * np.cos(angle)
    y = features["y"][owner] + spread * np.sin(angle)
    return np.stack([x, y], axis=-1)


def _rows(relief: Relief) -> Reals:
    return np.stack(
        [part for slope in (*relief.bend, relief.swell, relief.ridge, relief.spur) for part in slope]
    )


def _edges(recipe: TerrainRecipe, features: Points) -> tuple[Ints, Ints]:
    """Owners and the features whose support reaches the circle of their places, sorted by both."""
    radius = features["radius"].astype(np.float64)
    centre = np.stack([features["x"], features["y"]], axis=-1)
    wide = radius * support_radii(recipe)
    tree = cKDTree(centre)
    found = tree.query_ball_point(centre, _TOP * radius + float(wide.max()), return_sorted=True)
    owner = np.repeat(np.arange(len(features)), [len(near) for near in found])
    of = np.fromiter(chain.from_iterable(found), dtype=np.int64, count=len(owner))
    away = np.hypot(*(centre[owner] - centre[of]).T)
    near = away <= (_TOP * radius[owner] + wide[of]) * (1 + 1e-9)
    return owner[near].astype(np.int64), of[near]


def _pairs(
    recipe: TerrainRecipe,
    features: Points,
    name: str,
    edges: tuple[Ints, Ints],
    places: tuple[Ints, Ints, Reals, Reals],
) -> tuple[Ints, Ints, Reals, Reals, Reals]:
    """Pairs on some edges: the first of each edge, their places, profiles and slopes."""
    first, count, at, noise = places
    many = count[edges[0]]
    row, of = _ranges(first[edges[0]], many), np.repeat(edges[1], many)
    radius = features["radius"].astype(np.float64)
    centre = np.stack([features["x"], features["y"]], axis=-1)
    offset = (at[row] - centre[of]).T
    # Most of what an edge proposes is out of reach: that is seen before anything else is worked out.
    reach = radius * support_radii(recipe) * (1 + 1e-9)
    near = np.flatnonzero((offset * offset).sum(axis=0) <= (reach * reach)[of])
    edge, row, of, offset = np.repeat(np.arange(len(many)), many)[near], row[near], of[near], offset[:, near]
    n = noise[:, row]
    t, _ = approached(offset, 1 / radius[of], (Slope(*n[:3]), Slope(*n[3:6])))
    if name == "mountain":
        t = carried(t, Slope(*n[12:]), noise_share(recipe, radius)[of])
        style = (features["peakiness"][of].astype(np.float64), recipe.flank)
        profile, slope = mountain_profile(t.value, *style), mountain_slope(t.value, *style)
    else:
        profile, slope = hill_profile(t.value, recipe.flank), hill_slope(t.value, recipe.flank)
    kept = profile > 0.0
    edge, profile, slope = edge[kept], profile[kept], slope[kept]
    start = np.concatenate([[0], np.cumsum(np.bincount(edge, minlength=len(many)))])
    return start, row[kept] - first[edges[0]][edge], profile, slope * t.east[kept], slope * t.north[kept]


def _merged(
    before: Places | None, reused: Ints, made: tuple[Ints, Ints, Reals, Reals, Reals]
) -> tuple[Ints, tuple[Ints, Reals, Reals, Reals]]:
    """First pair of each edge, and the pairs of all: those of reused edges from before, the others made."""
    if before is None or (reused < 0).all():
        return made[0], made[1:]
    old, fresh, more = before.start, reused < 0, len(before.place)
    begin, length = np.zeros((2, len(reused)), dtype=np.int64)
    begin[~fresh], length[~fresh] = old[reused[~fresh]], np.diff(old)[reused[~fresh]]
    begin[fresh], length[fresh] = made[0][:-1] + more, np.diff(made[0])
    start = np.concatenate([[0], np.cumsum(length)])
    rows = _ranges(begin, length)
    parts = zip((before.place, before.profile, before.east, before.north), made[1:], strict=True)
    place, profile, east, north = (np.concatenate(each)[rows] for each in parts)
    return start, (place, profile, east, north)


def _ranges(first: Ints, count: Ints) -> Ints:
    """``first, first + 1, …`` for `count` numbers each, one after another."""
    starts = np.cumsum(count) - count
    return np.asarray(np.arange(int(count.sum())) + np.repeat(first - starts, count))
