"""Evaluated pieces of a terrain: tile, raster, band of rows, placed features."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import StructuredArray
    from sketchterrain.features import Lake, River
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
    materials : ndarray of float32, shape (65, 65, 8)
        Weights in the order of ``MATERIALS``; they sum to 1.
    parent_height, parent_normal : ndarray of float32, shapes (65, 65) and (65, 65, 3)
        Values of the parent tile at these vertices: bit-equal at shared vertices; between two of the
        parent's vertices half their sum, along its edges or its diagonals from north-west to south-east.
    """

    level: int
    column: int
    row: int
    bounds: tuple[float, float, float, float]
    cell_size: float
    detail_bound: float
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    materials: npt.NDArray[np.float32]
    parent_height: npt.NDArray[np.float32]
    parent_normal: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Raster:
    """The whole sketch as images of rows × columns vertices; row 0 is the north edge."""

    spacing: tuple[float, float]  # m between columns and between rows
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    materials: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Band:
    """Some rows of a grid of vertices, from row ``top`` of the grid; row 0 is the band's north edge."""

    top: int
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    materials: npt.NDArray[np.float32]


@dataclass(frozen=True)
class TerrainFeatures:
    """Placed features: points (mountains, hills, dunes, forests) in and near the sketch by id; rivers.

    Lakes.
    """

    points: StructuredArray
    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...] = ()

    @classmethod
    def from_recipe(cls, recipe: TerrainRecipe, size: tuple[float, float]) -> TerrainFeatures:
        """Return a recipe's features: all painted ones, and the fill inside a sketch of a size (m)."""
        points = np.concatenate([recipe.painted, recipe.fill.within(0.0, 0.0, *size)])
        return cls(points[np.argsort(points["id"], kind="stable")], recipe.rivers, recipe.lakes)
