"""Roads as the terrain, pictures and exports know them: axis, profile and cross-section; pads; walls."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.schema.layers import STANDING_LAYERS

GROUND, BRIDGE, TUNNEL = range(3)
STRUCTURES: Final = ("ground", "bridge", "tunnel")
"""What carries a road, by number."""


class Works(NamedTuple):
    """How a road or pad shapes the ground beside it."""

    cut: float  # rise over run of the slopes of cuttings
    fill: float  # … and of embankments
    surface: str  # material


@dataclass(frozen=True, eq=False)
class Road:
    """A part of a road, railway or path with one structure, of one vector feature.

    Station i and i + 1 are joined by a circular arc, along which the slope is piecewise linear: from `slope`
    at its ends to one in its middle (`profile_at`). Parts of one `leg`, from a junction to the next one,
    follow each other by `part`: the last station of one is the first of the next, bit for bit.
    """

    id: int  # of the feature: `document.layers.id_of_vector`
    layer: str  # road, railway or path
    leg: int  # number of the leg that it is a part of, below 2⁵³
    part: int  # along the leg
    structure: int  # GROUND, BRIDGE or TUNNEL
    axis: Float64Array  # (m, 3) stations x, y and height of the surface there, m; m ≥ 2
    bend: Float64Array  # (m − 1,) tangent of a quarter of each arc's angle, positive bulges to the left
    along: Float64Array  # (m,) m from the leg's start, along the arcs
    slope: Float64Array  # (m,) rise over run at stations
    half_width: Float64Array  # (m,) m, of the carriageway
    shoulder: Float64Array  # (m,) m, beyond it
    crossfall: Float64Array  # (m, 2) rise over run from the axis to the left and to the right
    reach: Float64Array  # (m,) m from the axis beyond which the ground is unchanged
    deepest: Float64Array  # (m,) m by which the ground changes at most, as far as samples of it show
    works: Works
    trees: float = 0.0  # m between trees along it; 0: none
    ends: tuple[int, int] = (2, 2)  # ways that meet at its first and last station; 1: a dead end

    @property
    def whole_half(self) -> Float64Array:
        """Half the width with shoulders, (m,), m."""
        return self.half_width + self.shoulder


def deck_depth(span: float) -> float:
    """Return the height (m) of a bridge's deck and its beams, of a span (m)."""
    return min(max(0.5, span / 25.0), 2.0)


@dataclass(frozen=True, eq=False)
class Pad:
    """Level ground for a building."""

    id: int
    outline: Float64Array  # (n, 2) m, counter-clockwise, without its first vertex again
    level: float  # m
    reach: float  # m from the outline beyond which the ground is unchanged
    building: float  # m, height of a building on it; 0: none
    works: Works


@dataclass(frozen=True, eq=False)
class LineObject:
    """What stands along a line on the ground: a wall, a hedge, a power line."""

    id: int
    layer: str
    line: Float64Array  # (n, 2) m
    values: Mapping[str, Any]  # by the names of the layer's parameters


@dataclass(frozen=True, eq=False)
class RoadNetwork:
    """All that roads, pads and what stands along lines are, and findings about them in words."""

    roads: tuple[Road, ...] = ()
    pads: tuple[Pad, ...] = ()
    standing: tuple[LineObject, ...] = ()
    findings: tuple[str, ...] = ()

    @property
    def lists(self) -> dict[str, Sequence[Road | Pad | LineObject]]:
        """All of it by names of lists, as in features.json."""
        names = {each: f"{each}s" for each in STANDING_LAYERS}
        standing = {of: [each for each in self.standing if each.layer == name] for name, of in names.items()}
        return {"roads": self.roads, "pads": self.pads, **standing}


NO_ROADS: Final = RoadNetwork()


def profile_at(road: Road, piece: int | np.ndarray, t: Float64Array) -> Float64Array:
    """Return heights (m) of the axis at shares t, 0 … 1, of pieces.

    The slope is linear from each end to the middle of a piece (parabolic vertical curves).
    """
    after = np.asarray(piece) + 1
    length = road.along[after] - road.along[piece]
    rises = road.slope[piece] * length, road.slope[after] * length
    return vertical_curve(road.axis[piece, 2], road.axis[after, 2], *rises, t)


def vertical_curve(
    start: Float64Array, end: Float64Array, first: Float64Array, last: Float64Array, t: Float64Array
) -> Float64Array:
    """Return heights at shares t of pieces from a height to another, whose ends rise by so much a piece."""
    middle = 2.0 * (end - start) - 0.5 * (first + last)
    s = 1.0 - t
    rising = start + t * (first + (middle - first) * t)
    falling = end - s * (last + (middle - last) * s)
    return np.asarray(np.where(t < 0.5, rising, falling))
