"""Lakes: a bed that shelves from the shore, a beach, and a rim that holds the water."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import StructuredArray
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.landforms.placement.feature_types import Lake, cubic
from sketchterrain.terrain.layers.fields import (
    FieldRows,
    PackedFields,
    field_distance,
    field_items,
    pack_fields,
)
from sketchterrain.terrain.layers.layer import (
    ITEMS,
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    smooth_rise,
    soft_positive,
)

_HEADER: Final = "layers/lakes.clh"
LAKE: Final = kernel_columns(_HEADER, "LakeRow")
"""Columns of packed lakes."""
_RIM, _BEACH, _WATERSIDE, _BARE_SHORE, _SHORE_FRINGE, _SHARPNESS, _SOFTNESS = kernel_constants(
    _HEADER, "RIM", "BEACH", "WATERSIDE", "BARE_SHORE", "SHORE_FRINGE", "SHARPNESS", "SOFTNESS"
)
# Metres of shelf per metre of depth, if the lake is wide enough; slopes of the shore.
_SHELF_RUN = 8.0
_SHORE_SHARE = 0.5
_STEEPEST_SHORE = 0.2
_STEEPEST_BED = 1.0


@dataclass(frozen=True, eq=False)
class LakesLayer(TerrainLayer):
    """Lakes that have found their levels."""

    name: ClassVar[str] = "lakes"
    item_masks: ClassVar[tuple[str, ...]] = ("water", "wetness")

    lakes: tuple[Lake, ...] = field(metadata=ITEMS)

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return the lakes by their contents."""
        settings = [(lake.level, lake.depth) for lake in self.lakes]
        return field_items([lake.shape for lake in self.lakes], settings, world.extent)

    def pack(self, sampling: Sampling) -> Packed:
        """Return the fields and their profiles."""
        lakes, fields = self._rows(sampling), self._fields(sampling.world.extent)
        arrays: dict[str, npt.NDArray[Any]] = {
            "lake_at": fields.at,
            "lake_form": fields.form,
            "lake_shape": lakes.row[:, :4],
            "lake_profile": lakes.row[:, 4:],
            "lake_samples": fields.samples,
        }
        return Packed(arrays, fields.boxes, "lake", lakes.visible, lakes)

    def _fields(self, extent: float) -> PackedFields:
        shapes = [lake.shape for lake in self.lakes]
        return self.cache.get_or_compute(extent, lambda: pack_fields(shapes, extent))

    def _rows(self, sampling: Sampling) -> FieldRows:
        """Return the lakes' profiles; lakes narrower than two cells fade out and vanish at one.

        A lake is at most as deep as its greatest distance from the shore, so that its bed is no steeper than
        45°.
        """
        fields = self._fields(sampling.world.extent)
        level = np.array([lake.level for lake in self.lakes], dtype=np.float64)
        requested = np.array([lake.depth for lake in self.lakes], dtype=np.float64)
        deep = np.minimum(requested, _STEEPEST_BED * fields.depth)
        shelf = np.minimum(0.9 * fields.depth, _SHELF_RUN * deep)
        shore = np.minimum(_SHORE_SHARE * deep / shelf, _STEEPEST_SHORE)
        # The beach is a parabola over half the margin that starts with the shore's slope.
        rise = shore * fields.margin / 4
        fade = smooth_rise(2 * fields.depth / sampling.cell, 1, 1)
        row = np.zeros((len(fade), 8))
        row[:, 0] = fields.scale
        for name, values in {
            "inverse_margin": 1 / fields.margin,
            "lake_level": level,
            "lake_visible": fade,
            "lake_depth": deep,
            "inverse_shelf": 1 / shelf,
            "shore_drop": shore * shelf,
            "beach_rise": rise,
        }.items():
            row[:, LAKE[name]] = values
        return FieldRows(fields, LAKE, row, fade > 0)

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add the greatest change by lakes that fade out: terrain up to their rims, or down to their beds."""
        lakes: FieldRows = culled.details.details
        lost, level = 1 - lakes["lake_visible"], lakes["lake_level"]
        if not lost.any():
            return
        block, lake = lakes.fields.index.touching(state.blocks)
        up = 2 * np.maximum((level + lakes["beach_rise"])[lake] - state.low[block], 0)
        down = state.high[block] - (level - lakes["lake_depth"])[lake]
        bound = np.zeros(len(state.blocks))
        np.maximum.at(bound, block, lost[lake] * np.maximum(up, down))
        state.bound += bound

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with lakes in it."""
        if not self.lakes:
            return ground
        sampling, x, y, height = site.sampling, site.x, site.y, ground.height
        packed, fields = self._rows(sampling), self._fields(sampling.world.extent)
        weights, own, top, visible, deepest = np.zeros((5, *height.shape))
        nearest = np.ones(height.shape)
        for i in np.flatnonzero(packed.visible):
            inverse_margin, level, fade, depth, inverse_shelf, slope, rise = (
                packed[name][i] for name in LAKE
            )
            west, south, east, north = fields.boxes[i]
            at = np.flatnonzero((x >= west) & (x <= east) & (y >= south) & (y <= north))
            d = field_distance(fields, int(i), x[at], y[at])
            s = np.clip(-d * inverse_margin, 0, 1)
            t = np.clip(d * inverse_shelf, 0, 1)
            bed = level - depth * t**2 * (3 - 2 * t) - slope * t * (1 - t) ** 2
            weight = fade * (1 - s) ** 2 / (s**2 + _SHARPNESS) ** 2
            weights[at] += weight
            own[at] += weight * (bed + rise * (1 - np.maximum(1 - _BEACH * s, 0) ** 2))
            top[at] += weight * (level + rise)
            visible[at] += weight * fade
            nearest[at], deepest[at] = np.minimum(nearest[at], s), np.maximum(deepest[at], t)
        near = weights > 0
        own, top, visible = (part[near] / weights[near] for part in (own, top, visible))
        s, t, below = nearest[near], deepest[near], height[near]
        result, (water, lake) = height.copy(), np.zeros((2, *height.shape))
        terrain = below + visible * soft_positive(top - below, _SOFTNESS) * (1 - s**4) * (1 - s**2)
        result[near] = terrain + (own - terrain) * visible * cubic(np.maximum(s - _RIM, 0) / (1 - _RIM))
        beside = 0.75 * (1 - _WATERSIDE * s) - _BARE_SHORE * np.minimum(_SHORE_FRINGE * s, 1)
        water[near] = visible * (np.maximum(beside, 0) + 0.25 * t)
        lake[near] = visible * cubic(s / _RIM)
        return replace(
            ground, height=result, water=np.maximum(ground.water, water), lake=np.maximum(ground.lake, lake)
        )
