"""The sketch that is open: its history, the stroke that is being drawn, where it is saved."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from pathlib import Path
from weakref import ref

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.document.history import History, LayerChange
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
from sketchterrain.errors import InputError


class Draft:
    """A stroke that is being drawn: a layer's pixels, writable, until it is committed.

    Attributes
    ----------
    layer : str
    image : (height, width) uint8
        Labels; whoever writes into it calls `touch`.
    box : Box or None
        Around all that was touched.
    """

    def __init__(self, document: Document, layer: str) -> None:
        self._document = document
        self.layer = layer
        self.image: LabelImage = document.sketch.layers[layer].copy()
        self.box: Box | None = None

    def touch(self, box: Box) -> None:
        """Tell that pixels in a box are others now."""
        self.box = union_box(self.box, box)
        self._document.painted.emit(self.layer, box)
        self._document.live_changed.emit()

    def commit(self, title: str) -> None:
        """Make it a step of the history, if it changed anything.

        Raises
        ------
        InputError
            If the layer has too many labels now; the stroke is cancelled then.
        """
        self._document.end_draft(self, title)

    def cancel(self) -> None:
        """Forget it; the layer is as it was."""
        self._document.end_draft(self, None)


class Document(QObject):
    """What a person works on.

    Parameters
    ----------
    sketch
        To begin with.
    """

    live_changed = pyqtSignal()
    """What the terrain is made of changed: a step was done or undone, or a stroke goes on."""
    painted = pyqtSignal(str, object)
    """Pixels of a layer changed: its name and a `Box`."""
    sketch_changed = pyqtSignal()
    """Another sketch is the current one: a step was done, undone, or one was opened."""
    history_changed = pyqtSignal()
    """There are other steps, or another one is the last."""
    saved_changed = pyqtSignal()
    """The path, or whether there is something to save, may have changed."""
    opened = pyqtSignal()
    """It is another document now."""

    def __init__(self, sketch: Sketch | None = None) -> None:
        super().__init__()
        self._history = History(sketch or Sketch())
        self._saved: int | None = self._key
        self._path: Path | None = None
        self._draft: Draft | None = None
        # Labels that may stand in an image, by layer.
        self._labels: dict[str, tuple[ref[LabelImage], frozenset[int]]] = {}

    @property
    def sketch(self) -> Sketch:
        """As it is, without a stroke that is still being drawn."""
        return self._history.sketch

    @property
    def history(self) -> History:
        """Its steps; change it through `do`, `undo`, `redo` and `go_to` only."""
        return self._history

    @property
    def path(self) -> Path | None:
        """Where it is saved; None if it never was."""
        return self._path

    @property
    def is_modified(self) -> bool:
        """Whether there is something to save."""
        return self._key != self._saved

    @property
    def draft(self) -> Draft | None:
        """The stroke that is being drawn."""
        return self._draft

    def layer(self, name: str) -> LabelImage:
        """Return a layer's labels, the stroke that is being drawn included."""
        if self._draft is not None and self._draft.layer == name:
            return self._draft.image
        return self.sketch.layers[name]

    def do(self, title: str, sketch: Sketch, *, merge: Hashable | None = None) -> None:
        """Make `sketch` the current one, as a step; nothing happens if it is equal to the current one.

        Parameters
        ----------
        title
            What the step does, for a person: ``"Move mountain"``.
        sketch
            From a command.
        merge
            Steps that follow one another with an equal key are one step.
        """
        if sketch is not self.sketch:
            self._do(title, sketch, merge=merge)

    def undo(self) -> None:
        """Undo the last step, if there is one."""
        self.go_to(max(self._history.position - 1, 0))

    def redo(self) -> None:
        """Do the last undone step again, if there is one."""
        self.go_to(min(self._history.position + 1, len(self._history.titles) - 1))

    def go_to(self, position: int) -> None:
        """Undo or redo up to a step of the history."""
        if self._draft is not None:
            self._draft.cancel()
        if position != self._history.position:
            self._tell(self._history.go_to(position))

    def open(self, sketch: Sketch, path: Path | None = None, *, modified: bool = False) -> None:
        """Work on another sketch, with a history of its own.

        Parameters
        ----------
        sketch
        path
            Where it is saved.
        modified
            Whether it differs from what is saved, as one that was recovered does.
        """
        self._draft = None
        self._history = History(sketch)
        self._saved = None if modified else self._key
        self._path = path
        self.opened.emit()
        self._tell({})
        self.saved_changed.emit()

    def mark_saved(self, sketch: Sketch, path: Path) -> None:
        """Remember that a sketch, the current one or one that was, is saved at a path.

        One that was opened before the current one was opened is none of this document's.
        """
        key = self._history.step_key(sketch)
        if key is not None:
            self._saved, self._path = key, path
            self.saved_changed.emit()

    def begin_draft(self, layer: str) -> Draft:
        """Begin a stroke on a layer; one that is still being drawn is cancelled."""
        if self._draft is not None:
            self._draft.cancel()
        self._draft = Draft(self, layer)
        return self._draft

    def end_draft(self, draft: Draft, title: str | None) -> None:
        """Commit a draft under a title, or cancel it for None; see `Draft`."""
        if draft is not self._draft:
            return
        self._draft = None
        if draft.box is None:
            return
        if title is None:
            self.painted.emit(draft.layer, draft.box)
            self.live_changed.emit()
            return
        change = LayerChange.between(self.sketch.layers[draft.layer], draft.image, within=draft.box)
        if change is None:
            return
        try:
            image = self._checked(draft, change)
            sketch = self.sketch.replace(layers={**self.sketch.layers, draft.layer: image})
        except InputError:
            self.painted.emit(draft.layer, draft.box)
            self.live_changed.emit()
            raise
        self._do(title, sketch, known={draft.layer: change})

    def _checked(self, draft: Draft, change: LayerChange) -> LabelImage:
        """Return a draft's image, read-only, looked at no more than it takes to know its labels."""
        before = self.sketch.layers[draft.layer]
        image, labels = self._labels.get(draft.layer, (None, frozenset()))
        if image is None or image() is not before:
            labels = frozenset(labels_in(before))
        labels |= change.new_labels - {0}
        if len(labels) > MAX_LABELS:  # some of them may have been painted over
            check_image(draft.layer, draft.image)
            labels = frozenset(labels_in(draft.image))
        self._labels[draft.layer] = ref(draft.image), labels
        return freeze_image(draft.image)

    @property
    def _key(self) -> int | None:
        return self._history.step_key(self.sketch)

    def _do(
        self,
        title: str,
        sketch: Sketch,
        *,
        merge: Hashable | None = None,
        known: Mapping[str, LayerChange] | None = None,
    ) -> None:
        before = self.sketch
        if (
            self._draft is not None
            and sketch.layers[self._draft.layer] is not before.layers[self._draft.layer]
        ):
            self._draft.cancel()  # what it was drawn over is no more
        boxes = self._history.record(title, sketch, merge=merge, known=known)
        if self.sketch is not before:
            self._tell(boxes)

    def _tell(self, boxes: Mapping[str, Box]) -> None:
        for name, box in boxes.items():
            self.painted.emit(name, box)
        self.sketch_changed.emit()
        self.history_changed.emit()
        self.saved_changed.emit()
        self.live_changed.emit()
