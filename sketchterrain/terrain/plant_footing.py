"""What the ground is like where plants stand, at full detail."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple, Self

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.terrain.evaluation import Evaluator

    Lattice = npt.NDArray[np.int64]
    Reals = npt.NDArray[np.floating]

_FOOT = 0.5  # m over which a plant's ground is taken to be even


class Footing(NamedTuple):
    """Places, shape (n,) each.

    Attributes
    ----------
    x, y : int64
        Lattice units.
    z : m
    slope_east, slope_north : rise over run
    dune, forest, water : masks, 0 … 1
    """

    x: Lattice
    y: Lattice
    z: Reals
    slope_east: Reals
    slope_north: Reals
    dune: Reals
    forest: Reals
    water: Reals

    @classmethod
    def of(cls, evaluator: Evaluator, x: Lattice, y: Lattice) -> Self:
        """Evaluate the ground at places (lattice units)."""
        unit = metres_per_unit(evaluator.recipe.extent)
        step = max(round(_FOOT / unit), 1)
        # The place, one step east of it and one north.
        corners = np.concatenate([x, x + step, x]), np.concatenate([y, y, y + step])
        height, mask = evaluator.points(*corners, cell_size=0.0)
        z, east, north = height.reshape(3, -1).astype(np.float64)
        run, (_, dune, forest, water) = step * unit, mask[: x.size].T
        return cls(x, y, z, (east - z) / run, (north - z) / run, dune, forest, water)

    @property
    def steepness(self) -> Reals:
        """Rise over run."""
        return np.hypot(self.slope_east, self.slope_north)

    @property
    def normal(self) -> Reals:
        """Unit vectors: east, north, up; shape (n, 3)."""
        upward = 1 / np.sqrt(1 + self.slope_east**2 + self.slope_north**2)
        return np.stack([-self.slope_east * upward, -self.slope_north * upward, upward], axis=-1)

    def of_those(self, chosen: npt.NDArray[np.bool_]) -> Footing:
        """Return some of the places."""
        ground = (each[chosen] for each in self[2:])
        return Footing(self.x[chosen], self.y[chosen], *ground)
