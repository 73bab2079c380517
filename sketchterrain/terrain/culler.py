"""Layers on a device: their buffers, and what affects which block."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.box_index import BoxIndex, item_lists
from sketchterrain.terrain.layers.layer import (
    Culled,
    LayerChange,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
)

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

MAX_CELL_SIZES = 64
"""Cell sizes that packed layers are cached for."""


class Culler(Protocol):
    """A layer on a device."""

    def updated(self, layer: TerrainLayer, change: LayerChange) -> Culler:
        """Return the same for a changed layer with the same key, sharing what is unchanged."""
        ...

    def cull(self, blocks: LatticeArray, sampling: Sampling, around: LatticeArray | None = None) -> Culled:
        """Return what affects blocks (n, 4) of west, south, east and north, lattice units.

        ``around`` (m, 4): fewer, larger blocks that contain all of them, to select items by.
        """
        ...


class WholeCuller:
    """A layer all of whose items are on the device at once."""

    def __init__(self, layer: TerrainLayer, context: ComputeContext, world: WorldSettings) -> None:
        self._layer = layer
        self._context = context
        self._world = world
        self._packed = LRUCache(MAX_CELL_SIZES)
        self._shared = LRUCache(MAX_CELL_SIZES)  # buffers of arrays, by these

    def updated(self, layer: TerrainLayer, change: LayerChange) -> WholeCuller:
        """Return the culler of a changed layer."""
        del change
        return WholeCuller(layer, self._context, self._world)

    def cull(self, blocks: LatticeArray, sampling: Sampling, around: LatticeArray | None = None) -> Culled:
        """Return what affects blocks."""
        del around
        packed, buffers, index = self._packed.get_or_compute(
            self._layer.pack_key(sampling.cell), lambda: self._upload(sampling)
        )
        if index is None:
            return Culled(buffers, {}, packed)
        starts, members = item_lists(index, blocks, packed.visible)
        prefix = packed.lists
        return Culled(buffers, {f"{prefix}_starts": starts, f"{prefix}_list": members}, packed)

    def _upload(self, sampling: Sampling) -> tuple[Packed, dict[str, Any], BoxIndex | None]:
        packed = self._layer.pack(sampling)
        buffers = {
            name: self._shared.get_or_compute(id(array), partial(self._held, array))[1]
            for name, array in packed.arrays.items()
        }
        return packed, buffers, None if packed.boxes is None else BoxIndex(packed.boxes)

    def _held(self, array: npt.NDArray[Any]) -> tuple[npt.NDArray[Any], Any]:
        """Return an array, whose id is its own while it is held, and its buffer."""
        return array, _upload_real(self._context, array)


def upload_reals(context: ComputeContext, arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, Any]:
    """Return buffers of arrays by name, float64 ones converted to the kernels' REAL."""
    return {name: _upload_real(context, array) for name, array in arrays.items()}


def _upload_real(context: ComputeContext, array: npt.NDArray[Any]) -> Any:
    return context.upload(array.astype(context.real_dtype) if array.dtype == np.float64 else array)


def list_arrays(culled: Mapping[str, Culled]) -> dict[str, npt.NDArray[Any]]:
    """Return the lists of all layers, by the names of the kernels' arguments."""
    return {name: array for each in culled.values() for name, array in each.lists.items()}
