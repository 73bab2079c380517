"""Edits of vector layers: nodes, vertices, lines, and features as text; each returns another layer."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.errors import InputError
from sketchterrain.features.table import (
    AREA,
    LINE,
    VectorFeature,
    VectorLayer,
    on_grid,
    property_columns,
    repeats,
    starts,
)
from sketchterrain.schema.layers import WAY_LAYERS
from sketchterrain.schema.parameters import Value

_COMPLEX = np.array([1.0, 1.0j])  # makes one number of a position


def network_layers(name: str) -> tuple[str, ...]:
    """Return the layers that share nodes with a layer, itself first: ways of all kinds are one network."""
    return (name, *(each for each in WAY_LAYERS if each != name)) if name in WAY_LAYERS else (name,)


def nearest_vertex(
    layer: VectorLayer, x: float, y: float, radius: float, *, other_than: tuple[float, float] | None = None
) -> int | None:
    """Return the number of the vertex nearest to a position, within a radius (m)."""
    best: int | None = None
    for first, piece in layer.pieces_near(x - radius, y - radius, x + radius, y + radius):
        distance = np.hypot(*(piece.vertices - (x, y)).T)
        if other_than is not None:
            distance[(piece.vertices == on_grid(other_than)).all(axis=1)] = np.inf
        nearest = int(np.argmin(distance))
        if distance[nearest] < radius or (distance[nearest] == radius and best is None):
            best, radius = first + nearest, float(distance[nearest])
    return best


def vertices_at(layer: VectorLayer, x: float, y: float) -> Int64Array:
    """Return the numbers of the vertices at a position: those of one node."""
    x, y = on_grid([x, y]).tolist()
    near = layer.pieces_near(x, y, x, y)
    # Pieces of areas that are sorted by their size are all everywhere: few have a vertex there.
    some = ((first, piece) for first, piece in near if piece.has_easting(x))
    found = [first + np.flatnonzero((piece.vertices == (x, y)).all(axis=1)) for first, piece in some]
    return np.concatenate([np.zeros(0, np.int64), *found])


def move_node(layer: VectorLayer, start: tuple[float, float], end: tuple[float, float]) -> VectorLayer:
    """Move a node from a position to another (m); at that of another node they are one."""
    own = layer.with_vertices(vertices_at(layer, *start))
    at = (own.vertices == on_grid(start)).all(axis=1)[:, None]
    moved = _rebuilt(own, np.where(at, on_grid(end), own.vertices), np.ones(len(at), np.bool_))
    return layer.edited(own.ids.tolist(), moved)


def shared_nodes(layers: Sequence[VectorLayer], places: Float64Array) -> BoolArray:
    """Return which vertices at positions (n, 2), m, are nodes with others of some layers."""
    low, high = places.min(axis=0), places.max(axis=0)
    pieces = [piece for layer in layers for _, piece in layer.pieces_near(*low, *high)]
    near = [
        piece.vertices[((piece.vertices >= low) & (piece.vertices <= high)).all(axis=1)] for piece in pieces
    ]
    found, counts = np.unique(np.concatenate(near) @ _COMPLEX, return_counts=True)
    return np.asarray(counts[np.searchsorted(found, places @ _COMPLEX)] > 1)


def insert_vertices(layer: VectorLayer, after: Int64Array, places: Float64Array) -> VectorLayer:
    """Insert vertices at positions (n, 2), m, each after one by its number, in the same ring; ascending."""
    own = layer.with_vertices(after)
    numbers = _numbers_in(own, layer, after)
    order = np.argsort(numbers, kind="stable")
    numbers, places = numbers[order], places[order]
    rings = own.rings + np.searchsorted(numbers, own.rings)
    longer = replace(own, vertices=np.insert(own.vertices, numbers + 1, places, axis=0), rings=rings)
    return layer.edited(own.ids.tolist(), longer)


def delete_vertex(layer: VectorLayer, vertex: int) -> VectorLayer:
    """Delete a vertex by its number; what then has too few is deleted: a line, an area or a hole."""
    own = layer.with_vertices(np.array([vertex]))
    keep = np.ones(len(own.vertices), np.bool_)
    keep[_numbers_in(own, layer, np.array([vertex]))] = False
    return layer.edited(own.ids.tolist(), _rebuilt(own, own.vertices, keep))


def _numbers_in(own: VectorLayer, layer: VectorLayer, vertices: Int64Array) -> Int64Array:
    """Return the numbers in a layer of some features of vertices of another that has these features."""
    ranges = [(own.vertices_of(name).start, layer.vertices_of(name)) for name in own.ids.tolist()]
    starts_of = np.array([(start, each.start) for start, each in ranges])
    which = np.array([[vertex in each for _, each in ranges].index(True) for vertex in vertices.tolist()])
    return np.asarray(vertices + (starts_of[which, 0] - starts_of[which, 1]))


def _rebuilt(layer: VectorLayer, vertices: Float64Array, keep: BoolArray) -> VectorLayer:
    """Return the layer with moved vertices, without some, without repeats and without what is too small."""
    kinds, ring = layer.kinds[layer.feature_of_ring], layer.ring_of_vertex
    keep = keep.copy()
    keep[keep] = ~repeats(vertices[keep], ring[keep], kinds == AREA)
    counts = np.bincount(ring[keep], minlength=len(kinds))
    small = counts <= kinds  # a line has two vertices, an area three
    gone = small[layer.parts[:-1]]
    if gone.any():
        own = ~gone[layer.feature_of_ring[ring]]
        return _rebuilt(layer.edited(remove=layer.ids[gone].tolist()), vertices[own], keep[own])
    parts = np.bincount(layer.feature_of_ring[~small], minlength=len(layer))
    return replace(
        layer, vertices=vertices[keep & ~small[ring]], rings=starts(counts[~small]), parts=starts(parts)
    )


def split_line(layer: VectorLayer, name: int, index: int) -> VectorLayer:
    """Split a line at one of its inner vertices into two that share it; the second one has the last id."""
    line = layer.feature(name)
    if line.kind != LINE or not 0 < index < len(line.rings[0]) - 1:
        raise InputError("a line is split at a vertex between its ends")
    first, second = line.rings[0][: index + 1], line.rings[0][index:]
    return layer.edited([name], [replace(line, rings=(first,)), replace(line, rings=(second,), id=0)])


def join_lines(layer: VectorLayer, name: int, index: int | None = None) -> VectorLayer:
    """Join a line with the one that shares an end with it, that of vertex `index` if it is an end.

    Of several it is the one that continues it most nearly straight. The line keeps id, direction and
    properties.
    """
    line = layer.feature(name)
    places = line.rings[0]
    ends = [end for end in (0, -1) if index in (None, end % len(places))] or [0, -1]
    found: list[tuple[float, Float64Array, int]] = []
    for end in ends if line.kind == LINE else ():
        one = places[::-1] if end == 0 else places  # the end that is shared is its last
        near = layer.with_vertices(vertices_at(layer, *one[-1]))
        for feature in map(near.feature, near.ids.tolist()):
            if feature.id == name or feature.kind != LINE:
                continue
            for rest in (feature.rings[0], feature.rings[0][::-1]):
                if (rest[0] == one[-1]).all():
                    both = np.concatenate([one, rest[1:]])
                    turn = _turn(one[-1] - one[-2], rest[1] - rest[0])
                    found.append((turn, both[::-1] if end == 0 else both, feature.id))
    if not found:
        raise InputError("no other line shares an end with this one")
    _, both, other_name = min(found, key=lambda each: each[0])
    return layer.edited([name, other_name], [replace(line, rings=(both,))])


def _turn(before: Float64Array, after: Float64Array) -> float:
    cross = float(before[0] * after[1] - before[1] * after[0])
    return abs(math.atan2(cross, float(before @ after)))


def change_layer(
    source: VectorLayer, target: VectorLayer, name: int, label: int
) -> tuple[VectorLayer, VectorLayer]:
    """Move a feature to another layer, with its vertices and own properties; there it has the last id."""
    feature = replace(source.feature(name), label=label, id=0)
    return source.edited(remove=[name]), target.edited(add=[feature])


def reverse_line(layer: VectorLayer, name: int) -> VectorLayer:
    """Reverse the order of a line's vertices."""
    line = layer.feature(name)
    if line.kind != LINE:
        raise InputError("only lines can be reversed")
    return layer.edited([name], [replace(line, rings=(line.rings[0][::-1],))])


