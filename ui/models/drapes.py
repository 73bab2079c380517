"""Draped layers in the window: their sources and problems, choice of features, commands; one step each."""

from __future__ import annotations

import colorsys
import math
from collections.abc import Callable, Hashable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeAlias, cast

import numpy as np
from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.array_types import Float64Array
from sketchterrain.document.drapes import MAX_CLASSES, DrapeClass, DrapedLayer, class_value, draped_layer
from sketchterrain.errors import InputError
from sketchterrain.geometry.splines import drop_repeats
from sketchterrain.ui.models.background import BackgroundReader
from sketchterrain.ui.models.workspace import Handle, Selection, Workspace

if TYPE_CHECKING:  # GDAL and shapely take a quarter of a second
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.drape.raster_source import DrapedRaster
    from sketchterrain.drape.vector_source import Feature, VectorSource
    from sketchterrain.ui.models.document import Document  # which reads drapes

_Change: TypeAlias = "Callable[[DrapedLayer, Feature], DrapedLayer]"

_MAX_HANDLES: Final = 1000  # of vertices
_MAX_STEPS: Final = 1500  # along an outline
_NUMBERS: Final = {"int64": (int, "a whole number"), "float64": (float, "a number")}  # by dtype
_GOLDEN: Final = 0.618034  # of the circle of hues, from one colour to the next


class DrapeSources(QObject):
    """The sources of a document's draped layers: new files are read in the background."""

    changed = pyqtSignal()  # `current`, `held` or `problems`

    def __init__(self, document: Document) -> None:
        super().__init__(document)
        self._document = document
        self.current: Drapes | None = None  # None without draped layers, and until the first ones are read
        self.held: tuple[int, int] | None = None  # layer and feature that are being edited
        self._found: tuple[object, Feature | None] = (None, None)  # the last one
        self._wanted: tuple[object, ...] = ()
        self._failure = ""
        self._reader = BackgroundReader(self)
        self._reader.failed.connect(self._fail)
        document.sketch_changed.connect(self._update)
        self._update()

    @property
    def is_busy(self) -> bool:
        return self._reader.is_busy

    @property
    def problems(self) -> tuple[str, ...]:
        """A line for each layer whose file is missing, unreadable or has changed."""
        lines = () if self.current is None else (*self.current.problems, *self.current.notes)
        return (*lines, self._failure) if self._failure else lines

    def source(self, number: int) -> VectorSource | DrapedRaster | None:
        """Return a layer's source; None until it is read, and if it cannot be."""
        current = self.current
        return None if current is None or number >= len(current.sources) else current.sources[number]

    def fields(self, number: int) -> Mapping[str, str] | None:
        """Return the types of the properties in a layer's file; None unless it is a known vector file."""
        return getattr(self.source(number), "fields", None)

    def feature(self, selection: Selection | None) -> Feature | None:
        """Return the selected feature; None without one or if it is missing."""
        if self.current is None or selection is None or not selection.is_draped or selection.id < 0:
            return None
        key = self.current, selection.layer, selection.id
        if key != self._found[0]:
            self._found = key, _find(*key)
        return self._found[1]

    def hold(self, selection: Selection | None) -> None:
        """Draw a draped feature apart from its layer while it is edited."""
        held = None if selection is None or not selection.is_draped else (selection.layer, selection.id)
        if held != self.held:
            self.held = held
            self.changed.emit()

    def _update(self) -> None:
        sketch, current = self._document.sketch, self.current
        layers, place = sketch.drapes, (sketch.frame, sketch.size, sketch.extent)
        if self._wanted == (layers, place):
            return
        self._wanted = layers, place
        self._reader.cancel()
        if current is not None and (current.frame, current.size, current.extent) != place:
            current = None
        known = set() if current is None else {each.source_key for each in current.layers}
        if not layers:
            self._show(None)
        elif current is not None and known.issuperset(each.source_key for each in layers):
            self._show(current.updated(layers))
        else:
            self._reader.read(partial(_read, current, layers, place), self._show)

    def _show(self, drapes: Drapes | None) -> None:
        if self.held is not None and (drapes is None or _find(drapes, *self.held) is None):
            self.hold(None)  # before it is gone
        self.current, self._failure = drapes, ""
        self.changed.emit()

    def _fail(self, line: str) -> None:
        self._failure = f"Draped layers: {line}"
        self.changed.emit()


