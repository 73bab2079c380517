"""Terrain heights on the host, in plain NumPy float64.

Used to route rivers before any device is opened, and to check the kernels. Only + - * / and sqrt are used, so
that results are the same on every machine.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.geometry.lattice import to_lattice
from sketchterrain.io.resources import kernel_constants
from sketchterrain.terrain.layers.base import BaseLayer
from sketchterrain.terrain.layers.layer import HostSamples, HostSite, effective_cell
from sketchterrain.terrain.layers.points import PointFinder
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.noise import FINEST_CELL, ValueSlope
from sketchterrain.terrain.recipe import TerrainRecipe

_DRY_WATER, _INVERSE_WET = kernel_constants("world.clh", "DRY_WATER", "INVERSE_WET")


@dataclass(frozen=True, eq=False)
class Ground:
    """Heights (m) of a recipe for cells of a size (m), as a function of positions x and y (n,), m."""

    recipe: TerrainRecipe
    cell: float

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return heights (n,), m."""
        at = (to_lattice(each, self.recipe.extent) for each in (x, y))
        return self._terrain.heights(*at, cell_size=self.cell)

    def displaced(self, at: Float64Array) -> Float64Array:
        """Return where nodes of the relief (n, 2), m, appear."""
        octaves = self.recipe.sampling(FINEST_CELL).octaves
        return self.recipe[ReliefLayer].displaced(at, self.recipe.world, octaves)

    @cached_property
    def _terrain(self) -> HostTerrain:
        return HostTerrain(self.recipe)


class HostTerrain:
    """A recipe evaluated on the host."""

    def __init__(self, recipe: TerrainRecipe) -> None:
        self._recipe = recipe
        self._finder = PointFinder(recipe.points, recipe.world)
        self._nodes = recipe[ReliefLayer].reader()

    def heights(self, x: LatticeArray, y: LatticeArray, *, cell_size: float = 0.0) -> Float64Array:
        """Return heights (m) at lattice positions of shape (n,)."""
        return self.samples(x, y, cell_size=cell_size, masks=False).height

    def samples(
        self, x: LatticeArray, y: LatticeArray, *, cell_size: float = 0.0, masks: bool = True
    ) -> HostSamples:
        """Return the terrain at lattice positions of shape (n,), with or without the mask of forests."""
        site = self._site(x, y, cell_size, masks=masks)
        ground = self._ground(x)
        for layer in self._recipe.layers:
            ground = layer.heights(ground, site)
        beside = _INVERSE_WET * (ground.water - _DRY_WATER)
        return replace(ground, wetness=np.maximum(ground.wetness * (1 - ground.dune), beside))

    def slopes(self, x: LatticeArray, y: LatticeArray, *, cell_size: float = 0.0) -> ValueSlope:
        """Return heights (m) and slopes of the drained ground with its gullies, without roughness.

        Slopes of gullies are taken with the direction of each wave held constant, as the filter takes them.
        """
        site = self._site(x, y, cell_size)
        self._recipe[BaseLayer].heights(self._ground(x), site)
        return self._recipe[ReliefLayer].eroded(site)

    def _ground(self, x: LatticeArray) -> HostSamples:
        return HostSamples(**{each.name: np.zeros(x.shape) for each in fields(HostSamples)})

    def _site(self, x: LatticeArray, y: LatticeArray, cell_size: float, *, masks: bool = False) -> HostSite:
        return HostSite(
            self._recipe.sampling(effective_cell(cell_size)), x, y, masks, self._finder, self._nodes
        )


def host_heights(
    recipe: TerrainRecipe, x: Float64Array, y: Float64Array, *, cell_size: float = 0.0
) -> Float64Array:
    """Return heights (m) at points in metres (any shape), in float64."""
    x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
    at = (to_lattice(each.ravel(), recipe.extent) for each in (x, y))
    return HostTerrain(recipe).heights(*at, cell_size=cell_size).reshape(x.shape)
