"""Grid of shards of a world, and its ground."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.document.parameters import MATERIALS
from sketchterrain.errors import InputError

SHARD: Final = 2048
"""Vertices along the side of a shard: what is computed and written at once, a file of each layer."""
CHUNK: Final = 256
"""Vertices along the side of a chunk: what is read at once."""


class Shard(NamedTuple):
    """A rectangle of a level's vertices: its place in the level's grid of shards, 0 the north-west one."""

    level: int
    row: int
    column: int


@dataclass(frozen=True)
class Level:
    """One grid of a pyramid. Vertex (row j, column i) lies at (west + i·cell, north − j·cell).

    Level 0 is the finest; each has twice the cell of the one before: metres between vertices, and what the
    terrain is band-limited to. `columns` and `rows` are of vertices.
    """

    number: int
    cell: float
    columns: int
    rows: int

    @property
    def shards(self) -> tuple[int, int]:
        """Rows and columns of shards."""
        return -(-self.rows // SHARD), -(-self.columns // SHARD)

    def size_of(self, shard: Shard) -> tuple[int, int]:
        """Return how many rows and columns of vertices a shard holds: fewer at the south and east edges."""
        return min(SHARD, self.rows - shard.row * SHARD), min(SHARD, self.columns - shard.column * SHARD)


@dataclass(frozen=True)
class World:
    """A rectangle of the world (m) at a cell size (m), and the coarser levels over it.

    The finest level has a vertex at each corner where the sides are whole numbers of cells; else the
    rectangle is widened eastward and southward to the next one. A coarser level reaches as far or up to a
    cell farther, so every level covers it all: the world does not end there.
    """

    west: float
    south: float
    east: float
    north: float
    cell: float

    def __post_init__(self) -> None:
        numbers = (self.west, self.south, self.east, self.north, self.cell)
        if not all(math.isfinite(number) for number in numbers):
            raise InputError(f"expected finite bounds and cell, got {numbers}")
        if not (self.west < self.east and self.south < self.north):
            raise InputError(
                f"expected bounds west < east and south < north, got {self.west:g},{self.south:g},"
                f"{self.east:g},{self.north:g}"
            )
        if self.cell <= 0:
            raise InputError(f"expected a cell of more than 0 m, got {self.cell:g}")

    @property
    def levels(self) -> tuple[Level, ...]:
        """All levels, the finest first; the last one fits into a chunk."""
        across = _cells(self.east - self.west, self.cell)
        down = _cells(self.north - self.south, self.cell)
        found = []
        for number in range(64):
            step = 1 << number
            columns, rows = -(-across // step) + 1, -(-down // step) + 1
            found.append(Level(number, self.cell * step, columns, rows))
            if max(columns, rows) <= CHUNK:
                break
        return tuple(found)

    @property
    def vertices(self) -> int:
        """Of all levels."""
        return sum(level.columns * level.rows for level in self.levels)

    @property
    def shard_count(self) -> int:
        """Of all levels."""
        return sum(math.prod(level.shards) for level in self.levels)

    def shards(self) -> Iterator[Shard]:
        """Return every shard, without a list of them: the coarse levels first, rows from the north."""
        for level in reversed(self.levels):
            for row, column in product(*map(range, level.shards)):
                yield Shard(level.number, row, column)


def _cells(length: float, cell: float) -> int:
    """Return how many cells cover a length; a billionth of one too many is rounding."""
    cells = length / cell
    whole = round(cells)
    return max(whole if abs(cells - whole) <= 1e-9 * max(cells, 1.0) else math.ceil(cells), 1)


@dataclass(frozen=True)
class LayerSpec:
    """How a layer is stored; the benchmark ``packing`` shows why it is compressed in this way.

    `dimension` names that of the bands in Zarr; empty: the array has rows and columns only. `shuffle` and
    `clevel` are Blosc's filter and the level of its Zstandard, `predictor` is GDAL's, `attributes` are of the
    Zarr array.
    """

    bands: tuple[str, ...]
    dtype: Literal["float32", "uint8"]
    dimension: str
    shuffle: Literal["noshuffle", "shuffle", "bitshuffle"]
    clevel: int
    predictor: Literal["NO", "STANDARD", "FLOATING_POINT"]
    attributes: dict[str, Any] = field(hash=False)

    def shape(self, rows: int, columns: int) -> tuple[int, ...]:
        """Return the shape of an array of so many vertices."""
        return (len(self.bands), rows, columns) if self.dimension else (rows, columns)


_HEIGHT: Final = {"long_name": "height of the ground", "units": "m"}
_NORMAL: Final = {
    "long_name": "unit vector up from the ground: east, north, up",
    "axes": ["east", "north", "up"],
    "units": "1",
    "scale_factor": 1 / 127.5,
    "add_offset": -1.0,
}
_MATERIALS: Final = {
    "long_name": "share of each material, of 1 in all",
    "materials": list(MATERIALS),
    "units": "1",
    "scale_factor": 1 / 255,
}
LAYER_SPECS: Final = {
    "height": LayerSpec(("height",), "float32", "", "shuffle", 3, "FLOATING_POINT", _HEIGHT),
    "normal": LayerSpec(("east", "north", "up"), "uint8", "axis", "bitshuffle", 1, "STANDARD", _NORMAL),
    # Weights are mostly 0 or 255: differences only cost.
    "materials": LayerSpec(MATERIALS, "uint8", "material", "noshuffle", 1, "NO", _MATERIALS),
}
"""By name; `Ground` tells what the values mean."""
LAYERS: Final = tuple(LAYER_SPECS)


@dataclass(frozen=True, eq=False)
class Ground:
    """What is known at each vertex of a shard; row 0 is the northernmost, column 0 the westernmost.

    Heights (rows, columns) are in m; normals (3, rows, columns) are east, north, up, 0 is −1, 255 is 1;
    materials (materials, rows, columns) are weights that sum to 255 at each vertex.
    """

    shard: Shard
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.uint8]
    materials: npt.NDArray[np.uint8]
