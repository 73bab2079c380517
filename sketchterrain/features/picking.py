"""Vectors as they are drawn: curves, what is near a place, places on lines."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Bounds, Float64Array, Int64Array
from sketchterrain.features.table import LINE, POINT, Feature, FeatureTable, Shapes, on_grid
from sketchterrain.geometry.splines import cubics

if TYPE_CHECKING:  # it takes a quarter of a second
    from shapely.geometry.base import BaseGeometry

_PIECES: Final = 16  # straight ones of a curve between two vertices
_POWERS: Final = (np.arange(_PIECES) / _PIECES) ** np.arange(4)[:, None]

PICK: Final = 3.0
"""Pixels from a line or point within which it is found where nothing is drawn."""


@dataclass(frozen=True, eq=False)
class Curves:
    """A layer's features as drawn: smooth lines have `_PIECES` pieces between two vertices.

    Parameters
    ----------
    shapes : (n,) m
    boxes : (4, n) m, west, south, east and north
    """

    shapes: Shapes
    boxes: Float64Array

    @classmethod
    def of(cls, layer: FeatureTable) -> Curves:
        """Return the curves of a layer; those of its pieces are known if they are unchanged."""
        import shapely

        if len(layer.pieces) > 1:
            pieces = [piece.curves for piece in layer.pieces]
            boxes = np.concatenate([each.boxes for each in pieces], axis=1)
            return cls(np.concatenate([each.shapes for each in pieces]), boxes)
        shapes = layer.shapes()
        smooth = (np.asarray(layer.columns.get("smooth", layer.kinds * 0.0)) == 1) & (layer.kinds == LINE)
        if smooth.any():
            own = smooth[layer.feature_of_ring]
            points, line = _sampled(layer.vertices[own[layer.ring_of_vertex]], np.diff(layer.rings)[own])
            shapes[smooth] = shapely.linestrings(points, indices=line)
        return cls(shapes, np.ascontiguousarray(shapely.bounds(shapes).T))

    def touching(self, box: Bounds) -> Int64Array:
        """Return the indices of the features whose boxes touch a box, ascending."""
        west, south, east, north = self.boxes
        return np.flatnonzero((west <= box[2]) & (east >= box[0]) & (south <= box[3]) & (north >= box[1]))

    def near(self, x: float, y: float, reach: float) -> tuple[Int64Array, Float64Array, BoolArray]:
        """Return features near a place (m), the distances of their outlines, and which have it inside.

        Distances greater than the reach (m) are infinite.
        """
        import shapely

        box = (x - reach, y - reach, x + reach, y + reach)
        rows, place = self.touching(box), shapely.Point(x, y)
        distance = shapely.distance(shapely.clip_by_rect(outlines_of(self.shapes[rows]), *box), place)
        return rows, np.nan_to_num(distance, nan=np.inf), shapely.intersects_xy(self.shapes[rows], x, y)


def curve_of(feature: Feature) -> BaseGeometry:
    """Return a feature of the sketch's own layers as it is drawn."""
    import shapely

    if feature.kind == LINE and feature.properties.get("smooth") == 1:
        return shapely.LineString(_sampled(feature.rings[0], np.array([len(feature.rings[0])]))[0])
    return feature.geometry


def outlines_of(shapes: Shapes) -> Shapes:
    """Return shapes with their borders and holes in place of areas."""
    import shapely

    lines, areas = shapes.copy(), shapely.get_dimensions(shapes) == 2
    lines[areas] = shapely.boundary(shapes[areas])
    return lines


def _sampled(vertices: Float64Array, lengths: Int64Array) -> tuple[Float64Array, Int64Array]:
    """Return points of the curves through lines of some vertices each, and the line of each point."""
    line = np.repeat(np.arange(len(lengths)), lengths)
    end = np.cumsum(lengths)
    first, last = end - lengths, end - 1
    # Before and after each line is the reflection of its second vertex and its last but one.
    beyond = [2.0 * vertices[last] - vertices[last - 1], 2.0 * vertices[first] - vertices[first + 1]]
    padded = np.insert(vertices, np.concatenate([end, first]), np.concatenate(beyond), axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):  # between two lines
        curves = cubics(padded)[np.arange(len(vertices)) + 2 * line + 1] @ _POWERS
    curves[last, :, 0] = vertices[last]
    within = np.ones((len(vertices), _PIECES), np.bool_)
    within[last, 1:] = False
    return np.swapaxes(curves, 1, 2)[within], np.repeat(line, _PIECES)[within.ravel()]


def nearest_place(
    table: FeatureTable, feature: Feature, x: float, y: float
) -> tuple[float, int, tuple[float, float]]:
    """Return the place on a line or border nearest to a position (m): distance, vertex before it, place."""
    import shapely

    point, lines = shapely.Point(x, y), shapely.get_parts(outlines_of(np.array([table.curve(feature)])))
    distance = shapely.distance(lines, point)
    part = int(np.argmin(distance))
    line, ring = lines[part], feature.rings[part]
    along = line.project(point)
    ends = np.cumsum(np.hypot(*np.diff(shapely.get_coordinates(line), axis=0).T))
    pieces = len(ends) // (len(ring) - int(feature.kind == LINE))
    after = (
        sum(map(len, feature.rings[:part])) + int(np.searchsorted(ends[:-1], along, side="right")) // pieces
    )
    return float(distance[part]), after, _pair(line.interpolate(along).coords[0])


def _pair(place: npt.ArrayLike) -> tuple[float, float]:
    x, y = on_grid(place).tolist()
    return x, y


def snapped(
    tables: Iterable[FeatureTable],
    x: float,
    y: float,
    reach: float,
    *,
    other_than: tuple[float, float] | None = None,
) -> tuple[float, float] | None:
    """Return the nearest vertex of layers, else place on a line or border, within a distance (m).

    `other_than`: not the node at a position, nor what is connected to it.
    """
    vertices, lines = [np.zeros((0, 2))], []
    for table in tables:
        for feature in table.near(x, y, reach):
            places = np.concatenate(feature.rings)
            is_node = (places == (np.nan if other_than is None else other_than)).all(axis=1)
            vertices.append(places[~is_node])
            if feature.kind != POINT and not is_node.any():
                lines.append((table, feature))
    nodes = np.concatenate(vertices)
    away = np.hypot(*(nodes - (x, y)).T)
    if away.min(initial=np.inf) <= reach:
        east, north = nodes[np.argmin(away)].tolist()
        return east, north
    found = [nearest_place(table, each, x, y) for table, each in lines]
    distance, _, place = min(found, default=(np.inf, 0, (x, y)))
    return place if distance <= reach else None
