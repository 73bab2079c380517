"""Grass layer: density and species of tufts, flowers and ferns, independent of trees."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.plant import SPECIES
from sketchterrain.terrain.plant_noise import PlantNoise, ramp
from sketchterrain.terrain.plant_spacing import density_of, padded_axes, power_of_two_step

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.array_types import FloatArray, LatticeArray
    from sketchterrain.terrain.evaluation import Evaluator
    from sketchterrain.terrain.plant_footing import PlantSites


LEAST: Final = 0.5
"""Spacing (m) of tufts at the greatest density."""
MOST: Final = 4.0
"""Spacing (m) of single plants; none grow where it would be wider."""
CELL: Final = 2.0
"""Approximate distance (m) between the raster's vertices."""

_APART = {
    "grass": 0.5,
    "forest_floor": 1.2,
    "soil": 1.5,
    "scree": 2.4,
    "river_bed": 3.0,
    "sand": 3.4,
    "rock": 3.8,
}
"""Least spacing (m) on pure materials; none grow on snow."""
_PATCHES = (23.0, 6.0)  # m: wavelengths of dense patches and of their ragged borders
_THIN = 0.3  # density between patches, over the density in them
_DROUGHT = 0.8  # share of plants missing in a desert
_SHADED = (0.1, 0.6)  # forest mask from which ferns grow, and at which they are most frequent
_FERNS = 0.75  # greatest share of ferns on a moist forest floor
_BLOOM = (48.0, 9.0)  # m: wavelengths of patches of flowers and of their ragged borders
_FLOWERS = (0.02, 0.4)  # share of flowers between patches and in their centre
_DAMP = (0.05, 0.5)  # water mask from which grass is taller, and at which it is tallest
_LOWER_UP = (-150.0, 200.0)  # m above the tree line, between which plants get lower
_STEEPEST = 1.3  # rise over run at which tufts still hold
_WATERSIDE = 0.72  # water mask from which it is too wet
_GRASS, _FLOWER, _FERN = (SPECIES.index(name) for name in ("grass", "flower", "fern"))


class Meadow:
    """Grass, flowers and ferns of a recipe; see :class:`SpacingRule` for step, least and most."""

    def __init__(self, evaluator: Evaluator) -> None:
        recipe = evaluator.recipe
        self._evaluator = evaluator
        self._climate = recipe.climate
        self._noise = PlantNoise(recipe)
        unit = metres_per_unit(recipe.extent)
        self.step = power_of_two_step(CELL, recipe.extent)
        self.least, self.most = max(round(LEAST / unit), 2), max(round(MOST / unit), 4)
        self._cell = self.step * unit
        full = [float(density_of(_APART[name])) if name in _APART else 0.0 for name in MATERIALS]
        self._full = np.array(full, np.float32)

    def densities(self, x: LatticeArray, y: LatticeArray) -> FloatArray:
        """Return plants per square metre; see :class:`SpacingRule`."""
        padded_x, padded_y = (padded_axes(each, self.step) for each in (x, y))
        surface = self._evaluator.surface(padded_x, padded_y[:, ::-1], cell_size=self._cell)
        density = np.zeros(surface.height.shape, np.float32)
        # One material after the other: the order of a library's sums is unspecified.
        for material, full in enumerate(self._full):
            if full > 0:
                density += full * surface.materials[:, ::-1, :, material]
        wide, narrow = (self._noise.over_blocks("tufts", width, x, y) for width in _PATCHES)
        thick = _THIN + (1 - _THIN) * ramp(0.6 * wide + 0.4 * narrow, 0.2, 0.6)
        return np.asarray(density * (thick * (1 - _DROUGHT * self._climate["aridity"] ** 2)))

    def survives(self, sites: PlantSites) -> npt.NDArray[np.bool_]:
        """Return which plants can grow at their exact positions."""
        return np.asarray((sites.steepness < _STEEPEST) & (sites.water < _WATERSIDE))

    def assign_species(self, plants: npt.NDArray[Any], sites: PlantSites, spacing: FloatArray) -> None:
        """Write the species and scale of plants; neither depends on the spacing (m)."""
        x, y, dry = sites.x, sites.y, self._climate["aridity"]
        ferns = _FERNS * (1 - dry) * ramp(sites.forest, *_SHADED)
        wide, narrow = (self._noise.at("bloom", width, x, y) for width in _BLOOM)
        bloom = ramp(0.7 * wide + 0.3 * narrow, 0.55, 0.8) * (1 - dry) * (1 - ramp(sites.forest, *_SHADED))
        flowers = _FLOWERS[0] + (_FLOWERS[1] - _FLOWERS[0]) * bloom
        fern = self._noise.draw("fern", x, y) < ferns
        flower = self._noise.draw("flower", x, y) < flowers
        plants["species"] = np.where(fern, _FERN, np.where(flower, _FLOWER, _GRASS))
        above = sites.z - self._climate["tree_line"]
        lush = (1 + 0.5 * ramp(sites.water, *_DAMP)) * (1 - 0.4 * ramp(above, *_LOWER_UP)) * (1 - 0.35 * dry)
        plants["scale"] = (0.6 + 0.7 * self._noise.draw("tuft scale", x, y)) * lush
