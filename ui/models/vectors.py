"""Vectors of the sketch: their curves, hit testing and commands; one history step each."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final, TypeAlias

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features import edits as edits
from sketchterrain.features.picking import PICK, Shapes, curves_of
from sketchterrain.features.table import AREA, LINE, VectorFeature, VectorLayer, on_grid
from sketchterrain.schema.layers import LAYERS, VECTOR_ORDER, storey
from sketchterrain.ui.commands import with_vectors
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.drapes import delete_draped, insert_draped_vertex
from sketchterrain.ui.models.workspace import Selection, Workspace

_ON_LINE = 0.01  # m
_AT_VERTEX = 0.1  # m from a vertex, where two lines that share it cross
_OFFSET = 0.02  # of what is pasted, over the sketch's extent
LEAST_WIDTH: Final = 1.5
"""Logical px of a line on the canvas."""

CASING: Final = 1.0
"""Logical px of the light rim of a way, on each side."""


def nearest_place(layer: VectorLayer, index: int, x: float, y: float) -> tuple[int, tuple[float, float]]:
    """Return the place on a feature's outline nearest to a position (m), after the vertex before it."""
    import shapely

    point, lines = shapely.Point(x, y), shapely.get_parts(curves_of(layer).outlines[index])
    part = int(np.argmin(shapely.distance(lines, point)))
    line = lines[part]
    along = line.project(point)
    place = np.array(line.interpolate(along).coords[0])
    ends = np.cumsum(np.hypot(*np.diff(shapely.get_coordinates(line), axis=0).T))
    first, end = layer.rings[layer.parts[index] + part :][:2].tolist()
    pieces = len(ends) // (end - first - int(layer.kinds[index] == LINE))
    return first + int(np.searchsorted(ends[:-1], along, side="right")) // pieces, _pair(place)


def _pair(place: Float64Array) -> tuple[float, float]:
    x, y = on_grid(place).tolist()
    return x, y


def widths_of(sketch: Sketch, layer: VectorLayer) -> Float64Array:
    """Return the width of each line of a layer (m), 0 of the rest."""
    name = layer.layer
    if "width" not in LAYERS[name].parameters:
        return np.zeros(len(layer))
    return np.where(layer.kinds == LINE, sketch.vector_widths(name), 0.0)


def network_of(sketch: Sketch, name: str) -> list[VectorLayer]:
    """Return the layers that share nodes with a layer, itself first."""
    return [sketch.vectors[each] for each in edits.network_layers(name)]


def find_vector(sketch: Sketch, selection: Selection | None) -> VectorFeature | None:
    """Return the selected vector; None without one or if it is missing."""
    if selection is None or not selection.is_vector:
        return None
    layer = sketch.vectors[selection.kind]
    return layer.feature(selection.id) if selection.id in layer else None


def _selected(document: Document, workspace: Workspace) -> tuple[VectorLayer, Selection] | None:
    """Return the selection and its layer if it is a vector that exists."""
    selection = workspace.selection
    if selection is None or find_vector(document.sketch, selection) is None:
        return None
    return document.sketch.vectors[selection.kind], selection


def visible_vectors(sketch: Sketch, workspace: Workspace) -> list[VectorLayer]:
    """Return the visible layers that have vectors, from bottom to top."""
    names = [name for name in VECTOR_ORDER if workspace.look(name).visible]
    return [sketch.vectors[name] for name in names if len(sketch.vectors[name])]


def vector_picks(
    sketch: Sketch, workspace: Workspace, x: float, y: float, texel: float
) -> Iterator[tuple[float, Selection]]:
    """Yield the visible vectors at a position (m) or near it, the topmost first, and how far (m) they are.

    The distance of what is drawn there is 0; a pixel is `texel` m.
    """
    for layer in visible_vectors(sketch, workspace)[::-1]:
        half = 0.5 * np.maximum(widths_of(sketch, layer), LEAST_WIDTH * texel)
        rim = CASING * texel if LAYERS[layer.layer].kind == "way" else 0.0
        rows, distance, inside = curves_of(layer).near(x, y, float(half.max()) + rim + PICK * texel)
        gap = np.where(inside, 0.0, np.maximum(distance - half[rows], 0.0))
        is_line = layer.kinds[rows] == LINE
        body = is_line & (gap == 0.0)  # over the rims of all ways, which are over areas
        gap = np.maximum(gap - rim, 0.0)
        for each in np.lexsort((rows, is_line, body))[::-1].tolist():
            if gap[each] <= PICK * texel:
                yield float(gap[each]), Selection(layer.layer, int(layer.ids[rows[each]]))


def snapped(
    layers: Sequence[VectorLayer],
    x: float,
    y: float,
    reach: float,
    *,
    other_than: tuple[float, float] | None = None,
) -> tuple[float, float] | None:
    """Return the nearest vertex of layers, else place on a line or border, within a distance (m).

    `other_than`: not the node at a position, nor what is connected to it.
    """
    vertices = [(layer, edits.nearest_vertex(layer, x, y, reach, other_than=other_than)) for layer in layers]
    places = [layer.vertices[number] for layer, number in vertices if number is not None]
    for layer in layers if not places else ():
        index = curves_of(layer).nearest(x, y, reach, without=_at_node(layer, other_than))
        if index is not None:
            places.append(np.array(nearest_place(layer, index, x, y)[1]))
    return _pair(min(places, key=lambda place: float(np.hypot(*(place - (x, y)))))) if places else None


