"""What tools of the canvas work on: viewport, document, tells."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final, overload

from PyQt6.QtCore import QObject, QPointF, QRectF, Qt, pyqtSignal
from PyQt6.QtGui import QPainter

from sketchterrain.array_types import Float64Array
from sketchterrain.document.parameters import LAYERS
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace

LARGEST: Final = 64.0
"""Most pixels of the screen along a pixel of the sketch."""

_LEAST_SEEN = 48  # px of the sheet that stay on the screen, however it is moved
_SMALLEST = 96.0  # px of the screen along the sheet's longer side


@dataclass(frozen=True)
class Viewport:
    """Where the sheet lies on the screen.

    All of the screen is counted in device pixels from the widget's upper left corner; pixels of the
    sketch are counted as floats from its north-west corner, x along columns, y along rows.
    """

    width: int  # px of the screen
    height: int
    columns: int  # px of the sketch
    rows: int
    scale: float = 1.0  # px of the screen along a pixel of the sketch
    left: int = 0  # The sheet's upper left corner on the screen
    top: int = 0

    @property
    def sheet_size(self) -> tuple[int, int]:
        """Width and height of the sheet on the screen (px)."""
        return max(round(self.columns * self.scale), 1), max(round(self.rows * self.scale), 1)

    def to_sketch(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of the sketch at a place of the screen."""
        return (x - self.left) / self.scale, (y - self.top) / self.scale

    def to_screen(self, x: float, y: float) -> tuple[float, float]:
        """Return the place of the screen at a place of the sketch."""
        return self.left + x * self.scale, self.top + y * self.scale

    def fitted(self, *, margin: int) -> Viewport:
        """Return one that shows the whole sheet in the middle, a margin (px of the screen) around it."""
        room_x = max(self.width - 2 * margin, 16)
        room_y = max(self.height - 2 * margin, 16)
        scale = min(room_x / self.columns, room_y / self.rows, LARGEST)
        return self._with(scale, *self._centred(scale))

    def zoomed(self, factor: float, x: float, y: float) -> Viewport:
        """Return one in which the sheet is larger by a factor; what is at (x, y) of the screen stays."""
        smallest = min(_SMALLEST / max(self.columns, self.rows), 1.0)
        scale = min(max(self.scale * factor, smallest), LARGEST)
        at_x, at_y = self.to_sketch(x, y)
        return self._with(scale, x - at_x * scale, y - at_y * scale)

    def moved(self, right: float, down: float) -> Viewport:
        """Return one in which the sheet lies elsewhere, by px of the screen."""
        return self._with(self.scale, self.left + right, self.top + down)

    def resized(self, width: int, height: int) -> Viewport:
        """Return one for a screen of another size; what was in the middle stays there."""
        resized = Viewport(width, height, self.columns, self.rows, self.scale)
        right, down = 0.5 * (width - self.width), 0.5 * (height - self.height)
        return resized._with(self.scale, self.left + right, self.top + down)

    def with_middle(self, x: float, y: float) -> Viewport:
        """Return one with a place of the sketch in the middle of the screen."""
        return self._with(self.scale, 0.5 * self.width - x * self.scale, 0.5 * self.height - y * self.scale)

    def _centred(self, scale: float) -> tuple[float, float]:
        return 0.5 * (self.width - self.columns * scale), 0.5 * (self.height - self.rows * scale)

    def _with(self, scale: float, left: float, top: float) -> Viewport:
        """Keep the sheet within reach: some of it is always on the screen."""
        sides = (self.columns * scale, self.rows * scale)
        corner = []
        for at, side, room in zip((left, top), sides, (self.width, self.height), strict=True):
            seen = min(_LEAST_SEEN, side, room)
            corner.append(math.floor(min(max(at, seen - side), room - seen) + 0.5))
        return Viewport(self.width, self.height, self.columns, self.rows, scale, corner[0], corner[1])


@dataclass(frozen=True)
class Pointer:
    """Where the mouse or the pen is."""

    x: float  # px of the sketch, to the right and down, centres of pixels at +0.5
    y: float
    pressure: float = 1.0  # 0 … 1; 1 of a mouse
    erases: bool = False  # Whether the right button or a pen's eraser is used
    picks: bool = False  # Whether Alt is held
    adds: bool = False  # Whether Shift is held


@dataclass(eq=False)
class ToolContext:
    """The models, where the sheet lies, and what tools tell the canvas."""

    document: Document
    workspace: Workspace
    link: EngineLink
    viewport: Viewport = field(default_factory=lambda: Viewport(1, 1, 1, 1))
    ratio: float = 1.0  # Device pixels a logical one
    tells: ToolSignals = field(default_factory=lambda: ToolSignals())

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
    def pixels(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]: ...
    def pixels(self, x: Any, y: Any) -> Any:
        """Return the place of the sketch (px) of a place of the world (m), or of many."""
        sketch = self.document.sketch
        return x / sketch.pixel_size, sketch.height_px - y / sketch.pixel_size

    def screen_from_world(self, x: float, y: float) -> QPointF:
        """Return the place of the screen (logical px) of a place of the world (m)."""
        return self.at(*self.pixels(x, y))

    def screens_from_world(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
        """Return the places of the screen (logical px) of many places of the world (m)."""
        columns, rows = self.pixels(x, y)
        left, top = self.viewport.left, self.viewport.top
        return (left + columns * self.viewport.scale) / self.ratio, (
            top + rows * self.viewport.scale
        ) / self.ratio

    @property
    def px_per_metre(self) -> float:
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


class ToolSignals(QObject):
    """What tools tell the canvas."""

    message = pyqtSignal(str)
    """A line for a person."""
    stale = pyqtSignal(object)
    """What a tool draws is another picture in a rectangle (logical px); None: somewhere."""

    def redraw(self, area: QRectF | None = None) -> None:
        """Tell that what a tool draws changed."""
        self.stale.emit(area)


class Tool:
    """A tool that does nothing; others say what they do."""

    cursor = Qt.CursorShape.ArrowCursor

    def __init__(self, context: ToolContext) -> None:
        self.context = context

    @property
    def is_busy(self) -> bool:
        """Whether something was begun that can be finished or cancelled."""
        return False

    def press(self, pointer: Pointer) -> None:
        """Begin: a button is pressed, or the pen touches."""

    def move(self, pointer: Pointer) -> None:
        """Go on: the mouse moves, with or without a button."""

    def release(self, pointer: Pointer) -> None:
        """Let go."""

    def double(self, pointer: Pointer) -> None:
        """Do what a double click means: a second press."""
        self.press(pointer)

    def key(self, key: int) -> bool:
        """Take a key (`Qt.Key`); return whether it meant something."""
        return False

    def takes(self, key: int) -> bool:
        """Whether `key` would take a key now, so that no shortcut has it."""
        return False

    def finish(self) -> None:
        """Come to an end with what was begun: the focus is lost, or another tool is chosen."""

    def cancel(self) -> None:
        """Forget what was begun."""

    def leave(self) -> None:
        """Forget where the mouse was: it left the canvas."""

    def draw(self, painter: QPainter) -> None:
        """Draw what the tool shows over the sketch, in logical pixels."""

    def cursor_at(self, place: QPointF) -> Qt.CursorShape:
        """Return the shape of the mouse's cursor at a place of the screen."""
        return self.cursor

    def extent(self) -> QRectF:
        """Return the rectangle (logical px) outside of which `draw` draws nothing; empty: all of it."""
        return QRectF()
