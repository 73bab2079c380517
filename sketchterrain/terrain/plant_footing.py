"""Terrain properties at plants, at full detail."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import FloatArray, LatticeArray
    from sketchterrain.terrain.evaluation import Evaluator


_FOOTPRINT = 0.5  # m over which the terrain at a plant is planar


class PlantSites(NamedTuple):
    """Terrain at positions, shape (n,) each."""

    x: LatticeArray  # lattice units
    y: LatticeArray
    z: FloatArray  # m
    slope_east: FloatArray  # rise over run
    slope_north: FloatArray
    dune: FloatArray  # masks, 0 … 1
    forest: FloatArray
    water: FloatArray

    @classmethod
    def evaluate(cls, evaluator: Evaluator, x: LatticeArray, y: LatticeArray) -> Self:
        """Evaluate the terrain at positions (lattice units)."""
        unit = metres_per_unit(evaluator.recipe.extent)
        step = max(round(_FOOTPRINT / unit), 1)
        # The position, one step east of it and one north.
        corners = np.concatenate([x, x + step, x]), np.concatenate([y, y, y + step])
        height, mask = evaluator.points(*corners, cell_size=0.0)
        z, east, north = height.reshape(3, -1).astype(np.float64)
        run, (_, dune, forest, water) = step * unit, mask[: x.size].T
        return cls(x, y, z, (east - z) / run, (north - z) / run, dune, forest, water)

    @property
    def steepness(self) -> FloatArray:
        """Rise over run."""
        return np.hypot(self.slope_east, self.slope_north)

    @property
    def normal(self) -> FloatArray:
        """Unit vectors: east, north, up; shape (n, 3)."""
        upward = 1 / np.sqrt(1 + self.slope_east**2 + self.slope_north**2)
        return np.stack([-self.slope_east * upward, -self.slope_north * upward, upward], axis=-1)

    def subset(self, chosen: npt.NDArray[np.bool_]) -> PlantSites:
        """Return some of the positions."""
        ground = (each[chosen] for each in self[2:])
        return PlantSites(self.x[chosen], self.y[chosen], *ground)
