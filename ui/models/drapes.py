"""Draped layers in the window: their sources and problems, choice of features, commands; one step each."""

from __future__ import annotations

import colorsys
from collections.abc import Hashable
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, cast

import numpy as np
from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.array_types import Float64Array
from sketchterrain.document.drapes import MAX_CLASSES, DrapeClass, DrapedLayer, FeatureEdit, draped_layer
from sketchterrain.errors import InputError
from sketchterrain.ui.models.background import BackgroundReader
from sketchterrain.ui.models.workspace import Selection, Workspace

if TYPE_CHECKING:  # GDAL and shapely take a quarter of a second
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.drape.raster_source import RasterSource
    from sketchterrain.drape.vector_source import Feature, VectorSource
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.selection import Handle

_REACH: Final = 3.0  # px from a line or point that is found, as by `Drapes.pick`
_MAX_HANDLES: Final = 1000  # of vertices
_GOLDEN: Final = 0.618034  # of the circle of hues, from one colour to the next


class DrapeSources(QObject):
    """The sources of a document's draped layers: new files are read in the background."""

    changed = pyqtSignal()  # `current`, `held` or `problems`

    def __init__(self, document: Document) -> None:
        super().__init__(document)
        self._document = document
        self.current: Drapes | None = None  # None without draped layers, and until the first ones are read
        self.held: tuple[int, int] | None = None  # layer and feature that are being edited
        self._shown: tuple[DrapedLayer, ...] = ()
        self._at: tuple[object, ...] = ()
        self._reader = BackgroundReader(self)
        document.sketch_changed.connect(self._update)
        self._update()

    @property
    def is_busy(self) -> bool:
        return self._reader.is_busy

    @property
    def problems(self) -> tuple[str, ...]:
        """A line for each layer whose file is missing, unreadable or has changed."""
        return () if self.current is None else self.current.problems

    def feature(self, selection: Selection | None) -> Feature | None:
        """Return the selected feature; None without one or if it is missing."""
        current = self.current
        if current is None or selection is None or not selection.is_draped or selection.id < 0:
            return None
        with suppress(InputError, IndexError):
            return current.feature(selection.layer, selection.id)
        return None

    def stack(self, x: float, y: float, texel: float) -> list[Selection]:
        """Return the features at a place (m), the highest first, at a scale of `texel` m a pixel."""
        top = None if self.current is None else self.current.pick(x, y, texel)
        if self.current is None or top is None or top.feature < 0:  # a raster hides those below it
            return []
        from sketchterrain.drape.drapes import distances, winding

        reach, found = _REACH * texel, [(top.layer, top.feature)]
        items = self.current.items((x - reach, y - reach, x + reach, y + reach), texel)
        for layer in range(top.layer, -1, -1):
            own = items.taken(items.layer == layer)
            near = {*own.feature[distances(own, x, y) <= reach].tolist(), *winding(own, x, y).tolist()}
            found += [(layer, each) for each in sorted(near, reverse=True) if (layer, each) != found[0]]
        return [Selection("drape", each, layer=layer) for layer, each in found]

    def hold(self, selection: Selection | None) -> None:
        """Draw a feature apart from its layer while it is edited."""
        held = None if selection is None or selection.id < 0 else (selection.layer, selection.id)
        if held != self.held:
            self.held = held
            self.changed.emit()

    def _update(self) -> None:
        from_sketch = self._document.sketch
        layers = from_sketch.drapes
        at = from_sketch.frame, from_sketch.size, from_sketch.extent
        if layers is self._shown and at == self._at:
            return
        known = {each.source_key for each in self._shown} if at == self._at else set()
        is_read = self.current is not None and known.issuperset(each.source_key for each in layers)
        if not layers or is_read:
            self._reader.cancel()
            self._show(at, None if not layers or self.current is None else self.current.updated(layers))
        else:
            base = self.current if at == self._at else None
            self._reader.read(partial(_read, from_sketch, base), partial(self._show, at))

    def _show(self, at: tuple[object, ...], found: object) -> None:
        self.current, self._at = cast("Drapes | None", found), at
        self._shown = () if self.current is None else self.current.layers
        self.changed.emit()


def _read(sketch: Sketch, base: Drapes | None) -> Drapes:
    from sketchterrain.drape.drapes import Drapes

    if base is not None:
        return base.updated(sketch.drapes)
    return Drapes.open(sketch.drapes, sketch.frame, sketch.size, sketch.extent)


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
    document: Document, number: int, title: str, *, merge: Hashable | None = None, **changes: Any
) -> None:
    """Record a step that changes fields, or values by the names in `DRAPE` and `STYLE`, of a layer."""
    layers = list(document.sketch.drapes)
    before = layers[number]
    layers[number] = before.replace(**changes)
    if layers[number] != before:
        _do(document, f"{title} {before.title}", layers, merge)


def _do(document: Document, title: str, layers: list[DrapedLayer], merge: Hashable | None = None) -> None:
    document.do(title, document.sketch.replace(drapes=tuple(layers)), merge=merge)


def add_drapes(document: Document, workspace: Workspace, added: list[DrapedLayer]) -> None:
    """Record a step that adds layers above the others, and choose the last one."""
    layers = [*document.sketch.drapes, *added]
    title = added[0].title if len(added) == 1 else f"{len(added)} draped layers"
    _do(document, f"Add {title}", layers)
    workspace.selection = Selection("drape", -1, layer=len(layers) - 1)


def remove_drape(document: Document, workspace: Workspace, number: int) -> None:
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
        workspace.selection = Selection("drape", -1, layer=to)
        _do(document, f"Move {layers[to].title}", layers)


def update_file(document: Document, number: int) -> None:
    """Take a layer's file as it is now."""
    digest = draped_layer(Path(document.sketch.drapes[number].path))["sha256"]
    change_drape(document, number, "Update", sha256=digest)


