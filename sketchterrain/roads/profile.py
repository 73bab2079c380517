"""Longitudinal profiles of a network: heights within every limit of grade, equal where ways meet.

Heights are whole numbers of `UNIT`, and so are the rises that pieces allow. No equations are solved: the
bits are the same everywhere, and a change of the ground reaches no farther than its cone of slopes.

1. Of all heights within the grade of every given one, U is the lowest upper, and L the greatest lower
   envelope: U(i) = min over j of z(j) + g d(i, j), L(i) = max over j of z(j) - g d(i, j), with d along the
   network. Both, and (U + L) / 2, keep the limit.
2. Bounds at some stations have envelopes of their own; a median of functions that keep the limit keeps it.
3. Structures are straight, and so are their ramps, as far as means reach.
4. Means over ± h along a leg, twice, round the profile. They keep the limit where h itself changes by no
   more than its distance; h is 0 at junctions.
"""

# mypy: disable-error-code="untyped-decorator"

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.roads.alignment import Alignment
from sketchterrain.roads.network import Leg, Way

UNIT: Final = 2.0**-16
"""Metres of a whole height."""
_FREE: Final = 1 << 60
_SLACK = 0.9995  # of the grade: heights are rounded
_LEAST_MEAN = 1e-3  # m
_SMOOTH, _SMOOTH_RADII = (10.0, 40.0), 0.5  # m of the means, within this range by the least radius


@dataclass(frozen=True, eq=False)
class StationGraph:
    """Stations as a graph: those at the ends of legs are one node where legs meet."""

    node: Int64Array  # (n,) of each station
    count: int
    starts: Int64Array  # (nodes + 1,) of the neighbours of each node
    to: Int64Array
    weight: Int64Array  # greatest difference of height, units
    reach: Float64Array  # (n,) m over which means are taken at most


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
    weight = np.floor(np.where(own, limit * line.length, 0.0) * (_SLACK / UNIT)).astype(np.int64)
    a, b = node[:-1][own], node[1:][own]
    source, target, both = np.append(a, b), np.append(b, a), np.tile(weight[own], 2)
    order = np.argsort(source, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(source, minlength=len(used))))
    return StationGraph(node, len(used), starts, target[order], both[order], _mean_reach(ways, line, limit))


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
    violation: Float64Array  # (n,) m by which bounds contradict each other at a station's node


def solve_profile(
    graph: StationGraph,
    line: Alignment,
    ground: Float64Array,
    is_free: BoolArray,
    straight: Sequence[tuple[int, int]],
    lower: Float64Array,
    upper: Float64Array,
) -> Profile:
    """Return the profile of stations.

    Parameters
    ----------
    ground : (n,) heights that it is to be near to, m
    is_free : (n,) stations at which they do not matter: those on structures
    straight : first and last stations between which it is straight
    lower, upper : (n,) bounds, m; infinite where there are none
    """
    free = np.zeros(graph.count, np.bool_)
    free[graph.node[is_free]] = True
    free[graph.node[~is_free]] = False
    wanted = _at_nodes(graph, ground)
    high = _envelope(np.where(free, _FREE, wanted), graph)
    low = -_envelope(np.where(free, _FREE, -wanted), graph)
    bound_high = _envelope(_at_nodes(graph, upper, np.minimum, _FREE), graph)
    bound_low = -_envelope(-_at_nodes(graph, lower, np.maximum, -_FREE), graph)
    alone = high >= _FREE  # a network without ground, on structures as a whole
    middle = np.where(alone, wanted, (high + low) >> 1)
    contrary = bound_low > bound_high
    node_height = np.where(
        contrary, (bound_low + bound_high) >> 1, np.clip(middle, bound_low, np.maximum(bound_low, bound_high))
    )
    height = node_height[graph.node] * UNIT
    along = line.along
    for first, last in straight:
        share = (along[first : last + 1] - along[first]) / max(along[last] - along[first], 1e-9)
        height[first : last + 1] = height[first] + share * (height[last] - height[first])
    for _ in range(2):
        height = _means(along, line.first, height, graph.reach)
    violation = np.where(contrary, (bound_low - bound_high) * UNIT, 0.0)[graph.node]
    return Profile(*_parabolas(line, height), violation)


def _at_nodes(
    graph: StationGraph, values: Float64Array, reduce: np.ufunc = np.maximum, none: int = -_FREE
) -> Int64Array:
    """Return values (m) of stations as whole units at their nodes; infinite ones are `none`."""
    finite = np.isfinite(values)
    whole = np.where(finite, np.rint(np.where(finite, values, 0.0) / UNIT), none).astype(np.int64)
    found = np.full(graph.count, none)
    reduce.at(found, graph.node, whole)
    return found


def _envelope(values: Int64Array, graph: StationGraph) -> Int64Array:
    return np.asarray(_lower_envelope(values, graph.starts, graph.to, graph.weight))


@njit(cache=True)
def _lower_envelope(values, starts, to, weight):  # type: ignore[no-untyped-def]
    """Return the greatest function below values that rises by at most the weight along each edge."""
    found = values.copy()
    count = len(found)
    queue = np.arange(count)  # a ring
    waiting = np.ones(count, np.bool_)
    head, size = 0, count
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
    slope[both + 1] = rise[both] + change * before / (before + after)
    result[both + 1] += change * before * after / (4.0 * (before + after))
    return result, slope
