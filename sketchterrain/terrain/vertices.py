"""Store of tiles as OpenGL draws them: packed vertices in slots of one device buffer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np

from sketchterrain.array_types import Float32Array, LatticeArray, StructuredArray
from sketchterrain.errors import InputError
from sketchterrain.terrain.lattice import QUADS

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

VERTEX: Final = np.dtype(
    [
        ("height", "<f4"),
        ("parent_height", "<f4"),
        ("slope", "<i2", 2),
        ("parent_slope", "<i2", 2),
        ("weights", "u1", 8),
        ("parent_weights", "u1", 8),
    ]
)
"""A vertex, 32 bytes: metres; x and y of the unit normal times 32767; materials' weights, 255 for 1."""

FACTS: Final = np.dtype([("low", "f8"), ("high", "f8"), ("error", "f8")])
"""Facts of a tile, m: see :meth:`~sketchterrain.terrain.terrain.Terrain.write_tiles`."""

TILE_QUADS: Final = (32, 64, 128, 256)
"""Valid numbers of quads along a tile's side."""


class VertexMemory(Protocol):
    """Memory that a device writes and OpenGL reads; see :mod:`sketchterrain.compute.gl_interop`."""

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
    128 or 256. ``memory`` is on the context's device; None allocates a buffer.
    """

    def __init__(
        self, context: ComputeContext, slots: int, *, quads: int = QUADS, memory: VertexMemory | None = None
    ) -> None:
        if quads not in TILE_QUADS:
            raise InputError(f"expected quads of {', '.join(map(str, TILE_QUADS))}, got {quads}")
        if slots < 1:
            raise InputError(f"expected at least 1 slot, got {slots}")
        self.context = context
        self.slots = slots
        self.quads = quads
        if memory is not None and memory.nbytes < self.nbytes:
            raise InputError(f"expected {self.nbytes} bytes for {slots} tiles, got {memory.nbytes}")
        self.memory = memory
        self.buffer: Any = context.empty(self.nbytes, np.uint8) if memory is None else memory.buffer

    @property
    def tile_bytes(self) -> int:
        """Bytes of a slot."""
        return (self.quads + 1) ** 2 * VERTEX.itemsize

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
        """Upload a tile (quads + 1, quads + 1) of `VERTEX`, row 0 north, to a slot that the device holds."""
        self.context.upload_into(self.buffer, np.ascontiguousarray(tile), start=slot * self.tile_bytes)

    def heights(self, slot: int) -> Float32Array:
        """Wait for the device, which must hold the vertices, and return a tile's heights (m)."""
        tile = np.empty((self.quads + 1, self.quads + 1), VERTEX)
        self.context.download_into(self.buffer, tile, start=slot * self.tile_bytes)
        return np.ascontiguousarray(tile["height"])

    def download(self) -> StructuredArray:
        """Wait for the device and return the vertices of all slots, shape (slots, quads + 1, quads + 1)."""
        self.acquire()
        shape = (self.slots, self.quads + 1, self.quads + 1)
        found = self.context.download(self.buffer, shape, VERTEX)
        self.release(np.zeros(0, np.int64))
        return found
