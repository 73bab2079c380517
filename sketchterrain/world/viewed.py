"""Stored worlds as terrains for the renderer, and pictures of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import replace
from functools import cache, cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Bounds
from sketchterrain.compute.context import ComputeContext
from sketchterrain.document.drapes import DrapedLayer
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.export.files import prepare_folder
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.lattice import LATTICE_BITS, QUADS, finest_level
from sketchterrain.io.console import Stages
from sketchterrain.jobs.export import DeviceFallback, build_terrain
from sketchterrain.jobs.pictures import PictureOptions, check_picture, draw_picture, sketch_weather
from sketchterrain.landforms.placement.feature_types import FEATURE, Lake, River, ShapeField
from sketchterrain.landforms.placement.plateaus import Plateau
from sketchterrain.render.overlays import LegendEntry
from sketchterrain.schema.materials import BEDROCK, BUILT_IN, MaterialTable, weight_words
from sketchterrain.terrain.surfaces import FACTS, TerrainFeatures, VertexMemory, VertexStore, vertex_dtype
from sketchterrain.terrain.vertex_writer import geometric_error
from sketchterrain.tiles.quadtree import code_of, intersects_bounds
from sketchterrain.vegetation.graded_poisson import run_to_completion
from sketchterrain.vegetation.plants import PLANT
from sketchterrain.world.grid import CHUNK, LAYER_SPECS, GridLevel, layer_specs
from sketchterrain.world.stored_world import StoredWorld, at_corner, draped_sketch, open_world

_LEAST_BITS: Final = 8
_MOST_BITS: Final = LATTICE_BITS - 1
"""Exponents of the least and most cells along the longer side of a viewed world."""
_UNIT: Final = np.float32(32767)  # a unit normal's component, as a slope
_HALF_STEP: Final = np.float32(1.0 / 255)  # accuracy of a stored normal's components
_Array = npt.NDArray[Any]
_Area = TypeVar("_Area", Lake, Plateau)
_Floats = npt.NDArray[np.float32]
_Doubles = npt.NDArray[np.float64]


class StoredPyramid:
    """Windows of a stored world's levels, extended beyond its edges, and subsampled for coarser levels.

    With `on_error`, unreadable parts are reported to it once, and replaced by the next coarser level.
    """

    def __init__(
        self,
        world: StoredWorld,
        table: MaterialTable = BUILT_IN,
        *,
        on_error: Callable[[str], None] | None = None,
    ) -> None:
        self.world, self._table, self._on_error = world, table, on_error
        self._lines: set[str] = set()
        unknown = [name for name in world.material_names if name not in table.names]
        if "materials" in world.layers and unknown:
            raise InputError(f"expected materials among {', '.join(table.names)}, got {', '.join(unknown)}")

    def level(self, number: int) -> GridLevel:
        """Return a level, which may be coarser than the stored ones."""
        levels = self.world.levels
        if number < len(levels):
            return levels[number]
        last, step = levels[-1], 1 << (number - len(levels) + 1)
        columns, rows = (-(-(side - 1) // step) + 1 for side in (last.columns, last.rows))
        return GridLevel(number, last.cell * step, columns, rows)

    def window(self, layer: str, number: int, *, top: int, left: int, rows: int, columns: int) -> _Array:
        """Return a window of a layer that may extend beyond the level; see `StoredWorld.read`."""
        grid = self.world.levels[min(number, len(self.world.levels) - 1)]
        step = 1 << (number - grid.number)
        down = np.clip(np.arange(top, top + rows) * step, 0, grid.rows - 1)
        across = np.clip(np.arange(left, left + columns) * step, 0, grid.columns - 1)
        north, south, west, east = int(down[0]), int(down[-1]), int(across[0]), int(across[-1])
        found = self._read(layer, grid.number, north, west, south - north + 1, east - west + 1)
        if step == 1 and found.shape[-2:] == (rows, columns):
            return found
        return np.asarray(found[..., (down - north)[:, None], (across - west)[None, :]])

    def _read(self, layer: str, number: int, top: int, left: int, rows: int, columns: int) -> _Array:
        """Read a window inside the level, with coarser data in place of unreadable parts."""
        if self._on_error is None:
            return self.world.read(layer, number, top=top, left=left, rows=rows, columns=columns)
        found = self._empty(layer, rows, columns)
        # By chunks, so that a vertex has the same value in every window: no cracks.
        for low, high in _chunk_parts(top, top + rows):
            for west, east in _chunk_parts(left, left + columns):
                part = self._part(layer, number, low, west, high - low, east - west)
                found[..., low - top : high - top, west - left : east - left] = part
        return found

    def _part(self, layer: str, number: int, top: int, left: int, rows: int, columns: int) -> _Array:
        try:
            return self.world.read(layer, number, top=top, left=left, rows=rows, columns=columns)
        except InputError as error:
            line = str(error)
            if self._on_error is not None and line not in self._lines:
                self._lines.add(line)
                self._on_error(line)
        if number + 1 >= len(self.world.levels):
            return self._empty(layer, rows, columns)
        north, west = top // 2, left // 2
        size = (top + rows) // 2 - north + 1, (left + columns) // 2 - west + 1
        above = self._read(layer, number + 1, north, west, *size).astype(np.float32)
        down, across = np.arange(top, top + rows), np.arange(left, left + columns)
        low, first = (down // 2 - north)[:, None], across // 2 - west
        middle = 0.5 * (above[..., low, first] + above[..., low + (down & 1)[:, None], first + (across & 1)])
        return middle.astype(LAYER_SPECS[layer].dtype)

    def _empty(self, layer: str, rows: int, columns: int) -> _Array:
        spec = layer_specs(self.world.material_names)[layer]
        return np.zeros(spec.shape(rows, columns), spec.dtype)

    def heights(self, x: npt.ArrayLike, y: npt.ArrayLike, *, cell_size: float = 0.0) -> _Floats:
        """Return heights (m) at positions (m east and north) from the north-west corner.

        The coarsest level up to `cell_size` (m) is read. Heights beyond the edges are at most the world's 5 %
        quantile, so that they cast no shadows.
        """
        levels = self.world.levels
        finer = int(np.floor(np.log2(max(cell_size, levels[0].cell) / levels[0].cell) + 1e-9))
        level = levels[min(finer, len(levels) - 1)]
        east, south = np.broadcast_arrays(np.asarray(x, np.float64), -np.asarray(y, np.float64))
        finest = levels[0]
        inside_x = np.clip(east, 0.0, (finest.columns - 1) * finest.cell)
        inside_y = np.clip(south, 0.0, (finest.rows - 1) * finest.cell)
        column, row = inside_x.ravel() / level.cell, inside_y.ravel() / level.cell
        # Chunk by chunk, as positions may be far apart.
        chunk = (row // CHUNK).astype(np.int64) * (1 << 32) + (column // CHUNK).astype(np.int64)
        order = np.argsort(chunk, kind="stable")
        flat = np.empty(column.size)
        for some in np.split(order, np.flatnonzero(np.diff(chunk[order])) + 1) if column.size else ():
            flat[some] = self._bilinear(level.number, column[some], row[some])
        found = flat.reshape(east.shape)
        outside = (inside_x != east) | (inside_y != south)
        if outside.any():
            found[outside] = np.minimum(found[outside], self._low)
        return found.astype(np.float32)

    @cached_property
    def _low(self) -> float:
        last = self.world.levels[-1]
        whole = self._read("height", last.number, 0, 0, last.rows, last.columns)
        return float(np.percentile(whole, 5))

    def _bilinear(self, number: int, column: _Doubles, row: _Doubles) -> _Doubles:
        i, j = column.astype(np.int64), row.astype(np.int64)
        left, top = int(i.min()), int(j.min())
        size = {"rows": int(j.max()) - top + 2, "columns": int(i.max()) - left + 2}
        h = self.window("height", number, top=top, left=left, **size).astype(np.float64)
        u, v = column - i, row - j
        i, j = i - left, j - top
        north = h[j, i] * (1 - u) + h[j, i + 1] * u
        south = h[j + 1, i] * (1 - u) + h[j + 1, i + 1] * u
        return np.asarray(north * (1 - v) + south * v)

    def tile(
        self, number: int, column: int, row: int, *, quads: int, root: bool
    ) -> tuple[npt.NDArray[np.void], tuple[float, float, float]]:
        """Return a tile's vertices, and its lowest and highest height and its geometric error (m).

        A tile in column c and row −1 − r, rows northward, starts at the level's vertex (r·quads, c·quads).
        Parent values are interpolated along edges and north-west diagonals as in kernels/vertices.clh.
        """
        top, left = -(row + 1) * quads, column * quads
        own = self._samples(number, top, left, quads + 1)
        parent = own
        if not root:
            parent = _refined(self._samples(number + 1, top // 2, left // 2, quads // 2 + 1))
        tile = np.empty((quads + 1, quads + 1), vertex_dtype(len(self._table)))
        tile["height"], tile["slope"], tile["weights"] = own
        tile["parent_height"], tile["parent_slope"], tile["parent_weights"] = parent
        low = min(float(own.height.min()), float(parent.height.min()))
        high = max(float(own.height.max()), float(parent.height.max()))
        return tile, (low, high, self._error(number, top, left, own.height))

    def _samples(self, number: int, top: int, left: int, side: int) -> _Samples:
        height = self.window("height", number, top=top - 1, left=left - 1, rows=side + 2, columns=side + 2)
        level = self.level(number)
        cell = np.float32(level.cell)
        dx = (height[1:-1, 2:] - height[1:-1, :-2]) / (cell * _apart(left, side, level.columns))
        dy = (height[:-2, 1:-1] - height[2:, 1:-1]) / (cell * _apart(top, side, level.rows))[:, None]
        length = 1.0 / np.sqrt(1.0 + (dx * dx + dy * dy))
        normal = np.stack([-dx * length, -dy * length], axis=-1)
        inside = {"top": top, "left": left, "rows": side, "columns": side}
        if "normal" in self.world.layers:
            # Heights are more precise than 8-bit normals, except if rounded.
            coded = self.window("normal", number, **inside)[:2].transpose(1, 2, 0)
            stored = coded * np.float32(1 / 127.5) - 1
            normal = np.clip(normal, stored - _HALF_STEP, stored + _HALF_STEP)
        slope = np.rint(np.clip(normal, -1, 1) * _UNIT).astype(np.int16)
        weights = np.zeros((side, side, 4 * weight_words(len(self._table))), np.uint8)
        if "materials" in self.world.layers:
            bands = [self._table.names.index(name) for name in self.world.material_names]
            weights[..., bands] = self.window("materials", number, **inside).transpose(1, 2, 0)
        else:
            weights[..., self._table.names.index(BEDROCK)] = 255
        return _Samples(np.ascontiguousarray(height[1:-1, 1:-1]), slope, weights)

    def _error(self, number: int, top: int, left: int, height: _Floats) -> float:
        """Return the geometric error δ of a tile (m) from the next finer level."""
        if number == 0:
            return 0.0
        side = 2 * len(height) - 3
        finer = self.window("height", number - 1, top=2 * top + 1, left=2 * left + 1, rows=side, columns=side)
        apart = np.abs(finer[::2, ::2] - 0.5 * (height[:-1, :-1] + height[1:, 1:]))
        grid = self.level(number - 1)
        inside = apart[: max((grid.rows - 2 * top) // 2, 0), : max((grid.columns - 2 * left) // 2, 0)]
        if not inside.size:
            return 0.0
        # Differences halve from level to level on typical terrain: their sum is at most twice the first one.
        return 2.0 * (1.0 - 0.5**number) * float(geometric_error(inside.reshape(1, -1))[0])


class _Samples(NamedTuple):
    """Layers of a level at a tile's vertices."""

    height: _Floats
    slope: npt.NDArray[np.int16]
    weights: npt.NDArray[np.uint8]