def _at_node(layer: VectorLayer, place: tuple[float, float] | None) -> Int64Array:
    """Return the indices of the features that have a node at a position."""
    own = [] if place is None else layer.with_vertices(edits.vertices_at(layer, *place)).ids.tolist()
    return np.array([layer.index(each) for each in own], np.int64)


def with_nodes(
    layer: VectorLayer, places: Float64Array, *, other_than: tuple[float, float] | None = None
) -> VectorLayer:
    """Return the layer with vertices at those of some positions (m) that are on its lines and borders.

    `other_than`: not in features that have a node at a position.
    """
    curves, own = curves_of(layer), _at_node(layer, other_than)
    found: list[tuple[int, float, float, float]] = []
    for x, y in np.unique(places, axis=0).tolist():
        index = None if len(edits.vertices_at(layer, x, y)) else curves.nearest(x, y, _ON_LINE, without=own)
        if index is not None:
            after = nearest_place(layer, index, x, y)[0]
            found.append((after, float(np.hypot(*(layer.vertices[after] - (x, y)))), x, y))
    if not found:
        return layer
    found.sort()
    at = np.array(found)
    return edits.insert_vertices(layer, at[:, 0].astype(np.int64), at[:, 2:])


def with_feature(sketch: Sketch, name: str, feature: VectorFeature) -> list[VectorLayer]:
    """Return the layers of a network, `name` first, with another feature, joined where it touches others.

    Roads, railways and paths are also joined where they cross at one level, areas where they touch.
    """
    layers = network_of(sketch, name)
    own = VectorLayer(name).edited(add=[feature])
    if feature.kind == AREA:
        own = with_nodes(own, np.concatenate([_vertices_on(own, layer) for layer in layers]))
    if LAYERS[name].kind == "way":
        own = with_nodes(own, _crossings(sketch, own, layers))
    first, *others = (with_nodes(layer, own.vertices) for layer in layers)
    return [first.edited(add=[replace(own.feature(1), id=0)]), *others]


def _vertices_on(own: VectorLayer, layer: VectorLayer) -> Float64Array:
    """Return the vertices of a layer on the lines and borders of a small one, (n, 2), m."""
    import shapely

    low, high = own.vertices.min(axis=0) - _ON_LINE, own.vertices.max(axis=0) + _ON_LINE
    pieces = [piece.vertices for _, piece in layer.pieces_near(*low.tolist(), *high.tolist())]
    places = np.concatenate([np.zeros((0, 2)), *pieces])
    places = places[((places >= low) & (places <= high)).all(axis=1)]
    border = shapely.union_all(curves_of(own).outlines)
    return np.asarray(places[shapely.dwithin(shapely.points(places), border, _ON_LINE)])


def _crossings(sketch: Sketch, own: VectorLayer, layers: Sequence[VectorLayer]) -> Float64Array:
    """Return where a new line crosses those at its level, away from its vertices, (n, 2), m."""
    import shapely

    (line,) = curves_of(own).shapes
    (level,) = _storeys(sketch, own, [0])
    found = [np.zeros((0, 2))]
    for layer in layers:
        shapes, rows = curves_of(layer).shapes, curves_of(layer).touching(line.bounds)
        rows = rows[shapely.crosses(shapes[rows], line)].tolist()
        same = [row for row, other in zip(rows, _storeys(sketch, layer, rows), strict=True) if other == level]
        found.append(shapely.get_coordinates(shapely.intersection(line, shapes[same])))
    places = on_grid(np.concatenate(found))
    return places[[edits.nearest_vertex(own, x, y, _AT_VERTEX) is None for x, y in places]]


def _storeys(sketch: Sketch, layer: VectorLayer, rows: list[int]) -> list[int]:
    """Return the levels of some ways; those of bridges and tunnels follow from that unless they are given."""
    labels = layer.labels[rows].tolist()
    values = [
        {**sketch.properties(layer.layer, label), **own}
        for label, own in zip(labels, layer.properties(rows), strict=True)
    ]
    return [storey(each["level"], each["structure"]) for each in values]


def with_moved_node(layer: VectorLayer, start: tuple[float, float], end: tuple[float, float]) -> VectorLayer:
    """Return the features at a node, moved to another position (m) where that is possible, for previews."""
    own = layer.with_vertices(edits.vertices_at(layer, *start))
    try:
        return edits.move_node(own, start, end)
    except InputError:
        return own


def moved_shapes(sketch: Sketch, name: str, start: tuple[float, float], end: tuple[float, float]) -> Shapes:
    """Return the curves of all features of a network at a node, moved as by `with_moved_node`."""
    moved = (with_moved_node(layer, start, end) for layer in network_of(sketch, name))
    return np.concatenate([curves_of(each).shapes for each in moved])


