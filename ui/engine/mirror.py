"""A process's own copy of the sketch, which follows the window's by what changed."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import numpy as np

from sketchterrain.sketch import LAYERS, Sketch
from sketchterrain.ui.engine.orders import LayerPatch, SketchUpdate

if TYPE_CHECKING:
    from collections.abc import Mapping

    from sketchterrain.sketch.document import LabelImage

__all__ = ["SketchMirror", "settings_of"]


def settings_of(sketch: Sketch) -> dict[str, Any]:
    """Return every field of a sketch but its layers."""
    return {each.name: getattr(sketch, each.name) for each in fields(sketch) if each.name != "layers"}


class SketchMirror:
    """The newest sketch, put together from updates.

    A layer that an update leaves as it was stays the same array, so that all that is remembered of it holds.

    Attributes
    ----------
    version : int
        Of the last update; −1 before the first.
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
        """Return the sketch as of the last update.

        Raises
        ------
        InputError
            If a setting is out of range.
        """
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
