"""The open sketch: history, current stroke, file path."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from pathlib import Path

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.caching import LRUCache
from sketchterrain.document.history import History, ImageChange
from sketchterrain.document.label_layers import (
    MAX_LABELS,
    Box,
    LabelImage,
    check_image,
    freeze_image,
    labels_in,
    union_box,
)
from sketchterrain.document.sketch import Sketch
from sketchterrain.document.store import Hashes, file_hashes
from sketchterrain.errors import InputError
from sketchterrain.schema.layers import PAINTED_LAYERS
from sketchterrain.stages.digests import derive_digest
from sketchterrain.ui.models.drapes import DrapeSources


class Draft:
    """The current stroke: a writable copy of a layer's labels until it is committed.

    Writers of `image` call `touch`; `box` encloses all touched pixels.
    """

    def __init__(self, document: Document, layer: str) -> None:
        self._document = document
        self.layer = layer
        self.image: LabelImage = document.sketch.layers[layer].copy()
        self.box: Box | None = None

    def touch(self, box: Box) -> None:
        """Announce changed pixels in a box."""
        self.box = union_box(self.box, box)
        self._document.painted.emit(self.layer, box)
        self._document.live_changed.emit()

    def snapshot(self) -> LabelImage:
        """Return the labels as they are now, with their digest."""
        return self.frozen(self.image.copy())

    def frozen(self, image: LabelImage) -> LabelImage:
        """Freeze and return the labels or a copy of them; only what the stroke touched is hashed."""
        derive_digest(freeze_image(image), self._document.sketch.layers[self.layer], self.box or (0, 0, 0, 0))
        return image

    def commit(self, title: str, box: Box | None = None) -> None:
        """Record the stroke as a history step, with a last box; raise InputError for too many labels."""
        if box is not None:
            self.touch(box)
        self._document.end_draft(self, title)

    def cancel(self) -> None:
        self._document.end_draft(self, None)


class Document(QObject):
    """The sketch that the user edits, with its history."""

    live_changed = pyqtSignal()  # the sketch or the current stroke
    painted = pyqtSignal(str, object)  # layer, Box of changed pixels
    sketch_changed = pyqtSignal()  # a step was recorded, undone or redone, or a sketch opened
    history_changed = pyqtSignal()
    saved_changed = pyqtSignal()  # path or `is_modified`
    opened = pyqtSignal()
    message = pyqtSignal(str)  # a line for the user, such as why a change is refused

    def __init__(self, sketch: Sketch | None = None) -> None:
        super().__init__()
        self.history = History(sketch or Sketch())  # changed through `do`, `undo`, `redo` and `go_to` only
        self.path: Path | None = None  # None if never saved
        self.known_files: dict[Path | None, Hashes] = {}  # by path, as they were read or written last
        self.draft: Draft | None = None  # the current stroke
        self._saved: object = self.state
        self.drapes = DrapeSources(self)
        self._labels = LRUCache(len(PAINTED_LAYERS))  # images by id, with the labels in them

    @property
    def sketch(self) -> Sketch:
        """The current sketch, without the current stroke."""
        return self.history.sketch

    @property
    def is_modified(self) -> bool:
        return self.state != self._saved

    def layer(self, name: str) -> LabelImage:
        """Return a layer's labels, including the current stroke."""
        if self.draft is not None and self.draft.layer == name:
            return self.draft.image
        return self.sketch.layers[name]

    def do(self, title: str, sketch: Sketch, *, merge: Hashable | None = None) -> None:
        """Record a step that makes `sketch` current; consecutive steps with an equal `merge` are one."""
        if sketch is not self.sketch:
            self._do(title, sketch, merge=merge)

    def undo(self) -> None:
        self.go_to(max(self.history.position - 1, 0))

    def redo(self) -> None:
        self.go_to(min(self.history.position + 1, len(self.history.titles) - 1))

    def go_to(self, position: int) -> None:
        """Undo or redo to a history position."""
        if self.draft is not None:
            self.draft.cancel()
        if position != self.history.position:
            self._emit_changes(self.history.go_to(position))

    def open(
        self, sketch: Sketch, path: Path | None = None, files: Hashes | None = None, *, modified: bool = False
    ) -> None:
        """Replace the sketch and its history; `modified`: its file differs; `files`: its hashes when read."""
        self.draft = None
        self.history = History(sketch)
        self._saved = None if modified else self.state
        self.path = path
        if path is not None:
            self.known_files[path] = file_hashes(path) if files is None else files
        self.opened.emit()
        self._emit_changes({})
        self.saved_changed.emit()

    @property
    def state(self) -> tuple[History, object]:
        """Key of the current sketch, the same after it was undone and redone."""
        return self.history, self.history.key

    def mark_saved(self, state: tuple[History, object], path: Path) -> None:
        """Record that the sketch of a state, current or not, was saved at a path."""
        if state[0] is self.history:
            self._saved, self.path = state, path
            self.saved_changed.emit()

    def begin_draft(self, layer: str) -> Draft:
        """Start a stroke on a layer; an unfinished one is cancelled."""
        if self.draft is not None:
            self.draft.cancel()
        self.draft = Draft(self, layer)
        return self.draft

    def end_draft(self, draft: Draft, title: str | None) -> None:
        """Commit the stroke under a title, or cancel it for None; see `Draft`."""
        if draft is not self.draft:
            return
        self.draft = None
        if draft.box is None:
            return
        if title is None:
            self._emit_painted(draft.layer, draft.box)
            return
        change = ImageChange.between(self.sketch.layers[draft.layer], draft.image, within=draft.box)
        if change is None:
            return
        try:
            image = self._checked(draft, change)
            sketch = self.sketch.replace(layers={**self.sketch.layers, draft.layer: image})
        except InputError:
            self._emit_painted(draft.layer, draft.box)
            raise
        self._do(title, sketch, known={draft.layer: change})

    def _emit_painted(self, layer: str, box: Box) -> None:
        self.painted.emit(layer, box)
        self.live_changed.emit()

    def _checked(self, draft: Draft, change: ImageChange) -> LabelImage:
        """Freeze and return the stroke's image; labels are counted only as far as needed."""
        before = self.sketch.layers[draft.layer]
        labels = self._labels.get_or_compute(id(before), lambda: (before, frozenset(labels_in(before))))[1]
        labels |= change.new_labels - {0}
        if len(labels) > MAX_LABELS:  # some of them may have been painted over
            check_image(draft.layer, draft.image)
            labels = frozenset(labels_in(draft.image))
        self._labels.store(id(draft.image), (draft.image, labels))
        return draft.frozen(draft.image)

    def _do(
        self,
        title: str,
        sketch: Sketch,
        *,
        merge: Hashable | None = None,
        known: Mapping[str, ImageChange] | None = None,
    ) -> None:
        before = self.sketch
        layer = "" if self.draft is None else self.draft.layer
        if self.draft is not None and sketch.layers[layer] is not before.layers[layer]:
            self.draft.cancel()  # its base has changed
        boxes = self.history.record(title, sketch, merge=merge, known=known)
        if self.sketch is not before:
            self._emit_changes(boxes)

    def _emit_changes(self, boxes: Mapping[str, Box]) -> None:
        for name, box in boxes.items():
            self.painted.emit(name, box)
        self.sketch_changed.emit()
        self.history_changed.emit()
        self.saved_changed.emit()
        self.live_changed.emit()
