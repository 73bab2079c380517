"""Sampling grid of a world: levels, shards, and layers of their vertices."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import product
from typing import Any, Final, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.errors import InputError
from sketchterrain.schema.materials import MATERIALS

SHARD: Final = 2048
"""Vertices along a side of a shard, the unit of computing and writing."""
CHUNK: Final = 256
"""Vertices along a side of a chunk, the unit of reading."""


class Shard(NamedTuple):
    """Level of a shard, and its row and column in the level's grid of shards from the north-west."""

    level: int
    row: int
    column: int


@dataclass(frozen=True)
class GridLevel:
    """One grid of a pyramid, `columns` × `rows` vertices; level 0 is the finest, cells (m) double per level.

    Vertex (row j, column i) is at (west + i·cell, north − j·cell). The terrain is band-limited to the cell.
    """

    number: int
    cell: float
    columns: int
    rows: int

    @property
    def shards(self) -> tuple[int, int]:
        """Numbers of rows and columns of shards."""
        return -(-self.rows // SHARD), -(-self.columns // SHARD)

    def size_of(self, shard: Shard) -> tuple[int, int]:
        """Return the rows and columns of vertices of a shard, fewer at the south and east edges."""
        return min(SHARD, self.rows - shard.row * SHARD), min(SHARD, self.columns - shard.column * SHARD)


@dataclass(frozen=True)
class World:
    """A rectangle (m) sampled at a cell size (m), and its coarser levels.

    The rectangle is widened eastward and southward to whole cells of each level.
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
    def levels(self) -> tuple[GridLevel, ...]:
        """All levels, the finest first; the last one is at most a chunk."""
        across = _cells(self.east - self.west, self.cell)
        down = _cells(self.north - self.south, self.cell)
        found = []
        for number in range(64):
            step = 1 << number
            columns, rows = -(-across // step) + 1, -(-down // step) + 1
            found.append(GridLevel(number, self.cell * step, columns, rows))
            if max(columns, rows) <= CHUNK:
                break
        return tuple(found)

    @property
    def vertices(self) -> int:
        """Number of vertices of all levels."""
        return sum(level.columns * level.rows for level in self.levels)

    @property
    def shard_count(self) -> int:
        """Number of shards of all levels."""
        return sum(math.prod(level.shards) for level in self.levels)

    def shards(self) -> Iterator[Shard]:
        """Yield every shard, the coarsest level first, rows from the north."""
        for level in reversed(self.levels):
            for row, column in product(*map(range, level.shards)):
                yield Shard(level.number, row, column)


def _cells(length: float, cell: float) -> int:
    """Return the number of cells that cover a length, with a relative tolerance of 1e-9."""
    cells = length / cell
    whole = round(cells)
    return max(whole if abs(cells - whole) <= 1e-9 * max(cells, 1.0) else math.ceil(cells), 1)


@dataclass(frozen=True)
class LayerSpec:
    """Storage of a layer; its compression is measured by the benchmark ``packing``.

    `dimension` is the Zarr name of the band dimension (empty: none), `shuffle` and `clevel` are of Blosc,
    `predictor` is of GDAL, `attributes` are of the Zarr array.
    """

    bands: tuple[str, ...]
    dtype: Literal["float32", "uint8"]
    dimension: str
    shuffle: Literal["noshuffle", "shuffle", "bitshuffle"]
    clevel: int
    predictor: Literal["NO", "STANDARD", "FLOATING_POINT"]
    attributes: dict[str, Any] = field(hash=False)

    def shape(self, rows: int, columns: int) -> tuple[int, ...]:
        """Return the array shape for a number of vertices."""
        return (len(self.bands), rows, columns) if self.dimension else (rows, columns)


_CHANNELS: Final = ("red", "green", "blue", "covered")
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
    "units": "1",
    "scale_factor": 1 / 255,
}


_APPEARANCE: Final = {
    "long_name": "square root of the albedo of roads and land use, and the share that they cover",
    "units": "1",
    "scale_factor": 1 / 255,
}


def layer_specs(materials: tuple[str, ...]) -> dict[str, LayerSpec]:
    """Return layers by name, for a world with some materials; see `ShardData` for their values."""
    named = _MATERIALS | {"materials": list(materials)}
    return {
        "height": LayerSpec(("height",), "float32", "", "shuffle", 3, "FLOATING_POINT", _HEIGHT),
        "normal": LayerSpec(("east", "north", "up"), "uint8", "axis", "bitshuffle", 1, "STANDARD", _NORMAL),
        # Weights are mostly 0 or 255: a predictor does not help.
        "materials": LayerSpec(materials, "uint8", "material", "noshuffle", 1, "NO", named),
        "appearance": LayerSpec(_CHANNELS, "uint8", "channel", "noshuffle", 1, "NO", _APPEARANCE),
    }


LAYER_SPECS: Final = layer_specs(MATERIALS)
"""Layers of a world with the program's materials."""
LAYERS: Final = tuple(LAYER_SPECS)
DEFAULT_LAYERS: Final = ("height", "normal", "materials")


@dataclass(frozen=True, eq=False)
class ShardData:
    """Layers of a shard; row 0 is the northernmost, column 0 the westernmost.

    Heights (rows, columns) in m; normals (3, rows, columns) as east, north, up, with −1 … 1 as 0 … 255;
    material weights (materials, rows, columns), which sum to 255 at each vertex; appearance (4, rows,
    columns), as `Appearance.tiles`.
    """

    shard: Shard
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.uint8]
    materials: npt.NDArray[np.uint8]
    appearance: npt.NDArray[np.uint8] = field(default_factory=lambda: np.zeros((0, 0, 0), np.uint8))
