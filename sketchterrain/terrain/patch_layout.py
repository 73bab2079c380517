"""Layout of patches: positions of the vertices of tiles, parents and samples; batches that fit memory."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from sketchterrain.array_types import LatticeArray
from sketchterrain.errors import DeviceMemoryError
from sketchterrain.terrain.lattice import QUADS, level_step, metres_per_unit

if TYPE_CHECKING:
    Keys = Sequence[tuple[int, int]] | LatticeArray

T = TypeVar("T")


def run_to_completion(steps: Generator[None, None, T]) -> T:
    """Run all steps and return the generator's result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result


class Batches:
    """Process items in slices of at most ``limit``, halved for good each time the device is out of memory."""

    def __init__(self, limit: int) -> None:
        self.limit = limit

    def run(
        self, count: int, work: Callable[[slice], None], *, on_shrink: Callable[[], None] | None = None
    ) -> None:
        """Call ``work`` on slices of ``count`` items in order, retrying smaller ones after DeviceMemoryError.

        ``on_shrink`` is called in between to release larger allocations. A batch of one that fails is an
        error.
        """
        first = 0
        while first < count:
            end = min(first + self.limit, count)
            try:
                work(slice(first, end))
            except DeviceMemoryError as error:
                if end - first == 1:
                    raise DeviceMemoryError(f"{error}; not even a batch of one fits") from error
                self.limit = (end - first) // 2
            else:
                first = end
                continue
            # Not in the handler: the error would keep the work's buffers alive.
            if on_shrink is not None:
                on_shrink()


@dataclass(frozen=True, eq=False)
class Patches:
    """Squares of vertices, each with a border of one vertex around it."""

    axis_x: LatticeArray  # (patches, side), west to east
    axis_y: LatticeArray  # (patches, side), north to south
    cell_size: float  # m between samples
    squares: int = 1  # parts along a side of a patch, culled separately

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.axis_x)

    @property
    def side(self) -> int:
        """Vertices along a side, border included."""
        return int(self.axis_x.shape[1])

    @cached_property
    def blocks(self) -> LatticeArray:
        """West, south, east and north of each, shape (patches, 4)."""
        x, y = self.axis_x, self.axis_y
        return np.stack([x[:, 0], y[:, -1], x[:, -1], y[:, 0]], axis=-1)

    @property
    def corners(self) -> LatticeArray:
        """The south-west vertex of each, shape (patches, 2)."""
        return self.blocks[:, :2]

    @property
    def square_side(self) -> int:
        """Vertices along a square's side; the last ones may have fewer."""
        return -(-self.side // self.squares)

    @property
    def square_blocks(self) -> LatticeArray:
        """West, south, east and north of squares, shape (patches · squares², 4).

        Squares of a patch are in rows from west to east, from north to south.
        """
        if self.squares == 1:
            return self.blocks
        first = np.arange(self.squares) * self.square_side
        last = np.minimum(first + self.square_side, self.side) - 1
        shape = (self.count, self.squares, self.squares)
        along = (
            self.axis_x[:, None, first],
            self.axis_y[:, last, None],
            self.axis_x[:, None, last],
            self.axis_y[:, first, None],
        )
        return np.stack([np.broadcast_to(each, shape) for each in along], axis=-1).reshape(-1, 4)

    @cached_property
    def step_bits(self) -> tuple[int, int] | None:
        """Bits of the step between vertices, and of the longest step that divides all positions.

        Both are powers of two lattice units; None where vertices are not spaced so.
        """
        step = int(self.axis_x[0, 1] - self.axis_x[0, 0])
        if step <= 0 or step & (step - 1):
            return None
        if np.any(np.diff(self.axis_x) != step) or np.any(np.diff(self.axis_y) != -step):
            return None
        common = int(np.bitwise_or.reduce(self.corners, axis=None)) | step
        return step.bit_length() - 1, (common & -common).bit_length() - 1


def tile_patches(level: int, keys: Keys, extent: float, *, up: int = 0, quads: int = QUADS) -> Patches:
    """Return the patches of tiles (column, row) of a level; with ``up=1`` their parents' vertices there.

    ``quads`` along a side is a power of two; the finest level is 18 for 64 quads.
    """
    step = level_step(level, quads)
    column, row = np.array(keys, np.int64).reshape(-1, 2).T[..., None] * (quads * step)
    offsets = np.arange(-1, (quads >> up) + 2, dtype=np.int64) * (step << up)
    return Patches(column + offsets, row + quads * step - offsets, step * 2**up * metres_per_unit(extent))


def sample_stride(quads: int) -> int:
    """Return the spacing, in quads, of the samples of a tile's error: two, and one in a small tile."""
    return 1 if quads < QUADS else 2


def tile_samples(level: int, keys: Keys, *, cell_size: float, quads: int = QUADS) -> Patches:
    """Return the centres of every :func:`sample_stride`-th quad of tiles; not for the finest level."""
    step = level_step(level, quads)
    corner = np.array(keys, np.int64).reshape(-1, 2) * (quads * step)
    stride = sample_stride(quads)
    along = np.arange(quads // stride, dtype=np.int64) * (stride * step) + step // 2
    north = corner[:, 1, None] + quads * step
    return Patches(corner[:, 0, None] + along, north - along, cell_size)
