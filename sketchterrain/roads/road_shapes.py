"""Points on the axis of a road and beside it, within a tolerance of its arcs and vertical curves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sketchterrain.array_types import Float64Array
from sketchterrain.roads.road_types import Road, profile_at


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
