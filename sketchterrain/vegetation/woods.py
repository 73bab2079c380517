"""Trees and shrubs: species, site preferences, selection."""

from __future__ import annotations

from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from sketchterrain.placement.feature_types import FEATURE_TYPES, conifer_share
from sketchterrain.terrain.culling import features_near
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.packing import support_radii
from sketchterrain.vegetation.plants import (
    STOREYS,
    PlantNoise,
    density_of,
    padded_axes,
    power_of_two_step,
    ramp,
)

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.array_types import FloatArray, LatticeArray
    from sketchterrain.terrain.evaluator import Evaluator
    from sketchterrain.terrain.recipe import TerrainRecipe
    from sketchterrain.vegetation.plants import PlantSites


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


LEAST: Final = 4.0
"""m between trees or shrubs where they stand thickest."""
MOST: Final = 63.9
"""m between lone ones; where they would stand thinner none does."""
CELL: Final = 8.0
"""m between the raster's vertices, about."""

_LONE = 0.00040  # plants on a square metre outside forests where it is not dry, on the mean
_GROUPS = (190.0, 55.0)  # m, from group to group of those, and from thicket to thicket in a group
_BETWEEN, _IN_GROUP = 0.25, 7.0  # times as many as on the mean stand between groups, and in the midst of one
_THIN, _THICK = 0.42, 0.86  # noise from which on a group gets thicker, and where it is thickest
_DRY_GAPS = 0.21  # how much more of that noise the gaps take where it is dry: few groups, but groups
_RIPARIAN = 1.5  # times as many more of those on a bank
_BANK = (0.05, 0.5)  # water mask from which on it is one, and where it is one through and through
_STEEPEST = 1.0  # rise over run on which trees hold
_LESS_STEEP = 0.75  # rise over run from which on fewer do
_TREE_LINE = 60.0  # m about the tree line in which they get fewer
_WATERSIDE = 0.7  # water mask from which on it is too wet
_FRINGE = 0.028  # plants on a bare square metre amid a full forest that have seeded themselves from it
_SEED_FLIES = 22.0  # m: how far


