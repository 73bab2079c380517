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

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numba import njit

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.roads.alignment import Alignment
from sketchterrain.roads.network import Leg, Way

UNIT: Final = 2.0**-16
"""Metres of a whole height."""
_FREE: Final = 1 << 60
_WALL: Final = 1e9  # slope of the derivative where there is no height
_SWEEPS: Final = 200
_SLACK = 0.9995  # of the grade: heights are rounded
_LEAST_MEAN = 1e-3  # m
_BENT = 0.75  # of the squared distance along a bend that is left inside of it
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
                own = _means(part.along, part.first, own, graph.reach[at])
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
    shared = _shared(wanted * UNIT, legs.starts, legs.to, legs.weight * UNIT)
    moved = np.rint(shared / UNIT).astype(np.int64)
    junction = _midst(moved, -moved, legs)
    half = 0.5 * line.length  # of the pieces on both sides of each station
    share = np.where(is_free, 0.0, np.append(half, 0.0) + np.append(0.0, half))
    return np.asarray(
        _least_squares(line.first, ground, share, graph.piece_weight * UNIT, junction[ends] * UNIT)
    )


def _midst(high: Int64Array, low: Int64Array, nodes: _Neighbours) -> Int64Array:
    """Return the mean of the upper envelope of `high` and the lower one of - `low`."""
    return np.asarray((_lower_envelope(high, *nodes) - _lower_envelope(low, *nodes)) >> 1)


@njit(cache=True)
def _shared(height, starts, to, most):  # type: ignore[no-untyped-def]
    """Return heights of junctions, moved in sweeps by their mean excess over the limits of their legs."""
    before, after = height.copy(), height.copy()
    for _ in range(_SWEEPS):
        for i in range(len(height)):
            total, count = 0.0, 0
            for k in range(starts[i], starts[i + 1]):
                apart = before[to[k]] - before[i]
                excess = apart - most[k] if apart > most[k] else apart + most[k]
                if abs(apart) > most[k]:
                    total += excess
                    count += 1
            after[i] = before[i] + (0.5 * total / count if count else 0.0)
        before, after = after, before
    return before


@njit(cache=True)
def _least_squares(first, ground, share, most, ends):  # type: ignore[no-untyped-def]
    """Return heights of the stations of legs with given ends: see 2. in the module's description.

    Knots of the derivative are kept in two stacks, below and above the minimum, each with a common offset.
    """
    found = ground.copy()
    count = 0
    for leg in range(len(first) - 1):
        count = max(count, first[leg + 1] - first[leg])
    place, jump = np.empty((2, 2 * count + 4)), np.empty((2, 2 * count + 4))
    best = np.empty(count)
    for leg in range(len(first) - 1):
        start, last = first[leg], first[leg + 1] - 1
        size = np.array([1, 1])
        offset = np.zeros(2)
        place[0, 0] = place[1, 0] = ends[leg, 0]
        jump[0, 0] = jump[1, 0] = _WALL
        near = np.zeros(2)  # slope of the derivative just below and above the minimum
        middle = ends[leg, 0]
        best[0] = middle
        for i in range(start + 1, last):
            r = most[i - 1]
            for side, sign in ((0, -1.0), (1, 1.0)):
                offset[side] += sign * r
                place[side, size[side]] = middle + sign * r - offset[side]
                jump[side, size[side]] = near[side]
                size[side] += 1
            w = share[i]
            low, high = middle - r, middle + r
            if w <= 0.0:  # the flat part stays
                near[0] = near[1] = 0.0
            else:
                aim = ground[i]
                near[0] = near[1] = w
                side = 1 if aim > high else 0
                if low <= aim <= high:
                    middle = aim
                else:
                    # From the flat part's end to where the derivative w (z - aim) + … is 0.
                    other = 1 - side
                    sign = 1.0 if side == 1 else -1.0
                    at, value, slope = (high if side == 1 else low), 0.0, w
                    value = sign * w * (at - aim)  # below 0
                    while True:
                        # The knot at `at` is the top of this side's stack: it goes to the other one.
                        size[side] -= 1
                        edge = jump[side, size[side]]
                        place[other, size[other]] = at - offset[other]
                        jump[other, size[other]] = -edge
                        size[other] += 1
                        slope += edge
                        target = at - sign * value / slope
                        if size[side] > 0:
                            following = place[side, size[side] - 1] + offset[side]
                            if sign * (target - following) > 0.0:
                                value += slope * sign * (following - at)
                                at = following
                                continue
                        middle = target
                        break
                    near[0] = near[1] = slope
            best[i - start] = middle
        found[start], found[last] = ends[leg, 0], ends[leg, 1]
        for i in range(last - 1, start, -1):
            found[i] = min(max(best[i - start], found[i + 1] - most[i]), found[i + 1] + most[i])
    return found


