"""Launch the kernels that evaluate patches: many at once, written where they live."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.compute.staging import StagingBuffer
from sketchterrain.terrain.lattice import metres_per_unit
from sketchterrain.terrain.octaves import corner_table, fits_patches, whole_step_bits

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy.typing as npt

    from sketchterrain.terrain.kernel_arguments import KernelArguments, Reaching
    from sketchterrain.terrain.octaves import OctaveTable
    from sketchterrain.terrain.patch_places import Patches
    from sketchterrain.terrain.surfaces import SurfaceStore

    Lattice = npt.NDArray[np.int64]

GROUP = 64
"""Work items of a group."""

# Beyond it, registers get scarce on GPUs.
_MOST_IN_GROUP = 512
_PATCH_GROUP = 4 * GROUP
_ANYWHERE, _WHOLE_STEPS = "terrain.cl", "tiles.cl"


def rounded_up(count: int) -> int:
    """Return the number of work items in whole groups."""
    return -(-count // GROUP) * GROUP


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
        self._most = lru_cache(maxsize=8)(self._context.max_group_size)
        self._rows = lru_cache(maxsize=16)(self._whole_rows)
        self._staged = {name: StagingBuffer(self._context) for name in ("whole", "bare")}

    def of(self, arguments: KernelArguments) -> PatchLauncher:
        """Return one of another recipe of the same extent on the same device; room on it is shared."""
        other = copy(self)
        other._arguments = arguments
        return other

    def surfaces(self, patches: Patches, store: SurfaceStore, slots: npt.NDArray[np.integer]) -> Reaching:
        """Enqueue heights, normals and materials of patches.

        Parameters
        ----------
        patches
            Of the store's side and a border of one.
        store
            Where they are written.
        slots
            Which place in it each of them has, shape (patches,).

        Returns
        -------
        Reaching
            What reaches the patches.
        """
        more = {"slot": np.asarray(slots, np.int32)}
        return self._surfaces("surfaces", patches, more, store.ground, store.materials)

    def vertices(self, patches: Patches, lives: npt.NDArray[np.int32], vertices: Any) -> Reaching:
        """Enqueue packed vertices of patches, their parents' part included.

        Parameters
        ----------
        patches
            Tiles.
        lives
            Slot, parent's slot, east half and north half of each, as the kernel ``vertices`` reads them,
            shape (patches, 4).
        vertices
            The buffer they are written to.

        Returns
        -------
        Reaching
            What reaches the patches.
        """
        return self._surfaces("vertices", patches, {"lives": lives}, vertices)

    def _surfaces(
        self, kernel: str, patches: Patches, where: Mapping[str, npt.NDArray[Any]], *written: Any
    ) -> Reaching:
        """Enqueue one of the kernels that make surfaces, told in small arrays where patches are written."""
        inner = patches.side - 2
        covers = self._arguments.cover_lists(patches.blocks)
        launch = self._heights(patches, {**where, **covers}, bare=False)
        self._context.launch(
            launch.file,
            kernel,
            (inner, inner, patches.count),
            *self._arguments.rules,
            *launch.places,
            *launch.across,
            launch.small["absent"],
            np.int32(patches.side),
            *launch.results,
            *self._arguments.covers(launch.small),
            *(launch.small[name] for name in where),
            *written,
            group=self._rows(launch.file, kernel, inner),
        )
        return launch.reaching

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

    def masked(self, patches: Patches) -> tuple[Any, Any]:
        """Enqueue heights and masks, their border included; return their buffers, which later ones reuse.

        Returns
        -------
        height
            m, (patches, side, side).
        masks
            (patches, 4, side, side), in the order of ``MASKS``.
        """
        height, masks, _ = self._heights(patches, {}, bare=False).results
        return height, masks

    def heights(self, patches: Patches) -> Any:
        """Enqueue heights alone; return their buffer, m, (patches, side, side), which later ones reuse."""
        return self._heights(patches, {}, bare=True).results[0]

    def _heights(self, patches: Patches, more: Mapping[str, npt.NDArray[Any]], *, bare: bool) -> _Launch:
        """Enqueue heights, masks and mottle with their border; put more small arrays where those go."""
        count, side = patches.count, patches.side
        size = 1 if bare else count * side * side
        reaching = self._arguments.reaching(patches.square_blocks, patches.cell_size, ground=patches.blocks)
        vertices = self._vertices(patches)
        staging = self._staged["bare" if bare else "whole"]
        if not bare:
            more = {**more, **vertices.inverse, "absent": _in_none(reaching.absent, patches.squares)}
        small = staging.upload({**reaching.lists, **vertices.arrays, **more})
        launch = _Launch(
            vertices.file,
            reaching,
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
        items = patches.square_side**2
        whole = self._most(vertices.file, "patches") >= _PATCH_GROUP and items >= 4 * _PATCH_GROUP
        group = _PATCH_GROUP if whole or items == _PATCH_GROUP else GROUP
        self._context.launch(
            vertices.file,
            "patches",
            (-(-items // group) * group, count * patches.squares**2),
            *self._arguments.terrain(reaching, patches.cell_size, small),
            *(small[name] for name in vertices.noise),
            *vertices.octaves,
            *launch.places,
            np.int32(side),
            np.int32(patches.squares),
            np.int32(patches.square_side),
            np.int32(bare),
            *launch.results,
            group=(group, 1),
        )
        return launch

    def _vertices(self, patches: Patches) -> _Vertices:
        """Say where vertices lie, in 32 bits where they do."""
        real = self._context.real_dtype
        octaves: OctaveTable = self._arguments.world(patches.cell_size)["table"]
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
            {
                "octave_corner": corner_table(octaves, patches.corners, bits),
                "corner_at": patches.corners,
            },
            (np.int32(len(octaves.form)),),
            (np.int32(bits), np.int32(stride_bits)),
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
        most = min(self._most(file, kernel), _MOST_IN_GROUP)
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


def _in_none(absent: npt.NDArray[np.int32], squares: int) -> npt.NDArray[np.int32]:
    """Return the bits of what is absent from all squares of a patch, shape (patches,)."""
    if squares == 1:
        return absent
    return np.asarray(np.bitwise_and.reduce(absent.reshape(-1, squares**2), axis=1), np.int32)


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
    """A launch of ``patches``: its file, what it is given, where vertices lie, and what it writes."""

    file: str
    reaching: Reaching
    small: dict[str, Any]
    places: list[Any]
    across: list[Any]
    results: tuple[Any, Any, Any]
