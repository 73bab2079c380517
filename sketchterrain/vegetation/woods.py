"""Woody layer: density, species and size of trees and shrubs."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float32Array, FloatArray, LatticeArray, UInt8Array
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.landforms.placement.feature_types import conifer_share, has_parameter
from sketchterrain.landuse.areas import FOREST
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.points import support_radii
from sketchterrain.vegetation.plants import (
    BLOCK,
    STOREYS,
    PlantNoise,
    PlantSites,
    density_of,
    padded_axes,
    power_of_two_step,
    ramp,
)

if TYPE_CHECKING:
    from sketchterrain.terrain.evaluator import Evaluator

OUTSIDE = 0.22
"""Forest mask below which a position is outside."""
EDGE = (0.35, 0.95)
"""Depth into a forest, see :meth:`Woods.depths`, between which trees reach their full height."""

_SPRUCE, _PINE, _OAK, _BIRCH, SHRUB = range(len(STOREYS["woody"]))
_SPACING = (5.0, 5.9, 6.6, 4.4, 3.8)
"""Spacing (m) of plants in a full stand of each species."""
_FULL = tuple(float(density_of(apart)) for apart in _SPACING)
_CONIFER_BELT = 450.0  # m below the tree line over which conifers become dominant
_STANDS = (420.0, 90.0)  # m: wavelengths of stands of one species, and of their ragged borders
_MIXED = (0.9, 75.0)  # share of pure stands of conifers and broadleaves; m: their wavelength
_NORTHERN = 0.5  # conifers for a slope of 1 down to the north, beside what the elevation gives
_WET_GROUND = 0.3  # loss of conifers on wet ground
_YOUNG = 0.10  # share of a stand's trees that are young
_AGES = (110.0, 38.0)  # m: wavelengths of stands of one age, and of their borders
_AGE_RANGE = (0.20, 0.44)  # noise below which a stand is a thicket, and above which it is mature
_THICKET, _MATURE = 0.50, 1.08  # heights of trees in them, over those of a forest of all ages
_CROWDED, _THINNED = 0.50, 0.20  # surplus of trees in a thicket, and loss in a mature stand
_MANTLE = (0.30, 0.48, 0.62, 0.88)  # depths where a mantle of shrubs begins, is full, and ends
_MANTLE_SHRUBS = 0.6  # share of shrubs in it
_MANTLE_COVER = 0.5  # its least cover over that of the forest behind it
_MANTLE_HEIGHT = 1.1  # surplus height of its shrubs
_EDGE_HEIGHT = 0.42  # height of trees at the very edge, over that inside
_STAND_TINT = 0.6  # share of a plant's tint that its stand decides
_STUNTED = 0.6  # greatest loss of height near the tree line
_STUNTED_FROM = (-130.0, 50.0)  # m above the tree line where the loss begins, and where it is greatest

MIN_SPACING: Final = 4.0
"""Spacing (m) of trees or shrubs at the greatest density."""
MAX_SPACING: Final = 63.9
"""Spacing (m) of isolated plants; none grow where it would be wider."""
CELL: Final = 8.0
"""Approximate distance (m) between the raster's vertices."""

_LONE = 0.00040  # mean plants per square metre outside forests in a moist climate
_GROUPS = (190.0, 55.0)  # m: wavelengths of their groups, and of thickets within a group
_BETWEEN, _IN_GROUP = 0.25, 7.0  # density between groups and in the centre of one, over the mean
_THIN, _THICK = 0.42, 0.86  # noise from which a group gets denser, and where it is densest
_DRY_GAPS = 0.21  # widening of the gaps, in units of that noise, in a dry climate: few groups, but groups
_RIPARIAN = 1.5  # increase on a bank
_BANK_SHRUBS = 0.03  # shrubs per square metre in thickets of willow and alder along banks
_ALDERS = 0.3  # share of trees in them
_THICKETS = (70.0, 17.0)  # m: wavelengths of these thickets, and of their ragged borders
_THICKET_NOISE = (0.45, 0.62)  # noise from which a thicket begins, and is dense
_THICKET_BANK = (0.15, 0.4)  # water mask between which they begin
_ON_FLOORS = 0.8  # … and on the floors of valleys
_BANK = (0.05, 0.5)  # water mask where a bank begins, and where the increase is full
_MOIST = (0.3, 0.9)  # wetness where it begins and is full on the floors of valleys
_STEEPEST = 1.0  # rise over run at which trees still hold
_LESS_STEEP = 0.75  # rise over run from which there are fewer
_TREE_LINE = 60.0  # m below and above the tree line over which trees thin out
_WATERSIDE = 0.7  # water mask from which it is too wet
_FRINGE = 0.028  # self-seeded plants per bare square metre amid a full forest
_SEED_RANGE = 22.0  # m
_CACHED = 1024  # blocks of depths: 16 MiB