def _chunk_parts(first: int, last: int) -> Iterator[tuple[int, int]]:
    for start in range(first // CHUNK * CHUNK, last, CHUNK):
        yield max(start, first), min(start + CHUNK, last)


def _apart(first: int, count: int, whole: int) -> _Floats:
    """Return the distance in cells between the neighbours of each vertex, at least 1."""
    at = np.arange(first - 1, first + count + 1).clip(0, whole - 1)
    return np.asarray(np.maximum(at[2:] - at[:-2], 1), np.float32)


def _refined(parent: _Samples) -> _Samples:
    first, second = _ends(2 * len(parent.height) - 1)

    def mean(values: _Array) -> _Array:
        total = values[first].astype(np.int32) + values[second].astype(np.int32) + 1
        return np.asarray((total >> 1).astype(values.dtype))

    height: _Floats = np.float32(0.5) * (parent.height[first] + parent.height[second])
    return _Samples(height, mean(parent.slope), mean(parent.weights))


@cache
def _ends(side: int) -> tuple[tuple[npt.NDArray[np.intp], ...], tuple[npt.NDArray[np.intp], ...]]:
    """Return rows and columns of the two parent vertices whose mean is each vertex of a tile."""
    row, column = np.indices((side, side))
    return (row >> 1, column >> 1), ((row >> 1) + (row & 1), (column >> 1) + (column & 1))


class StoredTerrain:
    """A stored world as a bounded `~sketchterrain.render.scene.Terrain`.

    Viewing coordinates are m east and north of its north-west `corner`. A level-0 tile spans 2ⁿ cells, so
    vertices of tiles are stored samples. `terrain` is that of the world's sketch (None: no plants and water).
    `missing_parts` describes what is not stored. See `StoredPyramid` for `on_error`.
    """

    def __init__(
        self,
        world: StoredWorld,
        context: ComputeContext,
        terrain: Terrain | None = None,
        *,
        on_error: Callable[[str], None] | None = None,
    ) -> None:
        self.corner = world.west, world.north
        self.sketch = Sketch() if terrain is None else at_corner(terrain.sketch, self.corner)
        self._pyramid = StoredPyramid(world, self.sketch.material_table, on_error=on_error)
        self._terrain, self.context = terrain, context
        finest = world.levels[0]
        across, down = finest.columns - 1, finest.rows - 1
        self._bits = max(math.ceil(math.log2(max(across, down, 1))), _LEAST_BITS)
        if self._bits > _MOST_BITS:
            most = 1 << _MOST_BITS
            raise InputError(f"expected a world of at most {most} cells a side, got {across}×{down}")
        self.finest_cell = finest.cell
        self.extent = finest.cell * 2.0**self._bits
        self.size = across * finest.cell, down * finest.cell
        self.bounds: Bounds = (0.0, -self.size[1], self.size[0], 0.0)
        self.features = TerrainFeatures(np.zeros(0, FEATURE), ())
        self.sea_level = None if terrain is None else terrain.sea_level
        if terrain is not None:
            self.features = _moved_features(terrain.features, *self.corner, self.bounds)
        self.heights = self._pyramid.heights
        missing_parts = {
            "the world holds no normals: they are computed from its heights": "normal" not in world.layers,
            f"the world holds no materials: it is shown as {BEDROCK}": "materials" not in world.layers,
            "the world holds no sketch: it is shown without plants and water": terrain is None,
        }
        self.missing_parts = [line for line, true in missing_parts.items() if true]

    def vertex_store(
        self, slots: int, *, quads: int = QUADS, memory: VertexMemory | None = None
    ) -> VertexStore:
        """Return a store with slots for tiles, for `write_tiles`."""
        return VertexStore(self.context, slots, len(self.sketch.material_table), quads=quads, memory=memory)

    def write_tiles(
        self,
        keys: Sequence[tuple[int, int, int]],
        slots: npt.ArrayLike,
        parents: npt.ArrayLike,
        store: VertexStore,
    ) -> npt.NDArray[np.void]:
        """Write tiles inside the bounds to their slots; return their `FACTS`."""
        slot_numbers = np.asarray(slots, np.int64).reshape(-1)
        roots = np.asarray(parents, np.int64).reshape(-1) < 0
        facts = np.zeros(len(slot_numbers), FACTS)
        codes = np.array([code_of(*key) for key in keys], np.int64)
        coarsest = self._bits - LATTICE_BITS + finest_level(store.quads)
        tiles = []
        for i in np.flatnonzero(intersects_bounds(codes, self.extent, self.bounds)).tolist():
            level, column, row = keys[i]
            tile, facts[i] = self._pyramid.tile(
                coarsest - level, column, row, quads=store.quads, root=bool(roots[i])
            )
            tiles.append((int(slot_numbers[i]), tile))
        store.acquire()
        try:
            for slot, tile in tiles:
                store.write(slot, tile)
        finally:
            store.release(slot_numbers)
        return facts

    def foliage(self, west: float, south: float, east: float, north: float) -> npt.NDArray[np.void]:
        """Return the plants in a rectangle of viewing coordinates (m), at the stored heights."""
        return run_to_completion(self.foliage_steps(west, south, east, north))

    def foliage_steps(
        self, west: float, south: float, east: float, north: float
    ) -> Generator[None, None, npt.NDArray[np.void]]:
        """Return the same in steps of a few ms."""
        if self._terrain is None:
            return np.zeros(0, PLANT)
        x, y = self.corner
        found = yield from self._terrain.foliage_steps(west + x, south + y, east + x, north + y)
        plants = found.copy()
        plants["x"] -= x
        plants["y"] -= y
        plants = plants[_within(plants["x"], plants["y"], self.bounds)]
        if len(plants):
            plants["z"] = self.heights(plants["x"], plants["y"])
        return plants


def _moved_features(features: TerrainFeatures, west: float, north: float, bounds: Bounds) -> TerrainFeatures:
    """Return features relative to an origin, clipped to bounds relative to it (m)."""
    points = features.points.copy()
    points["x"] -= west
    points["y"] -= north
    radius = points["radius"]
    inside = (points["x"] + radius > bounds[0]) & (points["x"] - radius < bounds[2])
    inside &= (points["y"] + radius > bounds[1]) & (points["y"] - radius < bounds[3])
    rivers = [part for river in features.rivers for part in _river_parts(river, west, north, bounds)]
    lakes = [_cut_area(lake, west, north, bounds) for lake in features.lakes]
    return TerrainFeatures(
        points[inside],
        tuple(rivers),
        tuple(lake for lake in lakes if (lake.shape.inside > 0).any()),
        features.sea_level,
        tuple(_cut_area(plateau, west, north, bounds) for plateau in features.plateaus),
    )


def _river_parts(river: River, west: float, north: float, bounds: Bounds) -> Iterator[River]:
    line = river.centreline - np.array([west, north, 0.0])
    inside = _within(line[:, 0], line[:, 1], bounds)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(np.int8)))
    for first, last in zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        if last - first > 1:
            width = np.ascontiguousarray(river.centreline_width[first:last])
            yield replace(river, centreline=np.ascontiguousarray(line[first:last]), centreline_width=width)


