"""Features of the sketch's own and draped layers: picking, snapping, handles, edits of one step each."""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Final, TypeAlias

import numpy as np

from sketchterrain.array_types import Float64Array, Int64Array
from sketchterrain.document.sketch import Sketch
from sketchterrain.errors import InputError
from sketchterrain.features import edits
from sketchterrain.features.picking import PICK, nearest_place, outlines_of, snapped
from sketchterrain.features.table import AREA, DRAPED, LINE, POINT, Feature, FeatureTable, on_grid
from sketchterrain.geometry.splines import drop_repeats
from sketchterrain.schema.layers import LAYERS, VECTOR_ORDER, storey
from sketchterrain.schema.parameters import Value
from sketchterrain.ui.commands import with_vectors
from sketchterrain.ui.models import drapes
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Handle, Selection, Workspace

if TYPE_CHECKING:  # it takes a quarter of a second
    from shapely.geometry.base import BaseGeometry

LEAST_WIDTH: Final = 1.5
"""Logical px of a line on the canvas."""

_looks: dict[str, tuple[FeatureTable, object, tuple[Float64Array, Int64Array]]] = {}
"""Widths and classes of layers in use, with their labels."""

_ON_LINE = 0.01  # m
_AT_VERTEX = 0.1  # m from a vertex, where two lines that share it cross
_OFFSET = 0.02  # of what is pasted, over the sketch's extent
_MAX_HANDLES = 1000  # of vertices
_MAX_STEPS = 1500  # along an outline
_ALONG = 0.1  # m along a line, which gives its direction
_DECIMALS = 2  # of a dragged width, m
_LEAST: Final = {POINT: 1, LINE: 2, AREA: 3}  # points that are drawn
_NUMBERS: Final = {"int64": (int, "a whole number"), "float64": (float, "a number")}  # by dtype


