"""Bridges and tunnels: where the features ask for them, and where the ground, water or another way does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.roads.alignment import Alignment
from sketchterrain.roads.network import AUTOMATIC, Crossing, Way, WayGraph
from sketchterrain.roads.profile import Profile, ProfileInput, ProfileSolver, StationGraph, nearest_heights
from sketchterrain.roads.road_types import BRIDGE, GROUND, TUNNEL, deck_depth
from sketchterrain.schema.layers import feature_name

CLEARANCE: Final = 4.7
"""Least height (m) between a carriageway and a deck above it."""
FREEBOARD: Final = 1.0
"""Least height (m) of a deck above floods, and of a causeway above water."""
TUNNEL_HEIGHT: Final = 5.5
"""From the carriageway to the top of the tube, m."""
COVER: Final = 3.0
"""Least ground over a tube, m; where there is less, it is a cutting."""

_LEAST_CLEARANCE = 4.5  # m, between a carriageway and a deck, below which a crossing is reported
_MAX_FILL, _ABUTMENT = 12.0, 4.0  # m over the ground from which on a bridge is built, and where it ends
_MAX_CUT = 20.0  # m under the ground from which on a tunnel is built
_SHORTEST = {BRIDGE: 4.0, TUNNEL: 20.0}  # m; shorter ones are ground
_BETWEEN = 15.0  # m; ground between two structures of a kind that is shorter is one of them
_LONGEST_IN_WATER = 1500.0  # m; a longer way in water is a causeway
_BEYOND_WATER, _BEYOND_WAY = 1.0, 2.5  # m from the edge of what is crossed to the abutment
_STOREYS, _NEGLIGIBLE = 4, 1e-3  # times that clearances are asked for, and what they may lack, m
_DECK_COVER = 0.3  # m of ground over a deck from which on it is a road on the ground


_Crossed = tuple[Crossing, int, int]
"""A crossing, and its stations on the upper and on the lower way."""


@dataclass(frozen=True, eq=False)
class Carried:
    """What carries each piece, and the profile."""

    structure: Int64Array  # (n − 1,)
    profile: Profile
    findings: tuple[str, ...]


def carry(
    ways: WayGraph,
    graph: StationGraph,
    line: Alignment,
    ground: Float64Array,
    water: Float64Array,
) -> Carried:
    """Return structures and the profile of stations.

    Parameters
    ----------
    ground : (n,) m, across the carriageway
    water : (n,) level of floods, m; NaN on land
    """
    told: list[str] = []
    asked = np.array([way.structure for way in ways.ways])[line.way]
    is_path = np.array([way.layer == "path" for way in ways.ways])[line.way]
    structure = np.where(line.way < 0, GROUND, np.where(asked == AUTOMATIC, GROUND, asked))
    choose: BoolArray = (line.way >= 0) & (asked == AUTOMATIC)
    none = np.full(len(line.at), np.inf)
    lower, upper = -none, none.copy()
    crossed = [_crossed(crossing, line) for crossing in ways.crossings]
    solver = ProfileSolver(graph, line)
    for crossing, a, b in crossed:
        if TUNNEL not in _beside(structure, b):
            _mark(structure, line, a, _width_below(ways, crossing), BRIDGE, choose)
    in_water = np.isfinite(water)
    causeway = _cross_water(structure, line, in_water, choose, told)
    lower[causeway] = water[causeway] + FREEBOARD
    first = solver.solve(_wanted(structure, line, graph, ground), lower, upper)
    depth = first.height - ground
    bridged = choose & ~is_path
    _mark_runs(structure, line, depth > _MAX_FILL, depth > _ABUTMENT, BRIDGE, bridged)
    _mark_runs(structure, line, -depth > _MAX_CUT, -depth > COVER + TUNNEL_HEIGHT, TUNNEL, bridged)
    _join(structure, line, choose)
    asked_tunnels, opened = structure == TUNNEL, True
    floods = np.where(in_water & ~causeway, water + FREEBOARD, -np.inf)
    while opened:
        wanted = _wanted(structure, line, graph, ground)
        profile = solver.solve(wanted, lower, upper)
        for _ in range(_STOREYS):  # what is above a raised deck is raised after it
            if not _clear(wanted, line, profile.height, floods, crossed, lower, upper):
                break
            profile = solver.solve(wanted, lower, upper)
        result = _trimmed(structure, line, profile.height, ground, {a for _, a, _ in crossed})
        opened = False
        for crossing, a, b in crossed:
            is_open = TUNNEL in _beside(structure, b) and TUNNEL not in _beside(result, b)
            if is_open and BRIDGE not in _beside(structure, a):  # the way above needs a bridge then
                structure[(structure == TUNNEL) & (result == GROUND)] = GROUND
                _mark(structure, line, a, _width_below(ways, crossing), BRIDGE, choose)
                opened = opened or BRIDGE in _beside(structure, a)
    told += _shallow_tunnels(asked_tunnels & (result == GROUND), line)
    told += _low_crossings(ways, result, profile.height, line, crossed)
    return Carried(result, profile, tuple(dict.fromkeys(told)))


def _shallow_tunnels(opened: BoolArray, line: Alignment) -> list[str]:
    """Return a finding about pieces of tunnels that are cuttings, if any."""
    lost = float(line.length[opened].sum())
    what = f"{lost:.0f} m of tunnels have less than {COVER:g} m of ground over them: they are cuttings"
    return [what] if lost else []


def _low_crossings(
    ways: WayGraph,
    structure: Int64Array,
    height: Float64Array,
    line: Alignment,
    crossed: Sequence[_Crossed],
) -> list[str]:
    """Return findings about crossings without enough room."""
    decks = {
        station: deck_depth(line.along[last] - line.along[first])
        for first, last in _runs(structure, line)
        if structure[first] == BRIDGE
        for station in range(first, last + 1)
    }
    found = []
    for crossing, a, b in crossed:
        room = height[a] - height[b] - decks.get(a, 0.0)
        if room < _LEAST_CLEARANCE and TUNNEL not in _beside(structure, b):
            upper, lower = (feature_name(ways.ways[each].id) for each in (crossing.upper, crossing.lower))
            found.append(f"{upper} is {room:.1f} m above {lower}: expected {_LEAST_CLEARANCE} m")
    return found


def _beside(structure: Int64Array, station: int) -> Int64Array:
    """Return the structures of the pieces on both sides of a station."""
    return structure[max(station - 1, 0) : station + 1]


def _width_below(ways: WayGraph, crossing: Crossing) -> float:
    """Return half the length of a bridge over the lower way of a crossing, m."""
    below = ways.ways[crossing.lower]
    return 1.5 * (below.half_width + below.shoulder) + _BEYOND_WAY


def _crossed(crossing: Crossing, line: Alignment) -> _Crossed:
    """Return a crossing with the stations of its two ways that are nearest to it."""
    found = []
    for way in (crossing.upper, crossing.lower):
        pieces = np.flatnonzero(line.way == way)
        stations = np.union1d(pieces, pieces + 1)
        away = ((line.at[stations] - (crossing.x, crossing.y)) ** 2).sum(axis=1)
        found.append(int(stations[np.argmin(away)]))
    return crossing, found[0], found[1]


def _runs(structure: Int64Array, line: Alignment) -> list[tuple[int, int]]:
    """Return the first and last stations of runs of pieces on structures of one kind, by leg."""
    kind = np.where(line.way < 0, GROUND, structure)
    edges = np.flatnonzero(np.diff(np.concatenate([[GROUND], kind, [GROUND]])))
    return [(a, b) for a, b in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True) if kind[a] != GROUND]


def _wanted(
    structure: Int64Array, line: Alignment, graph: StationGraph, ground: Float64Array
) -> ProfileInput:
    """Return what the profile of structures, and on the ground (m) between them, follows."""
    decks = np.array(_runs(structure, line), np.int64).reshape(-1, 2)
    ramps = np.array([_with_ramps(run, graph, line) for run in decks.tolist()], np.int64).reshape(-1, 2)
    is_free = np.zeros(len(line.at), np.bool_)
    for first, last in ramps.tolist():
        is_free[first + 1 : last] = True
    return ProfileInput(nearest_heights(graph, line, ground, is_free), structure.copy(), ramps, decks)


def _with_ramps(run: Sequence[int], graph: StationGraph, line: Alignment) -> tuple[int, int]:
    """Return a run of stations with those that its means reach."""
    first, last = run
    start, end = line.first[line.leg[first]], line.first[line.leg[first] + 1] - 1
    along = line.along
    while first > start and along[run[0]] - along[first] < graph.reach[run[0]]:
        first -= 1
    while last < end and along[last] - along[run[1]] < graph.reach[run[1]]:
        last += 1
    return first, last


def _mark(
    structure: Int64Array, line: Alignment, at: int, wide: float, kind: int, allowed: BoolArray
) -> None:
    """Let the pieces around a station, by a length along its leg, be of a kind."""
    start, end = line.first[line.leg[at]], line.first[line.leg[at] + 1] - 1
    middle = line.along[at]
    near = np.arange(start, end)
    near = near[(line.along[near + 1] > middle - wide) & (line.along[near] < middle + wide)]
    structure[near[allowed[near]]] = kind


def _mark_runs(
    structure: Int64Array, line: Alignment, most: BoolArray, least: BoolArray, kind: int, allowed: BoolArray
) -> None:
    """Let runs of pieces at whose stations `least` holds, and `most` at one of them, be of a kind."""
    inside = least[:-1] & least[1:] & allowed & (structure == GROUND) & (line.way >= 0)
    for first, last in _true_runs(inside):
        is_long = line.along[last] - line.along[first] >= _SHORTEST[kind]
        if is_long and line.leg[first] == line.leg[last] and most[first : last + 1].any():
            structure[first:last] = kind


def _join(structure: Int64Array, line: Alignment, allowed: BoolArray) -> None:
    """Join structures of one kind with little ground between them."""
    runs = _runs(structure, line)
    for (_, first), (last, _) in pairwise(runs):
        same = line.leg[first] == line.leg[last] and structure[first - 1] == structure[last]
        if same and line.along[last] - line.along[first] < _BETWEEN and allowed[first:last].all():
            structure[first:last] = structure[last]


def _true_runs(inside: BoolArray) -> list[tuple[int, int]]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]])))
    return list(zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True))


def _cross_water(
    structure: Int64Array, line: Alignment, in_water: BoolArray, choose: BoolArray, told: list[str]
) -> BoolArray:
    """Bridge the water that ways cross; return the stations of those that stay in it, on a causeway."""
    causeway = np.zeros(len(in_water), np.bool_)
    wet = (in_water[:-1] | in_water[1:]) & (line.way >= 0)
    for start, end in pairwise(line.first.tolist()):
        if not wet[start : end - 1].any():
            continue
        for a, b in _true_runs(wet[start : end - 1]):
            first, last = start + a, start + b
            size = line.along[last] - line.along[first]
            if in_water[first] or in_water[last] or size > _LONGEST_IN_WATER:  # it ends in the water
                causeway[first : last + 1] = True
                told.append("a way ends in water or runs in it: it is on a causeway")
                continue
            while first > start and line.along[start + a] - line.along[first] < _BEYOND_WATER:
                first -= 1
            while last < end - 1 and line.along[last] - line.along[start + b] < _BEYOND_WATER:
                last += 1
            part = np.arange(first, last)
            structure[part[choose[part]]] = BRIDGE
            causeway[part[structure[part] == GROUND]] = True  # as the feature asks
    return causeway


def _clear(
    wanted: ProfileInput,
    line: Alignment,
    height: Float64Array,
    floods: Float64Array,
    crossed: Sequence[_Crossed],
    lower: Float64Array,
    upper: Float64Array,
) -> bool:
    """Set bounds: decks above floods and above what they cross, and this beneath them; return whether any."""
    structure, least, most = wanted.structure, floods.copy(), np.full(len(height), np.inf)
    for _, a, b in crossed:
        is_tunnel = TUNNEL in _beside(structure, b)
        least[a] = max(least[a], height[b] + CLEARANCE) if not is_tunnel else least[a]
        if is_tunnel:
            most[b] = min(most[b], height[a] - TUNNEL_HEIGHT - COVER)
        elif height[a] - height[b] < CLEARANCE and BRIDGE not in _beside(structure, b):
            upper[b] = min(upper[b], height[b])
    found = False
    bounded = np.append(0, np.cumsum(np.isfinite(least) | np.isfinite(most)))
    near = bounded[wanted.decks[:, 1] + 1] > bounded[wanted.decks[:, 0]]
    for (first, last), ends in zip(wanted.decks[near].tolist(), wanted.straight[near].tolist(), strict=True):
        inside = slice(first, last + 1)
        if structure[first] == BRIDGE:
            deck = deck_depth(line.along[last] - line.along[first])
            lack = float((least[inside] + deck - height[inside]).max())
            if lack > _NEGLIGIBLE:
                found = True
                lower[ends] = np.maximum(lower[ends], height[ends]) + lack
        else:
            lack = float((height[inside] - most[inside]).max())
            if lack > _NEGLIGIBLE:
                found = True
                upper[ends] = np.minimum(upper[ends], height[ends]) - lack
    return found


def _trimmed(
    structure: Int64Array,
    line: Alignment,
    height: Float64Array,
    ground: Float64Array,
    above: set[int],
) -> Int64Array:
    """Return structures without tunnels under too little ground, and without decks in the ground.

    Those at stations `above` other ways stay.
    """
    result = structure.copy()
    cover = ground - height
    shallow = np.minimum(cover[:-1], cover[1:]) < COVER + TUNNEL_HEIGHT
    buried = np.minimum(cover[:-1], cover[1:]) > -_DECK_COVER
    buried[[piece for a in above for piece in (a - 1, a) if 0 <= piece < len(buried)]] = False
    result[(structure == TUNNEL) & shallow] = GROUND
    result[(structure == BRIDGE) & buried] = GROUND
    for first, last in _runs(result, line):
        is_short = line.along[last] - line.along[first] < _SHORTEST[int(result[first])]
        if is_short and above.isdisjoint(range(first, last + 1)):
            result[first:last] = GROUND
    return result


def bends_told(ways: Sequence[Way], at: Sequence[tuple[int, float]]) -> list[str]:
    """Return a finding about bends that are too tight: way and radius (m) each."""
    tight = [(radius / ways[way].radius, way, radius) for way, radius in at if radius < ways[way].radius]
    if not tight:
        return []
    _, way, radius = min(tight)
    worst = f"{feature_name(ways[way].id)} {radius:.1f} m, expected {ways[way].radius:g} m"
    return [f"bends tighter than their ways' least radius: {len(tight)}, the tightest of {worst}"]