class Woods:
    """Trees and shrubs of a recipe.

    Parameters
    ----------
    evaluator

    Attributes
    ----------
    step, least, most : int
        See :class:`SpacingRule`.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        recipe = evaluator.recipe
        self._evaluator = evaluator
        self._recipe = recipe
        self._noise = PlantNoise(recipe)
        unit = metres_per_unit(recipe.extent)
        self.step = power_of_two_step(CELL, recipe.extent)
        self.least, self.most = round(LEAST / unit), round(MOST / unit)
        self._cell = self.step * unit
        # Vertices that seeds reach the next ones from.
        self._rim = int(_SEED_FLIES / self._cell)

    def densities(self, x: LatticeArray, y: LatticeArray) -> FloatArray:
        """Return plants on a square metre; see :class:`SpacingRule`."""
        rim = self._rim
        wide_x, wide_y = (padded_axes(each, self.step, rim=rim) for each in (x, y))
        height, mask = self._evaluator.heights_and_masks(wide_x, wide_y[:, ::-1], cell_size=self._cell)
        height, mask = height[:, ::-1], mask[:, :, ::-1]
        inner = (slice(None), slice(rim, -rim), slice(rim, -rim))
        _, dune, forest, water = (mask[:, kind][inner] for kind in range(4))
        z, steepness = height[inner], self._steepness(height)
        wide, narrow = (self._noise.over_blocks("group", width, x, y) for width in _GROUPS)
        lone = self._lone(wide, narrow, dune, water)
        beside = _FRINGE * np.maximum(self._around(mask[:, 2]) - forest, 0)
        young = beside / (beside + lone + 1e-9) * (forest < OUTSIDE)
        density = lone + beside
        some = forest.any(axis=(1, 2))
        if some.any():
            over = partial(self._noise.over_blocks, x=x[some], y=y[some])
            ground = (part[some] for part in (z, steepness, forest, water, young))
            site = Site(x[some, None, :], y[some, :, None], over, *ground)
            wood = forest[some] * species_mix(self._recipe, site).full_density
            density[some] = np.maximum(wood, lone[some]) + beside[some]
        return np.asarray(density * self._hold(z, steepness))

    def survives(self, foot: PlantSites) -> npt.NDArray[np.bool_]:
        """Tell which plants the exact place lets stand."""
        too_high = foot.z >= self._recipe.climate["tree_line"] + _TREE_LINE
        return np.asarray((foot.steepness < _STEEPEST) & ~too_high & (foot.water < _WATERSIDE))

    def assign_species(self, plants: npt.NDArray[Any], foot: PlantSites, spacing: FloatArray) -> None:
        """Give plants their species and scale.

        Parameters
        ----------
        plants
            Of dtype ``PLANT``, written.
        foot
            Where they stand.
        spacing
            m to the next ones.
        """
        draw = partial(self._noise.draw, x=foot.x, y=foot.y)
        at = partial(self._noise.at, x=foot.x, y=foot.y)
        wide, narrow = (at("group", width) for width in _GROUPS)
        lone = self._lone(wide, narrow, foot.dune, foot.water)
        # Thicker than lone ones stand outside a forest, they have seeded themselves from it.
        young = (foot.forest < OUTSIDE) & (draw("seed") >= lone / density_of(spacing))
        ground = (foot.z, foot.steepness, foot.forest, foot.water, young.astype(np.float64))
        site = Site(foot.x, foot.y, at, *ground)
        plants["species"] = species_mix(self._recipe, site).chosen(draw)
        above = foot.z - self._recipe.climate["tree_line"]
        plants["scale"] = tree_size(draw, foot.forest, above, young, plants["species"] == SHRUB)

    def _lone(self, wide: FloatArray, narrow: FloatArray, dune: FloatArray, water: FloatArray) -> FloatArray:
        """Plants on a square metre outside forests: in loose groups, few between them; more beside water."""
        dry = self._recipe.climate["aridity"]
        thick = ramp(0.65 * wide + 0.35 * narrow, _THIN + _DRY_GAPS * dry, _THICK) ** 2
        between = _BETWEEN * (1 - dry)
        share = np.sqrt(1 - dry) * (between + (_IN_GROUP - between) * thick)
        return np.asarray(_LONE * share * (1 - dune) * (1 + _RIPARIAN * ramp(water, *_BANK)))

    def _hold(self, z: FloatArray, steepness: FloatArray) -> FloatArray:
        """Share of plants, 0 … 1, that the slope and the height leave."""
        tree_line = self._recipe.climate["tree_line"]
        warm = 1 - ramp(z, tree_line - _TREE_LINE, tree_line + _TREE_LINE)
        return np.asarray(warm * (1 - ramp(steepness, _LESS_STEEP, _STEEPEST)))

    def _steepness(self, height: FloatArray) -> FloatArray:
        """Rise over run within the rim, by central differences."""
        rim = self._rim
        near = height[:, rim - 1 : height.shape[1] - rim + 1, rim - 1 : height.shape[2] - rim + 1]
        east = near[:, 1:-1, 2:] - near[:, 1:-1, :-2]
        north = near[:, 2:, 1:-1] - near[:, :-2, 1:-1]
        return np.asarray(np.sqrt(east * east + north * north) / np.float32(2 * self._cell))

    def _around(self, forest: FloatArray) -> FloatArray:
        """Mean of a mask over the disc that seeds fly from, within the rim."""
        rim = self._rim
        side = forest.shape[-1] - 2 * rim
        total = np.zeros((len(forest), side, side), forest.dtype)
        if not forest.any():
            return total
        reach = (_SEED_FLIES / self._cell) ** 2
        shifts = [(i, j) for i, j in product(range(-rim, rim + 1), repeat=2) if i * i + j * j <= reach]
        for i, j in shifts:
            total += forest[:, rim + i : rim + i + side, rim + j : rim + j + side]
        return np.asarray(total / np.float32(len(shifts)))
