"""What draws in a process of its own, as views know it: its last picture, what it shows, what it is asked."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from PyQt6.QtCore import QObject, pyqtSignal
from PyQt6.QtGui import QImage

from sketchterrain.ui.engine.messages import EngineFacts
from sketchterrain.ui.engine.orders import FrameTaken, Pick, ViewState

if TYPE_CHECKING:
    from sketchterrain.ui.engine.frames import FrameMemory
    from sketchterrain.ui.engine.messages import FrameFacts
    from sketchterrain.ui.engine.plan import FrameThere

__all__ = ["PictureSource"]


class PictureSource(QObject):
    """Draws for one view. It says `FrameTaken` by itself.

    Parameters
    ----------
    view
        What shall be shown at first.

    Attributes
    ----------
    facts : EngineFacts
        What it runs on; all empty until it is known.
    frame : FrameFacts or None
        Of the last picture.
    picture : QImage or None
        The last picture.
    view : ViewState
        What the view shall show.
    working : str
        What it is busy with; empty: nothing.
    """

    working_changed = pyqtSignal(str)
    frame_shown = pyqtSignal(object)
    """A new picture is there: its `FrameFacts`; see `picture`."""
    picked = pyqtSignal(object)
    view_changed = pyqtSignal(object)
    trouble = pyqtSignal(object)
    """`Trouble`."""

    def __init__(self, view: ViewState) -> None:
        super().__init__()
        self.facts = EngineFacts()
        self.frame: FrameFacts | None = None
        self.picture: QImage | None = None
        self.view = view
        self.working = ""
        self._token = 0

    def start(self) -> None:
        """Start what draws; anew while it runs."""
        raise NotImplementedError

    def tell(self, message: Any) -> None:
        """Send a motion, `Look`, `Pick` and so on."""
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

    def _take_frame(self, frames: FrameMemory, there: FrameThere) -> None:
        """Take a picture over from where it was drawn."""
        self.picture = _picture_of(frames, there)
        self.tell(FrameTaken())
        self.frame = there.facts
        self.frame_shown.emit(there.facts)

    def _set_working(self, what: str) -> None:
        if what != self.working:
            self.working = what
            self.working_changed.emit(what)


def _picture_of(memory: FrameMemory, there: FrameThere) -> QImage:
    """Return a copy of a frame in shared memory; its place may be drawn into again."""
    width, height = there.facts.width, there.facts.height
    with memory.view(there.start, 4 * width * height, there.capacity) as pixels:
        shared = QImage(pixels, width, height, 4 * width, QImage.Format.Format_RGBX8888)  # type: ignore[call-overload]
        picture: QImage = shared.convertToFormat(QImage.Format.Format_RGB32)
        del shared
    return picture
