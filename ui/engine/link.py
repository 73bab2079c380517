"""The window's end of the engine: signals for what it tells, methods for what it is asked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from PyQt6.QtCore import QObject, pyqtSignal

from sketchterrain.ui.engine.messages import EngineFacts, Pick, ViewState

if TYPE_CHECKING:
    from PyQt6.QtGui import QImage

    from sketchterrain.ui.engine.messages import Adherence, FrameFacts, Placed, Relief
    from sketchterrain.ui.models.document import Document

__all__ = ["EngineLink"]


class EngineLink(QObject):
    """Works out the terrain of a document, and draws it, in processes of its own.

    Attributes
    ----------
    facts : EngineFacts
        What it runs on; all empty until it is known.
    placed : Placed or None
        What was placed last.
    relief : Relief or None
        The last terrain at the sketch's pixels.
    adherence : Adherence or None
        As it was measured last.
    frame : FrameFacts or None
        Of the last picture.
    picture : QImage or None
        The last picture.
    view : ViewState
        What the view shall show.
    working : str
        What it is busy with; empty: nothing.
    """

    facts_changed = pyqtSignal(object)
    working_changed = pyqtSignal(str)
    placed_changed = pyqtSignal(object)
    relief_changed = pyqtSignal(object)
    adherence_changed = pyqtSignal(object)
    frame_shown = pyqtSignal(object)
    """A new picture is there: its `FrameFacts`; see `picture`."""
    picked = pyqtSignal(object)
    view_changed = pyqtSignal(object)
    picture_written = pyqtSignal(str)
    trouble = pyqtSignal(object)
    """`Trouble`."""

    def __init__(self, document: Document) -> None:
        super().__init__()
        self._document = document
        self.facts = EngineFacts()
        self.placed: Placed | None = None
        self.relief: Relief | None = None
        self.adherence: Adherence | None = None
        self.frame: FrameFacts | None = None
        self.picture: QImage | None = None
        self.view = ViewState()
        self.working = ""
        self._token = 0

    def start(self) -> None:
        """Start the processes; again after they ended."""
        raise NotImplementedError

    def stop(self) -> None:
        """End the processes; waits for them for a short while."""
        raise NotImplementedError

    def tell(self, message: Any) -> None:
        """Send one of the window's messages: a motion, `Look`, `MeasureAdherence`, `TakePicture` and so on."""
        raise NotImplementedError

    def show(self, view: ViewState) -> None:
        """Say what the view shall show."""
        if view != self.view:
            self.view = view
            self.view_changed.emit(view)
            self.tell(view)

    def pick(self, x: float, y: float) -> int:
        """Ask what ground is seen at a place of the picture; `picked` answers with the token returned."""
        self._token += 1
        self.tell(Pick(self._token, x, y))
        return self._token
