"""How far plants stand apart, over the ground: a raster of the world, made and kept in blocks."""

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

    Lattice = npt.NDArray[np.int64]

BLOCK = 64
"""Vertices along a block's side."""
FILL = 0.65
"""Points on a square whose side is the distance between them, as the sampler leaves them."""

_AT_ONCE = 32  # blocks of one evaluation
_A_STEP = 4  # blocks that are made in a step
_KEPT = 4096  # blocks: 64 MiB
_BEYOND = 1.2  # times the greatest spacing, where nothing stands; no more, or woods would end a vertex early


class SpacingRule(Protocol):
    """What decides about the spacing of a storey's plants.

    Attributes
    ----------
    step : int
        Lattice units between vertices of the raster.
    least, most : int
        Range of spacing, lattice units.
    """

    step: int
    least: int
    most: int

    def densities(self, x: Lattice, y: Lattice) -> npt.NDArray[np.floating]:
        """Return plants on a square metre at the vertices of blocks.

        Parameters
        ----------
        x, y
            Lattice coordinates along the blocks' axes, shapes (blocks, n), ascending, ``step`` apart.

        Returns
        -------
        ndarray, shape (blocks, n, n)
            Row 0 southernmost. A value depends on its vertex alone, not on what else is asked for.
        """
        ...


class SpacingBlocks:
    """The spacing of a storey's plants, a function of the world.

    Parameters
    ----------
    rule
    extent
        Metres along the sketch's longer side.
    """

    def __init__(self, rule: SpacingRule, extent: float) -> None:
        self._rule = rule
        self._unit = metres_per_unit(extent)
        self._kept: OrderedDict[tuple[int, int], npt.NDArray[np.float32]] = OrderedDict()

    def raster(self, west: int, south: int, east: int, north: int) -> SpacingRaster:
        """Return the vertices in and around a rectangle (lattice units), a row or column beyond each border.

        Values are lattice units; more than the rule's greatest where nothing stands.
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

    def made_steps(self, west: int, south: int, east: int, north: int) -> Generator[None, None, None]:
        """Make what a raster of a rectangle (lattice units) needs, in steps of a few ms."""
        columns, rows = (
            _blocks_of(_vertices(low, high, self._rule.step)) for low, high in ((west, east), (south, north))
        )
        keys = [(column, row) for row in rows for column in columns]
        missing = [key for key in keys if key not in self._kept]
        for start in range(0, min(len(missing), _KEPT), _A_STEP):
            yield
            self.blocks(missing[start : start + _A_STEP])

    def blocks(self, keys: list[tuple[int, int]]) -> list[npt.NDArray[np.float32]]:
        """Return blocks of BLOCK² vertices by their columns and rows, counted from the world's origin."""
        missing = [key for key in keys if key not in self._kept]
        made: dict[tuple[int, int], npt.NDArray[np.float32]] = {}
        for start in range(0, len(missing), _AT_ONCE):
            part = missing[start : start + _AT_ONCE]
            made.update(zip(part, self._made(part), strict=True))
        blocks = []
        for key in keys:
            block = made[key] if key in made else self._kept[key]
            blocks.append(block)
            self._kept[key] = block
            self._kept.move_to_end(key)
        while len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return blocks

    def _made(self, keys: list[tuple[int, int]]) -> npt.NDArray[np.float32]:
        rule = self._rule
        along = np.arange(BLOCK, dtype=np.int64)
        x, y = (rule.step * (BLOCK * each[:, None] + along) for each in np.array(keys, np.int64).T)
        spacing = spacing_of(rule.densities(x, y)) / self._unit
        return np.clip(spacing, rule.least, _BEYOND * rule.most).astype(np.float32)


def spacing_of(density: npt.NDArray[np.floating]) -> npt.NDArray[np.float64]:
    """Return the distance between plants (m) that so many on a square metre keep."""
    return np.asarray(np.sqrt(FILL / np.maximum(density, 1e-12)), np.float64)


def density_of(spacing: npt.NDArray[np.floating] | float) -> npt.NDArray[np.float64]:
    """Return how many plants there are on a square metre where they keep a distance (m)."""
    return np.asarray(FILL / np.square(np.asarray(spacing, np.float64)))


def widened(axis: Lattice, step: int, *, rim: int = 1) -> Lattice:
    """Return blocks' axes (blocks, n) of vertices a step apart with so many more beyond each end."""
    count = axis.shape[1] + 2 * rim
    return np.asarray(axis[:, :1] + step * (np.arange(count, dtype=np.int64) - rim))


def whole_step(metres: float, extent: float) -> int:
    """Return the power of two of lattice units that is nearest to a length: what kernels evaluate fastest."""
    return 1 << max(round(math.log2(metres / metres_per_unit(extent))), 0)


def _vertices(low: int, high: int, step: int) -> tuple[int, int]:
    """Return the first of the vertices that a stretch lies between, and one past the last."""
    return low // step, -(-high // step) + 1


def _blocks_of(vertices: tuple[int, int]) -> range:
    """Return the blocks that vertices from a first to one past the last lie in."""
    return range(vertices[0] // BLOCK, (vertices[1] - 1) // BLOCK + 1)
