"""Per-frame results of the tile stream: tiles to generate and tiles to draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array, Int64Array
    from sketchterrain.tiles.codes import TileKey


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
    cases: Int64Array  # (n,) border case: borders.py
    morph: npt.NDArray[np.float32]  # (n, 3, 3) the parent's weight at the controls: morph.py
    errors: Float64Array  # (n,) geometric error δ, m
    screen_errors: Float64Array  # (n,) its projection, px

    @property
    def levels(self) -> Int64Array:
        """Level of each tile, (n,)."""
        return np.array([key.level for key in self.keys], np.int64)
