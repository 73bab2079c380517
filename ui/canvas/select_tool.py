"""The selection tool: selects placed features and vectors, drags them and their handles."""

import math
from dataclasses import replace

from PyQt6.QtCore import QLineF, QPointF, QRectF, Qt
from PyQt6.QtGui import QColor, QPainter, QPen

from sketchterrain.ui.canvas.decorations import write_beside
from sketchterrain.ui.canvas.marks import SELECTED, draw_placed
from sketchterrain.ui.canvas.tool_context import Pointer, Tool, ToolContext
from sketchterrain.ui.canvas.vectors import draw_feature, draw_selected_feature
from sketchterrain.ui.commands import exists, name_of, reported
from sketchterrain.ui.engine.protocol import GoTo, Placement
from sketchterrain.ui.models.features import SelectedFeature, drag_refusal, insert_vertex
from sketchterrain.ui.models.selection import (
    OFFSET_ROLES,
    REACH,
    FeatureDrag,
    delete,
    handles_of,
    kept,
    next_below,
    selections_at,
)
from sketchterrain.ui.models.workspace import Handle, Selection

_DRAG = 4.0  # logical px after which a press is a drag
_WIDTH_OFFSET = 12.0  # logical px of a width handle from its bank
_LEAST_DISTANCE = 16.0  # logical px between visible control points
_DELETE_KEYS = (Qt.Key.Key_Delete, Qt.Key.Key_Backspace)


