"""Inputs of the terrain kernels: layers packed and uploaded, and what affects which block."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import copy
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import LatticeArray, StructuredArray
from sketchterrain.caching import LRUCache
from sketchterrain.io.resources import kernel_arguments
from sketchterrain.terrain.culler import Culler, PointCuller, ReliefCuller, WholeCuller
from sketchterrain.terrain.layers.base import BaseCuller, BaseLayer
from sketchterrain.terrain.layers.landuse import LandUseCuller, LandUseLayer
from sketchterrain.terrain.layers.layer import (
    MASKS,
    MAX_CELL_SIZES,
    Culled,
    Sampling,
    TerrainLayer,
    WorldSettings,
    effective_cell,
    upload_reals,
)
from sketchterrain.terrain.layers.points import PointsLayer
from sketchterrain.terrain.layers.relief import ReliefLayer
from sketchterrain.terrain.materials import material_defines, pack_rules
from sketchterrain.terrain.recipe import RecipeChange, TerrainRecipe

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

# Cullers of layers that are not on the device as a whole, by the layer's name.
_CULLERS: Final[Mapping[str, Callable[[Any, ComputeContext, WorldSettings], Culler]]] = {
    PointsLayer.name: PointCuller,
    BaseLayer.name: BaseCuller,
    ReliefLayer.name: ReliefCuller,
    LandUseLayer.name: LandUseCuller,
}


def culler_of(layer: TerrainLayer, context: ComputeContext, world: WorldSettings) -> Culler:
    """Return a layer's arguments and lists on a device."""
    return _CULLERS.get(layer.name, WholeCuller)(layer, context, world)


class KernelInputs:
    """A recipe on an open device: the arguments of its kernels, by name."""

    def __init__(self, recipe: TerrainRecipe, context: ComputeContext) -> None:
        self.recipe = recipe
        self.context = context
        self.defines = material_defines(recipe.materials)
        self.rules = _upload_rules(recipe, context)
        self.cullers = {layer.name: culler_of(layer, context, recipe.world) for layer in recipe.layers}
        self._worlds = LRUCache(MAX_CELL_SIZES)

    def updated(self, change: RecipeChange) -> KernelInputs:
        """Return the inputs of a changed recipe, sharing unchanged buffers."""
        other = copy(self)
        other.recipe, other.cullers = change.recipe, dict(self.cullers)
        for layer in change.recipe.layers:
            if layer.name in change.layers:
                other.cullers[layer.name] = self.cullers[layer.name].updated(layer, change.layers[layer.name])
        return other

    def point_features(self, blocks: LatticeArray) -> StructuredArray:
        """Return the point features that may affect any of the blocks (n, 4), sorted by id."""
        culler = self.cullers[PointsLayer.name]
        assert isinstance(culler, PointCuller)  # noqa: S101 # which that layer makes
        return culler.near(blocks)

    def sampling(self, cell_size: float) -> Sampling:
        """Return what layers are packed for at a cell size (m)."""
        return self._at_cell(cell_size)[0]

    def cull(
        self,
        blocks: LatticeArray,
        cell_size: float,
        *,
        around: LatticeArray | None = None,
        surface: bool = False,
        heights_only: bool = False,
    ) -> dict[str, Culled]:
        """Return what affects blocks by layer: those of heights, or of the ``surface``; see `Culler.cull`.

        With ``heights_only`` lists of layers that change no height are empty.
        """
        sampling = self.sampling(cell_size)
        return {
            layer.name: self.cullers[layer.name].cull(
                blocks if layer.has_heights or not heights_only else blocks[:0], sampling, around
            )
            for layer in self.recipe.layers
            if layer.surface == surface
        }

    def arguments(
        self, macro: str, culled: Mapping[str, Culled], cell_size: float, staged: Mapping[str, Any]
    ) -> list[Any]:
        """Return the arguments in a list of ``kernels/tiles.cl``, in order.

        ``staged`` are device buffers of the layers' lists, by name.
        """
        named = dict(staged) | self._at_cell(cell_size)[1]
        for each in culled.values():
            named |= each.buffers
        return [named[name] for name in kernel_arguments("tiles.cl", macro)]

    def empty_masks(self, culled: Mapping[str, Culled], blocks: int) -> npt.NDArray[np.int32]:
        """Return the bits of the masks that are 0 on all of a block, shape (blocks,)."""
        present = np.zeros(blocks, np.int32)
        for layer in self.recipe.layers:
            if layer.name in culled:
                present |= layer.masks(culled[layer.name], blocks)
        return ~present & ((1 << len(MASKS)) - 1)

    def _at_cell(self, cell_size: float) -> tuple[Sampling, dict[str, Any]]:
        """Return what layers are packed for, and the buffers of ``WORLD_ARGUMENTS``; cached."""
        cell = effective_cell(cell_size)

        def compute() -> tuple[Sampling, dict[str, Any]]:
            sampling = self.recipe.sampling(cell, self.context.real_dtype)
            return sampling, upload_reals(self.context, self.recipe.pack_world(sampling))

        return self._worlds.get_or_compute(cell, compute)


def _upload_rules(recipe: TerrainRecipe, context: ComputeContext) -> list[Any]:
    """Return the arguments of ``RULE_ARGUMENTS`` and ``STRATA_ARGUMENTS`` in ``kernels``."""
    rules, (east, north, up) = pack_rules(recipe), recipe.strata.across
    unit, strength = recipe.world.unit, recipe.strata.rock.bedding
    arrays: dict[str, npt.NDArray[Any]] = {"form": rules.form, "cover": rules.cover, "ramp": rules.ramp}
    arrays["strata"] = np.array([[east * unit, north * unit, up, strength], [east, north, 0.0, 0.0]])
    return [np.int32(rules.count), *upload_reals(context, arrays).values()]
