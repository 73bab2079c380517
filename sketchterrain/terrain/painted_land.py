"""Roads, land use and photographs as appearance tiles paint them (Bruneton & Neyret 2008, section 4.2)."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import (
    BoolArray,
    Float32Array,
    Float64Array,
    Int32Array,
    Int64Array,
    LatticeArray,
    UInt8Array,
)
from sketchterrain.caching import LRUCache
from sketchterrain.geometry.box_index import BoxIndex, expanded
from sketchterrain.geometry.hashing import hash_unit
from sketchterrain.geometry.lattice import LATTICE_BITS, metres_per_unit, to_lattice
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.landuse.areas import NO_LAND_USE
from sketchterrain.roads.road_types import BRIDGE, GROUND, Road, RoadNetwork
from sketchterrain.schema.layers import LANE_WIDTHS
from sketchterrain.terrain.centrelines import arc_boxes
from sketchterrain.terrain.layers.landuse import LandUseLayer
from sketchterrain.terrain.layers.layer import WorldSettings
from sketchterrain.terrain.recipe import TerrainRecipe

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext


_PIECE: Final = kernel_columns("appearance.clh", "PaintedRoad")
_SURFACES: Final = {"asphalt": 0, "gravel": 1, "soil": 2, "rock": 3}
_RAILS: Final = 4
_MARKED: Final = 5.0  # m: carriageways of asphalt have marks from this width on
_FRAY: Final = 0.5  # m by which noise widens roads
_UNDER: Final = 3.0  # m that roads continue under bridges


_Pieces = tuple[LatticeArray, Float64Array, Float64Array, LatticeArray]
"""Pieces of a road: the first three fields of `PaintedRoads`, and boxes."""
_NO_PIECES: Final = np.zeros((0, 2), np.int64), np.zeros((0, 16)), np.zeros(0), np.zeros((0, 4), np.int64)


class PaintedRoads(NamedTuple):
    """Pieces as the kernel reads them, the index of their boxes, and those of each road."""

    at: LatticeArray  # (n, 2) starts, lattice units
    row: Float64Array  # (n, 16) columns of `_PIECE`
    half_width: Float64Array  # (n,) half the greatest width with shoulders, m
    boxes: BoxIndex
    roads: Mapping[tuple[Any, ...], _Pieces]  # by what they depend on, see `_pieces`

    def without(self, other: PaintedRoads) -> Int64Array:
        """Return the numbers of pieces of roads that the other ones lack."""
        own = [key not in other.roads for key in self.roads]
        return np.flatnonzero(np.repeat(own, [len(at) for at, *_ in self.roads.values()]))

    def as_bytes(self, numbers: Int64Array) -> npt.NDArray[np.void]:
        """Return each of some pieces as one value."""
        rows = np.column_stack([self.at[numbers].view(np.float64), self.row[numbers]])
        return np.ascontiguousarray(rows).view(np.dtype((np.void, rows.itemsize * rows.shape[1]))).ravel()


def painted_roads(network: RoadNetwork, extent: float, before: PaintedRoads | None = None) -> PaintedRoads:
    """Return the pieces of all roads on the ground; what is the same as before is shared."""
    known = {} if before is None else before.roads
    others = {(road.leg, road.part): road.structure for road in network.roads if road.structure != GROUND}
    lengths: dict[int, float] = defaultdict(float)
    for road in network.roads:
        lengths[road.leg] = max(lengths[road.leg], float(road.along[-1]))
    ends, roads = _junctions(network), dict[tuple[Any, ...], _Pieces]()
    for road in network.roads:
        if road.structure == GROUND:
            beside = tuple(others.get((road.leg, road.part + step), GROUND) for step in (-1, 1))
            key = road, tuple(ends[road.leg]), lengths[road.leg], beside
            roads[key] = known.get(key) or _pieces(key, extent)
    at, row, half_width, boxes = map(np.concatenate, zip(_NO_PIECES, *roads.values(), strict=True))
    found = PaintedRoads(at, row, half_width, BoxIndex(boxes), roads)
    if before is None or [key for key in roads if key in known] != [key for key in known if key in roads]:
        return found
    added = found.without(before)
    return found._replace(boxes=before.boxes.updated(before.without(found), added, boxes[added]))


def _pieces(key: tuple[Any, ...], extent: float) -> _Pieces:
    """Return the pieces of a road by its `_junctions`, its leg's length (m) and the structures beside it."""
    road, ((clear, gives_way), (clear_end, gives_way_end)), length, beside = key
    count = len(road.bend)
    row = np.zeros((count, 16))
    chord = np.diff(road.axis[:, :2], axis=0)
    row[:, :2], row[:, 2] = chord, 1.0 / np.maximum((chord**2).sum(axis=1), 1e-12)
    row[:, _PIECE["piece_bend"]] = road.bend
    for name, values in (("half", road.half_width), ("whole", road.whole_half)):
        row[:, _PIECE[f"piece_from_{name}"]] = values[:-1]
        row[:, _PIECE[f"piece_to_{name}"]] = values[1:]
    row[:, _PIECE["piece_start"]] = road.along[:-1]
    row[:, _PIECE["piece_length"]] = np.diff(road.along)
    row[:, _PIECE["piece_clear"]] = clear
    row[:, _PIECE["piece_marked"]] = length - clear_end
    lane = LANE_WIDTHS[road.layer]
    row[:, _PIECE["piece_lanes"]] = max(round(2.0 * float(road.half_width.mean()) / lane), 1)
    surface = _RAILS if road.layer == "railway" else _SURFACES.get(road.works.surface, 1)
    row[:, _PIECE["piece_surface"]] = surface
    row[:, _PIECE["piece_ends"]] = 4 * gives_way + 8 * gives_way_end
    row[0, _PIECE["piece_ends"]] += beside[0] != GROUND
    row[-1, _PIECE["piece_ends"]] += 2 * (beside[1] != GROUND)
    marked = surface == 0 and 2.0 * float(road.half_width.min()) >= _MARKED
    row[:, _PIECE["piece_marks"]] = marked
    starts, rows = [road.axis[:-1, :2]], [row]
    for structure, end, step in zip(beside, (0, -1), (-1, 1), strict=True):
        if structure == BRIDGE:
            place, beyond = _under_bridge(road, row[end], end, step)
            starts.append(place)
            rows.append(beyond)
    at, row = to_lattice(np.concatenate(starts), extent), np.concatenate(rows)
    wide = row[:, [_PIECE["piece_from_whole"], _PIECE["piece_to_whole"]]].max(axis=1)
    boxes = arc_boxes(at, row[:, :2], row[:, _PIECE["piece_bend"]], wide + _FRAY, metres_per_unit(extent))
    return at, row, wide, boxes


