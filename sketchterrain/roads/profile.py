"""Longitudinal profiles of a network: heights within every limit of grade, equal where ways meet.

1. Junctions: their ground, moved until no leg between two of them exceeds its grade, by sweeps that share
   each excess between both ends; what is left of it by the mean of the envelopes of 3.
2. Legs between them: the least squares of the distance from the ground within the limits, exactly, by dynamic
   programming: f(i + 1, z) = w (z - ground)² + min of f(i, z') over |z' - z| <= g d. The derivative of f is
   piecewise linear; each step moves its parts below and above the minimum apart by g d.
3. Bounds at some stations hold along the network by envelopes: U(i) = min over j of u(j) + g d(i, j), and L
   from below. A median of functions that keep the limit keeps it.
4. Structures are straight, and so are their ramps, as far as means reach.
5. Means over ± h along a leg, twice, round the profile. They keep the limit where h itself changes by no
   more than its distance; h is 0 at junctions.

Only + - * / are used, and every leg is solved for itself: the bits are the same everywhere, and an edit
changes a leg, and others as far as heights of junctions change.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.host.library import host_function
from sketchterrain.roads.alignment import Alignment
from sketchterrain.roads.network import Leg, Way

UNIT: Final = 2.0**-16
"""Metres of a whole height."""
_FREE: Final = 1 << 60
_SLACK = 0.9995  # of the grade: heights are rounded
_SMOOTH, _SMOOTH_RADII = (10.0, 40.0), 0.5  # m of the means, within this range by the least radius


class _Neighbours(NamedTuple):
    """The neighbours of nodes, one node after the other."""

    starts: Int64Array  # (nodes + 1,) of those of each node
    to: Int64Array
    weight: Int64Array  # greatest difference of height, units

    @classmethod
    def from_edges(cls, ends: Int64Array, weight: Int64Array, count: int) -> _Neighbours:
        """Return the neighbours of so many nodes by edges (2, n) of a weight, which lead both ways."""
        source, target = ends.ravel(), ends[::-1].ravel()
        order = np.argsort(source, kind="stable")
        starts = np.append(0, np.cumsum(np.bincount(source, minlength=count)))
        return cls(starts, target[order], np.tile(weight, 2)[order])


@dataclass(frozen=True, eq=False)
class StationGraph:
    """Stations as a graph: those at the ends of legs are one node where legs meet."""

    node: Int64Array  # (n,) of each station
    neighbours: _Neighbours
    piece_weight: Int64Array  # (n − 1,) the same of pieces
    reach: Float64Array  # (n,) m over which means are taken at most
    limit: Float64Array  # (n − 1,) greatest slope of pieces; NaN between legs


def station_graph(ways: Sequence[Way], legs: Sequence[Leg], line: Alignment) -> StationGraph:
    """Return the graph of an alignment's stations with the limits of grade between them."""
    node = np.arange(len(line.at))
    ends = np.concatenate([line.first[:-1], line.first[1:] - 1])
    names = np.array([leg.nodes for leg in legs], np.int64).T.ravel()
    _, number = np.unique(names, return_inverse=True)
    node[ends] = len(node) + number.reshape(-1)
    used, node = np.unique(node, return_inverse=True)
    node = node.reshape(-1)
    own = line.way >= 0
    grade = np.array([way.grade for way in ways])
    limit = np.where(own, grade[line.way], np.nan)
    # Slopes at stations are means of those beside them: the piece before a stricter one keeps its limit.
    strict = limit.copy()
    strict[:-1] = np.fmin(strict[:-1], limit[1:])
    strict[1:] = np.fmin(strict[1:], limit[:-1])
    limit = np.where(own, strict, np.nan)
    weight = np.floor(np.where(own, limit * line.length, 0.0) * (_SLACK / UNIT)).astype(np.int64)
    ends = np.stack([node[:-1][own], node[1:][own]])
    neighbours = _Neighbours.from_edges(ends, weight[own], len(used))
    return StationGraph(node, neighbours, weight, _mean_reach(ways, line, limit), limit)


