"""Pool of tile slots, and requests to fill them."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.errors import InputError
from sketchterrain.tiles.quadtree import UNBOUNDED, Boxes, TileKey, boxes_of, clip_boxes, index_in


@dataclass(frozen=True, eq=False)
class Batch:
    """Tiles to generate: parents come before children."""

    keys: tuple[TileKey, ...]
    slots: Int64Array  # (n,) slot of each tile
    parents: Int64Array  # (n,) slot of its parent, -1 for a root

    def __bool__(self) -> bool:
        return bool(self.keys)


@dataclass(frozen=True, eq=False)
class DrawList:
    """Tiles to draw."""

    keys: tuple[TileKey, ...]
    slots: Int64Array  # (n,) slot of each tile
    corners: Int64Array  # (n, 2) north-west corner, lattice units from the origin, eastward and northward
    steps: Int64Array  # (n,) lattice units between vertices
    cases: Int64Array  # (n,) border case of quadtree.tile_indices
    morph: npt.NDArray[np.float32]  # (n, 3, 3) the parent's weight at the controls
    errors: Float64Array  # (n,) geometric error δ, m
    screen_errors: Float64Array  # (n,) its projection, px

    @property
    def levels(self) -> Int64Array:
        """Level of each tile, (n,)."""
        return np.array([key.level for key in self.keys], np.int64)


_FREE = -1
_ANY_HEIGHT = 1e5
"""m"""


class TilePool:
    """LRU cache of tiles in a fixed number of slots, with each tile's error, height range and stale flag.

    Terrain exists within `bounds` (west, south, east, north, m). `error`, `bottom`, `top` (slots,) are the
    geometric error and the lowest and highest terrain (m) of the tile in each slot; `stale` (slots,) marks
    tiles that show the terrain before a change.
    """

    def __init__(self, slots: int, *, bounds: tuple[float, float, float, float] = UNBOUNDED) -> None:
        if slots < 1:
            raise InputError(f"expected at least 1 slot, got {slots}")
        self._bounds = bounds
        self._code = np.full(slots, _FREE, np.int64)
        self._used = np.zeros(slots, np.int64)
        self.error, self.bottom, self.top = (np.zeros(slots) for _ in range(3))
        self.stale = np.zeros(slots, np.bool_)
        self._sorted: tuple[Int64Array, Int64Array] = self._code[:0], self._code[:0]
        self._time = 0

    @property
    def slots(self) -> int:
        """Capacity in tiles."""
        return len(self._code)

    @property
    def count(self) -> int:
        """Number of cached tiles."""
        return len(self._sorted[0])

    def tiles(self) -> tuple[Int64Array, Int64Array]:
        """Return all cached tiles, sorted, and their slots."""
        return self._sorted

    def stale_tiles(self) -> Int64Array:
        """Return the stale tiles, coarser ones first."""
        codes, slots = self._sorted
        return codes[self.stale[slots]]

    def find(self, codes: Int64Array) -> Int64Array:
        """Return the slot of each tile, -1 if not cached; any shape."""
        cached, slots = self._sorted
        at = index_in(cached, codes)
        return np.where(at >= 0, slots[at], _FREE) if cached.size else at

    def touch(self, codes: Int64Array) -> None:
        """Mark tiles as in use now; tiles used together are evicted together."""
        self._time += 1
        slots = self.find(codes)
        self._used[slots[slots >= 0]] = self._time

    def available(self) -> int:
        """Return how many tiles can be acquired without evicting one that is in use now."""
        return int(np.count_nonzero((self._code == _FREE) | (self._used < self._time)))

    def acquire(self, codes: Int64Array) -> Int64Array:
        """Assign a slot to each new tile, evicting the least recently used ones; shape (n,).

        The tiles count as cached at once: later commands in the queue run after they are written. Raises
        InputError if that would evict a tile in use.
        """
        if len(codes) > self.available():
            raise InputError(f"{len(codes)} tiles do not fit into {self.slots} slots")
        slots = np.lexsort((self._used, self._code != _FREE))[: len(codes)]
        self._code[slots] = codes
        self._used[slots] = self._time
        self.stale[slots] = False
        self._sort()
        return slots

    def remove(self, codes: Int64Array) -> None:
        """Remove cached tiles."""
        slots = self.find(codes)
        self._code[slots] = _FREE
        self.stale[slots] = False
        self._sort()

    def codes_in(self, slots: Int64Array) -> Int64Array:
        """Return the tiles in slots."""
        return self._code[slots]

    def _sort(self) -> None:
        occupied = np.flatnonzero(self._code != _FREE)
        order = occupied[np.argsort(self._code[occupied])]
        self._sorted = self._code[order], order

    def set_properties(self, slots: Int64Array, properties: npt.NDArray[Any]) -> None:
        """Store the fields ``low``, ``high`` and ``error`` (m) of tiles."""
        self.bottom[slots], self.top[slots], self.error[slots] = (
            properties["low"],
            properties["high"],
            properties["error"],
        )

    def boxes(self, codes: Int64Array, slots: Int64Array, extent: float) -> Boxes:
        """Return the boxes of cached tiles, enclosing their own surface and the exact one."""
        error = self.error[slots]
        boxes = boxes_of(codes, extent, self.bottom[slots] - error, self.top[slots] + error)
        return clip_boxes(boxes, self._bounds)

    def conservative_boxes(self, codes: Int64Array, slots: Int64Array, extent: float) -> Boxes:
        """Return the same boxes, with unlimited height for stale tiles."""
        boxes, unknown = self.boxes(codes, slots, extent), self.stale[slots]
        boxes.low[unknown, 2], boxes.high[unknown, 2] = -_ANY_HEIGHT, _ANY_HEIGHT
        return boxes
