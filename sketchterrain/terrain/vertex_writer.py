"""Writer of tiles as packed vertices: launches by level, coarse levels first, one wait."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds, Float32Array, Float64Array, LatticeArray, StructuredArray
from sketchterrain.caching import LRUCache
from sketchterrain.compute.buffers import BufferSet, StagingBuffer
from sketchterrain.geometry.lattice import LATTICE_BITS, QUADS, finest_level
from sketchterrain.landforms.node_raster import node_level
from sketchterrain.terrain.inputs import KernelInputs
from sketchterrain.terrain.noise import FINEST_CELL
from sketchterrain.terrain.patches import (
    Batches,
    Patches,
    PatchLauncher,
    sample_stride,
    tile_patches,
    tile_samples,
)
from sketchterrain.terrain.recipe import TerrainRecipe, touches
from sketchterrain.terrain.surfaces import FACTS, VertexStore, non_finite

if TYPE_CHECKING:
    _Samples = tuple[LatticeArray, LatticeArray, Float32Array]

_WIDEST = 17e3  # m
_MAX_CACHED = 256

_FILE = "tiles.cl"
_MAX_QUADS = 1 << 20  # of the tiles of a launch
# Wide patches are cut into squares, which fewer features affect: least vertices a side, least width.
_MIN_SQUARE_VERTICES = 16
_MIN_SQUARE = 200.0  # m
_USUAL = 0.99  # share of a tile whose error is at most its δ
_OTHER_NODES = 0.8  # share that counts of a deviation between nodes of two levels: see `deviation_weights`
_SPARSE = 1.1  # of tiles of coarse nodes in the sketch: the samples miss a part of their greatest errors
_WORST = 1.5  # greatest error of a sample over δ, so that errors between samples hardly exceed 2 δ


class WideTileErrors:
    """Deviation of finer detail from wide tiles, at 32 × 32 samples of a square of at most 17 km.

    The square holds the tile's highest painted feature. Unpainted terrain is much the same everywhere, so one
    square beside the sketch gives the detail that a level omits of it. The samples have the cell size of a
    tile as wide as the square, so they are finer. ``heights`` evaluates patches, (patches, side, side).
    """

    def __init__(self, recipe: TerrainRecipe, heights: Callable[[Patches], Float32Array]) -> None:
        self._recipe = recipe
        self._heights = heights
        self._square_level = int(np.ceil(np.log2(recipe.extent / _WIDEST)))
        self._sampled = LRUCache(_MAX_CACHED)  # `_Samples` by column and row of their square
        self._omitted = LRUCache(_MAX_CACHED)  # by cell size

    def updated(
        self, recipe: TerrainRecipe, heights: Callable[[Patches], Float32Array], areas: Sequence[Bounds]
    ) -> WideTileErrors:
        """Return the errors of a changed recipe of the same extent, which differs in areas (m)."""
        other = WideTileErrors(recipe, heights)
        side = recipe.extent / 2.0**self._square_level
        other._sampled = self._sampled.retained(
            (column, row)
            for column, row in self._sampled.keys()  # noqa: SIM118 # no mapping
            if not touches(areas, (column * side, row * side, (column + 1) * side, (row + 1) * side))
        )
        if other._sampled.get((self._beside, 0)) is not None:
            other._omitted = self._omitted
        return other

    def is_wide(self, level: int) -> bool:
        """Return whether the tiles of a level are wider than the sampled square."""
        return level < self._square_level

    def distances(self, level: int, column: int, row: int, height: Float32Array) -> Float32Array:
        """Return how far (m) finer detail is from a wide tile's triangles at the samples, shape (samples,).

        ``height`` is that of its vertices, m, (quads + 1, quads + 1).
        """
        square = self._painted_square(level, column, row)
        if square is None:
            return self._unpainted(self._recipe.extent * 2.0**-level / (len(height) - 1))
        x, y, full = self._samples(square)
        width, quads = 1 << (LATTICE_BITS - level), len(height) - 1
        u = np.asarray((x - column * width) * (quads / width), np.float64)
        v = np.asarray(((row + 1) * width - y[:, None]) * (quads / width), np.float64)
        deviation: Float32Array = np.abs(np.subtract(full, _on_triangles(height, u, v)))
        return deviation.ravel()

    def _painted_square(self, level: int, column: int, row: int) -> tuple[int, int] | None:
        """Return column and row of the square with a tile's highest painted feature, if any."""
        side = self._recipe.extent / 2.0**self._square_level
        share = 1 << (self._square_level - level)
        low = np.array([column, row]) * share
        painted = self._recipe.points.painted
        at = np.floor(np.stack([painted["x"], painted["y"]], axis=-1) / side).astype(np.int64)
        inside = np.flatnonzero(np.all((at >= low) & (at < low + share), axis=-1))
        if not inside.size:
            return None
        best = at[inside[np.argmax(painted["strength"][inside])]]
        return int(best[0]), int(best[1])

    @property
    def _beside(self) -> int:
        """Column of a square beside the sketch."""
        return int(np.ceil(2.0**self._square_level)) + 1

    def _unpainted(self, cell_size: float) -> Float32Array:
        """Return the detail (m) that a cell size omits of unpainted terrain."""

        def compute() -> Float32Array:
            square = self._beside, 0
            coarse = tile_samples(self._square_level, [square], cell_size=cell_size)
            deviation = np.abs(self._samples(square)[2] - self._heights(coarse)[0])
            return np.asarray(deviation, np.float32).ravel()

        return self._omitted.get_or_compute(cell_size, compute)

    def _samples(self, square: tuple[int, int]) -> _Samples:
        """Return the lattice positions of the samples of a square, and the detail there; cached."""

        def compute() -> _Samples:
            extent = self._recipe.extent
            cell = extent * 2.0**-self._square_level / QUADS
            patches = tile_samples(self._square_level, [square], cell_size=cell)
            return patches.axis_x[0], patches.axis_y[0], self._heights(patches)[0]

        return self._sampled.get_or_compute(square, compute)


