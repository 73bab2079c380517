"""Incremental updates of a sketch, sent between processes, and the copies that follow them."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.sketch.box import Box, union_box
from sketchterrain.ui.engine.protocol import LayerPatch, SketchUpdate

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from sketchterrain.sketch.document import LabelImage
    from sketchterrain.ui.models.document import Document


def settings_of(sketch: Sketch) -> dict[str, Any]:
    """Return every field of a sketch but its layers."""
    return {each.name: getattr(sketch, each.name) for each in fields(sketch) if each.name != "layers"}


class SketchMirror:
    """The newest sketch, put together from updates.

    A layer that an update leaves as it was stays the same array, so that all that is remembered of it holds.
    """

    def __init__(self) -> None:
        self.version = -1
        self._layers: dict[str, LabelImage] = {}
        self._settings: Mapping[str, Any] = {}
        self._changed: set[str] = set()

    def apply(self, update: SketchUpdate) -> None:
        """Take an update over."""
        first = next(iter(self._layers.values()), None)
        if first is None or first.shape != update.shape:
            empty = np.zeros(update.shape, np.uint8)
            empty.flags.writeable = False
            self._layers = dict.fromkeys(LAYERS, empty)
            self._changed = set(LAYERS)
        for name, patch in update.layers.items():
            self._put(name, patch)
        self._settings = update.settings
        self.version = update.version

    def sketch(self) -> Sketch:
        """Return the sketch as of the last update."""
        return Sketch(**self._settings, layers=self._layers)

    def changes(self) -> SketchUpdate:
        """Return what another mirror needs to follow, since this was asked last."""
        shape = next(iter(self._layers.values())).shape
        layers = {name: LayerPatch(0, 0, self._layers[name]) for name in sorted(self._changed)}
        self._changed = set()
        return SketchUpdate(self.version, (shape[0], shape[1]), self._settings, layers)

    def _put(self, name: str, patch: LayerPatch) -> None:
        image = self._layers[name]
        rows, columns = patch.pixels.shape
        place = (slice(patch.row, patch.row + rows), slice(patch.column, patch.column + columns))
        if np.array_equal(image[place], patch.pixels):
            return
        if patch.pixels.shape == image.shape:
            image = np.array(patch.pixels)
        else:
            image = image.copy()
            image[place] = patch.pixels
        image.flags.writeable = False
        self._layers[name] = image
        self._changed.add(name)


class UpdateBuilder:
    """Listens to a document, the stroke that is being drawn included."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._version = 0
        self._shape = (0, 0)
        self._boxes: dict[str, Box] = {}
        self._all = self._fresh = True
        self._tell: Callable[[], None] | None = None

    def start(self, tell: Callable[[], None]) -> None:
        """Call `tell` whenever there is something to send; the next update holds everything."""
        self._all = True
        if self._tell is None:
            self._document.painted.connect(self._painted)
            self._document.opened.connect(self._opened)
            self._document.live_changed.connect(tell)
        self._tell = tell

    def stop(self) -> None:
        """Listen no more."""
        if self._tell is not None:
            self._document.painted.disconnect(self._painted)
            self._document.opened.disconnect(self._opened)
            self._document.live_changed.disconnect(self._tell)
        self._tell = None

    def next(self) -> tuple[SketchUpdate, bool]:
        """Return what changed since the last one, and whether it is of another document."""
        sketch = self._document.sketch
        shape = (sketch.height_px, sketch.width_px)
        if self._all or shape != self._shape:
            self._shape, fresh = shape, self._fresh
            # Layers begin empty only where the shape is another one, so empty ones are sent as well.
            layers = {name: self._patch(name, (0, 0, *shape)) for name in LAYERS}
        else:
            fresh = self._fresh
            layers = {name: self._patch(name, box) for name, box in self._boxes.items()}
        self._all = self._fresh = False
        self._boxes = {}
        self._version += 1
        return SketchUpdate(self._version, shape, settings_of(sketch), layers), fresh

    def _patch(self, name: str, box: Box) -> LayerPatch:
        top, left, bottom, right = box
        image = self._document.layer(name)
        pixels = image[max(top, 0) : bottom, max(left, 0) : right]
        # A sketch's own arrays never change; a stroke's do.
        still = not image.flags.writeable
        return LayerPatch(max(top, 0), max(left, 0), pixels if still else pixels.copy())

    def _painted(self, layer: str, box: Box) -> None:
        self._boxes[layer] = union_box(self._boxes.get(layer), box) or box

    def _opened(self) -> None:
        self._all = self._fresh = True
