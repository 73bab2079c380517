"""The ground of one shard, as small as a world's layers hold it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from sketchterrain.world.grid import Shard

__all__ = ["BYTES_PER_VERTEX", "LAYERS", "Ground"]

LAYERS = ("height", "normal", "materials")
"""What a world holds at each vertex."""
BYTES_PER_VERTEX = {"height": 4, "normal": 3, "materials": 8}
"""Before they are compressed."""


@dataclass(frozen=True, eq=False)
class Ground:
    """What is known at each vertex of a shard; row 0 is the northernmost, column 0 the westernmost.

    Attributes
    ----------
    shard : Shard
    height : (rows, columns) float32
        m.
    normal : (3, rows, columns) uint8
        East, north, up; 0 is −1, 255 is 1.
    materials : (materials, rows, columns) uint8
        Weights in the terrain's order, that sum to 255 at each vertex.
    """

    shard: Shard
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.uint8]
    materials: npt.NDArray[np.uint8]
