"""A frame that lies in the shared memory, as a picture of one's own."""

from __future__ import annotations

from typing import TYPE_CHECKING

from PyQt6.QtGui import QImage

if TYPE_CHECKING:
    from sketchterrain.ui.engine.frames import FrameMemory
    from sketchterrain.ui.engine.plan import FrameThere

__all__ = ["picture_of"]


def picture_of(memory: FrameMemory, there: FrameThere) -> QImage:
    """Return a copy of a frame; its place may be drawn into again."""
    width, height = there.facts.width, there.facts.height
    with memory.view(there.start, 4 * width * height, there.capacity) as pixels:
        shared = QImage(pixels, width, height, 4 * width, QImage.Format.Format_RGBX8888)  # type: ignore[call-overload]
        picture: QImage = shared.convertToFormat(QImage.Format.Format_RGB32)
        del shared
    return picture
