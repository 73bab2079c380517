"""The storey of trees and shrubs: how thick they stand, and which, how tall."""

from __future__ import annotations

from functools import partial
from itertools import product
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.plant_noise import PlantNoise, ramp
from sketchterrain.terrain.plant_spacing import density_of, padded_axes, power_of_two_step
from sketchterrain.terrain.woody_species import (
    OUTSIDE,
    SHRUB,
    Site,
    species_mix,
    tree_size,
)

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import FloatArray, LatticeArray
    from sketchterrain.terrain.evaluation import Evaluator
    from sketchterrain.terrain.plant_footing import PlantSites


LEAST: Final = 4.0
"""m between trees or shrubs where they stand thickest."""
MOST: Final = 63.9
"""m between lone ones; where they would stand thinner none does."""
CELL: Final = 8.0
"""m between the raster's vertices, about."""

_LONE = 0.00040  # plants on a square metre outside forests where it is not dry, on the mean
_GROUPS = (190.0, 55.0)  # m, from group to group of those, and from thicket to thicket in a group
_BETWEEN, _IN_GROUP = 0.25, 7.0  # times as many as on the mean stand between groups, and in the midst of one
_THIN, _THICK = 0.42, 0.86  # noise from which on a group gets thicker, and where it is thickest
_DRY_GAPS = 0.21  # how much more of that noise the gaps take where it is dry: few groups, but groups
_RIPARIAN = 1.5  # times as many more of those on a bank
_BANK = (0.05, 0.5)  # water mask from which on it is one, and where it is one through and through
_STEEPEST = 1.0  # rise over run on which trees hold
_LESS_STEEP = 0.75  # rise over run from which on fewer do
_TREE_LINE = 60.0  # m about the tree line in which they get fewer
_WATERSIDE = 0.7  # water mask from which on it is too wet
_FRINGE = 0.028  # plants on a bare square metre amid a full forest that have seeded themselves from it
_SEED_FLIES = 22.0  # m: how far


