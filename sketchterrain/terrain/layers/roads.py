"""Roads, railways and paths: pieces of their axes with profile and cross-section."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from itertools import groupby, pairwise
from typing import ClassVar, Final, NamedTuple

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array, LatticeArray, StructuredArray
from sketchterrain.geometry.box_index import ITEM, BoxIndex, content_items
from sketchterrain.geometry.lattice import metres_per_unit, to_lattice
from sketchterrain.io.resources import kernel_columns, kernel_constants
from sketchterrain.roads.road_types import GROUND, TUNNEL, Road, vertical_curve
from sketchterrain.terrain.centrelines import arc_boxes, nearest_on_arc, signed_square
from sketchterrain.terrain.layers.earthworks import Strips, coverage, with_strips
from sketchterrain.terrain.layers.layer import (
    ITEMS,
    Culled,
    DetailState,
    HostSamples,
    HostSite,
    Packed,
    Sampling,
    TerrainLayer,
    WorldSettings,
    smooth_rise,
)

_HEADER: Final = "layers/roads.clh"
ROAD: Final = kernel_columns(_HEADER, "RoadRow")
_WIDER, _CLEAR, _CELLS = kernel_constants(_HEADER, "ROAD_WIDER", "ROAD_CLEAR", "ROAD_CELLS")
_DEPTH = 24  # column of rows on the host
_PROFILE = slice(ROAD["road_from_height"], ROAD["road_to_rise"] + 1)
_TURN = 0.5  # sum of the tangents of quarters of angles (115°), from which on a chain may come near itself
_OVERLAP = 4.0  # length of two chains' overlap, in half widths
_IN_ITEM = 16  # pieces of an item
_DEPTH_FACTOR, _DEPTH_MARGIN = 2.0, 4.0  # of depths between samples of the ground: times, plus m
_LEAST_SHARE = 1.0 / 256.0


@dataclass(frozen=True, eq=False)
class PackedRoads:
    """Pieces of all chains (``Roads`` of ``kernels/layers/roads.clh``)."""

    unit: float  # m a lattice unit
    at: LatticeArray  # (n, 2) starts, lattice units
    chain: npt.NDArray[np.int32]  # (n,)
    row: Float64Array  # (n, 24) columns of `ROAD`
    depth: Float64Array  # (n,) m by which the ground changes at most

    def __getitem__(self, name: str) -> Float64Array:
        """Return a column of `ROAD`, shape (n,)."""
        return self.row[:, ROAD[name]]

    def ends(self, name: str) -> tuple[Float64Array, Float64Array]:
        """Return a column at the starts and at the ends of pieces, (n,) each."""
        return self[f"road_from_{name}"], self[f"road_to_{name}"]

    def along(self, name: str, piece: Int64Array, t: Float64Array) -> Float64Array:
        """Return a value at shares t of pieces, linear between their ends."""
        start, end = (column[piece] for column in self.ends(name))
        return np.asarray(start + (end - start) * t)

    @cached_property
    def boxes(self) -> LatticeArray:
        """Boxes (n, 4) that pieces affect, lattice units."""
        reach = np.maximum(np.maximum(*self.ends("reach")), np.maximum(*self.ends("half")) + _CLEAR)
        return arc_boxes(self.at, self.row[:, :2], self["road_bend"], reach, self.unit)

    @cached_property
    def index(self) -> BoxIndex:
        """Index of the boxes."""
        return BoxIndex(self.boxes)


@dataclass(frozen=True, eq=False)
class RoadsLayer(TerrainLayer):
    """Roads, railways and paths on the ground."""

    name: ClassVar[str] = "roads"

    materials: tuple[str, ...]  # names, in the order of their weights
    roads: tuple[Road, ...] = field(metadata=ITEMS)

    def rows(self, extent: float) -> PackedRoads:
        """Return the pieces of all roads on the ground, by chain."""
        return self.cache.get_or_compute(
            extent, lambda: _joined([_packed(*run, self.materials, extent) for run in self._runs], extent)
        )

    @cached_property
    def _runs(self) -> list[tuple[tuple[Road, ...], tuple[bool, bool]]]:
        """Successive roads on the ground, and whether they begin and end at tunnels."""
        runs = []
        for _, leg in groupby(self.roads, key=lambda road: road.leg):
            parts = list(leg)
            end = 0
            for is_ground, group in groupby(parts, key=lambda road: road.structure == GROUND):
                run = tuple(group)
                start, end = end, end + len(run)
                if is_ground:
                    beside = parts[max(start - 1, 0)], parts[min(end, len(parts) - 1)]
                    runs.append((run, (beside[0].structure == TUNNEL, beside[1].structure == TUNNEL)))
        return runs

    @cached_property
    def _widths(self) -> Float64Array:
        """Widths (m) of pieces, ascending: those below a cell are left out of it."""
        halves = [np.maximum(road.half_width[:-1], road.half_width[1:]) for road in self.roads]
        return np.unique(2.0 * np.concatenate([np.zeros(0), *halves]))

    def items(self, world: WorldSettings) -> StructuredArray:
        """Return runs of pieces by their contents."""
        parts = [_items(*run, self.materials, world.extent) for run in self._runs]
        return np.sort(np.concatenate([np.zeros(0, ITEM), *parts]), order=("id", "digest"))

    def pack_key(self, cell: float) -> float:
        """Return how many widths a cell does not show."""
        return float(np.searchsorted(self._widths, cell * _CELLS, side="right"))

    def pack(self, sampling: Sampling) -> Packed:
        """Return the pieces."""
        packed = self.rows(sampling.world.extent)
        arrays: dict[str, npt.NDArray[np.generic]] = {
            "road_at": packed.at,
            "road_chain": packed.chain,
            "road_row": packed.row,
        }
        visible = 2.0 * np.maximum(*packed.ends("half")) > _CELLS * sampling.cell
        return Packed(arrays, packed.boxes, "road", visible, packed)

    def omitted(self, state: DetailState, culled: Culled, sampling: Sampling) -> None:
        """Add the change by roads that fade out, and by strips that are wider at a coarser cell."""
        packed: PackedRoads = culled.details.details
        if not len(packed.at):
            return
        block, piece = packed.index.touching(state.blocks)
        if not len(block):
            return
        own = PackedRoads(
            packed.unit, packed.at[piece], packed.chain[piece], packed.row[piece], packed.depth[piece]
        )
        low, high = np.minimum(*own.ends("height")), np.maximum(*own.ends("height"))
        deep = np.maximum(np.maximum(high - state.low[block], state.high[block] - low), 0.0)
        deep = np.minimum(deep, _DEPTH_FACTOR * own.depth + _DEPTH_MARGIN)
        seen = smooth_rise(2.0 * np.minimum(*own.ends("half")) / sampling.cell, _CELLS, _CELLS)
        steep = np.maximum(own["road_cut"], own["road_fill"])
        # For each metre that a strip is wider, its embankment of slope s moves by s h(p) at a share p of
        # the width w within which it fades: h(p) = (1 + 7 p^8 - 8 p^9) / (1 - p^8)^2. Above the ground this
        # is at most max(1.6 s, 2.5 deep / w). A mean of two embankments moves by at most deep / w more.
        width = np.maximum(np.minimum(*own.ends("reach")) - np.maximum(*own.ends("whole")), 1.0)
        wider = np.minimum(_WIDER * sampling.cell, 0.5 * width)
        moved = wider * (1.6 * steep + 3.5 * deep / width)
        moved = (1.0 - seen) * deep + np.minimum(moved, deep + high - low)
        bound = np.zeros(len(state.blocks))
        np.maximum.at(bound, block, moved)
        state.bound += bound
        np.minimum.at(state.low, block, low)
        np.maximum.at(state.high, block, high)

    def heights(self, ground: HostSamples, site: HostSite) -> HostSamples:
        """Return the ground with roads."""
        packed = self.rows(site.sampling.world.extent)
        if not len(packed.at):
            return ground
        cell = site.sampling.cell
        feet = self._feet(packed, site)
        piece, t = feet.piece, feet.t
        away = np.sqrt(feet.square)
        lean = np.where(feet.left, packed.along("left", piece, t), packed.along("right", piece, t))
        half, whole, reach, share = (
            packed.along(name, piece, t) for name in ("half", "whole", "reach", "share")
        )
        start, end, first, last = packed.row[piece, _PROFILE].T
        seen = smooth_rise(2.0 * half / cell, _CELLS, _CELLS)
        wide = np.minimum(whole + _WIDER * cell, 0.5 * (whole + reach))
        strips = Strips(
            feet.point,
            vertical_curve(start, end, first, last, t) + lean * np.minimum(away, whole),
            np.maximum(away - wide, 0.0),
            reach - wide,
            packed["road_cut"][piece],
            packed["road_fill"][piece],
            feet.square / whole**2,
            share,
            seen,
            (seen > 0.0) & (share > _LEAST_SHARE),
            np.clip((whole + _CLEAR - away) / _CLEAR, 0.0, 1.0),
            coverage(half, away, cell),
        )
        return with_strips(ground, strips)

    def _feet(self, packed: PackedRoads, site: HostSite) -> _Feet:
        """Return the nearest point of each chain near each point, none beyond a tunnel's portal."""
        point, piece = packed.index.at_points(site.x, site.y)
        at = np.stack([site.x[point], site.y[point]], axis=1)
        chord, bend = packed.row[piece, :2], packed["road_bend"][piece]
        offset: Float64Array = np.asarray((at - packed.at[piece]) * packed.unit, np.float64)
        t, square = nearest_on_arc(chord, bend, offset)
        left = signed_square(chord, bend, offset) > 0.0
        feet = _Feet(point, piece, t, square, left)
        feet = feet.subset(square < packed.along("reach", piece, t) ** 2)
        key = feet.point * (int(packed.chain[-1]) + 1) + packed.chain[feet.piece]
        order = np.lexsort((np.arange(len(key)), feet.square, key))
        is_first = np.append(True, np.diff(key[order]) != 0)[: len(order)]
        feet = feet.subset(order[is_first])
        portals = packed["road_portals"][feet.piece].astype(np.int64)
        before, behind = (portals & 1 > 0) & (feet.t <= 0.0), (portals & 2 > 0) & (feet.t >= 1.0)
        return feet.subset(~(before | behind))


