"""Tools that paint: brush and eraser, fill, label picker, lines."""

from __future__ import annotations

import math

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QPainter, QPen, QPolygonF

from sketchterrain.document.parameters import LAYERS
from sketchterrain.ui.canvas.decorations import write_beside
from sketchterrain.ui.canvas.layer_brushes import visible_layers
from sketchterrain.ui.canvas.tool_context import Pointer, Tool, ToolContext
from sketchterrain.ui.look.layer_colours import label_colour
from sketchterrain.ui.models.document import Draft
from sketchterrain.ui.models.painting import Stroke, draw_line, flood_fill, line_path, line_width, pick

_LEAST_PRESSURE = 0.2  # share of the radius that the lightest touch has


class BrushTool(Tool):
    """Paints strokes with the label that one paints with, or erases."""

    cursor = Qt.CursorShape.CrossCursor

    def __init__(self, context: ToolContext, *, erases: bool = False) -> None:
        super().__init__(context)
        self._always_erases = erases
        self._draft: Draft | None = None
        self._stroke: Stroke | None = None
        self._title = ""
        self._place: tuple[float, float] | None = None
        self._radius = 0.0

    @property
    def is_busy(self) -> bool:
        """Whether a stroke is being drawn."""
        return self._draft is not None

    def press(self, pointer: Pointer) -> None:
        """Begin a stroke."""
        self._follow(pointer)
        if self._draft is not None or not self.context.may_paint():
            return
        workspace = self.context.workspace
        erases = self._always_erases or pointer.erases
        verb = "Erase" if erases else "Paint"
        self._title = f"{verb} {LAYERS[workspace.layer].title.lower()}"
        self._draft = self.context.document.begin_draft(workspace.layer)
        grain = 1.0 / max(self.context.scale, 1e-6)
        self._stroke = Stroke(self._draft.image, 0 if erases else workspace.label, grain=grain)
        self._extend(pointer)

    def move(self, pointer: Pointer) -> None:
        """Go on with it; show the ring where the mouse is."""
        self._follow(pointer)
        self._extend(pointer)

    def release(self, pointer: Pointer) -> None:
        """End it."""
        self._extend(pointer)
        self.finish()

    def key(self, key: int) -> bool:
        """Cancel the stroke by Escape."""
        if not self.takes(key):
            return False
        self.cancel()
        return True

    def takes(self, key: int) -> bool:
        """Take Escape while a stroke is being drawn."""
        return self.is_busy and key == Qt.Key.Key_Escape

    def finish(self) -> None:
        """Make the stroke a step of the history."""
        draft, stroke = self._draft, self._stroke
        self._draft = self._stroke = None
        if draft is None or stroke is None or draft is not self.context.document.draft:
            return
        box = stroke.finish()
        if box is not None:
            draft.touch(box)
        draft.commit(self._title)

    def cancel(self) -> None:
        """Forget the stroke."""
        draft = self._draft
        self._draft = self._stroke = None
        if draft is not None and draft is self.context.document.draft:
            draft.cancel()

    def leave(self) -> None:
        """Show the ring no longer."""
        self.context.tells.redraw(self.extent())
        self._place = None

    def extent(self) -> QRectF:
        """Return the rectangle around the ring."""
        if self._place is None:
            return QRectF()
        reach = self._radius * self.context.scale + 3.0
        middle = self.context.at(*self._place)
        return QRectF(middle.x() - reach, middle.y() - reach, 2.0 * reach, 2.0 * reach)

    def draw(self, painter: QPainter) -> None:
        """Draw the ring in the brush's size."""
        if self._place is None:
            return
        middle, reach = self.context.at(*self._place), max(self._radius * self.context.scale, 1.0)
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for colour, width in ((QColor(255, 255, 255, 190), 3.0), (QColor(20, 20, 20, 220), 1.2)):
            painter.setPen(QPen(colour, width))
            painter.drawEllipse(middle, reach, reach)

    def show_size(self, place: QPointF | None) -> None:
        """Show the ring in the brush's size, where the mouse is."""
        self.context.tells.redraw(self.extent())
        if place is not None:
            self._place = self.context.on_sketch(place)
        self._radius = self.context.workspace.brush
        self.context.tells.redraw(self.extent())

    def _follow(self, pointer: Pointer) -> None:
        self.context.tells.redraw(self.extent())
        self._place = (pointer.x, pointer.y)
        self._radius = self._pressed(pointer)
        self.context.tells.redraw(self.extent())

    def _pressed(self, pointer: Pointer) -> float:
        return self.context.workspace.brush * (_LEAST_PRESSURE + (1.0 - _LEAST_PRESSURE) * pointer.pressure)

    def _extend(self, pointer: Pointer) -> None:
        if self._draft is None or self._stroke is None:
            return
        if self._draft is not self.context.document.draft:  # an undo, or another document, took it away
            self._draft = self._stroke = None
            return
        box = self._stroke.to(pointer.x, pointer.y, self._pressed(pointer))
        if box is not None:
            self._draft.touch(box)


