"""Elevation data under the sketch: patches that kernels blend to one surface, in slots on a device."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.elevation.base import BaseElevation
from sketchterrain.elevation.detail_law import DetailLaw, slope_terms
from sketchterrain.elevation.patches import COEFFICIENTS
from sketchterrain.elevation.surface import Heights, PatchSlots
from sketchterrain.geometry.box_index import BoxIndex, item_lists
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.landforms.node_raster import node_level
from sketchterrain.terrain.layers.erosion import gully_octave, gully_steepness
from sketchterrain.terrain.layers.layer import (
    MAX_CELL_SIZES,
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    LayerChange,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    smooth_rise,
    upload_reals,
)
from sketchterrain.terrain.noise import (
    FINEST_CELL,
    NoiseStack,
    OctaveTable,
    ValueSlope,
    octave_noise,
    omitted_amplitudes,
)

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.elevation.selection import Patchwork


_DETAIL_HEADER: Final = "layers/base_detail.clh"
_GULLY, _PER_NOISE, _PER_GULLY = kernel_constants(
    _DETAIL_HEADER, "BASE_GULLY", "INVERSE_NOISE_RMS", "INVERSE_GULLY_RMS"
)
_GAIN = 0.5
_PEAK = 5.0  # bound of an octave over its rms on the same slope
_DEVIATIONS = 4.0  # of the detail that its bound is, at least
_SQUEEZED = 1.05  # by how much that lowers the deviation


class DetailScale(NamedTuple):
    """What patches of a grid carry; means by their weights at points."""

    resolution: Float64Array | float  # longest wavelength that was lost, m
    depth: Float64Array | float  # factor of all amplitudes
    bound: Float64Array | float  # that no height moves farther than, m


@dataclass(frozen=True)
class BaseDetail:
    """Detail below grids of real elevation (docs/kernels/base.md)."""

    law: DetailLaw  # of the grid that covers most
    strength: float = 1.0  # 0 … 1

    def stack(self, world: WorldSettings) -> NoiseStack:
        """Return its noise."""
        return NoiseStack("base", world.extent / 8, _GAIN)

    def scale(self, law: DetailLaw, accuracy: float | None, world: WorldSettings) -> DetailScale:
        """Return what patches of a grid carry: with it, their detail has the rms that the grid lost.

        Heights move by less than its declared accuracy (m), or by less than 4 rms.
        """
        bound = _DEVIATIONS * law.lost if accuracy is None else accuracy
        finest = world.unit * 2.0 ** round(np.log2(self.stack(world).wavelength / world.unit))
        wavelength = finest * 2.0 ** (np.ceil(np.log2(law.resolution / finest)) - np.arange(16.0))
        octaves = _onset(wavelength / law.resolution) * self.law.octave(wavelength)
        rms = float(np.sqrt(np.sum(octaves**2)))
        depth = _SQUEEZED * min(law.lost, bound / _DEVIATIONS)
        return DetailScale(law.resolution, depth / rms if rms else 0.0, bound)

    def pack(self, sampling: Sampling) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays of the kernels' arguments."""
        names = ("gentle", "middling", "steep", "slope_square")
        values = sampling.ranges("base") | dict(zip(names, (*self.law.shape, self.law.slope**2), strict=True))
        octaves = np.stack(self._octaves(sampling.octaves, sampling.unit), axis=-1)
        return {
            "base_detail_params": sampling.struct(_DETAIL_HEADER, "BaseDetailParams", values),
            "base_detail_octave": octaves.astype(sampling.real),
        }

    def _octaves(self, octaves: OctaveTable, unit: float) -> tuple[Float64Array, Float64Array]:
        """Return the factors of the stack's octaves (m), and their wavelengths (m)."""
        wavelength = unit / octaves.scale[slice(*octaves.ranges["base"]), 1]
        nominal = (1 - _GAIN) * _GAIN ** np.arange(float(len(wavelength)))
        return self.strength * self.law.octave(wavelength) / nominal, wavelength

    def heights(self, site: HostSite, z: ValueSlope, data: DetailScale) -> Float64Array:
        """Return the detail (m) at points where the data have the heights and slopes z."""
        octaves = site.sampling.octaves
        square = z.east**2 + z.north**2
        depth = data.depth * np.sqrt(slope_terms(square, self.law.slope) @ self.law.shape)
        share = _GULLY * gully_steepness(square)
        rough, deep = depth * _PER_NOISE * np.sqrt(1 - share**2), depth * (_GULLY * _PER_GULLY)
        detail, cut = np.zeros(site.x.shape), ValueSlope(*np.zeros((3, *site.x.shape)))
        packed = zip(*self._octaves(octaves, site.sampling.unit), strict=True)
        for i, (factor, wavelength) in enumerate(packed, start=octaves.ranges["base"][0]):
            amplitude = _onset(wavelength / data.resolution) * factor * octaves.scale[i, 0]
            if np.any(amplitude):
                detail += rough * amplitude * octave_noise(octaves, i, site.x, site.y)
                cut = gully_octave(octaves, i, site, deep * amplitude, z, cut)
        detail += cut.value
        return np.asarray(detail * data.bound / np.maximum(np.hypot(detail, data.bound), 1e-300))

    def omitted(
        self, sampling: Sampling, data: DetailScale, turned: npt.NDArray[np.bool_]
    ) -> tuple[Float64Array, Float64Array]:
        """Return bounds (m) of what a cell size omits near n blocks, and of the detail.

        `data` (n,) are the largest values near each block. Where the slope of the data depends on the cell
        size, blocks are `turned`: all octaves differ.
        """
        factor, wavelength = self._octaves(sampling.all_octaves, sampling.unit)
        whole, left = omitted_amplitudes(sampling.all_octaves, sampling.octaves, "base")
        weight = _onset(wavelength / np.asarray(data.resolution)[:, None]) * factor
        peak = _PEAK * np.asarray(data.depth) * np.sqrt(max(self.law.shape))
        most = np.minimum(peak * (weight @ whole), data.bound)
        return np.minimum(peak * (weight @ (whole - left) + 2 * turned * (weight @ left)), 2 * most), most