class SpeciesInputs(NamedTuple):
    """Inputs of the choice of species; arrays that broadcast together."""

    x: LatticeArray
    y: LatticeArray
    noise: Callable[[str, float], FloatArray]  # smooth noise at these positions by its name and width (m)
    z: FloatArray  # m
    steepness: FloatArray  # rise over run
    northern: FloatArray  # drop over run, to the north
    depth: FloatArray  # into a forest
    forest: FloatArray  # masks, 0 … 1
    water: FloatArray
    wetness: FloatArray
    young: FloatArray  # share of self-seeded plants from a forest nearby


class SpeciesMix(NamedTuple):
    """Shares: of shrubs among all plants, of conifers among trees, of the first species of either."""

    shrub: FloatArray
    conifer: FloatArray
    pine: FloatArray
    birch: FloatArray

    @property
    def full_density(self) -> FloatArray:
        """Plants per square metre in a full stand."""
        conifers = self.pine * _FULL[_PINE] + (1 - self.pine) * _FULL[_SPRUCE]
        broadleaves = self.birch * _FULL[_BIRCH] + (1 - self.birch) * _FULL[_OAK]
        trees = self.conifer * conifers + (1 - self.conifer) * broadleaves
        return np.asarray(self.shrub * _FULL[SHRUB] + (1 - self.shrub) * trees)

    def draw_species(self, draw: Callable[[str], FloatArray]) -> UInt8Array:
        """Return a species for each position, from random numbers in [0, 1) by stream."""
        conifer = np.where(draw("pine") < self.pine, _PINE, _SPRUCE)
        broadleaf = np.where(draw("birch") < self.birch, _BIRCH, _OAK)
        tree = np.where(draw("conifer") < self.conifer, conifer, broadleaf)
        return np.where(draw("shrub") < self.shrub, SHRUB, tree).astype(np.uint8)


def species_mix(evaluator: Evaluator, site: SpeciesInputs) -> SpeciesMix:
    """Return the shares of species at positions."""
    climate = evaluator.recipe.climate
    belt = ramp(site.z, climate["tree_line"] - 2 * _CONIFER_BELT, climate["tree_line"] - 0.3 * _CONIFER_BELT)
    moist = ramp(site.wetness, *_MOIST)
    shady = _NORTHERN * np.clip(site.northern, -0.5, 0.5) - _WET_GROUND * moist
    conifers = _conifers(evaluator, site.x, site.y, np.clip(0.22 + 0.78 * belt + shady, 0.0, 1.0))
    # Stands of one kind stand beside each other; their mean is the site's share.
    pure = np.clip(4.0 * (site.noise("mixed", _MIXED[1]) - 0.5), -0.5, 0.5)
    conifers = np.clip(conifers + 4.0 * _MIXED[0] * conifers * (1 - conifers) * pure, 0.0, 1.0)
    # Pines prefer dry and steep slopes; birches pioneer edges and tolerate wet soil.
    dry = 0.7 * ramp(site.steepness, 0.25, 0.7) + 0.7 * climate["aridity"] - 0.3 * moist
    pines = _stands(site, "pine", dry - 0.45)
    wet = np.maximum(site.water > 0.02, 0.6 * moist)
    birches = _stands(site, "birch", 0.35 * (site.depth < EDGE[1]) + 0.5 * wet - 0.3)
    # Shrubs grow in the open, at forest edges and in dry climates.
    open_ground = 0.3 * (site.forest < OUTSIDE) + 0.3 * site.young + _MANTLE_SHRUBS * mantle(site.depth)
    shrubs = np.clip(0.08 + 1.25 * climate["aridity"] ** 2 + open_ground, 0, 1)
    return SpeciesMix(shrubs, conifers, pines, birches)


def mantle(depth: FloatArray) -> FloatArray:
    """Return how much of a forest's mantle of shrubs and low trees a depth has, 0 … 1."""
    begin, full, ending, end = _MANTLE
    return np.asarray(ramp(depth, begin, full) * (1 - ramp(depth, ending, end)))


def maturity(noise: Callable[[str, float], FloatArray]) -> FloatArray:
    """Return the age of the stands at positions: 0 a thicket … 1 mature."""
    wide, narrow = (noise("age", width) for width in _AGES)
    return ramp(0.8 * wide + 0.2 * narrow, *_AGE_RANGE)