def _under_bridge(road: Road, row: Float64Array, end: int, step: int) -> tuple[Float64Array, Float64Array]:
    """Return the start (1, 2) and row (1, 16) of a straight piece from an end of a road under a bridge."""
    turn = -2.0 * step * np.arctan(road.bend[end])
    cos, sin = _UNDER * np.cos(turn), _UNDER * np.sin(turn)
    chord = np.array([[cos, -sin], [sin, cos]]) @ row[:2] * np.sqrt(row[2])
    beyond = row[None].copy()
    beyond[0, :2], beyond[0, 2] = chord, 1.0 / _UNDER**2
    for name, values in (("half", road.half_width), ("whole", road.whole_half)):
        beyond[0, [_PIECE[f"piece_from_{name}"], _PIECE[f"piece_to_{name}"]]] = values[end]
    beyond[0, _PIECE["piece_bend"]] = 0.0
    beyond[0, _PIECE["piece_start"]] = road.along[end] - _UNDER * (step < 0)
    beyond[0, _PIECE["piece_length"]] = _UNDER
    beyond[0, _PIECE["piece_ends"]] = row[_PIECE["piece_ends"]] // 4 * 4 + (1 if step < 0 else 2)
    return (road.axis[end, :2] - chord * (step < 0))[None], beyond


def _junctions(network: RoadNetwork) -> dict[int, list[tuple[float, bool]]]:
    """Return how far (m) marks stay away from each leg's start and end, and whether traffic stops there.

    At a junction of three the two legs that are most nearly straight have the right of way; at larger ones
    none has.
    """
    at_node: dict[tuple[float, float], list[tuple[int, int, float, Float64Array, bool]]] = defaultdict(list)
    found: dict[int, list[tuple[float, bool]]] = {}
    for road in network.roads:
        found.setdefault(road.leg, [(0.0, False), (0.0, False)])
        for end, (place, inward, ways) in enumerate(((0, 1, road.ends[0]), (-1, -2, road.ends[1]))):
            if ways < 3:
                continue
            ahead = road.axis[inward, :2] - road.axis[place, :2]
            node = road.axis[place, 0].item(), road.axis[place, 1].item()
            width = float(road.whole_half[place]) if road.layer == "road" else 0.0
            at_node[node].append((road.leg, end, width, ahead / np.hypot(*ahead), road.layer == "road"))
    for arms in at_node.values():
        through = _through([arm[3] for arm in arms]) if len(arms) == 3 else ()
        for number, (leg, end, width, _, is_road) in enumerate(arms):
            others = [arm[2] for k, arm in enumerate(arms) if k != number]
            gives_way = is_road and number not in through and max(others) > 0.0
            found[leg][end] = max(*others, width) + 1.0 if max(others) > 0.0 else 0.0, gives_way
    return found


