"""Vectors of the sketch: their curves, hit testing, drags and commands; one history step each."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from sketchterrain.array_types import BoolArray, Float64Array, Int64Array
from sketchterrain.caching import IdentityKey, LRUCache
from sketchterrain.document import vector_edits as edits
from sketchterrain.document.layers import DRAW_ORDER, LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.vectors import AREA, LINE, VECTOR_LAYERS, VectorFeature, VectorLayer
from sketchterrain.errors import InputError
from sketchterrain.hydrology.splines import cubics, drop_repeats
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Selection, Workspace

if TYPE_CHECKING:  # it imports this module
    from sketchterrain.ui.models.selection import Handle

_PIECES = 16  # straight ones of a curve between two vertices, for distances
_T = np.linspace(0.0, 1.0, _PIECES + 1)[:, None]
_BERNSTEIN = np.hstack([(1.0 - _T) ** 3, 3.0 * _T * (1.0 - _T) ** 2, 3.0 * _T**2 * (1.0 - _T), _T**3])
_OFFSET = 0.02  # of what is pasted, over the sketch's extent
_curves = LRUCache(4)


@dataclass(frozen=True, eq=False)
class Curves:
    """The segments of a layer's lines and borders as Bézier curves.

    Parameters
    ----------
    start, end : (n,) numbers of the vertices that each segment joins, by ring in their order
    points : (n, 4, 2) Bézier points, m
    boxes : (n, 4) west, south, east, north, m
    features : (n,) index of each segment's feature, ascending
    shared : (m,) whether each vertex is a node with others
    smooth : (number of features,) which are curved
    """

    start: Int64Array
    end: Int64Array
    points: Float64Array
    boxes: Float64Array
    features: Int64Array
    shared: BoolArray
    smooth: BoolArray

    @classmethod
    def from_layer(cls, layer: VectorLayer) -> Curves:
        ring, vertices = layer.ring_of_vertex, layer.vertices
        kinds = layer.kinds[layer.feature_of_ring]
        first, last = layer.rings[:-1][ring], layer.rings[1:][ring] - 1
        number = np.arange(len(vertices))
        start = np.flatnonzero((kinds[ring] == AREA) | ((kinds[ring] == LINE) & (number < last)))
        end = np.where(start < last[start], start + 1, first[start])
        features = layer.feature_of_ring[ring[start]]
        at, to = vertices[start], vertices[end]
        c = np.stack([at, to - at, np.zeros_like(at), np.zeros_like(at)], axis=-1)
        smooth = (np.asarray(layer.columns.get("smooth", layer.kinds * 0.0)) == 1) & (layer.kinds == LINE)
        curved = smooth[features]
        if curved.any():
            s, e = start[curved], end[curved]
            before = np.where((s > first[s])[:, None], vertices[s - 1], 2.0 * vertices[s] - vertices[e])
            after = vertices[np.minimum(e + 1, len(vertices) - 1)]
            after = np.where((e < last[e])[:, None], after, 2.0 * vertices[e] - vertices[s])
            c[curved] = cubics(np.stack([before, vertices[s], vertices[e], after], axis=1))[:, 1]
        points = bezier(c)
        boxes = np.concatenate([points.min(axis=1), points.max(axis=1)], axis=1)
        _, node, counts = np.unique(vertices @ np.array([1.0, 1.0j]), return_inverse=True, return_counts=True)
        return cls(start, end, points, boxes, features, counts[node] > 1, smooth)

    @cached_property
    def ends(self) -> Int64Array:
        """(number of features + 1,) feature i has the segments ends[i] … ends[i + 1]."""
        return np.searchsorted(self.features, np.arange(len(self.smooth) + 1))

    @cached_property
    def bounds(self) -> Float64Array:
        """(number of features, 4) west, south, east, north of each feature, m."""
        bounds = np.repeat([[np.inf, np.inf, -np.inf, -np.inf]], len(self.smooth), axis=0)
        for side, ufunc in enumerate((np.minimum, np.minimum, np.maximum, np.maximum)):
            ufunc.at(bounds[:, side], self.features, self.boxes[:, side])
        return bounds

    def nearest(
        self, x: float, y: float, reach: float | Float64Array
    ) -> tuple[int, tuple[float, float]] | None:
        """Return the nearest segment within a distance (m) and the place on it."""
        west, south, east, north = self.boxes.T
        near = (west - reach <= x) & (east + reach >= x) & (south - reach <= y) & (north + reach >= y)
        rows = np.flatnonzero(near)
        if not len(rows):
            return None
        points = _BERNSTEIN @ self.points[rows]
        pieces = np.concatenate([points[:, :-1], points[:, 1:]], axis=2)
        places, distance = edits.nearest_points(pieces.reshape(-1, 4), x, y)
        excess = distance - np.repeat(np.broadcast_to(reach, len(self.start))[rows], _PIECES)
        best = int(np.argmin(excess))
        return None if excess[best] > 0.0 else (int(rows[best // _PIECES]), _pair(places[best]))

    def inside(self, layer: VectorLayer, x: float, y: float) -> int | None:
        """Return the index of the last area that a position is in."""
        (x0, y0), (x1, y1) = layer.vertices[self.start].T, layer.vertices[self.end].T
        crossed = (layer.kinds[self.features] == AREA) & ((y0 > y) != (y1 > y))
        x0, y0, x1, y1 = (each[crossed] for each in (x0, y0, x1, y1))
        right = x < x0 + (y - y0) / (y1 - y0) * (x1 - x0)
        odd = np.bincount(self.features[crossed][right], minlength=len(layer)) % 2
        found = np.flatnonzero(odd)
        return int(found[-1]) if len(found) else None


def curves_of(layer: VectorLayer) -> Curves:
    """Return a layer's curves, cached."""
    return _curves.get_or_compute(IdentityKey(layer), lambda: Curves.from_layer(layer))


