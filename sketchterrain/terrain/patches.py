"""Patches of vertices: positions of tiles, parents and samples; launches of the kernels that fill them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.compute.buffers import BufferSet, StagingBuffer
from sketchterrain.errors import DeviceMemoryError
from sketchterrain.geometry.lattice import QUADS, level_step, metres_per_unit
from sketchterrain.terrain.culler import list_arrays
from sketchterrain.terrain.layers.layer import MASKS, Culled
from sketchterrain.terrain.noise import corner_table, fits_patches, whole_step_bits
from sketchterrain.terrain.surfaces import SurfaceStore

if TYPE_CHECKING:
    from sketchterrain.terrain.inputs import KernelInputs

    Keys = Sequence[tuple[int, int]] | LatticeArray

T = TypeVar("T")

GROUP = 64
"""Work items of a group."""

# Larger groups run short of registers on GPUs.
_MAX_IN_GROUP = 512
_PATCH_GROUP = 4 * GROUP
_MAX_CACHED = 32
_ANYWHERE, _WHOLE_STEPS = "terrain.cl", "tiles.cl"


def rounded_up(count: int) -> int:
    """Return the number of work items in whole groups."""
    return -(-count // GROUP) * GROUP


class Batches:
    """Process items in slices of at most ``limit``, halved for good each time the device is out of memory."""

    def __init__(self, limit: int) -> None:
        self.limit = limit

    def run(
        self, count: int, work: Callable[[slice], None], *, on_shrink: Callable[[], None] | None = None
    ) -> None:
        """Call ``work`` on slices of ``count`` items in order, retrying smaller ones after DeviceMemoryError.

        ``on_shrink`` is called in between to release larger allocations. A batch of one that fails is an
        error.
        """
        first = 0
        while first < count:
            end = min(first + self.limit, count)
            try:
                work(slice(first, end))
            except DeviceMemoryError as error:
                if end - first == 1:
                    raise DeviceMemoryError(f"{error}; not even a batch of one fits") from error
                self.limit = (end - first) // 2
            else:
                first = end
                continue
            # Not in the handler: the error would keep the work's buffers alive.
            if on_shrink is not None:
                on_shrink()


@dataclass(frozen=True, eq=False)
class Patches:
    """Squares of vertices, each with a border of one vertex around it."""

    axis_x: LatticeArray  # (patches, side), west to east
    axis_y: LatticeArray  # (patches, side), north to south
    cell_size: float  # m between samples
    squares: int = 1  # parts along a side of a patch, culled separately

    @property
    def count(self) -> int:
        """Number of patches."""
        return len(self.axis_x)

    @property
    def side(self) -> int:
        """Vertices along a side, border included."""
        return int(self.axis_x.shape[1])

    @cached_property
    def blocks(self) -> LatticeArray:
        """West, south, east and north of each, shape (patches, 4)."""
        x, y = self.axis_x, self.axis_y
        return np.stack([x[:, 0], y[:, -1], x[:, -1], y[:, 0]], axis=-1)

    @property
    def corners(self) -> LatticeArray:
        """The south-west vertex of each, shape (patches, 2)."""
        return self.blocks[:, :2]

    @property
    def square_side(self) -> int:
        """Vertices along a square's side; the last ones may have fewer."""
        return -(-self.side // self.squares)

    @property
    def square_blocks(self) -> LatticeArray:
        """West, south, east and north of squares, shape (patches · squares², 4).

        Squares of a patch are in rows from west to east, from north to south.
        """
        if self.squares == 1:
            return self.blocks
        first = np.arange(self.squares) * self.square_side
        last = np.minimum(first + self.square_side, self.side) - 1
        shape = (self.count, self.squares, self.squares)
        along = (
            self.axis_x[:, None, first],
            self.axis_y[:, last, None],
            self.axis_x[:, None, last],
            self.axis_y[:, first, None],
        )
        return np.stack([np.broadcast_to(each, shape) for each in along], axis=-1).reshape(-1, 4)

    @cached_property
    def step_bits(self) -> tuple[int, int] | None:
        """Bits of the step between vertices, and of the longest step that divides all positions.

        Both are powers of two lattice units; None where vertices are not spaced so.
        """
        step = int(self.axis_x[0, 1] - self.axis_x[0, 0])
        if step <= 0 or step & (step - 1):
            return None
        if np.any(np.diff(self.axis_x) != step) or np.any(np.diff(self.axis_y) != -step):
            return None
        common = int(np.bitwise_or.reduce(self.corners, axis=None)) | step
        return step.bit_length() - 1, (common & -common).bit_length() - 1


def tile_patches(level: int, keys: Keys, extent: float, *, up: int = 0, quads: int = QUADS) -> Patches:
    """Return the patches of tiles (column, row) of a level; with ``up=1`` their parents' vertices there.

    ``quads`` along a side is a power of two; the finest level is 18 for 64 quads.
    """
    step = level_step(level, quads)
    column, row = np.array(keys, np.int64).reshape(-1, 2).T[..., None] * (quads * step)
    offsets = np.arange(-1, (quads >> up) + 2, dtype=np.int64) * (step << up)
    return Patches(column + offsets, row + quads * step - offsets, step * 2**up * metres_per_unit(extent))


def sample_stride(quads: int) -> int:
    """Return the spacing, in quads, of the samples of a tile's error: two, and one in a small tile."""
    return 1 if quads < QUADS else 2


def tile_samples(level: int, keys: Keys, *, cell_size: float, quads: int = QUADS) -> Patches:
    """Return the centres of every :func:`sample_stride`-th quad of tiles; not for the finest level."""
    step = level_step(level, quads)
    corner = np.array(keys, np.int64).reshape(-1, 2) * (quads * step)
    stride = sample_stride(quads)
    along = np.arange(quads // stride, dtype=np.int64) * (stride * step) + step // 2
    north = corner[:, 1, None] + quads * step
    return Patches(corner[:, 0, None] + along, north - along, cell_size)


class PatchLauncher:
    """Evaluates patches of a recipe on a device, without downloads."""

    def __init__(self, inputs: KernelInputs) -> None:
        self._inputs = inputs
        self._context = inputs.context
        self._buffers = BufferSet(self._context)
        self._staged = {name: StagingBuffer(self._context) for name in ("all", "heights")}
        self._groups = LRUCache(_MAX_CACHED)

    def updated(self, inputs: KernelInputs) -> PatchLauncher:
        """Return a launcher of another recipe on the same device, with shared buffers."""
        other = copy(self)
        other._inputs = inputs
        return other

    def surfaces(
        self, patches: Patches, store: SurfaceStore, slots: npt.NDArray[np.integer]
    ) -> dict[str, Culled]:
        """Enqueue heights, normals and materials of patches into ``slots`` (patches,) of a store."""
        extra = {"slot": np.asarray(slots, np.int32)}
        return self._surfaces("surfaces", patches, extra, store.ground, store.materials)

    def vertices(
        self, patches: Patches, tile_slots: npt.NDArray[np.int32], vertices: Any
    ) -> dict[str, Culled]:
        """Enqueue packed vertices of tiles into a buffer, with their parents' values.

        ``tile_slots`` (patches, 4) are the slot, parent's slot, east half and north half that the kernel
        ``vertices`` reads.
        """
        return self._surfaces("vertices", patches, {"tile_slots": tile_slots}, vertices)

    def _surfaces(
        self, kernel: str, patches: Patches, where: Mapping[str, npt.NDArray[Any]], *written: Any
    ) -> dict[str, Culled]:
        """Enqueue a kernel that writes surfaces at the destinations given by small arrays."""
        inner = patches.side - 2
        surface = self._inputs.cull(patches.blocks, patches.cell_size, surface=True)
        launch = self._heights(patches, {**where, **list_arrays(surface)}, heights_only=False)
        self._context.launch(
            launch.file,
            kernel,
            (inner, inner, patches.count),
            *self._inputs.rules,
            *launch.positions,
            *launch.across,
            launch.small["empty_masks"],
            np.int32(patches.side),
            *launch.results,
            *self._inputs.arguments("COVERS_ARGUMENTS", surface, patches.cell_size, launch.small),
            *(launch.small[name] for name in where),
            *written,
            group=self._row_groups(launch.file, kernel, inner),
            defines=self._inputs.defines,
        )
        return launch.culled

    def parents(self, patches: Patches, store: SurfaceStore, slots: npt.NDArray[np.integer]) -> None:
        """Enqueue the parents' values at their children's vertices, see :func:`tile_patches`."""
        launch = self._heights(patches, {"slot": np.asarray(slots, np.int32)}, heights_only=True)
        self._context.launch(
            launch.file,
            "parents",
            (patches.side - 2, patches.side - 2, patches.count),
            self._context.real_dtype.type(self._inverse_spans(patches.axis_x[:1, :3])[0, 1]),
            np.int32(patches.side),
            launch.results[0],
            launch.small["slot"],
            store.parent,
            group=self._row_groups(launch.file, "parents", patches.side - 2),
            defines=self._inputs.defines,
        )

    def heights_and_masks(self, patches: Patches) -> tuple[Any, Any]:
        """Enqueue heights and masks with their border; return their buffers, which later launches reuse.

        Heights are (patches, side, side), m; masks (patches, masks, side, side), in the order of ``MASKS``.
        """
        height, masks, *_ = self._heights(patches, {}, heights_only=False).results
        return height, masks

    def heights(self, patches: Patches) -> Any:
        """Enqueue heights (patches, side, side), m; return their buffer, which later launches reuse."""
        return self._heights(patches, {}, heights_only=True).results[0]

    def _heights(
        self, patches: Patches, extra: Mapping[str, npt.NDArray[Any]], *, heights_only: bool
    ) -> _Launch:
        """Enqueue heights, masks and mottle with their border, staging ``more`` small arrays along."""
        count, side, real = patches.count, patches.side, self._context.real_dtype
        size = 1 if heights_only else count * side * side
        culled = self._inputs.cull(
            patches.square_blocks, patches.cell_size, around=patches.blocks, heights_only=heights_only
        )
        vertices = self._vertices(patches)
        staging = self._staged["heights" if heights_only else "all"]
        if not heights_only:
            empty = self._inputs.empty_masks(culled, len(patches.square_blocks))
            empty_masks = _common_bits(empty, patches.squares)
            extra = {**extra, **vertices.inverse, "empty_masks": empty_masks}
        small = staging.upload({**list_arrays(culled), **vertices.noise, **vertices.places, **extra})
        launch = _Launch(
            vertices.file,
            culled,
            small,
            [*(small[name] for name in vertices.places), *vertices.step],
            vertices.across or [small[name] for name in vertices.inverse if name in small],
            (
                # Two spare rows: see `parents`.
                self._buffers.buffer(f"height {heights_only}", (count * side + 2, side), real),
                self._buffers.buffer("masks", (len(MASKS), size), real),
                self._buffers.buffer("mottle", size, real),
                self._buffers.buffer("built", (2, size), real),
            ),
        )
        items = patches.square_side**2
        whole = self._group_limit(vertices.file, "patches") >= _PATCH_GROUP and items >= 4 * _PATCH_GROUP
        group = _PATCH_GROUP if whole or items == _PATCH_GROUP else GROUP
        self._context.launch(
            vertices.file,
            "patches",
            (-(-items // group) * group, count * patches.squares**2),
            *self._inputs.arguments("TERRAIN_ARGUMENTS", culled, patches.cell_size, small),
            *(small[name] for name in vertices.noise),
            *vertices.octaves,
            *launch.positions,
            np.int32(side),
            np.int32(patches.squares),
            np.int32(patches.square_side),
            np.int32(heights_only),
            *launch.results,
            group=(group, 1),
            defines=self._inputs.defines,
        )
        return launch

    def _vertices(self, patches: Patches) -> _Vertices:
        """Return the positions of vertices, as 32-bit steps where possible."""
        real = self._context.real_dtype
        octaves = self._inputs.sampling(patches.cell_size).octaves
        between, bits = patches.step_bits or (0, -1)
        bits = min(bits, whole_step_bits(octaves))
        stride_bits = between - bits
        if bits < 0 or not fits_patches(octaves, bits, patches.side << stride_bits):
            inverse = {
                "inverse_x": self._inverse_spans(patches.axis_x).astype(real),
                "inverse_y": self._inverse_spans(-patches.axis_y).astype(real),
            }
            axes = {"axis_x": patches.axis_x, "axis_y": patches.axis_y}
            return _Vertices(_ANYWHERE, axes, inverse=inverse)
        return _Vertices(
            _WHOLE_STEPS,
            {"corner_at": patches.corners},
            {"octave_corner": corner_table(octaves, patches.corners, bits)},
            (np.int32(len(octaves.form)),),
            (np.int32(bits), np.int32(stride_bits)),
            across=[real.type(self._inverse_spans(patches.axis_x[:1, :3])[0, 1])],
        )

    def _inverse_spans(self, axis: LatticeArray) -> Float64Array:
        """Return 1 / distance between a vertex's two neighbours (1/m); 0 at the ends."""
        inverse = np.zeros(axis.shape)
        spans = np.maximum(axis[:, 2:] - axis[:, :-2], 1) * metres_per_unit(self._inputs.recipe.extent)
        inverse[:, 1:-1] = 1 / spans
        return inverse

    def _group_limit(self, file: str, kernel: str) -> int:
        """Return the most work items of a kernel's group."""
        key = file, kernel, self._inputs.defines
        return self._groups.get_or_compute(key, lambda: self._context.max_group_size(*key))

    def _row_groups(self, file: str, kernel: str, side: int) -> tuple[int, int, int] | None:
        """Return groups of as many whole rows of a square as fit and divide it; None where none fits."""
        limit = min(self._group_limit(file, kernel), _MAX_IN_GROUP)
        rows = [number for number in range(1, side + 1) if side % number == 0 and number * side <= limit]
        return (side, rows[-1], 1) if rows else None


def _common_bits(bits: npt.NDArray[np.int32], squares: int) -> npt.NDArray[np.int32]:
    """Return the bits set in all squares of a patch, shape (patches,)."""
    if squares == 1:
        return bits
    return np.asarray(np.bitwise_and.reduce(bits.reshape(-1, squares**2), axis=1), np.int32)


@dataclass(frozen=True, eq=False)
class _Vertices:
    """The file whose kernels place vertices; positions, what noise reads and spacing by arguments' names."""

    file: str
    places: dict[str, npt.NDArray[Any]]
    noise: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    octaves: tuple[np.int32, ...] = ()
    step: tuple[np.int32, ...] = ()
    inverse: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    across: list[Any] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Launch:
    """A launch of ``patches``: its file, inputs, positions of vertices, and output buffers."""

    file: str
    culled: dict[str, Culled]
    small: dict[str, Any]
    positions: list[Any]
    across: list[Any]
    results: tuple[Any, Any, Any, Any]
