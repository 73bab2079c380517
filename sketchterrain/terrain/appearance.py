"""Appearance tiles: colour of roads, land use and draped layers at any texel size, by one painter."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import (
    BoolArray,
    Float32Array,
    Float64Array,
    LatticeArray,
    UInt8Array,
)
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.terrain.painted_land import BLOCK, BLOCKS, FILE, SIDE, PaintedLand, lattice_corners
from sketchterrain.terrain.painted_layers import (
    TEXEL_PIXELS,
    UNKNOWN_GROUND,
    PaintedLayers,
    Scale,
    no_layers,
)

if TYPE_CHECKING:
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.terrain.recipe import TerrainRecipe

_NOISE: Final = (60.0, 7.0, 0.7)  # m
_MAX_TILES: Final = 32  # in a launch
_EVERYWHERE: Final = np.array([[-np.inf, -np.inf, np.inf, np.inf]])


@dataclass(frozen=True, eq=False)
class Appearance:
    """Colour of what vectors and pictures paint on a terrain: draped layers over its roads and land use.

    A tile (level, column, row) covers [column, column + 1] × [row, row + 1] · extent / 2^level m and has
    `SIDE`² texels, row 0 northernmost; those of the outermost rows and columns are its neighbours'. It
    depends on its key alone.
    """

    land: PaintedLand
    layers: PaintedLayers | None = None

    def updated(self, recipe: TerrainRecipe, heights: Callable[..., Float32Array]) -> Appearance:
        """Return the appearance of a changed recipe; what depends on unchanged roads and areas is shared."""
        return replace(self, land=self.land.updated(recipe, heights))

    def with_drapes(self, drapes: Drapes, before: Appearance | None = None) -> Appearance:
        """Return it beneath draped layers; what is listed for unchanged ones of an earlier one is shared."""
        old = before and before.layers
        return replace(self, layers=replace(old, drapes=drapes) if old else PaintedLayers(drapes))

    @property
    def extent(self) -> float:
        """Width of the tile (0, 0, 0), m."""
        return self.land.extent

    @property
    def is_empty(self) -> bool:
        """Whether nothing is painted anywhere."""
        return self.land.is_empty and (self.layers is None or self.layers.drapes.is_empty)

    @property
    def filters(self) -> bool:
        """Whether a layer is unlit, or blends otherwise than by opacity: tiles have twice the channels."""
        return self.layers is not None and self.layers.filters

    @property
    def nbytes(self) -> int:
        """Bytes of lists that are kept."""
        return self.layers.nbytes if self.layers else 0

    def reach(self, old: Appearance) -> float:
        """Texels around `changed_areas` in which tiles may differ."""
        return max([1.0, *(each.layers.reach for each in (self, old) if each.layers)])

    def occupied(self, keys: npt.ArrayLike) -> BoolArray:
        """Return whether anything may be painted in tiles (n, 3) of level, column and row, (n,)."""
        tiles = np.asarray(keys, np.int64).reshape(-1, 3)
        found = self.land.occupied(tiles)
        if self.layers is None:
            return found
        width = self.extent / np.exp2(tiles[:, :1])
        margin = width / (SIDE - 2)
        boxes = np.hstack([tiles[:, 1:] * width - margin, (tiles[:, 1:] + 1) * width + margin])
        return found | self.layers.drapes.occupied(boxes)

    def changed_areas(self, old: Appearance) -> Float64Array:
        """Return boxes (n, 4), m, outside of which tiles of an earlier appearance are equal.

        Widths in px add `reach` texels.
        """
        boxes = [np.zeros((0, 4))] if self.land is old.land else [self.land.changed_areas(old.land)]
        if self.layers and old.layers:
            boxes.append(self.layers.drapes.changed_boxes(old.layers.drapes))
        elif self.layers or old.layers:
            return _EVERYWHERE
        return np.concatenate(boxes)

    def texel(self, level: int) -> float:
        """Return the side of a level's texels, m."""
        return float(self.extent / 2.0**level / (SIDE - 2))

    def tiles(self, keys: npt.ArrayLike) -> UInt8Array:
        """Return tiles.

        Parameters
        ----------
        keys : (n, 3) levels, columns and rows

        Returns
        -------
        (n, SIDE, SIDE, 4) uint8
            √ of the albedo of red, green and blue over what is painted, and the share of the texel that is.
            If the appearance `filters`, 8: how much of the ground's red, green and blue is seen, and what is
            lit.
        """
        tiles = np.asarray(keys, np.int64).reshape(-1, 3)
        result = np.zeros((len(tiles), SIDE, SIDE, 8 if self.filters else 4), np.uint8)
        for level in np.unique(tiles[:, 0]).tolist():
            own, texel = np.flatnonzero(tiles[:, 0] == level), self.texel(level)
            names = list(map(tuple, tiles[own].tolist()))
            scale = Scale(texel, texel / TEXEL_PIXELS)
            result[own] = self._squares(lattice_corners(tiles[own]), scale, names)
        return result

    def window(
        self, west: float, north: float, *, cell: tuple[float, float], columns: int, rows: int
    ) -> UInt8Array:
        """Return texels around the samples of a grid, (rows, columns, 4), as those of `tiles`.

        The first sample is at (west, north), m; the others follow every so many m to the east and the south,
        which differ by less than the number of rows can show. A texel is a pixel. Where layers filter what is
        below, it is taken for ground of a mean albedo.
        """
        inner, (east_step, south_step) = SIDE - 2, cell
        across, down = -(-columns // inner), -(-rows // inner)
        x = west - 0.5 * east_step + inner * east_step * np.arange(across)
        y = north + 0.5 * south_step - inner * south_step * np.arange(1, down + 1)
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        found = self._squares(to_lattice(places, self.extent), Scale(east_step, east_step))[:, 1:-1, 1:-1]
        whole = _without_filter(found).reshape(down, across, inner, inner, 4).swapaxes(1, 2)
        return whole.reshape(down * inner, across * inner, 4)[:rows, :columns]

    def _squares(
        self, corners: LatticeArray, scale: Scale, names: Sequence[Hashable] | None = None
    ) -> UInt8Array:
        """Return squares of texels, the outermost outside of south-west corners (n, 2), lattice units."""
        parts = [slice(first, first + _MAX_TILES) for first in range(0, len(corners), _MAX_TILES)]
        found = [self._launch(corners[part], scale, names[part] if names else None) for part in parts]
        return np.concatenate(found)

    def _launch(self, corners: LatticeArray, scale: Scale, names: Sequence[Hashable] | None) -> UInt8Array:
        land, unit, texel = self.land, metres_per_unit(self.extent), scale.texel
        context, real, shape = land.context, land.context.real_dtype, (len(corners), SIDE, SIDE, 4)
        starts, numbers, *vectors = land.launched(corners, texel)
        outer = corners * unit - texel
        layers = self.layers.launched(outer, scale, names) if self.layers else no_layers(len(corners))
        entry_starts, pieces, *parts = layers
        starts = np.column_stack([starts, entry_starts, np.full(len(starts), len(numbers))])
        arrays = corners, *vectors, starts.astype(np.int32), np.concatenate([numbers, pieces]), *parts
        place, *buffers = (
            context.upload(each.astype(real) if each.dtype.kind == "f" else each) for each in arrays
        )
        bits = np.array([max(round(np.log2(width / unit)), 0) for width in _NOISE] + [0], np.int32)
        result, base = context.empty(shape, np.uint8), land.base(corners, texel)
        through = context.empty(shape, np.uint8) if self.filters else result
        below = result if base is None else context.upload(base)
        context.launch(
            *(FILE, "appearance", (BLOCKS * BLOCK**2, BLOCKS, len(corners))),
            *(place, real.type(texel), real.type(unit), bits, *buffers, below, np.int32(base is not None)),
            *(np.int32(len(parts[-2])), np.int32(self.filters), result, through),
            group=(BLOCK**2, 1, 1),
        )
        found = [context.download(each, shape, np.uint8) for each in (result, through)[: 1 + self.filters]]
        return np.concatenate(found, axis=-1)


def _without_filter(texels: UInt8Array) -> UInt8Array:
    """Return texels (…, 4) that look over ground of a mean albedo as those with a filter (…, 8) do."""
    if texels.shape[-1] == 4:
        return texels
    values = texels / 255.0
    share = values[..., 3:4]
    own = values[..., :3] ** 2 * share + UNKNOWN_GROUND * (values[..., 4:7] - (1.0 - share))
    root = np.sqrt(np.clip(own / np.maximum(share, 1e-6), 0.0, 1.0))
    return np.rint(255.0 * np.concatenate([root, share], axis=-1)).astype(np.uint8)
