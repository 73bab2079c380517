"""Terrain layers: what each one declares, and the values that they hand on to one another."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property, partial
from typing import TYPE_CHECKING, Any, ClassVar, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, LatticeArray, StructuredArray
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.box_index import ITEM, row_difference
from sketchterrain.geometry.lattice import metres_per_unit
from sketchterrain.io.resources import kernel_struct
from sketchterrain.landforms.placement.feature_types import smoothstep
from sketchterrain.stages.digests import digest_of
from sketchterrain.terrain.noise import (
    FINEST_CELL,
    NOISE_PEAK,
    NoiseStack,
    OctaveTable,
    ValueSlope,
    omitted_amplitudes,
)

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

ITEMS: Final = {"items": True}
"""Metadata of dataclass fields that hold items, which a layer's key leaves out."""

MAX_CELL_SIZES = 64
"""Cell sizes that packed layers are cached for."""

MASKS: Final = ("mountain", "dune", "forest", "water", "wetness")
"""The masks of a point: see ``TerrainSample`` in ``kernels/world.clh``."""


def effective_cell(cell_size: float) -> float:
    """Return the cell size, but not below the one that resolves every octave."""
    return max(cell_size, FINEST_CELL)


@dataclass(frozen=True)
class WorldSettings:
    """What all layers depend on."""

    extent: float  # metres along the sketch's longer side
    seed: int
    fidelity: float  # 0 … 1; outlines deviate less towards 1

    @property
    def unit(self) -> float:
        """Metres per lattice unit."""
        return metres_per_unit(self.extent)


@dataclass(frozen=True)
class Sampling:
    """What layers are packed for: the world, the cell size, and the octaves that it resolves."""

    world: WorldSettings
    cell: float  # m, at least `FINEST_CELL`
    octaves: OctaveTable
    all_octaves: OctaveTable  # of the finest cell size
    real: np.dtype[Any]  # the kernels' REAL

    @property
    def unit(self) -> float:
        """Metres per lattice unit."""
        return self.world.unit

    def ranges(self, *stacks: str) -> dict[str, int]:
        """Return the first and the last (exclusive) octave of noise stacks, by the names in kernels."""
        found = {}
        for name in stacks:
            found[f"{name}_first"], found[f"{name}_last"] = self.octaves.ranges[name]
        return found

    def missing(self, stack: str) -> float:
        """Return a bound of what the cell size omits of a noise."""
        amplitude, left = omitted_amplitudes(self.all_octaves, self.octaves, stack)
        return float(np.sum(amplitude - left)) * NOISE_PEAK

    def struct(self, file: str, name: str, *rows: Mapping[str, float]) -> StructuredArray:
        """Return an array of a kernel's struct; rows have exactly the struct's members."""
        dtype = kernel_struct(file, name, self.real)
        for row in rows:
            if set(row) != set(dtype.names or ()):
                raise ValueError(f"expected the members {dtype.names}, got {sorted(row)}")
        return np.array([tuple(row[member] for member in dtype.names or ()) for row in rows], dtype=dtype)


@dataclass(frozen=True, eq=False)
class Packed:
    """A layer as kernels read it at one cell size."""

    arrays: Mapping[str, npt.NDArray[Any]]  # by the names of the kernels' arguments
    boxes: LatticeArray | None = None  # (n, 4) of the items that blocks list; None without items
    lists: str = ""  # prefix of the names of their lists, such as ``lake``
    visible: npt.NDArray[np.bool_] | None = None  # (n,) items that are left at the cell size
    details: Any = None  # what the layer's bounds read


@dataclass(frozen=True, eq=False)
class Culled:
    """A layer's part of a launch."""

    buffers: Mapping[str, Any]  # on the device, by the names of the kernels' arguments
    lists: Mapping[str, npt.NDArray[Any]]  # what affects which block, to be uploaded
    details: Any  # what the layer's bounds read


@dataclass
class HostSite:
    """Points that layers are evaluated at on the host, in float64."""

    sampling: Sampling
    x: LatticeArray  # (n,)
    y: LatticeArray
    masks: bool = True  # whether masks that change no height are needed
    finder: Any = None  # ``PointFinder`` of the recipe, if there is one already
    nodes: Any = None  # ``NodeReader`` of the recipe, if there is one already
    points: Any = None  # ``PointSite``: what the layer of points leaves to those above it
    base: Any = None  # ``Heights`` of elevation data; None without a base


@dataclass(frozen=True)
class HostSamples:
    """Heights (m) and masks (0 … 1) at points; see ``TerrainSample`` in ``kernels/world.clh``."""

    height: Float64Array
    mountain: Float64Array
    dune: Float64Array
    forest: Float64Array
    wetness: Float64Array
    water: Float64Array
    lake: Float64Array


@dataclass
class DetailState:
    """Bounds of what layers so far omit of n blocks, and of the ground they leave (m)."""

    blocks: LatticeArray  # (n, 4)
    bound: Float64Array  # (n,) of |height at full detail - height at the cell size|
    low: Float64Array  # (n,) of the heights, at any detail
    high: Float64Array
    scale: Float64Array  # (n,) of the heights' magnitude, for their rounding
    near: Any = None  # ``NearPoints``: what the layer of points finds near each block

    @classmethod
    def empty(cls, blocks: LatticeArray) -> DetailState:
        """Return the state before the first layer."""
        bound, low, high, scale = np.zeros((4, len(blocks)))
        return cls(blocks, bound, low, high, scale)


