"""Random numbers and smooth noise for plants, at single positions and over grids."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.hashing import hash_unit, value_noise
from sketchterrain.terrain.lattice import metres_per_unit

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import Float64Array, LatticeArray
    from sketchterrain.terrain.recipe import TerrainRecipe


class PlantNoise:
    """Noise of a recipe's plants: functions of the position and of a stream's name."""

    def __init__(self, recipe: TerrainRecipe) -> None:
        self._seed = recipe.seed
        self._unit = metres_per_unit(recipe.extent)

    def draw(self, stream: str, x: LatticeArray, y: LatticeArray) -> Float64Array:
        """Return one number in [0, 1) for each position (lattice units)."""
        return hash_unit(self._seed, f"plant {stream}", x, y)

    def at(self, name: str, width: float, x: LatticeArray, y: LatticeArray) -> Float64Array:
        """Return smooth noise, 0 … 1, with a period of about two widths (m), at positions (lattice units)."""
        return value_noise(self._seed, _stream(name, width), self._steps(x, width), self._steps(y, width))

    def over_grid(self, name: str, width: float, x: LatticeArray, y: LatticeArray) -> Float64Array:
        """Return the same bits on a grid: y over rows, x over columns, both ascending.

        Corners are hashed once.
        """
        columns, east, u = _cells_and_fractions(self._steps(x, width))
        rows, north, v = _cells_and_fractions(self._steps(y, width))
        corner = hash_unit(self._seed, _stream(name, width), columns[None, :], rows[:, None])
        across = (1.0 - u) * corner[:, east] + u * corner[:, east + 1]
        return np.asarray((1.0 - v[:, None]) * across[north] + v[:, None] * across[north + 1])

    def over_blocks(self, name: str, width: float, x: LatticeArray, y: LatticeArray) -> Float64Array:
        """Return the same over blocks, by their axes of shape (blocks, n); shape (blocks, n, n)."""
        return np.stack([self.over_grid(name, width, *axes) for axes in zip(x, y, strict=True)])

    def _steps(self, along: LatticeArray, width: float) -> Float64Array:
        return np.asarray(self._unit / width * along.astype(np.float64))


def ramp(x: npt.NDArray[np.floating], low: float, high: float) -> npt.NDArray[np.floating]:
    """Return 0 up to ``low``, 1 from ``high`` on, linear between."""
    return np.asarray(np.clip((x - low) / (high - low), 0, 1))


def _stream(name: str, width: float) -> str:
    return f"plant {name} {width:g}"


def _cells_and_fractions(at: Float64Array) -> tuple[LatticeArray, LatticeArray, Float64Array]:
    """Return steps around positions, the index of the one below each, and smoothed fractions."""
    below = np.floor(at).astype(np.int64)
    u = at - below
    u = u * u * (3.0 - 2.0 * u)
    steps = int(below[-1] - below[0]) + 2
    if steps <= 2 * below.size:
        return below[0] + np.arange(steps), below - below[0], u
    return np.stack([below, below + 1], axis=-1).ravel(), 2 * np.arange(below.size), u
