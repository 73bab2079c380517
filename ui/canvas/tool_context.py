"""Canvas tools: their interface, and what they share: viewport, coordinate transforms, models, images."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import reduce
from typing import Any, Final, overload

from PyQt6.QtCore import QPointF, QRect, QRectF, Qt
from PyQt6.QtGui import QPainter, QPixmap

from sketchterrain.array_types import Float64Array
from sketchterrain.schema.layers import LAYERS
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace

LARGEST: Final = 64.0  # screen px per sketch px
_MAX_AREAS = 12  # stale areas drawn one by one
_LEAST_VISIBLE = 48  # px of the sketch that stay on the screen
_SMALLEST = 96.0  # screen px along the sketch's longer side


@dataclass(frozen=True)
class Viewport:
    """Position and scale of the sketch on the screen.

    Screen: device px from the widget's upper left corner. Sketch: px from its north-west corner.
    """

    width: int  # screen px
    height: int
    columns: int  # sketch px
    rows: int
    scale: float = 1.0  # screen px per sketch px
    left: int = 0  # the sketch's upper left corner on the screen
    top: int = 0

    @property
    def sketch_size(self) -> tuple[int, int]:
        """Width and height of the sketch on the screen (px)."""
        return max(round(self.columns * self.scale), 1), max(round(self.rows * self.scale), 1)

    def to_sketch(self, x: float, y: float) -> tuple[float, float]:
        return (x - self.left) / self.scale, (y - self.top) / self.scale

    def to_screen(self, x: float, y: float) -> tuple[float, float]:
        return self.left + x * self.scale, self.top + y * self.scale

    def fitted(self, *, margin: int) -> Viewport:
        """Return a viewport that shows the whole sketch, centred, with a margin (px)."""
        width, height = max(self.width - 2 * margin, 16), max(self.height - 2 * margin, 16)
        scale = min(width / self.columns, height / self.rows, LARGEST)
        left, top = 0.5 * (self.width - self.columns * scale), 0.5 * (self.height - self.rows * scale)
        return self._clamped(scale, left, top)

    def zoomed(self, factor: float, x: float, y: float) -> Viewport:
        """Return a viewport zoomed about a screen position."""
        smallest = min(_SMALLEST / max(self.columns, self.rows), 1.0)
        scale = min(max(self.scale * factor, smallest), LARGEST)
        at_x, at_y = self.to_sketch(x, y)
        return self._clamped(scale, x - at_x * scale, y - at_y * scale)

    def moved(self, right: float, down: float) -> Viewport:
        """Return a viewport panned by screen px."""
        return self._clamped(self.scale, self.left + right, self.top + down)

    def resized(self, width: int, height: int) -> Viewport:
        """Return a viewport for another screen size, with the same centre."""
        resized = Viewport(width, height, self.columns, self.rows, self.scale)
        right, down = 0.5 * (width - self.width), 0.5 * (height - self.height)
        return resized._clamped(self.scale, self.left + right, self.top + down)

    def with_middle(self, x: float, y: float) -> Viewport:
        """Return a viewport centred on a sketch position."""
        return self._clamped(
            self.scale, 0.5 * self.width - x * self.scale, 0.5 * self.height - y * self.scale
        )

    def _clamped(self, scale: float, left: float, top: float) -> Viewport:
        """Return a viewport clamped so that part of the sketch is always visible."""
        sides = (self.columns * scale, self.rows * scale)
        corner = []
        for at, side, size in zip((left, top), sides, (self.width, self.height), strict=True):
            visible = min(_LEAST_VISIBLE, side, size)
            corner.append(math.floor(min(max(at, visible - side), size - visible) + 0.5))
        return Viewport(self.width, self.height, self.columns, self.rows, scale, corner[0], corner[1])


@dataclass(frozen=True)
class Pointer:
    """Position and state of the mouse or pen."""

    x: float  # px of the sketch, right and down, pixel centres at +0.5
    y: float
    pressure: float = 1.0  # 0 … 1; 1 for a mouse
    erases: bool = False  # right button or a pen's eraser
    picks: bool = False  # Alt


@dataclass(eq=False)
class ToolContext:
    """Models and viewport; transforms between screen (logical px), sketch (px) and world (m)."""

    document: Document
    workspace: Workspace
    link: EngineLink
    viewport: Viewport = field(default_factory=lambda: Viewport(1, 1, 1, 1))
    ratio: float = 1.0  # device pixels a logical one
    redraw: Callable[..., None] = lambda area=None: None  # a rectangle (logical px), or everything

    @property
    def scale(self) -> float:
        """Logical pixels along a sketch pixel."""
        return self.viewport.scale / self.ratio

    @property
    def px_per_metre(self) -> float:
        """Logical pixels along a metre."""
        return self.scale / self.document.sketch.pixel_size

    @property
    def area(self) -> QRectF:
        """The canvas, logical pixels."""
        return QRectF(0.0, 0.0, self.viewport.width / self.ratio, self.viewport.height / self.ratio)

    def screen_from_sketch(self, x: float, y: float) -> QPointF:
        right, down = self.viewport.to_screen(x, y)
        return QPointF(right / self.ratio, down / self.ratio)

    def sketch_from_screen(self, place: QPointF) -> tuple[float, float]:
        return self.viewport.to_sketch(place.x() * self.ratio, place.y() * self.ratio)

    def world_from_sketch(self, x: float, y: float) -> tuple[float, float]:
        sketch = self.document.sketch
        return x * sketch.pixel_size, (sketch.height_px - y) * sketch.pixel_size

    @overload
    def sketch_from_world(self, x: float, y: float) -> tuple[float, float]: ...
    @overload
    def sketch_from_world(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]: ...
    def sketch_from_world(self, x: Any, y: Any) -> Any:
        """Return the sketch position of a world position, or arrays of many."""
        sketch = self.document.sketch
        return x / sketch.pixel_size, sketch.height_px - y / sketch.pixel_size

    def screen_from_world(self, x: float, y: float) -> QPointF:
        return self.screen_from_sketch(*self.sketch_from_world(x, y))

    def screens_from_world(self, x: Float64Array, y: Float64Array) -> tuple[Float64Array, Float64Array]:
        viewport, (columns, rows) = self.viewport, self.sketch_from_world(x, y)
        right, down = viewport.left + columns * viewport.scale, viewport.top + rows * viewport.scale
        return right / self.ratio, down / self.ratio

    def may_paint(self) -> bool:
        """Return whether the active layer can be painted on; else report why."""
        refusal = self.workspace.refusal(self.workspace.layer)
        if not LAYERS[self.workspace.layer].is_painted:
            title = LAYERS[self.workspace.layer].title
            refusal = f"{title} are drawn, not painted: use the line tool (L), or select one (V)."
        if refusal:
            self.document.message.emit(refusal)
        return not refusal


class CanvasImage:
    """An image of the whole canvas, drawn where it is stale; `draw` draws an area, both device pixels."""

    def __init__(
        self,
        context: ToolContext,
        draw: Callable[[QPainter, QRect], None],
        background: Qt.GlobalColor = Qt.GlobalColor.transparent,
    ) -> None:
        self._context, self._draw, self._background = context, draw, background
        self._image = QPixmap()
        self._stale: list[QRect] = []
        self._key: tuple[object, ...] = ()
        self.viewport: Viewport | None = None  # that it shows; None before it was drawn

    def invalidate(self, area: QRect | None = None) -> None:
        """Mark an area as stale; None: all of it."""
        whole = self._image.rect()
        area = whole if area is None else area.intersected(whole)
        self._stale = [*(self._stale if area != whole else ()), *([] if area.isEmpty() else [area])]

    def updated(self, *key: object) -> QPixmap:
        """Return the image of what a key stands for; where it is scrolled, only what is new is drawn."""
        viewport, before = self._context.viewport, self.viewport if key == self._key else None
        self._key, self.viewport = key, viewport
        if (self._image.width(), self._image.height()) != (viewport.width, viewport.height):
            self._image, before = QPixmap(viewport.width, viewport.height), None
            self._image.fill(self._background)
        if before is None or replace(before, left=viewport.left, top=viewport.top) != viewport:
            self.invalidate()
        else:
            right, down = viewport.left - before.left, viewport.top - before.top
            self._stale = [each.translated(right, down) for each in self._stale]
            for step in ((right, 0), (0, down)):
                if exposed := self._image.scroll(*step, self._image.rect()):
                    self.invalidate(exposed.boundingRect())
        stale, self._stale = self._stale, []
        if len(stale) > _MAX_AREAS:
            stale = [reduce(QRect.united, stale)]
        if stale:
            painter = QPainter(self._image)
            for area in stale:
                self._draw(painter, area)
            painter.end()
        return self._image


class Tool:
    """A tool that does nothing."""

    cursor = Qt.CursorShape.ArrowCursor

    def __init__(self, context: ToolContext) -> None:
        self.context = context

    @property
    def is_busy(self) -> bool:
        """Whether an operation can be finished or cancelled."""
        return False

    def press(self, pointer: Pointer) -> None:
        """Start: a button is pressed, or the pen touches."""

    def move(self, pointer: Pointer) -> None:
        """Continue: the mouse moves, with or without a button."""

    def release(self, pointer: Pointer) -> None:
        """Release the button."""

    def double(self, pointer: Pointer) -> None:
        """Handle a double click: a second press."""
        self.press(pointer)

    def takes_key(self, key: int) -> bool:
        """Return whether the tool handles a key (`Qt.Key`) now, before any shortcut."""
        return False

    def press_key(self, key: int) -> None:
        """Handle a key that `takes_key` accepted."""

    def finish(self) -> None:
        """Finish the operation: the focus is lost, or the tool changes."""

    def cancel(self) -> None:
        """Cancel the operation."""

    def leave(self) -> None:
        """Hide what follows the mouse: it left the canvas."""

    def draw(self, painter: QPainter) -> None:
        """Draw the tool's overlay, in logical pixels."""

    def cursor_at(self, place: QPointF) -> Qt.CursorShape:
        """Return the cursor's shape at a screen position."""
        return self.cursor
