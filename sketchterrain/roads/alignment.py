"""Horizontal alignment: the vertices of legs as straights and circular arcs, with stations along them.

Corners are rounded by tangent arcs. Only + - * / and sqrt are used, so that the bits are the same everywhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.roads.network import Leg, Way

MAX_STEP: Final = 10.0
"""Greatest distance of stations (m)."""
_STEP_WIDTHS, _LEAST_STEP = 3.0, 5.0  # step in half widths of the carriageway, and at least, m
_CORNER_WIDTHS, _LEAST_CORNER = 1.0, 1.5  # how far arcs leave vertices: in half widths, and at least, m
_MAX_BEND = 0.13  # tangent of a quarter of an arc's angle
_STRAIGHT = 1e-3  # the same of a corner that is none
_SHORT = 1e-2  # m; shorter straights between arcs are left out


@dataclass(frozen=True, eq=False)
class Alignment:
    """Stations of all legs one after the other; pieces that join two legs have the way −1."""

    at: Float64Array  # (n, 2) m
    bend: Float64Array  # (n − 1,) tangent of a quarter of a piece's angle, positive bulges to the left
    way: Int64Array  # (n − 1,) index of a piece's way; −1 between two legs
    first: Int64Array  # (legs + 1,) first station of each leg, and the end of the last one

    @cached_property
    def chord(self) -> Float64Array:
        """(n − 1, 2) m."""
        return np.diff(self.at, axis=0)

    @cached_property
    def length(self) -> Float64Array:
        """(n − 1,) of pieces along their arcs, m; 0 between legs."""
        b2 = self.bend**2
        series = 1.0 + b2 * (-1.0 / 3.0 + b2 * (1.0 / 5.0 + b2 * (-1.0 / 7.0 + b2 / 9.0)))
        chord = np.sqrt((self.chord**2).sum(axis=1))
        return np.asarray(np.where(self.way < 0, 0.0, chord * (1.0 + b2) * series))

    @cached_property
    def along(self) -> Float64Array:
        """(n,) m from the start of each one's leg."""
        along = np.zeros(len(self.at))
        for first, end in pairwise(self.first.tolist()):  # each for itself: no rounding depends on other legs
            np.cumsum(self.length[first : end - 1], out=along[first + 1 : end])
        return along

    @cached_property
    def leg(self) -> Int64Array:
        """(n,) number of each station's leg."""
        return np.repeat(np.arange(len(self.first) - 1), np.diff(self.first))

    @cached_property
    def curvature(self) -> Float64Array:
        """(n − 1,) of pieces, 1/m, positive turns to the left."""
        b2 = self.bend**2
        angle = -4.0 * self.bend * (1.0 + b2 * (-1.0 / 3.0 + b2 * (1.0 / 5.0 - b2 / 7.0)))
        return np.asarray(np.where(self.way < 0, 0.0, angle / np.maximum(self.length, 1e-9)))

    @cached_property
    def left(self) -> Float64Array:
        """(n, 2) unit normals to the left at stations."""
        own = self.way >= 0
        unit = self.chord / np.maximum(np.sqrt((self.chord**2).sum(axis=1, keepdims=True)), 1e-9)
        aside = np.stack([-unit[:, 1], unit[:, 0]], axis=1)
        b2 = self.bend**2
        cosine, sine = ((1.0 - b2) / (1.0 + b2))[:, None], (2.0 * self.bend / (1.0 + b2))[:, None]
        start, end = aside * cosine - unit * sine, aside * cosine + unit * sine
        total = np.zeros(self.at.shape)
        total[:-1] += start * own[:, None]
        total[1:] += end * own[:, None]
        return np.asarray(total / np.maximum(np.sqrt((total**2).sum(axis=1, keepdims=True)), 1e-9))

    def of_legs(self, legs: Int64Array) -> tuple[Int64Array, Alignment]:
        """Return the numbers of the stations of some legs, and their alignment."""
        count = np.diff(self.first)[legs]
        first = np.append(0, np.cumsum(count))
        at = np.arange(first[-1]) + np.repeat(self.first[legs] - first[:-1], count)
        return at, Alignment(self.at[at], self.bend[at[:-1]], self.way[at[:-1]], first)

    def at_stations(self, values: Float64Array) -> Float64Array:
        """Return the mean of the values of the pieces on both sides of each station, by leg, (n,)."""
        own = (self.way >= 0).astype(np.float64)
        total, count = np.zeros((2, len(self.at)))
        for part in (slice(None, -1), slice(1, None)):
            total[part] += values * own
            count[part] += own
        return np.asarray(total / np.maximum(count, 1.0))


