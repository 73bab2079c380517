"""The land that rivers run down, asked at places and remembered from one recipe to the next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from sketchterrain.features.fill_changes import rows_only_in
from sketchterrain.terrain.culling import features_near
from sketchterrain.terrain.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.packing import effective_cell, pack_features
from sketchterrain.terrain.reference import dry_heights

if TYPE_CHECKING:
    import numpy.typing as npt

    from sketchterrain.features.catalogue import Points
    from sketchterrain.terrain.recipe import TerrainRecipe

    Reals = npt.NDArray[np.float64]
    Lattice = npt.NDArray[np.int64]

# Rivers see the ground as samples so far apart would: its lie, not its stones.
_CELLS_PER_EXTENT = 256
_FARTHEST = 2**31  # lattice units: farther places are not remembered


@dataclass(frozen=True, eq=False)
class _Known:
    """Heights of one recipe's land.

    Attributes
    ----------
    world : tuple
        Everything that the land depends on but its features.
    block : (4,) int64
        Rectangle around all places, lattice units.
    features : array of FEATURE
        Those that reach it.
    key : (n,) int64
        The places, ascending.
    height : (n,) float64
        Metres.
    """

    world: tuple[object, ...]
    block: Lattice
    features: Points
    key: Lattice
    height: Reals


@dataclass
class GroundMemory:
    """What was asked of the last recipe's land; several threads may share it."""

    last: _Known | None = None


class DryGround:
    """Heights of a recipe's land without rivers and lakes, each place asked once.

    Parameters
    ----------
    recipe : TerrainRecipe
    memory : GroundMemory
        Heights of places that nothing changed is near to come from there; the bits are the same.
    """

    def __init__(self, recipe: TerrainRecipe, memory: GroundMemory) -> None:
        self._recipe = recipe
        self._memory = memory
        self._cell = recipe.extent / _CELLS_PER_EXTENT
        settings = (recipe.ground["relief"], recipe.stacks, recipe.dune_styles)
        self._world = (recipe.extent, recipe.seed, recipe.fidelity, *settings)
        self._asked: Lattice = np.zeros(0, dtype=np.int64)
        self._key, self._height = self._still_good(memory.last)

    def __call__(self, x: Reals, y: Reals) -> Reals:
        """Return heights (m) at positions (m), shape (n,)."""
        east, north = (to_lattice(each, self._recipe.extent) for each in (x, y))
        if len(east) == 0 or max(np.abs(east).max(), np.abs(north).max()) >= _FARTHEST:
            return dry_heights(self._recipe, east, north, cell_size=self._cell)
        key, inverse = np.unique((east << 32) + north, return_inverse=True)
        row = np.minimum(np.searchsorted(self._key, key), max(len(self._key) - 1, 0))
        known = self._key[row] == key if len(self._key) else np.zeros(len(key), dtype=np.bool_)
        height = np.zeros(len(key))
        height[known] = self._height[row[known]]
        if not known.all():
            at = _places(key[~known])
            height[~known] = dry_heights(self._recipe, *at, cell_size=self._cell)
            merged = np.concatenate([self._key, key[~known]])
            order = np.argsort(merged)
            self._key = merged[order]
            self._height = np.concatenate([self._height, height[~known]])[order]
        self._asked = np.union1d(self._asked, key)
        return np.asarray(height[inverse])

    def remember(self) -> None:
        """Keep what was asked for the next recipe, all else is forgotten."""
        if len(self._asked) == 0:
            return
        row = np.searchsorted(self._key, self._asked)
        block = _around(self._asked)
        known = _Known(self._world, block, self._near(block), self._asked, self._height[row])
        self._memory.last = known

    def _near(self, block: Lattice) -> Points:
        return features_near(self._recipe, block[None], min_radius=effective_cell(self._cell))

    def _still_good(self, last: _Known | None) -> tuple[Lattice, Reals]:
        """Places, ascending, and heights that are still the same: no feature that changed reaches them."""
        if last is None or last.world != self._world:
            return np.zeros(0, dtype=np.int64), np.zeros(0)
        now = self._near(last.block)
        changed = np.concatenate([rows_only_in(now, last.features), rows_only_in(last.features, now)])
        packed = pack_features(self._recipe, changed, self._cell)
        good = np.ones(len(last.key), dtype=np.bool_)
        east, north = _places(last.key)
        unit = metres_per_unit(self._recipe.extent)
        for (x, y), reach in zip(packed.at, packed.support, strict=True):
            good &= np.hypot(east - x, north - y) * unit > reach
        return last.key[good], last.height[good]


def _places(key: Lattice) -> tuple[Lattice, Lattice]:
    """Positions by their keys: the one in the high half, the other, signed, in the low half."""
    north = (key & 0xFFFFFFFF).astype(np.uint32).view(np.int32).astype(np.int64)
    return (key - north) >> 32, north


def _around(key: Lattice) -> Lattice:
    east, north = _places(key)
    return np.array([east.min(), north.min(), east.max(), north.max()])