class FillTool(Tool):
    """Gives a connected region the label that one paints with, or clears it."""

    cursor = Qt.CursorShape.CrossCursor

    def press(self, pointer: Pointer) -> None:
        """Fill, or pick."""
        if not self.context.may_paint():
            return
        workspace, document = self.context.workspace, self.context.document
        draft = document.begin_draft(workspace.layer)
        label = 0 if pointer.erases else workspace.label
        box = flood_fill(draft.image, math.floor(pointer.y), math.floor(pointer.x), label)
        if box is None:
            draft.cancel()
            return
        draft.touch(box)
        verb = "Clear a shape of" if pointer.erases else "Fill"
        draft.commit(f"{verb} {LAYERS[workspace.layer].title.lower()}")


class PickTool(Tool):
    """Goes on with the layer and label that are painted where one clicks."""

    cursor = Qt.CursorShape.PointingHandCursor

    def press(self, pointer: Pointer) -> None:
        """Fill, or pick."""
        pick_label(self.context, pointer)


def pick_label(context: ToolContext, pointer: Pointer) -> None:
    """Paint with what is seen at a place from now on; tells a person if that is nothing."""
    layers = [(name, context.document.layer(name)) for name in reversed(visible_layers(context.workspace))]
    found = pick(layers, math.floor(pointer.y), math.floor(pointer.x))
    if found is None:
        context.tells.message.emit("Nothing is painted here.")
    else:
        context.workspace.use_label(*found)
        context.tells.message.emit(f"Paints {LAYERS[found[0]].title.lower()}, label {found[1]}.")


_DRAG = 6.0  # logical px after which a press is no click but draws freehand
_NODES = 5.0  # logical px between the points of a line that is drawn freehand
_ENDS = (Qt.Key.Key_Return, Qt.Key.Key_Enter)


