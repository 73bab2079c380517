"""Roads of Andorra: grades, sections, earthworks, structures and times."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from itertools import groupby
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any, TypeAlias

import numpy as np
import shapely
from scipy.spatial import cKDTree

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.benchmarks.effort import Effort
from sketchterrain.benchmarks.report import Row, Table, Tables
from sketchterrain.benchmarks.timing import TimedContext, alternate
from sketchterrain.document.rasters import raster_source
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import load_sketch
from sketchterrain.generation.building import make_recipe
from sketchterrain.generation.terrain import Terrain
from sketchterrain.geometry.lattice import QUADS
from sketchterrain.importing.elevation import sketch_on_elevation
from sketchterrain.importing.vectors import with_vectors_of
from sketchterrain.io.resources import kernel_constants
from sketchterrain.roads.build import ROAD_LAYERS, Floods, road_network
from sketchterrain.roads.road_types import BRIDGE, GROUND, TUNNEL, Road, RoadNetwork, axis_points, deck_depth
from sketchterrain.roads.structures import TUNNEL_HEIGHT
from sketchterrain.schema.layers import id_of_vector
from sketchterrain.stages.runner import Results, Runner
from sketchterrain.terrain.host_heights import Ground, host_heights

DEMS, OSM = "SKETCHTERRAIN_DEMS", "SKETCHTERRAIN_OSM"
"""Environment variables: the folder with `N42E001.hgt.zip`, and a file of OpenStreetMap with its roads."""

_CORNER, _EXTENT = (368_000.0, 4_697_500.0), 32_000.0  # m
_TOLERANCE = 1e-3  # m
_STEP, _DENSE, _SECTIONS = 10.0, 2.0, 100.0  # m between samples, those of structures, sections
_OFFSETS = np.arange(-40.0, 40.25, 0.5)  # m of points of sections from the axis
_EDGE = 1.0 - 1e-3  # of the half width: positions have steps of 2 mm
_OVER = 1e-3  # of grades
_CELL = 2.0  # m, of the ground that roads are laid on
(_WIDER,) = kernel_constants("layers/roads.clh", "ROAD_WIDER")  # cells by which strips are wider
_TILES = 64
_MOVED = np.array([12.0, 16.0])  # m by which nodes are moved

_PROFILES = {"over": "over the limit by > 0.1 %: % of samples", "rms": "cut and fill, rms m"}
_KEYS = ("heights", "over", "p50", "p95", "most", "rms", "p90", "p99", "seconds")
_HEADINGS = ("line", "measure", "asked", "reached", "of", "besides")
_Line: TypeAlias = tuple[str, float | None, float, int, str]
"""A measure, what is asked, what is reached, of how many, and facts."""


def measure(context: TimedContext, effort: Effort) -> Tables:
    """Roads, railways and paths of Andorra (OpenStreetMap 2013) on SRTM 3″, and what is asked of them.

    Without the files that `SKETCHTERRAIN_DEMS` and `SKETCHTERRAIN_OSM` name: the preset `mountain_pass`.

    Grades are those between samples 10 m apart along the car roads: of the evaluated terrain at full detail,
    and of the profile on bridges and tunnels. Cut and fill are differences from the ground, of samples on the
    ground. Times, in seconds, leave out sampling it.

    Edges and points are compared with profile and crossfall where no other road, nor another bend of the own
    one, overlaps them with its shoulders. Points in coarser cells are those of the tiles' triangles, where no
    other strip and no portal is nearer than twice what strips are widened by. Sections of 80 m, every 100 m,
    are beside Bruneton's blend of the same profile, b = smoothstep(1, 2, |v| / (w / 2)).
    """
    case = _RoadCase(context, _sketch(), effort)
    lines = [
        dict(
            zip(_HEADINGS, (name, *line[:2], np.asarray(line[2]).item(), str(line[3]), line[4]), strict=True)
        )
        for name, work in _LINES.items()
        for line in work(case)
    ]
    title = f"{case.length / 1e3:.0f} km of car roads"
    return (Table("Longitudinal profiles", tuple(_profiles(case)), _PROFILES), Table(title, tuple(lines)))


def _sketch() -> Sketch:
    dem, osm = Path(os.environ.get(DEMS, "")) / "N42E001.hgt.zip", Path(os.environ.get(OSM, ""))
    if dem.is_file() and osm.is_file():
        source = raster_source(dem, "elevation")
        return with_vectors_of(sketch_on_elevation([source], origin=_CORNER, extent=_EXTENT)[0], osm)[0]
    return load_sketch("mountain_pass")


@dataclass(frozen=True, eq=False)
class RoadSamples:
    """Points at equal steps along each leg, one leg after the other."""

    roads: tuple[Road, ...]
    leg: Int64Array  # (n,)
    along: Float64Array  # (n,) m
    road: Int64Array  # (n,) number of the road that it is on
    at: Float64Array  # (n, 2) m
    height: Float64Array  # (n,) m, of the profile
    left: Float64Array  # (n, 2) normals
    half: Float64Array  # (n,) m
    whole: Float64Array  # (n,) m, with the shoulder
    crossfall: Float64Array  # (n, 2)

    @cached_property
    def inner(self) -> BoolArray:
        """(n − 1,) whether the next sample is on the same leg."""
        return np.asarray(np.diff(self.leg) == 0)

    @cached_property
    def structure(self) -> Int64Array:
        """(n,)."""
        return np.array([road.structure for road in self.roads])[self.road]

    @property
    def on_ground(self) -> BoolArray:
        """(n,)."""
        return np.asarray(self.structure == GROUND)

    def beside(self, offset: Float64Array) -> Float64Array:
        """Return positions and heights (n, 3) of the section at offsets (m) from the axis, to the left."""
        lean = np.where(offset > 0.0, *self.crossfall.T)
        return np.column_stack([self.at + self.left * offset[:, None], self.height + lean * np.abs(offset)])

    def limits(self, grades: Mapping[int, float]) -> Float64Array:
        """Return the limits of grade between samples and the next ones, (n − 1,), by a road's feature."""
        own = np.array([grades[road.id] for road in self.roads])[self.road]
        return np.asarray(np.maximum(own[:-1], own[1:]))

    def grades(self, height: Float64Array) -> Float64Array:
        """Return the grades of heights (n,) between samples and the next ones, (n − 1,); 0 between legs."""
        length = np.where(self.inner, np.diff(self.along), np.inf)
        return np.asarray(np.abs(np.diff(height)) / length)