def _cut_area(area: _Area, west: float, north: float, bounds: Bounds) -> _Area:
    field = area.shape
    rows, columns = field.inside.shape
    x = field.west - west + np.arange(columns) * field.spacing
    y = field.south - north + np.arange(rows) * field.spacing
    across, down = np.minimum(x - bounds[0], bounds[2] - x), np.minimum(y - bounds[1], bounds[3] - y)
    inside = np.minimum(field.inside, np.minimum(across[None, :], down[:, None])).astype(np.float32)
    return replace(area, shape=ShapeField(float(x[0]), float(y[0]), field.spacing, inside))


def _within(x: _Array, y: _Array, bounds: Bounds) -> npt.NDArray[np.bool_]:
    return np.asarray((x >= bounds[0]) & (y >= bounds[1]) & (x <= bounds[2]) & (y <= bounds[3]))


def draw_world(
    store: Path,
    path: Path,
    still: PictureOptions,
    drapes: Sequence[DrapedLayer] = (),
    *,
    device: str | None,
    stages: Stages,
) -> tuple[list[LegendEntry], list[str]]:
    """Render a picture of a stored world; return the legend and the parts that are not stored.

    Positions of `still` are m from the sketch's south-west corner; `drapes` come after the sketch's own.
    """
    check_picture(still)
    prepare_folder(path.parent)
    with stages.stage("world", "Opening the world"):
        stored = open_world(store)
        sketch = draped_sketch(stored, drapes)

    def work(context: ComputeContext, _: tuple[str, ...]) -> tuple[list[LegendEntry], list[str]]:
        plants = "points.cl", "graded_poisson.cl"
        terrain = None if sketch is None else build_terrain(sketch, context, stages, kernels=plants)
        world = StoredTerrain(stored, context, terrain)
        with stages.stage("picture", "Rendering"):
            (x, y), positions = world.corner, (still.eye, still.look_at)
            eye, look_at = (each and (each[0] - x, each[1] - y, each[2]) for each in positions)
            weather = sketch_weather(world.sketch, still.hour, still.sky, still.clouds)
            legend = draw_picture(path, world, replace(still, eye=eye, look_at=look_at), weather)
        return legend, world.missing_parts

    return DeviceFallback(device).run(work, stages=stages)
