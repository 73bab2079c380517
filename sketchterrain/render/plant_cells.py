"""Plant instances around an eye by cells of the world: generated in steps, most urgent first, and cached."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from sketchterrain.look.tree_levels import VARIANTS, plant_chances, plant_variants
from sketchterrain.look.tree_species import HEIGHTS
from sketchterrain.render.plant_meshes import cull_distance, plant_importance, removal_rank
from sketchterrain.render.quality import UNLIMITED, WorkRate
from sketchterrain.render.scatter import cells_within
from sketchterrain.tiles.lod import inside_frustum

if TYPE_CHECKING:
    from collections.abc import Generator, Sequence

    import numpy.typing as npt

    from sketchterrain.array_types import (
        BoolArray,
        Bounds,
        Float32Array,
        Float64Array,
        StructuredArray,
        UInt8Array,
    )
    from sketchterrain.render.quality import TimeBudget
    from sketchterrain.render.scene import TerrainSource

CELL: Final = 256.0
"""Side of a cell, m. Smaller ones take as long, larger ones longer than a frame can spare."""
SINK: Final = 0.15  # depth of feet below the ground, m
PATCH: Final = 32.0  # side of the squares in which neighbours are counted, m
DENSE: Final = 0.02  # trees per m² of dense forest
LOW: Final = 3.5  # height below which plants shade no others, m
MAX_CELLS: Final = 640  # size of the cache
CROWN_MARGIN: Final = 12.0  # largest radius of a crown, m
FADE: Final = 0.55
"""Share of the draw distance from which on plants are thinned out, so that they end without a seam."""
INVALIDATION_MARGIN: Final = 300.0
"""Distance from changed terrain (m) within which plants may change: their spacing depends on neighbours."""

CellKey = tuple[int, int]


class PlantInstances(NamedTuple):
    """Plants as arrays; those culled last come first."""

    rows: Float32Array
    """(n, 8) foot x, y from the cell's south-west corner, z, height (m); cosine and sine of the rotation;
    variation: crowding 0..15 + tint 0..1; unused."""
    rank: Float32Array  # (n,) `removal_rank`
    importance: Float32Array  # (n,) m
    cull: Float32Array  # (n,) `cull_distance`, m
    kind: UInt8Array  # (n,) species · variants + variant

    def subset(self, index: npt.NDArray[np.intp]) -> PlantInstances:
        """Return the instances at indices."""
        rows, rank, importance, cull, kind = self
        return PlantInstances(rows[index], rank[index], importance[index], cull[index], kind[index])

    @property
    def position(self) -> Float32Array:
        """(n, 3) feet (m)."""
        return self.rows[:, :3]

    @property
    def height(self) -> Float32Array:
        """(n,) heights (m)."""
        return self.rows[:, 3]


def plant_instances(plants: StructuredArray, corner: Float64Array) -> PlantInstances:
    """Return the instances of plants (`PLANT`) of the cell with a south-west corner (m)."""
    position = np.stack([plants["x"] - corner[0], plants["y"] - corner[1], plants["z"] - SINK], axis=1)
    chance, second = plant_chances(plants)
    rank = removal_rank(plants["level"], chance)
    height = np.asarray(HEIGHTS)[plants["species"]] * plants["scale"]
    crowding = _crowding(position, height)
    importance = plant_importance(height, crowding)
    cull = cull_distance(importance, rank)
    rows = np.zeros((len(plants), 8), np.float32)
    rows[:, :3], rows[:, 3] = position, height
    rows[:, 4], rows[:, 5] = np.cos(plants["rotation"]), np.sin(plants["rotation"])
    rows[:, 6] = np.floor(15.0 * crowding) + 0.998 * plants["tint"]
    kind = plants["species"] * VARIANTS + plant_variants(second)
    order = np.argsort(-cull, kind="stable")
    single = [column.astype(np.float32) for column in (rank, importance, cull)]
    return PlantInstances(rows, single[0], single[1], single[2], kind.astype(np.uint8)).subset(order)


def _crowding(position: Float64Array, height: Float64Array) -> Float64Array:
    """Return each plant's shading by other trees, 0 alone … 1 in a dense forest."""
    trees = np.where(height > LOW, 1.0, 0.0)
    column, row = np.clip(np.floor(position[:, :2] / PATCH), 0, CELL // PATCH - 1).astype(np.int64).T
    patch = column + int(CELL / PATCH) * row
    count = np.bincount(patch, trees, minlength=int(CELL / PATCH) ** 2)
    return np.asarray(np.clip((count[patch] - 1.0) / (DENSE * PATCH**2), 0.0, 1.0))


@dataclass
class Cell:
    """The plants of one cell."""

    corner: Float64Array  # (2,) south-west, m
    instances: PlantInstances
    low: float  # vertical bounds, m
    high: float
    age: float = 0.0  # s
    new: BoolArray | None = None  # (n,) which plants are not from before the last change; None: all
    version: int = 0  # of the terrain
    stale: bool = False

    def ages(self, count: int) -> Float32Array:
        """Return the ages of the first plants (s), infinite for those from before the last change."""
        if self.new is None:
            return np.full(count, self.age, np.float32)
        return np.where(self.new[:count], np.float32(self.age), np.float32(np.inf))

    def count_above(self, eye: tuple[float, float, float], angle: float) -> int:
        """Return the number of first plants that may exceed a culling angle (rad) for an eye (m)."""
        x, y = np.maximum(np.abs(self.corner + 0.5 * CELL - eye[:2]) - 0.5 * CELL, 0.0).tolist()
        z = max(eye[2] - self.high, self.low - eye[2], 0.0)
        nearest = max(math.hypot(x, y, z), 1.0)
        return int(np.searchsorted(-self.instances.cull, -angle * nearest, side="right"))


class PlantCells:
    """Cache and generator of plant cells; `changes` counts the cells generated."""

    def __init__(self, terrain: TerrainSource) -> None:
        self._terrain = terrain
        self._cells: dict[CellKey, Cell] = {}  # least recently requested first
        self._requested: list[CellKey] = []
        self._job: tuple[list[CellKey], Generator[None, None, StructuredArray]] | None = None
        self._step = 0
        self._version = self._job_version = 0
        self._rates: list[WorkRate] = []  # of a job's steps
        self.changes = 0

    @property
    def complete(self) -> bool:
        """Whether all requested cells are up to date."""
        return not self._missing()

    @property
    def youngest(self) -> float:
        """Smallest age (s) of the requested cells."""
        return min((self._cells[key].age for key in self._requested if key in self._cells), default=np.inf)

    def __getitem__(self, key: CellKey) -> Cell | None:
        return self._cells.get(key)

    def request(self, keys: Sequence[CellKey]) -> None:
        """Set the cells that are needed, most urgent first."""
        self._requested = list(keys)
        for key in reversed(self._requested):
            if key in self._cells:
                self._cells[key] = self._cells.pop(key)
        for key in list(self._cells)[: max(len(self._cells) - MAX_CELLS, 0)]:
            del self._cells[key]

    def set_terrain(self, terrain: TerrainSource, areas: Sequence[Bounds]) -> None:
        """Replace the terrain, which differs inside areas (m) only.

        Requested cells that are affected stay until they have been generated again; others are dropped.
        """
        self._terrain = terrain
        self._version += 1
        requested = set(self._requested)
        for key in [key for key in self._cells if _near_any(key, areas)]:
            if key in requested:
                self._cells[key].stale = True
            else:
                del self._cells[key]
        up_to_date = self._job_version == self._version - 1
        if self._job is not None and up_to_date and not any(_near_any(key, areas) for key in self._job[0]):
            self._job_version = self._version

    def grow(self, elapsed: float) -> None:
        """Increase the age of all cells (s)."""
        for cell in self._cells.values():
            cell.age += elapsed

    def advance(self, budget: TimeBudget = UNLIMITED, *, block: int = 1) -> None:
        """Generate cells within a time budget, as many along the sides of a block at once."""
        while True:
            if self._job is None:
                missing = self._missing()
                if not missing:
                    return
                col, row = (place // block for place in missing[0])
                keys = [key for key in missing if (key[0] // block, key[1] // block) == (col, row)]
                self._job, self._step = (keys, self._terrain.foliage_steps(*_bounds_of(keys))), 0
                self._job_version = self._version
            while len(self._rates) <= self._step:
                self._rates.append(WorkRate(0.004))
            if not self._rates[self._step].run(budget, self._run_step, count=1):
                return

    def _run_step(self, _: int) -> None:
        if self._job is None:
            return
        keys, steps = self._job
        try:
            next(steps)
            self._step += 1
        except StopIteration as end:
            self._store(keys, end.value)
            self._job = None

    def _missing(self) -> list[CellKey]:
        """Return the cells to generate: missing ones, then stale ones, oldest first."""
        missing = [key for key in self._requested if key not in self._cells]
        stale = [key for key in self._requested if key in self._cells and self._cells[key].stale]
        return missing + sorted(stale, key=lambda key: self._cells[key].version)

    def _store(self, keys: Sequence[CellKey], plants: StructuredArray) -> None:
        col, row = (np.floor(plants[axis] / CELL).astype(np.int64) for axis in ("x", "y"))
        for key in keys:
            self._store_cell(key, plants[(col == key[0]) & (row == key[1])])

    def _store_cell(self, key: CellKey, plants: StructuredArray) -> None:
        corner = CELL * np.array(key, dtype=np.float64)
        instances = plant_instances(plants, corner)
        top = instances.position[:, 2] + instances.height
        low, high = (float(instances.position[:, 2].min()), float(top.max())) if len(top) else (0.0, 0.0)
        before = self._cells.get(key)
        new = None if before is None else ~np.isin(_plant_ids(instances), _plant_ids(before.instances))
        # If the terrain has changed since the job started, its result belongs to the terrain before.
        stale = self._job_version != self._version
        self._cells[key] = Cell(corner, instances, low, high, new=new, version=self._job_version, stale=stale)
        self.changes += 1


def _bounds_of(keys: Sequence[CellKey]) -> Bounds:
    """Return the rectangle (west, south, east, north, m) around cells."""
    places = np.array(keys, dtype=np.int64)
    return *(CELL * places.min(axis=0)).tolist(), *(CELL * (places.max(axis=0) + 1)).tolist()


def _plant_ids(instances: PlantInstances) -> npt.NDArray[np.uint64]:
    """Return an id of each plant within its cell, from its position and kind."""
    position = np.ascontiguousarray(instances.rows[:, :2]).view(np.uint64)[:, 0]
    return np.asarray(position * np.uint64(0x9E3779B97F4A7C15) + instances.kind.astype(np.uint64))


def _near_any(key: CellKey, areas: Sequence[Bounds]) -> bool:
    """Return whether plants of a cell may depend on the ground in areas (m)."""
    west, south = (CELL * axis - INVALIDATION_MARGIN for axis in key)
    east, north = (CELL * (axis + 1) + INVALIDATION_MARGIN for axis in key)
    return any(w <= east and e >= west and s <= north and n >= south for w, s, e, n in areas)


def cells_in_view(planes: Float64Array, keys: Sequence[CellKey], bounds: Float64Array) -> BoolArray:
    """Return which cells with (n, 2) vertical bounds (m) intersect a frustum of (k, 4) planes."""
    corner = CELL * np.array(keys, dtype=np.float64).reshape(-1, 2)
    low = np.concatenate([corner - CROWN_MARGIN, bounds[:, :1]], axis=1)
    high = np.concatenate([corner + CELL + CROWN_MARGIN, bounds[:, 1:]], axis=1)
    return inside_frustum(planes, low, high)


def cells_near(x: float, y: float, distance: float) -> list[CellKey]:
    """Return the cells within a distance (m) of a position, nearest first."""
    return [(col, row) for col, row in cells_within((x, y), distance, CELL).tolist()]


def vanish_distance(rank: Float32Array, draw_distance: float) -> Float64Array:
    """Return the distances (m) at which plants vanish; the last ones at the draw distance."""
    return np.asarray(draw_distance * (FADE + (1.0 - FADE) * rank), dtype=np.float64)


def join_cells(
    cells: Sequence[Cell], origin: Float64Array, counts: Sequence[int] | None = None
) -> PlantInstances:
    """Concatenate the first `counts` (default: all) plants of cells, relative to `origin` (m)."""
    if not cells:
        empty = np.zeros(0, np.float32)
        return PlantInstances(np.zeros((0, 8), np.float32), empty, empty, empty, np.zeros(0, np.uint8))
    if counts is None:
        counts = [len(cell.instances.kind) for cell in cells]
    parts = [[column[:count] for column in cell.instances] for cell, count in zip(cells, counts, strict=True)]
    joined = PlantInstances(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    offsets = np.array([cell.corner - origin for cell in cells], np.float32)
    joined.rows[:, :2] += np.repeat(offsets, counts, axis=0)
    return joined
