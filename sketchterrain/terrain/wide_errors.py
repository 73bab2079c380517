"""The error of tiles too wide for all their features to be placed: by a close look at one place in each."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.terrain.changes import touches
from sketchterrain.terrain.lattice import LATTICE_BITS
from sketchterrain.terrain.patch_places import tile_samples
from sketchterrain.terrain.recipe import FINEST_CELL

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Bounds, Float32Array
    from sketchterrain.terrain.patch_places import Patches
    from sketchterrain.terrain.recipe import TerrainRecipe

    _Samples = tuple[npt.NDArray[np.int64], npt.NDArray[np.int64], Float32Array]

_WIDEST = 17e3  # m
_MOST_KEPT = 256


class WideTileErrors:
    """How far full detail is from wide tiles, at 32 × 32 samples of a square of at most 17 km.

    That is where the highest feature that was painted in the tile stands. Ground that nothing was painted on
    is much the same everywhere, so one square beside the sketch tells what a level leaves out of it.

    Parameters
    ----------
    recipe : TerrainRecipe
    heights : callable
        Gives the heights of patches, shape (patches, side, side).
    """

    def __init__(self, recipe: TerrainRecipe, heights: Callable[[Patches], Float32Array]) -> None:
        self._recipe = recipe
        self._heights = heights
        self._square_level = int(np.ceil(np.log2(recipe.extent / _WIDEST)))
        self._sampled: dict[tuple[int, int], _Samples] = {}
        self._left_out: dict[float, Float32Array] = {}

    def updated(
        self, recipe: TerrainRecipe, heights: Callable[[Patches], Float32Array], areas: Sequence[Bounds]
    ) -> WideTileErrors:
        """Return those of a changed recipe of the same extent, which differs in some areas (m)."""
        other = WideTileErrors(recipe, heights)
        side = recipe.extent / 2.0**self._square_level
        for (column, row), samples in self._sampled.items():
            square = (column * side, row * side, (column + 1) * side, (row + 1) * side)
            if not touches(areas, square):
                other._sampled[column, row] = samples
        if (self._beside, 0) in other._sampled:
            other._left_out = dict(self._left_out)
        return other

    def is_wide(self, level: int) -> bool:
        """Whether the tiles of a level are wider than what is looked at."""
        return level < self._square_level

    def distances(self, level: int, column: int, row: int, height: Float32Array) -> Float32Array:
        """Return how far full detail is from a tile's triangles at the samples, m, shape (samples,).

        Parameters
        ----------
        level, column, row
            Of a wide tile.
        height
            Of its vertices, m, shape (quads + 1, quads + 1).
        """
        square = self._painted_square(level, column, row)
        if square is None:
            return self._unpainted(self._recipe.extent * 2.0**-level / (len(height) - 1))
        x, y, full = self._samples(square)
        width, quads = 1 << (LATTICE_BITS - level), len(height) - 1
        u = np.asarray((x - column * width) * (quads / width), np.float64)
        v = np.asarray(((row + 1) * width - y[:, None]) * (quads / width), np.float64)
        apart: Float32Array = np.abs(np.subtract(full, _on_triangles(height, u, v)))
        return apart.ravel()

    def _painted_square(self, level: int, column: int, row: int) -> tuple[int, int] | None:
        """Column and row, at the squares' level, of the one with a tile's highest painted feature, if any."""
        side = self._recipe.extent / 2.0**self._square_level
        share = 1 << (self._square_level - level)
        low = np.array([column, row]) * share
        painted = self._recipe.painted
        at = np.floor(np.stack([painted["x"], painted["y"]], axis=-1) / side).astype(np.int64)
        inside = np.flatnonzero(np.all((at >= low) & (at < low + share), axis=-1))
        if not inside.size:
            return None
        best = at[inside[np.argmax(painted["strength"][inside])]]
        return int(best[0]), int(best[1])

    @property
    def _beside(self) -> int:
        """Column of a square beside the sketch."""
        return int(np.ceil(2.0**self._square_level)) + 1

    def _unpainted(self, cell_size: float) -> Float32Array:
        """How far full detail is from what a cell size shows of ground that nothing was painted on, m."""
        if cell_size not in self._left_out:
            place = self._beside, 0
            coarse = tile_samples(self._square_level, [place], cell_size=cell_size)
            apart = np.abs(self._samples(place)[2] - self._heights(coarse)[0])
            self._left_out[cell_size] = np.asarray(apart, np.float32).ravel()
        return self._left_out[cell_size]

    def _samples(self, place: tuple[int, int]) -> _Samples:
        """Where the samples of a square lie (lattice units), and full detail there; kept."""
        if place not in self._sampled:
            patches = tile_samples(self._square_level, [place], cell_size=FINEST_CELL)
            while len(self._sampled) >= _MOST_KEPT:
                del self._sampled[next(iter(self._sampled))]
            self._sampled[place] = patches.axis_x[0], patches.axis_y[0], self._heights(patches)[0]
        return self._sampled[place]


def _on_triangles(
    height: Float32Array, u: npt.NDArray[np.float64], v: npt.NDArray[np.float64]
) -> Float32Array:
    """Return the height of quads cut from north-west to south-east, u east and v south in quads."""
    u, v = np.broadcast_arrays(u, v)
    column, row = (np.minimum(np.floor(place).astype(np.intp), len(height) - 2) for place in (u, v))
    u, v = u - column, v - row
    nw, se = height[row, column], height[row + 1, column + 1]
    other = np.where(v > u, height[row + 1, column], height[row, column + 1])
    # From north-west along the longer way first, then along the shorter.
    longer, shorter = np.maximum(u, v), np.minimum(u, v)
    return np.asarray(nw + longer * (other - nw) + shorter * (se - other), dtype=np.float32)