def set_class_style(
    document: Document, number: int, index: int, name: str, value: Any, *, merge: Hashable | None = None
) -> None:
    """Set a style of a layer, or of a class by its index; None is the layer's, or of that the default."""
    layer = document.sketch.drapes[number]
    title = f"Set {name.replace('_', ' ')} of"
    if index < 0:
        change_drape(document, number, title, merge=merge, **{name: value})
        return
    classes = list(layer.classes)
    style = {key: each for key, each in classes[index].style.items() if key != name}
    classes[index] = replace(classes[index], style=style if value is None else {**style, name: value})
    change_drape(document, number, title, merge=merge, classes=tuple(classes))


def classify(document: Document, number: int, by: str) -> None:
    """Make a class of each value of a property, in colours of its own; raise InputError for too many."""
    from sketchterrain.drape.vector_source import VectorSource, class_value

    layer, source = document.sketch.drapes[number], _source(document, number)
    if not isinstance(source, VectorSource) or by not in source.fields:
        raise InputError(
            f"{layer.title}: expected a property, one of {', '.join(property_names(document, number))}"
        )
    values = {class_value(each) for each in source.values(by, range(source.next_id))}
    if len(values) > MAX_CLASSES:
        raise InputError(f"{layer.title}: {by} has {len(values)} values; expected at most {MAX_CLASSES}")
    colours = map(distinct_colour, range(len(values)))
    classes = (
        DrapeClass(value, {"colour": each, "fill": each})
        for value, each in zip(sorted(values), colours, strict=True)
    )
    change_drape(document, number, "Classify", by=by, classes=tuple(classes))


def refusal(document: Document, workspace: Workspace, number: int) -> str:
    """Return why features of a layer cannot be edited; empty if they can."""
    layer = document.sketch.drapes[number]
    if workspace.look(look_key(layer)).locked:
        return f"{layer.title} is locked. Unlock the layer to edit it."
    if not layer["visible"]:
        return f"{layer.title} is hidden. Show the layer to edit it."
    return "" if is_vector(document, number) else f"{layer.title} has no features that can be edited."


def look_key(layer: DrapedLayer) -> str:
    """Return the name by which the workspace keeps a layer's lock."""
    return f"drape {layer.path}|{layer['table']}"


def _source(document: Document, number: int) -> VectorSource | RasterSource | None:
    current = document.drapes.current
    return None if current is None or number >= len(current.sources) else current.sources[number]


def is_vector(document: Document, number: int) -> bool:
    """Return whether a layer is known to have features."""
    return hasattr(_source(document, number), "fields")


def kind_and_size(feature: Feature) -> tuple[str, str]:
    """Return what a feature is in a word, and its size."""
    shape = feature.geometry
    if shape.area > 0.0:
        return "Area", f"{shape.area / 1e6:.3g} km²"
    return ("Line", f"{shape.length / 1e3:.3g} km") if shape.length else ("Point", "")


def outlines_of(document: Document, selection: Selection) -> tuple[Float64Array, ...]:
    """Return the lines and borders of the selected feature, (n, 2) m; a point twice."""
    import shapely

    feature = document.drapes.feature(selection)
    if feature is None:
        return ()
    shape = feature.geometry
    lines = shapely.get_parts(shapely.boundary(shape) if shape.area else shape)
    points = map(shapely.get_coordinates, lines)
    return tuple(np.repeat(line, 2, axis=0) if len(line) == 1 else line for line in points)


def draped_handles(document: Document, selection: Selection | None) -> tuple[Handle, ...]:
    """Return the handles of a feature: its vertices, corners of its box, and one that rotates it."""
    import shapely

    from sketchterrain.ui.models.selection import Handle

    feature = document.drapes.feature(selection)
    if feature is None or selection is None:
        return ()
    whole, places = replace(selection, index=None), shapely.get_coordinates(feature.geometry)
    step = -(-len(places) // _MAX_HANDLES)
    vertices = [
        Handle("point", replace(whole, index=at), *places[at].tolist(), *places[at].tolist())
        for at in range(0, len(places), step)
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


def _with_edit(sketch: Sketch, layer: int, edit: FeatureEdit) -> Sketch:
    drapes = list(sketch.drapes)
    drapes[layer] = drapes[layer].replace(edits={**drapes[layer].edits, edit.id: edit})
    return sketch.replace(drapes=tuple(drapes))


def dragged_feature(sketch: Sketch, feature: Feature, handle: Handle, x: float, y: float) -> Sketch:
    """Return the sketch with a handle of a feature, as it was before, dragged to a position (m)."""
    raise NotImplementedError


def delete_draped(document: Document, workspace: Workspace) -> None:
    """Delete the active vertex, or without one the selected feature."""
    raise NotImplementedError


def insert_draped_vertex(
    document: Document, workspace: Workspace, x: float, y: float, *, reach: float
) -> bool:
    """Insert a vertex in the selected feature and activate it; return whether it is within a distance (m)."""
    return False


def draw_draped(
    document: Document, workspace: Workspace, number: int, points: list[tuple[float, float]]
) -> None:
    """Add a feature of the kind that the workspace draws, and select it."""
    raise NotImplementedError


def set_property(
    document: Document, workspace: Workspace, selection: Selection, name: str, text: str
) -> None:
    raise NotImplementedError


def property_names(document: Document, number: int) -> list[str]:
    """Return the names of the properties that a layer's file has."""
    return [*getattr(_source(document, number), "fields", ())]


def bounds_of(document: Document, number: int) -> tuple[float, float, float, float] | None:
    """Return west, south, east and north (m) of a layer; None if it cannot be read."""
    source = _source(document, number)
    return None if source is None else tuple(source.box.tolist())