def bezier(c: Float64Array) -> Float64Array:
    """Return the Bézier points of cubic polynomials (n, 2, 4), (n, 4, 2)."""
    c0, c1, c2, c3 = np.moveaxis(c, -1, 0)
    return np.stack([c0, c0 + c1 / 3.0, c0 + (2.0 * c1 + c2) / 3.0, c0 + c1 + c2 + c3], axis=1)


def _pair(place: Float64Array) -> tuple[float, float]:
    x, y = edits.on_grid(place).tolist()
    return x, y


def widths_of(sketch: Sketch, layer: VectorLayer) -> Float64Array:
    """Return the width of each line of a layer (m), 0 of the rest."""
    if "width" not in LAYERS[layer.layer].parameters:
        return np.zeros(len(layer))
    labels = {label: sketch.properties(layer.layer, label)["width"] for label in set(layer.labels.tolist())}
    return np.where(layer.kinds == LINE, layer.values("width", labels), 0.0)


def find_vector(sketch: Sketch, selection: Selection | None) -> VectorFeature | None:
    """Return the selected vector; None without one or if it is missing."""
    if selection is None or not selection.is_vector:
        return None
    layer = sketch.vectors[selection.kind]
    return layer.feature(selection.id) if selection.id in layer.ids else None


def visible_vectors(sketch: Sketch, workspace: Workspace) -> list[VectorLayer]:
    """Return the visible layers that have vectors, from bottom to top."""
    names = [name for name in DRAW_ORDER if name in VECTOR_LAYERS and workspace.look(name).visible]
    return [sketch.vectors[name] for name in names if len(sketch.vectors[name])]


def vector_at(sketch: Sketch, workspace: Workspace, x: float, y: float, *, reach: float) -> Selection | None:
    """Return the visible vector at a position (m): a line or border within a tolerance (m), else an area."""
    layers = visible_vectors(sketch, workspace)[::-1]
    for layer in layers:
        curves = curves_of(layer)
        distances = np.maximum(0.5 * widths_of(sketch, layer), reach)[curves.features]
        found = curves.nearest(x, y, distances)
        if found is not None:
            return Selection(layer.layer, int(layer.ids[curves.features[found[0]]]))
    for layer in layers:
        index = curves_of(layer).inside(layer, x, y)
        if index is not None:
            return Selection(layer.layer, int(layer.ids[index]))
    return None


