"""Vectors of the sketch: their curves, hit testing and commands; one history step each."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final, TypeAlias
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.caching import LRUCache
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features import edits as edits
from sketchterrain.features.table import AREA, LINE, VectorFeature, VectorLayer, on_grid
from sketchterrain.geometry.splines import cubics
from sketchterrain.schema.layers import LAYERS, VECTOR_ORDER, storey
from sketchterrain.ui.commands import with_vectors
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.drapes import delete_draped, insert_draped_vertex
from sketchterrain.ui.models.workspace import Selection, Workspace

if TYPE_CHECKING:  # it takes a quarter of a second
    import shapely

_PIECES = 16  # straight ones of a curve between two vertices
_POWERS = (np.arange(_PIECES) / _PIECES) ** np.arange(4)[:, None]
_ON_LINE = 0.01  # m
_AT_VERTEX = 0.1  # m from a vertex, where two lines that share it cross
_OFFSET = 0.02  # of what is pasted, over the sketch's extent
_curves = LRUCache(12)
_of_pieces: WeakKeyDictionary[VectorLayer, Curves] = WeakKeyDictionary()

Shapes: TypeAlias = npt.NDArray[np.object_]
"""Shapely geometries."""


@dataclass(frozen=True, eq=False)
class Curves:
    """A layer's features as drawn: smooth lines have `_PIECES` pieces between two vertices.

    Parameters
    ----------
    shapes, outlines : (n,) m; the outline of an area is its border and holes
    """

    shapes: Shapes
    outlines: Shapes

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Index of the shapes."""
        import shapely

        return shapely.STRtree(self.shapes)

    @classmethod
    def from_layer(cls, layer: VectorLayer) -> Curves:
        """Return the curves of a layer; those of unchanged pieces are known."""
        import shapely

        if len(layer.pieces) > 1:
            for piece in layer.pieces:
                if piece not in _of_pieces:
                    _of_pieces[piece] = cls.from_layer(piece)
            parts = [_of_pieces[piece] for piece in layer.pieces]
            return cls(
                *(np.concatenate([getattr(each, key) for each in parts]) for key in ("shapes", "outlines"))
            )
        shapes = layer.shapes()
        smooth = (np.asarray(layer.columns.get("smooth", layer.kinds * 0.0)) == 1) & (layer.kinds == LINE)
        if smooth.any():
            own = smooth[layer.feature_of_ring]
            lengths = np.diff(layer.rings)[own]
            points, line = _sampled(layer.vertices[own[layer.ring_of_vertex]], lengths)
            shapes[smooth] = shapely.linestrings(points, indices=line)
        return cls(shapes, outlines(shapes))

    def nearest(self, x: float, y: float, reach: float | Float64Array) -> int | None:
        """Return the index of the feature with the nearest outline within a distance (m), or each its own."""
        import shapely

        reach = np.broadcast_to(reach, len(self.shapes))
        most = reach.max(initial=0.0)
        if most <= 0.0:
            return None
        box = (x - most, y - most, x + most, y + most)
        rows = self.tree.query(shapely.box(*box))
        distance = shapely.distance(shapely.clip_by_rect(self.outlines[rows], *box), shapely.Point(x, y))
        excess = np.where(np.isnan(distance), np.inf, distance - reach[rows])  # nan: of what is outside
        return int(rows[np.argmin(excess)]) if excess.min(initial=np.inf) <= 0.0 else None


def outlines(shapes: Shapes) -> Shapes:
    """Return shapes with their borders and holes in place of areas."""
    import shapely

    lines, areas = shapes.copy(), shapely.get_dimensions(shapes) == 2
    lines[areas] = shapely.boundary(shapes[areas])
    return lines


def curves_of(layer: VectorLayer) -> Curves:
    """Return a layer's curves, cached."""
    return _curves.get_or_compute(layer, lambda: Curves.from_layer(layer))


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


def vector_at(sketch: Sketch, workspace: Workspace, x: float, y: float, *, reach: float) -> Selection | None:
    """Return the visible vector at a position (m): a line or border within a tolerance (m), else an area."""
    layers = visible_vectors(sketch, workspace)[::-1]
    for layer in layers:
        index = curves_of(layer).nearest(x, y, np.maximum(0.5 * widths_of(sketch, layer), reach))
        if index is not None:
            return Selection(layer.layer, int(layer.ids[index]))
    for layer in layers:
        import shapely

        inside = curves_of(layer).tree.query(shapely.Point(x, y), predicate="intersects")
        if len(inside):
            return Selection(layer.layer, int(layer.ids[inside.max()]))
    return None


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
        index = curves_of(layer).nearest(x, y, _reaches(layer, reach, other_than))
        if index is not None:
            places.append(np.array(nearest_place(layer, index, x, y)[1]))
    return _pair(min(places, key=lambda place: float(np.hypot(*(place - (x, y)))))) if places else None


def _reaches(layer: VectorLayer, reach: float, other_than: tuple[float, float] | None) -> Float64Array:
    """Return a distance for each feature; less than 0 of those that have a node at a position."""
    reaches = np.full(len(layer), reach)
    if other_than is not None:
        own = layer.with_vertices(edits.vertices_at(layer, *other_than))
        reaches[[layer.index(each) for each in own.ids.tolist()]] = -np.inf
    return reaches


def with_nodes(
    layer: VectorLayer, places: Float64Array, *, other_than: tuple[float, float] | None = None
) -> VectorLayer:
    """Return the layer with vertices at those of some positions (m) that are on its lines and borders.

    `other_than`: not in features that have a node at a position.
    """
    curves, reaches = curves_of(layer), _reaches(layer, _ON_LINE, other_than)
    found: list[tuple[int, float, float, float]] = []
    for x, y in np.unique(places, axis=0).tolist():
        index = None if len(edits.vertices_at(layer, x, y)) else curves.nearest(x, y, reaches)
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
        curves = curves_of(layer)
        rows = curves.tree.query(line, predicate="crosses").tolist()
        same = [row for row, other in zip(rows, _storeys(sketch, layer, rows), strict=True) if other == level]
        found.append(shapely.get_coordinates(shapely.intersection(line, curves.shapes[same])))
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
    return np.concatenate([Curves.from_layer(each).shapes for each in moved])


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
    index = curves_of(layer).nearest(x, y, np.where(layer.ids == selection.id, reach, -np.inf))
    if index is None:
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
