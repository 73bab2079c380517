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


class AxisPoints(NamedTuple):
    """Points on the axis of a road, from its first station to its last one."""

    position: Float64Array  # (n, 3) m
    left: Float64Array  # (n, 2) horizontal unit normal to the left
    along: Float64Array  # (n,) m, as `Road.along`
    half_width: Float64Array  # (n,) m, as all that follows
    shoulder: Float64Array
    crossfall: Float64Array  # (n, 2)

    def beside(self, offset: Float64Array | float) -> Float64Array:
        """Return points (n, 3) of the surface at offsets (m) from the axis, positive to the left."""
        offset = np.broadcast_to(np.asarray(offset, np.float64), self.along.shape)
        rise = np.where(offset > 0.0, self.crossfall[:, 0], self.crossfall[:, 1]) * np.abs(offset)
        return np.asarray(self.position + np.column_stack([self.left * offset[:, None], rise]))

    def at_distances(self, along: Float64Array) -> AxisPoints:
        """Return points at distances (m) as `along`, beyond the ends on their tangents."""

        def at(values: Float64Array) -> Float64Array:
            columns = values.reshape(len(values), -1).T
            found = np.column_stack([np.interp(along, self.along, each) for each in columns])
            return found.reshape(len(along), *values.shape[1:])

        result = AxisPoints(*(at(values) for values in self))
        beyond = along - np.clip(along, self.along[0], self.along[-1])
        ahead = np.column_stack([result.left[:, 1], -result.left[:, 0]])
        result.position[:, :2] += ahead * beyond[:, None]
        return result._replace(along=along)


def axis_points(road: Road, tolerance: float) -> AxisPoints:
    """Return the stations of a road and points between them.

    The polyline through them, and those along its edges, deviate from the arcs and the profile by at most
    `tolerance` (m).
    """
    start, chord = road.axis[:-1, :2], np.diff(road.axis[:, :2], axis=0)
    length = np.diff(road.along)
    angle = 4.0 * np.arctan(road.bend)  # that the direction turns to the right
    outer = length + np.abs(angle) * np.maximum(road.whole_half[:-1], road.whole_half[1:])
    rise = np.diff(road.axis[:, 2]) - 0.5 * (road.slope[:-1] + road.slope[1:]) * length
    # Sagittas of arcs, and of the two parabolas of a piece that meet in its middle.
    slope_change = np.abs(np.diff(road.slope)) * length / 2.0 + 2.0 * np.abs(rise)
    sagitta = np.maximum(outer * np.abs(angle) / 8.0, slope_change / 4.0)
    counts = np.maximum(np.ceil(np.sqrt(sagitta / tolerance)), 1.0).astype(np.intp)
    piece = np.repeat(np.arange(len(counts)), counts)
    t = (np.arange(len(piece)) - np.repeat(np.cumsum(counts) - counts, counts)) / counts[piece]

    turned, back = 0.5 * angle[piece] * t, 0.5 * angle[piece] * (1.0 - t)
    scale = t * np.sinc(turned / np.pi) / np.sinc(0.5 * angle[piece] / np.pi)
    ahead = chord[piece]
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=-1)
    place = (np.cos(back) * scale)[:, None] * ahead + (np.sin(back) * scale)[:, None] * aside
    position = np.column_stack([start[piece] + place, profile_at(road, piece, t)])
    first = np.cumsum(counts) - counts

    def directions(bearing: Float64Array, of: np.ndarray) -> Float64Array:
        """Return unit normals to the left at angles (to the left) from the chords of pieces."""
        unit = chord[of] / np.maximum(np.hypot(*chord[of].T), 1e-300)[:, None]
        cos, sin = np.cos(bearing), np.sin(bearing)
        return np.stack([-unit[:, 0] * sin - unit[:, 1] * cos, unit[:, 0] * cos - unit[:, 1] * sin], axis=-1)

    left = directions(back - turned, piece)
    ends = directions(-0.5 * angle, np.arange(len(angle)))
    middle = left[first[1:]] + ends[:-1]  # at stations between two pieces
    left[first[1:]] = middle / np.maximum(np.hypot(*middle.T), 1e-300)[:, None]

    def along_pieces(values: Float64Array) -> Float64Array:
        share = t if values.ndim == 1 else t[:, None]
        return np.concatenate([values[piece] * (1.0 - share) + values[piece + 1] * share, values[-1:]])

    position[first] = road.axis[:-1]
    return AxisPoints(
        np.concatenate([position, road.axis[-1:]]),
        np.concatenate([left, ends[-1:]]),
        along_pieces(road.along),
        along_pieces(road.half_width),
        along_pieces(road.shoulder),
        along_pieces(road.crossfall),
    )


def grades(road: Road) -> Float64Array:
    """Return the slope (rise over run) at all stations, then in the middle of all pieces."""
    length = np.diff(road.along)
    middle = 2.0 * np.diff(road.axis[:, 2]) / length - 0.5 * (road.slope[:-1] + road.slope[1:])
    return np.concatenate([road.slope, middle])
