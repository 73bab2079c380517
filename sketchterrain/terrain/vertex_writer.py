"""Write tiles of packed vertices: launches a level, coarser levels first, one wait for all."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.compute.staging import StagingBuffer
from sketchterrain.terrain.batches import Batches
from sketchterrain.terrain.finite import non_finite
from sketchterrain.terrain.lattice import finest_level
from sketchterrain.terrain.patch_places import sample_stride, tile_patches, tile_samples
from sketchterrain.terrain.patches import PatchLauncher
from sketchterrain.terrain.recipe import FINEST_CELL
from sketchterrain.terrain.vertices import FACTS
from sketchterrain.terrain.wide_errors import WideTileErrors

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import Bounds, LatticeArray
    from sketchterrain.terrain.kernel_arguments import KernelArguments
    from sketchterrain.terrain.patch_places import Patches
    from sketchterrain.terrain.vertices import VertexStore


_FILE = "tiles.cl"
_MOST_QUADS = 1 << 20  # of the tiles of a launch
# Wide patches are cut into squares, which fewer features reach: of so many vertices a side at least, so wide.
_LEAST_IN_SQUARE = 16
_LEAST_SQUARE = 200.0  # m
_USUAL = 0.99  # share of a tile whose error is at most its δ
_WORST = 1.5  # δ that no sample is farther off, so that what lies between samples is hardly beyond 2 δ


class VertexWriter:
    """Writes tiles of a recipe into stores of vertices.

    Parameters
    ----------
    arguments : KernelArguments
    """

    def __init__(self, arguments: KernelArguments) -> None:
        self._arguments = arguments
        self._context = arguments.context
        self._launcher = PatchLauncher(arguments)
        self._staged = StagingBuffer(self._context)
        self._wide = WideTileErrors(arguments.recipe, self._heights)
        self._at_once: dict[int, Batches] = {}
        self._rooms: dict[str, tuple[int, Any]] = {}

    def updated(self, arguments: KernelArguments, areas: Sequence[Bounds]) -> VertexWriter:
        """Return one of a changed recipe on the same device, in areas (m); room on it is shared."""
        other = copy(self)
        other._arguments = arguments
        other._launcher = self._launcher.with_arguments(arguments)
        other._wide = self._wide.updated(arguments.recipe, other._heights, areas)
        return other

    def write(
        self, keys: LatticeArray, slots: LatticeArray, parents: LatticeArray, store: VertexStore
    ) -> npt.NDArray[np.void]:
        """Write tiles and wait for them.

        Parameters
        ----------
        keys
            Level, column and row of each, shape (n, 3).
        slots, parents
            Each tile's slot and its parent's, −1 where it has none; shape (n,).
        store

        Returns
        -------
        structured ndarray, shape (n,)
            :data:`~sketchterrain.terrain.vertices.FACTS`.
        """
        facts = np.zeros(len(keys), FACTS)
        if not len(keys):
            return facts
        lives = np.concatenate([np.stack([slots, parents], axis=1), keys[:, 1:] & 1], axis=1).astype(np.int32)
        order = np.argsort(keys[:, 0], kind="stable")
        strips = store.quads // sample_stride(store.quads)
        found = self._room("found", 4 * len(keys) * strips)
        away = self._room("away", len(keys) * strips**2)
        at_once = self._at_once.setdefault(store.quads, Batches(max(_MOST_QUADS // store.quads**2, 1)))
        store.acquire()
        try:
            for first, last in _runs(keys[order, 0]):
                chosen = order[first:last]

                def enqueue(part: slice, chosen: LatticeArray = chosen, first: int = first) -> None:
                    some = chosen[part]
                    place = first + part.start
                    self._enqueue(keys[some], lives[some], store, found, away, place)

                at_once.run(len(chosen), enqueue, on_shrink=self._give_back)
            parts = self._context.download(found, (len(keys), strips, 4), np.float32)
            apart = self._context.download(away, (len(keys), strips**2), np.float32)
            facts["error"][order] = geometric_error(apart)
            for i in np.flatnonzero([self._wide.is_wide(int(level)) for level in keys[:, 0]]):
                level, column, row = (int(number) for number in keys[i])
                apart = self._wide.distances(level, column, row, store.heights(int(slots[i])))
                facts["error"][i] = geometric_error(apart[None])[0]
        finally:
            store.release(slots)
        if not np.isfinite(parts[..., 2]).all():
            count = f"in {np.count_nonzero(~np.isfinite(parts[..., 2]).all(axis=1))} of {len(keys)} tiles"
            raise non_finite("heights", self._context.device, count)
        facts["low"][order] = parts[..., 0].min(axis=1)
        facts["high"][order] = parts[..., 1].max(axis=1)
        return facts

    def _enqueue(
        self,
        keys: LatticeArray,
        lives: npt.NDArray[np.int32],
        store: VertexStore,
        found: Any,
        away: Any,
        first: int,
    ) -> None:
        """Enqueue tiles of one level."""
        level, places = int(keys[0, 0]), keys[:, 1:]
        stride = sample_stride(store.quads)
        patches = tile_patches(level, places, self._arguments.recipe.extent, quads=store.quads)
        cut = partial(_in_squares, width=patches.cell_size * store.quads)
        self._launcher.vertices(cut(patches), lives, store.buffer)
        sample, sampled = found, False
        if level < finest_level(store.quads) and not self._wide.is_wide(level):
            samples = tile_samples(level, places, cell_size=FINEST_CELL, quads=store.quads)
            sample, sampled = self._launcher.heights(cut(samples)), True
        slot = self._staged.upload({"slot": lives[:, 0]})["slot"]
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
            found,
            away,
        )

    def _heights(self, patches: Patches) -> npt.NDArray[np.float32]:
        """Return heights of patches here, shape (patches, side, side)."""
        real = self._context.real_dtype
        shape = (patches.count, patches.side, patches.side)
        return self._context.download(self._launcher.heights(patches), shape, real).astype(np.float32)

    def _room(self, name: str, count: int) -> Any:
        """Return a buffer for so many floats; kept while it is large enough."""
        held, buffer = self._rooms.get(name, (0, None))
        if held < count:
            self._rooms.pop(name, None)
            buffer = self._context.empty(count, np.float32)
            self._rooms[name] = count, buffer
        return buffer

    def _give_back(self) -> None:
        """Let go of what was allocated for larger batches."""
        self._launcher = PatchLauncher(self._arguments)


def geometric_error(apart: npt.NDArray[np.float32]) -> npt.NDArray[np.float64]:
    """Return δ of tiles from how far samples of full detail are from their triangles (m), shape (tiles, n).

    A hundredth of a tile may be farther off, but nothing of it much farther: a rare crag does not decide.
    """
    samples = apart.shape[1]
    rank = min(int(np.ceil(_USUAL * samples)), samples) - 1
    usual = np.partition(apart, rank, axis=1)[:, rank]
    return np.asarray(np.maximum(usual, apart.max(axis=1) / _WORST), np.float64)


def _in_squares(patches: Patches, width: float) -> Patches:
    """Return patches that are so wide (m) cut into squares, if that makes them quicker."""
    most = min(patches.side // _LEAST_IN_SQUARE, int(width / _LEAST_SQUARE))
    return replace(patches, squares=1 << (most.bit_length() - 1)) if most > 1 else patches


def _runs(levels: LatticeArray) -> list[tuple[int, int]]:
    """First and last (exclusive) of each run of equal levels."""
    cuts = [0, *(np.flatnonzero(np.diff(levels)) + 1).tolist(), len(levels)]
    return list(pairwise(cuts))