def road_samples(roads: tuple[Road, ...], layer: str, step: float) -> RoadSamples:
    """Return points on the axes of a layer's roads, about `step` (m) apart."""
    roads = tuple(road for road in roads if road.layer == layer)
    found: list[tuple[Any, ...]] = []
    number = 0
    for leg, group in groupby(roads, key=lambda road: road.leg):
        parts = list(group)
        points = [axis_points(part, _TOLERANCE) for part in parts]
        known = [
            np.column_stack([each.position, each.left, each.half_width, each.shoulder, each.crossfall])
            for each in points
        ]
        along = np.concatenate([each.along for each in points])
        at = np.linspace(along[0], along[-1], max(round((along[-1] - along[0]) / step), 1) + 1)
        columns = np.column_stack([np.interp(at, along, column) for column in np.concatenate(known).T])
        own = number + np.searchsorted([part.along[0] for part in parts], at, side="right") - 1
        found.append((np.full(len(at), leg), at, own, columns))
        number += len(parts)
    leg, along, road, columns = (np.concatenate(each) for each in zip(*found, strict=True))
    left = columns[:, 3:5] / np.hypot(*columns[:, 3:5].T)[:, None]
    whole = columns[:, 5] + columns[:, 6]
    shape = columns[:, :2], columns[:, 2], left, columns[:, 5], whole, columns[:, 7:]
    return RoadSamples(roads, leg.astype(np.int64), along, road.astype(np.int64), *shape)


@dataclass(frozen=True, eq=False)
class _TimedGround(Ground):
    """Ground without roads, and the seconds of each evaluation."""

    seconds: list[float] = field(init=False, default_factory=list)

    def __call__(self, x: Float64Array, y: Float64Array) -> Float64Array:
        """Return heights (n,), m."""
        start = perf_counter()
        found = super().__call__(x, y)
        self.seconds.append(perf_counter() - start)
        return found


