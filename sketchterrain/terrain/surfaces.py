"""Results of an evaluation: tiles, rasters, and stores of surfaces and vertices on the device."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Protocol, Self

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import (
    Bounds,
    Float32Array,
    FloatArray,
    LatticeArray,
    StructuredArray,
    UInt8Array,
)
from sketchterrain.errors import DeviceFailedError, InputError
from sketchterrain.geometry.lattice import QUADS
from sketchterrain.landforms.placement.feature_types import Lake, River
from sketchterrain.roads.road_types import NO_ROADS, RoadNetwork
from sketchterrain.schema.materials import weight_words

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.compute.device import Device
    from sketchterrain.landforms.placement.plateaus import Plateau
    from sketchterrain.terrain.recipe import TerrainRecipe


@dataclass(frozen=True)
class Tile:
    """One tile of 64×64 quads; row 0 is its north edge.

    Attributes
    ----------
    level, column, row : int
        The tile covers [column, column + 1] × [row, row + 1] · extent/2^level metres.
    bounds : tuple of float
        West, south, east, north, m.
    cell_size : float
        Metres between vertices.
    detail_bound : float
        Upper bound (m) of the difference between heights at full detail and at this level within the tile.
    height : ndarray of float32, shape (65, 65)
        Metres.
    normal : ndarray of float32, shape (65, 65, 3)
        Unit vectors: east, north, up.
    materials : ndarray of float32, shape (65, 65, materials)
        Weights in the order of ``Terrain.materials``; they sum to 1.
    parent_height, parent_normal : ndarray of float32, shapes (65, 65) and (65, 65, 3)
        Values of the parent tile at these vertices: bit-equal at shared vertices; between two of the parent's
        vertices half their sum, along its edges or its diagonals from north-west to south-east.
    """

    level: int
    column: int
    row: int
    bounds: Bounds
    cell_size: float
    detail_bound: float
    height: Float32Array
    normal: Float32Array
    materials: Float32Array
    parent_height: Float32Array
    parent_normal: Float32Array


@dataclass(frozen=True)
class Raster:
    """The whole sketch as images of rows × columns vertices; row 0 is the north edge."""

    spacing: tuple[float, float]  # m between columns and between rows
    height: Float32Array  # as in `Tile`, for all vertices
    normal: Float32Array
    materials: Float32Array


@dataclass(frozen=True)
class Drainage:
    """The sketch's nodes of drained ground, extent / 256 apart; row 0 is the northernmost."""

    spacing: float  # m; the south-westernmost node is the sketch's corner
    area: Float32Array  # (rows, columns), m² that drain through each node
    wetness: UInt8Array  # (rows, columns), 0 … 255


@dataclass(frozen=True)
class Band:
    """Some rows of a grid of vertices, from row ``top`` of the grid; row 0 is the band's north edge."""

    top: int
    height: Float32Array
    normal: Float32Array
    materials: Float32Array


@dataclass(frozen=True)
class TerrainFeatures:
    """Placed features: points (mountains, hills, dunes, forests) in and near the sketch; plateaus; waters."""

    points: StructuredArray  # dtype ``FEATURE``, by id
    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...] = ()
    sea_level: float | None = None  # m; None: no sea
    plateaus: tuple[Plateau, ...] = ()
    network: RoadNetwork = NO_ROADS

    @classmethod
    def from_recipe(cls, recipe: TerrainRecipe, size: tuple[float, float]) -> TerrainFeatures:
        """Return a recipe's features: all painted ones, and the fill inside a sketch of a size (m)."""
        points = np.concatenate([recipe.points.painted, recipe.points.fill.within(0.0, 0.0, *size)])
        ordered = points[np.argsort(points["id"], kind="stable")]
        return cls(ordered, recipe.rivers, recipe.lakes, recipe.sea_level, recipe.plateaus, recipe.network)


def require_finite(values: npt.NDArray[Any], what: str, device: Device) -> None:
    """Raise DeviceFailedError if any value is not finite.

    No recipe gives such values, so the device failed.
    """
    bad = values.size - int(np.count_nonzero(np.isfinite(values)))
    if bad:
        raise non_finite(what, device, f"{bad} of {values.size}")


def non_finite(what: str, device: Device, count: str) -> DeviceFailedError:
    """Return the error for a count of non-finite values, for example ``"3 of 4225"`` ``"heights"``."""
    return DeviceFailedError(
        f"{device.name} ({device.platform}) produced non-finite {what} (NaN or Inf): {count}"
    )


@dataclass(frozen=True)
class Surface:
    """Normals, heights and materials of patches of n×n vertices, as a device writes them."""

    ground: FloatArray  # (patches, n, n, 4): unit normal (east, north, up), height (m)
    materials: FloatArray  # (patches, n, n, materials): weights that sum to 1
    parent: FloatArray  # as ``ground``: the parents' values; (0, n, n, 4) unless requested

    @property
    def height(self) -> FloatArray:
        """Heights (patches, n, n), m."""
        return self.ground[..., 3]

    @property
    def normal(self) -> FloatArray:
        """Unit vectors (patches, n, n, 3): east, north, up."""
        return self.ground[..., :3]

    @classmethod
    def empty(
        cls, count: int, inner: int, materials: int, *, real: npt.DTypeLike, parents: bool = False
    ) -> Self:
        """Return uninitialised arrays for ``count`` patches of inner × inner vertices."""
        shape = (inner, inner)
        return cls(
            np.empty((count, *shape, 4), real),
            np.empty((count, *shape, materials), real),
            np.empty((count if parents else 0, *shape, 4), real),
        )

    def part(self, part: slice) -> Surface:
        """Return views of some of the patches."""
        return Surface(self.ground[part], self.materials[part], self.parent[part])


