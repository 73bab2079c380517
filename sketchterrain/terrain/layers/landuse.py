"""Land use: fields, meadows, forests and built-up land within outlines."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array, LatticeArray
from sketchterrain.features.table import starts
from sketchterrain.geometry.box_index import BoxIndex
from sketchterrain.host.library import host_function
from sketchterrain.io.resources import kernel_constants
from sketchterrain.landuse.areas import BUILT_UP, FIELD, FOREST, MEADOW, LandUse
from sketchterrain.schema.layers import CROPS
from sketchterrain.terrain.layers.layer import (
    ITEMS,
    MASKS,
    Culled,
    HostSamples,
    HostSite,
    LayerChange,
    Sampling,
    TerrainLayer,
    WorldSettings,
    smooth_rise,
)

if TYPE_CHECKING:
    from sketchterrain.compute.context import ComputeContext

_HEADER: Final = "layers/landuse.clh"
(_CELLS,) = kernel_constants(_HEADER, "LAND_CELLS")
_COVERS: Final = {
    MEADOW: ("grass", 1.0),
    BUILT_UP: ("gravel", 0.5),
}
"""Material of a use, and the share of the ground that it covers; forests leave it to the rules."""
_BARE_CROPS: Final = ("ploughed", "vineyard")  # on soil; others grow as grass does
_MARGIN = 2  # lattice units: rounding of positions
_FARTHEST = 1 << 30  # lattice units from a block to the ends of its edges
_MOST_CELL = 0.25  # of the extent: no land use at wider cells
_AT_ONCE = 1 << 20  # edges
_MEASURED = 1 << 13  # areas that are measured at once
_MANY = 256  # areas whose boxes are one, if so many differ
_CROWDED, _PARTS = 16, 4  # areas of a block from which on it is cut into so many parts along a side


class AreaIndex(NamedTuple):
    """Where areas are, and how wide."""

    boxes: BoxIndex  # lattice units
    width: Float64Array  # (n,) m

    @classmethod
    def of(cls, areas: LandUse, world: WorldSettings) -> AreaIndex:
        """Return the index of areas."""
        parts = np.array_split(np.arange(len(areas)), len(areas) // _MEASURED + 1)
        boxes, width = zip(*(_measured(areas, part, world.unit) for part in parts), strict=True)
        return cls(BoxIndex(np.concatenate(boxes)), np.concatenate(width))

    def updated(self, areas: LandUse, change: LayerChange, world: WorldSettings) -> AreaIndex:
        """Return the index of changed areas."""
        boxes, added = _measured(areas, change.added, world.unit)
        width = np.empty(len(areas))
        stays = np.ones(len(areas), np.bool_)
        stays[change.added] = False
        width[stays], width[change.added] = np.delete(self.width, change.removed), added
        return AreaIndex(self.boxes.updated(change.removed, change.added, boxes), width)


class _Near(NamedTuple):
    """Pairs of a block and an area near it, by block, and the area's edges near the block."""

    block: Int64Array  # (k,)
    area: Int64Array  # (k,)
    inside: BoolArray  # (k,) whether the block's south-east corner is
    counts: Int64Array  # (k,) of its edges near the block
    ends: npt.NDArray[np.int32]  # (m, 4) of edges, as kernels read them
    rows: npt.NDArray[np.int32]