class Woods:
    """Trees and shrubs of a recipe.

    Parameters
    ----------
    evaluator

    Attributes
    ----------
    step, least, most : int
        See :class:`SpacingRule`.
    """

    def __init__(self, evaluator: Evaluator) -> None:
        recipe = evaluator.recipe
        self._evaluator = evaluator
        self._recipe = recipe
        self._noise = PlantNoise(recipe)
        unit = metres_per_unit(recipe.extent)
        self.step = power_of_two_step(CELL, recipe.extent)
        self.least, self.most = round(LEAST / unit), round(MOST / unit)
        self._cell = self.step * unit
        # Vertices that seeds reach the next ones from.
        self._rim = int(_SEED_FLIES / self._cell)

    def densities(self, x: LatticeArray, y: LatticeArray) -> FloatArray:
        """Return plants on a square metre; see :class:`SpacingRule`."""
        rim = self._rim
        wide_x, wide_y = (padded_axes(each, self.step, rim=rim) for each in (x, y))
        height, mask = self._evaluator.heights_and_masks(wide_x, wide_y[:, ::-1], cell_size=self._cell)
        height, mask = height[:, ::-1], mask[:, :, ::-1]
        inner = (slice(None), slice(rim, -rim), slice(rim, -rim))
        _, dune, forest, water = (mask[:, kind][inner] for kind in range(4))
        z, steepness = height[inner], self._steepness(height)
        wide, narrow = (self._noise.over_blocks("group", width, x, y) for width in _GROUPS)
        lone = self._lone(wide, narrow, dune, water)
        beside = _FRINGE * np.maximum(self._around(mask[:, 2]) - forest, 0)
        young = beside / (beside + lone + 1e-9) * (forest < OUTSIDE)
        density = lone + beside
        some = forest.any(axis=(1, 2))
        if some.any():
            over = partial(self._noise.over_blocks, x=x[some], y=y[some])
            ground = (part[some] for part in (z, steepness, forest, water, young))
            site = Site(x[some, None, :], y[some, :, None], over, *ground)
            wood = forest[some] * species_mix(self._recipe, site).full_density
            density[some] = np.maximum(wood, lone[some]) + beside[some]
        return np.asarray(density * self._hold(z, steepness))

    def survives(self, foot: PlantSites) -> npt.NDArray[np.bool_]:
        """Tell which plants the exact place lets stand."""
        too_high = foot.z >= self._recipe.climate["tree_line"] + _TREE_LINE
        return np.asarray((foot.steepness < _STEEPEST) & ~too_high & (foot.water < _WATERSIDE))

    def assign_species(self, plants: npt.NDArray[Any], foot: PlantSites, spacing: FloatArray) -> None:
        """Give plants their species and scale.

        Parameters
        ----------
        plants
            Of dtype ``PLANT``, written.
        foot
            Where they stand.
        spacing
            m to the next ones.
        """
        draw = partial(self._noise.draw, x=foot.x, y=foot.y)
        at = partial(self._noise.at, x=foot.x, y=foot.y)
        wide, narrow = (at("group", width) for width in _GROUPS)
        lone = self._lone(wide, narrow, foot.dune, foot.water)
        # Thicker than lone ones stand outside a forest, they have seeded themselves from it.
        young = (foot.forest < OUTSIDE) & (draw("seed") >= lone / density_of(spacing))
        ground = (foot.z, foot.steepness, foot.forest, foot.water, young.astype(np.float64))
        site = Site(foot.x, foot.y, at, *ground)
        plants["species"] = species_mix(self._recipe, site).chosen(draw)
        above = foot.z - self._recipe.climate["tree_line"]
        plants["scale"] = tree_size(draw, foot.forest, above, young, plants["species"] == SHRUB)

    def _lone(self, wide: FloatArray, narrow: FloatArray, dune: FloatArray, water: FloatArray) -> FloatArray:
        """Plants on a square metre outside forests: in loose groups, few between them; more beside water."""
        dry = self._recipe.climate["aridity"]
        thick = ramp(0.65 * wide + 0.35 * narrow, _THIN + _DRY_GAPS * dry, _THICK) ** 2
        between = _BETWEEN * (1 - dry)
        share = np.sqrt(1 - dry) * (between + (_IN_GROUP - between) * thick)
        return np.asarray(_LONE * share * (1 - dune) * (1 + _RIPARIAN * ramp(water, *_BANK)))

    def _hold(self, z: FloatArray, steepness: FloatArray) -> FloatArray:
        """Share of plants, 0 … 1, that the slope and the height leave."""
        tree_line = self._recipe.climate["tree_line"]
        warm = 1 - ramp(z, tree_line - _TREE_LINE, tree_line + _TREE_LINE)
        return np.asarray(warm * (1 - ramp(steepness, _LESS_STEEP, _STEEPEST)))

    def _steepness(self, height: FloatArray) -> FloatArray:
        """Rise over run within the rim, by central differences."""
        rim = self._rim
        near = height[:, rim - 1 : height.shape[1] - rim + 1, rim - 1 : height.shape[2] - rim + 1]
        east = near[:, 1:-1, 2:] - near[:, 1:-1, :-2]
        north = near[:, 2:, 1:-1] - near[:, :-2, 1:-1]
        return np.asarray(np.sqrt(east * east + north * north) / np.float32(2 * self._cell))

    def _around(self, forest: FloatArray) -> FloatArray:
        """Mean of a mask over the disc that seeds fly from, within the rim."""
        rim = self._rim
        side = forest.shape[-1] - 2 * rim
        total = np.zeros((len(forest), side, side), forest.dtype)
        if not forest.any():
            return total
        reach = (_SEED_FLIES / self._cell) ** 2
        shifts = [(i, j) for i, j in product(range(-rim, rim + 1), repeat=2) if i * i + j * j <= reach]
        for i, j in shifts:
            total += forest[:, rim + i : rim + i + side, rim + j : rim + j + side]
        return np.asarray(total / np.float32(len(shifts)))