class LineTool(Tool):
    """Collects points; Enter or a double click paints the line through them, Escape forgets them.

    A press that is dragged draws freehand, and paints when it is let go. Backspace or the right button
    takes the last point away.
    """

    cursor = Qt.CursorShape.CrossCursor

    def __init__(self, context: ToolContext) -> None:
        super().__init__(context)
        self._points: list[tuple[float, float]] = []
        self._place: tuple[float, float] | None = None
        self._pressed: tuple[float, float] | None = None
        self._freehand = False
        self._paints: tuple[str, int] = ("", 0)

    @property
    def is_busy(self) -> bool:
        """Whether there are points."""
        return bool(self._points)

    @property
    def width(self) -> float:
        """How wide the line is painted, px of the sketch."""
        workspace = self.context.workspace
        return line_width(self.context.document.sketch, workspace.layer, workspace.label, workspace.brush)

    def press(self, pointer: Pointer) -> None:
        """Add a point."""
        if pointer.erases:
            self.key(Qt.Key.Key_Backspace)
            return
        workspace = self.context.workspace
        if not self.context.may_paint():
            self.cancel()
            return
        if self._paints != (workspace.layer, workspace.label):
            self._points.clear()
        self._paints = (workspace.layer, workspace.label)
        at = (pointer.x, pointer.y)
        if not self._points or math.dist(at, self._points[-1]) * self.context.scale > 1.0:
            self._points.append(at)
        self._pressed, self._place = at, at
        self.context.tells.redraw()

    def move(self, pointer: Pointer) -> None:
        """Show where the line would go on; draw freehand."""
        at = (pointer.x, pointer.y)
        self._place = at
        if self._pressed is not None and self._points:
            away = math.dist(at, self._points[-1]) * self.context.scale
            self._freehand |= math.dist(at, self._pressed) * self.context.scale > _DRAG
            if self._freehand and away > _NODES:
                self._points.append(at)
        self.context.tells.redraw()

    def release(self, pointer: Pointer) -> None:
        """End what was drawn freehand."""
        self._pressed = None
        if self._freehand:
            self._freehand = False
            if self._points and math.dist(self._points[-1], (pointer.x, pointer.y)) > 0.5:
                self._points.append((pointer.x, pointer.y))
            self.finish()

    def double(self, pointer: Pointer) -> None:
        """Paint the line."""
        self.finish()

    def key(self, key: int) -> bool:
        """Paint, forget, or take a point back."""
        if not self.takes(key):
            return False
        if key in _ENDS:
            self.finish()
        elif key == Qt.Key.Key_Escape:
            self.cancel()
        else:
            self._points.pop()
        self.context.tells.redraw()
        return True

    def takes(self, key: int) -> bool:
        """Take Enter, Escape and Backspace while there are points."""
        return self.is_busy and key in (*_ENDS, Qt.Key.Key_Escape, Qt.Key.Key_Backspace)

    def finish(self) -> None:
        """Paint the line, a step of the history."""
        points, self._points = self._points, []
        self._pressed, self._freehand = None, False
        self.context.tells.redraw()
        layer, label = self._paints
        if not points or layer != self.context.workspace.layer or not self.context.may_paint():
            return
        width = line_width(self.context.document.sketch, layer, label, self.context.workspace.brush)
        draft = self.context.document.begin_draft(layer)
        box = draw_line(draft.image, points, width, label)
        if box is None:
            draft.cancel()
            return
        draft.touch(box)
        draft.commit(f"Draw a line of {LAYERS[layer].title.lower()}")

    def cancel(self) -> None:
        """Forget the line."""
        self._points = []
        self._pressed, self._freehand = None, False
        self.context.tells.redraw()

    def leave(self) -> None:
        """Show the tip no longer."""
        self._place = None
        self.context.tells.redraw()

    def draw(self, painter: QPainter) -> None:
        """Draw the line as wide as it will be, its points and its tip."""
        context, points = self.context, list(self._points)
        wide = max(self.width * context.scale, 1.0)
        follows = self._place is not None and not self._freehand
        if follows and points and self._place is not None and self._place != points[-1]:
            points.append(self._place)
        colour = label_colour(context.workspace.layer, context.workspace.label)
        if len(points) > 1:
            path = QPolygonF([context.at(x, y) for x, y in line_path(points)])
            for shade, more in ((QColor(255, 255, 255, 170), 3.0), (QColor(20, 20, 20, 150), 1.5)):
                painter.setPen(_pen(shade, wide + more))
                painter.drawPolyline(path)
            painter.setPen(_pen(colour, wide))
            painter.drawPolyline(path)
        if self._place is not None:
            self._draw_tip(painter, context.at(*self._place), wide)
        for x, y in self._points if not self._freehand else []:
            at = context.at(x, y)
            painter.setPen(QPen(QColor(20, 20, 20), 1.0))
            painter.setBrush(QColor(255, 255, 255))
            painter.drawRect(QRectF(at.x() - 3.0, at.y() - 3.0, 6.0, 6.0))

    def _draw_tip(self, painter: QPainter, at: QPointF, wide: float) -> None:
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for shade, line in ((QColor(255, 255, 255, 190), 3.0), (QColor(20, 20, 20, 220), 1.2)):
            painter.setPen(QPen(shade, line))
            painter.drawEllipse(at, 0.5 * wide, 0.5 * wide)
        metres = self.width * self.context.document.sketch.pixel_size
        text = f"{metres:.0f} m wide" if metres >= 9.5 else f"{metres:.1f} m wide"
        write_beside(painter, at + QPointF(0.5 * wide + 10.0, -0.5 * wide - 8.0), text)


def _pen(colour: QColor, width: float) -> QPen:
    return QPen(colour, width, Qt.PenStyle.SolidLine, Qt.PenCapStyle.RoundCap, Qt.PenJoinStyle.RoundJoin)