@dataclass(frozen=True, eq=False)
class SelectedFeature:
    """A feature of the sketch's own or of a draped layer, its handles, and what becomes of them."""

    sketch: Sketch
    table: FeatureTable
    selection: Selection

    @classmethod
    def find(
        cls, document: Document, selection: Selection | None, sketch: Sketch | None = None
    ) -> SelectedFeature | None:
        """Return the selected feature, in another sketch than the document's; None without one."""
        sketch = sketch or document.sketch
        if selection is None or selection.is_placed:
            return None
        table: FeatureTable | None = (
            document.drapes.table(selection.layer) if selection.is_draped else sketch.vectors[selection.kind]
        )
        return None if table is None or selection.id not in table else cls(sketch, table, selection)

    @cached_property
    def feature(self) -> Feature:
        """Its vertices and properties."""
        return self.table.feature(self.selection.id)

    @cached_property
    def places(self) -> Float64Array:
        """(n, 2) m, its vertices."""
        return np.concatenate(self.feature.rings)

    @property
    def whole(self) -> Selection:
        """The selection of it without a vertex."""
        return replace(self.selection, index=None)

    @cached_property
    def shape(self) -> BaseGeometry:
        """How it is drawn."""
        return self.table.curve(self.feature)

    def lines(self, *, step: float = 0.0) -> list[Float64Array]:
        """Return its lines and borders, (n, 2) m; a point twice.

        Points are at most `step` m apart, unless that is 0 or there would be too many.
        """
        import shapely

        longest = max(step, self.shape.length / _MAX_STEPS)
        shape = shapely.segmentize(self.shape, longest) if step and longest else self.shape
        lines = map(shapely.get_coordinates, shapely.get_parts(outlines_of(np.array([shape]))))
        return [np.repeat(line, 2, axis=0) if len(line) == 1 else line for line in lines]

    @property
    def vertex_handles(self) -> tuple[Handle, ...]:
        """Handles of its vertices, of a large one every so many and the active one."""
        places, active = self.places.tolist(), self.selection.index
        shown = {*range(0, len(places), -(-len(places) // _MAX_HANDLES)), -1 if active is None else active}
        numbers = sorted(shown & {*range(len(places))})
        return tuple(
            Handle("point", replace(self.selection, index=at), *places[at], *places[at]) for at in numbers
        )

    @property
    def box_handles(self) -> tuple[Handle, ...]:
        """Handles at the corners of its box, of its rotation and place, and of the width of a line."""
        (west, south), (east, north) = self.places.min(axis=0).tolist(), self.places.max(axis=0).tolist()
        if not (east > west or north > south):
            return ()
        x, y, whole = 0.5 * (west + east), 0.5 * (south + north), self.whole
        corners = ((west, south), (east, south), (east, north), (west, north))
        return (
            *(Handle("corner", whole, *at, west + east - at[0], south + north - at[1]) for at in corners),
            *(Handle("rotate", whole, x, north, x, y), Handle("move", whole, x, y, x, y)),
            *self._width_handles,
        )

    @property
    def _width_handles(self) -> tuple[Handle, ...]:
        """The handle of a line's width: on its left, halfway along it; none if it is no line with one."""
        layer, line = self.table, self.shape
        half = 0.0
        if layer.layer != DRAPED:
            half = 0.5 * float(widths_of(self.sketch, layer)[layer.ids == self.selection.id].item())
        if not half:
            return ()
        (x, y), (to_x, to_y) = (
            line.interpolate(min(0.5 * line.length + step, line.length)).coords[0] for step in (0.0, _ALONG)
        )
        across = half / max(math.hypot(to_x - x, to_y - y), 1e-9)
        return (Handle("width", self.whole, x - across * (to_y - y), y + across * (to_x - x), x, y),)

    def vertex_at(self, x: float, y: float, *, reach: float) -> Handle | None:
        """Return the vertex within a distance (m) of a position; the active one first."""
        distance = np.hypot(*(self.places - (x, y)).T)
        if self.selection.index is not None and self.selection.index < len(distance):
            distance[self.selection.index] -= 1e-6
        index = int(np.argmin(distance))
        if distance[index] > reach:
            return None
        x, y = self.places[index].tolist()
        return Handle("point", replace(self.selection, index=index), x, y, x, y)

    def others_at(self, x: float, y: float) -> list[SelectedFeature]:
        """Return the other features of its network with a node at a position (m)."""
        layers = network_of(self.sketch, self.selection.kind) if self.selection.is_vector else []
        found = (Selection(layer.layer, each.id) for layer in layers for each in layer.features_at(x, y))
        vectors = self.sketch.vectors
        return [
            SelectedFeature(self.sketch, vectors[each.kind], each) for each in found if each != self.whole
        ]

    def dragged(self, handle: Handle, x: float, y: float) -> Sketch:
        """Return the sketch with a handle dragged to a position (m)."""
        base, name = np.array([handle.base_x, handle.base_y]), self.selection.id
        if handle.role == "width":
            parameter = LAYERS[self.selection.kind].parameters["width"]
            low, high = parameter.soft_range or (parameter.low, parameter.high)
            width = round(2.0 * math.dist((x, y), base), _DECIMALS)
            changed = edits.set_value(self.table, name, "width", min(max(width, low), high))
            return with_tables(self.sketch, self.selection, changed)
        start, end = np.array([handle.x, handle.y]) - base, np.array([x, y]) - base
        if handle.role == "point":
            is_vertex = np.arange(len(self.places)) == handle.selection.index
            return self._reshaped(np.where(is_vertex[:, None], (x, y), self.places))
        if handle.role == "corner":
            factors = [to / at if at and to else 1.0 for at, to in zip(start, end, strict=True)]
            return self._reshaped(base + (self.places - base) * factors)
        if handle.role == "rotate":
            turn = math.atan2(end[1], end[0]) - math.atan2(start[1], start[0])
            across, along = math.cos(turn), math.sin(turn)
            return self._reshaped(base + (self.places - base) @ [[across, along], [-along, across]])
        return self._reshaped(self.places + (end - start))

    def _reshaped(self, places: Float64Array) -> Sketch:
        """Return the sketch with its vertices at other positions (n, 2), m.

        Of the sketch's own layers the nodes move, with all that share them. A node that is moved alone onto a
        line or border is a vertex of that too.
        """
        if self.selection.is_draped:
            moved_feature = edits.with_places(self.table, self.selection.id, places)
            return with_tables(self.sketch, self.selection, moved_feature)
        moved = (self.places != on_grid(places)).any(axis=1)
        starts, ends, layers = self.places[moved], places[moved], network_of(self.sketch, self.selection.kind)
        if not len(starts):
            return self.sketch
        if len(starts) == 1:
            layers = [with_nodes(layer, on_grid(ends), other_than=starts[0].tolist()) for layer in layers]
        return with_vectors(self.sketch, *(edits.move_nodes(layer, starts, ends) for layer in layers))


def title_of(document: Document, selection: Selection) -> str:
    """Return the name of the layer of a feature in titles of steps."""
    if selection.is_draped:
        return document.sketch.drapes[selection.layer].title
    return LAYERS[selection.kind].title.lower()


def refusal(document: Document, workspace: Workspace, selection: Selection) -> str:
    """Return why the features of a layer cannot be edited; empty if they can."""
    if selection.is_draped:
        return drapes.refusal(document, workspace, selection.layer)
    return workspace.refusal(selection.kind)


def network_of(sketch: Sketch, name: str) -> list[FeatureTable]:
    """Return the layers that share nodes with a layer, itself first."""
    return [sketch.vectors[each] for each in edits.network_layers(name)]


def tables_near(document: Document, selection: Selection) -> Sequence[FeatureTable]:
    """Return the layers that the vertices of a layer snap to."""
    if selection.is_draped:
        table = document.drapes.table(selection.layer)
        return [] if table is None else [table]
    return network_of(document.sketch, selection.kind)


def with_tables(sketch: Sketch, selection: Selection, *tables: FeatureTable) -> Sketch:
    """Return the sketch with other layers in place of that of a feature, and of its network."""
    if selection.is_draped:
        layer = sketch.drapes[selection.layer].replace(edits=tables[0].edits)
        return drapes.with_layer(sketch, selection.layer, layer)
    return with_vectors(sketch, *tables)


def change_features(
    document: Document,
    workspace: Workspace,
    title: str,
    selection: Selection,
    *tables: FeatureTable,
    merge: Hashable | None = None,
) -> None:
    """Record a step that replaces the layers of a feature and its network; raise InputError if it may not."""
    if problem := refusal(document, workspace, selection):
        raise InputError(problem)
    vectors = document.sketch.vectors
    changed = [each for each in tables if each is not vectors.get(each.layer)]
    for each in changed:
        if not selection.is_draped and workspace.look(each.layer).locked:
            raise InputError(workspace.refusal(each.layer))
    if changed:
        title = f"{title} {title_of(document, selection)}"
        document.do(title, with_tables(document.sketch, selection, *changed), merge=merge)


def widths_of(sketch: Sketch, layer: FeatureTable) -> Float64Array:
    """Return the width of each line of a layer (m), 0 of the rest."""
    return looks_of(sketch, layer)[0]


def looks_of(sketch: Sketch, layer: FeatureTable) -> tuple[Float64Array, Int64Array]:
    """Return the width of each line of a layer (m), 0 of the rest, and the number of its class."""
    name = layer.layer
    if name not in _looks or _looks[name][0] is not layer or _looks[name][1] != sketch.labels:
        widths = np.zeros(len(layer))
        if "width" in LAYERS[name].parameters:
            widths = np.where(layer.kinds == LINE, sketch.vector_widths(name), 0.0)
        _looks[name] = layer, sketch.labels, (widths, _classes_of(sketch, layer))
    return _looks[name][2]


def _classes_of(sketch: Sketch, layer: FeatureTable) -> Int64Array:
    look = LAYERS[layer.layer]
    known = [each.value for each in look.classes]
    if not look.by:
        return np.zeros(len(layer), np.int64)
    if look.kind == "way":
        values = sketch.vector_widths(look.name) + 2.0 * sketch.vector_values(look.name, "shoulder")
    elif isinstance(known[0], str):
        return np.array([known.index(each) for each in sketch.vector_texts(look.name, look.by)], np.int64)
    else:
        values = sketch.vector_values(look.name, look.by)
    return np.asarray((values[:, None] < np.array(known)).sum(axis=1))


def visible_vectors(sketch: Sketch, workspace: Workspace) -> list[FeatureTable]:
    """Return the visible layers that have vectors, from bottom to top."""
    names = [name for name in VECTOR_ORDER if workspace.look(name).visible]
    return [sketch.vectors[name] for name in names if len(sketch.vectors[name])]


def vector_picks(
    sketch: Sketch, workspace: Workspace, x: float, y: float, texel: float, *, styled: bool = True
) -> Iterator[tuple[float, Selection]]:
    """Yield the visible vectors at a position (m) or near it, the topmost first, and how far (m) they are.

    The distance of what is drawn there is 0; a pixel is `texel` m. Lines are `styled` on the canvas: at least
    as wide as their class's, with its casing.
    """
    for layer in visible_vectors(sketch, workspace)[::-1]:
        (widths, classes), look = looks_of(sketch, layer), LAYERS[layer.layer]
        least = np.array([max(styled * each.style["width"], LEAST_WIDTH) for each in look.classes])
        is_cased = styled and not look.is_painted
        edge = np.array([each.casing_width if is_cased else 0.0 for each in look.classes])
        half, rims = 0.5 * np.maximum(widths, least[classes] * texel), edge[classes] * texel
        rows, distance, inside = layer.curves.near(x, y, float((half + rims).max()) + PICK * texel)
        rim = rims[rows]
        gap = np.where(inside, 0.0, np.maximum(distance - half[rows], 0.0))
        is_line = layer.kinds[rows] == LINE
        body = is_line & (gap == 0.0)  # over the rims of all ways, which are over areas
        gap = np.maximum(gap - rim, 0.0)
        for each in np.lexsort((rows, is_line, body))[::-1].tolist():
            if gap[each] <= PICK * texel:
                yield float(gap[each]), Selection(layer.layer, int(layer.ids[rows[each]]))


def snap(
    document: Document,
    workspace: Workspace,
    selection: Selection,
    x: float,
    y: float,
    reach: float,
    **options: tuple[float, float] | None,
) -> tuple[float, float] | None:
    """Return the vertex or place on a line that a new vertex of a layer snaps to, within a distance (m)."""
    tables = tables_near(document, selection)
    shown = [each for each in tables if each.layer == DRAPED or workspace.look(each.layer).visible]
    return snapped(shown, x, y, reach, **options)


def with_nodes(
    layer: FeatureTable, places: Float64Array, *, other_than: tuple[float, float] | None = None
) -> FeatureTable:
    """Return the layer with vertices at those of some positions (m) that are on its lines and borders.

    `other_than`: not in features that have a node at a position.
    """
    curves, found = layer.curves, dict[int, list[tuple[int, float, float, float]]]()
    own = [] if other_than is None else [each.id for each in layer.features_at(*other_than)]
    for x, y in np.unique(places, axis=0).tolist():
        if any(layer.features_at(x, y)):
            continue
        rows, distance, _ = curves.near(x, y, _ON_LINE)
        distance[np.isin(layer.ids[rows], own)] = np.inf
        if distance.min(initial=np.inf) <= _ON_LINE:
            feature = layer.feature(int(layer.ids[rows[np.argmin(distance)]]))
            _, after, _ = nearest_place(layer, feature, x, y)
            beyond = math.dist(np.concatenate(feature.rings)[after], (x, y))
            found.setdefault(feature.id, []).append((after, beyond, x, y))
    for name, each in found.items():
        at = np.array(sorted(each))
        layer = edits.insert_vertices(layer, name, at[:, 0].astype(np.int64), at[:, 2:])
    return layer


def with_feature(sketch: Sketch, name: str, feature: Feature) -> list[FeatureTable]:
    """Return the layers of a network, `name` first, with another feature, joined where it touches others.

    Roads, railways and paths are also joined where they cross at one level, areas where they touch.
    """
    layers = network_of(sketch, name)
    own = FeatureTable(name).edited(add=[feature])
    if feature.kind == AREA:
        own = with_nodes(own, np.concatenate([_vertices_on(own, layer) for layer in layers]))
    if LAYERS[name].kind == "way":
        own = with_nodes(own, _crossings(sketch, own, layers))
    first, *others = (with_nodes(layer, own.vertices) for layer in layers)
    return [first.edited(add=[replace(own.feature(1), id=0)]), *others]


def _vertices_on(own: FeatureTable, layer: FeatureTable) -> Float64Array:
    """Return the vertices of a layer on the lines and borders of a small one, (n, 2), m."""
    import shapely

    low, high = own.vertices.min(axis=0) - _ON_LINE, own.vertices.max(axis=0) + _ON_LINE
    pieces = [piece.vertices for piece in layer.pieces_near(*low.tolist(), *high.tolist())]
    places = np.concatenate([np.zeros((0, 2)), *pieces])
    places = places[((places >= low) & (places <= high)).all(axis=1)]
    border = shapely.union_all(outlines_of(own.curves.shapes))
    return np.asarray(places[shapely.dwithin(shapely.points(places), border, _ON_LINE)])


def _crossings(sketch: Sketch, own: FeatureTable, layers: Sequence[FeatureTable]) -> Float64Array:
    """Return where a new line crosses those at its level, away from its vertices, (n, 2), m."""
    import shapely

    (line,) = own.curves.shapes
    (level,) = _storeys(sketch, own, [0])
    found = [np.zeros((0, 2))]
    for layer in layers:
        shapes, rows = layer.curves.shapes, layer.curves.touching(line.bounds)
        rows = rows[shapely.crosses(shapes[rows], line)].tolist()
        same = [row for row, other in zip(rows, _storeys(sketch, layer, rows), strict=True) if other == level]
        found.append(shapely.get_coordinates(shapely.intersection(line, shapes[same])))
    places = on_grid(np.concatenate(found))
    near = shapely.dwithin(shapely.points(places), shapely.multipoints(own.vertices), _AT_VERTEX)
    return np.asarray(places[~near])


def _storeys(sketch: Sketch, layer: FeatureTable, rows: list[int]) -> list[int]:
    """Return the levels of some ways; those of bridges and tunnels follow from that unless they are given."""
    labels = layer.labels[rows].tolist()
    values = [
        {**sketch.properties(layer.layer, label), **own}
        for label, own in zip(labels, layer.properties(rows), strict=True)
    ]
    return [storey(each["level"], each["structure"]) for each in values]


def drag_refusal(document: Document, workspace: Workspace, handle: Handle) -> str:
    """Return why a handle cannot be dragged; empty if it can."""
    selection, own = handle.selection, SelectedFeature.find(document, handle.selection)
    problem = "" if selection.is_placed else refusal(document, workspace, selection)
    if problem or own is None or selection.is_draped or handle.role == "width":
        return problem
    moved = own.places[[selection.index or 0]] if handle.role == "point" else own.places
    names = [each.layer for each in network_of(document.sketch, selection.kind)]
    locked = (name for name in names if workspace.look(name).locked)
    shared = (name for name in locked if any(document.sketch.vectors[name].features_among(moved)))
    return next(map(workspace.refusal, shared), "")


def insert_vertex(document: Document, workspace: Workspace, x: float, y: float, *, reach: float) -> bool:
    """Insert a vertex in the selected feature and activate it; return whether it is within a distance (m)."""
    own = SelectedFeature.find(document, workspace.selection)
    if own is None or own.feature.kind == POINT:
        return False
    distance, after, place = nearest_place(own.table, own.feature, x, y)
    if distance > reach:
        return False
    changed = edits.insert_vertices(own.table, own.selection.id, [after], [place])
    change_features(document, workspace, "Insert a vertex in", own.selection, changed)
    workspace.selection = replace(own.selection, index=after + 1)
    return True


def delete_feature(document: Document, workspace: Workspace) -> None:
    """Delete the active vertex, or without one the selected feature."""
    own = SelectedFeature.find(document, workspace.selection)
    if own is None:
        return
    selection, index = own.selection, own.selection.index
    if index is None or index >= len(own.places):  # it has fewer vertices since an undo
        title, changed = "Delete a feature of", own.table.edited([selection.id])
    else:
        title, changed = "Delete a vertex of", edits.delete_vertex(own.table, selection.id, index)
    change_features(document, workspace, title, selection, changed)
    exists = selection.id in changed
    workspace.selection = replace(selection, index=max((index or 0) - 1, 0)) if exists else None


Command: TypeAlias = Callable[[Document, Workspace], None]


def _command(title: str, change: Callable[[FeatureTable, Selection], FeatureTable]) -> Command:
    def command(document: Document, workspace: Workspace) -> None:
        own = SelectedFeature.find(document, workspace.selection)
        if own is not None:
            change_features(document, workspace, title, own.selection, change(own.table, own.selection))
            workspace.selection = own.whole  # vertices have other numbers

    return command


FEATURE_COMMANDS: Final[Mapping[str, Command]] = {
    "split-line": _command(
        "Split a line of",
        lambda table, own: edits.split_line(table, own.id, -1 if own.index is None else own.index),
    ),
    "join-lines": _command("Join lines of", lambda table, own: edits.join_lines(table, own.id, own.index)),
    "reverse-line": _command("Reverse a line of", lambda table, own: edits.reverse_line(table, own.id)),
    "delete-selection": delete_feature,
}
"""Commands for the selected feature, by the names of their actions."""


def set_property(
    document: Document,
    workspace: Workspace,
    own: SelectedFeature,
    name: str,
    value: Value | None,
    key: object,
) -> None:
    """Set a property of a feature; None and an empty text remove its own value.

    Those of draped features are texts; raise InputError if one is not of its property's type.
    """
    table = own.table
    if table.layer == DRAPED and value is not None and value != "":
        convert, what = _NUMBERS.get(table.fields.get(name, ""), (str, ""))
        with suppress(ValueError):
            value, what = convert(str(value)), ""
        if what:
            raise InputError(f"{name}: expected {what}, got {value!r}")
    changed = edits.set_value(table, own.selection.id, name, None if value == "" else value)
    title = f"Set {name.replace('_', ' ')} of"
    change_features(document, workspace, title, own.selection, changed, merge=key)


def draw(
    document: Document,
    workspace: Workspace,
    target: Selection,
    label: int,
    kind: int,
    points: list[tuple[float, float]],
    *,
    smooth: bool = False,
) -> None:
    """Add a point, line or area to a layer; raise InputError if it is not possible."""
    title = title_of(document, target)
    places = drop_repeats(np.array(points) if target.is_draped else on_grid(points))
    if kind == AREA and (places[0] == places[-1]).all():
        places = places[:-1]
    if len(places) < _LEAST[kind]:
        raise InputError(f"{title[:1].upper()}{title[1:]}: expected {_LEAST[kind]} points or more")
    feature = Feature(kind, (places,), label, {"smooth": 1} if smooth else {})
    before: Sequence[FeatureTable] = tables_near(document, target)
    if target.is_draped:
        tables: Sequence[FeatureTable] = [table.edited(add=[feature]) for table in before]
    else:
        tables = with_feature(document.sketch, target.kind, feature)
    what = {POINT: "a point", LINE: "a line", AREA: "an area"}[kind]
    change_features(document, workspace, f"Draw {what} of", target, *tables)
    if target.is_draped:
        workspace.selection = replace(target, id=before[0].next_id)


def selected_text(document: Document, workspace: Workspace) -> str:
    """Return the selected feature as text; empty without one."""
    own = SelectedFeature.find(document, workspace.selection)
    return "" if own is None else edits.to_text(own.selection.kind, [own.feature])


def paste(document: Document, workspace: Workspace, text: str) -> None:
    """Add the features of a text beside those that they were copied from, and select the first one.

    Those of a draped layer are added to the chosen one.
    """
    (name, features), chosen = edits.from_text(text), workspace.selection
    target = Selection(name, 0)
    if target.is_draped and chosen is not None:
        target = replace(chosen, index=None)
    table = next(iter(tables_near(document, target)), None)
    if table is None:
        raise InputError("choose a draped layer to paste into")
    step, count, first = _OFFSET * document.sketch.extent, 1, features[0].rings[0][0]
    while any(table.features_at(*(first + count * step * np.array([1.0, -1.0])).tolist())):
        count += 1
    added = table.edited(add=[edits.moved(each, count * step, -count * step) for each in features])
    change_features(document, workspace, "Paste", target, added)
    workspace.selection = replace(target, id=table.next_id)
