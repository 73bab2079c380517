"""Foliage of a rectangle: trees, shrubs, grass and flowers."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import (
    BoolArray,
    Bounds,
    Float32Array,
    FloatArray,
    Int64Array,
    LatticeArray,
    StructuredArray,
)
from sketchterrain.caching import LRUCache
from sketchterrain.errors import InputError
from sketchterrain.geometry.hashing import hash_keys
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.roads.built_ground import BuiltGround, trees_along
from sketchterrain.vegetation.farmland import ROWS, Farmland, PlantedRows
from sketchterrain.vegetation.graded_poisson import GradedPoisson, run_to_completion
from sketchterrain.vegetation.plants import (
    BLOCK,
    FILL,
    PLANT,
    SPECIES,
    STOREYS,
    PlantNoise,
    PlantSites,
    SpacingBlocks,
    density_of,
    padded_axes,
    power_of_two_step,
    ramp,
)
from sketchterrain.vegetation.poisson_grids import GREATEST_DENSITY
from sketchterrain.vegetation.woods import Woods

if TYPE_CHECKING:
    from sketchterrain.terrain.evaluator import Evaluator

    Area = tuple[int, int, int, int]

MIN_SPACING: Final = 0.5
"""Spacing (m) of tufts at the greatest density."""
MAX_SPACING: Final = 4.0
"""Spacing (m) of single plants; none grow where it would be wider."""
CELL: Final = 2.0
"""Approximate distance (m) between the raster's vertices."""

_PATCHES = (23.0, 6.0)  # m: wavelengths of dense patches and of their ragged borders
_THIN = 0.3  # density between patches, over the density in them
_DROUGHT = 0.8  # share of plants missing in a desert
_SHADED = (0.1, 0.6)  # forest mask from which ferns grow, and at which they are most frequent
_FERNS = 0.75  # greatest share of ferns on a moist forest floor
_BLOOM = (48.0, 9.0)  # m: wavelengths of patches of flowers and of their ragged borders
_FLOWERS = (0.02, 0.4)  # share of flowers between patches and in their centre
_DAMP = (0.05, 0.5)  # water mask from which grass is taller, and at which it is tallest
_MOIST = (0.3, 1.3)  # … and the same of the wetness
_LOWER_UP = (-150.0, 200.0)  # m above the tree line, between which plants get lower
_STEEPEST = 1.3  # rise over run at which tufts still hold
_WATERSIDE = (0.72, 0.8)  # water mask from which plants are reeds, and from which it is too wet
_REEDS = 3.5  # height of reeds over that of the same plant on land
_GRASS, _FLOWER, _FERN = (SPECIES.index(name) for name in ("grass", "flower", "fern"))

LEVELS: Final = 3
"""Coarser Poisson-disk sets nested in the plants, each of twice the distance."""

_SQUARES: Final = {"woody": 2048.0, "grass": 256.0}
"""Approximate side (m) of the squares by which plants are sorted."""
_VERGES: Final = {"woody": 3.0, "grass": 0.1}
"""Distance (m) that plants keep from carriageways."""
_AVENUE: Final = -1
_PLANTED: Final = {_AVENUE: PlantedRows("oak", 0.8, 0.0, 0.0, 0.0), **ROWS}  # by crop; trees of avenues
_AT_ONCE = 1 << 12  # plants evaluated in a step
_PACE = 8  # times as much is done in a step of pieces, between which nobody waits
_SAMPLES = 16  # blocks along a side that an estimate reads
_ERRORS = 2.0  # standard errors added to their mean
_MARGIN = 1.3  # safety factor on the density

MAX_PLANTS: Final = 20_000_000
"""Most plants returned at once."""

_MAX_PER_PIECE = 4_000_000


