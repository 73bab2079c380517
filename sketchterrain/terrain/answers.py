"""What a terrain answers: a tile, a raster, what was placed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features import Lake, River
    from sketchterrain.features.catalogue import Points
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
        Metres by which heights at full detail differ from those at this level, at most, anywhere in the tile.
    height : ndarray of float32, shape (65, 65)
        Metres.
    normal : ndarray of float32, shape (65, 65, 3)
        Unit vectors: east, north, up.
    materials : ndarray of float32, shape (65, 65, 8)
        Weights in the order of ``MATERIALS``; they sum to 1.
    parent_height, parent_normal : ndarray of float32, shapes (65, 65) and (65, 65, 3)
        What the coarser tile over it holds here: bit-equal at the vertices they share; between two of the
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
    """The whole sketch as images of rows × columns vertices; row 0 is the north edge.

    Attributes
    ----------
    spacing : tuple of float
        Metres between columns and between rows.
    height, normal, materials : ndarray of float32
        As in :class:`Tile`.
    """

    spacing: tuple[float, float]
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    materials: npt.NDArray[np.float32]


@dataclass(frozen=True)
class Band:
    """Some rows of a grid of vertices; row 0 is its north edge.

    Attributes
    ----------
    top : int
        The first row's place in the whole grid.
    height, normal, materials : ndarray of float32
        As in :class:`Tile`, of (rows, columns) vertices.
    """

    top: int
    height: npt.NDArray[np.float32]
    normal: npt.NDArray[np.float32]
    materials: npt.NDArray[np.float32]


@dataclass(frozen=True)
class TerrainFeatures:
    """What was placed.

    Attributes
    ----------
    points : structured ndarray
        Mountains, hills, dunes and forests (dtype ``FEATURE``) in and near the sketch, sorted by id.
    rivers : tuple of River
    lakes : tuple of Lake
    """

    points: Points
    rivers: tuple[River, ...]
    lakes: tuple[Lake, ...] = ()

    @classmethod
    def of(cls, recipe: TerrainRecipe, size: tuple[float, float]) -> TerrainFeatures:
        """Return what a recipe places: all that is painted, and what fills a sketch of a size (m)."""
        points = np.concatenate([recipe.painted, recipe.fill.within(0.0, 0.0, *size)])
        return cls(points[np.argsort(points["id"], kind="stable")], recipe.rivers, recipe.lakes)