class _RoadCase:
    """The terrain with roads and without, and samples of the car roads."""

    def __init__(self, context: TimedContext, sketch: Sketch, effort: Effort) -> None:
        memory = Results()
        removed = {name: sketch.vectors[name].edited(remove=sketch.vectors[name].ids) for name in ROAD_LAYERS}
        without = sketch.replace(vectors={**sketch.vectors, **removed})
        self.context, self.sketch, self.effort = context, sketch, effort
        self.recipe, self.bare = (make_recipe(each, memory=memory) for each in (sketch, without))
        self.terrain, self.natural = (Terrain(sketch, each, context) for each in (self.recipe, self.bare))
        self.roads = self.recipe.network.roads
        self.samples = road_samples(self.roads, "road", _STEP)
        self.length = float(np.diff(self.samples.along)[self.samples.inner].sum())
        self.ground = _TimedGround(self.bare, _CELL)
        ids = [id_of_vector("road", number) for number in sketch.vectors["road"].ids.tolist()]
        grades = sketch.vector_values("road", "grade").tolist()
        self.limits = self.samples.limits(dict(zip(ids, grades, strict=True)))
        self.on_terrain = np.where(self.samples.on_ground, self.heights(self.samples.at), self.samples.height)

    @cached_property
    def axes(self) -> tuple[Any, Int64Array]:
        """Axes of all roads as lines, and their legs."""
        lines = [shapely.LineString(axis_points(road, 0.01).position) for road in self.roads]
        return np.array(lines, object), np.array([road.leg for road in self.roads])

    @cached_property
    def pieces(self) -> tuple[Any, Float64Array]:
        """Pieces of the axes; starts, ends, half widths (m), legs, and whether they are in tunnels."""
        lines, facts = [], []
        for road in self.roads:
            axis = axis_points(road, 0.1)
            lines.append(np.stack([axis.position[:-1, :2], axis.position[1:, :2]], axis=1))
            own = np.full((len(axis.along) - 1, 2), (road.leg, road.structure == TUNNEL), np.float64)
            wide = axis.half_width + axis.shoulder
            facts.append(np.column_stack([axis.along[:-1], axis.along[1:], wide[1:], own]))
        return shapely.linestrings(np.concatenate(lines)), np.concatenate(facts)

    def heights(self, at: Float64Array, *, bare: bool = False, cell: float = 0.0) -> Float64Array:
        """Return heights (n,) at positions (n, 2 or 3), m."""
        terrain = self.natural if bare else self.terrain
        return terrain.heights(at[:, 0], at[:, 1], cell_size=cell).astype(np.float64)

    def network(self, sketch: Sketch, memory: Results) -> tuple[RoadNetwork, float, float]:
        """Return a sketch's network, seconds without sampling the ground, and those of sampling it."""
        water = Floods(self.bare.rivers, self.bare.lakes, self.bare.sea_level, self.ground)
        start, before = perf_counter(), sum(self.ground.seconds)
        network = road_network(sketch, self.ground, water, Runner(memory))
        sampling = sum(self.ground.seconds) - before
        return network, perf_counter() - start - sampling, sampling

    def alone(
        self, at: Float64Array, samples: RoadSamples, offset: Float64Array, more: float = 0.0
    ) -> BoolArray:
        """Return where roads at offsets from their axes (m) overlap no other road, nor themselves.

        They do where an axis is nearer than the offset, or 1.5 times as far along as the way across.
        """
        (lines, facts), points = self.pieces, shapely.points(at[:, :2])
        piece, point = shapely.STRtree(points).query(lines, "dwithin", facts[:, 2] + more)
        first, last, _, leg, in_tunnel = facts[piece].T
        away = shapely.distance(lines[piece], points[point])
        across, along = np.abs(offset[point]), samples.along[point]
        far = np.maximum(first - along, along - last) > 1.5 * (across + away)
        result = np.ones(len(at), np.bool_)
        other = (leg != samples.leg[point]) | far | (away < across - 0.05) | (in_tunnel * more > 0.0)
        result[point[other]] = False
        return result

    def untouched(self, at: Float64Array, leg: Int64Array) -> BoolArray:
        """Return where no earthworks reach, but for those of a leg's ends."""
        (lines, legs), tree = self.axes, shapely.STRtree(shapely.points(at[:, :2]))
        reach = np.array([road.reach.max() if road.structure == GROUND else np.nan for road in self.roads])
        line, point = tree.query(lines, predicate="dwithin", distance=reach + 0.1)
        result = np.ones(len(at), np.bool_)
        place = shapely.line_locate_point(lines[line], tree.geometries[point])
        beside = (place > 0.01) & (place < shapely.length(lines[line]) - 0.01)
        result[point[(legs[line] != leg[point]) | beside]] = False
        for pad in self.recipe.network.pads:
            outline = shapely.Polygon(pad.outline)
            result[tree.query(outline, predicate="dwithin", distance=pad.reach + 0.1)] = False
        return result


