"""Elevation data under the sketch: patches that kernels blend to one surface."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Final

import numpy as np

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.elevation.base import BaseElevation
from sketchterrain.elevation.surface import PatchSlots
from sketchterrain.io.resources import kernel_columns
from sketchterrain.terrain.layers.layer import (
    DetailState,
    HostSamples,
    HostSite,
    Sampling,
    TerrainLayer,
    WorldSettings,
)

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.culler import Culled
    from sketchterrain.terrain.layers.base_culler import BaseCuller, NearPatches

_HEADER: Final = "layers/base.clh"
_ROW: Final = kernel_columns(_HEADER, "BaseRow")
ROW_VALUES: Final = 20
"""Values of a ``BaseRow``."""


@dataclass(frozen=True, eq=False)
class BaseLayer(TerrainLayer):
    """Elevation data; the drained ground adds them by their weight."""

    name: ClassVar[str] = "base"

    base: BaseElevation | None = field(default=None)

    def culler(self, context: ComputeContext, world: WorldSettings) -> BaseCuller:
        """Return the patches on a device."""
        from sketchterrain.terrain.layers.base_culler import BaseCuller

        return BaseCuller(self, context, world)

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add the errors of patches that finer ones replace at full detail."""
        del sampling
        near: NearPatches | None = culled.details
        if near is None:
            return
        state.bound += near.error
        state.low += np.minimum(near.low, 0.0)
        state.high += np.maximum(near.high, 0.0)
        state.scale += np.maximum(np.abs(near.low), np.abs(near.high))

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground as it is; what the data are here is left to the drained ground."""
        if self.base is not None:
            x, y = (np.asarray(each * site.sampling.unit, np.float64) for each in (site.x, site.y))
            site.base = self.base.heights(x, y, site.sampling.cell)
        return ground


def pack_rows(slots: PatchSlots, unit: float) -> tuple[LatticeArray, Float64Array]:
    """Return the lattice units (n, 2) and the rows (n, `ROW_VALUES`) of patches as kernels read them.

    Centres are rounded to lattice units, and the maps to steps are counted from there.
    """
    at = np.rint(slots.centre / unit).astype(np.int64)
    x, y = (at * unit - slots.centre).T[:, :, None]
    c, cx, cy, cxx, cxy, cyy = np.moveaxis(slots.to_steps, 2, 0)
    row = np.zeros((len(at), 5, 4))
    row[:, :2, 0] = c + cx * x + cy * y + (cxx * x + cxy * y) * x + cyy * y * y
    row[:, :2, 1] = cx + 2.0 * cxx * x + cxy * y
    row[:, :2, 2] = cy + cxy * x + 2.0 * cyy * y
    row[:, 2:4, :3] = np.stack([cxx, cxy, cyy], axis=-1)
    masked = np.flatnonzero(slots.mask_of >= 0)
    row[masked, 4] = slots.rims[slots.mask_of[masked], :4]
    flat = row.reshape(len(at), ROW_VALUES)
    flat[:, _ROW["base_height"]] = slots.base
    flat[:, _ROW["base_density"]] = slots.density
    flat[:, _ROW["base_step"]] = slots.step
    flat[masked, _ROW["base_scale"]] = slots.rims[slots.mask_of[masked], 4]
    return at, flat