def node_moved(
    sketch: Sketch, name: str, start: tuple[float, float], end: tuple[float, float]
) -> list[VectorLayer]:
    """Return the layers of a network with a node moved; on a line or border it is a vertex of that too."""
    place = np.array([end])
    layers = [with_nodes(layer, place, other_than=start) for layer in network_of(sketch, name)]
    return [
        edits.move_node(each, start, end) if len(edits.vertices_at(each, *start)) else each for each in layers
    ]


def drag_refusal(sketch: Sketch, workspace: Workspace, name: str, x: float, y: float) -> str:
    """Return why the node of a layer at a position (m) cannot be moved; empty if it can."""
    locked = (
        layer.layer
        for layer in network_of(sketch, name)
        if workspace.look(layer.layer).locked and len(edits.vertices_at(layer, x, y))
    )
    return workspace.refusal(name) or next(map(workspace.refusal, locked), "")


def change_vectors(
    document: Document,
    workspace: Workspace,
    title: str,
    layer: VectorLayer,
    *others: VectorLayer,
    merge: Hashable | None = None,
) -> None:
    """Record a step that replaces vector layers; raise InputError if one is locked or the first is hidden."""
    sketch = document.sketch
    if refusal := workspace.refusal(layer.layer):
        raise InputError(refusal)
    changed = [each for each in (layer, *others) if each is not sketch.vectors[each.layer]]
    for each in changed:
        if workspace.look(each.layer).locked:
            raise InputError(workspace.refusal(each.layer))
    if changed:
        title = f"{title} {LAYERS[layer.layer].title.lower()}"
        document.do(title, with_vectors(sketch, *changed), merge=merge)


def insert_vertex(document: Document, workspace: Workspace, x: float, y: float, *, reach: float) -> bool:
    """Insert a vertex in the selected feature and activate it; return whether it is within a distance (m)."""
    selection = workspace.selection
    if selection is not None and selection.is_draped:
        return insert_draped_vertex(document, workspace, x, y, reach=reach)
    if (found := _selected(document, workspace)) is None:
        return False
    layer, selection = found
    index = layer.index(selection.id)
    rows, distance, _ = curves_of(layer).near(x, y, reach)
    if (distance[rows == index] > reach).all():
        return False
    after, place = nearest_place(layer, index, x, y)
    changed = edits.insert_vertices(layer, np.array([after]), np.array([place]))
    change_vectors(document, workspace, "Insert a vertex in", changed)
    workspace.selection = replace(selection, index=after + 1 - layer.vertices_of(selection.id)[0])
    return True


def delete_vector(document: Document, workspace: Workspace) -> None:
    """Delete the active vertex, or without one the selected vector or draped feature."""
    selection = workspace.selection
    if selection is not None and selection.is_draped:
        delete_draped(document, workspace)
        return
    if (found := _selected(document, workspace)) is None:
        return
    layer, selection = found
    index = selection.index
    vertices = layer.vertices_of(selection.id)
    if index is None or index >= len(vertices):  # it has fewer vertices since an undo
        title, changed = "Delete a vector of", layer.edited(remove=[selection.id])
    else:
        title, changed = "Delete a vertex of", edits.delete_vertex(layer, vertices[index])
    change_vectors(document, workspace, title, changed)
    exists = selection.id in changed
    workspace.selection = replace(selection, index=max((index or 0) - 1, 0)) if exists else None


Command: TypeAlias = Callable[[Document, Workspace], None]


def _command(title: str, change: Callable[[VectorLayer, Selection], VectorLayer]) -> Command:
    def command(document: Document, workspace: Workspace) -> None:
        if found := _selected(document, workspace):
            change_vectors(document, workspace, title, change(*found))
            workspace.selection = replace(found[1], index=None)  # vertices have other numbers

    return command


VECTOR_COMMANDS: Final[Mapping[str, Command]] = {
    "split-line": _command(
        "Split a line of",
        lambda layer, own: edits.split_line(layer, own.id, -1 if own.index is None else own.index),
    ),
    "join-lines": _command("Join lines of", lambda layer, own: edits.join_lines(layer, own.id, own.index)),
    "reverse-line": _command("Reverse a line of", lambda layer, own: edits.reverse_line(layer, own.id)),
    "delete-selection": delete_vector,
}
"""Commands for the selected vector, by the names of their actions."""


def selected_text(document: Document, workspace: Workspace) -> str:
    """Return the selected vector as text; empty without one."""
    found = _selected(document, workspace)
    return "" if found is None else edits.to_text(found[0], [found[1].id])


def paste(document: Document, workspace: Workspace, text: str) -> None:
    """Add the vectors of a text beside those that they were copied from, and select the first one."""
    name, features = edits.from_text(text)
    layer, step, count = document.sketch.vectors[name], _OFFSET * document.sketch.extent, 1
    first = features[0].rings[0][0]
    while len(edits.vertices_at(layer, *(first + count * step * np.array([1.0, -1.0])))):
        count += 1
    added = layer.edited(add=[edits.moved(each, count * step, -count * step) for each in features])
    change_vectors(document, workspace, "Paste", added)
    workspace.selection = Selection(name, int(added.ids[len(layer)]))