def _profiles(case: _RoadCase) -> Iterator[Row]:
    """Yield grades of ground, profile and terrain, and how far their heights are from the ground."""
    samples, limits = case.samples, case.limits
    raw = case.natural.heights(*samples.at.T, cell_size=_CELL).astype(np.float64)
    memory = Results()
    solve = [case.network(case.sketch, memory)[1] for _ in range(3)][-1]
    for name, height in {"draped": raw, "profile": samples.height, "terrain": case.on_terrain}.items():
        grade, works = samples.grades(height)[samples.inner], np.abs(height - raw)[samples.on_ground]
        over = 100.0 * float(np.mean(grade > limits[samples.inner] + _OVER))
        errors = np.sqrt(np.mean(works**2)), *np.percentile(works, (90, 99))
        seconds = 0.0 if name == "draped" else solve
        values = (name, over, *np.percentile(grade, (50, 95, 100)).tolist(), *map(float, errors), seconds)
        yield dict(zip(_KEYS, values, strict=True))


def _grade(case: _RoadCase) -> Iterator[_Line]:
    over = case.samples.grades(case.on_terrain) > case.limits + _OVER
    yield "samples over the limit by > 0.1 %", 0, over.sum(), len(over), ""


def _across(case: _RoadCase) -> Iterator[_Line]:
    samples = case.samples
    on_ground, edges, overlap = samples.on_ground, [], 0.0
    for side in (_EDGE, -_EDGE):
        edge = samples.beside(side * samples.half)
        alone = on_ground & case.alone(edge, samples, samples.half)
        overlap += 50.0 * float(np.mean(~alone[on_ground]))
        off, raw = (np.abs(case.heights(edge, bare=bare) - edge[:, 2]) for bare in (False, True))
        edges.append((off[alone], raw[on_ground]))
    off, raw = (np.concatenate(each) for each in zip(*edges, strict=True))
    shared = f"carriageways overlap at {overlap:.1f} % of the edges"
    yield "edges > 2 cm off the section, %", 0, 100 * float(np.mean(off > 0.02)), len(off), shared
    ground = f"the ground: median {np.median(raw):.2g} m"
    yield "largest distance from the section, m", 0.02, off.max(), len(off), ground


