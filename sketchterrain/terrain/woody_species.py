"""Which trees and shrubs grow at a place, as shares; how thick they stand there, and how tall each gets."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.features.catalogue import conifer_share
from sketchterrain.terrain.culling import features_near
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import support_radii
from sketchterrain.terrain.plant import STOREYS
from sketchterrain.terrain.plant_noise import ramp
from sketchterrain.terrain.plant_spacing import density_of

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.array_types import FloatArray, LatticeArray
    from sketchterrain.terrain.recipe import TerrainRecipe


__all__ = ["EDGE", "OUTSIDE", "SHRUB", "Mix", "Site", "species_mix", "tree_size"]

OUTSIDE = 0.22
"""Forest mask below which a place is outside."""
EDGE = 0.55
"""Forest mask below which trees are smaller: it is the forest's edge."""

_SPRUCE, _PINE, _OAK, _BIRCH, SHRUB = range(len(STOREYS["woody"]))
_APART = (5.0, 5.9, 6.6, 4.4, 3.8)
"""m between plants of a full stand of each species."""
_FULL = tuple(float(density_of(apart)) for apart in _APART)
_CONIFER_BELT = 450.0  # m below the tree line in which conifers take over
_STANDS = (420.0, 90.0)  # m, from one species' stand to the next, and their ragged borders
_YOUNG = 0.16  # share of a forest's trees that are not grown
_STUNTED = 0.6  # share of their height that the highest trees lack
_STUNTED_FROM = (-130.0, 50.0)  # m above the tree line from which on they do, and where they lack most


class Site(NamedTuple):
    """What the species at places depends on; arrays that broadcast together.

    Attributes
    ----------
    x, y : int64
        LatticeArray units.
    noise : callable
        Smooth noise at these places by its name and width (m).
    z : m
    steepness : rise over run
    forest, water : masks, 0 … 1
    young : 0 … 1
        Share of the plants that have seeded themselves from a forest nearby.
    """

    x: LatticeArray
    y: LatticeArray
    noise: Callable[[str, float], FloatArray]
    z: FloatArray
    steepness: FloatArray
    forest: FloatArray
    water: FloatArray
    young: FloatArray


class Mix(NamedTuple):
    """Shares of species: of shrubs among all plants, of conifers among trees, of either's first species."""

    shrub: FloatArray
    conifer: FloatArray
    pine: FloatArray
    birch: FloatArray

    @property
    def full_density(self) -> FloatArray:
        """Plants on a square metre of a full stand of these."""
        conifers = self.pine * _FULL[_PINE] + (1 - self.pine) * _FULL[_SPRUCE]
        broadleaves = self.birch * _FULL[_BIRCH] + (1 - self.birch) * _FULL[_OAK]
        trees = self.conifer * conifers + (1 - self.conifer) * broadleaves
        return np.asarray(self.shrub * _FULL[SHRUB] + (1 - self.shrub) * trees)

    def chosen(self, draw: Callable[[str], FloatArray]) -> npt.NDArray[np.uint8]:
        """Return a species for each place by numbers in [0, 1) drawn there, by what they are for."""
        conifer = np.where(draw("pine") < self.pine, _PINE, _SPRUCE)
        broadleaf = np.where(draw("birch") < self.birch, _BIRCH, _OAK)
        tree = np.where(draw("conifer") < self.conifer, conifer, broadleaf)
        return np.where(draw("shrub") < self.shrub, SHRUB, tree).astype(np.uint8)