def tree_size(
    draw: Callable[[str], FloatArray],
    site: SpeciesInputs,
    above_tree_line: FloatArray,
    shrub: BoolArray,
) -> FloatArray:
    """Return sizes: as old as their stand; lower towards a forest's edge and the tree line (m)."""
    size, inside = draw("scale"), site.forest >= OUTSIDE
    age = np.where(inside, maturity(site.noise), 1.0)
    stand = _THICKET + (_MATURE - _THICKET) * age
    # A thicket is even; old trees differ.
    grown = stand * (0.85 - 0.2 * age + (0.2 + 0.4 * age) * size**2)
    edge = np.where(site.forest > 0, _EDGE_HEIGHT + (1 - _EDGE_HEIGHT) * ramp(site.depth, *EDGE), 1.0)
    small = (site.young > 0) | (inside & (draw("young") < _YOUNG * age))
    stunted = 1 - _STUNTED * ramp(above_tree_line, *_STUNTED_FROM)
    bush = (0.65 + 0.6 * size**2) * (1 + _MANTLE_HEIGHT * mantle(site.depth))
    return np.where(shrub, bush, stunted * np.where(small, 0.22 + 0.38 * size, grown * edge))


def _stands(site: SpeciesInputs, name: str, lean: FloatArray) -> FloatArray:
    """Return the share of a species against its rival, 0.05 … 0.95, in stands; `lean` above 0 favours it."""
    wide, narrow = (site.noise(name, width) for width in _STANDS)
    return np.asarray(np.clip(0.5 + 4.0 * (0.75 * wide + 0.25 * narrow - 0.5) + lean, 0.05, 0.95))


def _conifers(evaluator: Evaluator, x: LatticeArray, y: LatticeArray, by_elevation: FloatArray) -> FloatArray:
    """Return the share of conifers: as forests of land use ask for, else as painted ones do."""
    share = _painted_conifers(evaluator, x, y, by_elevation)
    layer = evaluator.recipe[LandUseLayer]
    asked = np.where(layer.areas.use == FOREST, layer.areas.conifers, -1.0)
    if not (asked >= 0.0).any():
        return share
    x, y = np.broadcast_arrays(x, y)
    area = layer.areas_at(x.ravel(), y.ravel(), evaluator.recipe.world)
    own = np.where(area >= 0, asked[area], -1.0).reshape(share.shape)
    return np.where(own >= 0.0, own, share)


def _painted_conifers(
    evaluator: Evaluator, x: LatticeArray, y: LatticeArray, by_elevation: FloatArray
) -> FloatArray:
    """Return the share of conifers: the mean of the forests at a position, weighted by their cover."""
    recipe = evaluator.recipe
    if not (by_elevation.size and recipe.points.has_conifer_shares):
        return by_elevation
    near = evaluator.features_near(_bounding_blocks(x, y))
    forests = near[has_parameter(near, "conifers")]
    share = conifer_share(forests["peakiness"])
    if not (share >= 0).any():
        return by_elevation
    x, y = np.broadcast_arrays(x, y)
    places = np.stack([x.ravel(), y.ravel()], axis=-1) * metres_per_unit(recipe.extent)
    centres = np.stack([forests["x"], forests["y"]], axis=-1)
    radii = support_radii(recipe.world.fidelity) * forests["radius"].astype(np.float64)
    members = cKDTree(places).query_ball_point(centres, radii, return_sorted=True)
    own = by_elevation.ravel()
    change, weights = np.zeros((2, own.size))
    # In the order of ids, without forests that set no share: the same bits whatever the rectangle.
    for target, i, centre, radius in zip(share, members, centres, radii, strict=True):
        cover = np.maximum(1 - np.sum((places[i] - centre) ** 2, axis=-1) / radius**2, 0)
        weights[i] += cover
        if target >= 0:
            change[i] += cover * (target - own[i])
    return np.asarray(own + change / np.where(weights > 0, weights, 1)).reshape(by_elevation.shape)


def _bounding_blocks(x: LatticeArray, y: LatticeArray) -> LatticeArray:
    """Return the rectangle around positions, or one for each block of them, shape (n, 4)."""
    flat = [each.reshape(len(each) if each.ndim > 1 else 1, -1) for each in (x, y)]
    return np.stack([*(each.min(axis=1) for each in flat), *(each.max(axis=1) for each in flat)], axis=-1)