def align(ways: Sequence[Way], legs: Sequence[Leg]) -> tuple[Alignment, Float64Array]:
    """Return stations along legs, and the radius of the arc at each of their vertices, m; inf at straights.

    An arc leaves its vertex by half a carriageway at most, and takes half of the segments beside it.
    """
    counts = np.array([len(leg.at) for leg in legs])
    at = np.concatenate([leg.at for leg in legs])
    leg_ends = np.cumsum(counts)
    segment_way = np.concatenate([np.append(leg.way, -1) for leg in legs])[:-1]
    inner = np.ones(len(at), np.bool_)
    inner[leg_ends - 1] = inner[leg_ends - counts] = False

    step = np.diff(at, axis=0)
    size = np.sqrt((step**2).sum(axis=1))
    unit = step / np.maximum(size, 1e-9)[:, None]
    before, after = unit[:-1], unit[1:]
    cosine = np.clip((before * after).sum(axis=1), -1.0, 1.0)
    cross = before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0]
    half_tangent = np.sqrt((1.0 - cosine) / np.maximum(1.0 + cosine, 1e-9))
    quarter = half_tangent / (1.0 + np.sqrt(1.0 + half_tangent**2))
    widths = np.array([way.half_width for way in ways])[segment_way]
    off = np.maximum(_LEAST_CORNER, _CORNER_WIDTHS * np.minimum(widths[:-1], widths[1:]))
    secant = np.sqrt(1.0 + half_tangent**2) - 1.0
    radius = np.minimum(
        off / np.maximum(secant, 1e-12),
        0.5 * np.minimum(size[:-1], size[1:]) / np.maximum(half_tangent, 1e-12),
    )
    is_arc = inner[1:-1] & (quarter > _STRAIGHT) & (radius > _SHORT)
    tangent = np.zeros(len(at))
    tangent[1:-1] = np.where(is_arc, radius * half_tangent, 0.0)
    bend = np.zeros(len(at))
    bend[1:-1] = np.where(is_arc, np.where(cross > 0.0, -quarter, quarter), 0.0)
    radii = np.full(len(at), np.inf)
    radii[1:-1] = np.where(is_arc, radius, np.where(inner[1:-1] & (quarter > _STRAIGHT), 0.0, np.inf))

    # Each vertex is the start and the end of an arc; those without one are one point.
    entry, leaving = at.copy(), at.copy()
    entry[1:] -= unit * tangent[1:, None]
    leaving[:-1] += unit * tangent[:-1, None]
    ends = np.stack([entry, leaving], axis=1).reshape(-1, 2)
    bends = np.stack([bend, np.zeros(len(at))], axis=1).ravel()[:-1]
    # An arc belongs to the segment before it.
    incoming = np.append(-1, segment_way)
    pieces_way = np.stack([np.where(inner, incoming, -2), np.append(segment_way, -1)], axis=1).ravel()[:-1]
    return _divided(ways, ends, bends, pieces_way), radii


def _divided(ways: Sequence[Way], at: Float64Array, bend: Float64Array, way: Int64Array) -> Alignment:
    """Return pieces without empty ones, halved until none is longer than its step or bends too much."""
    size = np.sqrt((np.diff(at, axis=0) ** 2).sum(axis=1))
    # The last piece of a leg joins it with the next one; where an arc is empty its two ends are one point.
    last = np.append(way[1:] == -2, False)  # whose end is a node
    keep: BoolArray = (way == -1) | ((way >= 0) & ((size > _SHORT) | last))
    station = np.append(True, keep)
    bend, way = bend[keep], way[keep]
    at = at[station]
    half = np.array([each.half_width for each in ways])
    limit = np.clip(_STEP_WIDTHS * half, _LEAST_STEP, MAX_STEP)
    last_station, start, end = at[-1:], at[:-1], at[1:]
    place, share = np.arange(len(way)) << 32, 1 << 32
    done = []
    while len(way):
        chord = end - start
        long = (way >= 0) & ((np.sqrt((chord**2).sum(axis=1)) > limit[way]) | (np.abs(bend) > _MAX_BEND))
        done.append([each[~long] for each in (place, start, bend, way)])
        place, start, end, chord, bend, way = (each[long] for each in (place, start, end, chord, bend, way))
        aside = np.stack([-chord[:, 1], chord[:, 0]], axis=1)
        middle = start + 0.5 * (chord + bend[:, None] * aside)
        start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
        share >>= 1
        place = np.concatenate([place, place + share])
        bend, way = np.tile(bend / (1.0 + np.sqrt(1.0 + bend**2)), 2), np.tile(way, 2)
    place, start, bend, way = (np.concatenate(parts) for parts in zip(*done, strict=True))
    order = np.argsort(place)
    at, bend, way = np.concatenate([start[order], last_station]), bend[order], way[order]
    between = np.flatnonzero(way == -1) + 1
    first = np.concatenate([[0], between, [len(at)]])
    return Alignment(at, np.where(way < 0, 0.0, bend), way, first)
