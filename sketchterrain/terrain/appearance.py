"""Appearance tiles: colour of roads and land use at any texel size (Bruneton & Neyret 2008, section 4.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import compress, product
from typing import TYPE_CHECKING, Any, Final, Protocol

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, Int64Array, LatticeArray
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.box_index import BoxIndex, item_lists
from sketchterrain.geometry.hashing import hash_unit
from sketchterrain.geometry.lattice import LATTICE_BITS, metres_per_unit, to_lattice
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.painted_roads import PaintedRoads, painted_roads

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext
    from sketchterrain.terrain.recipe import TerrainRecipe

SIDE, _BLOCK = (int(each) for each in kernel_constants("appearance.cl", "SIDE", "BLOCK"))
"""Texels along a side of a tile, the outermost those of its neighbours; of a group with lists of its own."""
_COARSE: Final = 7.0  # m: texels from which on areas are summed up on the host
_FILE: Final = "appearance.cl"
_AREA: Final = kernel_columns("appearance.clh", "PaintedArea")
(_PHOTO_KEPT,) = kernel_constants("appearance.clh", "PHOTO_KEPT")
_NOISE: Final = (60.0, 7.0, 0.7)  # m
_LEAST: Final = 0.1  # texels: half widths up to which roads have faded out (paint_road)
_MAX_TILES: Final = 64  # in a launch
_WHOLE: Final = 2.0**40  # 1 in sums of areas
_MOST_SUMS: Final = 64  # squares of large texels whose sums are kept, of 1.2 MB
_MOST_EDITED: Final = 1000  # areas of an edit that sums are changed by
_MOST_KNOWN: Final = 1 << 16  # tiles of which it is known whether anything is painted there


class AppearanceSource(Protocol):
    """Colour of what is painted on a terrain; see `Appearance`."""

    @property
    def extent(self) -> float:
        """Width of a level-0 tile (m)."""

    @property
    def is_empty(self) -> bool:
        """Whether nothing is painted anywhere."""

    def occupied(self, keys: Int64Array) -> BoolArray:
        """Return whether anything may show in tiles (n, 3) of level, column and row, (n,)."""

    def tiles(self, keys: Int64Array) -> npt.NDArray[np.uint8]:
        """Return tiles (n, side, side, 4), row 0 north: √albedo of what is painted, and its share."""

    def window(
        self, west: float, north: float, *, cell: tuple[float, float], columns: int, rows: int
    ) -> npt.NDArray[np.uint8]:
        """Return texels around the samples of a grid, (rows, columns, 4)."""

    def changed_areas(self, old: Any) -> Float64Array:
        """Return boxes (n, 4), m, in which tiles may differ from those of an earlier source."""


def known_tiles(
    known: dict[tuple[int, ...], bool], tiles: Int64Array, find: Callable[[Int64Array], BoolArray]
) -> BoolArray:
    """Return what `find` returns for tiles (n, 3); a view asks for the same ones in each frame."""
    names = list(map(tuple, tiles.tolist()))
    if len(known) > _MOST_KNOWN:
        known.clear()
    new = np.array([name not in known for name in names], np.bool_)
    if new.any():
        known.update(zip(compress(names, new), find(tiles[new]).tolist(), strict=True))
    return np.array([known[name] for name in names], np.bool_)


def tile_boxes(tiles: Int64Array, extent: float) -> Float64Array:
    """Return the boxes (n, 4), m, of all texels of tiles (n, 3)."""
    width = extent / np.exp2(tiles[:, :1])
    margin = width / (SIDE - 2)
    return np.concatenate([tiles[:, 1:] * width - margin, (tiles[:, 1:] + 1) * width + margin], axis=1)


@dataclass(frozen=True, eq=False)
class Appearance:
    """Colour of what vectors paint on a terrain.

    A tile (level, column, row) covers [column, column + 1] × [row, row + 1] · extent / 2^level m and has
    `SIDE`² texels, row 0 northernmost; those of the outermost rows and columns are its neighbours'.
    """

    recipe: TerrainRecipe
    context: ComputeContext
    heights: Callable[..., Float32Array]  # `Terrain.heights`

    @property
    def extent(self) -> float:
        """Width of the tile (0, 0, 0), m."""
        return self.recipe.extent

    @cached_property
    def is_empty(self) -> bool:
        """Whether nothing is painted anywhere."""
        return not (len(self.recipe.landuse) or len(self._roads.at) or self.recipe.orthophotos)

    def updated(self, recipe: TerrainRecipe, heights: Callable[..., Float32Array]) -> Appearance:
        """Return the appearance of a changed recipe; what depends on unchanged roads and areas is shared."""
        new, old = Appearance(recipe, self.context, heights), self.recipe
        known, kept = self.__dict__, new.__dict__
        if "_roads" in known:
            is_old = recipe.network.roads is old.network.roads
            kept["_roads"] = (
                self._roads if is_old else painted_roads(recipe.network, self.extent, self._roads)
            )
        removed, added = recipe.landuse.difference(old.landuse)
        if "_known_bearings" in known and _same_ground(recipe, old):
            kept["_known_bearings"] = np.full(len(recipe.landuse), np.nan)
            stays = np.delete(np.arange(len(recipe.landuse)), added)
            new._known_bearings[stays] = np.delete(self._known_bearings, removed)
        if "_known_occupied" in known:
            kept["_known_occupied"] = self._occupied_outside(new.changed_areas(self))
        if "_sums" in known and len(removed) + len(added) <= _MOST_EDITED:
            for place, (corner, texel, total) in self._sums.items():
                for each, areas, sign in ((self, removed, -1), (new, added, 1)):
                    if (change := each._sum_near(areas, corner, texel)) is not None:
                        total = total + sign * change
                new._sums.store(place, (corner, texel, total))
        return new

    def _occupied_outside(self, boxes: Float64Array) -> dict[tuple[int, ...], bool]:
        """Return what is known of tiles outside of boxes (n, 4), m."""
        around = tile_boxes(np.array(list(self._known_occupied), np.int64).reshape(-1, 3), self.extent)
        low, high = around[:, :2], around[:, 2:]
        stays = np.ones(len(around), np.bool_)
        for west, south, east, north in boxes:
            stays &= ((low > (east, north)) | (high < (west, south))).any(axis=1)
        return dict(compress(self._known_occupied.items(), stays.tolist()))

    def _sum_near(self, areas: Int64Array, corner: LatticeArray, texel: float) -> Int64Array | None:
        """Return `_sum_of` those of some areas that may be in a square, None without any."""
        box = _blocks(corner[None], texel / metres_per_unit(self.extent), 1)
        boxes = self._areas.boxes_of(areas)
        near = areas[((boxes[:, :2] <= box[:, 2:]) & (boxes[:, 2:] >= box[:, :2])).all(axis=1)]
        return self._sum_of(near, corner, texel) if len(near) else None

    def changed_areas(self, old: Appearance) -> Float64Array:
        """Return boxes (n, 4), m, outside of which tiles of an earlier appearance are equal.

        Directions of rows of crops that follow changed ground are left out: they turn with the next tiles.
        """
        unit = metres_per_unit(self.extent)
        boxes = [np.zeros((0, 4))]
        if self._roads is not old._roads:
            one, other = old._roads, self._roads
            for _ in range(2):
                numbers = one.without(other)
                rows = one.as_bytes(numbers), other.as_bytes(other.without(one))
                changed = numbers[~np.isin(*rows)]
                boxes.append(np.asarray(one.boxes.boxes_of(changed) * unit, np.float64))
                one, other = other, one
        removed, added = self.recipe.landuse.difference(old.recipe.landuse)
        for each, areas in ((old, removed), (self, added)):
            boxes.append(np.asarray(each._areas.boxes_of(areas) * unit, np.float64))
        photos, before = self.recipe.orthophotos, old.recipe.orthophotos
        boxes += [np.array([each.box]) for each in (*photos, *before) if photos != before]
        return np.concatenate(boxes)

    def texel(self, level: int) -> float:
        """Return the side of a level's texels, m."""
        return float(self.extent / 2.0**level / (SIDE - 2))

    def occupied(self, keys: npt.ArrayLike) -> BoolArray:
        """Return whether anything may be painted in tiles (n, 3) of level, column and row, (n,)."""

        def find(tiles: Int64Array) -> BoolArray:
            boxes = _blocks(_corners(tiles), np.exp2(LATTICE_BITS - tiles[:, 0]) / (SIDE - 2), 1)
            found = np.zeros(len(boxes), np.bool_)
            photos = np.array([each.box for each in self.recipe.orthophotos]).reshape(-1, 4)
            photo_boxes = BoxIndex(to_lattice(photos, self.extent))
            for index in (self._roads.boxes, self._areas, photo_boxes):
                if len(index):
                    found[np.unique(index.touching(boxes)[0])] = True
            return found

        return known_tiles(self._known_occupied, np.asarray(keys, np.int64).reshape(-1, 3), find)

    @cached_property
    def _known_occupied(self) -> dict[tuple[int, ...], bool]:
        return {}

    def tiles(self, keys: npt.ArrayLike) -> npt.NDArray[np.uint8]:
        """Return tiles.

        Parameters
        ----------
        keys : (n, 3) levels, columns and rows

        Returns
        -------
        (n, SIDE, SIDE, 4) uint8
            √ of the albedo of red, green and blue over what is painted, and the share of the texel that is.
        """
        tiles = np.asarray(keys, np.int64).reshape(-1, 3)
        result = np.zeros((len(tiles), SIDE, SIDE, 4), np.uint8)
        for level in np.unique(tiles[:, 0]).tolist():
            own = np.flatnonzero(tiles[:, 0] == level)
            result[own] = self._squares(_corners(tiles[own]), self.texel(level))
        return result

    def window(
        self, west: float, north: float, *, cell: tuple[float, float], columns: int, rows: int
    ) -> npt.NDArray[np.uint8]:
        """Return texels around the samples of a grid, (rows, columns, 4) uint8, as those of `tiles`.

        The first sample is at (west, north), m; the others follow every so many m to the east and the south,
        which differ by less than the number of rows can show.
        """
        inner, (east_step, south_step) = SIDE - 2, cell
        across, down = -(-columns // inner), -(-rows // inner)
        x = west - 0.5 * east_step + inner * east_step * np.arange(across)
        y = north + 0.5 * south_step - inner * south_step * np.arange(1, down + 1)
        places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
        found = self._squares(to_lattice(places, self.extent), east_step)[:, 1:-1, 1:-1]
        whole = found.reshape(down, across, inner, inner, 4).swapaxes(1, 2)
        return whole.reshape(down * inner, across * inner, 4)[:rows, :columns]

    def _squares(self, corners: LatticeArray, texel: float) -> npt.NDArray[np.uint8]:
        """Return squares of texels (m), the outermost outside of south-west corners (n, 2), lattice units."""
        result = np.zeros((len(corners), SIDE, SIDE, 4), np.uint8)
        for first in range(0, len(corners), _MAX_TILES):
            part = slice(first, first + _MAX_TILES)
            result[part] = self._launch(corners[part], texel)
        return result

    def _launch(self, corners: LatticeArray, texel: float) -> npt.NDArray[np.uint8]:
        context, unit = self.context, metres_per_unit(self.extent)
        real, shape = context.real_dtype.type, (len(corners), SIDE, SIDE, 4)
        blocks = _blocks(corners, texel / unit, SIDE // _BLOCK)
        roads, road_lists = _listed(self._roads.boxes, blocks, self._roads.half_width > _LEAST * texel)
        # Areas of large texels are in the base.
        areas, area_lists = _listed(self._areas, blocks, np.array([texel <= _COARSE]))
        at, row, form, edges = self._area_rows(areas, self._bearings(areas))
        arrays = (
            *(corners, self._roads.at[roads], self._roads.row[roads].astype(real), *road_lists),
            *(at, row.astype(real), form, edges.astype(real), *area_lists),
        )
        place, *buffers = (context.upload(array) for array in arrays)
        result = context.empty(shape, np.uint8)
        base = self._base(corners, texel)
        bits = np.array([max(round(np.log2(scale / unit)), 0) for scale in _NOISE] + [0], np.int32)
        context.launch(
            *(
                _FILE,
                "appearance",
                (SIDE, SIDE, len(corners)),
                place,
                real(texel),
                real(unit),
                bits,
                *buffers,
            ),
            *(np.int32(base is not None), result if base is None else context.upload(base), result),
            group=(_BLOCK, 1, 1),
        )
        return context.download(result, shape, np.uint8)

    @cached_property
    def _roads(self) -> PaintedRoads:
        return painted_roads(self.recipe.network, self.extent)

    @property
    def _areas(self) -> BoxIndex:
        return self.recipe[LandUseLayer].index(self.recipe.world).boxes

    def _area_rows(
        self, areas: Int64Array, bearings: Float64Array
    ) -> tuple[LatticeArray, Float64Array, npt.NDArray[np.int32], Float64Array]:
        """Return places, rows, forms and edges of some areas whose rows of crops have bearings (°)."""
        use = self.recipe.landuse
        area, ends = use.outlines(areas)
        counts = np.bincount(area, minlength=len(areas))
        first = np.cumsum(counts) - counts
        at = to_lattice(ends[first, :2], self.extent)
        start = ends[:, :2] - (at * metres_per_unit(self.extent))[area]
        edges = np.concatenate([start, ends[:, 2:] - ends[:, :2]], axis=1)
        tone = hash_unit(0, "tone of an area", use.ids[areas])
        row = np.zeros((len(areas), 12))
        corners = np.concatenate([start, start + edges[:, 2:]], axis=1)
        for column, (reduce, x) in enumerate(product((np.minimum, np.maximum), (0, 1))):
            row[:, column] = reduce.reduceat(reduce(corners[:, x], corners[:, 2 + x]), first)
        bearing = np.radians(bearings)
        row[:, _AREA["area_across_x"]], row[:, _AREA["area_across_y"]] = np.cos(bearing), -np.sin(bearing)
        row[:, _AREA["area_tone"]], row[:, _AREA["area_density"]] = tone, use.density[areas]
        row[:, _AREA["area_parcel"]], row[:, _AREA["area_mixed"]] = use.parcels[areas], use.crop[areas] == 0
        form = np.zeros((len(areas), 4), np.int32)
        form[:, 0], form[:, 1] = first, counts
        form[:, 2], form[:, 3] = use.use[areas], use.crops(areas)
        return at, row, form, edges

    @cached_property
    def _known_bearings(self) -> Float64Array:
        return np.full(len(self.recipe.landuse), np.nan)

    def _bearings(self, areas: Int64Array) -> Float64Array:
        """Return the directions (°) of rows of crops: as given, along contours, or along the longest side."""
        use, known = self.recipe.landuse, self._known_bearings
        missing = areas[np.isnan(known[areas])]
        if len(missing):
            known[missing] = use.bearings(missing, self.heights)
        return known[areas]

    def _base(self, corners: LatticeArray, texel: float) -> npt.NDArray[np.uint8] | None:
        """Return what lies below roads, and below areas of small texels: photographs, areas of large ones."""
        photos, is_coarse = self.recipe.orthophotos, texel > _COARSE
        if not photos and not is_coarse:
            return None
        result = np.zeros((len(corners), SIDE, SIDE, 4), np.float32)
        for square, corner in zip(result, corners, strict=True):
            west, south = corner * metres_per_unit(self.extent) - 0.5 * texel
            x, y = west + texel * np.arange(SIDE), south + texel * np.arange(SIDE)[::-1]
            for photo in photos:
                found = photo.sample(x, y, texel)
                square += found - square * (found[..., 3:] / 255.0)
            if is_coarse:
                land = self._coarse(corner, texel)
                share = land[..., 3:] * (1.0 - _PHOTO_KEPT * square[..., 3:] / 255.0)
                square += share * (np.append(255.0 * land[..., :3], np.full_like(share, 255.0), 2) - square)
        result[..., :3] *= 255.0 / np.maximum(result[..., 3:], 1.0)
        return np.rint(np.clip(result, 0.0, 255.0)).astype(np.uint8)

    def _coarse(self, corner: LatticeArray, texel: float) -> Float64Array:
        """Return what areas paint in a square of large texels, exact in colour.

        √ of the albedo, and the share, (SIDE, SIDE, 4), 0 … 1.
        """
        place = tuple(corner.tolist()), texel
        *_, total = self._sums.get(place) or (None,)
        if total is None:
            _, areas = self._areas.touching(_blocks(corner[None], texel / metres_per_unit(self.extent), 1))
            total = self._sum_of(areas, corner, texel)
            self._sums.store(place, (corner, texel, total))
        found = np.maximum(total * _WHOLE**-1, 0.0)[::-1]
        share = found[..., 3:]
        albedo = np.minimum(found[..., :3] / np.maximum(share, 1e-6), 1.0)
        return np.concatenate([np.sqrt(albedo), np.minimum(share, 1.0)], axis=-1)

    @cached_property
    def _sums(self) -> LRUCache:
        """Sums of `_sum_of` over all areas in squares, by place: an edit adds to them what it changes."""
        return LRUCache(_MOST_SUMS)

    def _sum_of(self, areas: Int64Array, corner: LatticeArray, texel: float) -> Int64Array:
        """Return the sum of what areas add to the texels of a square, rows from the south, in 1 / `_WHOLE`.

        Sums of whole numbers are the same in any order.
        """
        context, total = self.context, np.zeros((SIDE, SIDE, 4), np.int64)
        if not len(areas):
            return total
        real = context.real_dtype
        at, row, form, edges = self._area_rows(areas, np.zeros(len(areas)))  # no row is seen
        means = context.empty((len(areas), 4), real)
        rows = [context.upload(each) for each in (row.astype(real), form)]
        context.launch(_FILE, "area_means", (len(areas),), real.type(texel), *rows, means)
        colour = context.download(means, (len(areas), 4), real).astype(np.float64)
        colour[:, :3] *= colour[:, 3:]
        edges[:, :2] += np.repeat((at - corner) * metres_per_unit(self.extent) + texel, form[:, 1], axis=0)
        colour = _WHOLE * np.repeat(colour, form[:, 1], axis=0)
        host_function("sum_edges")(edges / texel, colour, total, np.empty((SIDE, SIDE + 1, 4), np.int64))
        return total


def _corners(tiles: Int64Array) -> LatticeArray:
    """Return the south-west corners (n, 2) of tiles (n, 3), lattice units."""
    return np.asarray(tiles[:, 1:] << (LATTICE_BITS - tiles[:, :1]))


def _blocks(corners: LatticeArray, texel: npt.ArrayLike, parts: int) -> LatticeArray:
    """Return boxes (n · parts², 4), lattice units, of blocks of squares' texels, from the north-west."""
    side = np.broadcast_to(np.asarray(texel, np.float64), len(corners))[:, None]
    step = side * (SIDE // parts)
    west = corners[:, :1] - side + step * np.arange(parts)
    south = corners[:, 1:] - side + step * np.arange(parts)[::-1]
    low = np.stack(np.broadcast_arrays(west[:, None, :], south[:, :, None]), axis=-1).reshape(-1, 2)
    high = low + np.repeat(step, parts**2, axis=0)
    return np.concatenate([np.floor(low), np.ceil(high)], axis=1).astype(np.int64)


def _same_ground(one: TerrainRecipe, other: TerrainRecipe) -> bool:
    """Return whether two recipes have the same heights."""
    layers = zip(one.layers, other.layers, strict=True)
    return all(a is b for a, b in layers if not isinstance(a, LandUseLayer))


def _listed(
    index: BoxIndex, blocks: LatticeArray, visible: BoolArray
) -> tuple[Int64Array, tuple[npt.NDArray[np.int32], npt.NDArray[np.int32]]]:
    """Return the items that blocks list, and the lists by their numbers among these.

    `visible` are those that are listed, (n,), or whether all are, (1,).
    """
    some = len(index) > 0 and bool(visible.any())
    starts, items = np.zeros(len(blocks) + 1, np.int32), np.zeros(0, np.int32)
    if some:
        starts, items = item_lists(index, blocks, None if visible.all() else visible)
    used, number = np.unique(items, return_inverse=True)
    return used.astype(np.int64), (starts, number.astype(np.int32))