def no_boxes() -> LatticeArray:
    """Return no boxes."""
    return np.zeros((0, 4), np.int64)


@dataclass(frozen=True, eq=False)
class LayerChange:
    """Items that only the old or only the new of two layers has."""

    removed: LatticeArray  # rows of the old layer, ascending
    added: LatticeArray  # rows of the new one
    boxes: LatticeArray  # (n, 4) of all that differ, lattice units
    unbounded: LatticeArray = field(default_factory=no_boxes)  # (m, 4) where features without end differ

    def __bool__(self) -> bool:
        """Return whether anything differs."""
        return bool(len(self.removed) or len(self.added) or len(self.unbounded))


@dataclass(frozen=True, eq=False)
class TerrainLayer:
    """One step of the height function, as a value.

    `kernels/layers/NAME.clh` evaluates it; `kernels/height.clh` has the order. Fields marked `ITEMS` hold
    items, whose effect is bounded; all the others are in its key.
    """

    name: ClassVar[str]
    surface: ClassVar[bool] = False  # whether it changes materials, not heights
    has_heights: ClassVar[bool] = True  # whether it changes more than masks and materials
    varies_with_cell: ClassVar[bool] = True  # whether packed values may differ between cell sizes
    item_masks: ClassVar[tuple[str, ...]] = ()  # `MASKS` that blocks with any of its items may have

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields, without cached properties."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @cached_property
    def cache(self) -> LRUCache:
        """What follows from it and the extent, the settings of the world or the cell size, by these."""
        return LRUCache()

    def key(self) -> bytes:
        """Return a digest of everything that it depends on everywhere."""
        return digest_of(
            [getattr(self, each.name) for each in fields(self) if not each.metadata.get("items")]
        )

    def stacks(self, world: WorldSettings) -> tuple[NoiseStack, ...]:
        """Return its noises; they must not depend on items: one edit would reshape the whole world."""
        del world
        return ()

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return its items sorted by ``id``; equal rows have equal effects."""
        del world
        return np.zeros(0, ITEM)

    def boxes(self, rows: StructuredArray, world: WorldSettings) -> LatticeArray:
        """Return the boxes (n, 4) that items affect: west, south, east, north, lattice units."""
        del world
        return np.concatenate([rows["low"], rows["high"]], axis=1)

    def change(self, old: TerrainLayer, world: WorldSettings) -> LayerChange | None:
        """Return what differs from a layer with the same key; None if it may be anything anywhere."""
        before, now = (
            each.cache.get_or_compute(("items", world), partial(each.items, world)) for each in (old, self)
        )
        removed, added = row_difference(before, now)
        boxes = [old.boxes(before[removed], world), self.boxes(now[added], world)]
        return LayerChange(removed, added, np.concatenate(boxes))

    def pack(self, sampling: Sampling) -> Packed:
        """Return it as kernels read it; arrays that do not depend on the cell size are the same objects."""
        del sampling
        return Packed({})

    def pack_key(self, cell: float) -> float:
        """Return a number for cell sizes that have the same packed values."""
        return cell if self.varies_with_cell else 0.0

    def masks(self, culled: Culled, blocks: int) -> npt.NDArray[np.int32]:
        """Return the bits of `MASKS` that it may set in each of the blocks it was culled for."""
        if not self.item_masks:
            return np.zeros(blocks, np.int32)
        listed = np.diff(culled.lists[f"{culled.details.lists}_starts"]) > 0
        return mask_bits(**dict.fromkeys(self.item_masks, listed))

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add to the bounds what the cell size omits of it."""

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with this layer, in NumPy float64."""
        del site
        return ground


def mask_bits(**present: npt.NDArray[np.bool_]) -> npt.NDArray[np.int32]:
    """Return the bits of masks that are present."""
    return np.asarray(sum(each.astype(np.int32) << MASKS.index(name) for name, each in present.items()))


def smooth_rise(x: Float64Array, start: float, width: float) -> Float64Array:
    """Return the cubic from 0 at ``start`` to 1 at ``start + width``."""
    return smoothstep((x - start) / width)


def soft_positive(x: Float64Array, softness: float) -> Float64Array:
    """Return max(x, 0) with its corner rounded, exactly 0 up to ``-softness``."""
    near = np.clip(x, -softness, softness) + softness
    return np.asarray(near**2 / (4 * softness) + np.maximum(x - softness, 0))


def scaled_slope(slope: ValueSlope, by: float) -> ValueSlope:
    """Return a value and its slope times a number."""
    return ValueSlope(*(part * by for part in slope))


def upload_reals(context: ComputeContext, arrays: Mapping[str, npt.NDArray[Any]]) -> dict[str, Any]:
    """Return buffers of arrays by name, as of `upload_real`."""
    return {name: upload_real(context, array) for name, array in arrays.items()}


def upload_real(context: ComputeContext, array: npt.NDArray[Any]) -> Any:
    """Return a buffer of an array, float64 converted to the kernels' REAL."""
    return context.upload(array.astype(context.real_dtype) if array.dtype == np.float64 else array)