def _read(base: Drapes | None, layers: tuple[DrapedLayer, ...], place: tuple[Any, ...]) -> Drapes:
    from sketchterrain.drape.drapes import Drapes

    return Drapes.open(layers, *place) if base is None else base.updated(layers)


def _find(drapes: Drapes, layer: int, number: int) -> Feature | None:
    with suppress(InputError, IndexError):
        return drapes.feature(layer, number)
    return None


def new_drape(path: Path, number: int) -> DrapedLayer:
    """Return a layer of a file, in the colour of a number; raise InputError if it cannot be read."""
    colour = distinct_colour(number)
    return draped_layer(path, colour=colour, fill=colour)


def distinct_colour(number: int) -> str:
    """Return one of many colours, each far from the ones before it."""
    value = 0.85 if number // 8 % 2 == 0 else 0.6
    red, green, blue = (round(255 * part) for part in colorsys.hsv_to_rgb(number * _GOLDEN % 1.0, 0.7, value))
    return f"#{red:02x}{green:02x}{blue:02x}"


def change_drape(
    document: Document, number: int, step: str, /, *, merge: Hashable | None = None, **changes: Any
) -> None:
    """Record a step that changes fields, or values by the names in `DRAPE` and `STYLE`, of a layer."""
    before = document.sketch.drapes[number]
    changed = before.replace(**changes)
    if changed != before:
        document.do(f"{step} {before.title}", with_layer(document.sketch, number, changed), merge=merge)


def with_layer(sketch: Sketch, number: int, layer: DrapedLayer) -> Sketch:
    """Return the sketch with another layer in place of one."""
    return sketch.replace(drapes=(*sketch.drapes[:number], layer, *sketch.drapes[number + 1 :]))


def _do(document: Document, title: str, layers: list[DrapedLayer]) -> None:
    document.do(title, document.sketch.replace(drapes=tuple(layers)))


def add_drapes(document: Document, workspace: Workspace, added: list[DrapedLayer]) -> None:
    """Record a step that adds layers above the others, and choose the last one."""
    layers = [*document.sketch.drapes, *added]
    title = added[0].title if len(added) == 1 else f"{len(added)} draped layers"
    _do(document, f"Add {title}", layers)
    workspace.selection = Selection("drape", -1, layer=len(layers) - 1)


def remove_drape(document: Document, workspace: Workspace, number: int) -> None:
    """Record a step that removes a layer."""
    layers = list(document.sketch.drapes)
    gone = layers.pop(number)
    workspace.selection = None
    _do(document, f"Remove {gone.title}", layers)


def move_drape(document: Document, workspace: Workspace, number: int, to: int) -> None:
    """Record a step that moves a layer to another place in the order, from the lowest on."""
    layers = list(document.sketch.drapes)
    to = min(max(to, 0), len(layers) - 1)
    if to != number:
        layers.insert(to, layers.pop(number))
        _do(document, f"Move {layers[to].title}", layers)
        workspace.selection = Selection("drape", -1, layer=to)


def classify(document: Document, number: int, by: str) -> None:
    """Make a class of each value of a property, in colours of its own; raise InputError for too many."""
    from sketchterrain.drape.vector_source import VectorSource

    layer, source = document.sketch.drapes[number], document.drapes.source(number)
    if not isinstance(source, VectorSource) or by not in source.fields:
        raise InputError(f"{layer.title}: expected a property of its file, got {by!r}")
    values = {class_value(each) for each in source.values(by, range(source.next_id))}
    if len(values) > MAX_CLASSES:
        raise InputError(f"{layer.title}: {by} has {len(values)} values; expected at most {MAX_CLASSES}")
    colours = map(distinct_colour, range(len(values)))
    styles = ({"colour": colour, "fill": colour} for colour in colours)
    change_drape(document, number, "Classify", by=by, classes=tuple(map(DrapeClass, sorted(values), styles)))


