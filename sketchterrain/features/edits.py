"""Edits of tables of features: nodes, vertices, lines, and features as text; each returns another table."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.errors import InputError
from sketchterrain.features.table import (
    AREA,
    DRAPED,
    LINE,
    POINT,
    Feature,
    FeatureTable,
    on_grid,
    one_number,
    property_columns,
)
from sketchterrain.geometry.splines import drop_repeats
from sketchterrain.schema.layers import WAY_LAYERS
from sketchterrain.schema.parameters import Value


def network_layers(name: str) -> tuple[str, ...]:
    """Return the layers that share nodes with a layer, itself first: ways of all kinds are one network."""
    return (name, *(each for each in WAY_LAYERS if each != name)) if name in WAY_LAYERS else (name,)


def move_nodes(layer: FeatureTable, starts: Float64Array, ends: Float64Array) -> FeatureTable:
    """Move nodes from positions (n, 2) to others (m); at those of other nodes they are one."""
    keys, order = np.unique(one_number(on_grid(starts)), return_index=True)
    ends, moved = on_grid(ends)[order], dict[int, Feature | None]()
    for feature in layer.features_among(starts):
        vertices = np.concatenate(feature.rings)
        at = np.minimum(np.searchsorted(keys, one_number(vertices)), len(keys) - 1)
        is_node = (keys[at] == one_number(vertices))[:, None]
        moved[feature.id] = rebuilt(feature, np.where(is_node, ends[at], vertices), ring_numbers(feature))
    return layer.edited(list(moved), [each for each in moved.values() if each]) if moved else layer


def move_node(layer: FeatureTable, start: tuple[float, float], end: tuple[float, float]) -> FeatureTable:
    """Move a node from a position to another (m)."""
    return move_nodes(layer, np.array([start]), np.array([end]))


def shared_nodes(layers: Sequence[FeatureTable], places: Float64Array) -> BoolArray:
    """Return which vertices at positions (n, 2), m, are nodes with others of some layers."""
    low, high = places.min(axis=0), places.max(axis=0)
    pieces = [piece for layer in layers for piece in layer.pieces_near(*low, *high)]
    near = [
        piece.vertices[((piece.vertices >= low) & (piece.vertices <= high)).all(axis=1)] for piece in pieces
    ]
    found, counts = np.unique(one_number(np.concatenate(near)), return_counts=True)
    return np.asarray(counts[np.searchsorted(found, one_number(places))] > 1)


def ring_numbers(feature: Feature) -> Int64Array:
    """Return the number of each vertex's ring."""
    return np.repeat(np.arange(len(feature.rings)), [len(ring) for ring in feature.rings])


def rebuilt(feature: Feature, vertices: Float64Array, ring: Int64Array) -> Feature | None:
    """Return a feature with other vertices in its rings, None if it has too few then.

    Repeats are left out, and rings that are too small, of a border with its holes.
    """
    rings, parts, has_border = list[Float64Array](), list[int](), False
    for number, own in enumerate(np.split(vertices, np.searchsorted(ring, range(1, len(feature.rings))))):
        places = drop_repeats(own)
        if feature.kind == AREA and len(places) > 1 and (places[0] == places[-1]).all():
            places = places[1:]
        if number in feature.parts:
            has_border = len(places) > feature.kind  # a line has two vertices, an area three
        if has_border and len(places) > feature.kind:
            parts += [len(rings)] if number in feature.parts else []
            rings.append(places)
    return replace(feature, rings=tuple(rings), parts=tuple(parts)) if rings else None


def with_places(table: FeatureTable, name: int, places: Float64Array) -> FeatureTable:
    """Move the vertices of a feature, but not their nodes, to positions (n, 2), m."""
    feature = table.feature(name)
    return _with_vertices(table, feature, places, ring_numbers(feature))


def insert_vertices(
    table: FeatureTable, name: int, after: npt.ArrayLike, places: npt.ArrayLike
) -> FeatureTable:
    """Insert vertices at positions (n, 2), m, in a feature, each after one by its number; ascending."""
    feature, at = table.feature(name), np.asarray(after)
    if feature.kind == POINT:
        raise InputError("vertices are inserted in lines and areas")
    vertices = np.insert(np.concatenate(feature.rings), at + 1, places, axis=0)
    ring = ring_numbers(feature)
    return _with_vertices(table, feature, vertices, np.insert(ring, at + 1, ring[at]))


def delete_vertex(table: FeatureTable, name: int, index: int) -> FeatureTable:
    """Delete a vertex of a feature; what then has too few is deleted: a line, an area or a hole."""
    feature = table.feature(name)
    vertices, ring = np.concatenate(feature.rings), ring_numbers(feature)
    if not 0 <= index < len(vertices):
        raise InputError(f"vertex {index}: expected 0 to {len(vertices) - 1}")
    return _with_vertices(table, feature, np.delete(vertices, index, axis=0), np.delete(ring, index))


