"""The network of roads, railways and paths: features, junctions, legs between them, facts for reports."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import shapely

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.features.table import STEP, FeatureTable, on_grid
from sketchterrain.geometry.splines import drop_repeats
from sketchterrain.landforms.hydrology.vector_rivers import line_path
from sketchterrain.roads.road_types import BRIDGE, GROUND, TUNNEL, Road, RoadNetwork, Works, grades
from sketchterrain.schema.layers import WAY_LAYERS, id_of_vector, storey, vector_of

if TYPE_CHECKING:
    from sketchterrain.document.sketch import Sketch


AUTOMATIC: Final = -1
"""The structure of a feature that follows from the ground."""
_ORDINAL_BITS = 16
_ON_LINE: Final = 1.5 * STEP  # m from a line of places on it that are rounded
_LEAST_LOOP: Final = 0.1  # m
_STRUCTURE: Final = {"automatic": AUTOMATIC, "ground": GROUND, "bridge": BRIDGE, "tunnel": TUNNEL}


@dataclass(frozen=True)
class Way:
    """A road, railway or path as a feature: its properties."""

    id: int  # `id_of_vector`
    layer: str
    half_width: float  # m, of the carriageway
    shoulder: float  # m
    grade: float  # rise over run, at most
    radius: float  # m, at least
    superelevation: float
    structure: int  # AUTOMATIC, GROUND, BRIDGE or TUNNEL
    storey: int  # which of two ways that cross is higher
    works: Works
    trees: float


@dataclass(frozen=True)
class Crossing:
    """Where two ways cross without a junction."""

    upper: int  # index of the way
    lower: int
    x: float  # m
    y: float


@dataclass(frozen=True, eq=False)
class Leg:
    """Vertices from a junction or end to the next one, through nodes where one way continues another."""

    key: int  # of its first feature, and its number there: kept when vertices move
    at: Float64Array  # (n, 2) m
    way: Int64Array  # (n − 1,) index of each segment's way
    nodes: tuple[int, int]  # numbers of its ends
    degrees: tuple[int, int]  # ways that meet there


@dataclass(frozen=True, eq=False)
class WayGraph:
    """All ways as legs between junctions, sorted by `key`."""

    ways: tuple[Way, ...]
    legs: tuple[Leg, ...]
    crossings: tuple[Crossing, ...]


def way_graph(sketch: Sketch) -> WayGraph:
    """Return the graph of a sketch's roads, railways and paths.

    Ways are connected where they share a vertex, and where they cross at one level: a vertex is added there.
    """
    ways: list[Way] = []
    paths: list[Float64Array] = []
    for name in WAY_LAYERS:
        layer = sketch.vectors[name]
        if len(layer):
            ways += _ways(sketch, layer)
            paths += [on_grid(line_path(layer, index)) for index in range(len(layer))]
    paths = [drop_repeats(path) for path in paths]
    whole = [number for number, path in enumerate(paths) if len(path) > 1]
    whole.sort(key=lambda number: ways[number].id)
    ways, paths = [ways[number] for number in whole], [paths[number] for number in whole]
    if not ways:
        return WayGraph((), (), ())
    paths, crossings = _with_crossings(ways, paths)
    return WayGraph(tuple(ways), tuple(_legs(ways, paths)), tuple(crossings))


def _ways(sketch: Sketch, layer: FeatureTable) -> list[Way]:
    name = layer.layer
    numbers = {key: sketch.vector_values(name, key).tolist() for key in _NUMBERS}
    texts = {key: sketch.vector_texts(name, key) for key in ("surface", "structure")}
    halves = (0.5 * sketch.vector_widths(name)).tolist()
    rows = zip(layer.ids.tolist(), halves, *numbers.values(), *texts.values(), strict=True)
    return [
        Way(
            id_of_vector(name, number),
            name,
            half,
            *(shoulder, grade, radius, lean),
            _STRUCTURE[structure],
            storey(int(level), structure),
            Works(cut, fill, surface),
            trees,
        )
        for number, half, shoulder, grade, radius, lean, cut, fill, level, trees, surface, structure in rows
    ]


_NUMBERS = ("shoulder", "grade", "radius", "superelevation", "cut", "fill", "level", "trees")


def _with_crossings(
    ways: Sequence[Way], paths: Sequence[Float64Array]
) -> tuple[list[Float64Array], list[Crossing]]:
    """Return paths with vertices where they meet at one level, and where they cross at different ones."""
    lines = np.array([shapely.LineString(path) for path in paths], object)
    one, other = shapely.STRtree(lines).query(lines, predicate="intersects")
    one, other = one[one < other], other[one < other]
    met = shapely.intersection(lines[one], lines[other])
    met = np.where(np.isin(shapely.get_type_id(met), (1, 5, 7)), shapely.boundary(met), met)  # they overlap
    points, pair = shapely.get_coordinates(met, return_index=True)
    points = on_grid(points)
    known = [set(map(tuple, path.tolist())) for path in paths]
    added: dict[int, list[tuple[float, float]]] = defaultdict(list)
    for number in np.flatnonzero(~shapely.is_simple(lines)).tolist():  # it meets itself
        added[number] += map(tuple, on_grid(shapely.get_coordinates(shapely.node(lines[number]))).tolist())
    crossings = []
    for (x, y), number in zip(points.tolist(), pair.tolist(), strict=True):
        a, b = int(one[number]), int(other[number])
        is_vertex = [(x, y) in known[each] for each in (a, b)]
        if all(is_vertex):
            continue
        storeys = [ways[each].storey for each in (a, b)]
        if storeys[0] != storeys[1]:
            upper, lower = (a, b) if storeys[0] > storeys[1] else (b, a)
            crossings.append(Crossing(upper, lower, x, y))
            continue
        for each, known_here in zip((a, b), is_vertex, strict=True):
            if not known_here:
                added[each].append((x, y))
    paths = list(paths)
    for number, places in added.items():
        paths[number] = _with_vertices(paths[number], np.array(sorted(set(places))))
    return paths, crossings


def _with_vertices(path: Float64Array, places: Float64Array) -> Float64Array:
    """Return a path with vertices added wherever it runs through them."""
    segments = shapely.linestrings(np.stack([path[:-1], path[1:]], axis=1))
    points = shapely.points(places)
    place, segment = shapely.STRtree(segments).query(points, predicate="dwithin", distance=_ON_LINE)
    along = segment + shapely.line_locate_point(segments[segment], points[place], normalized=True)
    order = np.argsort(np.append(np.arange(len(path)), along), kind="stable")
    return drop_repeats(np.concatenate([path, places[place]])[order])


def _legs(ways: Sequence[Way], paths: Sequence[Float64Array]) -> list[Leg]:
    points = np.concatenate(paths)
    counts = np.array([len(path) for path in paths])
    way = np.repeat(np.arange(len(paths)), counts)
    cells = np.rint(points / STEP).astype(np.int64)
    _, node = np.unique(cells[:, 0] * (1 << 36) + cells[:, 1], return_inverse=True)
    node = node.reshape(-1)
    first = np.append(0, np.cumsum(counts))
    is_end = np.zeros(len(points), np.bool_)
    is_end[first[:-1]] = is_end[first[1:] - 1] = True
    degree = np.bincount(node, weights=np.where(is_end, 1.0, 2.0)).astype(np.int64)
    layer_of = np.array([WAY_LAYERS.index(each.layer) for each in ways])[way]
    low, high = np.full(len(degree), len(WAY_LAYERS)), np.full(len(degree), -1)
    np.minimum.at(low, node, layer_of)
    np.maximum.at(high, node, layer_of)
    is_junction = (degree != 2) | (low != high)
    curves: list[
        tuple[int, int]
    ] = []  # (first, last) vertices of pieces between junctions and ends of features
    for number in range(len(paths)):
        start, end = int(first[number]), int(first[number + 1])
        inner = np.flatnonzero(is_junction[node[start + 1 : end - 1]]) + start + 1
        breaks = [start, *inner.tolist(), end - 1]
        curves += pairwise(breaks)
    at_node: dict[int, list[tuple[int, bool]]] = defaultdict(list)
    for number, (a, b) in enumerate(curves):
        at_node[int(node[a])].append((number, False))
        at_node[int(node[b])].append((number, True))
    used = np.zeros(len(curves), np.bool_)
    ordinals = [0] * len(ways)
    legs = []

    def grown(number: int, *, reverse: bool) -> list[tuple[int, bool]]:
        """Return curves, and whether they are reversed, that continue one beyond its last node."""
        found: list[tuple[int, bool]] = []
        while True:
            a, b = curves[number]
            last = int(node[a if reverse else b])
            if is_junction[last]:
                return found
            follow = [each for each in at_node[last] if not used[each[0]]]
            if not follow:
                return found
            number, reverse = follow[0]
            used[number] = True
            found.append((number, reverse))

    for number in range(len(curves)):
        if used[number]:
            continue
        used[number] = True
        after = grown(number, reverse=False)
        before = [(each, not reverse) for each, reverse in grown(number, reverse=True)][::-1]
        chosen = []
        for each, reverse in [*before, (number, False), *after]:
            a, b = curves[each]
            chosen.append(np.arange(b, a - 1, -1) if reverse else np.arange(a, b + 1))
        index = np.concatenate([chosen[0], *(part[1:] for part in chosen[1:])])
        owner = np.concatenate([np.full(len(part) - 1, way[part[0]]) for part in chosen])
        ends = int(node[index[0]]), int(node[index[-1]])
        if ends[0] == ends[1] and np.ptp(points[index], axis=0).max() < _LEAST_LOOP:
            continue
        degrees = int(degree[ends[0]]), int(degree[ends[1]])
        own = int(way[curves[number][0]])
        vector = vector_of(ways[own].id) or 0
        key = (WAY_LAYERS.index(ways[own].layer) << 31 | vector) << _ORDINAL_BITS | ordinals[own]
        ordinals[own] += 1
        legs.append(Leg(key, points[index], owner, ends, degrees))
    return legs


def road_facts(network: RoadNetwork, sketch: Sketch) -> dict[str, Any]:
    """Return a report's entries of a network: lengths in m, grades as rise over run."""
    own = {name: [road for road in network.roads if road.layer == name] for name in WAY_LAYERS}
    own = {name: roads for name, roads in own.items() if roads}
    return {
        "lengths": {name: round(sum(_length(road) for road in roads), 1) for name, roads in own.items()},
        "bridges": _connected(network, BRIDGE),
        "tunnels": _connected(network, TUNNEL),
        **{name: len(built) for name, built in network.lists.items() if name != "roads"},
        "steepest": {name: _steepest(roads, sketch) for name, roads in own.items()},
        "findings": list(network.findings),
    }


def _length(road: Road) -> float:
    return float(road.along[-1] - road.along[0])


def _connected(network: RoadNetwork, structure: int) -> int:
    """Return how many connected groups of parts have a structure: they form no loops."""
    axes = [road.axis for road in network.roads if road.structure == structure]
    return len({axis[end].tobytes() for axis in axes for end in (0, -1)}) - len(axes)


def _steepest(roads: list[Road], sketch: Sketch) -> dict[str, Any]:
    """Return the grade that is the largest share of its limit, and where it is."""
    layer = roads[0].layer
    limits = dict(zip(sketch.vectors[layer].ids.tolist(), sketch.vector_values(layer, "grade"), strict=True))
    slopes = [np.abs(grades(road)) for road in roads]
    shares = [slope.max() / limits[vector_of(road.id)] for road, slope in zip(roads, slopes, strict=True)]
    worst = int(np.argmax(shares))
    road, at = roads[worst], int(slopes[worst].argmax()) % len(roads[worst].axis)
    return {
        "grade": round(float(slopes[worst].max()), 4),
        "limit": round(float(limits[vector_of(road.id)]), 4),
        "vector": vector_of(road.id),
        "position": np.round(road.axis[at, :2], 1).tolist(),
    }