def refusal(document: Document, workspace: Workspace, number: int) -> str:
    """Return why features of a layer cannot be edited; empty if they can."""
    layer = document.sketch.drapes[number]
    if workspace.look(look_key(layer)).locked:
        return f"{layer.title} is locked. Unlock the layer to edit it."
    if not layer["visible"]:
        return f"{layer.title} is hidden. Show the layer to edit it."
    is_vector = document.drapes.fields(number) is not None
    return "" if is_vector else f"{layer.title} has no features that can be edited."


def look_key(layer: DrapedLayer) -> str:
    """Return the name by which the workspace keeps a layer's lock."""
    return f"drape {layer.path}|{layer['table']}"


def kind_and_size(feature: Feature) -> tuple[str, str]:
    """Return a feature's kind and size."""
    shape = feature.geometry
    if shape.area > 0.0:
        return "Area", f"{shape.area / 1e6:.3g} km²"
    return ("Line", f"{shape.length / 1e3:.3g} km") if shape.length else ("Point", "")


def outlines_of(
    document: Document, selection: Selection | None, *, step: float = 0.0
) -> tuple[Float64Array, ...]:
    """Return the lines and borders of the selected feature, (n, 2) m; a point twice.

    Points are at most `step` m apart, unless that is 0 or there would be too many.
    """
    import shapely

    feature = document.drapes.feature(selection)
    if feature is None:
        return ()
    shape = feature.geometry
    if step:
        shape = shapely.segmentize(shape, max(step, shape.length / _MAX_STEPS))
    shape = shapely.boundary(shape) if shapely.get_dimensions(shape) == 2 else shape
    lines = map(shapely.get_coordinates, shapely.get_parts(shape))
    return tuple(np.repeat(line, 2, axis=0) if len(line) == 1 else line for line in lines)