@dataclass(frozen=True, eq=False)
class LandUseLayer(TerrainLayer):
    """Areas of land use: the mask of forests, and materials; it changes no height."""

    name: ClassVar[str] = "landuse"
    has_heights: ClassVar[bool] = False

    materials: tuple[str, ...]  # names, in the order of their weights
    areas: LandUse = field(metadata=ITEMS)

    def index(self, world: WorldSettings) -> AreaIndex:
        """Return the index of its areas; the one of a changed layer follows from that before."""
        return self.cache.get_or_compute(world.extent, lambda: AreaIndex.of(self.areas, world))

    def change(self, old: TerrainLayer, world: WorldSettings) -> LayerChange | None:
        """Return what differs from another one."""
        if not isinstance(old, LandUseLayer):
            raise TypeError(f"expected a {type(self).__name__}, got a {type(old).__name__}")
        removed, added = self.areas.difference(old.areas)
        pairs = (old.areas, removed), (self.areas, added)
        boxes = np.concatenate([_measured(areas, rows, world.unit)[0] for areas, rows in pairs])
        if len(boxes) > _MANY:
            boxes = np.concatenate([boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)])[None]
        change = LayerChange(removed, added, boxes)
        if change and world.extent in old.cache:
            self.cache.store(world.extent, old.index(world).updated(self.areas, change, world))
        return change

    def masks(self, culled: Culled, blocks: int) -> npt.NDArray[np.int32]:
        """Return the bit of forests for blocks with one."""
        first, rows = culled.lists["landuse_starts"], culled.lists["landuse_row"]
        trees = np.append(0, np.cumsum(rows[:, 0] > 0.0))
        trees = trees[first[:: (len(first) - 1) // max(blocks, 1)]]
        present = trees[1:] > trees[:-1]
        return np.asarray(present.astype(np.int32) << MASKS.index("forest"), np.int32)

    def listed(
        self, blocks: LatticeArray, cell: float, world: WorldSettings
    ) -> tuple[Int64Array, Int64Array]:
        """Return pairs of a block and an area of which its cells may show something, from the top down."""
        index, unit = self.index(world), world.unit
        reach = _reach(cell, unit)
        if cell > _MOST_CELL * world.extent:
            blocks = blocks[:0]
        widened = blocks + np.array([-reach, -reach, reach, reach])
        block, area = index.boxes.touching(widened, least=int(_CELLS * cell / unit))
        shown = index.width[area] > _CELLS * cell
        block, area = block[shown], area[shown]
        order = np.lexsort((-area, block))
        return block[order], area[order]

    def near(
        self, blocks: LatticeArray, pairs: tuple[Int64Array, Int64Array], cell: float, unit: float
    ) -> _Near:
        """Return pairs of a block (n, 4) and an area with the area's edges near the block."""
        (block, area), reach = pairs, _reach(cell, unit)
        inside, counts = np.zeros(len(area), np.bool_), np.zeros(len(area), np.int64)
        every = [np.zeros((2, 0, 4), np.int32)]
        batch = np.cumsum(self.areas.counts[area]) // _AT_ONCE
        for number in range(int(batch[-1]) + 1 if len(batch) else 0):
            own = slice(*np.searchsorted(batch, (number, number + 1)))
            _, edges = self.areas.outlines(area[own])
            found = np.empty((2, len(edges), 4), np.int32)
            first = starts(self.areas.counts[area[own]])
            given = first, edges, blocks[block[own]], reach, unit, _FARTHEST
            last = host_function("edges_near")(*given, inside[own], counts[own], *found)
            every.append(found[:, :last])
        ends, rows = np.concatenate(every, axis=1)
        return _Near(block, area, inside, counts, ends, rows)

    def areas_at(self, x: LatticeArray, y: LatticeArray, world: WorldSettings) -> Int64Array:
        """Return the area at each position (n,), the one on top; -1 where none is."""
        at = np.stack([x, y, x, y], axis=1)
        near = self.near(at, self.index(world).boxes.at_points(x, y), 0.0, world.unit)
        found = np.full(len(x), -1)
        found[near.block[near.inside]] = near.area[near.inside]  # the topmost is assigned last
        return found

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with the mask of its forests."""
        if not site.masks or not len(self.areas):
            return ground
        world, cell = site.sampling.world, site.sampling.cell
        left, trees = np.ones(len(site.x)), np.zeros(len(site.x))
        at = np.stack([site.x, site.y, site.x, site.y], axis=1)
        near = self.near(at, self.listed(at, cell, world), cell, world.unit)
        shares = self._shares(near, cell, world)
        shares *= smooth_rise(self.index(world).width[near.area] / cell, _CELLS, _CELLS)
        density = self.densities(near.area)
        # The first areas of all points, then the second ones, and so on.
        rank = np.arange(len(near.block)) - np.searchsorted(near.block, near.block)
        for number in range(int(rank.max(initial=-1)) + 1):
            own = np.flatnonzero(rank == number)
            point = near.block[own]
            share = np.minimum(shares[own], left[point])
            left[point] -= share
            trees[point] += share * density[own]
        return replace(ground, forest=ground.forest * left + trees)

    def _shares(self, near: _Near, cell: float, world: WorldSettings) -> Float64Array:
        """Return the share of the cell about each point, a block, that areas near it cover."""
        x, y, to_x, to_y = (near.ends * world.unit).T
        east, north = to_x - x, to_y - y
        square = east * east + north * north
        t = np.clip(-(x * east + y * north) / np.where(square > 0.0, square, 1.0), 0.0, 1.0)
        nearest = np.full(len(near.area), np.inf)
        np.minimum.at(
            nearest,
            np.repeat(np.arange(len(near.area)), near.counts),
            (x + t * east) ** 2 + (y + t * north) ** 2,
        )
        cells = np.sqrt(nearest) / cell
        return np.asarray(np.clip(0.5 + np.where(near.inside, cells, -cells), 0.0, 1.0))

    def densities(self, areas: Int64Array) -> Float64Array:
        """Return the shares of a full stand of trees in areas (n,)."""
        return np.where(self.areas.use[areas] == FOREST, self.areas.density[areas], 0.0)

    def covers(self, areas: Int64Array) -> tuple[npt.NDArray[np.int32], Float64Array]:
        """Return the material of areas (n,), -1 without one, and the share of the ground that it covers."""
        names = [*self.materials, "forest"]
        use = self.areas.use[areas]
        material, cover = np.full(len(areas), -1, np.int32), np.zeros(len(areas))
        for each, (name, share) in _COVERS.items():
            material[use == each], cover[use == each] = names.index(name), share
        fields = use == FIELD
        bare = np.isin(self.areas.crops(areas), [CROPS.index(name) for name in _BARE_CROPS])
        material[fields] = np.where(bare, names.index("soil"), names.index("grass"))[fields]
        cover[fields] = 1.0
        return material, cover


class LandUseCuller:
    """Areas on a device: each launch gets those near its blocks, with their edges."""

    def __init__(self, layer: LandUseLayer, context: ComputeContext, world: WorldSettings) -> None:
        self._layer = layer
        self._context = context
        self._world = world

    def updated(self, layer: TerrainLayer, change: LayerChange) -> LandUseCuller:
        """Return the culler of a changed layer."""
        del change
        assert isinstance(layer, LandUseLayer)  # noqa: S101 # a layer is followed by one of its kind
        return LandUseCuller(layer, self._context, self._world)

    def cull(self, blocks: LatticeArray, sampling: Sampling, around: LatticeArray | None = None) -> Culled:
        """Return the areas near blocks and their edges (``LandUse`` of ``kernels/layers/landuse.clh``)."""
        del around
        layer, world, cell = self._layer, sampling.world, sampling.cell
        pairs, grid = layer.listed(blocks, cell, world), np.ones((len(blocks), 4), np.int32)
        if len(pairs[0]) > _CROWDED * len(blocks):
            grid[:, 0], grid[:, 1:3] = _PARTS, (blocks[:, 2:] - blocks[:, :2]) // _PARTS + 1
            blocks = _parts(blocks[:, :2], grid[:, 1:3])
            pairs = layer.listed(blocks, cell, world)
        else:
            grid[:, 1:3] = blocks[:, 2:] - blocks[:, :2] + 1
        near = layer.near(blocks, pairs, cell, world.unit)
        used = near.inside | (near.counts > 0)
        block, area = near.block[used], near.area[used]
        last = np.cumsum(near.counts[used])
        material, cover = layer.covers(area)
        form = np.stack([last - near.counts[used], last, material, near.inside[used]], axis=1)
        reach = _reach(cell, world.unit)
        box = layer.index(world).boxes.boxes_of(area) - np.tile(blocks[block, :2], 2)
        box += (-reach, -reach, reach, reach)
        seen = smooth_rise(layer.index(world).width[area] / cell, _CELLS, _CELLS)
        row = np.stack([layer.densities(area), seen, cover, np.zeros(len(area))], axis=1)
        square = ((near.ends[:, 2:] * 1.0 - near.ends[:, :2]) ** 2).sum(axis=1)
        inverse = np.where(square > 0.0, 1.0, 0.0) / np.where(square > 0.0, square * world.unit**2, 1.0)
        lists: dict[str, npt.NDArray[Any]] = {
            "landuse_grid": grid,
            "landuse_at": blocks[:, :2],
            "landuse_starts": np.searchsorted(block, np.arange(len(blocks) + 1)).astype(np.int32),
            "landuse_form": form.astype(np.int32),
            "landuse_box": np.clip(box, -_FARTHEST, _FARTHEST).astype(np.int32),
            "landuse_row": row.astype(sampling.real),
            "landuse_ends": near.ends,
            "landuse_rows": near.rows,
            "landuse_inverse": inverse.astype(sampling.real),
        }
        return Culled({}, lists, None)


def _parts(corner: LatticeArray, size: npt.NDArray[np.int32]) -> LatticeArray:
    """Return the parts of blocks at corners (n, 2), by rows from the south-west; without common points."""
    place = np.stack([np.tile(np.arange(_PARTS), _PARTS), np.repeat(np.arange(_PARTS), _PARTS)], axis=1)
    low = (corner[:, None] + size[:, None] * place.astype(np.int64)).reshape(-1, 2)
    return np.concatenate([low, low + np.repeat(size, _PARTS**2, axis=0) - 1], axis=1)


def _reach(cell: float, unit: float) -> int:
    """Return how far (lattice units) an area has an effect beyond its border."""
    return int(np.ceil(0.5 * cell / unit)) + _MARGIN


def _measured(areas: LandUse, numbers: Int64Array, unit: float) -> tuple[LatticeArray, Float64Array]:
    """Return the boxes (n, 4), lattice units, and the widths (m) of some areas."""
    if not len(numbers):
        return np.zeros((0, 4), np.int64), np.zeros(0)
    area, edges = areas.outlines(numbers)
    start, end = edges[:, :2], edges[:, 2:]
    first = np.searchsorted(area, np.arange(len(numbers)))
    low = np.minimum.reduceat(np.minimum(start, end), first)
    high = np.maximum.reduceat(np.maximum(start, end), first)
    boxes = np.concatenate([np.floor(low / unit) - _MARGIN, np.ceil(high / unit) + _MARGIN], axis=1)
    way = end - start
    from_corner = start - start[first][area]
    double = np.add.reduceat(from_corner[:, 0] * way[:, 1] - from_corner[:, 1] * way[:, 0], first)
    around = np.add.reduceat(np.sqrt((way * way).sum(axis=1)), first)
    # Of a square its side, of a long strip twice its width.
    width = np.minimum(2.0 * np.abs(double) / around, (high - low).min(axis=1))
    return boxes.astype(np.int64), width
