"""Incremental sketch updates between processes, and the mirrors that apply them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.document.label_layers import Box, LabelImage, union_box
from sketchterrain.document.parameters import LAYERS
from sketchterrain.document.sketch import Sketch
from sketchterrain.ui.engine.protocol import LayerPatch, SketchUpdate

if TYPE_CHECKING:
    from sketchterrain.ui.models.document import Document


def settings_of(sketch: Sketch) -> dict[str, Any]:
    """Return every field of a sketch except its layers."""
    return {each.name: getattr(sketch, each.name) for each in fields(sketch) if each.name != "layers"}


class SketchMirror:
    """A copy of the sketch, assembled from updates.

    Unchanged layers stay the same array, so that caches keyed by identity remain valid.
    """

    def __init__(self) -> None:
        self.version = -1
        self._layers: dict[str, LabelImage] = {}
        self._settings: Mapping[str, Any] = {}
        self._changed: set[str] = set()

    def apply(self, update: SketchUpdate) -> None:
        """Apply an update."""
        first = next(iter(self._layers.values()), None)
        if first is None or first.shape != update.shape:
            empty = np.zeros(update.shape, np.uint8)
            empty.flags.writeable = False
            self._layers = dict.fromkeys(LAYERS, empty)
            self._changed = set(LAYERS)
        for name, patch in update.layers.items():
            self._patch(name, patch)
        self._settings = update.settings
        self.version = update.version

    def sketch(self) -> Sketch:
        """Return the sketch as of the last update."""
        return Sketch(**self._settings, layers=self._layers)

    def changes(self) -> SketchUpdate:
        """Return the update for another mirror since the last call."""
        shape = next(iter(self._layers.values())).shape
        layers = {name: LayerPatch(0, 0, self._layers[name]) for name in sorted(self._changed)}
        self._changed = set()
        return SketchUpdate(self.version, (shape[0], shape[1]), self._settings, layers)

    def _patch(self, name: str, patch: LayerPatch) -> None:
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
    """Collects a document's changes, including the current stroke's, into updates."""

    def __init__(self, document: Document) -> None:
        self._document = document
        self._version = 0
        self._shape = (0, 0)
        self._boxes: dict[str, Box] = {}
        self._all = self._fresh = True
        self._notify: Callable[[], None] | None = None
        document.painted.connect(self._on_painted)
        document.opened.connect(self._on_opened)

    def start(self, notify: Callable[[], None]) -> None:
        """Call `notify` on each change; the next update is complete."""
        self.stop()
        self._all, self._notify = True, notify
        self._document.live_changed.connect(notify)

    def stop(self) -> None:
        """Stop notifying."""
        if self._notify is not None:
            self._document.live_changed.disconnect(self._notify)
        self._notify = None

    def next(self) -> tuple[SketchUpdate, bool]:
        """Return the changes since the last update, and whether another document was opened."""
        sketch, fresh = self._document.sketch, self._fresh
        shape = (sketch.height_px, sketch.width_px)
        if self._all or shape != self._shape:
            # Mirrors clear layers only where the shape differs, so empty ones are sent as well.
            self._boxes = dict.fromkeys(LAYERS, (0, 0, *shape))
        layers = {name: self._patch(name, box) for name, box in self._boxes.items()}
        self._shape, self._boxes = shape, {}
        self._all = self._fresh = False
        self._version += 1
        return SketchUpdate(self._version, shape, settings_of(sketch), layers), fresh

    def _patch(self, name: str, box: Box) -> LayerPatch:
        top, left, bottom, right = max(box[0], 0), max(box[1], 0), box[2], box[3]
        image = self._document.layer(name)
        pixels = image[top:bottom, left:right]
        # A sketch's arrays never change; a stroke's do.
        return LayerPatch(top, left, pixels.copy() if image.flags.writeable else pixels)

    def _on_painted(self, layer: str, box: Box) -> None:
        self._boxes[layer] = union_box(self._boxes.get(layer), box) or box

    def _on_opened(self) -> None:
        self._all = self._fresh = True
