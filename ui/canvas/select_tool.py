"""Choosing and dragging what was placed."""

from __future__ import annotations

import math

from PyQt6.QtCore import QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QPainter, QPen

from sketchterrain.ui.canvas.decorations import write_beside
from sketchterrain.ui.canvas.marks import SELECTED, FeatureMarks, draw_selection
from sketchterrain.ui.canvas.tool_context import Pointer, Tool, ToolContext
from sketchterrain.ui.commands.placed_edits import exists, name_of
from sketchterrain.ui.commands.selection import delete
from sketchterrain.ui.engine.protocol import GoTo, Placement
from sketchterrain.ui.models.handles import FeatureDrag, Handle, handles_of, select_at
from sketchterrain.ui.models.workspace import Selection

_REACH = 9.0  # logical px by which a click may miss
_DRAG = 4.0  # logical px after which a press is a drag
_OUT = 12.0  # logical px that a width's handle stands off its bank
_APART = 16.0  # logical px between control points that are shown
_DELETES = (Qt.Key.Key_Delete, Qt.Key.Key_Backspace)


class SelectTool(Tool):
    """A click chooses, a drag moves, handles resize."""

    def __init__(self, context: ToolContext, marks: FeatureMarks) -> None:
        super().__init__(context)
        self._marks = marks
        self._hovered: Selection | None = None
        self._drag: FeatureDrag | None = None
        self._pressed: tuple[float, float] | None = None
        self._doubled: tuple[float, float] | None = None
        self._shown: tuple[Placement | None, FeatureDrag] | None = None

    @property
    def is_busy(self) -> bool:
        """Whether something is dragged."""
        return self._drag is not None

    def press(self, pointer: Pointer) -> None:
        """Choose, or take hold of a handle."""
        placed = self.context.link.placed
        if placed is None or pointer.erases:
            return
        at = self.context.metres(pointer.x, pointer.y)
        handle = self._handle_at(placed, pointer)
        if handle is not None:
            self.context.workspace.selection = handle.selection
            self._begin(placed, handle, at)
            return
        self.context.workspace.selection = self._chosen_at(placed, at)
        self._pressed = at
        self.context.tells.redraw()

    def move(self, pointer: Pointer) -> None:
        """Drag, or show what would be chosen."""
        at = self.context.metres(pointer.x, pointer.y)
        placed = self.context.link.placed
        if self._drag is not None:
            self._drag.to(*at)
            if self._drag.problem:
                self.context.tells.message.emit(self._drag.problem)
            self.context.tells.redraw()
        elif placed is not None and self._pressed is not None:
            if math.dist(at, self._pressed) * self.context.px_per_metre > _DRAG:
                handles = handles_of(placed, self.context.workspace.selection)
                if handles and handles[0].role == "move":
                    self._begin(placed, handles[0], self._pressed)
                    self.move(pointer)
        elif placed is not None:
            hovered = None if self._handle_at(placed, pointer) else self._chosen_at(placed, at)
            if hovered != self._hovered:
                self._hovered = hovered
                self.context.tells.redraw()

    def release(self, pointer: Pointer) -> None:
        """Let go; after a double click that was not dragged bring the 3-D view there."""
        self._pressed = None
        self.finish()
        doubled, self._doubled = self._doubled, None
        if doubled is not None and math.dist(doubled, (pointer.x, pointer.y)) * self.context.scale <= _DRAG:
            self.context.link.send(GoTo(*self.context.metres(*doubled)))

    def double(self, pointer: Pointer) -> None:
        """Begin as with any press: who clicks and at once drags means the drag."""
        self.press(pointer)
        self._doubled = (pointer.x, pointer.y)

    def finish(self) -> None:
        """Let go: what was dragged is a step of the history."""
        drag, self._drag = self._drag, None
        self._pressed = None
        if drag is not None:
            drag.finish()
            self.context.tells.redraw()

    def cancel(self) -> None:
        """Put what was dragged back."""
        drag, self._drag = self._drag, None
        self._shown = self._pressed = None
        if drag is not None:
            drag.cancel()
            self.context.tells.redraw()

    def leave(self) -> None:
        """Show no longer what would be chosen."""
        self._hovered = None
        self.context.tells.redraw()

    def takes(self, key: int) -> bool:
        """Take Escape and Delete while something is chosen."""
        selection = self.context.workspace.selection
        return (key == Qt.Key.Key_Escape and (self.is_busy or selection is not None)) or (
            key in _DELETES and selection is not None
        )

    def key(self, key: int) -> bool:
        """Let go or choose nothing by Escape; delete what is chosen."""
        workspace, placed = self.context.workspace, self.context.link.placed
        if not self.takes(key):
            return False
        if key == Qt.Key.Key_Escape and self.is_busy:
            self.cancel()
        elif key == Qt.Key.Key_Escape:
            workspace.selection = None
        elif placed is not None and workspace.selection is not None:
            self.finish()
            delete(self.context.document, workspace, placed, workspace.selection)
        return True

    def chosen_under(self, place: QPointF) -> Selection | None:
        """Return what a click at a place of the screen would choose."""
        placed = self.context.link.placed
        at = self.context.metres(*self.context.on_sketch(place))
        return None if placed is None else self._chosen_at(placed, at)

    def cursor_at(self, place: QPointF) -> Qt.CursorShape:
        """Return what shows whether there is something to take hold of."""
        if self._drag is not None:
            return Qt.CursorShape.ClosedHandCursor
        placed = self.context.link.placed
        handle = None if placed is None else self._handle_near(placed, place)
        if handle is not None:
            return Qt.CursorShape.SizeAllCursor
        return Qt.CursorShape.PointingHandCursor if self._hovered else Qt.CursorShape.ArrowCursor

    def draw(self, painter: QPainter) -> None:
        """Draw what is chosen with its handles, and what would be chosen."""
        placed, selection = self.context.link.placed, self.context.workspace.selection
        if placed is None:
            return
        hover, accent = QColor(SELECTED), SELECTED
        hover.setAlpha(150)
        if self._hovered is not None and self._drag is None and exists(placed, self._hovered):
            draw_selection(painter, self._marks, self.context, placed, self._hovered, hover)
            if selection is None or self._hovered.id != selection.id:
                self._draw_name(painter, placed, self._hovered)
        if selection is None or not exists(placed, selection):
            return
        draw_selection(painter, self._marks, self.context, placed, selection, accent)
        for handle in self._handles(placed):
            self._draw_handle(painter, handle, selection)
        self._draw_drag(painter, placed)

    def _draw_handle(self, painter: QPainter, handle: Handle, selection: Selection) -> None:
        at, base = self._shown_at(handle), self.context.screen_from_world(handle.base_x, handle.base_y)
        if handle.role in ("radius", "width"):
            painter.setPen(QPen(SELECTED, 1.0, Qt.PenStyle.DashLine))
            painter.drawLine(base, at)
        strong = handle.selection.index is not None and handle.selection.index == selection.index
        painter.setPen(QPen(SELECTED, 1.8))
        painter.setBrush(SELECTED if strong else QColor(255, 255, 255))
        if handle.role == "point":
            painter.drawRect(QRectF(at.x() - 3.5, at.y() - 3.5, 7.0, 7.0))
        else:
            painter.drawEllipse(at, 5.0, 5.0)

    def _draw_drag(self, painter: QPainter, placed: Placement) -> None:
        """Draw where the handle is, before the engine has placed it there."""
        if self._shown is None or (self._drag is None and self._shown[0] is not placed):
            self._shown = None
            return
        drag = self._shown[1]
        at = self.context.screen_from_world(drag.x, drag.y)
        if self._drag is not None or self._shown[0] is placed:
            painter.setPen(QPen(QColor(255, 255, 255), 2.0))
            painter.setBrush(SELECTED)
            painter.drawEllipse(at, 5.5, 5.5)
        if self._drag is None:
            return
        handle = drag.handle
        away = math.dist((drag.x, drag.y), (handle.base_x, handle.base_y))
        texts = {"radius": f"{away:.0f} m", "width": f"{2.0 * away:.0f} m wide"}
        text = texts.get(handle.role, f"{drag.x:.0f} m, {drag.y:.0f} m")
        write_beside(painter, at + QPointF(12.0, -10.0), text)

    def _draw_name(self, painter: QPainter, placed: Placement, selection: Selection) -> None:
        handles = handles_of(placed, selection)
        if handles and handles[0].role == "move":
            at = self.context.screen_from_world(handles[0].x, handles[0].y)
            write_beside(painter, at + QPointF(10.0, -9.0), name_of(placed, selection).capitalize())

    def _begin(self, placed: Placement, handle: Handle, at: tuple[float, float]) -> None:
        self._drag = FeatureDrag(self.context.document, placed, handle, grab=at)
        self._shown = (placed, self._drag)
        self._hovered = None
        self.context.tells.redraw()

    def _chosen_at(self, placed: Placement, at: tuple[float, float]) -> Selection | None:
        return select_at(placed, *at, reach=_REACH / self.context.px_per_metre)

    def _handle_at(self, placed: Placement, pointer: Pointer) -> Handle | None:
        return self._handle_near(placed, self.context.at(pointer.x, pointer.y))

    def _handle_near(self, placed: Placement, place: QPointF) -> Handle | None:
        """Find the handle that is shown near a place of the screen."""
        near = []
        for handle in self._handles(placed):
            off = self._shown_at(handle) - place
            near.append((math.hypot(off.x(), off.y()), handle))
        best = min(near, key=lambda pair: pair[0], default=None)
        return best[1] if best is not None and best[0] <= _REACH else None

    def _handles(self, placed: Placement) -> list[Handle]:
        """Return the handles that have room on the screen; the chosen point's before its neighbours'."""
        selection = self.context.workspace.selection
        handles = handles_of(placed, selection)
        own = None if selection is None else selection.index
        kept: list[Handle] = []
        places: list[QPointF] = []
        for handle in sorted(handles, key=lambda each: each.role == "point" and each.selection.index != own):
            place = self._shown_at(handle)
            if handle.role == "point" and any(
                math.hypot(place.x() - other.x(), place.y() - other.y()) < _APART for other in places
            ):
                continue
            kept.append(handle)
            places.append(place)
        return kept

    def _shown_at(self, handle: Handle) -> QPointF:
        """Where a handle is drawn: that of a width stands off its bank, clear of the course."""
        at = self.context.screen_from_world(handle.x, handle.y)
        if handle.role != "width":
            return at
        off = at - self.context.screen_from_world(handle.base_x, handle.base_y)
        length = math.hypot(off.x(), off.y())
        return at + (off * (_OUT / length) if length > 0.0 else QPointF(0.0, -_OUT))
