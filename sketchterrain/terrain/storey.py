"""One storey's plants: graded Poisson-disk points, what grows at each, and the order they come in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.features.hashing import hash_keys
from sketchterrain.terrain.graded_poisson import GradedPoisson
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.meadow import Meadow
from sketchterrain.terrain.plant import PLANT
from sketchterrain.terrain.plant_footing import PlantSites
from sketchterrain.terrain.plant_noise import PlantNoise
from sketchterrain.terrain.plant_spacing import BLOCK, FILL, SpacingBlocks, power_of_two_step
from sketchterrain.terrain.poisson import GREATEST_DENSITY
from sketchterrain.terrain.woods import Woods

if TYPE_CHECKING:
    from collections.abc import Generator, Iterator

    import numpy.typing as npt

    from sketchterrain.array_types import StructuredArray
    from sketchterrain.terrain.evaluation import Evaluator

    Area = tuple[int, int, int, int]

LEVELS: Final = 3
"""Coarser Poisson-disk sets among the plants, at twice the distance each."""

_RULES: Final[dict[str, type[Woods] | type[Meadow]]] = {"woody": Woods, "grass": Meadow}
_SQUARES: Final = {
    "woody": 2048.0,
    "grass": 256.0,
}  # m, side of the squares in whose order plants come, about
_AT_ONCE = 1 << 12  # plants whose ground is evaluated in a step
_SAMPLES = 16  # blocks along a side of those that an estimate reads
_ERRORS = 2.0  # standard errors that are added to their mean
_MARGIN = 1.3  # times as many plants as the spacing says there may be


class Storey:
    """StructuredArray of one storey, a function of the world.

    Parameters
    ----------
    evaluator
    name
        One of ``STOREYS``.
    """

    def __init__(self, evaluator: Evaluator, name: str) -> None:
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

    def bound(self, area: Area) -> int:
        """Return how many plants an area (lattice units) holds at most if they stand thickest all over it."""
        thickest = GREATEST_DENSITY / self._rule.least**2
        return math.ceil(_ground(area) * thickest + _a_row(area, thickest))

    def estimate(self, area: Area) -> int:
        """Return about how many plants an area (lattice units) holds at most, by some of its blocks."""
        if _ground(area) == 0:
            return 0
        side = BLOCK * self._rule.step
        columns, rows = (range(low // side, -(-high // side)) for low, high in _spans(area))
        if len(columns) * len(rows) <= _SAMPLES**2:
            thick = self._thick(self._spacing.raster(*area).spacing)
        else:
            blocks = self._spacing.blocks(_strewn(columns, rows))
            each = np.array([self._thick(block) for block in blocks])
            thick = float(each.mean() + _ERRORS * each.std() / math.sqrt(each.size))
        most = _MARGIN * _ground(area) * thick + _a_row(area, thick)
        return min(math.ceil(most), self.bound(area))

    def _thick(self, spacing: npt.NDArray[np.float32]) -> float:
        """Mean density of plants over a raster, per lattice unit squared."""
        apart = spacing.astype(np.float64)
        return float(np.mean(np.where(apart <= self._rule.most, FILL / apart**2, 0.0)))

    def parts(self, area: Area, *, most: int) -> Iterator[Area]:
        """Cut an area (lattice units) into parts that hold so many plants at most, along lines of the world.

        The plants of the parts, one after the other, are those of the area in their order.
        """
        west, south, east, north = area
        if _ground(area) == 0:
            return
        a_square = self.bound((0, 0, self._square, self._square))
        columns, rows = (range(low // self._square, -(-high // self._square)) for low, high in _spans(area))
        wide = min(max(most // a_square, 1), len(columns))
        high = max(most // (a_square * wide), 1) if wide == len(columns) else 1
        for row in range(rows.start, rows.stop, high):
            for column in range(columns.start, columns.stop, wide):
                yield (
                    max(west, column * self._square),
                    max(south, row * self._square),
                    min(east, (column + wide) * self._square),
                    min(north, (row + high) * self._square),
                )

    def plants_steps(self, area: Area) -> Generator[None, None, StructuredArray]:
        """Find the plants of an area (lattice units) in steps of a few ms; the last one returns them."""
        # Beforehand, for the sampler asks for all it needs at once.
        halo = self._points.halo
        west, south, east, north = area
        yield from self._spacing.prefetch_steps(west - halo, south - halo, east + halo, north + halo)
        points = yield from self._points.steps(area)
        # They come from south to north already, and stay so within the squares.
        points = points[np.lexsort((points["x"] // self._square, points["y"] // self._square))]
        found = []
        for start in range(0, len(points), _AT_ONCE):
            yield
            found.append(self._grown(points[start : start + _AT_ONCE]))
        return np.concatenate(found) if found else np.zeros(0, PLANT)

    def _grown(self, points: npt.NDArray[Any]) -> StructuredArray:
        """Return what grows at points, but for those where the ground lets nothing stand."""
        places = (np.ascontiguousarray(points[axis]) for axis in ("x", "y"))
        foot = PlantSites.evaluate(self._evaluator, *places)
        kept = self._rule.survives(foot)
        points, foot = points[kept], foot.subset(kept)
        plants = np.zeros(len(points), PLANT)
        if not len(points):
            return plants
        plants["x"], plants["y"], plants["z"] = foot.x * self._unit, foot.y * self._unit, foot.z
        plants["normal"], plants["level"] = foot.normal, points["level"]
        plants["rotation"] = 2 * np.pi * self._noise.draw("rotation", foot.x, foot.y)
        plants["tint"] = self._noise.draw("tint", foot.x, foot.y)
        self._rule.assign_species(plants, foot, points["spacing"] * self._unit)
        return plants


def _spans(area: Area) -> tuple[tuple[int, int], tuple[int, int]]:
    west, south, east, north = area
    return (west, east), (south, north)


def _sides(area: Area) -> tuple[int, int]:
    west, south, east, north = area
    return east - west, north - south


def _ground(area: Area) -> int:
    """Lattice units squared."""
    return math.prod(_sides(area))


def _a_row(area: Area, thick: float) -> float:
    """Return how many more plants of a density (on a unit squared) may stand just within the border."""
    return sum(_sides(area)) * math.sqrt(thick) + 1


def _strewn(columns: range, rows: range) -> list[tuple[int, int]]:
    """Return some of many blocks, spread evenly, none in line with those of the next row."""
    down = min(_SAMPLES, len(rows))
    some_rows = [rows[i * len(rows) // down] for i in range(down)]
    across = min(_SAMPLES**2 // len(some_rows), len(columns))
    return [
        (columns[int((i + (n + 0.5) / len(some_rows)) / across * len(columns))], row)
        for n, row in enumerate(some_rows)
        for i in range(across)
    ]