class Meadow:
    """Grass, flowers and ferns of a recipe; see :class:`SpacingRule` for step, least and most."""

    def __init__(self, evaluator: Evaluator) -> None:
        recipe = evaluator.recipe
        self._evaluator = evaluator
        self._climate = recipe.climate
        self._noise = PlantNoise(recipe)
        unit = metres_per_unit(recipe.extent)
        self.step = power_of_two_step(CELL, recipe.extent)
        self.least, self.most = max(round(MIN_SPACING / unit), 2), max(round(MAX_SPACING / unit), 4)
        self._cell = self.step * unit
        spacings = [each.spacing for each in recipe.materials]
        full = [0.0 if least is None else float(density_of(least)) for least in spacings]
        self._full = np.array(full, np.float32)

    def densities(self, x: LatticeArray, y: LatticeArray) -> FloatArray:
        """Return plants per square metre; see :class:`SpacingRule`."""
        padded_x, padded_y = (padded_axes(each, self.step) for each in (x, y))
        surface = self._evaluator.surface(padded_x, padded_y[:, ::-1], cell_size=self._cell)
        density = np.zeros(surface.height.shape, np.float32)
        # One material after the other: the order of a library's sums is unspecified.
        for material, full in enumerate(self._full):
            if full > 0:
                density += full * surface.materials[:, ::-1, :, material]
        wide, narrow = (self._noise.over_blocks("tufts", width, x, y) for width in _PATCHES)
        thick = _THIN + (1 - _THIN) * ramp(0.6 * wide + 0.4 * narrow, 0.2, 0.6)
        return np.asarray(density * (thick * (1 - _DROUGHT * self._climate["aridity"] ** 2)))

    def survives(self, sites: PlantSites) -> BoolArray:
        """Return which plants can grow at their exact positions."""
        return np.asarray((sites.steepness < _STEEPEST) & (sites.water < _WATERSIDE[1]))

    def assign_species(self, plants: npt.NDArray[Any], sites: PlantSites, spacing: FloatArray) -> None:
        """Write the species and scale of plants; neither depends on the spacing (m)."""
        x, y, dry = sites.x, sites.y, self._climate["aridity"]
        ferns = _FERNS * (1 - dry) * ramp(sites.forest, *_SHADED)
        wide, narrow = (self._noise.at("bloom", width, x, y) for width in _BLOOM)
        bloom = ramp(0.7 * wide + 0.3 * narrow, 0.55, 0.8) * (1 - dry) * (1 - ramp(sites.forest, *_SHADED))
        flowers = _FLOWERS[0] + (_FLOWERS[1] - _FLOWERS[0]) * bloom
        fern = self._noise.draw("fern", x, y) < ferns
        flower = self._noise.draw("flower", x, y) < flowers
        flower &= sites.water < _WATERSIDE[0]
        plants["species"] = np.where(fern, _FERN, np.where(flower, _FLOWER, _GRASS))
        above = sites.z - self._climate["tree_line"]
        damp = np.maximum(ramp(sites.water, *_DAMP), ramp(sites.wetness, *_MOIST))
        lush = (1 + 0.5 * damp) * (1 - 0.4 * ramp(above, *_LOWER_UP)) * (1 - 0.35 * dry)
        lush = np.where(sites.water > _WATERSIDE[0], _REEDS, lush)
        plants["scale"] = (0.6 + 0.7 * self._noise.draw("tuft scale", x, y)) * lush


_RULES: Final[dict[str, type[Woods] | type[Meadow]]] = {"woody": Woods, "grass": Meadow}


