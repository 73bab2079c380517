"""Launch the kernels that evaluate patches: many at once, written where they live."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.compute.staging import Staging
from sketchterrain.terrain.lattice import QUADS, level_step, metres_per_unit
from sketchterrain.terrain.octaves import corner_table, fits_patches

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from sketchterrain.terrain.kernel_arguments import KernelArguments
    from sketchterrain.terrain.octaves import OctaveTable
    from sketchterrain.terrain.surfaces import SurfaceStore

    Lattice = npt.NDArray[np.int64]

__all__ = ["GROUP", "PatchLauncher", "Patches", "rounded_up", "tile_patches"]

GROUP = 64
"""Work items of a group."""

# Beyond it, registers get scarce on GPUs.
_MOST_IN_GROUP = 512
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
    column, row = np.array(keys, np.int64).reshape(-1, 2).T[..., None] * (QUADS * step)
    quads = QUADS >> up
    offsets = np.arange(-1, quads + 2, dtype=np.int64) * (step << up)
    return Patches(column + offsets, row + QUADS * step - offsets, step * 2**up * metres_per_unit(extent))


class PatchLauncher:
    """Evaluates patches of a recipe on a device; nothing comes back but what a store is asked for.

    Parameters
    ----------
    arguments : KernelArguments
    """

    def __init__(self, arguments: KernelArguments) -> None:
        self._arguments = arguments
        self._context = arguments.context
        self._scratch: dict[str, tuple[int, Any]] = {}
        self._rows = lru_cache(maxsize=16)(self._whole_rows)
        self._staged = {name: Staging(self._context) for name in ("whole", "bare")}

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
        covers = self._arguments.cover_lists(patches.blocks)
        launch = self._heights(patches, {"slot": np.asarray(slots, np.int32), **covers}, bare=False)
        self._context.launch(
            launch.file,
            "surfaces",
            (store.inner, store.inner, patches.count),
            *self._arguments.rules,
            *launch.places,
            *launch.across,
            launch.small["absent"],
            np.int32(patches.side),
            *launch.results,
            *self._arguments.covers(launch.small),
            launch.small["slot"],
            store.ground,
            store.materials,
            group=self._rows(launch.file, "surfaces", store.inner),
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
        launch = self._heights(patches, {"slot": np.asarray(slots, np.int32)}, bare=True)
        self._context.launch(
            _ANYWHERE,
            "parents",
            (patches.side - 2, patches.side - 2, patches.count),
            self._context.real_dtype.type(self._inverse_spans(patches.axis_x[:1, :3])[0, 1]),
            np.int32(patches.side),
            launch.results[0],
            launch.small["slot"],
            store.parent,
            group=self._rows(_ANYWHERE, "parents", patches.side - 2),
        )

    def _heights(self, patches: Patches, more: Mapping[str, npt.NDArray[Any]], *, bare: bool) -> _Launch:
        """Enqueue heights, masks and mottle with their border; put more small arrays where those go."""
        count, side = patches.count, patches.side
        size = 1 if bare else count * side * side
        reaching = self._arguments.reaching(patches.blocks, patches.cell_size)
        vertices = self._vertices(patches)
        staging = self._staged["bare" if bare else "whole"]
        if not bare:
            more = {**more, **vertices.inverse, "absent": reaching.absent}
        small = staging.put({**reaching.lists, **vertices.arrays, **more})
        launch = _Launch(
            vertices.file,
            small,
            [*(small[name] for name in vertices.places), *vertices.step],
            vertices.across or [small[name] for name in vertices.inverse if name in small],
            (
                # Two rows more than there are: see `parents`.
                self._room("bare height" if bare else "height", (count * side + 2) * side),
                self._room("masks", 4 * size),
                self._room("mottle", size),
            ),
        )
        self._context.launch(
            vertices.file,
            "patches",
            (rounded_up(side * side), count),
            *self._arguments.terrain(reaching, patches.cell_size, small),
            *(small[name] for name in vertices.noise),
            *vertices.octaves,
            *launch.places,
            np.int32(side),
            np.int32(bare),
            *launch.results,
            group=(GROUP, 1),
        )
        return launch

    def _vertices(self, patches: Patches) -> _Vertices:
        """Say where vertices lie, in 32 bits where they do."""
        bits, real = patches.step_bits, self._context.real_dtype
        octaves: OctaveTable = self._arguments.world(patches.cell_size)["table"]
        if bits is None or not fits_patches(octaves, bits):
            inverse = {
                "inverse_x": self._inverse_spans(patches.axis_x).astype(real),
                "inverse_y": self._inverse_spans(-patches.axis_y).astype(real),
            }
            axes = {"axis_x": patches.axis_x, "axis_y": patches.axis_y}
            return _Vertices(_ANYWHERE, axes, inverse=inverse)
        return _Vertices(
            _WHOLE_STEPS,
            {
                "octave_corner": corner_table(octaves, patches.corners, bits),
                "corner_at": patches.corners,
            },
            (np.int32(len(octaves.form)),),
            (np.int32(bits),),
            across=[real.type(self._inverse_spans(patches.axis_x[:1, :3])[0, 1])],
        )

    def _inverse_spans(self, axis: Lattice) -> npt.NDArray[np.float64]:
        """1 / distance between a vertex's two neighbours (1/m); 0 where there is none."""
        inverse = np.zeros(axis.shape)
        spans = np.maximum(axis[:, 2:] - axis[:, :-2], 1) * metres_per_unit(self._arguments.recipe.extent)
        inverse[:, 1:-1] = 1 / spans
        return inverse

    def _whole_rows(self, file: str, kernel: str, side: int) -> tuple[int, int, int] | None:
        """Return groups of as many whole rows of a square as fit and divide it; None where none fits."""
        most = min(self._context.most_in_group(file, kernel), _MOST_IN_GROUP)
        rows = [number for number in range(1, side + 1) if side % number == 0 and number * side <= most]
        return (side, rows[-1], 1) if rows else None

    def _room(self, name: str, size: int) -> Any:
        """Return a buffer for ``size`` values; kept, and made anew only where one is too small."""
        held, buffer = self._scratch.get(name, (0, None))
        if held < size:
            self._scratch.pop(name, None)
            buffer = self._context.empty(size, self._context.real_dtype)
            self._scratch[name] = size, buffer
        return buffer


@dataclass(frozen=True, eq=False)
class _Vertices:
    """Which file's kernels place vertices, and what says where and how far apart, by the kernels' names."""

    file: str
    arrays: dict[str, npt.NDArray[Any]]
    octaves: tuple[np.int32, ...] = ()
    step: tuple[np.int32, ...] = ()
    inverse: dict[str, npt.NDArray[Any]] = field(default_factory=dict)
    across: list[Any] = field(default_factory=list)

    @property
    def noise(self) -> tuple[str, ...]:
        """Arrays that noise reads."""
        return tuple(name for name in self.arrays if name == "octave_corner")

    @property
    def places(self) -> tuple[str, ...]:
        """Arrays that all else reads."""
        return tuple(name for name in self.arrays if name != "octave_corner")


@dataclass(frozen=True, eq=False)
class _Launch:
    """A launch of ``patches``: its file, small arrays, where vertices lie, how far apart, what it writes."""

    file: str
    small: dict[str, Any]
    places: list[Any]
    across: list[Any]
    results: tuple[Any, Any, Any]