def snapped(
    layer: VectorLayer, x: float, y: float, reach: float, *, to_lines: bool = False
) -> tuple[float, float] | None:
    """Return the vertex, else the place on a line, within a distance (m)."""
    vertex = edits.nearest_vertex(layer, x, y, reach)
    if vertex is not None:
        return _pair(layer.vertices[vertex])
    found = curves_of(layer).nearest(x, y, reach) if to_lines else None
    return None if found is None else found[1]


def with_node(layer: VectorLayer, x: float, y: float, reach: float) -> VectorLayer:
    """Return the layer with a vertex at a position (m) in the line or border that is nearest to it."""
    curves = curves_of(layer)
    found = None if edits.at_node(layer, x, y).any() else curves.nearest(x, y, reach)
    return layer if found is None else edits.insert_vertex(layer, int(curves.start[found[0]]), x, y)


def lines_of(feature: VectorFeature) -> list[Float64Array]:
    """Return a feature's curve or closed rings as polylines (n, 2), m."""
    if feature.kind == AREA:
        return [np.concatenate([ring, ring[:1]]) for ring in feature.rings]
    points = drop_repeats(feature.rings[0])
    if feature.properties.get("smooth") != 1 or len(points) < 2:
        return [points]
    curve = _BERNSTEIN[:-1] @ bezier(cubics(points))
    return [np.concatenate([curve.reshape(-1, 2), points[-1:]])]


def with_moved_node(
    feature: VectorFeature, start: tuple[float, float], end: tuple[float, float]
) -> VectorFeature:
    """Return a feature with its vertices at a position (m) moved to another, for previews."""
    rings = (np.where((ring == start).all(axis=1)[:, None], end, ring) for ring in feature.rings)
    return replace(feature, rings=tuple(rings))


class VectorDrag:
    """A drag of a vertex, with all vertices at its node; recorded when it is finished.

    Within `reach` (m) of another vertex it snaps to it.
    """

    def __init__(
        self,
        document: Document,
        handle: Handle,
        *,
        grab: tuple[float, float] | None = None,
        reach: float = 0.0,
    ) -> None:
        self._document, self._sketch, self._reach = document, document.sketch, reach
        self._start = handle.x, handle.y
        self._offset = (0.0, 0.0) if grab is None else (handle.x - grab[0], handle.y - grab[1])
        self._layer = layer = document.sketch.vectors[handle.selection.kind]
        self._own = edits.at_node(layer, *self._start)
        indices = np.unique(layer.feature_of_ring[layer.ring_of_vertex[self._own]])
        self.handle, self.ids = handle, tuple(layer.ids[indices].tolist())
        self._features = [layer.feature(name) for name in self.ids]
        self.x, self.y = self._start
        self.problem = ""

    @property
    def features(self) -> list[VectorFeature]:
        """The features at the node, as dragged."""
        return [with_moved_node(each, self._start, (self.x, self.y)) for each in self._features]

    def to(self, x: float, y: float) -> None:
        """Drag to a position (m)."""
        x, y = x + self._offset[0], y + self._offset[1]
        distance = np.hypot(*(self._layer.vertices - (x, y)).T)
        distance[self._own] = np.inf
        near = int(np.argmin(distance))
        self.x, self.y = _pair(
            self._layer.vertices[near] if distance[near] <= self._reach else np.array([x, y])
        )

    def finish(self) -> None:
        """Record the step, unless the document has changed; `problem` says why it was not possible."""
        if (self.x, self.y) == self._start or self._document.sketch is not self._sketch:
            return
        try:
            changed = edits.move_node(self._layer, self._start, (self.x, self.y))
            store(self._document, f"Move a node of {LAYERS[changed.layer].title.lower()}", changed)
        except InputError as error:
            self.problem = str(error)

    def cancel(self) -> None:
        self.x, self.y = self._start


