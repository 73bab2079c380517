"""Unpainted ground: an unbounded raster of drained relief, mesh cell by mesh cell.

Node (i, j) of level k stands (i, j) · r0 · 2^k m east and north of the sketch's south-west corner, with r0 =
extent / 256. Each cell of the `mesh` is drained alone, its border at the heights of the mesh's edges, so a
node's value depends on the settings alone: on no window, no neighbour and no order. From level 4 on, nodes
follow the mesh, then a smooth mean of the ground.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, partial
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import binary_erosion

from sketchterrain.array_types import BoolArray, Float32Array, Float64Array, Int64Array
from sketchterrain.caching import LRUCache
from sketchterrain.host.library import host_function
from sketchterrain.landforms import mesh as meshes
from sketchterrain.landforms import mesh_nodes, mesh_vertices, relief_fields, wetness
from sketchterrain.landforms.drainage import BARE_ROUNDS, FIRST_ROUNDS, FIRST_UPLIFT
from sketchterrain.landforms.mesh import SIDE, SITE_BITS, MeshTable
from sketchterrain.landforms.mesh_nodes import CellNodes
from sketchterrain.landforms.relief_fields import UnpaintedSettings

_Block = tuple[Float64Array, Int64Array, Int64Array, Float64Array]
Site = tuple[int, int]  # column and row of a site of the mesh

LEVELS = 4
"""Levels that are drained: 0 … 3; the next two follow the mesh's crests and valleys, others a smooth mean."""
_MESH_LEVELS = 6
_CREST = 1.2  # height of a cell's crest above its lowest vertex, over the relief

_SLOPE_CAP = 0.25  # of tributary valleys between mesh vertices
_FALL = 0.13  # of a trunk valley along L, over the ground's relief
_PASS_RISE, _PASS_LOW_RISE = 1.0, 1.8  # of passes, over the relief: see `PassRule`
_PASS_SLOPE = 1.2  # … and over the slope of hillslopes
_HEAD = 2.7  # (drainage area where channels begin, over r0²)^(3/8); slopes above are straight
_TALUS = 1.5  # greatest slope below passes, over that of hillslopes
_MOST_THREADS = 4
_MAX_WINDOW_BYTES = 1 << 24  # of windows that were read
_GROUP = 8  # cells along the side of a group that is drained together


class Nodes(NamedTuple):
    """A window of nodes, (rows, columns): heights (m), rock (0 … 1), drainage areas (m²), wetness (0 … 1)."""

    height: Float64Array
    rock: Float32Array
    area: Float32Array
    wetness: Float32Array


class UpliftNodes(NamedTuple):
    """What raises the ground at a window of nodes: uplift, greatest slope, and how much is rock (0 … 1)."""

    uplift: Float64Array
    repose: Float64Array
    rock: Float32Array


@dataclass(frozen=True, eq=False)
class PaintedRegion:
    """Nodes of a level that belong to the cells which overlap the sketch, drained as one raster.

    Its size depends on the extent and the seed only. Rows run northward from node (column, row).
    """

    column: int
    row: int
    inside: BoolArray
    border: Float64Array  # heights (m) of nodes with an 8-neighbour outside, NaN elsewhere


class _Cell(NamedTuple):
    """A drained cell at one level: its rectangle of nodes, NaN outside of the cell."""

    column: int
    row: int
    levels: int  # that have been drained up to this one
    drained: Float64Array  # heights (m), from which the next finer level starts
    height: Float64Array  # (m) with talus
    area: Float32Array
    wetness: Float32Array


_NOTHING = _Cell(0, 0, 0, *np.empty((2, 0, 0)), *np.empty((2, 0, 0), np.float32))