class _Feet(NamedTuple):
    """Points of chains nearest to points of the ground, (k,) each."""

    point: Int64Array
    piece: Int64Array
    t: Float64Array  # 0 … 1 along the piece
    square: Float64Array  # squared distance, m²
    left: BoolArray  # whether the point is to the left

    def subset(self, chosen: BoolArray | Int64Array) -> _Feet:
        """Return some of them."""
        return _Feet._make(each[chosen] for each in self)


_KEPT: Final = 1 << 11
"""Runs of roads whose pieces are kept: those that an edit does not change."""


@lru_cache(_KEPT)
def _packed(
    run: tuple[Road, ...], tunnels: tuple[bool, bool], materials: tuple[str, ...], extent: float
) -> PackedRoads:
    """Return the pieces of successive roads, by chain."""
    unit = metres_per_unit(extent)
    at, row = _run_rows(run, materials)
    row[0, ROAD["road_portals"]] += tunnels[0]
    row[-1, ROAD["road_portals"]] += 2 * tunnels[1]
    starts, rows, chains = [], [], []
    for number, (first, last, share) in enumerate(_chains(row, run)):
        own = row[first:last].copy()
        own[:, ROAD["road_from_share"]], own[:, ROAD["road_to_share"]] = share[:-1], share[1:]
        starts.append(at[first:last])
        rows.append(own)
        chains.append(np.full(last - first, number, np.int32))
    at, row = np.concatenate(starts), np.concatenate(rows)
    lattice = to_lattice(at, extent)
    end = to_lattice(at + row[:, :2], extent)
    row[:, :2] = (end - lattice) * unit
    length2 = (row[:, :2] ** 2).sum(axis=1)
    row[:, 2] = 1.0 / np.where(length2 > 0.0, length2, 1.0)
    whole = length2 > 0.0
    lattice, chain, row = lattice[whole], np.concatenate(chains)[whole], row[whole]
    return PackedRoads(unit, lattice, chain, row[:, :_DEPTH], row[:, _DEPTH])


