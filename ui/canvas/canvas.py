"""The sketch editor: displays the sketch with its overlays; mouse, pen and keys, tool tips and a menu."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from PyQt6.QtCore import QEvent, QObject, QPointF, QRect, QRectF, QSize, Qt, pyqtSignal
from PyQt6.QtGui import (
    QContextMenuEvent,
    QFocusEvent,
    QHelpEvent,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QPointingDevice,
    QResizeEvent,
    QTabletEvent,
    QWheelEvent,
)
from PyQt6.QtWidgets import QSizePolicy, QToolTip, QWidget

from sketchterrain.ui.actions import ShortcutOverride, selection_menu
from sketchterrain.ui.canvas.decorations import Decorations, warning_at
from sketchterrain.ui.canvas.paint_tools import BrushTool, FillTool, LineTool, PickTool, pick_label
from sketchterrain.ui.canvas.select_tool import SelectTool
from sketchterrain.ui.canvas.sketch_image import SketchView
from sketchterrain.ui.canvas.tool_context import Pointer, Tool, ToolContext, Viewport
from sketchterrain.ui.engine.link import EngineLink
from sketchterrain.ui.engine.protocol import FrameFacts, GoTo
from sketchterrain.ui.look.theme import draw_focus
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.workspace import Workspace

_MARGIN = 28  # logical px around a fitted sketch
ZOOM = 1.25  # a step
_WHEEL_ZOOM = 1.2  # a notch
_WHEEL_BRUSH = 1.15
_STEP = 64.0  # logical px of an arrow key
_ARROWS = {
    Qt.Key.Key_Left: (1, 0),
    Qt.Key.Key_Right: (-1, 0),
    Qt.Key.Key_Up: (0, 1),
    Qt.Key.Key_Down: (0, -1),
}
_BRUSH_KEYS = {Qt.Key.Key_BracketLeft: 1.0 / 1.2, Qt.Key.Key_BracketRight: 1.2}
_ZOOM_KEYS = {Qt.Key.Key_Plus: ZOOM, Qt.Key.Key_Equal: ZOOM, Qt.Key.Key_Minus: 1.0 / ZOOM}
_KEYS = {*_ARROWS, *_BRUSH_KEYS, *_ZOOM_KEYS, Qt.Key.Key_Space, Qt.Key.Key_Home}
_PAINT_TOOLS = ("brush", "eraser", "line", "fill")


class Canvas(QWidget):
    """Displays a document's sketch; `CanvasInput` handles mouse, pen and keys."""

    hovered = pyqtSignal(object)  # (x, y, height or None) under the mouse, m; None: outside the sketch

    def __init__(self, document: Document, workspace: Workspace, link: EngineLink) -> None:
        super().__init__()
        self._context = ToolContext(document, workspace, link)
        self._sketch_view = SketchView(self._context, self)
        self.underlay, self.drapes = self._sketch_view.underlay, self._sketch_view.drapes
        self._input = CanvasInput(self._context, self)
        self._decorations = Decorations(self._context)
        self._fitted = True
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setAttribute(Qt.WidgetAttribute.WA_InputMethodEnabled, False)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self.setAccessibleName("Sketch")
        self.setAccessibleDescription("The layers of the sketch, to paint on; the arrow keys move it")
        self.setWhatsThis(
            "Paint here: the terrain follows. The wheel zooms, the middle button or the space bar moves the "
            "sketch, [ and ] change the brush, the right button erases, Alt picks a label."
        )
        document.sketch_changed.connect(self._on_sketch)
        document.opened.connect(self._on_opened)
        document.drapes.changed.connect(self._redraw)
        workspace.selection_changed.connect(self._redraw)
        workspace.look_changed.connect(self._redraw)
        link.placed_changed.connect(self._redraw)
        link.frame_shown.connect(self._on_frame)
        self._context.redraw = self._redraw
        self._sketch_view.stale.connect(self._on_stale)

    def sizeHint(self) -> QSize:
        return QSize(720, 720)

    @property
    def viewport(self) -> Viewport:
        """Position of the sketch, in device pixels."""
        return self._context.viewport

    def fit(self) -> None:
        self.set_viewport(self.viewport.fitted(margin=round(_MARGIN * self._context.ratio)), fitted=True)

    def actual_size(self) -> None:
        """Show each sketch pixel as one device pixel."""
        self.zoom(1.0 / self.viewport.scale)

    def show_place(self, x: float, y: float) -> None:
        """Centre a position (m)."""
        self.set_viewport(self.viewport.with_middle(*self._context.sketch_from_world(x, y)))

    def show_box(self, west: float, south: float, east: float, north: float) -> None:
        """Centre a box (m) and show as much of it as fits."""
        context = self._context
        size = max((east - west) / self.width(), (north - south) / self.height()) * 1.1  # m a logical px
        if size > 0.0:
            self.zoom(1.0 / (size * context.px_per_metre))
        self.show_place(0.5 * (west + east), 0.5 * (south + north))

    def zoom(self, factor: float, about: QPointF | None = None) -> None:
        """Zoom about a position (logical px), or the centre."""
        about, ratio = QPointF(self.rect().center()) if about is None else about, self._context.ratio
        self.set_viewport(self.viewport.zoomed(factor, about.x() * ratio, about.y() * ratio))

    def scroll_by(self, right: float, down: float) -> None:
        """Pan by logical px."""
        ratio = self._context.ratio
        self.set_viewport(self.viewport.moved(right * ratio, down * ratio))

    def set_viewport(self, viewport: Viewport, *, fitted: bool = False) -> None:
        """Show the sketch through a viewport; `fitted`: it stays fitted when the canvas is resized."""
        self._fitted |= fitted
        if viewport != self._context.viewport:
            self._fitted = fitted
            self._context.viewport = viewport
            self._decorations.reset()
            self._input.update_brush_ring()
            self.update()

    def _redraw(self, area: object = None) -> None:
        if isinstance(area, QRectF) and not area.isEmpty():
            self.update(area.toAlignedRect().adjusted(-2, -2, 2, 2))
        else:
            self.update()

    def _on_stale(self, pixels: QRect) -> None:
        ratio = self._context.ratio
        size = (pixels.width() / ratio, pixels.height() / ratio)
        self.update(QRectF(pixels.x() / ratio, pixels.y() / ratio, *size).toAlignedRect())

    def _on_sketch(self) -> None:
        sketch, viewport = self._context.document.sketch, self.viewport
        if (sketch.width_px, sketch.height_px) != (viewport.columns, viewport.rows):
            self._on_opened()
        self.update()

    def _on_opened(self) -> None:
        self._input.cancel()
        self._sketch_view.refresh()
        self._resize(fitted=True)

    def _on_frame(self, facts: FrameFacts) -> None:
        for area in self._decorations.camera_moved(facts):
            self._redraw(area)

    def _resize(self, *, fitted: bool) -> None:
        sketch, context = self._context.document.sketch, self._context
        context.ratio = self.devicePixelRatioF()
        size = round(self.width() * context.ratio), round(self.height() * context.ratio)
        sides = (sketch.width_px, sketch.height_px)
        if fitted or sides != (context.viewport.columns, context.viewport.rows):
            self._fitted = True
            context.viewport = Viewport(*size, *sides).fitted(margin=round(_MARGIN * context.ratio))
        else:
            context.viewport = context.viewport.resized(*size)
        self._decorations.reset()
        self.update()

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Keep the centre, or the whole sketch if it was fitted."""
        self._resize(fitted=self._fitted)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the cached sketch image, then decorations and the tool's overlay."""
        if self._context.ratio != self.devicePixelRatioF():  # moved to another screen
            self._resize(fitted=self._fitted)
        area = event.rect() if event is not None else self.rect()
        painter = QPainter(self)
        self._sketch_view.draw(painter, area)
        self._decorations.draw(painter, area, self._input.tool, self.width(), self.height())
        draw_focus(painter, self)
        painter.end()