def _mean_reach(ways: Sequence[Way], line: Alignment, limit: Float64Array) -> Float64Array:
    """Return the distance of means: at most that to an end where legs meet, or where the limit changes."""
    most = np.clip(_SMOOTH_RADII * np.array([way.radius for way in ways]), *_SMOOTH)
    of_piece = np.where(line.way >= 0, most[line.way], np.inf)
    least = np.minimum.reduceat(np.append(of_piece, np.inf), line.first[:-1])[line.leg]
    is_break = np.zeros(len(line.at), np.bool_)
    is_break[line.first[:-1]] = is_break[line.first[1:] - 1] = True
    is_break[1:-1] |= (limit[1:] != limit[:-1]) & (line.leg[2:] == line.leg[:-2])
    place = np.flatnonzero(is_break)
    station = np.arange(len(line.at))
    after = place[np.minimum(np.searchsorted(place, station), len(place) - 1)]
    before = place[np.searchsorted(place, station, side="right") - 1]
    along = line.along
    return np.asarray(np.minimum(least, np.minimum(along - along[before], along[after] - along)))


@dataclass(frozen=True, eq=False)
class Profile:
    """Heights and slopes at stations: vertical curves are parabolas around them."""

    height: Float64Array  # (n,) m
    slope: Float64Array  # (n,)
    violation: Float64Array  # (n,) m by which bounds contradict each other at a station


class ProfileInput(NamedTuple):
    """What a profile follows but bounds."""

    nearest: Float64Array  # (n,) heights within the limits of grade, m
    structure: Int64Array  # (n − 1,) of pieces, on which the following depend
    straight: Int64Array  # (k, 2) stations between which it is straight before means are taken
    decks: Int64Array  # (k, 2) the same of structures without their ramps: they stay straight


class ProfileSolver:
    """Profiles of stations within bounds that become closer: legs that nothing changes keep their parts."""

    def __init__(self, graph: StationGraph, line: Alignment) -> None:
        self._graph, self._line = graph, line
        self._high, self._low = np.full((2, len(graph.neighbours.starts) - 1), _FREE)
        self._structure, self._height = np.full(len(line.way), -1), np.full(len(line.at), np.nan)
        self._found = np.zeros((2, len(line.at)))

    def solve(self, wanted: ProfileInput, lower: Float64Array, upper: Float64Array) -> Profile:
        """Return the profile within bounds (n,), m, nowhere wider than the last ones; infinite: none."""
        graph, line = self._graph, self._line
        self._high, self._low = _highest(graph, upper, self._high), _highest(graph, -lower, self._low)
        high, low = self._high[graph.node], -self._low[graph.node]
        contrary = low > high
        whole = np.clip(np.rint(wanted.nearest / UNIT).astype(np.int64), low, np.maximum(low, high))
        height = np.where(contrary, (low + high) >> 1, whole) * UNIT
        changed = height != self._height
        changed[:-1] |= wanted.structure != self._structure
        self._structure, self._height, self._found = wanted.structure, height, self._found.copy()
        legs = np.unique(line.leg[changed])
        if legs.size:
            at, part = line.of_legs(legs)
            number = np.full(len(changed), -1)
            number[at] = np.arange(len(at))
            own, limit = height[at], graph.limit[at[:-1]]
            _straighten(own, number[wanted.straight], part, limit)
            for _ in range(2):
                (mean, integral), reach = np.empty((2, len(own))), graph.reach[at]
                host_function("mean_heights")(len(legs), part.along, part.first, own, reach, mean, integral)
                own = mean
            _straighten(own, number[wanted.decks], part, limit)
            self._found[:, at] = _parabolas(part, own)
        height, slope = self._found
        return Profile(height, slope, np.where(contrary, (low - high) * UNIT, 0.0))


def _straighten(height: Float64Array, runs: Int64Array, line: Alignment, limits: Float64Array) -> None:
    """Let heights be linear from the first to the last stations of runs, in place; −1 are not of these."""
    for first, last in runs[runs[:, 0] >= 0].tolist():
        rise, size, limit = height[last] - height[first], line.length[first:last], limits[first:last]
        if abs(rise) > limit.min() * size.sum():  # stricter parts are less steep than others
            size = limit * size
        height[first + 1 : last] = height[first] + rise * np.cumsum(size)[:-1] / max(size.sum(), 1e-9)


