"""Squares of vertices: where they lie, of tiles and of their parents."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.lattice import QUADS, level_step, metres_per_unit

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    Lattice = npt.NDArray[np.int64]

__all__ = ["Patches", "tile_patches"]


@dataclass(frozen=True, eq=False)
class Patches:
    """Squares of vertices, each with a border of one vertex around it.

    Attributes
    ----------
    axis_x, axis_y : (patches, side) int64
        Lattice coordinates; x runs west to east, y north to south.
    cell_size : float
        Metres between samples.
    """

    axis_x: Lattice
    axis_y: Lattice
    cell_size: float

    @property
    def count(self) -> int:
        """How many patches there are."""
        return len(self.axis_x)

    @property
    def side(self) -> int:
        """Vertices along a side, border included."""
        return int(self.axis_x.shape[1])

    @cached_property
    def blocks(self) -> Lattice:
        """West, south, east and north of each, shape (patches, 4)."""
        x, y = self.axis_x, self.axis_y
        return np.stack([x[:, 0], y[:, -1], x[:, -1], y[:, 0]], axis=-1)

    @property
    def corners(self) -> Lattice:
        """The south-west vertex of each, shape (patches, 2)."""
        return self.blocks[:, :2]

    @cached_property
    def step_bits(self) -> int | None:
        """All vertices are whole steps of 2^step_bits lattice units apart and from the origin; else None."""
        step = int(self.axis_x[0, 1] - self.axis_x[0, 0])
        if step <= 0 or step & (step - 1) or np.any(self.corners & (step - 1)):
            return None
        even = np.all(np.diff(self.axis_x) == step) and np.all(np.diff(self.axis_y) == -step)
        return step.bit_length() - 1 if even else None

    def part(self, part: slice) -> Patches:
        """Return some of the patches."""
        return replace(self, axis_x=self.axis_x[part], axis_y=self.axis_y[part])


def tile_patches(level: int, keys: Sequence[tuple[int, int]], extent: float, *, up: int) -> Patches:
    """Return the patches of tiles, or with ``up=1`` those of their parents' vertices on the same ground.

    Parameters
    ----------
    level
        −12 … 18.
    keys
        Column and row of each tile.
    extent
        Metres along the sketch's longer side.
    up
        0 or 1.

    Raises
    ------
    InputError
        If there is no such level.
    """
    step = level_step(level)
    column, row = np.array(keys, np.int64).reshape(-1, 2).T[..., None] * (QUADS * step)
    quads = QUADS >> up
    offsets = np.arange(-1, quads + 2, dtype=np.int64) * (step << up)
    return Patches(column + offsets, row + QUADS * step - offsets, step * 2**up * metres_per_unit(extent))
