"""The storey of grass tufts, flowers and ferns: how thick they stand, and which; it ignores the trees."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.plant import SPECIES
from sketchterrain.terrain.plant_noise import PlantNoise, ramp
from sketchterrain.terrain.plant_spacing import density_of, whole_step, widened

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.terrain.evaluation import Evaluator
    from sketchterrain.terrain.plant_footing import Footing

    Lattice = npt.NDArray[np.int64]
    Reals = npt.NDArray[np.floating]

LEAST: Final = 0.5
"""m between tufts where they stand thickest."""
MOST: Final = 4.0
"""m between single ones; where they would stand thinner none does."""
CELL: Final = 2.0
"""m between the raster's vertices, about."""

_APART = {
    "grass": 0.5,
    "forest_floor": 1.2,
    "soil": 1.5,
    "scree": 2.4,
    "river_bed": 3.0,
    "sand": 3.4,
    "rock": 3.8,
}
"""m between plants where all the ground is of a material and they stand thickest; on snow there are none."""
_PATCHES = (23.0, 6.0)  # m, from one thick patch to the next, and their ragged borders
_THIN = 0.3  # times as many as in a thick patch stand between
_DROUGHT = 0.8  # share of plants that a desert is short of
_SHADED = (0.1, 0.6)  # forest mask from which on ferns come, and at which they are most
_FERNS = 0.75  # share of a forest floor's plants that are ferns at most, where it is not dry
_BLOOM = (48.0, 9.0)  # m, from one bloom of flowers to the next, and their ragged borders
_FLOWERS = (0.02, 0.4)  # share of a meadow's plants that are flowers, between blooms and in their midst
_DAMP = (0.05, 0.5)  # water mask at which grass gets taller, and at which it is tallest
_LOWER_UP = (-150.0, 200.0)  # m above the tree line, between which plants get lower
_STEEPEST = 1.3  # rise over run on which tufts hold
_WATERSIDE = 0.72  # water mask from which on it is too wet
_GRASS, _FLOWER, _FERN = (SPECIES.index(name) for name in ("grass", "flower", "fern"))


class Meadow:
    """Grass, flowers and ferns of a recipe.

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
        self._climate = recipe.climate
        self._noise = PlantNoise(recipe)
        unit = metres_per_unit(recipe.extent)
        self.step = whole_step(CELL, recipe.extent)
        self.least, self.most = max(round(LEAST / unit), 2), max(round(MOST / unit), 4)
        self._cell = self.step * unit
        full = [float(density_of(_APART[name])) if name in _APART else 0.0 for name in MATERIALS]
        self._full = np.array(full, np.float32)

    def densities(self, x: Lattice, y: Lattice) -> Reals:
        """Return plants on a square metre; see :class:`SpacingRule`."""
        wide_x, wide_y = (widened(each, self.step) for each in (x, y))
        surface = self._evaluator.surface(wide_x, wide_y[:, ::-1], cell_size=self._cell)
        density = np.zeros(surface.height.shape, np.float32)
        # One material after the other: what a library sums in which order is its own business.
        for material, full in enumerate(self._full):
            if full > 0:
                density += full * surface.materials[:, ::-1, :, material]
        wide, narrow = (self._noise.over_blocks("tufts", width, x, y) for width in _PATCHES)
        thick = _THIN + (1 - _THIN) * ramp(0.6 * wide + 0.4 * narrow, 0.2, 0.6)
        return np.asarray(density * (thick * (1 - _DROUGHT * self._climate["aridity"] ** 2)))

    def kept(self, foot: Footing) -> npt.NDArray[np.bool_]:
        """Tell which plants the exact place lets stand."""
        return np.asarray((foot.steepness < _STEEPEST) & (foot.water < _WATERSIDE))

    def fill(self, plants: npt.NDArray[Any], foot: Footing, spacing: Reals) -> None:
        """Give plants their species and scale; the spacing (m) says nothing about either."""
        x, y, dry = foot.x, foot.y, self._climate["aridity"]
        ferns = _FERNS * (1 - dry) * ramp(foot.forest, *_SHADED)
        wide, narrow = (self._noise.at("bloom", width, x, y) for width in _BLOOM)
        bloom = ramp(0.7 * wide + 0.3 * narrow, 0.55, 0.8) * (1 - dry) * (1 - ramp(foot.forest, *_SHADED))
        flowers = _FLOWERS[0] + (_FLOWERS[1] - _FLOWERS[0]) * bloom
        fern = self._noise.draw("fern", x, y) < ferns
        flower = self._noise.draw("flower", x, y) < flowers
        plants["species"] = np.where(fern, _FERN, np.where(flower, _FLOWER, _GRASS))
        above = foot.z - self._climate["tree_line"]
        lush = (1 + 0.5 * ramp(foot.water, *_DAMP)) * (1 - 0.4 * ramp(above, *_LOWER_UP)) * (1 - 0.35 * dry)
        plants["scale"] = (0.6 + 0.7 * self._noise.draw("tuft scale", x, y)) * lush