def _through(ways: Sequence[Float64Array]) -> tuple[int, int]:
    """Return the two of three unit vectors that are most nearly opposite."""
    pairs = ((0, 1), (0, 2), (1, 2))
    return min(pairs, key=lambda pair: float(ways[pair[0]] @ ways[pair[1]]))


FILE: Final = "appearance.cl"
SIDE, BLOCK = (int(each) for each in kernel_constants(FILE, "SIDE", "BLOCK"))
"""Texels along a side of a tile, the outermost those of its neighbours; of a block with lists of its own."""
BLOCKS: Final = SIDE // BLOCK
_COARSE: Final = 7.0  # m: texels from which on areas are summed up on the host
_AREA: Final = kernel_columns("appearance.clh", "PaintedArea")
(_PHOTO_KEPT,) = kernel_constants("appearance.clh", "PHOTO_KEPT")
_LEAST: Final = 0.1  # texels: half widths up to which roads have faded out (paint_road)
_WHOLE: Final = 2.0**40  # 1 in sums of areas
_MOST_SUMS: Final = 64  # squares of large texels whose sums are kept, of 1.2 MB
_MOST_EDITED: Final = 1000  # areas of an edit that sums are changed by


@dataclass(frozen=True, eq=False)
class PaintedLand:
    """What a recipe paints on the ground: photographs beneath land use beneath roads."""

    recipe: TerrainRecipe
    context: ComputeContext
    heights: Callable[..., Float32Array]  # `Terrain.heights`

    @classmethod
    def bare(cls, extent: float, context: ComputeContext) -> PaintedLand:
        """Return land on which nothing is painted."""
        layers = (LandUseLayer((), NO_LAND_USE),)
        return cls(TerrainRecipe(WorldSettings(extent, 0, 0.0), {}, layers), context, np.zeros_like)

    @property
    def extent(self) -> float:
        """Width of the tile (0, 0, 0), m."""
        return self.recipe.extent

    @cached_property
    def is_empty(self) -> bool:
        """Whether nothing is painted anywhere."""
        return not (len(self.recipe.landuse) or len(self._roads.at) or self.recipe.orthophotos)

    def updated(self, recipe: TerrainRecipe, heights: Callable[..., Float32Array]) -> PaintedLand:
        """Return the land of a changed recipe; what depends on unchanged roads and areas is shared."""
        new, old = PaintedLand(recipe, self.context, heights), self.recipe
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
        if "_sums" in known and len(removed) + len(added) <= _MOST_EDITED:
            for place, (corner, texel, total) in self._sums.items():
                for each, areas, sign in ((self, removed, -1), (new, added, 1)):
                    if (change := each._sum_near(areas, corner, texel)) is not None:
                        total = total + sign * change
                new._sums.store(place, (corner, texel, total))
        return new

    def _sum_near(self, areas: Int64Array, corner: LatticeArray, texel: float) -> Int64Array | None:
        """Return `_sum_of` those of some areas that may be in a square, None without any."""
        box = _squares(corner[None], texel / metres_per_unit(self.extent))
        boxes = self._areas.boxes_of(areas)
        near = areas[((boxes[:, :2] <= box[:, 2:]) & (boxes[:, 2:] >= box[:, :2])).all(axis=1)]
        return self._sum_of(near, corner, texel) if len(near) else None

    def changed_areas(self, old: PaintedLand) -> Float64Array:
        """Return boxes (n, 4), m, outside of which tiles of an earlier land are equal.

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

    def occupied(self, tiles: Int64Array) -> BoolArray:
        """Return whether anything may be painted in tiles (n, 3) of level, column and row, (n,)."""
        boxes = _squares(lattice_corners(tiles), np.exp2(LATTICE_BITS - tiles[:, 0]) / (SIDE - 2))
        found = np.zeros(len(boxes), np.bool_)
        photos = np.array([each.box for each in self.recipe.orthophotos]).reshape(-1, 4)
        for index in (self._roads.boxes, self._areas, BoxIndex(to_lattice(photos, self.extent))):
            if len(index):
                found[np.unique(index.touching(boxes)[0])] = True
        return found

    def launched(self, corners: LatticeArray, texel: float) -> tuple[npt.NDArray[Any], ...]:
        """Return starts and numbers of areas and roads in blocks, and their arrays, for squares.

        Texels (m) have the outermost ones outside of south-west corners (n, 2), lattice units.
        """
        wide = texel / metres_per_unit(self.extent)
        roads = self._roads
        pieces, *road_lists = _listed(roads.boxes, corners, wide, roads.half_width > _LEAST * texel)
        # Areas of large texels are in the base.
        areas, *area_lists = _listed(self._areas, corners, wide, np.array([texel <= _COARSE]))
        (area_starts, area_list), (road_starts, road_list) = area_lists, road_lists
        starts = np.stack([area_starts, road_starts + len(area_list)], axis=1)
        arrays = roads.at[pieces], roads.row[pieces], *self._area_rows(areas, self._bearings(areas))
        return starts, np.concatenate([area_list, road_list]), *arrays

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

    def base(self, corners: LatticeArray, texel: float) -> UInt8Array | None:
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
            _, areas = self._areas.touching(_squares(corner[None], texel / metres_per_unit(self.extent)))
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
        context.launch(FILE, "area_means", (len(areas),), real.type(texel), *rows, means)
        colour = context.download(means, (len(areas), 4), real).astype(np.float64)
        colour[:, :3] *= colour[:, 3:]
        edges[:, :2] += np.repeat((at - corner) * metres_per_unit(self.extent) + texel, form[:, 1], axis=0)
        colour = _WHOLE * np.repeat(colour, form[:, 1], axis=0)
        host_function("sum_edges")(edges / texel, colour, total, np.empty((SIDE, SIDE + 1, 4), np.int64))
        return total


def lattice_corners(tiles: Int64Array) -> LatticeArray:
    """Return the south-west corners (n, 2) of tiles (n, 3), lattice units."""
    return np.asarray(tiles[:, 1:] << (LATTICE_BITS - tiles[:, :1]))


def _squares(corners: LatticeArray, wide: npt.ArrayLike) -> LatticeArray:
    """Return boxes (n, 4), lattice units, of squares of texels, by corners of all but the outermost."""
    texel = np.broadcast_to(np.asarray(wide, np.float64), len(corners))[:, None]
    low = corners - texel
    return np.concatenate([np.floor(low), np.ceil(low + SIDE * texel)], axis=1).astype(np.int64)


def _same_ground(one: TerrainRecipe, other: TerrainRecipe) -> bool:
    """Return whether two recipes have the same heights."""
    layers = zip(one.layers, other.layers, strict=True)
    return all(a is b for a, b in layers if not isinstance(a, LandUseLayer))


def block_starts(blocks: npt.NDArray[np.integer], squares: int) -> Int32Array:
    """Return the first of each block of squares among ascending ones, and the end."""
    return np.searchsorted(blocks, np.arange(squares * BLOCKS**2 + 1)).astype(np.int32)


def _listed(
    index: BoxIndex, corners: LatticeArray, wide: float, visible: BoolArray
) -> tuple[Int64Array, Int32Array, Int32Array]:
    """Return the items that blocks of squares list, and the starts and numbers among these of lists.

    `visible` are those that are listed, (n,), or whether all are, (1,).
    """
    square, item = np.zeros((2, 0), np.int64)
    if len(index) and visible.any():
        square, item = index.touching(_squares(corners, wide))
        is_shown = np.broadcast_to(visible, len(index))[item]
        square, item = square[is_shown], item[is_shown]
    boxes = (index.boxes_of(item) - np.tile(corners[square] - wide, 2)) / (BLOCK * wide)
    boxes += np.array([-1.0, -1.0, 1.0, 1.0]) / BLOCK  # texels beside roads have their colours
    low = np.clip(np.floor(boxes[:, :2]), 0, BLOCKS).astype(np.int64)
    high = np.clip(np.floor(boxes[:, 2:]), -1, BLOCKS - 1).astype(np.int64)
    across, up = np.maximum(high - low + 1, 0).T
    pair, place = expanded(across * up)
    column, row = low[pair, 0] + place % across[pair], low[pair, 1] + place // across[pair]
    block = (square[pair] * BLOCKS + BLOCKS - 1 - row) * BLOCKS + column
    order = np.argsort(block, kind="stable")
    used, number = np.unique(item[pair[order]], return_inverse=True)
    return used, block_starts(block[order], len(corners)), number.astype(np.int32)
