"""Mouse, pen and keyboard input of the canvas, and its tool tips and menus."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from PyQt6.QtCore import QEvent, QObject, QPointF, Qt
from PyQt6.QtGui import QHelpEvent, QPointingDevice
from PyQt6.QtWidgets import QToolTip

from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.ui.canvas.decorations import warning_at
from sketchterrain.ui.canvas.paint_tools import BrushTool, FillTool, LineTool, PickTool, pick_label
from sketchterrain.ui.canvas.select_tool import SelectTool
from sketchterrain.ui.canvas.tool_context import Pointer, Tool
from sketchterrain.ui.commands.selection import add
from sketchterrain.ui.engine.protocol import GoTo
from sketchterrain.ui.menus import ContextMenu, add_selection_commands

if TYPE_CHECKING:
    from PyQt6.QtGui import QContextMenuEvent, QKeyEvent, QMouseEvent, QTabletEvent, QWheelEvent
    from PyQt6.QtWidgets import QWidget

    from sketchterrain.ui.canvas.canvas import Canvas
    from sketchterrain.ui.canvas.marks import FeatureMarks
    from sketchterrain.ui.canvas.tool_context import ToolContext
    from sketchterrain.ui.models.workspace import Selection


def feature_menu(
    parent: QWidget, context: ToolContext, selection: Selection | None, x: float, y: float
) -> ContextMenu:
    """Return the menu for what is chosen and for a place."""
    menu = ContextMenu(parent)
    document, workspace, placed = context.document, context.workspace, context.link.placed
    if selection is not None and placed is not None:
        add_selection_commands(menu, document, workspace, placed, selection)
        menu.addSeparator()
    adding = menu.add_submenu("add", "Add here")
    for kind in FEATURE_TYPES:
        adding.add_command("", kind.capitalize(), partial(add, document, workspace, kind, x, y))
    menu.add_command("orbit", "Look here in 3-D", partial(context.link.send, GoTo(x, y)))
    return menu


class Tips(QObject):
    """Shows tool tips on a canvas."""

    def __init__(self, context: ToolContext, canvas: QWidget) -> None:
        super().__init__(canvas)
        self._desk, self._canvas = context, canvas
        canvas.installEventFilter(self)

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        """Show a tip where there is something to tell, and take it away elsewhere."""
        if not isinstance(event, QHelpEvent) or event.type() != QEvent.Type.ToolTip:
            return False
        text = ""
        if "contradictions" in self._desk.workspace.overlays:
            text = warning_at(self._desk, QPointF(event.pos()))
        QToolTip.showText(event.globalPos(), text, self._canvas)
        return True


_WHEEL_ZOOM = 1.2  # a notch
_WHEEL_BRUSH = 1.15
_PAINTERS = ("brush", "eraser", "line", "fill")


class PanTool(Tool):
    """Moves the sheet, which the canvas does itself; a double click brings the 3-D view there."""

    cursor = Qt.CursorShape.OpenHandCursor

    def double(self, pointer: Pointer) -> None:
        """Bring the 3-D view there."""
        self.context.link.send(GoTo(*self.context.metres(pointer.x, pointer.y)))


class CanvasInput(QObject):
    """Brings mouse and pen to the tool that the workspace says."""

    def __init__(self, context: ToolContext, marks: FeatureMarks, canvas: Canvas) -> None:
        super().__init__(canvas)  # which ends its connections
        self._desk = context
        self._canvas = canvas
        self._tools: dict[str, Tool] = {
            "select": SelectTool(context, marks),
            "brush": BrushTool(context),
            "eraser": BrushTool(context, erases=True),
            "line": LineTool(context),
            "fill": FillTool(context),
            "pick": PickTool(context),
            "pan": PanTool(context),
        }
        self._name = context.workspace.tool
        self._place: QPointF | None = None
        self._grabbed: QPointF | None = None
        self._space = False
        context.workspace.tool_changed.connect(self._on_tool)
        context.workspace.brush_changed.connect(self._on_brush)

    @property
    def tool(self) -> Tool:
        """The one that is used."""
        return self._tools[self._name]

    def press(self, event: QMouseEvent | None) -> None:
        """Begin: move the sheet, pick, or what the tool does."""
        if event is None:
            return
        self._place = event.position()
        pointer = self._pointer(event.position(), event)
        if event.button() == Qt.MouseButton.MiddleButton or self._space or self._pans(event):
            self._grabbed = event.position()
        elif pointer.picks and self._name in _PAINTERS:
            pick_label(self._desk, pointer)
        elif event.button() == Qt.MouseButton.LeftButton or self._name in _PAINTERS:
            self.tool.press(pointer)
            if self._name == "select" and self._desk.workspace.selection is None:
                self._grabbed = event.position()  # there is nothing to drag but the sheet
        self.show_cursor()

    def move(self, event: QMouseEvent | None) -> None:
        """Go on."""
        if event is None:
            return
        self._place = event.position()
        if self._grabbed is not None:
            moved = event.position() - self._grabbed
            self._grabbed = event.position()
            self._canvas.scroll_by(moved.x(), moved.y())
        else:
            self.tool.move(self._pointer(event.position(), event))
        self._tell_place()
        self.show_cursor()

    def release(self, event: QMouseEvent | None) -> None:
        """Let go."""
        if event is None:
            return
        if self._grabbed is not None:
            self._grabbed = None
        else:
            self.tool.release(self._pointer(event.position(), event))
        self.show_cursor()

    def double(self, event: QMouseEvent | None) -> None:
        """Do what the tool does at a double click."""
        if event is None:
            return
        pointer = self._pointer(event.position(), event)
        if event.button() == Qt.MouseButton.LeftButton and not self._space and not pointer.picks:
            self.tool.double(pointer)
        else:  # Qt tells the second of two quick presses so
            self.press(event)

    def wheel(self, event: QWheelEvent | None) -> None:
        """Zoom about the mouse; with Ctrl or Shift change the brush."""
        if event is None:
            return
        notches = (event.angleDelta().y() or event.angleDelta().x()) / 120.0
        event.accept()
        changes = Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.ShiftModifier
        if event.modifiers() & changes:
            self._desk.workspace.brush *= _WHEEL_BRUSH**notches
        else:
            self._canvas.zoom(_WHEEL_ZOOM**notches, event.position())

    def pen(self, event: QTabletEvent | None) -> None:
        """Use the tool with a pen: its pressure counts, its eraser erases."""
        if event is None:
            return
        self._place = event.position()
        erases = event.pointerType() == QPointingDevice.PointerType.Eraser
        if event.buttons() & Qt.MouseButton.RightButton:
            erases = True
        pressed = event.type() != QEvent.Type.TabletMove or bool(event.buttons())
        at = self._desk.on_sketch(event.position())
        pointer = Pointer(*at, pressure=event.pressure() if pressed else 1.0, erases=erases)
        if self._name == "pan" or self._space:
            event.ignore()  # it comes again as the mouse
            return
        event.accept()
        if event.type() == QEvent.Type.TabletPress:
            self.tool.press(pointer)
        elif event.type() == QEvent.Type.TabletRelease:
            self.tool.release(pointer)
        else:
            self.tool.move(pointer)
        self._tell_place()

    def menu(self, event: QContextMenuEvent | None) -> None:
        """Offer what can be done with a feature, with the tools that choose."""
        select = self._tools["select"]
        if event is None or self._name not in ("select", "pan") or not isinstance(select, SelectTool):
            return
        place = QPointF(event.pos())
        selection = select.chosen_under(place)
        self._desk.workspace.selection = selection
        at = self._desk.metres(*self._desk.on_sketch(place))
        menu = feature_menu(self._canvas, self._desk, selection, *at)
        menu.popup(event.globalPos())

    def leave(self) -> None:
        """Forget where the mouse was."""
        self._place = None
        if not self.tool.is_busy:
            self.tool.leave()
        self._canvas.hovered.emit(None)

    def hold_space(self, held: bool) -> None:
        """Move the sheet with any tool while the space bar is held."""
        self._space = held
        self.show_cursor()

    def finish(self) -> None:
        """Come to an end with what was begun."""
        self._grabbed = None
        self._space = False
        self.tool.finish()

    def forget(self) -> None:
        """Cancel what was begun: the document is another one."""
        self._grabbed = None
        for tool in self._tools.values():
            tool.cancel()

    def show_cursor(self) -> None:
        """Show what the mouse would do."""
        if self._grabbed is not None:
            shape = Qt.CursorShape.ClosedHandCursor
        elif self._space:
            shape = Qt.CursorShape.OpenHandCursor
        else:
            shape = self.tool.cursor_at(self._place or QPointF())
        if shape != self._canvas.cursor().shape():
            self._canvas.setCursor(shape)

    def _pans(self, event: QMouseEvent) -> bool:
        return self._name == "pan" and event.button() == Qt.MouseButton.LeftButton

    def _pointer(self, place: QPointF, event: QMouseEvent) -> Pointer:
        x, y = self._desk.on_sketch(place)
        return Pointer(
            x,
            y,
            erases=bool((event.buttons() | event.button()) & Qt.MouseButton.RightButton),
            picks=bool(event.modifiers() & Qt.KeyboardModifier.AltModifier),
            adds=bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier),
        )

    def _on_tool(self, name: str) -> None:
        self.tool.finish()
        self.tool.leave()
        self._name = name
        self._on_brush()
        self.show_cursor()
        self._canvas.update()

    def follow_sheet(self) -> None:
        """Keep the brush's ring under the mouse when the sheet moves."""
        if isinstance(self.tool, BrushTool):
            self.tool.show_size(self._place)

    def _on_brush(self) -> None:
        if isinstance(self.tool, BrushTool):
            self.tool.show_size(self._place)
        elif self._name == "line":
            self._desk.tells.redraw()

    def _tell_place(self) -> None:
        if self._place is None:
            return
        x, y = self._desk.on_sketch(self._place)
        sketch, relief = self._desk.document.sketch, self._desk.link.relief
        if not (0.0 <= x < sketch.width_px and 0.0 <= y < sketch.height_px):
            self._canvas.hovered.emit(None)
            return
        height = None
        if relief is not None:
            row, column = int(y // relief.step), int(x // relief.step)
            if row < relief.height.shape[0] and column < relief.height.shape[1]:
                height = float(relief.height[row, column])
        self._canvas.hovered.emit((*self._desk.metres(x, y), height))


_STEP = 64.0  # logical px that an arrow key moves the sheet
_BRUSH = 1.2
_ZOOM = 1.25
_MOVES = {
    Qt.Key.Key_Left: (1, 0),
    Qt.Key.Key_Right: (-1, 0),
    Qt.Key.Key_Up: (0, 1),
    Qt.Key.Key_Down: (0, -1),
}
_BRUSHES = {Qt.Key.Key_BracketLeft: 1.0 / _BRUSH, Qt.Key.Key_BracketRight: _BRUSH}
_ZOOMS = {Qt.Key.Key_Plus: _ZOOM, Qt.Key.Key_Equal: _ZOOM, Qt.Key.Key_Minus: 1.0 / _ZOOM}


class Keys:
    """Does what keys mean on the canvas."""

    def __init__(self, context: ToolContext, hands: CanvasInput, canvas: Canvas) -> None:
        self._desk = context
        self._hands = hands
        self._canvas = canvas

    def wants(self, event: QKeyEvent) -> bool:
        """Whether a key means something here, so that no shortcut of the window has it."""
        if event.modifiers() & (Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier):
            return False
        key = event.key()
        own = (*_MOVES, *_BRUSHES, *_ZOOMS, Qt.Key.Key_Space, Qt.Key.Key_Home)
        return key in own or self._hands.tool.takes(key)

    def press(self, event: QKeyEvent) -> bool:
        """Do what a key means; return whether it means anything."""
        if not self.wants(event):
            return False
        key = event.key()
        if self._hands.tool.key(key):
            return True
        if key == Qt.Key.Key_Space:
            if not event.isAutoRepeat():
                self._hands.hold_space(True)
        elif key == Qt.Key.Key_Home:
            self._canvas.fit()
        elif key in _MOVES:
            right, down = _MOVES[Qt.Key(key)]
            self._canvas.scroll_by(right * _STEP, down * _STEP)
        elif key in _BRUSHES:
            self._desk.workspace.brush *= _BRUSHES[Qt.Key(key)]
        else:
            self._canvas.zoom(_ZOOMS[Qt.Key(key)], QPointF(self._canvas.rect().center()))
        return True

    def release(self, event: QKeyEvent) -> bool:
        """Let go of the space bar; return whether that is what was let go."""
        if event.key() != Qt.Key.Key_Space:
            return False
        if not event.isAutoRepeat():
            self._hands.hold_space(False)
        return True
