"""Spacing of plants over the terrain: a raster of the world, cached in blocks."""

from __future__ import annotations

import math
from collections import OrderedDict
from typing import TYPE_CHECKING, Protocol

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.spacing_raster import SpacingRaster

if TYPE_CHECKING:
    from collections.abc import Generator

    import numpy.typing as npt

    from sketchterrain.array_types import LatticeArray


BLOCK = 64
"""Vertices along a block's side."""
FILL = 0.65
"""Points per squared spacing that the sampler achieves."""

_AT_ONCE = 32  # blocks of one evaluation
_PER_STEP = 4  # blocks
_CACHED = 4096  # blocks: 64 MiB
_BEYOND = 1.2  # times the greatest spacing, where nothing grows; no more, or woods would end a vertex early


class SpacingRule(Protocol):
    """Density of a storey's plants."""

    step: int  # lattice units between vertices of the raster
    least: int  # range of spacing, lattice units
    most: int

    def densities(self, x: LatticeArray, y: LatticeArray) -> npt.NDArray[np.floating]:
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
        self._cache: OrderedDict[tuple[int, int], npt.NDArray[np.float32]] = OrderedDict()

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

    def prefetch_steps(self, west: int, south: int, east: int, north: int) -> Generator[None, None, None]:
        """Cache the blocks that a raster of a rectangle (lattice units) needs, in steps of a few ms."""
        columns, rows = (
            _blocks_of(_vertices(low, high, self._rule.step)) for low, high in ((west, east), (south, north))
        )
        keys = [(column, row) for row in rows for column in columns]
        missing = [key for key in keys if key not in self._cache]
        for start in range(0, min(len(missing), _CACHED), _PER_STEP):
            yield
            self.blocks(missing[start : start + _PER_STEP])

    def blocks(self, keys: list[tuple[int, int]]) -> list[npt.NDArray[np.float32]]:
        """Return blocks of BLOCK² vertices by column and row, counted from the world's origin."""
        missing = [key for key in keys if key not in self._cache]
        computed: dict[tuple[int, int], npt.NDArray[np.float32]] = {}
        for start in range(0, len(missing), _AT_ONCE):
            part = missing[start : start + _AT_ONCE]
            computed.update(zip(part, self._compute(part), strict=True))
        blocks = []
        for key in keys:
            block = computed[key] if key in computed else self._cache[key]
            blocks.append(block)
            self._cache[key] = block
            self._cache.move_to_end(key)
        while len(self._cache) > _CACHED:
            self._cache.popitem(last=False)
        return blocks

    def _compute(self, keys: list[tuple[int, int]]) -> npt.NDArray[np.float32]:
        rule = self._rule
        along = np.arange(BLOCK, dtype=np.int64)
        x, y = (rule.step * (BLOCK * each[:, None] + along) for each in np.array(keys, np.int64).T)
        spacing = spacing_of(rule.densities(x, y)) / self._unit
        return np.clip(spacing, rule.least, _BEYOND * rule.most).astype(np.float32)


def spacing_of(density: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Return the spacing (m) of plants at a density (per square metre)."""
    return np.asarray(np.sqrt(FILL / np.maximum(density, 1e-12)), np.float64)


def density_of(spacing: npt.NDArray[np.floating] | float) -> npt.NDArray[np.float64]:
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