def _with_vertices(
    table: FeatureTable, feature: Feature, vertices: Float64Array, ring: Int64Array
) -> FeatureTable:
    changed = rebuilt(feature, vertices, ring)
    return table.edited([feature.id], [changed] if changed else [])


def split_line(table: FeatureTable, name: int, index: int) -> FeatureTable:
    """Split a line at one of its inner vertices into two that share it; the second one has the last id."""
    line = table.feature(name)
    if not _is_line(line) or not 0 < index < len(line.rings[0]) - 1:
        raise InputError("a line is split at a vertex between its ends")
    first, second = line.rings[0][: index + 1], line.rings[0][index:]
    return table.edited([name], [replace(line, rings=(first,)), replace(line, rings=(second,), id=0)])


def _is_line(feature: Feature) -> bool:
    return feature.kind == LINE and len(feature.rings) == 1


def join_lines(table: FeatureTable, name: int, index: int | None = None) -> FeatureTable:
    """Join a line with the one that shares an end with it, that of vertex `index` if it is an end.

    Of several it is the one that continues it most nearly straight. The line keeps id, direction and
    properties.
    """
    line = table.feature(name)
    places = line.rings[0]
    ends = [end for end in (0, -1) if index in (None, end % len(places))] or [0, -1]
    found: list[tuple[float, Float64Array, int]] = []
    for end in ends if _is_line(line) else ():
        one = places[::-1] if end == 0 else places  # the end that is shared is its last
        for feature in table.features_at(*one[-1].tolist()):
            if feature.id == name or not _is_line(feature):
                continue
            for rest in (feature.rings[0], feature.rings[0][::-1]):
                if (on_grid(rest[0]) == on_grid(one[-1])).all():
                    both = np.concatenate([one, rest[1:]])
                    turn = _turn(one[-1] - one[-2], rest[1] - rest[0])
                    found.append((turn, both[::-1] if end == 0 else both, feature.id))
    if not found:
        raise InputError("no other line shares an end with this one")
    _, both, other_name = min(found, key=lambda each: each[0])
    return table.edited([name, other_name], [replace(line, rings=(both,))])


def _turn(before: Float64Array, after: Float64Array) -> float:
    cross = float(before[0] * after[1] - before[1] * after[0])
    return abs(math.atan2(cross, float(before @ after)))


def change_layer(
    source: FeatureTable, target: FeatureTable, name: int, label: int
) -> tuple[FeatureTable, FeatureTable]:
    """Move a feature to another layer, with its vertices and own properties; there it has the last id."""
    feature = replace(source.feature(name), label=label, id=0)
    return source.edited(remove=[name]), target.edited(add=[feature])


def reverse_line(table: FeatureTable, name: int) -> FeatureTable:
    """Reverse the order of a line's vertices."""
    line = table.feature(name)
    if line.kind != LINE:
        raise InputError("only lines can be reversed")
    return table.edited([name], [replace(line, rings=tuple(ring[::-1] for ring in line.rings))])


def set_value(table: FeatureTable, name: int, key: str, value: Value | None) -> FeatureTable:
    """Set a property of a feature, or of the sketch's own its ``label``; None removes its own value."""
    feature = table.feature(name)
    if key == "label" and table.layer != DRAPED:
        changed = replace(feature, label=int(value or 1))
    else:
        properties = {other: own for other, own in feature.properties.items() if other != key}
        changed = replace(feature, properties=properties if value is None else {**properties, key: value})
    return table.edited([name], [changed])


def moved(feature: Feature, east: float, north: float) -> Feature:
    """Return a new feature beside another, at an offset (m)."""
    return replace(feature, rings=tuple(ring + np.array([east, north]) for ring in feature.rings), id=0)


def to_text(name: str, features: Sequence[Feature]) -> str:
    """Return features as GeoJSON, in metres from the sketch's south-west corner, with their layer's name."""
    import shapely

    rows = [
        {
            "type": "Feature",
            "geometry": json.loads(shapely.to_geojson(each.geometry)),
            "properties": {**each.properties, "label": each.label},
        }
        for each in features
    ]
    return json.dumps({"type": "FeatureCollection", "sketchterrain": name, "features": rows})


def from_text(text: str) -> tuple[str, list[Feature]]:
    """Return the layer's name and features of `to_text`, without ids; raise InputError for another text."""
    import shapely

    try:
        table = json.loads(text)
        name, rows = table["sketchterrain"], [dict(each["properties"]) for each in table["features"]]
        shapes = shapely.from_geojson([json.dumps(each["geometry"]) for each in table["features"]])
        labels = [row.pop("label") for row in rows]
        if not rows:
            raise ValueError("no features")
        if name == DRAPED:
            return name, [Feature.from_geometry(shape, row) for shape, row in zip(shapes, rows, strict=True)]
        layer = FeatureTable.from_shapes(name, shapes, labels=labels, columns=property_columns(rows))
    except (ValueError, TypeError, LookupError, OverflowError, RecursionError, shapely.GEOSException):
        raise InputError("expected vectors copied from a sketch") from None
    return name, [replace(layer.feature(each), id=0) for each in layer.ids.tolist()]