class Woods:
    """Trees and shrubs of a recipe; see :class:`SpacingRule` for step, least and most."""

    def __init__(self, evaluator: Evaluator) -> None:
        recipe = evaluator.recipe
        self._evaluator = evaluator
        self._recipe = recipe
        self._noise = PlantNoise(recipe)
        unit = metres_per_unit(recipe.extent)
        self.step = power_of_two_step(CELL, recipe.extent)
        self.least, self.most = round(MIN_SPACING / unit), round(MAX_SPACING / unit)
        self._cell = self.step * unit
        # Vertices within the seeds' range.
        self._rim = int(_SEED_RANGE / self._cell)
        self._depths = LRUCache(_CACHED)

    def densities(self, x: LatticeArray, y: LatticeArray) -> FloatArray:
        """Return plants per square metre; see :class:`SpacingRule`."""
        rim = self._rim
        padded_x, padded_y = (padded_axes(each, self.step, rim=rim) for each in (x, y))
        height, mask = self._evaluator.heights_and_masks(padded_x, padded_y[:, ::-1], cell_size=self._cell)
        height, mask = height[:, ::-1], mask[:, :, ::-1]
        inner = (slice(None), slice(rim, -rim), slice(rim, -rim))
        _, dune, forest, water, wet = (mask[:, kind][inner] for kind in range(5))
        z, (east, north) = height[inner], self._slopes(height)
        steepness = np.sqrt(east * east + north * north)
        wide, narrow = (self._noise.over_blocks("group", width, x, y) for width in _GROUPS)
        lone = self._lone(wide, narrow, dune, water, wet)
        mean, most = self._surroundings(mask[:, 2])
        depth = mean / np.maximum(most, 1e-6)
        for block, column, row in zip(depth, x[:, 0], y[:, 0], strict=True):
            self._depths.store(self._block(column, row), block)
        beside = _FRINGE * np.maximum(mean - forest, 0)
        young = beside / (beside + lone + 1e-9) * (forest < OUTSIDE)
        banks = (water > _THICKET_BANK[0]).any(axis=(1, 2))
        if banks.any():
            over = partial(self._noise.over_blocks, x=x[banks], y=y[banks])
            wide, narrow = (over("thicket", width) for width in _THICKETS)
            lone[banks] += self._thickets(wide, narrow, water[banks])
        density = lone + beside
        some = forest.any(axis=(1, 2))
        if some.any():
            over = partial(self._noise.over_blocks, x=x[some], y=y[some])
            ground = (part[some] for part in (z, steepness, -north, depth, forest, water, wet, young))
            site = SpeciesInputs(x[some, None, :], y[some, :, None], over, *ground)
            stocked = np.maximum(forest, _MANTLE_COVER * mantle(depth) * most * (forest > 0))[some]
            age = maturity(over)
            crowded = 1 + _CROWDED * (1 - age) - _THINNED * age
            wood = stocked * crowded * species_mix(self._evaluator, site).full_density
            density[some] = np.maximum(wood, lone[some]) + beside[some]
        return np.asarray(density * self._survival(z, steepness))

    def survives(self, sites: PlantSites) -> BoolArray:
        """Return which plants can grow at their exact positions."""
        too_high = sites.z >= self._recipe.climate["tree_line"] + _TREE_LINE
        return np.asarray((sites.steepness < _STEEPEST) & ~too_high & (sites.water < _WATERSIDE))

    def assign_species(self, plants: npt.NDArray[Any], sites: PlantSites, spacing: FloatArray) -> None:
        """Write the species and scale of ``PLANT`` records from their sites and spacing (m)."""
        draw = partial(self._noise.draw, x=sites.x, y=sites.y)
        at = cache(partial(self._noise.at, x=sites.x, y=sites.y))
        wide, narrow = (at("group", width) for width in _GROUPS)
        bank = sites.water > _THICKET_BANK[0]
        at_bank = partial(self._noise.at, x=sites.x[bank], y=sites.y[bank])
        thicket, ragged = (at_bank("thicket", width) for width in _THICKETS)
        thickets = np.zeros(sites.x.shape)
        thickets[bank] = self._thickets(thicket, ragged, sites.water[bank])
        lone = self._lone(wide, narrow, sites.dune, sites.water, sites.wetness) + thickets
        # Plants in excess of isolated ones outside a forest have seeded themselves from it.
        young = (sites.forest < OUTSIDE) & (draw("seed") >= lone / density_of(spacing))
        slopes = sites.steepness, -sites.slope_north
        masks = sites.forest, sites.water, sites.wetness, young.astype(np.float64)
        depth = self.depths(sites.x, sites.y)
        site = SpeciesInputs(sites.x, sites.y, at, sites.z, *slopes, depth, *masks)
        species = species_mix(self._evaluator, site).draw_species(draw)
        riparian = np.where(draw("alder") < _ALDERS, _BIRCH, SHRUB)
        plants["species"] = np.where(draw("thicket") * lone < thickets, riparian, species)
        above = sites.z - self._recipe.climate["tree_line"]
        plants["scale"] = tree_size(draw, site, above, plants["species"] == SHRUB)
        # Neighbours are alike, more than trees at random.
        stand = np.clip(0.5 + 1.6 * (at("age", _AGES[1]) - 0.5), 0.0, 1.0)
        plants["tint"] = (1 - _STAND_TINT) * plants["tint"] + _STAND_TINT * stand

    def depths(self, x: LatticeArray, y: LatticeArray) -> Float32Array:
        """Return depths into forests at the vertices nearest to positions (lattice units).

        Mean of the mask within the seeds' range over its maximum: 0 far outside, about 1/2 at the edge, 1
        inside, however sparse the forest.
        """
        column, row = ((each + self.step // 2) // self.step for each in (x, y))
        blocks, inverse = np.unique(np.stack([column // BLOCK, row // BLOCK]), axis=1, return_inverse=True)
        along = self.step * np.arange(BLOCK, dtype=np.int64)
        found = np.zeros((blocks.shape[1], BLOCK, BLOCK), np.float32)
        for number, key in enumerate(zip(*blocks.tolist(), strict=True)):
            block = self._depths.get(key)
            if block is None:
                corner = (self.step * BLOCK * np.array([[each]], np.int64) + along for each in key)
                self.densities(*corner)
                block = self._depths.get(key)
            found[number] = block
        return found[inverse.ravel(), row % BLOCK, column % BLOCK]

    def _block(self, x: int, y: int) -> tuple[int, int]:
        """Return the column and row of the block with a south-west vertex (lattice units)."""
        return int(x) // (self.step * BLOCK), int(y) // (self.step * BLOCK)

    def _thickets(self, wide: FloatArray, narrow: FloatArray, water: FloatArray) -> FloatArray:
        """Return shrubs per square metre in thickets along banks: stretches of shore, others are bare."""
        share = ramp(0.7 * wide + 0.3 * narrow, *_THICKET_NOISE) * ramp(water, *_THICKET_BANK)
        return np.asarray(_BANK_SHRUBS * (1 - self._recipe.climate["aridity"] ** 2) * share)

    def _lone(
        self, wide: FloatArray, narrow: FloatArray, dune: FloatArray, water: FloatArray, wet: FloatArray
    ) -> FloatArray:
        """Return isolated plants per square metre: in loose groups, few between them; more on wet ground."""
        dry = self._recipe.climate["aridity"]
        thick = ramp(0.65 * wide + 0.35 * narrow, _THIN + _DRY_GAPS * dry, _THICK) ** 2
        between = _BETWEEN * (1 - dry)
        share = np.sqrt(1 - dry) * (between + (_IN_GROUP - between) * thick)
        more = np.maximum(_RIPARIAN * ramp(water, *_BANK), _ON_FLOORS * ramp(wet, *_MOIST))
        return np.asarray(_LONE * share * (1 - dune) * (1 + more))

    def _survival(self, z: FloatArray, steepness: FloatArray) -> FloatArray:
        """Return the share of plants, 0 … 1, that slope and height allow."""
        tree_line = self._recipe.climate["tree_line"]
        warm = 1 - ramp(z, tree_line - _TREE_LINE, tree_line + _TREE_LINE)
        return np.asarray(warm * (1 - ramp(steepness, _LESS_STEEP, _STEEPEST)))

    def _slopes(self, height: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return rise over run to the east and to the north within the rim, by central differences."""
        rim, run = self._rim, np.float32(2 * self._cell)
        near = height[:, rim - 1 : height.shape[1] - rim + 1, rim - 1 : height.shape[2] - rim + 1]
        east = near[:, 1:-1, 2:] - near[:, 1:-1, :-2]
        north = near[:, 2:, 1:-1] - near[:, :-2, 1:-1]
        return east / run, north / run

    def _surroundings(self, forest: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the mean and the maximum of a mask over a disc of the seeds' range, within the rim."""
        rim = self._rim
        side = forest.shape[-1] - 2 * rim
        total, most = np.zeros((2, len(forest), side, side), forest.dtype)
        if not forest.any():
            return total, most
        radius_squared = (_SEED_RANGE / self._cell) ** 2
        shifts = [
            (i, j) for i, j in product(range(-rim, rim + 1), repeat=2) if i * i + j * j <= radius_squared
        ]
        for i, j in shifts:
            near = forest[:, rim + i : rim + i + side, rim + j : rim + j + side]
            total += near
            np.maximum(most, near, out=most)
        return total / np.float32(len(shifts)), most
