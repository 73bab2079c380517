"""Launch the kernels on a recipe: patches of vertices, and single points."""

from __future__ import annotations

from copy import copy
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.compute.staging import StagingBuffer
from sketchterrain.features import FEATURE_TYPES
from sketchterrain.terrain.batches import Batches
from sketchterrain.terrain.culling import feature_index, features_near
from sketchterrain.terrain.detail import DetailBound
from sketchterrain.terrain.finite import require_finite
from sketchterrain.terrain.kernel_arguments import KernelArguments
from sketchterrain.terrain.lattice import LATTICE_BITS, QUADS
from sketchterrain.terrain.packing import pack_features
from sketchterrain.terrain.patch_places import Patches, tile_patches
from sketchterrain.terrain.patches import GROUP, PatchLauncher, rounded_up
from sketchterrain.terrain.surfaces import Surface, SurfaceStore
from sketchterrain.terrain.vertex_writer import VertexWriter

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain.changes import Box
    from sketchterrain.terrain.recipe import TerrainRecipe

MASKS = ("mountain", "dune", "forest", "water")
"""What the four masks of a point say: see ``Ground`` in ``kernels/world.clh``."""

_FILE = "terrain.cl"
_PATCHES_PER_LAUNCH = 256
_POINTS_PER_LAUNCH = 1 << 21
# Points are culled in square blocks: 2^5 along the sketch's longer side, fewer where points lie far apart.
_BLOCKS_PER_EXTENT_BITS = 5
_MOST_BLOCKS_BITS = 6


