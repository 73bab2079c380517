"""Plants: record, species, noise, terrain at plants, and spacing."""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import TYPE_CHECKING, Final, NamedTuple, Protocol, Self

import numpy as np

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, FloatArray, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.hashing import hash_unit, value_noise
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.vegetation.graded_poisson import SpacingRaster

if TYPE_CHECKING:
    from sketchterrain.terrain.evaluator import Evaluator
    from sketchterrain.terrain.recipe import TerrainRecipe

STOREYS: Final = {
    "woody": ("spruce", "pine", "oak", "birch", "shrub"),
    "grass": ("grass", "flower", "fern"),
}
"""Names of the species by storey; each storey has its own spacing and ignores the other."""

SPECIES: Final = STOREYS["woody"] + STOREYS["grass"]
"""Names of the species, in the order of the ``species`` field."""

PLANT: Final = np.dtype(
    [
        ("x", "f8"),  # m east of the sketch's south-west corner
        ("y", "f8"),  # m north of it
        ("z", "f4"),  # m, height of the ground
        ("normal", "f4", 3),  # of the ground, a unit vector: east, north, up
        ("species", "u1"),  # index into SPECIES
        ("level", "u1"),  # those of this level and above are a Poisson-disk set at 2^level times the spacing
        ("scale", "f4"),  # 1 is a mature plant
        ("rotation", "f4"),  # radians, counter-clockwise seen from above
        ("tint", "f4"),  # 0 … 1, position in its species' range of colours
    ]
)
"""One plant."""

_FOOTPRINT = 0.5  # m over which the terrain at a plant is planar

BLOCK = 64
"""Vertices along a block's side."""
FILL = 0.65
"""Points per squared spacing that the sampler achieves."""

_AT_ONCE = 32  # blocks of one evaluation
_PER_STEP = 4  # blocks
_CACHED = 4096  # blocks: 64 MiB
_BEYOND = 1.2  # times the greatest spacing, where nothing grows; no more, or woods would end a vertex early


class PlantNoise:
    """Noise of a recipe's plants: functions of the position and of a stream's name."""

    def __init__(self, recipe: TerrainRecipe) -> None:
        self._seed = recipe.seed
        self._unit = metres_per_unit(recipe.extent)

    def draw(self, stream: str, x: LatticeArray, y: LatticeArray) -> Float64Array:
        """Return one number in [0, 1) for each position (lattice units)."""
        return hash_unit(self._seed, f"plant {stream}", x, y)

    def at(self, name: str, width: float, x: LatticeArray, y: LatticeArray) -> Float64Array:
        """Return smooth noise, 0 … 1, with a period of about two widths (m), at positions (lattice units)."""
        return value_noise(self._seed, _stream(name, width), self._steps(x, width), self._steps(y, width))

    def over_grid(self, name: str, width: float, x: LatticeArray, y: LatticeArray) -> Float64Array:
        """Return the same bits on a grid: y over rows, x over columns, both ascending.

        Corners are hashed once.
        """
        columns, east, u = _cells_and_fractions(self._steps(x, width))
        rows, north, v = _cells_and_fractions(self._steps(y, width))
        corner = hash_unit(self._seed, _stream(name, width), columns[None, :], rows[:, None])
        across = (1.0 - u) * corner[:, east] + u * corner[:, east + 1]
        return np.asarray((1.0 - v[:, None]) * across[north] + v[:, None] * across[north + 1])

    def over_blocks(self, name: str, width: float, x: LatticeArray, y: LatticeArray) -> Float64Array:
        """Return the same over blocks, by their axes of shape (blocks, n); shape (blocks, n, n)."""
        return np.stack([self.over_grid(name, width, *axes) for axes in zip(x, y, strict=True)])

    def _steps(self, along: LatticeArray, width: float) -> Float64Array:
        return np.asarray(self._unit / width * along.astype(np.float64))


def ramp(x: FloatArray, low: float, high: float) -> FloatArray:
    """Return 0 up to ``low``, 1 from ``high`` on, linear between."""
    return np.asarray(np.clip((x - low) / (high - low), 0, 1))


def _stream(name: str, width: float) -> str:
    return f"plant {name} {width:g}"


def _cells_and_fractions(at: Float64Array) -> tuple[LatticeArray, LatticeArray, Float64Array]:
    """Return steps around positions, the index of the one below each, and smoothed fractions."""
    below = np.floor(at).astype(np.int64)
    u = at - below
    u = u * u * (3.0 - 2.0 * u)
    steps = int(below[-1] - below[0]) + 2
    if steps <= 2 * below.size:
        return below[0] + np.arange(steps), below - below[0], u
    return np.stack([below, below + 1], axis=-1).ravel(), 2 * np.arange(below.size), u


class PlantSites(NamedTuple):
    """Terrain at positions, shape (n,) each."""

    x: LatticeArray  # lattice units
    y: LatticeArray
    z: FloatArray  # m
    slope_east: FloatArray  # rise over run
    slope_north: FloatArray
    dune: FloatArray  # masks, 0 … 1
    forest: FloatArray
    water: FloatArray
    wetness: FloatArray

    @classmethod
    def evaluate(cls, evaluator: Evaluator, x: LatticeArray, y: LatticeArray) -> Self:
        """Evaluate the terrain at positions (lattice units)."""
        unit = metres_per_unit(evaluator.recipe.extent)
        step = max(round(_FOOTPRINT / unit), 1)
        # The position, one step east of it and one north.
        corners = np.concatenate([x, x + step, x]), np.concatenate([y, y, y + step])
        height, mask = evaluator.points(*corners, cell_size=0.0)
        z, east, north = height.reshape(3, -1).astype(np.float64)
        run, (_, *masks) = step * unit, mask[: x.size].T
        return cls(x, y, z, (east - z) / run, (north - z) / run, *masks)

    @property
    def steepness(self) -> FloatArray:
        """Rise over run."""
        return np.hypot(self.slope_east, self.slope_north)

    @property
    def normal(self) -> FloatArray:
        """Unit vectors: east, north, up; shape (n, 3)."""
        upward = 1 / np.sqrt(1 + self.slope_east**2 + self.slope_north**2)
        return np.stack([-self.slope_east * upward, -self.slope_north * upward, upward], axis=-1)

    def subset(self, mask: BoolArray) -> PlantSites:
        """Return some of the positions."""
        ground = (each[mask] for each in self[2:])
        return PlantSites(self.x[mask], self.y[mask], *ground)