def nearest_heights(
    graph: StationGraph, line: Alignment, ground: Float64Array, is_free: BoolArray
) -> Float64Array:
    """Return heights (n,), m, within the limits of grade that are nearest to the ground, without bounds.

    `is_free` are stations at which the ground does not matter: those on structures.
    """
    ends = np.stack([graph.node[line.first[:-1]], graph.node[line.first[1:] - 1]], axis=1)
    rise = np.append(0, np.cumsum(graph.piece_weight))
    most = rise[line.first[1:] - 1] - rise[line.first[:-1]]
    names, number = np.unique(ends, return_inverse=True)
    ends = number.reshape(ends.shape)
    legs = _Neighbours.from_edges(ends.T, most, len(names))
    data, known = np.zeros(len(names)), np.zeros(len(names), np.bool_)
    for station in (line.first[:-1], line.first[1:] - 1):
        at = np.searchsorted(names, graph.node[station])
        data[at] = ground[station]
        known[at[~is_free[station]]] = True
    whole = np.rint(data / UNIT).astype(np.int64)
    wanted = _midst(np.where(known, whole, _FREE), np.where(known, -whole, _FREE), legs)
    wanted = np.where(known | (np.abs(wanted) >= _FREE >> 1), whole, wanted)
    shared = wanted * UNIT
    host_function("share_excess")(legs.starts, legs.to, legs.weight * UNIT, shared, np.empty_like(shared))
    moved = np.rint(shared / UNIT).astype(np.int64)
    junction = _midst(moved, -moved, legs)
    half = 0.5 * line.length  # of the pieces on both sides of each station
    share = np.where(is_free, 0.0, np.append(half, 0.0) + np.append(0.0, half))
    found, scratch = np.empty_like(ground), np.empty((4, 2 * np.diff(line.first).max() + 4))
    given = line.first, ground, share, graph.piece_weight * UNIT, junction[ends] * UNIT
    host_function("least_squares")(*given, found, scratch)
    return found


def _midst(high: Int64Array, low: Int64Array, nodes: _Neighbours) -> Int64Array:
    """Return the mean of the upper envelope of `high` and the lower one of - `low`."""
    return np.asarray((_lower_envelope(high, nodes) - _lower_envelope(low, nodes)) >> 1)


def _highest(graph: StationGraph, upper: Float64Array, before: Int64Array) -> Int64Array:
    """Return the greatest heights (units) of nodes within upper bounds (m) and the limits of grade.

    `before` are those of bounds that were nowhere lower.
    """
    bound = np.flatnonzero(np.isfinite(upper))
    at_nodes = before.copy()
    np.minimum.at(at_nodes, graph.node[bound], np.rint(upper[bound] / UNIT).astype(np.int64))
    if np.array_equal(at_nodes, before):
        return before
    return _lower_envelope(at_nodes, graph.neighbours)


def _lower_envelope(values: Int64Array, nodes: _Neighbours) -> Int64Array:
    """Return the greatest function below values that rises by at most the weight along each edge."""
    found, queue = np.empty((2, len(values)), np.int64)
    host_function("lower_envelope")(values, *nodes, _FREE, found, queue, np.empty(len(values), np.bool_))
    return found


def united_reach(along: Float64Array, first: Int64Array, reach: Float64Array) -> Float64Array:
    """Return how far beside stations all discs of a reach around stations of their leg extend.

    Where the nearest station does not reach, no other one does, unless inside of bends that are tighter than
    four reaches: earthworks end without steps.
    """
    found = np.empty_like(reach)
    host_function("united_reaches")(len(first) - 1, along, first, reach, found)
    return found


def _parabolas(line: Alignment, height: Float64Array) -> tuple[Float64Array, Float64Array]:
    """Return heights and slopes at stations of the parabolas that touch the middles of all pieces."""
    own = line.way >= 0
    length = np.where(own, np.maximum(line.length, 1e-9), 1.0)
    rise = np.where(own, np.diff(height) / length, 0.0)
    slope, result = np.zeros(len(height)), height.copy()
    slope[:-1] += np.where(own, rise, 0.0)
    slope[1:][~np.append(own[1:], False)] = rise[~np.append(own[1:], False)]
    both = np.flatnonzero(own[:-1] & own[1:])  # pieces on both sides of station both + 1
    before, after = length[both], length[both + 1]
    change = rise[both + 1] - rise[both]
    slope[both + 1] = rise[both] + change * after / (before + after)
    result[both + 1] += change * before * after / (4.0 * (before + after))
    return result, slope
