"""What a frame is told: tiles to generate, and tiles to draw."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.tiles.codes import TileKey

    Floats = npt.NDArray[np.float64]
    Ints = npt.NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Batch:
    """Tiles to generate: parents come before children.

    Attributes
    ----------
    keys : tuple of TileKey
    slots, parents : (n,) int64
        Where each is to live, and where its parent does, -1 for a root.
    """

    keys: tuple[TileKey, ...]
    slots: Ints
    parents: Ints

    def __bool__(self) -> bool:
        return bool(self.keys)


@dataclass(frozen=True, eq=False)
class DrawList:
    """Tiles to draw.

    Attributes
    ----------
    keys : tuple of TileKey
    slots : (n,) int64
        Where each lives.
    corners : (n, 2) int64
        North-west corner, lattice units from the world's origin, eastward and northward.
    steps : (n,) int64
        Lattice units between vertices.
    cases : (n,) int64
        Which vertices they show: see borders.py.
    morph : (n, 3, 3) float32
        How much of the parent is shown at the controls: see morph.py.
    errors, screen_errors : (n,) float64
        Geometric error δ (m) and what it covers on the screen (px).
    """

    keys: tuple[TileKey, ...]
    slots: Ints
    corners: Ints
    steps: Ints
    cases: Ints
    morph: npt.NDArray[np.float32]
    errors: Floats
    screen_errors: Floats

    @property
    def levels(self) -> Ints:
        """Level of each tile, (n,)."""
        return np.array([key.level for key in self.keys], np.int64)