class Evaluator:
    """A recipe on a device.

    Parameters
    ----------
    recipe
    context
        An open device; its ``real`` says whether this is the terrain or its float64 reference.

    Attributes
    ----------
    recipe, context
    vertices : VertexWriter
        Writes tiles as OpenGL draws them.
    """

    def __init__(self, recipe: TerrainRecipe, context: ComputeContext) -> None:
        self.recipe = recipe
        self.context = context
        self._arguments = KernelArguments(recipe, context)
        self._launcher = PatchLauncher(self._arguments)
        self._staged = StagingBuffer(context)
        self._kept: SurfaceStore | None = None
        self.vertices = VertexWriter(self._arguments)
        self._detail: DetailBound | None = None
        self._patches_at_once = Batches(_PATCHES_PER_LAUNCH)
        self._points_at_once = Batches(_POINTS_PER_LAUNCH)

    def with_strengths(self, strength: npt.NDArray[np.floating]) -> Evaluator:
        """Return an evaluator of the same recipe but for the painted features' strengths, shape (n,).

        It shares what is on the device already, all of which stays the same.
        """
        other = copy(self)
        other._arguments = self._arguments.with_strengths(strength)
        other._launcher = PatchLauncher(other._arguments)
        other.vertices = VertexWriter(other._arguments)
        other._detail = None
        other.recipe = other._arguments.recipe
        return other

    def after(self, recipe: TerrainRecipe, areas: Sequence[Box]) -> Evaluator:
        """Return an evaluator of a changed recipe of the same extent; what stays the same is shared.

        Parameters
        ----------
        recipe
            The changed one.
        areas
            Rectangles (m) that hold all that is another one.
        """
        other = copy(self)
        other.recipe = recipe
        other._arguments = self._arguments.after(recipe, areas)
        other._launcher = self._launcher.of(other._arguments)
        other.vertices = self.vertices.after(other._arguments, areas)
        other._detail = None
        return other

    def surface(
        self,
        axis_x: npt.NDArray[np.int64],
        axis_y: npt.NDArray[np.int64],
        *,
        cell_size: float,
        progress: Callable[[float], None] | None = None,
    ) -> Surface:
        """Evaluate patches whose axes have one more vertex beyond each border.

        Parameters
        ----------
        axis_x, axis_y
            Lattice coordinates, shape (patches, n + 2); x runs west to east, y north to south.
        cell_size
            Metres between samples; what they can't carry is left out.
        progress
            Called with the share that is done, 0 … 1.
        """
        count, side = axis_x.shape
        surface = Surface.empty(count, side - 2, real=self.context.real_dtype)

        def take(store: SurfaceStore, part: slice) -> None:
            store.download(surface.part(part))
            if progress is not None:
                progress(part.stop / count)

        self.stored(axis_x, axis_y, cell_size=cell_size, take=take)
        return surface

    def stored(
        self,
        axis_x: npt.NDArray[np.int64],
        axis_y: npt.NDArray[np.int64],
        *,
        cell_size: float,
        take: Callable[[SurfaceStore, slice], None],
    ) -> None:
        """Enqueue patches on the device, as many at once as have room, and what is done with them there.

        Parameters
        ----------
        axis_x, axis_y, cell_size
            As in :meth:`surface`.
        take
            Takes the store that patches have been enqueued into, from its first slot on, and which they are;
            what it enqueues finds them written, and later ones are written after it.
        """
        count, side = axis_x.shape

        def evaluate(part: slice) -> None:
            patches, store = Patches(axis_x[part], axis_y[part], cell_size), self._store(side - 2)
            self._launcher.surfaces(patches, store, np.arange(patches.count))
            take(store, part)

        self._patches_at_once.run(count, evaluate, smaller=self._give_back)

    def masked(
        self, axis_x: npt.NDArray[np.int64], axis_y: npt.NDArray[np.int64], *, cell_size: float
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Evaluate heights and masks of patches, with no border.

        Parameters
        ----------
        axis_x, axis_y, cell_size
            As in :meth:`surface`; every vertex comes back.

        Returns
        -------
        height : ndarray, shape (patches, n, n)
            Metres; row 0 northernmost.
        masks : ndarray, shape (patches, 4, n, n)
            In the order of :data:`MASKS`.
        """
        count, side = axis_x.shape
        height = np.empty((count, side, side), self.context.real_dtype)
        masks = np.empty((count, len(MASKS), side, side), self.context.real_dtype)

        def evaluate(part: slice) -> None:
            buffers = self._launcher.masked(Patches(axis_x[part], axis_y[part], cell_size))
            for buffer, array in zip(buffers, (height, masks), strict=True):
                self.context.download_into(buffer, array[part])

        self._patches_at_once.run(count, evaluate, smaller=self._give_back)
        require_finite(height, "heights", self.context.device)
        require_finite(masks, "masks", self.context.device)
        return height, masks

    def tiles(self, keys: Sequence[tuple[int, int]], level: int) -> tuple[Surface, npt.NDArray[np.float64]]:
        """Evaluate tiles of one level, what their parents hold at their vertices, and their detail's bounds.

        Parameters
        ----------
        keys
            Column and row of each.
        level
            −12 … 18.
        """
        surface = Surface.empty(len(keys), QUADS + 1, real=self.context.real_dtype, parents=True)
        bounds = np.empty(len(keys))

        def evaluate(part: slice) -> None:
            store = self._store(QUADS + 1)
            bounds[part] = self._fill(keys[part], level, store, np.arange(part.stop - part.start))
            store.download(surface.part(part))

        self._patches_at_once.run(len(keys), evaluate, smaller=self._give_back)
        return surface, bounds

    def fill(
        self,
        keys: Sequence[tuple[int, int]],
        level: int,
        store: SurfaceStore,
        slots: npt.NDArray[np.integer],
    ) -> npt.NDArray[np.float64]:
        """Enqueue the same into slots of a store of tiles; nothing but the bounds comes back."""
        bounds = np.empty(len(keys))

        def evaluate(part: slice) -> None:
            bounds[part] = self._fill(keys[part], level, store, slots[part])

        self._patches_at_once.run(len(keys), evaluate, smaller=self._give_back)
        return bounds

    def _fill(
        self,
        keys: Sequence[tuple[int, int]],
        level: int,
        store: SurfaceStore,
        slots: npt.NDArray[np.integer],
    ) -> npt.NDArray[np.float64]:
        own, coarse = (tile_patches(level, keys, self.recipe.extent, up=up) for up in (0, 1))
        reaching = self._launcher.surfaces(own, store, slots)
        self._launcher.parents(coarse, store, slots)
        if self._detail is None:
            self._detail = DetailBound(self.recipe)
        return self._detail.of(reaching, own.blocks, own.cell_size)

    def points(
        self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], *, cell_size: float
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        """Evaluate single points.

        Parameters
        ----------
        x, y
            Lattice coordinates, shape (n,).
        cell_size
            Metres between samples; what they can't carry is left out.

        Returns
        -------
        height : ndarray, shape (n,)
            Metres.
        masks : ndarray, shape (n, 4)
            In the order of :data:`MASKS`.
        """
        height = np.empty(x.size, self.context.real_dtype)
        masks = np.empty((x.size, 4), self.context.real_dtype)

        def evaluate(part: slice) -> None:
            height[part], masks[part] = self._points(x[part], y[part], cell_size)

        self._points_at_once.run(x.size, evaluate)
        require_finite(height, "heights", self.context.device)
        require_finite(masks, "masks", self.context.device)
        return height, masks

    def may_hold(
        self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], kind: str
    ) -> npt.NDArray[np.bool_]:
        """Return which points lie in a block of ground that some feature of a type reaches, shape (n,)."""
        blocks, block = _blocks_of(x, y)
        near = features_near(self.recipe, blocks, min_radius=0.0)
        packed = pack_features(self.recipe, near[near["type"] == FEATURE_TYPES.index(kind)], 0.0)
        index, _ = feature_index(self.recipe, packed)
        held, _ = index.touching(blocks)
        return np.isin(block, held)

    def _points(
        self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], cell_size: float
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        context, real = self.context, self.context.real_dtype
        blocks, block = _blocks_of(x, y)
        reaching = self._arguments.reaching(blocks, cell_size)
        lists = self._staged.upload(reaching.lists)
        height, masks = context.empty(x.size, real), context.empty(4 * x.size, real)
        context.launch(
            _FILE,
            "points",
            (rounded_up(x.size),),
            *self._arguments.terrain(reaching, cell_size, lists),
            context.upload(x),
            context.upload(y),
            context.upload(block.astype(np.int32)),
            np.int32(x.size),
            height,
            masks,
            group=(GROUP,),
        )
        return context.download(height, x.size, real), context.download(masks, (x.size, 4), real)

    def _store(self, inner: int) -> SurfaceStore:
        """Return the place on the device that patches of inner × inner vertices are written to; kept."""
        if self._kept is None or self._kept.inner != inner:
            self._kept = SurfaceStore(self.context, inner, self._patches_at_once.most)
        return self._kept

    def _give_back(self) -> None:
        """Let go of what was allocated for larger batches."""
        self._kept = None
        self._launcher = PatchLauncher(self._arguments)


def _blocks_of(
    x: npt.NDArray[np.int64], y: npt.NDArray[np.int64]
) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Return the square blocks that the points lie in (west, south, east, north), and each point's block."""
    span = int(max(np.ptp(x), np.ptp(y)))
    bits = max(LATTICE_BITS - _BLOCKS_PER_EXTENT_BITS, span.bit_length() - _MOST_BLOCKS_BITS)
    column, row = x >> bits, y >> bits
    west, south = int(column.min()), int(row.min())
    width, height = int(column.max()) - west + 1, int(row.max()) - south + 1
    number = (row - south) * width + (column - west)
    held = np.bincount(number, minlength=width * height) > 0
    block = (np.cumsum(held) - 1)[number]
    held_row, held_column = np.divmod(np.flatnonzero(held), width)
    cells = np.stack([held_column + west, held_row + south], axis=-1)
    corner = cells << bits
    return np.concatenate([corner, corner + (1 << bits)], axis=1), block
