"""What tools work at: the models, where the sheet lies, and what they tell the canvas."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, overload

from PyQt6.QtCore import QObject, QPointF, pyqtSignal

from sketchterrain.sketch import LAYERS
from sketchterrain.ui.canvas.viewport import Viewport

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt
    from PyQt6.QtCore import QRectF

    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.workspace import Workspace

    Floats = npt.NDArray[np.float64]

__all__ = ["Desk", "Pointer", "Tells"]


@dataclass(frozen=True)
class Pointer:
    """Where the mouse or the pen is.

    Attributes
    ----------
    x, y : float
        px of the sketch, to the right and down, centres of pixels at +0.5.
    pressure : float
        0 … 1; 1 of a mouse.
    erases : bool
        Whether the right button or a pen's eraser is used.
    picks : bool
        Whether Alt is held.
    adds : bool
        Whether Shift is held.
    """

    x: float
    y: float
    pressure: float = 1.0
    erases: bool = False
    picks: bool = False
    adds: bool = False


@dataclass(eq=False)
class Desk:
    """The models, where the sheet lies, and what tools tell the canvas.

    Attributes
    ----------
    document, workspace, link
    viewport : Viewport
    ratio : float
        Device pixels a logical one.
    tells : Tells
    """

    document: Document
    workspace: Workspace
    link: EngineLink
    viewport: Viewport = field(default_factory=lambda: Viewport(1, 1, 1, 1))
    ratio: float = 1.0
    tells: Tells = field(default_factory=lambda: Tells())

    @property
    def scale(self) -> float:
        """Logical pixels of the screen along a pixel of the sketch."""
        return self.viewport.scale / self.ratio

    def at(self, x: float, y: float) -> QPointF:
        """Return the place of the screen (logical px) of a place of the sketch (px)."""
        right, down = self.viewport.to_screen(x, y)
        return QPointF(right / self.ratio, down / self.ratio)

    def on_sketch(self, place: QPointF) -> tuple[float, float]:
        """Return the place of the sketch (px) at a place of the screen (logical px)."""
        return self.viewport.to_sketch(place.x() * self.ratio, place.y() * self.ratio)

    def metres(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of the world (m) of a place of the sketch (px)."""
        sketch = self.document.sketch
        return x * sketch.pixel_size, (sketch.height_px - y) * sketch.pixel_size

    @overload
    def pixels(self, x: float, y: float) -> tuple[float, float]: ...
    @overload
    def pixels(self, x: Floats, y: Floats) -> tuple[Floats, Floats]: ...
    def pixels(self, x: Any, y: Any) -> Any:
        """Return the place of the sketch (px) of a place of the world (m), or of many."""
        sketch = self.document.sketch
        return x / sketch.pixel_size, sketch.height_px - y / sketch.pixel_size

    def of_world(self, x: float, y: float) -> QPointF:
        """Return the place of the screen (logical px) of a place of the world (m)."""
        return self.at(*self.pixels(x, y))

    def all_of_world(self, x: Floats, y: Floats) -> tuple[Floats, Floats]:
        """Return the places of the screen (logical px) of many places of the world (m)."""
        columns, rows = self.pixels(x, y)
        left, top = self.viewport.left, self.viewport.top
        return (left + columns * self.viewport.scale) / self.ratio, (
            top + rows * self.viewport.scale
        ) / self.ratio

    @property
    def per_metre(self) -> float:
        """Logical pixels of the screen along a metre."""
        return self.scale / self.document.sketch.pixel_size

    def may_paint(self) -> bool:
        """Whether the layer that one paints on lets itself be painted on; tells a person if not."""
        look, title = self.workspace.look(self.workspace.layer), LAYERS[self.workspace.layer].title
        if look.locked:
            self.tells.message.emit(f"{title} are locked. Unlock the layer to paint on it.")
        elif not look.visible:
            self.tells.message.emit(f"{title} are hidden. Show the layer to paint on it.")
        return look.visible and not look.locked


class Tells(QObject):
    """What tools tell the canvas."""

    message = pyqtSignal(str)
    """A line for a person."""
    stale = pyqtSignal(object)
    """What a tool draws is another picture in a rectangle (logical px); None: somewhere."""

    def redraw(self, area: QRectF | None = None) -> None:
        """Tell that what a tool draws changed."""
        self.stale.emit(area)