def species_mix(recipe: TerrainRecipe, site: Site) -> Mix:
    """Return the shares of species at places."""
    climate = recipe.climate
    belt = ramp(site.z, climate["tree_line"] - 2 * _CONIFER_BELT, climate["tree_line"] - 0.3 * _CONIFER_BELT)
    conifers = _conifers(recipe, site.x, site.y, 0.22 + 0.78 * belt)
    # Pines hold dry and steep ground, birches come first to edges and stand with their feet wet.
    dry = 0.7 * ramp(site.steepness, 0.25, 0.7) + 0.7 * climate["aridity"]
    pines = _stands(site, "pine", dry - 0.45)
    birches = _stands(site, "birch", 0.35 * (site.forest < EDGE) + 0.5 * (site.water > 0.02) - 0.3)
    # Shrubs stand in the open, at forest edges and where it is dry.
    open_ground = 0.3 * (site.forest < OUTSIDE) + 0.3 * site.young
    shrubs = np.clip(0.08 + 1.25 * climate["aridity"] ** 2 + open_ground, 0, 1)
    return Mix(shrubs, conifers, pines, birches)


def tree_size(
    draw: Callable[[str], FloatArray],
    forest: FloatArray,
    above_tree_line: FloatArray,
    young: npt.NDArray[np.bool_],
    shrub: npt.NDArray[np.bool_],
) -> FloatArray:
    """Return sizes: most are grown; trees get lower towards a forest's edge and the tree line (m)."""
    size = draw("scale")
    grown = 0.65 + 0.6 * size**2
    edge = np.where((forest > 0) & (forest < EDGE), 0.6 + 0.4 * forest / EDGE, 1.0)
    small = young | ((forest >= OUTSIDE) & (draw("young") < _YOUNG))
    stunted = 1 - _STUNTED * ramp(above_tree_line, *_STUNTED_FROM)
    return np.where(shrub, grown, stunted * np.where(small, 0.22 + 0.38 * size, grown * edge))


def _stands(site: Site, name: str, lean: FloatArray) -> FloatArray:
    """Share of a species against its rival, 0.05 … 0.95: either in stands; `lean` above 0 favours it."""
    wide, narrow = (site.noise(name, width) for width in _STANDS)
    return np.asarray(np.clip(0.5 + 4.0 * (0.75 * wide + 0.25 * narrow - 0.5) + lean, 0.05, 0.95))


def _conifers(
    recipe: TerrainRecipe, x: LatticeArray, y: LatticeArray, by_elevation: FloatArray
) -> FloatArray:
    """Share of conifers at places: the mean of the forests there, by how much each covers a place."""
    if not (by_elevation.size and recipe.has_conifer_shares):
        return by_elevation
    near = features_near(recipe, _around(x, y), min_radius=0.0)
    forests = near[near["type"] == FEATURE_TYPES.index("forest")]
    share = conifer_share(forests["peakiness"])
    if not (share >= 0).any():
        return by_elevation
    x, y = np.broadcast_arrays(x, y)
    places = np.stack([x.ravel(), y.ravel()], axis=-1) * metres_per_unit(recipe.extent)
    centres = np.stack([forests["x"], forests["y"]], axis=-1)
    radii = support_radii(recipe) * forests["radius"].astype(np.float64)
    members = cKDTree(places).query_ball_point(centres, radii, return_sorted=True)
    own = by_elevation.ravel()
    change, weights = np.zeros((2, own.size))
    # One after the other in the order of their ids, and none where no forest says a share: the same bits
    # whatever else lies in the rectangle.
    for said, i, centre, radius in zip(share, members, centres, radii, strict=True):
        cover = np.maximum(1 - np.sum((places[i] - centre) ** 2, axis=-1) / radius**2, 0)
        weights[i] += cover
        if said >= 0:
            change[i] += cover * (said - own[i])
    return np.asarray(own + change / np.where(weights > 0, weights, 1)).reshape(by_elevation.shape)


def _around(x: LatticeArray, y: LatticeArray) -> LatticeArray:
    """Return the rectangle around places, or one for each block of them, shape (n, 4)."""
    flat = [each.reshape(len(each) if each.ndim > 1 else 1, -1) for each in (x, y)]
    return np.stack([*(each.min(axis=1) for each in flat), *(each.max(axis=1) for each in flat)], axis=-1)
