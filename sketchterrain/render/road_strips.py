"""Roads on the ground as straight pieces with levels of detail, for road_strip.vert.glsl."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING, Final

import numpy as np

from sketchterrain.array_types import Float32Array, Float64Array, Int64Array
from sketchterrain.look.road_meshes import CHORD, SHOULDER, track_spacing
from sketchterrain.roads.road_shapes import AxisPoints, axis_points
from sketchterrain.roads.road_types import GROUND, Road
from sketchterrain.tiles.lod import inside_frustum

if TYPE_CHECKING:
    from sketchterrain.render.camera import Camera

PIECES: Final = 16  # of a road in a chunk
STEPS: Final = (1, 2, 4, 8, 16)  # pieces that one stands for, by level of detail
DEVIATION: Final = 0.4  # px, of a coarser level
LEAST: Final = 0.25  # px; narrower roads and smaller objects are left out
_REACH: Final = (2.0, 0.04)  # m, and per m of distance, that the ground may be off a road's surface
_RANK: Final = {"path": 1, "railway": 2, "road": 3}  # of surfaces that lie on each other; shoulders: 0
_CUT, _ROUND, _LONGER = 0.0, 1.0, 2.0  # kinds of ends, as in road_strip.glsl


@dataclass(frozen=True)
class Chunks:
    """Boxes of things that are drawn together, and their ranges of a buffer by level of detail.

    Columns of n chunks; the corners are (n, 3), the error, first and count (n, levels).
    """

    low: Float64Array  # corners, m
    high: Float64Array
    width: Float64Array  # m, of the widest thing; narrow ones are left out
    unit: Float64Array  # m, size by which they are near or far
    rank: Int64Array  # order of drawing
    error: Float64Array  # m, largest deviation from the finest level
    first: Int64Array
    count: Int64Array

    @classmethod
    def joined(cls, chunks: Sequence[Chunks], starts: Sequence[int]) -> Chunks:
        """Return all chunks, their ranges moved to the starts of their parts of a buffer."""
        columns = {
            field.name: np.concatenate([getattr(each, field.name) for each in chunks])
            for field in fields(cls)
        }
        columns["first"] = columns["first"] + np.repeat(starts, [len(each.low) for each in chunks])[:, None]
        return cls(**columns)

    def visible(self, camera: Camera, aspect: float, pixel: float) -> tuple[Int64Array, Float64Array]:
        """Return the chunks in view, in the order of drawing, and their distances (m); `pixel` is in rad."""
        outside = np.maximum(np.maximum(self.low - camera.eye, camera.eye - self.high), 0.0)
        away = np.linalg.norm(outside, axis=1)
        more = np.outer(_REACH[0] + _REACH[1] * away, [0.0, 0.0, 1.0])
        seen = inside_frustum(camera.frustum(aspect), self.low - more, self.high + more)
        index = np.flatnonzero(seen & (self.width > LEAST * pixel * away))
        index = index[np.argsort(self.rank[index], kind="stable")]
        return index, away[index]


@dataclass(frozen=True)
class Strips:
    """Pieces of roads, rows of start, end, left, width and look of road_strip.vert.glsl, and their chunks."""

    rows: Float32Array  # (n, 20)
    chunks: Chunks


def road_strips(
    road: Road, neighbours: tuple[int, int], layers: Mapping[str, int], origin: Float64Array
) -> list[Strips]:
    """Return the strips of a road's shoulders and surface, relative to an origin (m).

    `neighbours` are the structures of the parts before and after it, `layers` the textures by material.
    """
    points = axis_points(road, CHORD)
    ends = [
        _LONGER if structure != GROUND else _ROUND if ways > 2 else _CUT
        for structure, ways in zip(neighbours, road.ends, strict=True)
    ]
    whole = points.half_width + points.shoulder
    surface = _strips(
        points, points.half_width, ends, origin, (layers[road.works.surface], track_spacing(road))
    )
    surface.chunks.rank[:] = _RANK[road.layer]
    if not road.shoulder.any():
        return [surface]
    return [_strips(points, whole, ends, origin, (layers[SHOULDER], 0.0)), surface]


def _strips(
    points: AxisPoints,
    half_width: Float64Array,
    ends: Sequence[float],
    origin: Float64Array,
    look: tuple[int, float],
) -> Strips:
    last = len(points.along) - 1
    values = np.column_stack([points.position - origin, points.along, points.left, half_width])
    count = -(-last // PIECES)
    error, first, number = np.zeros((3, count, len(STEPS)))
    rows, start = [], 0
    for level, step in enumerate(STEPS):
        index = np.append(np.arange(0, last, step), last)
        a, b = values[index[:-1]], values[index[1:]]
        row = np.zeros((len(a), 20), np.float32)
        row[:, :4], row[:, 4:8] = a[:, :4], b[:, :4]
        row[:, 8:10], row[:, 10:12] = a[:, 4:6], b[:, 4:6]
        row[:, 12], row[:, 13], row[:, 14:16] = a[:, 6], b[:, 6], points.crossfall[index[:-1]]
        row[:, 16:18] = look
        row[0, 18], row[-1, 19] = ends
        rows.append(row)
        at = np.arange(last) // step
        share = (values[:last, 3] - a[at, 3]) / np.maximum(b[at, 3] - a[at, 3], 1e-9)
        off = values[:last, :3] - a[at, :3] - share[:, None] * (b[at, :3] - a[at, :3])
        np.maximum.at(error[:, level], np.arange(last) // PIECES, np.linalg.norm(off, axis=1))
        number[:, level] = np.bincount(index[:-1] // PIECES, minlength=count)
        first[:, level] = start + np.cumsum(number[:, level]) - number[:, level]
        start += len(a)
    edges = np.arange(0, last, PIECES)
    corners = np.array([points.position[k : k + PIECES + 1].min(axis=0) for k in edges])
    high = np.array([points.position[k : k + PIECES + 1].max(axis=0) for k in edges])
    widest = float(half_width.max())
    return Strips(
        np.concatenate(rows),
        Chunks(
            corners - widest,
            high + widest,
            np.full(count, 2.0 * widest),
            np.full(count, 2.0 * widest),
            np.zeros(count, np.int64),
            error,
            first.astype(np.int64),
            number.astype(np.int64),
        ),
    )
