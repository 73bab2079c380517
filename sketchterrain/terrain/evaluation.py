"""Launch the kernels on a recipe: patches of vertices, and single points."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.features import FEATURE_TYPES
from sketchterrain.terrain.culling import feature_lists, features_near
from sketchterrain.terrain.kernel_arguments import KernelArguments
from sketchterrain.terrain.lattice import LATTICE_BITS, metres_per_unit
from sketchterrain.terrain.materials import MATERIALS
from sketchterrain.terrain.packing import pack_features

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from sketchterrain.compute import ComputeContext
    from sketchterrain.terrain.recipe import TerrainRecipe

__all__ = ["MASKS", "Evaluator", "Surface"]

MASKS = ("mountain", "dune", "forest", "water")
"""What the four masks of a point say: see ``Ground`` in ``kernels/world.clh``."""

_FILE = "terrain.cl"
_GROUP = 64
_PATCHES_PER_LAUNCH = 256
_POINTS_PER_LAUNCH = 1 << 21
# Points are culled in square blocks: 2^5 along the sketch's longer side, fewer where points lie far apart.
_BLOCKS_PER_EXTENT_BITS = 5
_MOST_BLOCKS_BITS = 6


@dataclass(frozen=True)
class Surface:
    """Heights, normals and materials of patches of n×n vertices.

    Attributes
    ----------
    height : ndarray, shape (patches, n, n)
        Metres.
    normal : ndarray, shape (patches, n, n, 3)
        Unit vectors: east, north, up.
    materials : ndarray, shape (patches, n, n, len(MATERIALS))
        Weights that sum to 1.
    """

    height: npt.NDArray[np.floating]
    normal: npt.NDArray[np.floating]
    materials: npt.NDArray[np.floating]


class Evaluator:
    """A recipe on a device.

    Parameters
    ----------
    recipe
    context
        An open device; its ``real`` says whether this is the terrain or its float64 reference.
    """

    def __init__(self, recipe: TerrainRecipe, context: ComputeContext) -> None:
        self.recipe = recipe
        self.context = context
        self._arguments = KernelArguments(recipe, context)

    def with_strengths(self, strength: npt.NDArray[np.floating]) -> Evaluator:
        """Return an evaluator of the same recipe but for the painted features' strengths, shape (n,).

        It shares what is on the device already, all of which stays the same.
        """
        other = copy(self)
        other._arguments = self._arguments.with_strengths(strength)
        other.recipe = other._arguments.recipe
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
        inner = side - 2
        real = self.context.real_dtype
        height = np.empty((count, inner, inner), real)
        normal = np.empty((count, inner, inner, 3), real)
        materials = np.empty((count, inner, inner, len(MATERIALS)), real)
        for first in range(0, count, _PATCHES_PER_LAUNCH):
            part = slice(first, first + _PATCHES_PER_LAUNCH)
            self._surface(axis_x[part], axis_y[part], cell_size, height[part], normal[part], materials[part])
            if progress is not None:
                progress(min((first + _PATCHES_PER_LAUNCH) / count, 1.0))
        return Surface(height, normal, materials)

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
        for first in range(0, x.size, _POINTS_PER_LAUNCH):
            part = slice(first, first + _POINTS_PER_LAUNCH)
            height[part], masks[part] = self._points(x[part], y[part], cell_size)
        return height, masks

    def may_hold(
        self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], kind: str
    ) -> npt.NDArray[np.bool_]:
        """Return which points lie in a block of ground that some feature of a type reaches, shape (n,)."""
        blocks, block = _blocks_of(x, y)
        near = features_near(self.recipe, blocks, min_radius=0.0)
        packed = pack_features(self.recipe, near[near["type"] == FEATURE_TYPES.index(kind)], 0.0)
        starts, _ = feature_lists(self.recipe, packed, blocks)
        starts = starts.reshape(len(blocks), -1)
        return np.asarray((starts[:, -1] > starts[:, 0])[block])

    def _points(
        self, x: npt.NDArray[np.int64], y: npt.NDArray[np.int64], cell_size: float
    ) -> tuple[npt.NDArray[Any], npt.NDArray[Any]]:
        context, real = self.context, self.context.real_dtype
        blocks, block = _blocks_of(x, y)
        height, masks = context.empty(x.size, real), context.empty(4 * x.size, real)
        context.launch(
            _FILE,
            "points",
            (_rounded_up(x.size),),
            *self._arguments.terrain(blocks, cell_size),
            context.upload(x),
            context.upload(y),
            context.upload(block.astype(np.int32)),
            np.int32(x.size),
            height,
            masks,
            group=(_GROUP,),
        )
        return context.download(height, x.size, real), context.download(masks, (x.size, 4), real)

    def _surface(
        self,
        axis_x: npt.NDArray[np.int64],
        axis_y: npt.NDArray[np.int64],
        cell_size: float,
        height_out: npt.NDArray[Any],
        normal_out: npt.NDArray[Any],
        materials_out: npt.NDArray[Any],
    ) -> None:
        context, real = self.context, self.context.real_dtype
        count, side = axis_x.shape
        blocks = np.stack([axis_x[:, 0], axis_y[:, -1], axis_x[:, -1], axis_y[:, 0]], axis=-1)
        world = self._arguments.world(cell_size)
        axes = context.upload(axis_x), context.upload(axis_y)
        height = context.empty(count * side * side, real)
        masks = context.empty(count * side * side * 4, real)
        context.launch(
            _FILE,
            "patches",
            (_rounded_up(side * side), count),
            *self._arguments.terrain(blocks, cell_size),
            *axes,
            np.int32(side),
            height,
            masks,
            group=(_GROUP, 1),
        )
        normal = context.empty(normal_out.shape, real)
        materials = context.empty(materials_out.shape, real)
        unit = metres_per_unit(self.recipe.extent)
        context.launch(
            _FILE,
            "surfaces",
            (_rounded_up((side - 2) ** 2), count),
            world["scalars"],
            world["climate"],
            *world["octaves"],
            *axes,
            context.upload(_inverse_spans(axis_x, unit).astype(real)),
            context.upload(_inverse_spans(-axis_y, unit).astype(real)),
            np.int32(side),
            height,
            masks,
            *self._arguments.covers(blocks),
            normal,
            materials,
            group=(_GROUP, 1),
        )
        padded = context.download(height, (count, side, side), real)
        height_out[...] = padded[:, 1:-1, 1:-1]
        normal_out[...] = context.download(normal, normal_out.shape, real)
        materials_out[...] = context.download(materials, materials_out.shape, real)


def _rounded_up(count: int) -> int:
    return -(-count // _GROUP) * _GROUP


def _inverse_spans(axis: npt.NDArray[np.int64], unit: float) -> npt.NDArray[np.float64]:
    """1 / distance between a vertex's two neighbours (1/m); 0 where there is none."""
    inverse = np.zeros(axis.shape)
    spans = axis[:, 2:] - axis[:, :-2]
    inverse[:, 1:-1] = 1 / (np.maximum(spans, 1) * unit)
    return inverse


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