class SurfaceStore:
    """Device buffers with slots for patches of inner × inner vertices.

    ``ground`` and ``parent`` have four REAL per vertex (unit normal, height), ``materials`` their number.
    """

    def __init__(self, context: ComputeContext, inner: int, slots: int, materials: int) -> None:
        self.context = context
        self.inner = inner
        self.slots = slots
        vertices = slots * inner * inner
        self.ground, self.materials, self.parent = (
            context.empty(width * vertices, context.real_dtype) for width in (4, materials, 4)
        )

    def download(self, out: Surface) -> None:
        """Wait, and copy the first slots into arrays."""
        parts = {
            "normals and heights": (self.ground, out.ground),
            "materials": (self.materials, out.materials),
            "parents' normals and heights": (self.parent, out.parent),
        }
        for what, (buffer, array) in parts.items():
            self.context.download_into(buffer, array)
            require_finite(array, what, self.context.device)


def vertex_dtype(materials: int) -> np.dtype[np.void]:
    """Return the layout of a vertex: m; x and y of the unit normal times 32767; weights, 255 for 1.

    Weights are padded to whole words of four.
    """
    weights = 4 * weight_words(materials)
    return np.dtype(
        [
            ("height", "<f4"),
            ("parent_height", "<f4"),
            ("slope", "<i2", 2),
            ("parent_slope", "<i2", 2),
            ("weights", "u1", weights),
            ("parent_weights", "u1", weights),
        ]
    )


FACTS: Final = np.dtype([("low", "f8"), ("high", "f8"), ("error", "f8")])
"""Facts of a tile, m: see :meth:`~sketchterrain.generation.terrain.Terrain.write_tiles`."""

TILE_QUADS: Final = (16, 32, 64, 128, 256)
"""Valid numbers of quads along a tile's side."""


class VertexMemory(Protocol):
    """Memory that a device writes and OpenGL reads; see :mod:`sketchterrain.compute.buffers`."""

    @property
    def nbytes(self) -> int:
        """Size in bytes."""
        ...

    @property
    def buffer(self) -> Any:
        """The device's buffer."""
        ...

    def acquire(self) -> None:
        """Give it to the device for writing."""
        ...

    def release(self, parts: Sequence[tuple[int, int]]) -> None:
        """Wait for the device and give it to OpenGL; only bytes in parts (start, size) were written."""
        ...


class VertexStore:
    """Slots for tiles of vertices.

    Slot s starts at vertex s · (quads + 1)²; rows run from north to south. ``quads`` along a side is 32, 64,
    128 or 256; vertices have weights of so many ``materials``. ``memory`` is on the context's device; None
    allocates a buffer.
    """

    def __init__(
        self,
        context: ComputeContext,
        slots: int,
        materials: int,
        *,
        quads: int = QUADS,
        memory: VertexMemory | None = None,
    ) -> None:
        if quads not in TILE_QUADS:
            raise InputError(f"expected quads of {', '.join(map(str, TILE_QUADS))}, got {quads}")
        if slots < 1:
            raise InputError(f"expected at least 1 slot, got {slots}")
        self.context = context
        self.slots = slots
        self.quads = quads
        self.vertex = vertex_dtype(materials)
        if memory is not None and memory.nbytes < self.nbytes:
            raise InputError(f"expected {self.nbytes} bytes for {slots} tiles, got {memory.nbytes}")
        self.memory = memory
        self.buffer: Any = context.empty(self.nbytes, np.uint8) if memory is None else memory.buffer

    @property
    def tile_bytes(self) -> int:
        """Bytes of a slot."""
        return (self.quads + 1) ** 2 * self.vertex.itemsize

    @property
    def nbytes(self) -> int:
        """Bytes of all slots."""
        return self.slots * self.tile_bytes

    def acquire(self) -> None:
        """Give the vertices to the device."""
        if self.memory is not None:
            self.memory.acquire()

    def release(self, slots: LatticeArray) -> None:
        """Give the vertices to OpenGL, with newly written slots."""
        if self.memory is None:
            return
        written = np.sort(slots)
        starts = np.flatnonzero(np.diff(written, prepend=-2) > 1)
        ends = np.append(starts[1:], written.size)
        size = self.tile_bytes
        runs = zip(written[starts], ends - starts, strict=True)
        self.memory.release([(int(first) * size, int(count) * size) for first, count in runs])

    def write(self, slot: int, tile: StructuredArray) -> None:
        """Upload a tile (quads + 1, quads + 1) of vertices, row 0 north, to a slot that the device holds."""
        self.context.upload_into(self.buffer, np.ascontiguousarray(tile), start=slot * self.tile_bytes)

    def heights(self, slot: int) -> Float32Array:
        """Wait for the device, which must hold the vertices, and return a tile's heights (m)."""
        tile = np.empty((self.quads + 1, self.quads + 1), self.vertex)
        self.context.download_into(self.buffer, tile, start=slot * self.tile_bytes)
        return np.ascontiguousarray(tile["height"])

    def download(self) -> StructuredArray:
        """Wait for the device and return the vertices of all slots, shape (slots, quads + 1, quads + 1)."""
        self.acquire()
        shape = (self.slots, self.quads + 1, self.quads + 1)
        found = self.context.download(self.buffer, shape, self.vertex)
        self.release(np.zeros(0, np.int64))
        return found