class SelectTool(Tool):
    """A click selects, a drag moves, handles resize."""

    def __init__(self, context: ToolContext) -> None:
        super().__init__(context)
        self._hovered: Selection | None = None
        self._drag: FeatureDrag | None = None
        self._pressed: tuple[tuple[float, float], Handle | None] | None = None  # place, m
        self._next: Selection | None = None  # that a click on the selected draped feature selects
        self._double_clicked: tuple[float, float] | None = None
        self._last_drag: tuple[Placement, FeatureDrag] | None = None  # drawn until it is placed

    @property
    def is_busy(self) -> bool:
        return self._drag is not None

    def press(self, pointer: Pointer) -> None:
        """Select what is there; a handle is dragged at once, a vertex or centre after a few px."""
        if pointer.erases:
            return
        at = self.context.world_from_sketch(pointer.x, pointer.y)
        handle = self._handle_at(at)
        before, self._next = self.context.workspace.selection, None
        found = self._selections_at(at) if handle is None else [handle.selection]
        whole = before and replace(before, index=None)
        if handle is None and whole is not None and not whole.is_placed and whole in found:
            handle, self._next = Handle("move", whole, *at, *at), next_below(found, whole)
        selection = self.context.workspace.selection = handle.selection if handle else next(iter(found), None)
        if handle is not None and handle.selection.is_placed:
            self._start_drag(handle, at)
            return
        if handle is None:
            handle = next(iter(handles_of(self.context.link.placed, selection)), None)
            handle = handle if handle is not None and handle.role == "move" else None
        self._pressed = at, handle
        self.context.redraw()

    def move(self, pointer: Pointer) -> None:
        """Drag, or highlight what a click would select."""
        at = self.context.world_from_sketch(pointer.x, pointer.y)
        if self._drag is None and self._pressed is not None:
            start, handle = self._pressed
            if handle is not None and math.dist(at, start) * self.context.px_per_metre > _DRAG:
                self._start_drag(handle, start)
        if self._drag is not None:
            self._drag.to(*at)
            self._report(self._drag.problem)
            self.context.redraw()
        elif self._pressed is None:
            self._hover(None if self._handle_at(at) else next(iter(self._selections_at(at)), None))

    def release(self, pointer: Pointer) -> None:
        """Finish the drag; after a double click without one, move the 3-D view there."""
        if self._drag is None and self._pressed is not None and self._next is not None:
            self.context.workspace.selection = self._next
        self.finish()
        at, self._double_clicked = self._double_clicked, None
        if at is not None and math.dist(at, (pointer.x, pointer.y)) * self.context.scale <= _DRAG:
            self.context.link.send(GoTo(*self.context.world_from_sketch(*at)))

    def double(self, pointer: Pointer) -> None:
        """Insert a vertex in the selected vector, else press: a drag may follow at once."""
        at, context = self.context.world_from_sketch(pointer.x, pointer.y), self.context
        with reported(self._report):
            handle, reach = self._handle_at(at), REACH / context.px_per_metre
            is_vertex = handle is not None and handle.is_vertex
            if is_vertex or not insert_vertex(context.document, context.workspace, *at, reach=reach):
                self.press(pointer)
                self._double_clicked = (pointer.x, pointer.y)

    def finish(self) -> None:
        """Record the drag as a history step."""
        drag, self._drag = self._drag, None
        self._pressed = None
        if drag is not None:
            drag.finish()
            self._report(drag.problem)
            self.context.redraw()

    def cancel(self) -> None:
        drag, self._drag = self._drag, None
        self._last_drag = self._pressed = None
        if drag is not None:
            drag.cancel()
            self.context.redraw()

    def leave(self) -> None:
        self._hover(None)

    def takes_key(self, key: int) -> bool:
        selected = self.context.workspace.selection is not None
        return (key == Qt.Key.Key_Escape and (self.is_busy or selected)) or (key in _DELETE_KEYS and selected)

    def press_key(self, key: int) -> None:
        workspace = self.context.workspace
        if key == Qt.Key.Key_Escape and self.is_busy:
            self.cancel()
        elif key == Qt.Key.Key_Escape:
            workspace.selection = None
        elif workspace.selection is not None:
            self.finish()
            with reported(self._report):
                delete(self.context.document, workspace, self.context.link.placed, workspace.selection)

    def selection_under(self, place: QPointF) -> Selection | None:
        """Return what a command at a screen position is for: a vertex, or what a click would select."""
        at = self.context.world_from_sketch(*self.context.sketch_from_screen(place))
        handle = self._handle_at(at)
        if handle is not None and handle.is_vertex:
            return handle.selection
        return kept(self._selections_at(at), self.context.workspace.selection)

    def cursor_at(self, place: QPointF) -> Qt.CursorShape:
        if self.is_busy:
            return Qt.CursorShape.ClosedHandCursor
        at = self.context.world_from_sketch(*self.context.sketch_from_screen(place))
        if self._handle_at(at) is not None:
            return Qt.CursorShape.SizeAllCursor
        return Qt.CursorShape.ArrowCursor if self._hovered is None else Qt.CursorShape.PointingHandCursor

    def draw(self, painter: QPainter) -> None:
        placed, selection, hovered = self.context.link.placed, self.context.workspace.selection, self._hovered
        faint = QColor(SELECTED)
        faint.setAlpha(150)
        if self._drag is None:
            own = SelectedFeature.find(self.context.document, hovered)
            draw_feature(painter, self.context, own, faint)
        if (selected := self._selected) is not None:
            draw_selected_feature(painter, self.context, selected, self._drag)
        if hovered is not None and self._drag is None and exists(placed, hovered):
            draw_placed(painter, self.context, hovered, faint)
            handles = handles_of(placed, hovered)
            other = selection is None or hovered.id != selection.id
            if other and handles and handles[0].role == "move":
                at = self.context.screen_from_world(handles[0].x, handles[0].y)
                write_beside(painter, at + QPointF(10.0, -9.0), name_of(placed, hovered).capitalize())
        if selection is not None:
            draw_placed(painter, self.context, selection, SELECTED)
        if self._drag is None or not self._drag.handle.is_vertex:
            for handle in self._handles():
                self._draw_handle(painter, handle)
            self._draw_drag(painter, placed)

    def _draw_handle(self, painter: QPainter, handle: Handle) -> None:
        at = self._handle_place(handle)
        if handle.role in ("radius", "width"):
            painter.setPen(QPen(SELECTED, 1.0, Qt.PenStyle.DashLine))
            painter.drawLine(self.context.screen_from_world(handle.base_x, handle.base_y), at)
        active = handle.selection.index is not None and handle.selection == self.context.workspace.selection
        painter.setPen(QPen(SELECTED, 1.8))
        painter.setBrush(SELECTED if active else QColor(255, 255, 255))
        if handle.role == "point":
            painter.drawRect(QRectF(at.x() - 3.5, at.y() - 3.5, 7.0, 7.0))
        elif handle.role == "corner":
            painter.drawPolygon(*(at + QPointF(*each) for each in ((-5, 0), (0, 5), (5, 0), (0, -5))))
        else:
            painter.drawEllipse(at, 5.0, 5.0)

    def _draw_drag(self, painter: QPainter, placed: Placement) -> None:
        """Draw the dragged handle until the engine has placed it."""
        if self._last_drag is None:
            return
        before, drag = self._last_drag
        if self._drag is None and (before is not placed or not drag.handle.selection.is_placed):
            self._last_drag = None
            return
        at = self.context.screen_from_world(drag.x, drag.y)
        painter.setPen(QPen(QColor(255, 255, 255), 2.0))
        painter.setBrush(SELECTED)
        painter.drawEllipse(at, 5.5, 5.5)
        if self._drag is None:
            return
        handle = drag.handle
        distance = math.dist((drag.x, drag.y), (handle.base_x, handle.base_y))
        texts = {"radius": f"{distance:.0f} m", "width": f"{2.0 * distance:.0f} m wide"}
        text = texts.get(handle.role, f"{drag.x:.0f} m, {drag.y:.0f} m")
        write_beside(painter, at + QPointF(12.0, -10.0), text)

    def _start_drag(self, handle: Handle, at: tuple[float, float]) -> None:
        context, placed = self.context, self.context.link.placed
        self._pressed = None
        if refusal := drag_refusal(context.document, context.workspace, handle):
            self._report(refusal)
            return
        reach = REACH / context.px_per_metre
        self._drag = FeatureDrag(context.document, placed, handle, grab=at, reach=reach)
        self._last_drag = placed, self._drag
        self._hovered = None
        context.redraw()

    def _hover(self, hovered: Selection | None) -> None:
        if hovered != self._hovered:
            self._hovered = hovered
            self.context.redraw()

    def _report(self, problem: str) -> None:
        if problem:
            self.context.document.message.emit(problem)

    def _selections_at(self, at: tuple[float, float]) -> list[Selection]:
        """Return what a click at a position (m) selects, and then what further clicks do."""
        context = self.context
        return selections_at(
            context.document, context.workspace, context.link.placed, *at, 1.0 / context.px_per_metre
        )

    @property
    def _selected(self) -> SelectedFeature | None:
        """The selected feature, as it is dragged."""
        context, drag = self.context, self._drag
        sketch = None if drag is None else drag.sketch
        return SelectedFeature.find(context.document, context.workspace.selection, sketch)

    def _handle_at(self, at: tuple[float, float]) -> Handle | None:
        """Return the handle at a position, m."""
        place, own = self.context.screen_from_world(*at), self._selected
        vertex = None if own is None else own.vertex_at(*at, reach=REACH / self.context.px_per_metre)
        if vertex is not None:
            return vertex
        handles = self._handles()
        near = [(QLineF(place, self._handle_place(each)).length(), each) for each in handles]
        best = min(near, key=lambda pair: pair[0], default=None)
        return best[1] if best is not None and best[0] <= REACH else None

    def _handles(self) -> list[Handle]:
        """Return handles that do not overlap on the screen; the selected point's before its neighbours'."""
        selection, own = self.context.workspace.selection, self._selected
        index = None if selection is None else selection.index
        handles: list[Handle] = []
        places: list[QPointF] = []
        for handle in sorted(
            handles_of(self.context.link.placed, selection),
            key=lambda each: each.role == "point" and each.selection.index != index,
        ):
            place = self._handle_place(handle)
            is_clear = all(QLineF(place, other).length() >= _LEAST_DISTANCE for other in places)
            if handle.role != "point" or is_clear:
                handles.append(handle)
                places.append(place)
        return [*handles, *(() if own is None else own.box_handles)]

    def _handle_place(self, handle: Handle) -> QPointF:
        """Return a handle's screen position: some lie off a bank or box, clear of it."""
        at = self.context.screen_from_world(handle.x, handle.y)
        if handle.role not in OFFSET_ROLES:
            return at
        offset = at - self.context.screen_from_world(handle.base_x, handle.base_y)
        length = math.hypot(offset.x(), offset.y())
        return at + (offset * (_WIDTH_OFFSET / length) if length > 0.0 else QPointF(0.0, -_WIDTH_OFFSET))
