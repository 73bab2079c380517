"""Kernel launches for a recipe: patches of vertices, tiles, and single points."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from copy import copy
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, Float64Array, LatticeArray, StructuredArray
from sketchterrain.compute.buffers import StagingBuffer
from sketchterrain.geometry.lattice import QUADS
from sketchterrain.landforms.node_raster import NODE_BITS, node_level
from sketchterrain.terrain.culler import list_arrays
from sketchterrain.terrain.inputs import KernelInputs
from sketchterrain.terrain.layers.layer import MASKS, Culled, DetailState, Sampling
from sketchterrain.terrain.patches import GROUP, Batches, Patches, PatchLauncher, rounded_up, tile_patches
from sketchterrain.terrain.recipe import EVERYWHERE, TerrainRecipe, difference
from sketchterrain.terrain.surfaces import Surface, SurfaceStore, require_finite
from sketchterrain.terrain.vertex_writer import VertexWriter

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

_FILE = "points.cl"
_PATCHES_PER_LAUNCH = 256
_POINTS_PER_LAUNCH = 1 << 21
# Points are culled in square blocks of so many nodes, and launched in groups of near ones.
_BLOCK_NODES_BITS = 3
_BLOCKS_PER_LAUNCH = 2048
_GROUP_BITS = 5
_ROUNDING = 1e-6  # of the height


class Evaluator:
    """A recipe on an open device; ``vertices`` writes tiles as OpenGL draws them."""

    def __init__(self, recipe: TerrainRecipe, context: ComputeContext) -> None:
        self.recipe = recipe
        self.context = context
        self._inputs = KernelInputs(recipe, context)
        self._launcher, self.vertices = PatchLauncher(self._inputs), VertexWriter(self._inputs)
        self._staged = StagingBuffer(context)
        self._cached_store: SurfaceStore | None = None
        self._patches_at_once = Batches(_PATCHES_PER_LAUNCH)
        self._points_at_once = Batches(_POINTS_PER_LAUNCH)

    def updated(self, recipe: TerrainRecipe) -> tuple[Evaluator, list[Bounds]]:
        """Return an evaluator of a changed recipe sharing the rest, and the areas (m) that differ."""
        change = difference(self.recipe, recipe)
        if change is None:
            return Evaluator(recipe, self.context), [EVERYWHERE]
        other = copy(self)
        other.recipe, other._inputs, other._cached_store = change.recipe, self._inputs.updated(change), None
        other._launcher = self._launcher.updated(other._inputs)
        other.vertices = self.vertices.updated(other._inputs, change.areas)
        return other, change.areas

    def features_near(self, blocks: LatticeArray) -> StructuredArray:
        """Return the point features that may affect any of the blocks (n, 4), lattice units, sorted by id."""
        return self._inputs.point_features(blocks)

    def surface(
        self,
        axis_x: LatticeArray,
        axis_y: LatticeArray,
        *,
        cell_size: float,
        progress: Callable[[float], None] | None = None,
    ) -> Surface:
        """Evaluate patches whose lattice axes (patches, n + 2) have one more vertex beyond each border.

        x runs west to east, y north to south; detail below the cell size (m) is omitted. ``progress`` takes 0
        … 1.
        """
        count, side = axis_x.shape
        surface = Surface.empty(count, side - 2, len(self.recipe.materials), real=self.context.real_dtype)

        def download(store: SurfaceStore, part: slice) -> None:
            store.download(surface.part(part))
            if progress is not None:
                progress(part.stop / count)

        self.enqueue_surfaces(axis_x, axis_y, cell_size=cell_size, consume=download)
        return surface

    def enqueue_surfaces(
        self,
        axis_x: LatticeArray,
        axis_y: LatticeArray,
        *,
        cell_size: float,
        consume: Callable[[SurfaceStore, slice], None],
    ) -> None:
        """Enqueue patches as in :meth:`surface`, as many at once as fit, and their consumers.

        ``consume`` gets the store that a slice of the patches has been enqueued into, from its first slot on;
        what it enqueues runs after these and before the next ones.
        """
        count, side = axis_x.shape

        def evaluate(part: slice) -> None:
            patches, store = Patches(axis_x[part], axis_y[part], cell_size), self._store(side - 2)
            self._launcher.surfaces(patches, store, np.arange(patches.count))
            consume(store, part)

        self._patches_at_once.run(count, evaluate, on_shrink=self.release_buffers)

    def heights_and_masks(
        self, axis_x: LatticeArray, axis_y: LatticeArray, *, cell_size: float
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return heights (patches, n, n), m, and masks (patches, masks, n, n) of patches without a border.

        Row 0 is northernmost; masks are in the order of :data:`MASKS`.
        """
        count, side = axis_x.shape
        height = np.empty((count, side, side), self.context.real_dtype)
        masks = np.empty((count, len(MASKS), side, side), self.context.real_dtype)

        def evaluate(part: slice) -> None:
            buffers = self._launcher.heights_and_masks(Patches(axis_x[part], axis_y[part], cell_size))
            for buffer, array in zip(buffers, (height, masks), strict=True):
                self.context.download_into(buffer, array[part])

        self._patches_at_once.run(count, evaluate, on_shrink=self.release_buffers)
        require_finite(height, "heights", self.context.device)
        require_finite(masks, "masks", self.context.device)
        return height, masks

    def tiles(self, keys: Sequence[tuple[int, int]], level: int) -> tuple[Surface, Float64Array]:
        """Evaluate tiles (column, row) of a level, with their parents' values and detail bounds (m)."""
        surface = Surface.empty(
            len(keys), QUADS + 1, len(self.recipe.materials), real=self.context.real_dtype, parents=True
        )
        bounds = np.empty(len(keys))

        def evaluate(part: slice) -> None:
            store = self._store(QUADS + 1)
            bounds[part] = self._enqueue_tiles(keys[part], level, store, np.arange(part.stop - part.start))
            store.download(surface.part(part))

        self._patches_at_once.run(len(keys), evaluate, on_shrink=self.release_buffers)
        return surface, bounds

    def _enqueue_tiles(
        self, keys: Sequence[tuple[int, int]], level: int, store: SurfaceStore, slots: npt.NDArray[np.integer]
    ) -> Float64Array:
        own, coarse = (tile_patches(level, keys, self.recipe.extent, up=up) for up in (0, 1))
        culled = self._launcher.surfaces(own, store, slots)
        self._launcher.parents(coarse, store, slots)
        return detail_bounds(self.recipe, culled, own.blocks, self._inputs.sampling(own.cell_size))

    def points(
        self, x: LatticeArray, y: LatticeArray, *, cell_size: float
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Return heights (n,), m, and masks (n, masks) at lattice positions (n,).

        Detail below the cell size (m) is omitted; masks are in the order of :data:`MASKS`.
        """
        context, real = self.context, self.context.real_dtype
        height, masks = np.empty(x.size, real), np.empty((x.size, len(MASKS)), real)
        if not x.size:
            return height, masks
        bits = NODE_BITS + node_level(cell_size, self.recipe.extent) + _BLOCK_NODES_BITS
        order, blocks, block = _blocks_of(x, y, bits)
        # A launch has no more than so many blocks, wherever they are.
        last_blocks = np.arange(_BLOCKS_PER_LAUNCH, len(blocks), _BLOCKS_PER_LAUNCH)
        cuts = [0, *np.searchsorted(block, last_blocks).tolist(), x.size]

        def evaluate(start: int, part: slice) -> None:
            own = slice(start + part.start, start + part.stop)
            at, first, last = order[own], int(block[own.start]), int(block[own.stop - 1]) + 1
            culled, count = self._inputs.cull(blocks[first:last], cell_size), len(at)
            lists = self._staged.upload(list_arrays(culled))
            buffers = context.empty(count, real), context.empty(len(MASKS) * count, real)
            context.launch(
                _FILE,
                "points",
                (rounded_up(count),),
                *self._inputs.arguments("TERRAIN_ARGUMENTS", culled, cell_size, lists),
                context.upload(x[at]),
                context.upload(y[at]),
                context.upload((block[own] - first).astype(np.int32)),
                np.int32(count),
                *buffers,
                group=(GROUP,),
                defines=self._inputs.defines,
            )
            for buffer, array in zip(buffers, (height, masks), strict=True):
                array[at] = context.download(buffer, (count, *array.shape[1:]), real)

        for start, stop in pairwise(cuts):
            self._points_at_once.run(stop - start, partial(evaluate, start))
        require_finite(height, "heights", context.device)
        require_finite(masks, "masks", context.device)
        return height, masks

    def _store(self, inner: int) -> SurfaceStore:
        """Return the cached store for patches of inner × inner vertices."""
        if self._cached_store is None or self._cached_store.inner != inner:
            self._cached_store = SurfaceStore(
                self.context, inner, self._patches_at_once.limit, len(self.recipe.materials)
            )
        return self._cached_store

    def release_buffers(self) -> None:
        """Free the device's buffers of patches, which the next ones need again."""
        self._cached_store = None
        self.vertices.release_buffers()
        self._launcher = PatchLauncher(self._inputs)


def detail_bounds(
    recipe: TerrainRecipe, culled: Mapping[str, Culled], blocks: LatticeArray, sampling: Sampling
) -> Float64Array:
    """Return bounds (n,), m, of |height at full detail - height at a cell size| over blocks (n, 4).

    Each noise misses the octaves that the cell size fades out, none of which exceeds its amplitude. A noise
    that warps outlines moves a profile by no more than the profile's steepest slope; one that scales heights
    counts with the height it multiplies, bounded by how near the features come to the block. Features, lakes
    and channels that fade out count with the share that is lost.
    """
    state = DetailState.empty(blocks)
    for layer in recipe.layers:
        if layer.name in culled:
            layer.omitted(state, culled[layer.name], sampling)
    return np.asarray(state.bound + np.where(state.bound > 0, _ROUNDING * state.scale, 0.0))


def _blocks_of(
    x: LatticeArray, y: LatticeArray, bits: int
) -> tuple[LatticeArray, LatticeArray, LatticeArray]:
    """Return an order of points that has near ones together, blocks 2^bits wide in it, and each one's block.

    Blocks are west, south, east, north.
    """
    column, row = x >> bits, y >> bits
    order = np.lexsort((column, row, column >> _GROUP_BITS, row >> _GROUP_BITS))
    column, row = column[order], row[order]
    first = np.append(True, (np.diff(column) != 0) | (np.diff(row) != 0))
    corner = np.stack([column[first], row[first]], axis=-1) << bits
    return order, np.concatenate([corner, corner + (1 << bits)], axis=1), np.cumsum(first) - 1
