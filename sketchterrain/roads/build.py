"""Roads, pads and what stands along lines of a sketch, on the ground that is there without them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
import shapely
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.features.table import AREA, LINE
from sketchterrain.landforms.hydrology.vector_rivers import line_path
from sketchterrain.landforms.placement.feature_types import Lake, River, is_inside
from sketchterrain.roads.alignment import Alignment, align
from sketchterrain.roads.network import WayGraph, way_graph
from sketchterrain.roads.profile import StationGraph, station_graph, united_reach
from sketchterrain.roads.road_types import LineObject, Pad, Road, RoadNetwork, Works
from sketchterrain.roads.structures import FREEBOARD, bends_told, carry
from sketchterrain.schema.layers import LAYERS, STANDING_LAYERS, WAY_LAYERS, id_of_vector
from sketchterrain.stages.parts import part_of
from sketchterrain.stages.runner import Runner

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


_FLOOD: Final = 0.5  # of a river's depth, above its surface: its banks' tops
_BANKS = 1.3  # half widths of a river with its banks


@dataclass(frozen=True, eq=False)
class Floods:
    """Levels (m) of the floods of waters as a function of positions (n,), m; NaN on land."""

    rivers: Sequence[River]
    lakes: Sequence[Lake]
    sea_level: float | None
    ground: Callable[[Float64Array, Float64Array], Float64Array]

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return levels (n,), m."""
        level, at = np.full(len(x), np.nan), np.stack([x, y], axis=1)
        if self.sea_level is not None:
            level[self.ground(x, y) < self.sea_level] = self.sea_level
        for lake in self.lakes:
            inside = is_inside(lake.shape, at)
            level[inside] = np.fmax(level[inside], lake.level)
        if self.rivers:
            tree, half, top, reach = self._river_points
            away, nearest = tree.query(at, distance_upper_bound=reach)
            found = np.isfinite(away)
            nearest = np.where(found, nearest, 0)
            wet = found & (away < half[nearest])
            level[wet] = np.fmax(level[wet], top[nearest[wet]])
        return level

    @cached_property
    def _river_points(self) -> tuple[cKDTree, Float64Array, Float64Array, float]:
        """Points of rivers, their half widths with banks and tops of banks (n,), and how far these reach."""
        line, width, depth = (
            np.concatenate([getattr(river, name) for river in self.rivers]).astype(np.float64)
            for name in ("centreline", "centreline_width", "centreline_depth")
        )
        half = 0.5 * _BANKS * width
        gap = 0.5 * max(
            float(np.hypot(*np.diff(river.centreline[:, :2], axis=0).T).max()) for river in self.rivers
        )
        return cKDTree(line[:, :2]), half, line[:, 2] + _FLOOD * depth, float(half.max()) + gap


Heights = Callable[[Float64Array, Float64Array], Float64Array]
"""Heights (m) at positions x and y (n,), m."""

ROAD_LAYERS: Final = (*WAY_LAYERS, "pad", *STANDING_LAYERS)
CROWN: Final = 0.025
"""Slope of a straight carriageway from its axis to its edges, of ways that have superelevation."""
_AT_ONCE = 1 << 14  # positions whose heights are computed at once, in the processor's cache
_GROUND_STEP = 8.0  # m between samples of the ground along a way
_FRICTION = 0.12  # of tyres across the carriageway that superelevation leaves
_LEVEL_ENDS, _WARP = 4.0, 20.0  # m beyond a junction's width with no crossfall; m over which it changes
_REACH, _LEAST_REACH, _MOST_REACH = 1.5, 4.0, 60.0  # of earthworks: times their width, m
_DAYLIGHT = 0.25  # of a slope that at least closes in on the ground beside it
_PAD_SAMPLES = 24  # along a pad's longer side


def road_network(sketch: Sketch, ground: Heights, water: Heights, run: Runner) -> RoadNetwork:
    """Return the roads, pads and what stands along lines of a sketch.

    Parameters
    ----------
    ground : heights without roads and pads, with a digest
    water : levels of floods, NaN on land, with a digest
    """
    roads: tuple[Road, ...] = ()
    findings: tuple[str, ...] = ()
    if any(len(sketch.vectors[name]) for name in WAY_LAYERS):
        names = (f"{kind}.{name}" for kind in ("vectors", "labels") for name in WAY_LAYERS)
        ways = run(_plan, part_of(sketch, *names), hashed=False)
        if ways is not None:
            roads, findings = run(_roads, ways, ground, water)
    return RoadNetwork(roads, _pads(sketch, ground, water, run), tuple(_standing(sketch)), findings)