class PanTool(Tool):
    """Pans, which `CanvasInput` does itself; a double click moves the 3-D view there."""

    cursor = Qt.CursorShape.OpenHandCursor

    def double(self, pointer: Pointer) -> None:
        self.context.link.send(GoTo(*self.context.world_from_sketch(pointer.x, pointer.y)))


class CanvasInput(QObject):
    """Event filter of the canvas: passes input to the active tool, pans and zooms."""

    def __init__(self, context: ToolContext, canvas: Canvas) -> None:
        super().__init__(canvas)  # the parent disconnects it
        self._context = context
        self._canvas = canvas
        self._select = SelectTool(context)
        self._tools: dict[str, Tool] = {
            "select": self._select,
            "brush": BrushTool(context),
            "eraser": BrushTool(context, erases=True),
            "line": LineTool(context),
            "fill": FillTool(context),
            "pick": PickTool(context),
            "pan": PanTool(context),
        }
        self._name = context.workspace.tool
        self._place: QPointF | None = None  # of the mouse, logical px
        self._pan_from: QPointF | None = None
        self._space = False
        context.workspace.tool_changed.connect(self._on_tool)
        context.workspace.brush_changed.connect(self._on_brush)
        kinds = QEvent.Type
        self._handlers: dict[QEvent.Type, Callable[[Any], bool]] = {
            kinds.MouseButtonPress: self._press,
            kinds.MouseMove: self._move,
            kinds.MouseButtonRelease: self._release,
            kinds.MouseButtonDblClick: self._double,
            kinds.Wheel: self._wheel,
            kinds.TabletPress: self._pen,
            kinds.TabletMove: self._pen,
            kinds.TabletRelease: self._pen,
            kinds.ContextMenu: self._menu,
            kinds.Enter: lambda _: self._show_cursor(),
            kinds.Leave: self._leave,
            kinds.KeyPress: self._press_key,
            kinds.KeyRelease: self._release_key,
            kinds.FocusOut: self._lose_focus,
            kinds.Hide: self._finish,
            kinds.ToolTip: self._show_tip,
        }
        canvas.installEventFilter(self)
        ShortcutOverride(canvas, self._takes_key)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        handler = None if event is None else self._handlers.get(event.type())
        return handler is not None and handler(event)

    @property
    def tool(self) -> Tool:
        return self._tools[self._name]

    def cancel(self) -> None:
        """Cancel the tools' operations: another document was opened."""
        self._pan_from = None
        for tool in self._tools.values():
            tool.cancel()

    def update_brush_ring(self) -> None:
        """Keep the brush's ring under the mouse when the viewport changes."""
        if isinstance(self.tool, BrushTool):
            self.tool.show_size(self._place)

    def _press(self, event: QMouseEvent) -> bool:
        self._place = event.position()
        pointer = self._pointer(event)
        pans = self._name == "pan" and event.button() == Qt.MouseButton.LeftButton
        if event.button() == Qt.MouseButton.MiddleButton or self._space or pans:
            self._pan_from = event.position()
        elif pointer.picks and self._name in _PAINT_TOOLS:
            pick_label(self._context, pointer)
        elif event.button() == Qt.MouseButton.LeftButton or self._name in _PAINT_TOOLS:
            self.tool.press(pointer)
            if self._name == "select" and self._context.workspace.selection is None:
                self._pan_from = event.position()  # nothing to drag: pan
        return self._show_cursor()

    def _move(self, event: QMouseEvent) -> bool:
        self._place = event.position()
        if self._pan_from is not None:
            moved = event.position() - self._pan_from
            self._pan_from = event.position()
            self._canvas.scroll_by(moved.x(), moved.y())
        else:
            self.tool.move(self._pointer(event))
        self._report_place()
        return self._show_cursor()

    def _release(self, event: QMouseEvent) -> bool:
        if self._pan_from is not None:
            self._pan_from = None
        else:
            self.tool.release(self._pointer(event))
        return self._show_cursor()

    def _double(self, event: QMouseEvent) -> bool:
        pointer = self._pointer(event)
        if event.button() == Qt.MouseButton.LeftButton and not self._space and not pointer.picks:
            self.tool.double(pointer)
            return True
        return self._press(event)  # Qt reports the second of two quick presses like this

    def _wheel(self, event: QWheelEvent) -> bool:
        """Zoom about the mouse; with Ctrl or Shift resize the brush."""
        notches = (event.angleDelta().y() or event.angleDelta().x()) / 120.0
        if event.modifiers() & (Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier):
            self._context.workspace.brush *= _WHEEL_BRUSH**notches
        else:
            self._canvas.zoom(_WHEEL_ZOOM**notches, event.position())
        event.accept()
        return True

    def _pen(self, event: QTabletEvent) -> bool:
        """Use the tool with a pen: pressure scales the brush, the pen's eraser erases."""
        self._place = event.position()
        if self._name == "pan" or self._space:
            event.ignore()  # Qt repeats it as a mouse event
            return True
        eraser = event.pointerType() == QPointingDevice.PointerType.Eraser
        pressed = event.type() != QEvent.Type.TabletMove or bool(event.buttons())
        pointer = Pointer(
            *self._context.sketch_from_screen(event.position()),
            pressure=event.pressure() if pressed else 1.0,
            erases=eraser or bool(event.buttons() & Qt.MouseButton.RightButton),
        )
        event.accept()
        if event.type() == QEvent.Type.TabletPress:
            self.tool.press(pointer)
        elif event.type() == QEvent.Type.TabletRelease:
            self.tool.release(pointer)
        else:
            self.tool.move(pointer)
        self._report_place()
        return True

    def _menu(self, event: QContextMenuEvent) -> bool:
        """Show the context menu of the feature under the mouse."""
        if self._name not in ("select", "pan"):
            return True
        context, place = self._context, QPointF(event.pos())
        document, workspace, placed = context.document, context.workspace, context.link.placed
        x, y = context.world_from_sketch(*context.sketch_from_screen(place))
        workspace.selection = self._select.selection_under(place)
        menu = selection_menu(self._canvas, document, workspace, placed, (x, y))
        menu.add_command("orbit", "Look here in 3-D", partial(context.link.send, GoTo(x, y)))
        menu.popup(event.globalPos())
        return True

    def _leave(self, _: QEvent) -> bool:
        self._place = None
        if not self.tool.is_busy:
            self.tool.leave()
        self._canvas.hovered.emit(None)
        return True

    def _lose_focus(self, event: QFocusEvent) -> bool:
        """Finish the tool's operation, unless the pointer has only moved to the 3-D view."""
        self._space = False
        return event.reason() != Qt.FocusReason.OtherFocusReason and self._finish()

    def _finish(self, _: QEvent | None = None) -> bool:
        self._pan_from = None
        self._space = False
        self.tool.finish()
        return False

    def _takes_key(self, event: QKeyEvent) -> bool:
        """Return whether a key means something here, so that no shortcut of the window gets it."""
        if event.modifiers() & (Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier):
            return False
        return event.key() in _KEYS or self.tool.takes_key(event.key())

    def _press_key(self, event: QKeyEvent) -> bool:
        key = event.key()
        if not self._takes_key(event):
            return False
        if self.tool.takes_key(key):
            self.tool.press_key(key)
        elif key == Qt.Key.Key_Space:
            if not event.isAutoRepeat():
                self._hold_space(True)
        elif key == Qt.Key.Key_Home:
            self._canvas.fit()
        elif key in _ARROWS:
            right, down = _ARROWS[Qt.Key(key)]
            self._canvas.scroll_by(right * _STEP, down * _STEP)
        elif key in _BRUSH_KEYS:
            self._context.workspace.brush *= _BRUSH_KEYS[Qt.Key(key)]
        else:
            self._canvas.zoom(_ZOOM_KEYS[Qt.Key(key)])
        return True

    def _release_key(self, event: QKeyEvent) -> bool:
        if event.key() != Qt.Key.Key_Space:
            return False
        if not event.isAutoRepeat():
            self._hold_space(False)
        return True

    def _hold_space(self, held: bool) -> None:
        """Pan with any tool while the space bar is held."""
        self._space = held
        self._show_cursor()

    def _show_tip(self, event: QHelpEvent) -> bool:
        text = ""
        if "contradictions" in self._context.workspace.overlays:
            text = warning_at(self._context, QPointF(event.pos()))
        QToolTip.showText(event.globalPos(), text, self._canvas)
        return True

    def _show_cursor(self) -> bool:
        if self._pan_from is not None:
            shape = Qt.CursorShape.ClosedHandCursor
        elif self._space:
            shape = Qt.CursorShape.OpenHandCursor
        else:
            shape = self.tool.cursor_at(self._place or QPointF())
        if shape != self._canvas.cursor().shape():
            self._canvas.setCursor(shape)
        return True

    def _pointer(self, event: QMouseEvent) -> Pointer:
        return Pointer(
            *self._context.sketch_from_screen(event.position()),
            erases=bool((event.buttons() | event.button()) & Qt.MouseButton.RightButton),
            picks=bool(event.modifiers() & Qt.KeyboardModifier.AltModifier),
        )

    def _on_tool(self, name: str) -> None:
        self.tool.finish()
        self.tool.leave()
        self._name = name
        self._on_brush()
        self._show_cursor()
        self._canvas.update()

    def _on_brush(self) -> None:
        self.update_brush_ring()
        if self._name == "line":
            self._context.redraw()

    def _report_place(self) -> None:
        """Emit the position and height under the mouse."""
        if self._place is None:
            return
        x, y = self._context.sketch_from_screen(self._place)
        sketch, relief = self._context.document.sketch, self._context.link.relief
        if not (0.0 <= x < sketch.width_px and 0.0 <= y < sketch.height_px):
            self._canvas.hovered.emit(None)
            return
        height = None
        if relief is not None:
            row, column = int(y // relief.step), int(x // relief.step)
            if row < relief.height.shape[0] and column < relief.height.shape[1]:
                height = float(relief.height[row, column])
        self._canvas.hovered.emit((*self._context.world_from_sketch(x, y), height))