class UnpaintedGround:
    """Windows of the raster of unpainted ground, with a bounded cache of drained cells; thread-safe."""

    def __init__(
        self, settings: UnpaintedSettings, *, max_bytes: int = 1 << 27, executor: Executor | None = None
    ) -> None:
        self.settings = settings
        self.mesh = meshes.mesh_parameters(settings.seed, _FALL * settings.ground_relief)
        self.fields = relief_fields.uplift_fields(settings)
        slope = _PASS_SLOPE * self.fields.per_relief / _HEAD
        length = settings.spacing * 2**SITE_BITS
        self._passes = meshes.PassRule(_PASS_RISE, _PASS_LOW_RISE, slope, length)
        self._cells = LRUCache(max_bytes=max_bytes)
        self._blocks = LRUCache(64)
        self._windows = LRUCache(max_bytes=_MAX_WINDOW_BYTES)
        self._executor = executor

    def window(
        self, level: int, column: int, row: int, rows: int, columns: int, *, painted: bool = True
    ) -> Nodes:
        """Return a window of nodes of a level; (column, row) is its south-western node.

        Unless `painted`, nodes of the painted region are left out: their heights are NaN.
        """
        at = level, column, row, rows, columns
        if level >= LEVELS:
            return self._windows.get_or_compute(at, partial(self._coarse_window, *at))
        return self._windows.get_or_compute((*at, painted), partial(self._drained_window, *at, painted))

    def prepare(
        self, level: int, corners: Int64Array, rows: int, columns: int, *, painted: bool = True
    ) -> None:
        """Drain at once what windows of a size need, by their south-western nodes (n, 2)."""
        if level < LEVELS:
            windows = ((level, column, row, rows, columns) for column, row in corners.tolist())
            sites = (self._sites(*at, painted) for at in windows)
            self._drained(level, list(dict.fromkeys(chain.from_iterable(sites))))

    def _sites(self, level: int, column: int, row: int, rows: int, columns: int, painted: bool) -> list[Site]:
        """Return the sites of the cells that may have nodes in a window."""
        table = self._table_of_nodes(level, column, row, rows, columns)
        west, south, east, north = np.moveaxis(self._bounds(level, table)[1:, 1:], -1, 0)
        near = (west < column + columns) & (south < row + rows) & (east >= column) & (north >= row)
        sites = [(table.column + 1 + i, table.row + 1 + j) for j, i in np.argwhere(near).tolist()]
        return sites if painted else [site for site in sites if site not in self.painted_sites]

    def _drained_window(
        self, level: int, column: int, row: int, rows: int, columns: int, painted: bool
    ) -> Nodes:
        """Return a window of nodes of a level that is drained, with those of the painted region or not."""
        sites = self._sites(level, column, row, rows, columns, painted)
        height = np.full((rows, columns), np.nan)
        area, wet = np.zeros((2, rows, columns), np.float32)
        for cell in self._drained(level, sites).values():
            part = cell.height, cell.area, cell.wetness, cell.row - row, cell.column - column
            host_function("paste_cell")(*part, height, area, wet)
        _, share = relief_fields.relief_raster(self.fields, level, column, row, rows, columns)
        return Nodes(height, share.astype(np.float32), area, wet)

    def _bounds(self, level: int, table: MeshTable) -> Int64Array:
        """Return the first and last nodes (west, south, east, north) that cells of inner sites may have."""
        side = 1 << (SITE_BITS - level)
        at = np.empty((*table.diagonal.shape, 4))
        host_function("cell_bounds")(table, at)
        corner = side * np.array([table.column, table.row])
        first, last = corner + np.floor(side * at[..., :2]), corner + np.ceil(side * at[..., 2:])
        return np.concatenate([first, last], axis=-1).astype(np.int64)

    def _coarse_window(self, level: int, column: int, row: int, rows: int, columns: int) -> Nodes:
        """Return a window of nodes of a level that is not drained."""
        at = level, column, row, rows, columns
        area = np.full((rows, columns), (self.settings.spacing * 2.0**level) ** 2, np.float32)
        height, share = np.empty((rows, columns)), np.empty((rows, columns))
        if level >= _MESH_LEVELS:
            host_function("mean_ground")(self.mesh, self.fields, level, column, row, height, share)
        else:
            table = self._table_of_nodes(*at)
            places = mesh_nodes.owners(self.mesh, table, *at)
            host_function("mesh_heights")(table, self._passes, _CREST, *places, height)
            _, share = relief_fields.relief_raster(self.fields, *at)
        rock = share.astype(np.float32)
        return Nodes(height, rock, area, wetness.mean_wetness(rock))

    def _table_of_nodes(self, *window: int) -> MeshTable:
        """Return sites and vertices around a window of nodes, from all threads; not to be called on one."""
        quads = mesh_nodes.quads_of_nodes(*window)
        missing = [at for at in _blocks_of(*quads) if at not in self._blocks]
        if self._executor is not None and len(missing) > 1:
            list(self._executor.map(self._cached_block, missing))
        return self.table(*quads)

    def table(self, column: int, row: int, rows: int, columns: int) -> MeshTable:
        """Return sites and vertices of a rectangle of quads."""
        x, y, diagonal = meshes.lattice_sites(self.mesh, column, row, rows, columns)
        height, relief = np.empty((2, rows, columns, 2))
        receiver, upstream = np.empty((2, rows, columns, 2), np.int64)
        size = mesh_vertices.BLOCK
        for at in _blocks_of(column, row, rows, columns):
            block = self._cached_block(at)
            first_column, first_row = _first_quad(at)
            south, west = max(first_row, row), max(first_column, column)
            north, east = min(first_row + size, row + rows), min(first_column + size, column + columns)
            into = np.s_[south - row : north - row, west - column : east - column]
            out = np.s_[south - first_row : north - first_row, west - first_column : east - first_column]
            for target, source in zip((height, receiver, upstream, relief), block, strict=True):
                target[into] = source[out]
        sites = relief_fields.site_relief(self.fields, column, row, x, y)
        low = meshes.lowest_around_sites(diagonal, height)
        return MeshTable(column, row, x, y, diagonal, height, receiver, upstream, relief, sites, low)

    def _cached_block(self, at: tuple[int, int]) -> _Block:
        return self._blocks.get_or_compute(at, partial(self._block, at))

    def _block(self, at: tuple[int, int]) -> _Block:
        """Return heights, receivers, numbers upstream and relief of the vertices of a block."""
        size, margin = mesh_vertices.BLOCK, mesh_vertices.MARGIN
        column, row = _first_quad(at)
        first = column - margin, row - margin
        count = size + 2 * margin
        x, y, diagonal = meshes.lattice_sites(self.mesh, *first, count, count)
        centre, probe = mesh_vertices.vertices(*first, x, y, diagonal)
        plain = relief_fields.uplift_fields(self.settings.painted)  # ranges beyond the sketch come last
        relief, _, _ = relief_fields.relief_at(plain, centre)
        level, course = mesh_vertices.receivers(self.mesh, diagonal, probe, relief)
        metres = self.settings.spacing / SIDE
        slopes = self.mesh.fall, self.fields.per_relief, _SLOPE_CAP, metres
        height, upstream = mesh_vertices.vertex_heights(diagonal, centre, level, course, relief, slopes)
        # Captures reach less far than what drains through a vertex.
        reach = mesh_vertices.CAPTURES + 1
        start = margin - reach
        near, sites = (slice(start, margin + size + reach + more) for more in (0, 1))
        at_sites = first[0] + start, first[1] + start, x[sites, sites].copy(), y[sites, sites].copy()
        at_vertices = diagonal[near, near].copy(), centre[near, near].copy()
        low, receiver = mesh_vertices.captured(
            *at_vertices,
            height[near, near].copy(),
            relief[near, near].copy(),
            relief_fields.site_relief(plain, *at_sites),
            slopes,
        )
        core, inner = slice(margin, margin + size), slice(reach, reach + size)
        if self.settings.surroundings > 0.0:
            relief[near, near], _, rise = relief_fields.relief_at(self.fields, at_vertices[1])
            low, receiver = mesh_vertices.raised(*at_vertices, low, receiver, rise, metres)
        return (
            low[inner, inner].copy(),
            receiver[inner, inner].copy(),
            upstream[core, core].copy(),
            relief[core, core].copy(),
        )

    def _drained(self, level: int, sites: list[Site]) -> dict[Site, _Cell]:
        """Return the cells of sites at a level."""
        result = {site: self._cells.get((level, *site)) for site in sites}
        groups: dict[Site, list[Site]] = {}
        for site in sites:
            if result[site] is None:
                groups.setdefault((site[0] // _GROUP, site[1] // _GROUP), []).append(site)
        run = map if self._executor is None or len(groups) == 1 else self._executor.map
        largest_first = sorted(groups.values(), key=len, reverse=True)  # threads end at about the same time
        for cells in run(partial(self._drain_group, level), largest_first):
            result |= cells
        return result

    def _drain_group(self, level: int, sites: list[Site]) -> dict[Site, _Cell]:
        """Drain cells of neighbouring sites, each from its next coarser level, and cache them."""
        coarser: dict[Site, Any] = {}
        if level < LEVELS - 1:
            coarser = {site: self._cells.get((level + 1, *site)) for site in sites}
            missing = [site for site in sites if coarser[site] is None]
            coarser |= self._drain_group(level + 1, missing) if missing else {}
        nodes, starts = self._cells_of(level, sites), [coarser.get(site, _NOTHING) for site in sites]
        sides = nodes.boxes[:, 2:] - nodes.boxes[:, :2]
        ends, room = np.cumsum(sides.prod(axis=1)).tolist(), 19 * int((sides + 2).prod(axis=1).max())
        before = np.concatenate([start.drained.ravel() for start in starts])
        places = np.array([(*start.drained.shape, start.row, start.column) for start in starts])
        given = nodes, before, places, self.settings.spacing
        rounds = np.array([BARE_ROUNDS[start.levels] for start in starts]), FIRST_ROUNDS, FIRST_UPLIFT
        found = *np.empty((2, ends[-1])), *np.empty((2, ends[-1]), np.float32)
        host_function("drain_cells")(*given, *rounds, _TALUS, *found, np.empty(room))
        result = {}
        for site, start, end, box in zip(sites, starts, ends, nodes.boxes.tolist(), strict=True):
            cell, shape = _NOTHING, (box[2] - box[0], box[3] - box[1])
            if any(box):
                part = slice(end - shape[0] * shape[1], end)
                drained, *fields = (each[part].reshape(shape) for each in found)
                fields.insert(0, drained if level else drained[:0])  # there is no finer one
                place = nodes.column + box[1], nodes.row + box[0], start.levels + 1
                cell = _Cell(*place, *(each.copy() for each in fields))
            result[site] = self._cells.store((level, *site), cell)
        return result

    def _cells_of(self, level: int, sites: Sequence[Site]) -> CellNodes:
        """Return the rasters around cells of neighbouring sites, from which these are drained."""
        columns, rows = [site[0] for site in sites], [site[1] for site in sites]
        west, south, east, north = min(columns), min(rows), max(columns), max(rows)
        table = self.table(west - 5, south - 5, north - south + 10, east - west + 10)
        at = tuple(np.transpose([(j - table.row, i - table.column) for i, j in sites]))
        bounds = self._bounds(level, table)[at]
        column, row = (bounds[:, :2].min(axis=0) - 1).tolist()
        shape = int(bounds[:, 3].max()) + 2 - row, int(bounds[:, 2].max()) + 2 - column
        place, third, _ = mesh_nodes.owners(self.mesh, table, level, column, row, *shape)
        # a node's cell as its place in the list of sites, −1 for others
        number = np.full(table.site_x.shape, -1, np.int32)
        number[at] = np.arange(len(sites))
        owner, boxes = np.empty(shape, np.int32), np.empty((len(sites), 4), np.int64)
        base, inflow = np.empty((2, *shape))
        given = table, self._passes, place, third, number
        host_function("cell_borders")(*given, owner, base, inflow, boxes)
        fields = self.uplift(level, column, row, *shape)
        return CellNodes(level, column, row, owner, base, fields.uplift, fields.repose, inflow, boxes)

    def uplift(self, level: int, column: int, row: int, rows: int, columns: int) -> UpliftNodes:
        """Return what raises unpainted ground at nodes of a level."""
        fields = self.fields
        relief, rock = relief_fields.relief_raster(fields, level, column, row, rows, columns)
        uplift = np.empty(relief.shape)
        host_function("roughened_uplift")(fields, level, column, row, relief, uplift, np.empty(columns))
        return UpliftNodes(uplift, uplift / (_HEAD + uplift), rock.astype(np.float32))

    @cached_property
    def painted_sites(self) -> tuple[Site, ...]:
        """Sites of the cells that overlap the sketch's square, in ascending order: the painted region."""
        table = self.table(-3, -3, 10, 10)
        side = 256
        place, _, _ = mesh_nodes.owners(self.mesh, table, 0, 0, 0, side + 1, side + 1)
        stride = table.site_x.shape[1]
        owner = np.unique(mesh_nodes.owner_index(place, stride))
        return tuple(sorted((table.column + int(k) % stride, table.row + int(k) // stride) for k in owner))

    def painted_region(self, level: int) -> PaintedRegion:
        """Return the nodes of a level that belong to the painted region, and the heights of its border."""
        cells = self._cells_of(level, self.painted_sites)
        inside = cells.owner >= 0
        outlets = np.where(inside & ~binary_erosion(inside, np.ones((3, 3), np.bool_)), cells.base, np.nan)
        rows, columns = np.flatnonzero(inside.any(axis=1)), np.flatnonzero(inside.any(axis=0))
        box = np.s_[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        return PaintedRegion(
            cells.column + int(columns[0]), cells.row + int(rows[0]), inside[box].copy(), outlets[box].copy()
        )


def _blocks_of(column: int, row: int, rows: int, columns: int) -> list[tuple[int, int]]:
    """Return columns and rows of the blocks of vertices in a rectangle of quads."""
    (west, south), (east, north) = (
        [(quad + mesh_vertices.BLOCK // 2) // mesh_vertices.BLOCK for quad in corner]
        for corner in ((column, row), (column + columns - 1, row + rows - 1))
    )
    return [(p, q) for q in range(south, north + 1) for p in range(west, east + 1)]


def _first_quad(block: tuple[int, int]) -> tuple[int, int]:
    """Return column and row of the first quad of a block, by its column and row."""
    column, row = (number * mesh_vertices.BLOCK - mesh_vertices.BLOCK // 2 for number in block)
    return column, row


@cache
def _threads() -> Executor:
    """Return the threads that drain cells; compiled code does not hold Python's lock."""
    return ThreadPoolExecutor(min(_MOST_THREADS, os.cpu_count() or 1), thread_name_prefix="drainage")


@lru_cache(maxsize=4)
def unpainted_ground(settings: UnpaintedSettings) -> UnpaintedGround:
    """Return the ground of some settings, with its cache."""
    return UnpaintedGround(settings, executor=_threads())