def no_detail(sampling: Sampling) -> dict[str, npt.NDArray[Any]]:
    """Return the arrays of the kernels' arguments without any detail."""
    values = dict.fromkeys(("gentle", "middling", "steep", "slope_square", "base_first", "base_last"), 0)
    params = sampling.struct(_DETAIL_HEADER, "BaseDetailParams", values)
    return {"base_detail_params": params, "base_detail_octave": np.zeros((0, 2), sampling.real)}


def _onset(wavelengths: Any) -> Float64Array:
    """Return the weight of octaves by their wavelength over the resolution: 0 from 1 on, 1 up to 1/2."""
    return 1 - smooth_rise(wavelengths, 0.5, 0.5)


_HEADER: Final = "layers/base.clh"
_ROW: Final = kernel_columns(_HEADER, "BaseRow")
ROW_VALUES: Final = 24
"""Values of a ``BaseRow``."""
SLOTS: Final = 8192
"""Patches on a device, 50 MB; more only if one launch needs them."""

_ROUNDING = 2  # lattice units


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

    def pack(self, sampling: Sampling) -> Packed:
        """Return the octaves of detail; patches are packed for the blocks that they reach."""
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


@dataclass(frozen=True, eq=False)
class _Cover:
    """The patches for a cell size: the largest first, then by number, as they are summed."""

    numbers: Int64Array
    error: Float64Array  # m; 0 for those of full detail
    index: BoxIndex


class BaseCuller:
    """Patches of elevation data that blocks need; they stay on the device until others take their slots."""

    def __init__(self, layer: BaseLayer, context: ComputeContext, world: WorldSettings) -> None:
        self._layer = layer
        self._context = context
        self._world = world
        self._packed = LRUCache(MAX_CELL_SIZES)
        self._covers = LRUCache(MAX_CELL_SIZES)
        self._slots: PatchSlotBuffers | None = None

    def updated(self, layer: TerrainLayer, change: LayerChange) -> BaseCuller:
        """Return itself: other data are another key."""
        del layer, change
        return self

    def cull(self, blocks: LatticeArray, sampling: Sampling, around: LatticeArray | None = None) -> Culled:
        """Return the patches that reach blocks (n, 4)."""
        del around
        if self._slots is None:
            self._slots = PatchSlotBuffers(self._layer, self._context, self._world)
        packed = self._packed.get_or_compute(
            sampling.cell,
            lambda: upload_reals(self._context, self._layer.pack(sampling).arrays),
        )
        if self._layer.base is None:
            lists = {"base_starts": np.zeros(len(blocks) + 1, np.int32), "base_list": np.zeros(0, np.int32)}
            return Culled(self._slots.buffers | packed, lists, None)
        work = self._layer.base.patchwork
        cover = self._covers.get_or_compute(sampling.cell, lambda: self._cover(work, sampling.cell))
        starts, members = item_lists(cover.index, blocks)
        used, position = np.unique(members, return_inverse=True)
        slots = self._slots.place(cover.numbers[used])
        low, high, error = np.zeros((3, len(blocks)))
        filled = np.flatnonzero(np.diff(starts))
        if len(filled):
            first = starts[filled]
            low[filled] = np.minimum.reduceat(self._slots.low[slots][position], first)
            high[filled] = np.maximum.reduceat(self._slots.high[slots][position], first)
            error[filled] = np.maximum.reduceat(cover.error[members], first)
        lists = {"base_starts": starts, "base_list": slots[position].astype(np.int32)}
        near = NearPatches(np.diff(starts) > 0, low, high, error)
        return Culled(self._slots.buffers | packed, lists, near)

    def _cover(self, work: Patchwork, cell: float) -> _Cover:
        numbers = work.cover_for_cells(cell)
        reach = work.reach[numbers].astype(np.float64)
        side = np.maximum(reach[:, 2] - reach[:, 0], reach[:, 3] - reach[:, 1])
        order = np.lexsort((numbers, -np.ceil(np.log2(side))))
        numbers = numbers[order]
        full = np.isin(numbers, work.cover_for_cells(FINEST_CELL))
        boxes = reach[order] / self._world.unit
        low, high = np.floor(boxes[:, :2]) - _ROUNDING, np.ceil(boxes[:, 2:]) + _ROUNDING
        index = BoxIndex(np.concatenate([low, high], axis=1).astype(np.int64))
        return _Cover(numbers, np.where(full, 0.0, work.error[numbers] + work.accuracy), index)