def _on_triangles(height: Float32Array, u: Float64Array, v: Float64Array) -> Float32Array:
    """Return the height of quads split from north-west to south-east at u east and v south, in quads."""
    u, v = np.broadcast_arrays(u, v)
    column, row = (np.minimum(np.floor(place).astype(np.intp), len(height) - 2) for place in (u, v))
    u, v = u - column, v - row
    nw, se = height[row, column], height[row + 1, column + 1]
    other = np.where(v > u, height[row + 1, column], height[row, column + 1])
    # From north-west along the longer way first, then along the shorter.
    longer, shorter = np.maximum(u, v), np.minimum(u, v)
    return np.asarray(nw + longer * (other - nw) + shorter * (se - other), dtype=np.float32)


class VertexWriter:
    """Writes tiles of a recipe into stores of vertices."""

    def __init__(self, inputs: KernelInputs) -> None:
        self._inputs = inputs
        self._context = inputs.context
        self._launcher = PatchLauncher(inputs)
        self._staged = StagingBuffer(self._context)
        self._buffers = BufferSet(self._context)
        self._at_once: dict[int, Batches] = {}
        self._wide_errors = WideTileErrors(inputs.recipe, self._heights)

    def updated(self, inputs: KernelInputs, areas: Sequence[Bounds]) -> VertexWriter:
        """Return a writer of a recipe that differs in areas (m), on the same device, with shared buffers."""
        other = copy(self)
        other._inputs, other._launcher = inputs, self._launcher.updated(inputs)
        other._wide_errors = self._wide_errors.updated(inputs.recipe, other._heights, areas)
        return other

    def write(
        self, keys: LatticeArray, slots: LatticeArray, parents: LatticeArray, store: VertexStore
    ) -> StructuredArray:
        """Write tiles (level, column, row) into slots, wait for them, and return their `FACTS`, shape (n,).

        ``parents`` are the slots of the parents, −1 without one.
        """
        facts = np.zeros(len(keys), FACTS)
        if not len(keys):
            return facts
        tile_slots = np.concatenate([np.stack([slots, parents], axis=1), keys[:, 1:] & 1], axis=1).astype(
            np.int32
        )
        order = np.argsort(keys[:, 0], kind="stable")
        strips = store.quads // sample_stride(store.quads)
        extrema = self._buffers.buffer("extrema", (len(keys), strips, 4), np.float32)
        errors = self._buffers.buffer("errors", (len(keys), strips**2), np.float32)
        at_once = self._at_once.setdefault(store.quads, Batches(max(_MAX_QUADS // store.quads**2, 1)))
        store.acquire()
        try:
            for first, last in _runs(keys[order, 0]):
                selected = order[first:last]

                def enqueue(part: slice, selected: LatticeArray = selected, first: int = first) -> None:
                    items = selected[part]
                    place = first + part.start
                    self._enqueue(keys[items], tile_slots[items], store, extrema, errors, place)

                at_once.run(len(selected), enqueue, on_shrink=self.release_buffers)
            ranges = self._context.download(extrema, (len(keys), strips, 4), np.float32)
            deviations = self._context.download(errors, (len(keys), strips**2), np.float32)
            facts["error"][order] = geometric_error(deviations)
            facts["error"] *= deviation_weights(keys, self._inputs.recipe.extent, store.quads)
            for i in np.flatnonzero([self._wide_errors.is_wide(int(level)) for level in keys[:, 0]]):
                level, column, row = (int(number) for number in keys[i])
                deviations = self._wide_errors.distances(level, column, row, store.heights(int(slots[i])))
                facts["error"][i] = geometric_error(deviations[None])[0]
        finally:
            store.release(slots)
        if not np.isfinite(ranges[..., 2]).all():
            count = f"in {np.count_nonzero(~np.isfinite(ranges[..., 2]).all(axis=1))} of {len(keys)} tiles"
            raise non_finite("heights", self._context.device, count)
        facts["low"][order] = ranges[..., 0].min(axis=1)
        facts["high"][order] = ranges[..., 1].max(axis=1)
        return facts

    def _enqueue(
        self,
        keys: LatticeArray,
        tile_slots: npt.NDArray[np.int32],
        store: VertexStore,
        extrema: Any,
        errors: Any,
        first: int,
    ) -> None:
        """Enqueue tiles of one level."""
        level, places = int(keys[0, 0]), keys[:, 1:]
        stride = sample_stride(store.quads)
        patches = tile_patches(level, places, self._inputs.recipe.extent, quads=store.quads)
        cut = partial(_in_squares, width=patches.cell_size * store.quads)
        self._launcher.vertices(cut(patches), tile_slots, store.buffer)
        sample, sampled = extrema, False
        if level < finest_level(store.quads) and not self._wide_errors.is_wide(level):
            cell = sample_cell(patches.cell_size, self._inputs.recipe.extent)
            samples = tile_samples(level, places, cell_size=cell, quads=store.quads)
            sample, sampled = self._launcher.heights(cut(samples)), True
        slot = self._staged.upload({"slot": tile_slots[:, 0]})["slot"]
        self._context.launch(
            _FILE,
            "facts",
            (store.quads // stride, len(keys)),
            np.int32(store.quads),
            np.int32(stride),
            np.int32(sampled),
            sample,
            slot,
            store.buffer,
            np.int32(first),
            extrema,
            errors,
            defines=self._inputs.defines,
        )

    def _heights(self, patches: Patches) -> Float32Array:
        """Return heights of patches on the host, shape (patches, side, side)."""
        real = self._context.real_dtype
        shape = (patches.count, patches.side, patches.side)
        return self._context.download(self._launcher.heights(patches), shape, real).astype(np.float32)

    def release_buffers(self) -> None:
        """Free the device's buffers of patches, which the next ones need again."""
        self._launcher = PatchLauncher(self._inputs)


def sample_cell(cell_size: float, extent: float) -> float:
    """Return the cell size (m) of the samples that a tile of a cell size is compared with.

    They are two levels finer, but one coarser where tiles read coarser nodes of the drained ground: finer
    ones would be drained under all far tiles only to be compared with.
    """
    return 2.0 * cell_size if node_level(cell_size, extent) else max(cell_size / 4.0, FINEST_CELL)


def deviation_weights(keys: LatticeArray, extent: float, quads: int = QUADS) -> Float64Array:
    """Return what deviations are multiplied by to give errors of tiles (level, column, row), shape (n,).

    Beyond the sketch the nodes of each level are drained by themselves: finer ones deviate less than coarser
    ones, in the median by a share. In the sketch, tiles of coarse nodes have a margin for missed errors.
    """
    level, corner = keys[:, 0], keys[:, 1:]
    coarse = np.array(
        [node_level(extent * 2.0 ** -int(each) / quads, extent) > 0 for each in level], np.bool_
    )
    across = np.exp2(level.astype(np.float64))[:, None]  # tiles along the sketch
    beyond = np.any((corner >= across) | (corner + 1 <= 0), axis=1)
    return np.where(coarse, np.where(beyond, _OTHER_NODES, _SPARSE), 1.0)


def geometric_error(deviations: Float32Array) -> Float64Array:
    """Return δ of tiles from the deviations (m) of finer detail from their triangles, shape (tiles, n).

    A hundredth of a tile may exceed it, but nothing by much: a rare crag does not decide.
    """
    samples = deviations.shape[1]
    rank = min(int(np.ceil(_USUAL * samples)), samples) - 1
    usual = np.partition(deviations, rank, axis=1)[:, rank]
    return np.asarray(np.maximum(usual, deviations.max(axis=1) / _WORST), np.float64)


def _in_squares(patches: Patches, width: float) -> Patches:
    """Return patches of a width (m) cut into squares, if that is quicker."""
    most = min(patches.side // _MIN_SQUARE_VERTICES, int(width / _MIN_SQUARE))
    return replace(patches, squares=1 << (most.bit_length() - 1)) if most > 1 else patches


def _runs(levels: LatticeArray) -> list[tuple[int, int]]:
    """Return the first and last (exclusive) of each run of equal levels."""
    cuts = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)]
    return list(pairwise(cuts))
