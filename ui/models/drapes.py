"""Draped layers in the window: their sources and problems, choice of features, commands; one step each."""

from __future__ import annotations

import colorsys
from collections.abc import Hashable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.document.drapes import MAX_CLASSES, DrapeClass, DrapedLayer, class_value, draped_layer
from sketchterrain.errors import InputError
from sketchterrain.ui.models.background import BackgroundReader
from sketchterrain.ui.models.workspace import Selection, Workspace

if TYPE_CHECKING:  # GDAL and shapely take a quarter of a second
    from sketchterrain.document.sketch import Sketch
    from sketchterrain.drape.drapes import Drapes
    from sketchterrain.drape.raster_source import DrapedRaster
    from sketchterrain.drape.vector_source import VectorSource
    from sketchterrain.features.table import FeatureTable
    from sketchterrain.ui.models.document import Document  # which reads drapes

_GOLDEN: Final = 0.618034  # of the circle of hues, from one colour to the next


class DrapeSources(QObject):
    """The sources of a document's draped layers: new files are read in the background."""

    changed = pyqtSignal()  # `current`, `held` or `problems`

    def __init__(self, document: Document) -> None:
        super().__init__(document)
        self._document = document
        self.current: Drapes | None = None  # None without draped layers, and until the first ones are read
        self.held: tuple[int, int] | None = None  # layer and feature that are being edited
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

    def table(self, number: int) -> FeatureTable | None:
        """Return the features of a layer; None unless it is a vector file that is read."""
        return _table(self.current, number)

    def hold(self, selection: Selection | None) -> None:
        """Draw a draped feature apart from its layer while it is edited."""
        held = None if selection is None else selection.draped
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
        if self.held is not None:
            table = _table(drapes, self.held[0])
            if table is None or self.held[1] not in table:
                self.hold(None)  # before it is gone
        self.current, self._failure = drapes, ""
        self.changed.emit()

    def _fail(self, line: str) -> None:
        self._failure = f"Draped layers: {line}"
        self.changed.emit()


def _table(drapes: Drapes | None, number: int) -> FeatureTable | None:
    """Return the features of a layer of drapes; None unless it is a known vector layer."""
    with suppress(InputError):
        return None if drapes is None else drapes.table(number)
    return None


def _read(base: Drapes | None, layers: tuple[DrapedLayer, ...], place: tuple[Any, ...]) -> Drapes:
    from sketchterrain.drape.drapes import Drapes

    return Drapes.open(layers, *place) if base is None else base.updated(layers)


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
    layer, table = document.sketch.drapes[number], document.drapes.table(number)
    if table is None or by not in table.fields:
        raise InputError(f"{layer.title}: expected a property of its file, got {by!r}")
    rows = np.flatnonzero(~np.isin(table.ids, list(table.edits)))
    edits = (edit.properties.get(by) for edit in table.edits.values() if edit)
    values = set(map(class_value, [*table.values(by, rows), *edits]))
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
    is_raster = document.drapes.table(number) is None
    return f"{layer.title} has no features that can be edited." if is_raster else ""


def look_key(layer: DrapedLayer) -> str:
    """Return the name by which the workspace keeps a layer's lock."""
    return f"drape {layer.path}|{layer['table']}"
