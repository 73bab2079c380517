"""Launch the kernels that evaluate patches: many at once, written where they live."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.terrain.lattice import QUADS, level_step, metres_per_unit, tile_axes
from sketchterrain.terrain.octaves import corner_table, fits_patches

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from sketchterrain.terrain.kernel_arguments import KernelArguments
    from sketchterrain.terrain.octaves import OctaveTable
    from sketchterrain.terrain.surfaces import SurfaceStore

    Lattice = npt.NDArray[np.int64]

__all__ = ["GROUP", "PatchLauncher", "Patches", "rounded_up", "tile_patches"]

GROUP = 64
"""Work items of a group."""

_ANYWHERE, _WHOLE_STEPS = "terrain.cl", "tiles.cl"


def rounded_up(count: int) -> int:
    """Return the number of work items in whole groups."""
    return -(-count // GROUP) * GROUP


@dataclass(frozen=True, eq=False)
class Patches:
    """Squares of vertices, each with a border of one vertex around it.

    Attributes
    ----------
    axis_x, axis_y : (patches, side) int64
        Lattice coordinates; x runs west to east, y north to south.
    cell_size : float
        Metres between samples.
    """

    axis_x: Lattice
    axis_y: Lattice
    cell_size: float

    @property
    def count(self) -> int:
        """How many patches there are."""
        return len(self.axis_x)

    @property
    def side(self) -> int:
        """Vertices along a side, border included."""
        return int(self.axis_x.shape[1])

    @property
    def blocks(self) -> Lattice:
        """West, south, east and north of each, shape (patches, 4)."""
        x, y = self.axis_x, self.axis_y
        return np.stack([x[:, 0], y[:, -1], x[:, -1], y[:, 0]], axis=-1)

    @property
    def corners(self) -> Lattice:
        """The south-west vertex of each, shape (patches, 2)."""
        return self.blocks[:, :2]

    @cached_property
    def step_bits(self) -> int | None:
        """All vertices are whole steps of 2^step_bits lattice units apart and from the origin; else None."""
        step = int(self.axis_x[0, 1] - self.axis_x[0, 0])
        if step <= 0 or step & (step - 1) or np.any(self.corners & (step - 1)):
            return None
        even = np.all(np.diff(self.axis_x) == step) and np.all(np.diff(self.axis_y) == -step)
        return step.bit_length() - 1 if even else None

    def part(self, part: slice) -> Patches:
        """Return some of the patches."""
        return replace(self, axis_x=self.axis_x[part], axis_y=self.axis_y[part])


def tile_patches(level: int, keys: Sequence[tuple[int, int]], extent: float, *, up: int) -> Patches:
    """Return the patches of tiles, or with ``up=1`` those of their parents' vertices on the same ground.

    Parameters
    ----------
    level
        −12 … 18.
    keys
        Column and row of each tile.
    extent
        Metres along the sketch's longer side.
    up
        0 or 1.

    Raises
    ------
    InputError
        If there is no such level.
    """
    step = level_step(level)
    axes = [tile_axes(level, *key) for key in keys]
    x, y = np.stack([x for x, _ in axes]), np.stack([y for _, y in axes])
    if up:
        offsets = np.arange(-1, QUADS // 2 + 2, dtype=np.int64) * 2 * step
        x, y = x[:, 1:2] + offsets, y[:, 1:2] - offsets
    return Patches(x, y, step * 2**up * metres_per_unit(extent))


class PatchLauncher:
    """Evaluates patches of a recipe on a device; nothing comes back but what a store is asked for.

    Parameters
    ----------
    arguments : KernelArguments
    """

    def __init__(self, arguments: KernelArguments) -> None:
        self._arguments = arguments
        self._context = arguments.context
        self._scratch: dict[tuple[str, int], Any] = {}

    def surfaces(self, patches: Patches, store: SurfaceStore, slots: npt.NDArray[np.integer]) -> None:
        """Enqueue heights, normals and materials of patches.

        Parameters
        ----------
        patches
            Of the store's side and a border of one.
        store
            Where they are written.
        slots
            Which place in it each of them has, shape (patches,).
        """
        context, real = self._context, self._context.real_dtype
        vertices = self._vertices(patches)
        height, masks, mottle = self._heights(patches, vertices, bare=False)
        unit = metres_per_unit(self._arguments.recipe.extent)
        context.launch(
            vertices.file,
            "surfaces",
            (rounded_up(store.inner**2), patches.count),
            *self._arguments.rules,
            *vertices.places,
            context.upload(_inverse_spans(patches.axis_x, unit).astype(real)),
            context.upload(_inverse_spans(-patches.axis_y, unit).astype(real)),
            np.int32(patches.side),
            height,
            masks,
            mottle,
            *self._arguments.covers(patches.blocks),
            context.upload(np.asarray(slots, np.int32)),
            store.height,
            store.normal,
            store.materials,
            group=(GROUP, 1),
        )

    def parents(self, patches: Patches, store: SurfaceStore, slots: npt.NDArray[np.integer]) -> None:
        """Enqueue what parents hold at their children's vertices.

        Parameters
        ----------
        patches
            The parents' vertices over each child, see :func:`tile_patches`.
        store, slots
            As in :meth:`surfaces`.
        """
        context, real = self._context, self._context.real_dtype
        height, _, _ = self._heights(patches, self._vertices(patches), bare=True)
        unit = metres_per_unit(self._arguments.recipe.extent)
        inverse = _inverse_spans(patches.axis_x[:1, :3], unit)[0, 1]
        context.launch(
            _ANYWHERE,
            "parents",
            (rounded_up(store.inner**2), patches.count),
            real.type(inverse),
            np.int32(patches.side),
            height,
            context.upload(np.asarray(slots, np.int32)),
            store.parent_height,
            store.parent_normal,
            group=(GROUP, 1),
        )

    def _heights(self, patches: Patches, vertices: _Vertices, *, bare: bool) -> tuple[Any, Any, Any]:
        """Enqueue heights, masks and mottle with their border, and return their buffers."""
        count, side = patches.count, patches.side
        size = 1 if bare else count * side * side
        buffers = (
            self._room("bare height" if bare else "height", count * side * side),
            self._room("masks", 4 * size),
            self._room("mottle", size),
        )
        self._context.launch(
            vertices.file,
            "patches",
            (rounded_up(side * side), count),
            *self._arguments.terrain(patches.blocks, patches.cell_size),
            *vertices.noise,
            *vertices.places,
            np.int32(side),
            np.int32(bare),
            *buffers,
            group=(GROUP, 1),
        )
        return buffers

    def _vertices(self, patches: Patches) -> _Vertices:
        """Say where vertices lie, in 32 bits where they do."""
        upload, bits = self._context.upload, patches.step_bits
        octaves: OctaveTable = self._arguments.world(patches.cell_size)["table"]
        if bits is None or not fits_patches(octaves, bits):
            return _Vertices(_ANYWHERE, [], [upload(patches.axis_x), upload(patches.axis_y)])
        table = corner_table(octaves, patches.corners, bits)
        noise = [upload(table), np.int32(len(octaves.form))]
        return _Vertices(_WHOLE_STEPS, noise, [upload(patches.corners), np.int32(bits)])

    def _room(self, name: str, size: int) -> Any:
        """Return a buffer for ``size`` values; kept, and made anew only where one is too small."""
        kept = self._scratch.get((name, size))
        if kept is None:
            for key in [key for key in self._scratch if key[0] == name]:
                del self._scratch[key]
            kept = self._scratch[name, size] = self._context.empty(size, self._context.real_dtype)
        return kept


@dataclass(frozen=True, eq=False)
class _Vertices:
    """Which file's kernels place vertices, and the arguments that say where: for noise, and for all else."""

    file: str
    noise: list[Any]
    places: list[Any]


def _inverse_spans(axis: Lattice, unit: float) -> npt.NDArray[np.float64]:
    """1 / distance between a vertex's two neighbours (1/m); 0 where there is none."""
    inverse = np.zeros(axis.shape)
    spans = axis[:, 2:] - axis[:, :-2]
    inverse[:, 1:-1] = 1 / (np.maximum(spans, 1) * unit)
    return inverse