def _poke(case: _RoadCase) -> Iterator[_Line]:
    random = np.random.default_rng(27)

    def thrown(count: int) -> tuple[RoadSamples, Float64Array, Float64Array]:
        points = road_samples(case.roads, "road", case.length / count)
        offset = random.uniform(-_EDGE, _EDGE, len(points.at)) * points.half
        return points, offset, points.beside(offset)

    points, offset, section = thrown(case.effort.road_points)
    own = points.on_ground & case.alone(section, points, offset)
    above = case.heights(section[own]) - section[own, 2]
    yield "ground above the carriageway, m", 0.01, above.max(), len(above), f"more: {np.sum(above > 0.01)}"
    points, offset, section = thrown(max(case.effort.road_points // 10, 1000))
    for level in range(6, 12):
        cell = case.sketch.extent / (QUADS << level)
        own = points.on_ground & (points.half >= cell)
        own &= case.alone(section, points, offset, 2.0 * _WIDER * cell)
        if own.any():
            above = _on_triangles(case, section[own, :2], cell) - section[own, 2]
            more = f"more: {np.sum(above > 0.1 * cell)}"
            yield f"… in cells of {cell:.3g} m, w ≥ 2 cells: cells", 0.1, above.max() / cell, len(above), more
    at = random.uniform(0.0, 1.0, (len(points.at), 2)) * case.sketch.size
    at = at[case.untouched(at, np.full(len(at), -1))]
    changed = case.heights(at) != case.heights(at, bare=True)
    yield "points beyond earthworks with other bits", 0, changed.sum(), len(at), ""


def _on_triangles(case: _RoadCase, at: Float64Array, cell: float) -> Float64Array:
    """Return heights (n,) of a grid of cells (m), the higher ones of both diagonals'."""
    corner = np.floor(at / cell)
    s, t = (at / cell - corner).T
    steps = ((0, 0), (1, 0), (0, 1), (1, 1))
    a, b, c, d = (case.heights((corner + step) * cell, cell=cell) for step in steps)
    rising = np.where(s > t, a + s * (b - a) + t * (d - b), a + t * (c - a) + s * (d - c))
    falling = np.where(s + t < 1, a + s * (b - a) + t * (c - a), d + (1 - s) * (c - d) + (1 - t) * (b - d))
    return np.asarray(np.maximum(rising, falling))


def _joints(case: _RoadCase) -> Iterator[_Line]:
    legs = [list(group) for _, group in groupby(case.roads, key=lambda road: road.leg)]
    at = np.array([leg[k].axis[k] for leg in legs for k in (0, -1)])
    on_ground = np.array([leg[k].structure == GROUND for leg in legs for k in (0, -1)])
    _, node, count = np.unique(at[:, 0] + 1j * at[:, 1], return_inverse=True, return_counts=True)
    order = np.lexsort((at[:, 2], node))
    step = np.diff(at[order, 2])[np.diff(node[order]) == 0]
    yield "step of profiles at nodes, m", 1e-3, step.max(initial=0.0), len(count), ""
    met = at[on_ground & (count[node] > 1)]
    off = np.abs(case.heights(met) - met[:, 2])
    more = f"more: {np.sum(off > 1e-3)}"
    yield "terrain off the profile at nodes, m", 1e-3, off.max(initial=0.0), len(met), more
    for level in (6, 8, 10):
        tiles = _busy_tiles(case, level)
        height = dict(zip(tiles, case.terrain.evaluator.tiles(tiles, level)[0].height, strict=True))
        sides = [(height[x, y][:, -1], height[x + 1, y][:, 0]) for x, y in tiles if (x + 1, y) in height]
        sides += [(height[x, y][0], height[x, y + 1][-1]) for x, y in tiles if (x, y + 1) in height]
        one, other = (np.concatenate(each) for each in zip(*sides, strict=True))
        yield f"vertices of borders with other bits, level {level}", 0, np.sum(one != other), len(one), ""


def _busy_tiles(case: _RoadCase, level: int) -> list[tuple[int, int]]:
    """Return a square of 64 tiles (column, row), that with most of the roads."""
    eight = 8.0 * case.sketch.extent / (1 << level)
    places, counts = np.unique(np.floor(case.samples.at / eight), axis=0, return_counts=True)
    column, row = (8 * places[counts.argmax()]).astype(int).tolist()
    return [(column + x, row + y) for y in range(8) for x in range(8)]


def _cuts(case: _RoadCase) -> Iterator[_Line]:
    samples, away = case.samples, np.abs(_OFFSETS)
    chosen = np.flatnonzero(samples.on_ground)[:: round(_SECTIONS / _STEP)]
    half, leg = samples.half[chosen, None], samples.leg[chosen, None]
    at = (samples.at[chosen, None] + samples.left[chosen, None] * _OFFSETS[:, None]).reshape(-1, 2)
    own, raw = (case.heights(at, bare=bare).reshape(-1, len(away)) for bare in (False, True))
    legs = np.concatenate([np.full(len(road.axis), road.leg) for road in case.roads])
    axes = cKDTree(np.concatenate([road.axis[:, :2] for road in case.roads]))
    nearest = legs[axes.query(at)[1]].reshape(own.shape) == leg
    t = np.clip(2.0 - away / half, 0.0, 1.0)
    fixed = raw + t * t * (3.0 - 2.0 * t) * (samples.height[chosen, None] - raw)
    works = [case.samples.roads[k].works for k in samples.road[chosen]]
    asked = np.array([max(each.cut, each.fill) for each in works])[:, None]
    for name, height, edge in (("", own, samples.whole[chosen, None]), ("fixed width: ", fixed, half)):
        beside = (away > edge) & nearest & (np.abs(height - raw) > 0.01)
        pair = beside[:, 1:] & beside[:, :-1]
        slope = np.abs(np.diff(height, axis=1)) / np.diff(_OFFSETS)
        p50, p99, most = np.percentile(slope[pair], (50, 99, 100))
        steep = 100 * np.mean((slope > 1.1 * asked)[pair])
        facts = f"slope: median {p50:.2f}, 99 % {p99:.2f}, largest {most:.1f}"
        yield f"{name}slopes over the road's own by > 10 %, %", 0, steep, pair.sum(), facts
        moved = 1e3 * np.mean(np.sum(np.abs(height - raw) * nearest, axis=1)) * np.diff(_OFFSETS)[0]
        yield f"{name}volume moved, m³ a km", None, moved, len(chosen), ""


def _runs(samples: RoadSamples, structure: int) -> list[slice]:
    """Return the runs of samples on structures of a kind."""
    change = np.flatnonzero((np.diff(samples.structure) != 0) | ~samples.inner) + 1
    pairs = zip([0, *change], [*change, len(samples.at)], strict=True)
    return [slice(a, b) for a, b in pairs if samples.structure[a] == structure and b - a > 3]


def _bridges(case: _RoadCase) -> Iterator[_Line]:
    samples = road_samples(case.roads, "road", _DENSE)
    off = []
    for each in _runs(samples, BRIDGE):
        along, height = samples.along[each] - samples.along[each.start], samples.height[each]
        fits = (np.polyval(np.polyfit(along, height, degree), along) for degree in (2, 1))
        off.append([0.5 * np.ptp(height - fit) for fit in fits])
    if not off:
        return
    curve, line = np.array(off).T
    facts = f"off a straight line by more: {np.sum(line > 0.05)}, at most {line.max():.2f} m"
    yield "off a vertical curve, m", 0.05, curve.max(), len(off), facts
    ends, grounds = (
        {tuple(road.axis[k]) for road in case.roads if road.structure == kind for k in (0, -1)}
        for kind in (BRIDGE, GROUND)
    )
    at = np.array(sorted(ends & grounds)).reshape(-1, 3)
    step = np.abs(case.heights(at) - at[:, 2])
    yield "step between deck and ground, m", 0.02, step.max(initial=0.0), len(at), ""
    (lines, legs), is_bridge = case.axes, np.array([road.structure == BRIDGE for road in case.roads])
    room, under = [], []
    for a, b in shapely.STRtree(lines).query(lines, predicate="crosses").T:
        if is_bridge[a] and legs[a] != legs[b]:
            for place in shapely.get_parts(shapely.intersection(lines[a], lines[b])):
                upper, lower = (_height_at(lines[k], place) for k in (a, b))
                if upper > lower:
                    room.append(upper - lower)
                    under.append(room[-1] - deck_depth(float(np.ptp(case.roads[a].along))))
    if room:
        facts = f"under the deck: {min(under):.2f} m"
        yield "carriageway over carriageway, m: at least", 4.5, min(room), len(room), facts


def _height_at(line: Any, place: Any) -> float:
    """Return the height (m) of a line's nearest point to a place."""
    x, y, z = shapely.get_coordinates(line, include_z=True).T
    along = np.append(0.0, np.cumsum(np.hypot(np.diff(x), np.diff(y))))
    return float(np.interp(shapely.line_locate_point(line, place), along, z))


def _tunnels(case: _RoadCase) -> Iterator[_Line]:
    samples = road_samples(case.roads, "road", _DENSE)
    runs = _runs(samples, TUNNEL)
    if runs:
        inside = np.concatenate([np.arange(each.start + 1, each.stop - 1) for each in runs])
        at = samples.at[inside]
        raw, own = (
            case.heights(at, bare=bare) - samples.height[inside] - TUNNEL_HEIGHT for bare in (True, False)
        )
        opened = f"other roads' cuttings leave less than 3 m at {100 * np.mean(own < 3.0):.1f} %"
        yield f"cover, m: at least; less at {np.sum(raw < 3.0)} points", 3.0, raw.min(), len(at), opened
        changed = (own != raw)[case.untouched(at, samples.leg[inside])]
        yield "points between portals with other bits", 0, changed.sum(), len(changed), ""


def _solves(case: _RoadCase) -> Iterator[_Line]:
    memory, rounds = Results(), case.effort.rounds
    before, first, sampling = case.network(case.sketch, memory)
    again = median(case.network(case.sketch, memory)[1] for _ in range(rounds))
    facts = f"of it profiles: {again:.2f} s; sampling the ground besides: {sampling:.1f} s"
    yield "plan and profiles, s", 2.0, first, len(case.roads), facts
    layer, times, far, change = case.sketch.vectors["road"], [], [], []
    nodes, count = np.unique(layer.vertices, axis=0, return_counts=True)
    known = {tuple(at[:2]): at[2] for road in before.roads for at in road.axis.tolist()}
    for node in np.random.default_rng(27).permutation(nodes[count > 1])[:rounds]:
        place = (layer.vertices == node).all(axis=1)
        moved = replace(layer, vertices=layer.vertices + place[:, None] * _MOVED)
        sketch = case.sketch.replace(vectors={**case.sketch.vectors, "road": moved})
        after, *seconds = case.network(sketch, memory)
        times.append(sum(seconds))
        stations = [at for road in after.roads for at in road.axis.tolist()]
        offs = [(abs(known.get((x, y), z) - z), np.hypot(x - node[0], y - node[1])) for x, y, z in stations]
        far.append(max((distance for off, distance in offs if off > 0.01), default=0.0))
        change.append(max(offs)[0])
        case.network(case.sketch, memory)
    yield "a node moved by 20 m, s", 0.05, median(times), rounds, f"largest: {max(times):.2f} s"
    facts = f"at most {max(far):.0f} m; change at vertices that stay: median {median(change):.2f} m"
    yield "… heights change by > 1 cm up to, m, median", None, median(far), rounds, facts


def _tiles(case: _RoadCase) -> Iterator[_Line]:
    for level in (5, 7, 9):
        with_roads = np.unique(np.floor(case.samples.at / (case.sketch.extent / (1 << level))), axis=0)
        chosen = np.random.default_rng(27).permutation(with_roads.astype(int))[:_TILES]
        yield _tile_time(case, "any tiles", list(map(tuple, chosen.tolist())), level)
        yield _tile_time(case, "the busiest", _busy_tiles(case, level), level)


def _tile_time(case: _RoadCase, what: str, keys: list[tuple[int, int]], level: int) -> _Line:
    work = {
        terrain: partial(case.context.lap, partial(terrain.evaluator.tiles, keys, level))
        for terrain in (case.terrain, case.natural)
    }
    laps = alternate(work, rounds=case.effort.rounds)
    own, bare = (1e3 * median(lap.wall for lap in laps[terrain]) for terrain in work)
    cell = case.sketch.extent / (QUADS << level)
    facts = f"{own:.0f} and {bare:.0f} ms"
    return f"time with roads ÷ without, {what}, cells of {cell:.3g} m", 1.5, own / bare, len(keys), facts


def _accuracy(case: _RoadCase) -> Iterator[_Line]:
    samples = case.samples
    at = samples.beside(np.random.default_rng(5).uniform(-20.0, 20.0, len(samples.at)))
    at = at[:: max(len(at) // 10_000, 1), :2]
    off = 1e3 * np.abs(case.heights(at) - host_heights(case.recipe, *at.T))
    p99 = f"99 %: {np.percentile(off, 99):.2g}"
    yield "float32 off float64 on the host, mm", None, off.max(), len(at), p99


_LINES = {
    "roads.grade": _grade,
    "roads.across": _across,
    "roads.poke": _poke,
    "roads.joint": _joints,
    "roads.cut": _cuts,
    "roads.bridge": _bridges,
    "roads.tunnel": _tunnels,
    "network.solve": _solves,
    "tiles": _tiles,
    "kernel": _accuracy,
}
"""Lines by name."""
