"""Layers of a world, and the ground of one shard as they hold it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
import numpy.typing as npt

from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.world.grid import Shard


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