class Storey:
    """Plants of one storey of ``STOREYS``, a function of the world."""

    def __init__(self, evaluator: Evaluator, name: str, built: BuiltGround) -> None:
        recipe = evaluator.recipe
        self._evaluator = evaluator
        self._unit = metres_per_unit(recipe.extent)
        self._rule = _RULES[name](evaluator)
        self._spacing = SpacingBlocks(self._rule, recipe.extent)
        self._noise = PlantNoise(recipe)
        self._points = GradedPoisson(
            evaluator.context,
            self._spacing.raster,
            least=self._rule.least,
            most=self._rule.most,
            levels=LEVELS,
            seed=int(hash_keys(recipe.seed, f"plants {name}")),
        )
        self._square = power_of_two_step(_SQUARES[name], recipe.extent)
        self._built = built
        self._verge = _VERGES[name]
        trees = trees_along(recipe.network) if name == "woody" else np.zeros((0, 2))
        self._planted = to_lattice(trees, recipe.extent)
        self._farmland = Farmland(evaluator, name)
        self._rows = LRUCache(4)  # planted places of areas, asked for by bounds, estimates and steps

    def bound(self, area: Area) -> int:
        """Return the greatest possible number of plants in an area (lattice units)."""
        thickest = GREATEST_DENSITY / self._rule.least**2
        planted = len(self._planted_in(area)[0])
        return math.ceil(_lattice_units(area) * thickest + _border_surplus(area, thickest)) + planted

    def estimate(self, area: Area) -> int:
        """Return an estimate, rarely exceeded, of the number of plants in an area (lattice units)."""
        if _lattice_units(area) == 0:
            return 0
        columns, rows = _squares(area, BLOCK * self._rule.step)
        if len(columns) * len(rows) <= _SAMPLES**2:
            density = self._density(self._spacing.raster(*area).spacing)
        else:
            blocks = self._spacing.blocks(_stratified_blocks(columns, rows))
            each = np.array([self._density(block) for block in blocks])
            density = float(each.mean() + _ERRORS * each.std() / math.sqrt(each.size))
        most = _MARGIN * _lattice_units(area) * density + _border_surplus(area, density)
        return min(math.ceil(most) + len(self._planted_in(area)[0]), self.bound(area))

    def _density(self, spacing: Float32Array) -> float:
        """Return the mean density of plants over a raster, per lattice unit squared."""
        apart = spacing.astype(np.float64)
        return float(np.mean(np.where(apart <= self._rule.most, FILL / apart**2, 0.0)))

    def parts(self, area: Area, *, most: int) -> Iterator[Area]:
        """Cut an area (lattice units) into parts of at most so many plants, along lines of the world.

        Concatenated, the plants of the parts are those of the area in order.
        """
        west, south, east, north = area
        if _lattice_units(area) == 0:
            return
        per_square = self.bound((0, 0, self._square, self._square))
        columns, rows = _squares(area, self._square)
        wide = min(max(most // per_square, 1), len(columns))
        high = max(most // (per_square * wide), 1) if wide == len(columns) else 1
        for row in range(rows.start, rows.stop, high):
            for column in range(columns.start, columns.stop, wide):
                yield (
                    max(west, column * self._square),
                    max(south, row * self._square),
                    min(east, (column + wide) * self._square),
                    min(north, (row + high) * self._square),
                )

    def plants_steps(self, area: Area, *, pace: int = 1) -> Generator[None, None, StructuredArray]:
        """Find the plants of an area (lattice units) in steps of ``pace`` times a few ms; return them."""
        # In advance, as the sampler reads the whole raster at once.
        halo = self._points.halo
        west, south, east, north = area
        yield from self._spacing.prefetch_steps(
            west - halo, south - halo, east + halo, north + halo, pace=pace
        )
        points = yield from self._points.steps(area)
        # Points are sorted from south to north, and remain so within the squares.
        points = points[np.lexsort((points["x"] // self._square, points["y"] // self._square))]
        plants = []
        for start in range(0, len(points), pace * _AT_ONCE):
            yield
            plants.append(self._grown(points[start : start + pace * _AT_ONCE]))
        found = np.concatenate(plants) if plants else np.zeros(0, PLANT)
        places, crops = self._planted_in(area)
        return self._with_planted(found, places, crops) if len(places) else found

    def _planted_in(self, area: Area) -> tuple[LatticeArray, Int64Array]:
        """Return places (lattice units) of plants along roads and in rows in an area, and their crops."""
        found: tuple[LatticeArray, Int64Array] = self._rows.get_or_compute(area, lambda: self._plant(area))
        return found

    def _plant(self, area: Area) -> tuple[LatticeArray, Int64Array]:
        west, south, east, north = area
        x, y = self._planted.T
        along = self._planted[(x >= west) & (x < east) & (y >= south) & (y < north)]
        rows, crops = self._farmland.rows_in(area)
        at = np.asarray(rows * self._unit, np.float64)
        free = ~self._built.is_near(at, self._verge)
        return np.concatenate([along, rows[free]]), np.append(np.full(len(along), _AVENUE), crops[free])

    def _with_planted(
        self, plants: StructuredArray, places: LatticeArray, crops: Int64Array
    ) -> StructuredArray:
        """Return plants with planted ones, after the others of their square."""
        sites = PlantSites.evaluate(self._evaluator, places[:, 0].copy(), places[:, 1].copy())
        trees = self._records(sites)
        above = sites.z > self._evaluator.recipe.climate["tree_line"]
        for crop, rows in _PLANTED.items():
            own = crops == crop
            trees["species"][own], trees["scale"][own] = SPECIES.index(rows.species), rows.scale
        trees["level"] = LEVELS
        trees["scale"] *= 0.9 + 0.2 * self._noise.draw("avenue", sites.x, sites.y)
        every = np.concatenate([plants, trees[~above]])
        column, row = (np.floor(every[axis] / (self._square * self._unit)) for axis in ("x", "y"))
        return np.asarray(every[np.lexsort((column, row))])

    def _records(self, sites: PlantSites) -> StructuredArray:
        """Return plants at sites, without species and scale."""
        plants = np.zeros(len(sites.x), PLANT)
        if not len(plants):
            return plants
        plants["x"], plants["y"], plants["z"] = sites.x * self._unit, sites.y * self._unit, sites.z
        plants["normal"] = sites.normal
        plants["rotation"] = 2 * np.pi * self._noise.draw("rotation", sites.x, sites.y)
        plants["tint"] = self._noise.draw("tint", sites.x, sites.y)
        return plants

    def _grown(self, points: npt.NDArray[Any]) -> StructuredArray:
        """Return the plants at points, except where they cannot grow."""
        places = (np.ascontiguousarray(points[axis]) for axis in ("x", "y"))
        sites = PlantSites.evaluate(self._evaluator, *places)
        surviving = self._rule.survives(sites)
        at = np.asarray(np.stack([sites.x, sites.y], axis=1) * self._unit, np.float64)
        surviving &= ~self._built.is_near(at, self._verge)
        surviving[surviving] = ~self._farmland.is_bare(sites.x[surviving], sites.y[surviving])
        points, sites = points[surviving], sites.subset(surviving)
        plants = self._records(sites)
        plants["level"] = points["level"]
        if len(points):
            self._rule.assign_species(plants, sites, points["spacing"] * self._unit)
        return plants


def _squares(area: Area, side: int) -> tuple[range, range]:
    west, south, east, north = area
    return range(west // side, -(-east // side)), range(south // side, -(-north // side))


def _sides(area: Area) -> tuple[int, int]:
    west, south, east, north = area
    return east - west, north - south


def _lattice_units(area: Area) -> int:
    return math.prod(_sides(area))


def _border_surplus(area: Area, thick: float) -> float:
    """Return how many more plants of a density there may be just inside the border."""
    return sum(_sides(area)) * math.sqrt(thick) + 1


def _stratified_blocks(columns: range, rows: range) -> list[tuple[int, int]]:
    """Return some of many blocks, evenly spread, rows staggered."""
    down = min(_SAMPLES, len(rows))
    some_rows = [rows[i * len(rows) // down] for i in range(down)]
    across = min(_SAMPLES**2 // len(some_rows), len(columns))
    return [
        (columns[int((i + (n + 0.5) / len(some_rows)) / across * len(columns))], row)
        for n, row in enumerate(some_rows)
        for i in range(across)
    ]


class FoliageSampler:
    """Plants of a recipe on a device, in rectangles (west, south, east, north), m."""

    def __init__(self, evaluator: Evaluator) -> None:
        self._extent = evaluator.recipe.extent
        built = BuiltGround(evaluator.recipe.network)
        self._storeys = {name: Storey(evaluator, name, built) for name in STOREYS}

    def within(self, rectangle: Bounds, storey: str = "woody") -> StructuredArray:
        """Return the plants of a rectangle; see :meth:`Terrain.foliage`."""
        return run_to_completion(self.steps(rectangle, storey))

    def steps(self, rectangle: Bounds, storey: str) -> Generator[None, None, StructuredArray]:
        """Do the same in steps; see :meth:`Terrain.foliage_steps`."""
        layer, area = self._validate(rectangle, storey)
        if layer.bound(area) > MAX_PLANTS:
            most, size = self.estimate(rectangle, storey)
            if most > MAX_PLANTS:
                raise InputError(
                    f"the rectangle may hold {most:.3g} plants ({size / 2**30:.1f} GiB); "
                    f"expected at most {MAX_PLANTS} at once, more in pieces"
                )
        parts = []
        for part in layer.parts(area, most=_MAX_PER_PIECE):
            plants = yield from layer.plants_steps(part)
            parts.append(plants)
        return np.concatenate(parts) if parts else np.zeros(0, PLANT)

    def pieces(self, rectangle: Bounds, storey: str = "woody") -> Iterator[StructuredArray]:
        """Return the same piece by piece; see :meth:`Terrain.foliage_pieces`."""
        layer, area = self._validate(rectangle, storey)
        parts = layer.parts(area, most=_MAX_PER_PIECE)
        return (run_to_completion(layer.plants_steps(part, pace=_PACE)) for part in parts)

    def estimate(self, rectangle: Bounds, storey: str = "woody") -> tuple[int, int]:
        """Return an upper estimate of the number of plants, and their bytes."""
        layer, area = self._validate(rectangle, storey)
        most = layer.estimate(area)
        return most, most * PLANT.itemsize

    def _validate(self, rectangle: Bounds, storey: str) -> tuple[Storey, Area]:
        if storey not in self._storeys:
            raise InputError(f"expected a storey, {' or '.join(STOREYS)}, got {storey!r}")
        west, south, east, north = (int(each) for each in to_lattice(rectangle, self._extent))
        if west > east or south > north:
            given = ", ".join(f"{each:g}" for each in rectangle)
            raise InputError(f"expected west ≤ east and south ≤ north, got {given}")
        return self._storeys[storey], (west, south, east, north)