def _ground_at(places: Sequence[Float64Array], ground: Heights, water: Heights) -> list[Float64Array]:
    """Return heights and levels of floods, (..., 2), at each array of positions (..., 2), m."""
    x, y = np.concatenate([each.reshape(-1, 2) for each in places]).T.copy()
    found = np.empty((len(x), 2))
    for first in range(0, len(x), _AT_ONCE):
        part = slice(first, first + _AT_ONCE)
        found[part, 0], found[part, 1] = ground(x[part], y[part]), water(x[part], y[part])
    parts = np.split(found, np.cumsum([each.size // 2 for each in places])[:-1])
    return [part.reshape(each.shape) for part, each in zip(parts, places, strict=True)]


@dataclass(frozen=True, eq=False)
class _Plan:
    """Ways as they lie in the plane."""

    graph: WayGraph
    line: Alignment
    stations: StationGraph
    bends: list[str]  # findings


def _plan(sketch: Sketch) -> _Plan | None:
    graph = way_graph(sketch)
    if not graph.legs:
        return None
    line, radii = align(graph.ways, graph.legs)
    way = np.concatenate([np.zeros(0, np.int64), *(np.append(leg.way[0], leg.way) for leg in graph.legs)])
    tight = np.flatnonzero(np.isfinite(radii))
    bends = bends_told(graph.ways, [(int(way[k]), float(radii[k])) for k in tight])
    return _Plan(graph, line, station_graph(graph.ways, graph.legs, line), bends)


def _roads(
    plan: _Plan, ground: Heights, floods: Heights, run: Runner
) -> tuple[tuple[Road, ...], tuple[str, ...]]:
    graph, line = plan.graph, plan.line
    ways = graph.ways
    own = line.way >= 0

    def of_ways(values: list[float]) -> Float64Array:
        return line.at_stations(np.where(own, np.array(values)[line.way], 0.0))

    half, shoulder = of_ways([way.half_width for way in ways]), of_ways([way.shoulder for way in ways])
    aside = line.left * (half + shoulder)[:, None]
    sampled = _sampled(line)
    at, aside = line.at[sampled], aside[sampled]
    legs = np.searchsorted(sampled, line.first[1:-1])
    places = np.split(np.stack([at, at + aside, at - aside], axis=1), legs)
    found = np.concatenate(run.each(_ground_at, places, ground, floods))
    middle, left, right = (_between(line, sampled, heights) for heights in found[..., 0].T)
    water = found[:, 0, 1][np.searchsorted(sampled, np.arange(len(line.at)), side="right") - 1]
    carried = carry(graph, plan.stations, line, 0.5 * middle + 0.25 * (left + right), water)
    crossfall = _crossfall(graph, line, half)
    cut, fill = of_ways([way.works.cut for way in ways]), of_ways([way.works.fill for way in ways])
    extent = _extent(line, carried.profile.height, (left, middle, right), half + shoulder, cut, fill)
    profile = carried.profile
    section = (profile.slope, half, shoulder, *extent)
    stations = np.column_stack([line.at, profile.height, crossfall, line.along, *section])
    roads = run.each(_cut_roads, _parts(graph, line, carried.structure, stations))
    return tuple(roads), (*carried.findings, *plan.bends)


def _sampled(line: Alignment) -> Int64Array:
    """Return the stations at which the ground is evaluated: the ends of legs, and one every some metres."""
    step = np.floor(line.along / _GROUND_STEP)
    chosen = np.append(True, np.diff(step) != 0.0)
    chosen[line.first[:-1]] = chosen[line.first[1:] - 1] = True
    return np.flatnonzero(chosen)


def _between(line: Alignment, sampled: Int64Array, heights: Float64Array) -> Float64Array:
    """Return heights at all stations, linear between those at some."""
    station = np.arange(len(line.at))
    after = np.searchsorted(sampled, station)
    before = np.maximum(after - 1, 0)
    start, end = line.along[sampled[before]], line.along[sampled[after]]
    share = np.where(end > start, (line.along - start) / np.where(end > start, end - start, 1.0), 1.0)
    share = np.where(sampled[after] == station, 1.0, share)
    return np.asarray(heights[before] * (1.0 - share) + heights[after] * share)


def _crossfall(graph: WayGraph, line: Alignment, half: Float64Array) -> Float64Array:
    """Return slopes from the axis to the left and to the right at stations, (n, 2).

    e = κ R (e_max + f) - f, at most e_max: what balances a car at the speed at which the bend of least
    radius R needs e_max and the friction f.
    """
    own = line.way >= 0
    most = np.where(own, np.array([way.superelevation for way in graph.ways])[line.way], 0.0)
    radius = np.where(own, np.array([way.radius for way in graph.ways])[line.way], 1.0)
    bent = np.abs(line.curvature) * radius * (most + _FRICTION) - _FRICTION
    lean = line.at_stations(np.where(most > 0.0, np.clip(bent, 0.0, most) * np.sign(line.curvature), 0.0))
    crown = CROWN * line.at_stations((most > 0.0).astype(np.float64))
    for _ in range(2):
        lean = _blurred(lean, line)
    towards = np.abs(lean)
    share = np.clip(towards / CROWN, 0.0, 1.0)
    inner, outer = -np.maximum(crown, towards), -crown * (1.0 - share) + towards * share
    turns_left = lean > 0.0
    both = np.where(turns_left[:, None], np.stack([inner, outer], 1), np.stack([outer, inner], 1))
    level = np.ones(len(half))
    for leg, (start, end) in zip(graph.legs, pairwise(line.first.tolist()), strict=True):
        along = line.along[start:end]
        for degree, away, at in (
            (leg.degrees[0], along, start),
            (leg.degrees[1], along[-1] - along, end - 1),
        ):
            if degree > 1:
                t = np.clip((away - half[at]) / (_LEVEL_ENDS + half[at]), 0.0, 1.0)
                level[start:end] = np.minimum(level[start:end], t * t * (3.0 - 2.0 * t))
    return np.asarray(both * level[:, None])


def _blurred(values: Float64Array, line: Alignment) -> Float64Array:
    """Return values with each station's mean of its neighbours', by their distance, along the leg."""
    result = values.copy()
    own = line.way >= 0
    share = np.where(own, np.exp2(-np.round(line.length / (0.5 * _WARP))), 0.0)
    total = np.ones(len(values))
    for a, b in ((slice(None, -1), slice(1, None)), (slice(1, None), slice(None, -1))):
        result[a] += share * values[b]
        total[a] += share
    return np.asarray(result / total)


def _extent(
    line: Alignment,
    height: Float64Array,
    ground: tuple[Float64Array, Float64Array, Float64Array],
    whole: Float64Array,
    cut: Float64Array,
    fill: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Return how far from the axis earthworks may be needed, and their depth there at most, (n,), m."""
    left, middle, right = ground
    widest, deepest = np.zeros(len(height)), np.abs(height - middle)
    for side in (left, right):
        away = np.maximum(whole, 1e-3)
        lean = (side - middle) / away
        lack = height - side
        slope = np.where(lack > 0.0, fill, cut)
        parallel = slope + np.where(lack > 0.0, lean, -lean)
        closing = np.maximum(parallel, _DAYLIGHT * slope)
        width = np.clip(_REACH * np.abs(lack) / closing, _LEAST_REACH, _MOST_REACH)
        widest = np.maximum(widest, width)
        deepest = np.maximum(deepest, np.abs(lack) + np.maximum(-parallel, 0.0) * width)
    return np.ceil(united_reach(line.along, line.first, whole + widest)), deepest


class _RoadPart(NamedTuple):
    """What a road is made of."""

    own: tuple[int, str, int, int, int]  # first fields of `Road`
    works: Works
    trees: float
    ends: tuple[int, int]
    # (m, 11) axis (3 columns), crossfall (2), along, slope, half width, shoulder, reach, depth
    stations: Float64Array
    bend: Float64Array  # (m − 1,)


def _parts(
    graph: WayGraph, line: Alignment, structure: Int64Array, stations: Float64Array
) -> list[_RoadPart]:
    """Return the legs cut where their features or structures change."""
    parts: list[_RoadPart] = []
    change = np.flatnonzero((np.diff(line.way) != 0) | (np.diff(structure) != 0)) + 1
    for leg, (start, end) in zip(graph.legs, pairwise(line.first.tolist()), strict=True):
        inner = change[(change > start) & (change < end - 1)].tolist()
        for part, (a, b) in enumerate(pairwise([start, *inner, end - 1])):
            way = graph.ways[line.way[a]]
            ends = (leg.degrees[0] if a == start else 2, leg.degrees[1] if b == end - 1 else 2)
            own = way.id, way.layer, leg.key, part, int(structure[a])
            parts.append(_RoadPart(own, way.works, way.trees, ends, stations[a : b + 1], line.bend[a:b]))
    return parts


def _cut_roads(parts: Sequence[_RoadPart]) -> list[Road]:
    roads = []
    for own, works, trees, ends, stations, bend in parts:
        axis, crossfall = stations[:, :3].copy(), stations[:, 3:5].copy()
        along, slope, half, shoulder, reach, depth = stations[:, 5:].T.copy()
        beside = slope, half, shoulder, crossfall, reach, depth
        roads.append(Road(*own, axis, bend.copy(), along, *beside, works, trees, ends))
    return roads


def _pads(sketch: Sketch, ground: Heights, floods: Heights, run: Runner) -> tuple[Pad, ...]:
    layer = sketch.vectors["pad"]
    indices = np.flatnonzero(layer.kinds == AREA).tolist()
    if not indices:
        return ()
    cut, fill, building = (sketch.vector_values("pad", name) for name in ("cut", "fill", "building"))
    surface = sketch.vector_texts("pad", "surface")
    rings = [layer.ring(int(layer.parts[index])) for index in indices]
    rings = [ring if _signed_area(ring) > 0.0 else ring[::-1] for ring in rings]
    found = run.each(_ground_at, [_inside(ring) for ring in rings], ground, floods)
    pads = []
    for index, outline, (height, water) in zip(indices, rings, (each.T for each in found), strict=True):
        level = float(np.round(np.median(np.fmax(height, water + FREEBOARD)) * 1024.0) / 1024.0)
        most = float(np.abs(height - level).max())
        widest = _REACH * 2.0 * most / min(cut[index], fill[index])
        works = Works(float(cut[index]), float(fill[index]), surface[index])
        pads.append(
            Pad(
                id_of_vector("pad", int(layer.ids[index])),
                outline,
                level,
                float(np.ceil(np.clip(widest, _LEAST_REACH, _MOST_REACH))),
                float(building[index]),
                works,
            )
        )
    return tuple(sorted(pads, key=lambda pad: pad.id))


def _signed_area(ring: Float64Array) -> float:
    x, y = (ring - ring[0]).T
    return 0.5 * float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _inside(ring: Float64Array) -> Float64Array:
    """Return positions (n, 2) on a grid inside a ring, and its vertices."""
    low, high = ring.min(axis=0), ring.max(axis=0)
    step = max(float((high - low).max()) / _PAD_SAMPLES, 0.5)
    x, y = np.meshgrid(*(np.arange(a + 0.5 * step, b, step) for a, b in zip(low, high, strict=True)))
    inside: BoolArray = shapely.contains_xy(shapely.Polygon(ring), x.ravel(), y.ravel())
    return np.concatenate([ring, np.stack([x.ravel(), y.ravel()], axis=1)[inside]])


def _standing(sketch: Sketch) -> Iterator[LineObject]:
    """Yield what stands along the lines of all layers of that kind."""
    for name in STANDING_LAYERS:
        layer = sketch.vectors[name]
        columns = {each: sketch.vector_property(name, each) for each in LAYERS[name].parameters}
        for index in np.flatnonzero(layer.kinds == LINE).tolist():
            values = {each: column[index] for each, column in columns.items()}
            number = id_of_vector(name, int(layer.ids[index]))
            yield LineObject(number, name, line_path(layer, index), values)