class PatchSlotBuffers:
    """Buffers of patches by slot, the names of the kernels' arguments; slots are reused in a ring."""

    def __init__(self, layer: BaseLayer, context: ComputeContext, world: WorldSettings) -> None:
        self._work = None if layer.base is None else layer.base.patchwork
        self._context, self._unit, self._scales = context, world.unit, layer.scales(world)
        self._slot_of: dict[int, int] = {}
        self._allocate(SLOTS if self._work is not None else 1)

    def _allocate(self, count: int) -> None:
        side, real = COEFFICIENTS, self._context.real_dtype
        self._slot_of.clear()
        self._held = np.full(count, -1)  # numbers of the patches
        self._next = 0
        self.low, self.high = np.zeros((2, count))  # m
        self._arrays: dict[str, tuple[tuple[int, ...], Any]] = {
            "base_at": ((2,), np.int64),
            "base_row": ((ROW_VALUES,), real),
            "base_spline": ((side, side), np.float32),
            "base_mask": ((side, side), np.uint8),
        }
        self.buffers = {
            name: self._context.empty((count, *shape), kind) for name, (shape, kind) in self._arrays.items()
        }

    def place(self, numbers: Int64Array) -> Int64Array:
        """Return the slots of patches, each once; what is missing is uploaded."""
        if len(numbers) > len(self._held):
            self._allocate(2 * len(numbers))
        slots = np.array([self._slot_of.get(number, -1) for number in numbers.tolist()], np.int64)
        missing = np.flatnonzero(slots < 0)
        if len(missing):
            free = np.ones(len(self._held), np.bool_)
            free[slots[slots >= 0]] = False
            ring = (np.arange(len(free)) + self._next) % len(free)
            taken = np.sort(ring[free[ring]][: len(missing)])
            self._next = int(ring[np.flatnonzero(free[ring])[len(missing) - 1]]) + 1
            self._upload(numbers[missing], taken)
            slots[missing] = taken
        return slots

    def _upload(self, numbers: Int64Array, slots: Int64Array) -> None:
        assert self._work is not None  # noqa: S101 # there are patches
        for old in self._held[slots].tolist():
            self._slot_of.pop(old, None)
        self._held[slots] = numbers
        self._slot_of.update(zip(numbers.tolist(), slots.tolist(), strict=True))
        patches = self._work.slots(numbers)
        at, row = pack_rows(patches, self._scales, self._unit)
        height = patches.base[:, None] + patches.coefficients.reshape(len(at), -1)
        self.low[slots], self.high[slots] = height.min(axis=1), height.max(axis=1)
        mask = np.zeros(patches.coefficients.shape, np.uint8)
        mask[patches.mask_of >= 0] = patches.masks[patches.mask_of[patches.mask_of >= 0]]
        values = {"base_at": at, "base_row": row, "base_spline": patches.coefficients, "base_mask": mask}
        ends = [0, *(np.flatnonzero(np.diff(slots) != 1) + 1).tolist(), len(slots)]
        for name, array in values.items():
            shape, kind = self._arrays[name]
            stride = int(np.prod(shape)) * np.dtype(kind).itemsize
            part = np.ascontiguousarray(array, kind)
            for first, last in pairwise(ends):
                start = int(slots[first]) * stride
                self._context.upload_into(self.buffers[name], part[first:last], start=start)