def _joined(runs: Sequence[PackedRoads], extent: float) -> PackedRoads:
    """Return the pieces of many runs."""
    none = np.zeros((0, 2), np.int64), np.zeros(0, np.int32), np.zeros((0, _DEPTH)), np.zeros(0)
    parts, number = [none], 0
    for run in runs:
        parts.append((run.at, run.chain + np.int32(number), run.row, run.depth))
        number += int(run.chain.max(initial=-1)) + 1
    return PackedRoads(metres_per_unit(extent), *map(np.concatenate, zip(*parts, strict=True)))


@lru_cache(_KEPT)
def _items(
    run: tuple[Road, ...], tunnels: tuple[bool, bool], materials: tuple[str, ...], extent: float
) -> StructuredArray:
    """Return the pieces of successive roads as items, by their contents."""
    packed = _packed(run, tunnels, materials, extent)
    if not len(packed.at):
        return np.zeros(0, ITEM)
    boxes = packed.boxes
    breaks = np.flatnonzero(np.append(True, np.diff(packed.chain) != 0))
    first = np.concatenate(
        [np.arange(a, b, _IN_ITEM) for a, b in pairwise([*breaks.tolist(), len(packed.at)])]
    )
    ends = np.append(first[1:], len(packed.at))
    of_chains = np.isin(np.stack([first, ends], axis=1), np.append(breaks, len(packed.at)))
    contents = [
        (packed.at[a:b].tobytes(), packed.row[a:b].tobytes(), is_end.tobytes())
        for a, b, is_end in zip(first.tolist(), ends.tolist(), of_chains, strict=True)
    ]
    low, high = (
        reduce.reduceat(part, first)
        for reduce, part in ((np.minimum, boxes[:, :2]), (np.maximum, boxes[:, 2:]))
    )
    return content_items(contents, low, high)