def draped_handles(
    document: Document, selection: Selection | None, *, spacing: float = 0.0
) -> tuple[Handle, ...]:
    """Return the handles of a feature: its vertices, corners of its box, and those that rotate and move it.

    Of the vertices in a square of `spacing` m it is the first one; the active one is among them.
    """
    import shapely

    feature = document.drapes.feature(selection)
    if feature is None or selection is None:
        return ()
    whole, places = replace(selection, index=None), shapely.get_coordinates(feature.geometry)
    some = np.arange(0, len(places), -(-len(places) // _MAX_HANDLES))
    if spacing:
        some = some[np.unique(places[some] // spacing, axis=0, return_index=True)[1]]
    active = -1 if selection.index is None else selection.index
    shown = {*some.tolist(), active} & {*range(len(places))}
    vertices = [
        Handle("point", replace(whole, index=at), *places[at].tolist(), *places[at].tolist())
        for at in sorted(shown)
    ]
    (west, south), (east, north) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
    x, y = 0.5 * (west + east), 0.5 * (south + north)
    if not (east > west or north > south):
        return tuple(vertices)
    corners = [
        Handle("corner", whole, at_x, at_y, west + east - at_x, south + north - at_y)
        for at_x, at_y in ((west, south), (east, south), (east, north), (west, north))
    ]
    return (*vertices, *corners, Handle("rotate", whole, x, north, x, y), Handle("move", whole, x, y, x, y))


def dragged_feature(sketch: Sketch, feature: Feature, handle: Handle, x: float, y: float) -> Sketch:
    """Return the sketch with a handle of a feature, as it was before, dragged to a position (m)."""
    from sketchterrain.drape import feature_edits as edits

    number, index = handle.selection.layer, handle.selection.index
    layer, base = sketch.drapes[number], (handle.base_x, handle.base_y)
    start, end = (handle.x - base[0], handle.y - base[1]), (x - base[0], y - base[1])
    if handle.role == "point" and index is not None:
        changed = edits.move_vertex(layer, feature, index, x, y)
    elif handle.role == "corner":
        east, north = (to / at if at and to else 1.0 for at, to in zip(start, end, strict=True))
        changed = edits.scale_feature(layer, feature, (east, north), base)
    elif handle.role == "rotate":
        turn = math.atan2(end[1], end[0]) - math.atan2(start[1], start[0])
        changed = edits.rotate_feature(layer, feature, math.degrees(turn), base)
    else:
        changed = edits.move_feature(layer, feature, x - handle.x, y - handle.y)
    return with_layer(sketch, number, changed)


def _edit(document: Document, workspace: Workspace, title: str, change: _Change) -> bool:
    """Record a step that changes the selected feature; return whether there is one, or raise InputError."""
    selection, feature = workspace.selection, document.drapes.feature(workspace.selection)
    if selection is None or feature is None:
        return False
    if problem := refusal(document, workspace, selection.layer):
        raise InputError(problem)
    layer = document.sketch.drapes[selection.layer]
    changed = with_layer(document.sketch, selection.layer, change(layer, feature))
    document.do(f"{title} of {layer.title}", changed)
    return True


def delete_draped(document: Document, workspace: Workspace) -> None:
    """Delete the active vertex, or without one the selected feature."""
    from sketchterrain.drape import feature_edits as edits

    selection = workspace.selection
    if selection is None or selection.index is None:
        if _edit(document, workspace, "Delete a feature", edits.delete_feature):
            workspace.selection = None
        return
    _edit(document, workspace, "Delete a vertex", partial(edits.delete_vertex, vertex=selection.index))
    is_left = document.drapes.feature(selection) is not None
    workspace.selection = replace(selection, index=max(selection.index - 1, 0)) if is_left else None


def insert_draped_vertex(
    document: Document, workspace: Workspace, x: float, y: float, *, reach: float
) -> bool:
    """Insert a vertex in the selected feature and activate it; return whether it is within a distance (m)."""
    import shapely

    from sketchterrain.drape import feature_edits as edits

    selection, feature = workspace.selection, document.drapes.feature(workspace.selection)
    if selection is None or feature is None or feature.geometry.length == 0.0:
        return False
    lines, at = outlines_of(document, selection), shapely.Point(x, y)
    points = np.concatenate(lines)
    segments = shapely.linestrings(np.stack([points[:-1], points[1:]], axis=1))
    distance = shapely.distance(segments, at)
    distance[np.cumsum([len(line) for line in lines])[:-1] - 1] = np.inf  # from one line to the next
    after = int(distance.argmin())
    if distance[after] >= reach:
        return False
    x, y = segments[after].interpolate(segments[after].project(at)).coords[0]
    _edit(document, workspace, "Insert a vertex", partial(edits.insert_vertex, vertex=after, x=x, y=y))
    workspace.selection = replace(selection, index=after + 1)
    return True


def draw_draped(
    document: Document, workspace: Workspace, number: int, points: list[tuple[float, float]]
) -> None:
    """Add a feature of the kind that the workspace draws, and select it; raise InputError if it cannot be."""
    import shapely

    from sketchterrain.drape.feature_edits import create_feature

    layer, kind = document.sketch.drapes[number], workspace.drape_kind
    source = cast("VectorSource", document.drapes.source(number))  # others are refused
    places = drop_repeats(np.array(points))
    least, make = {
        "point": (1, lambda places: shapely.Point(places[0])),
        "line": (2, shapely.LineString),
        "area": (3, shapely.Polygon),
    }[kind]
    if len(places) < least:
        raise InputError(f"{layer.title}: expected {least} points or more")
    changed, feature = create_feature(layer, source, make(places), dict.fromkeys(source.fields))
    document.do(f"Draw {kind} of {layer.title}", with_layer(document.sketch, number, changed))
    workspace.selection = Selection("drape", feature, layer=number)


def set_property(document: Document, workspace: Workspace, name: str, text: str) -> None:
    """Set a property of the selected feature from a text; raise InputError if it is of another type."""
    from sketchterrain.drape.feature_edits import set_properties

    selection = workspace.selection
    if selection is None:
        return
    kind = (document.drapes.fields(selection.layer) or {}).get(name, "")
    convert, what = _NUMBERS.get(kind, (str, ""))
    try:
        value = convert(text) if text else None
    except ValueError:
        raise InputError(f"{name}: expected {what}, got {text!r}") from None
    _edit(document, workspace, f"Set {name}", partial(set_properties, values={name: value}))