def store(document: Document, title: str, layer: VectorLayer, *, merge: Hashable | None = None) -> None:
    """Record a step that replaces a vector layer."""
    sketch = document.sketch
    if layer is not sketch.vectors[layer.layer]:
        document.do(title, sketch.replace(vectors={**sketch.vectors, layer.layer: layer}), merge=merge)


def change_vector(
    document: Document,
    workspace: Workspace,
    selection: Selection | None,
    title: str,
    change: Callable[[VectorLayer, Selection], VectorLayer],
    *,
    merge: Hashable | None = None,
) -> None:
    """Record a change of a selected vector; raise InputError if it is not possible."""
    if selection is None or find_vector(document.sketch, selection) is None:
        return
    if refusal := workspace.refusal(selection.kind):
        raise InputError(refusal)
    changed = change(document.sketch.vectors[selection.kind], selection)
    store(document, f"{title} {LAYERS[selection.kind].title.lower()}", changed, merge=merge)


def insert_vertex(document: Document, workspace: Workspace, x: float, y: float, *, reach: float) -> bool:
    """Insert a vertex in the selected vector and activate it; return whether it is within a distance (m)."""
    selection = workspace.selection
    if selection is None or find_vector(document.sketch, selection) is None:
        return False
    layer = document.sketch.vectors[selection.kind]
    curves = curves_of(layer)
    own = curves.features == layer.index(selection.id)
    found = curves.nearest(x, y, np.where(own, reach, -np.inf))
    if found is None:
        return False
    after = int(curves.start[found[0]])

    def change(layer: VectorLayer, _: Selection) -> VectorLayer:
        return edits.insert_vertex(layer, after, *found[1])

    change_vector(document, workspace, selection, "Insert a vertex in", change)
    workspace.selection = replace(selection, index=after + 1 - edits.vertices_of(layer, selection.id)[0])
    return True


def delete_vector(document: Document, workspace: Workspace) -> None:
    """Delete the active vertex, or without one the selected vector."""
    selection = workspace.selection
    feature = find_vector(document.sketch, selection)
    if selection is None or feature is None:
        return
    index = selection.index
    if index is not None and index >= sum(map(len, feature.rings)):  # it has fewer vertices since an undo
        index = None

    def change(layer: VectorLayer, own: Selection) -> VectorLayer:
        if index is None:
            return layer.edited(remove=[own.id])
        return edits.delete_vertex(layer, edits.vertices_of(layer, own.id)[index])

    what = "Delete a vector of" if index is None else "Delete a vertex of"
    change_vector(document, workspace, selection, what, change)
    exists = find_vector(document.sketch, selection) is not None
    workspace.selection = replace(selection, index=max((index or 0) - 1, 0)) if exists else None


Command: TypeAlias = Callable[[Document, Workspace], None]


def _command(title: str, change: Callable[[VectorLayer, Selection], VectorLayer]) -> Command:
    def command(document: Document, workspace: Workspace) -> None:
        change_vector(document, workspace, workspace.selection, title, change)
        if workspace.selection is not None:
            workspace.selection = replace(workspace.selection, index=None)  # vertices have other numbers

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
    selection = workspace.selection
    if selection is None or find_vector(document.sketch, selection) is None:
        return ""
    return edits.to_text(document.sketch.vectors[selection.kind], [selection.id])


def paste(document: Document, workspace: Workspace, text: str) -> None:
    """Add the vectors of a text beside those that they were copied from, and select the first one."""
    name, features = edits.from_text(text)
    if refusal := workspace.refusal(name):
        raise InputError(refusal)
    layer, step, count = document.sketch.vectors[name], _OFFSET * document.sketch.extent, 1
    first = features[0].rings[0][0]
    while edits.at_node(layer, *(first + count * step * np.array([1.0, -1.0]))).any():
        count += 1
    added = layer.edited(add=[edits.moved(each, count * step, -count * step) for each in features])
    store(document, f"Paste {LAYERS[name].title.lower()}", added)
    workspace.selection = Selection(name, int(added.ids[len(layer)]))