def _run_rows(run: Sequence[Road], materials: tuple[str, ...]) -> tuple[Float64Array, Float64Array]:
    """Return starts (n, 2), m, and rows of the pieces of successive roads, with their depths."""
    pieces = [len(road.bend) for road in run]
    rows = np.zeros((sum(pieces), _DEPTH + 1))

    def both(name: str, values: Sequence[Float64Array]) -> None:
        rows[:, ROAD[f"road_from_{name}"]] = np.concatenate([each[:-1] for each in values])
        rows[:, ROAD[f"road_to_{name}"]] = np.concatenate([each[1:] for each in values])

    axis = [road.axis for road in run]
    rows[:, :2] = np.concatenate([np.diff(each[:, :2], axis=0) for each in axis])
    rows[:, ROAD["road_bend"]] = np.concatenate([road.bend for road in run])
    both("height", [each[:, 2] for each in axis])
    both("half", [road.half_width for road in run])
    both("whole", [road.whole_half for road in run])
    both("left", [road.crossfall[:, 0] for road in run])
    both("right", [road.crossfall[:, 1] for road in run])
    both("reach", [road.reach for road in run])
    both("rise", [road.slope for road in run])
    rows[:, _DEPTH] = np.concatenate([np.maximum(road.deepest[:-1], road.deepest[1:]) for road in run])
    length = np.concatenate([np.diff(road.along) for road in run])
    for name in ("road_from_rise", "road_to_rise"):
        rows[:, ROAD[name]] *= length
    for name, values in {
        "road_cut": [road.works.cut for road in run],
        "road_fill": [road.works.fill for road in run],
        "road_material": [materials.index(road.works.surface) for road in run],
    }.items():
        rows[:, ROAD[name]] = np.repeat(np.array(values, np.float64), pieces)
    return np.concatenate([each[:-1, :2] for each in axis]), rows


def _chains(row: Float64Array, run: Sequence[Road]) -> list[tuple[int, int, Float64Array]]:
    """Return the first and last (exclusive) pieces of chains, and their shares at stations.

    A chain that turns far may come near itself: it ends, and the next one fades in where it fades out.
    """
    count = len(row)
    turned = np.cumsum(np.abs(row[:, ROAD["road_bend"]]))
    cuts = np.flatnonzero(np.diff(np.floor(turned / _TURN)) > 0) + 1
    if not len(cuts):
        return [(0, count, np.ones(count + 1))]
    along = np.append(0.0, np.cumsum(np.concatenate([np.diff(road.along) for road in run])))
    half = 0.5 * _OVERLAP * float(row[:, ROAD["road_from_whole"]].max())
    middles = along[cuts]
    kept = [middles[0]]
    for place in middles[1:]:  # overlaps do not meet
        if place - kept[-1] > 3.0 * half:
            kept.append(place)
    kept = [place for place in kept if half < place < along[-1] - half]
    found = []
    for begin, end in zip([None, *kept], [*kept, None], strict=True):
        share = np.ones(count + 1)
        if begin is not None:
            share = np.minimum(share, np.clip((along - begin + half) / (2.0 * half), 0.0, 1.0))
        if end is not None:
            share = np.minimum(share, np.clip((end + half - along) / (2.0 * half), 0.0, 1.0))
        used = np.flatnonzero(np.maximum(share[:-1], share[1:]) > 0.0)
        found.append((int(used[0]), int(used[-1]) + 1, share[used[0] : used[-1] + 2]))
    return found
