"""What changed of a document since it was sent last, without comparing pixels."""

from __future__ import annotations

from typing import TYPE_CHECKING

from sketchterrain.sketch import LAYERS
from sketchterrain.sketch.box import around
from sketchterrain.ui.engine.mirror import settings_of
from sketchterrain.ui.engine.orders import LayerPatch, SketchUpdate

if TYPE_CHECKING:
    from collections.abc import Callable

    from sketchterrain.ui.models.document import Box, Document

__all__ = ["UpdateMaker"]


class UpdateMaker:
    """Listens to a document, the stroke that is being drawn included.

    Parameters
    ----------
    document
    """

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
        self._boxes[layer] = around(self._boxes.get(layer), box) or box

    def _opened(self) -> None:
        self._all = self._fresh = True