def _highest(graph: StationGraph, upper: Float64Array, before: Int64Array) -> Int64Array:
    """Return the greatest heights (units) of nodes within upper bounds (m) and the limits of grade.

    `before` are those of bounds that were nowhere lower.
    """
    bound = np.flatnonzero(np.isfinite(upper))
    at_nodes = before.copy()
    np.minimum.at(at_nodes, graph.node[bound], np.rint(upper[bound] / UNIT).astype(np.int64))
    if np.array_equal(at_nodes, before):
        return before
    return np.asarray(_lower_envelope(at_nodes, *graph.neighbours))


@njit(cache=True)
def _lower_envelope(values, starts, to, weight):  # type: ignore[no-untyped-def]
    """Return the greatest function below values that rises by at most the weight along each edge."""
    found = values.copy()
    count = len(found)
    queue = np.zeros(count, np.int64)  # a ring
    waiting = values < _FREE
    head, size = 0, 0
    for i in range(count):
        if waiting[i]:
            queue[size] = i
            size += 1
    while size > 0:
        here = queue[head]
        head = (head + 1) % count
        size -= 1
        waiting[here] = False
        for k in range(starts[here], starts[here + 1]):
            other = found[here] + weight[k]
            if other < found[to[k]]:
                found[to[k]] = other
                if not waiting[to[k]]:
                    waiting[to[k]] = True
                    queue[(head + size) % count] = to[k]
                    size += 1
    return found


@njit(cache=True)
def _means(along, first, height, reach):  # type: ignore[no-untyped-def]
    """Return means of piecewise linear heights over ± half of a reach, at the stations of each leg."""
    found = height.copy()
    integral = np.zeros(len(height))
    for leg in range(len(first) - 1):
        start, last = first[leg], first[leg + 1] - 1
        for i in range(start, last):
            piece = along[i + 1] - along[i]
            integral[i + 1] = integral[i] + 0.5 * piece * (height[i] + height[i + 1])
        left = right = start
        for i in range(start, last + 1):
            half = 0.5 * reach[i]
            if half < _LEAST_MEAN:
                continue
            while left < last - 1 and along[left + 1] <= along[i] - half:
                left += 1
            while right < last - 1 and along[right + 1] <= along[i] + half:
                right += 1
            total = 0.0
            for side, k in ((1.0, right), (-1.0, left)):
                x = along[i] + side * half - along[k]
                rise = (height[k + 1] - height[k]) / (along[k + 1] - along[k])
                total += side * (integral[k] + x * (height[k] + 0.5 * x * rise))
            found[i] = total / (2.0 * half)
    return found


@njit(cache=True)
def united_reach(along, first, reach):  # type: ignore[no-untyped-def]
    """Return how far beside stations all discs of a reach around stations of their leg extend.

    Where the nearest station does not reach, no other one does, unless inside of bends that are tighter than
    four reaches: earthworks end without steps.
    """
    found = reach.copy()
    most = reach.max()
    for leg in range(len(first) - 1):
        for i in range(first[leg], first[leg + 1]):
            for step in (-1, 1):
                j = i + step
                while first[leg] <= j < first[leg + 1]:
                    apart = _BENT * (along[j] - along[i]) ** 2
                    if apart > most * most:
                        break
                    found[i] = max(found[i], (max(reach[j] ** 2 - apart, 0.0)) ** 0.5)
                    j += step
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