def set_value(layer: VectorLayer, name: int, key: str, value: Value | None) -> VectorLayer:
    """Set a property of a feature, or its ``label``; None removes its own value."""
    feature = layer.feature(name)
    if key == "label":
        return layer.edited([name], [replace(feature, label=int(value or 1))])
    rest = {other: own for other, own in feature.properties.items() if other != key}
    properties = rest if value is None else {**rest, key: value}
    return layer.edited([name], [replace(feature, properties=properties)])


def moved(feature: VectorFeature, east: float, north: float) -> VectorFeature:
    """Return a new feature beside another, at an offset (m)."""
    return replace(feature, rings=tuple(ring + np.array([east, north]) for ring in feature.rings), id=0)


def to_text(layer: VectorLayer, names: Sequence[int]) -> str:
    """Return features as GeoJSON, in metres from the sketch's south-west corner, with their layer."""
    import shapely

    indices = [layer.index(name) for name in names]
    features = [
        {"type": "Feature", "geometry": json.loads(geometry), "properties": {**own, "label": label}}
        for geometry, own, label in zip(
            shapely.to_geojson(layer.shapes()[indices]),
            layer.properties(indices),
            layer.labels[indices].tolist(),
            strict=True,
        )
    ]
    return json.dumps({"type": "FeatureCollection", "sketchterrain": layer.layer, "features": features})


def from_text(text: str) -> tuple[str, list[VectorFeature]]:
    """Return the layer and features of `to_text`, without ids; raise InputError for another text."""
    import shapely

    try:
        table = json.loads(text)
        name, features = table["sketchterrain"], table["features"]
        shapes = shapely.from_geojson([json.dumps(each["geometry"]) for each in features])
        columns = property_columns([each["properties"] for each in features])
        labels = columns.pop("label")
        layer = VectorLayer.from_shapes(name, shapes, labels=labels, columns=columns)
        if not len(layer):
            raise ValueError("no features")
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError, shapely.GEOSException):
        raise InputError("expected vectors copied from a sketch") from None
    return layer.layer, [replace(layer.feature(each), id=0) for each in layer.ids.tolist()]
