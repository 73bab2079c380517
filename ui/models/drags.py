"""A handle that is being dragged: the document follows, and in the end it was one step."""

from __future__ import annotations

from sketchterrain.errors import InputError
from sketchterrain.sketch import Sketch
from sketchterrain.ui.commands.placed_edits import dragged, title_of
from sketchterrain.ui.engine.protocol import Placed
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.handles import Handle


class FeatureDrag:
    """Changes a document as a handle is dragged."""

    def __init__(
        self, document: Document, placed: Placed, handle: Handle, *, grab: tuple[float, float] | None = None
    ) -> None:
        self._document = document
        self._placed = placed
        self._before = document.sketch
        self._last: Sketch | None = document.sketch
        self._title = title_of(placed, handle)
        self._off = (0.0, 0.0) if grab is None else (handle.x - grab[0], handle.y - grab[1])
        self._merge = object()
        self.handle = handle
        self.x, self.y = handle.x, handle.y
        self.problem = ""

    @property
    def is_alive(self) -> bool:
        """Whether nothing else changed the document meanwhile; if something did, dragging has no effect."""
        return self._document.sketch is self._last

    def to(self, x: float, y: float) -> None:
        """Drag it on: the mouse is at a place (m) now."""
        if not self.is_alive:
            return
        x, y = x + self._off[0], y + self._off[1]
        self.problem = ""
        try:
            self._do(dragged(self._before, self._placed, self.handle, x, y))
            self.x, self.y = x, y
        except InputError as error:
            self.problem = str(error)

    def finish(self) -> None:
        """Let go: what was done is one step of the history."""
        self._last = None

    def cancel(self) -> None:
        """Let go and leave everything as it was."""
        if self.is_alive and self._last is not self._before:
            self._do(self._before)
        self.x, self.y = self.handle.x, self.handle.y
        self.finish()

    def _do(self, sketch: Sketch) -> None:
        self._document.do(self._title, sketch, merge=self._merge)
        self._last = self._document.sketch