class SpacingRule(Protocol):
    """Density of a storey's plants."""

    step: int  # lattice units between vertices of the raster
    least: int  # range of spacing, lattice units
    most: int

    def densities(self, x: LatticeArray, y: LatticeArray) -> FloatArray:
        """Return plants per square metre at the vertices of blocks, (blocks, n, n), row 0 southernmost.

        x, y (blocks, n) are ascending lattice coordinates, ``step`` apart. A value depends on its vertex
        alone.
        """
        ...


class SpacingBlocks:
    """Spacing of a storey's plants, a function of the world; the extent is in metres."""

    def __init__(self, rule: SpacingRule, extent: float) -> None:
        self._rule = rule
        self._unit = metres_per_unit(extent)
        self._cache = LRUCache(_CACHED)  # blocks

    def raster(self, west: int, south: int, east: int, north: int) -> SpacingRaster:
        """Return the spacing at vertices in and around a rectangle (lattice units), one beyond each border.

        Values are lattice units; more than the rule's greatest where nothing grows.
        """
        step = self._rule.step
        first, end = _vertices(west, east, step), _vertices(south, north, step)
        columns, rows = _blocks_of(first), _blocks_of(end)
        blocks = self.blocks([(column, row) for row in rows for column in columns])
        whole = np.empty((len(rows) * BLOCK, len(columns) * BLOCK), np.float32)
        for number, block in enumerate(blocks):
            row, column = (BLOCK * each for each in divmod(number, len(columns)))
            whole[row : row + BLOCK, column : column + BLOCK] = block
        left, low = BLOCK * columns[0], BLOCK * rows[0]
        part = whole[end[0] - low : end[1] - low, first[0] - left : first[1] - left]
        return SpacingRaster(first[0] * step, end[0] * step, step, np.ascontiguousarray(part))

    def prefetch_steps(
        self, west: int, south: int, east: int, north: int, *, pace: int
    ) -> Generator[None, None, None]:
        """Cache the blocks of a rectangle's raster (lattice units), in steps of ``pace`` times a few ms."""
        columns, rows = (
            _blocks_of(_vertices(low, high, self._rule.step)) for low, high in ((west, east), (south, north))
        )
        keys = [(column, row) for row in rows for column in columns]
        missing = [key for key in keys if key not in self._cache]
        for start in range(0, min(len(missing), _CACHED), pace * _PER_STEP):
            yield
            self.blocks(missing[start : start + pace * _PER_STEP])

    def blocks(self, keys: list[tuple[int, int]]) -> list[Float32Array]:
        """Return blocks of BLOCK² vertices by column and row, counted from the world's origin."""
        missing = [key for key in keys if key not in self._cache]
        computed: dict[tuple[int, int], Float32Array] = {}
        for start in range(0, len(missing), _AT_ONCE):
            part = missing[start : start + _AT_ONCE]
            computed.update(zip(part, self._compute(part), strict=True))
        known = {key: self._cache.get(key) for key in keys if key not in computed}
        for key, block in computed.items():
            self._cache.store(key, block)
        return [known[key] if key in known else computed[key] for key in keys]

    def _compute(self, keys: list[tuple[int, int]]) -> Float32Array:
        rule = self._rule
        along = np.arange(BLOCK, dtype=np.int64)
        x, y = (rule.step * (BLOCK * each[:, None] + along) for each in np.array(keys, np.int64).T)
        density = np.maximum(rule.densities(x, y), 1e-12)
        spacing = np.asarray(np.sqrt(FILL / density), np.float64) / self._unit
        return np.clip(spacing, rule.least, _BEYOND * rule.most).astype(np.float32)


def density_of(spacing: FloatArray | float) -> Float64Array:
    """Return the density (per square metre) of plants at a spacing (m)."""
    return np.asarray(FILL / np.square(np.asarray(spacing, np.float64)))


def padded_axes(axis: LatticeArray, step: int, *, rim: int = 1) -> LatticeArray:
    """Return blocks' axes (blocks, n) of vertices a step apart, with ``rim`` more beyond each end."""
    count = axis.shape[1] + 2 * rim
    return np.asarray(axis[:, :1] + step * (np.arange(count, dtype=np.int64) - rim))


def power_of_two_step(metres: float, extent: float) -> int:
    """Return the power of two of lattice units nearest to a length (m), which kernels evaluate fastest."""
    return 1 << max(round(math.log2(metres / metres_per_unit(extent))), 0)


def _vertices(low: int, high: int, step: int) -> tuple[int, int]:
    """Return the range (end exclusive) of the vertices around an interval."""
    return low // step, -(-high // step) + 1


def _blocks_of(vertices: tuple[int, int]) -> range:
    """Return the blocks of a range of vertices."""
    return range(vertices[0] // BLOCK, (vertices[1] - 1) // BLOCK + 1)
