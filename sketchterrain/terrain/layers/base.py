"""Elevation data under the sketch: patches that kernels blend to one surface."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.elevation.base import BaseElevation
from sketchterrain.elevation.surface import Heights, PatchSlots
from sketchterrain.io.resources import kernel_columns
from sketchterrain.landforms.node_raster import node_level
from sketchterrain.terrain.layers.base_detail import BaseDetail, DetailScale, no_detail
from sketchterrain.terrain.layers.layer import (
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
)
from sketchterrain.terrain.noise import NoiseStack, ValueSlope

_HEADER: Final = "layers/base.clh"
_ROW: Final = kernel_columns(_HEADER, "BaseRow")
ROW_VALUES: Final = 24
"""Values of a ``BaseRow``."""


@dataclass(frozen=True, eq=False)
class NearPatches:
    """Bounds of the patches near n blocks, m."""

    is_reached: BoolArray
    low: Float64Array
    high: Float64Array
    error: Float64Array  # of patches that full detail has finer ones for


class HostBase(NamedTuple):
    """What elevation data are at points, and the scale of the detail that they lack."""

    heights: Heights
    layer: BaseLayer

    def detail(self, site: HostSite, rise: ValueSlope) -> Float64Array | float:
        """Return the detail (m) on a ground with the data in it."""
        detail = self.layer.detail
        if detail is None:
            return 0.0
        known = np.isfinite(self.heights.height)
        scale = np.where(known, self.heights.means, [[detail.law.resolution], [0.0], [0.0]])
        return detail.heights(site, rise, DetailScale(*scale))


@dataclass(frozen=True, eq=False)
class BaseLayer(TerrainLayer):
    """Elevation data, and the detail below them; the drained ground adds both by their weight."""

    name: ClassVar[str] = "base"

    base: BaseElevation | None = None
    detail: BaseDetail | None = None

    @classmethod
    def of(cls, base: BaseElevation | None, strength: float) -> BaseLayer:
        """Return the layer of some data with a strength of detail, 0 … 1."""
        if base is None or not strength:
            return cls(base)
        widest = max(base.grids, key=lambda each: each.patches.step**2 * math.prod(each.patches.shape))
        return cls(base, BaseDetail(widest.patches.law, strength))

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return the noise of detail."""
        return () if self.detail is None else (self.detail.stack(world),)

    def scales(self, world: WorldSettings) -> Float64Array:
        """Return the scale of detail (grids, 3) of the patchwork's grids."""
        if self.base is None or self.detail is None:
            return np.zeros((0 if self.base is None else len(self.base.patchwork.grids), 3))
        found = {
            each.patches.id: self.detail.scale(
                each.patches.law, each.patches.accuracy if each.is_declared else None, world
            )
            for each in self.base.grids
        }
        return np.array([found[key] for key in self.base.patchwork.grids], np.float64)

    def pack(self, sampling: Sampling, cache: LRUCache) -> Packed:
        """Return the octaves of detail; patches are packed for the blocks that they reach."""
        del cache
        if self.detail is not None:
            return Packed(self.detail.pack(sampling))
        return Packed(no_detail(sampling))

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add the errors of patches that finer ones replace at full detail, and octaves of detail."""
        near: NearPatches | None = culled.details
        if near is None:
            return
        state.bound += near.error
        state.low += np.minimum(near.low, 0.0)
        state.high += np.maximum(near.high, 0.0)
        state.scale += np.maximum(np.abs(near.low), np.abs(near.high))
        if self.detail is None:
            return
        turned = (near.error > 0.0) | (node_level(sampling.cell, sampling.world.extent) > 0)
        most = self.scales(sampling.world).max(axis=0)
        resolution, depth, bound = (np.where(near.is_reached, each, 0.0) for each in most)
        scale = DetailScale(np.where(near.is_reached, resolution, most[0]), depth, bound)
        omitted, whole = self.detail.omitted(sampling, scale, turned)
        state.bound += omitted
        state.low -= whole
        state.high += whole

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground as it is; what the data are here is left to the drained ground."""
        if self.base is not None:
            x, y = (np.asarray(each * site.sampling.unit, np.float64) for each in (site.x, site.y))
            cell, scales = site.sampling.cell, self.scales(site.sampling.world)
            site.base = HostBase(self.base.heights(x, y, cell, scales), self)
        return ground


def pack_rows(slots: PatchSlots, scales: Float64Array, unit: float) -> tuple[LatticeArray, Float64Array]:
    """Return the lattice units (n, 2) and the rows (n, `ROW_VALUES`) of patches as kernels read them.

    Centres are rounded to lattice units, and the maps to steps are counted from there.
    """
    at = np.rint(slots.centre / unit).astype(np.int64)
    x, y = (at * unit - slots.centre).T[:, :, None]
    c, cx, cy, cxx, cxy, cyy = np.moveaxis(slots.to_steps, 2, 0)
    row = np.zeros((len(at), 6, 4))
    row[:, :2, 0] = c + cx * x + cy * y + (cxx * x + cxy * y) * x + cyy * y * y
    row[:, :2, 1] = cx + 2.0 * cxx * x + cxy * y
    row[:, :2, 2] = cy + cxy * x + 2.0 * cyy * y
    row[:, 2:4, :3] = np.stack([cxx, cxy, cyy], axis=-1)
    masked = np.flatnonzero(slots.mask_of >= 0)
    row[masked, 4] = slots.rims[slots.mask_of[masked], :4]
    row[:, 5, :3] = scales[slots.grid]
    flat = row.reshape(len(at), ROW_VALUES)
    flat[:, _ROW["base_height"]] = slots.base
    flat[:, _ROW["base_density"]] = slots.density
    flat[masked, _ROW["base_scale"]] = slots.rims[slots.mask_of[masked], 4]
    return at, flat
