"""Mouse input of the 3-D view: camera motion, selection, handles and the context menu."""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from PyQt6.QtCore import QEvent, QObject, QPointF, Qt, pyqtSignal
from PyQt6.QtGui import QMouseEvent, QWheelEvent
from PyQt6.QtWidgets import QWidget

from sketchterrain.ui.actions import selection_menu
from sketchterrain.ui.commands import reported
from sketchterrain.ui.engine.link import NOT_PLACED
from sketchterrain.ui.engine.protocol import GoTo, PickResult, Placement
from sketchterrain.ui.models.background import single_shot
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import drag_refusal, insert_vertex
from sketchterrain.ui.models.selection import (
    REACH,
    FeatureDrag,
    handles_of,
    kept,
    next_below,
    selections_at,
)
from sketchterrain.ui.models.workspace import Handle, Selection
from sketchterrain.ui.view3d.camera import Projection, drag_motion, zoom_motion
from sketchterrain.ui.view3d.marks import HandleMark, Marks
from sketchterrain.ui.view3d.scene import Scene

Place = tuple[float, float, float]
_Button = Qt.MouseButton

_CLICK = 4.0  # px that the mouse may move during a click
_PICK_INTERVAL = 120  # ms between picks of the terrain under the mouse
_MAX_DRAG = 3.0  # extents from the sketch's centre
_PLACEMENT_TIMEOUT = 1500  # ms that a dropped handle waits for its placement
_PLACED = 0.5  # m; a placement this near confirms a dropped handle
_CURSORS = (
    Qt.CursorShape.SizeHorCursor,
    Qt.CursorShape.SizeFDiagCursor,
    Qt.CursorShape.SizeVerCursor,
    Qt.CursorShape.SizeBDiagCursor,
)


def handle_cursor(mark: HandleMark) -> Qt.CursorShape:
    """Return the cursor over a handle: for all directions or along that of a radius or width."""
    if mark.handle.role in ("move", "point"):
        return Qt.CursorShape.SizeAllCursor
    angle = math.degrees(math.atan2(mark.y - mark.base_y, mark.x - mark.base_x))
    return _CURSORS[round(angle / 45.0) % 4]


class HandleDrag(FeatureDrag):
    """Drags a handle by rays on the level plane where it was pressed.

    Not on the visible terrain, which the drag changes: a mountain would come nearer with every motion.
    """

    def __init__(
        self, document: Document, placed: Placement, mark: HandleMark, projection: Projection, start: QPointF
    ) -> None:
        grab = projection.intersect_level(start.x(), start.y(), mark.z)
        reach = REACH * projection.metres_per_px((mark.handle.x, mark.handle.y, mark.z))
        super().__init__(document, placed, mark.handle, grab=grab, reach=reach)
        self._level, self._start = mark.z, start
        self._centre = (0.5 * document.sketch.size[0], 0.5 * document.sketch.size[1])
        self._limit = _MAX_DRAG * document.sketch.extent
        self._is_moved = False

    def move(self, projection: Projection, at: QPointF) -> None:
        """Drag to a pixel; above the horizon nothing changes."""
        offset = at - self._start
        if not self._is_moved and max(abs(offset.x()), abs(offset.y())) < 2.0:
            return
        self._is_moved = True
        place = projection.intersect_level(at.x(), at.y(), self._level)
        if place is None:
            return
        if max(abs(place[0] - self._centre[0]), abs(place[1] - self._centre[1])) <= self._limit:
            self.to(*place)


class ViewMouse(QObject):
    """Event filter of a view that handles the mouse."""

    terrain_hovered = pyqtSignal(object)  # the terrain under the mouse: (x, y, height) in m, or None

    def __init__(self, view: QWidget, scene: Scene) -> None:
        super().__init__(view)
        self._view, self._scene = view, scene
        self._document, self._workspace, self._link = scene.document, scene.workspace, scene.link
        self._picks: dict[str, tuple[int, Callable[[Place | None], None]]] = {}  # pending, by purpose
        self._drag: HandleDrag | None = None
        self._start: QPointF | None = None
        self._last = QPointF()
        self._is_moved = self._is_double = False
        self._pick_timer = single_shot(self, _PICK_INTERVAL, self._pick_hovered)
        self._drop_timer = single_shot(self, _PLACEMENT_TIMEOUT, self._forget_drag)
        self._handlers: dict[QEvent.Type, Callable[[Any], None]] = {
            QEvent.Type.MouseButtonPress: self._press,
            QEvent.Type.MouseMove: self._move,
            QEvent.Type.MouseButtonRelease: self._release,
            QEvent.Type.MouseButtonDblClick: self._double_click,
            QEvent.Type.Wheel: self._wheel,
        }
        view.installEventFilter(self)
        scene.link.picked.connect(self._answer)
        scene.link.placed_changed.connect(self._confirm_drop)
        scene.workspace.selection_changed.connect(self._change_selection)

    @property
    def is_dragging(self) -> bool:
        return self._drag is not None

    @property
    def is_pressed(self) -> bool:
        return self._start is not None

    def eventFilter(self, watched: QObject | None, event: QEvent | None) -> bool:
        handler = None if event is None else self._handlers.get(event.type())
        if handler is not None:
            handler(event)
        elif event is not None and event.type() == QEvent.Type.Leave:
            self.leave()
        return handler is not None

    def cancel(self) -> bool:
        """Cancel the drag of a handle; return whether there was one."""
        if self._drag is None:
            return False
        self._drag.cancel()
        self._drag, self._start = None, None
        self._forget_drag()
        return True

    def leave(self) -> None:
        """Stop hovering: the mouse has left, or the view is hidden."""
        self._pick_timer.stop()
        self._set_hovered(None)
        self.terrain_hovered.emit(None)

    def forget_picks(self) -> None:
        """Drop pending picks, as when the engine ended."""
        self._picks.clear()

    def open_menu(self, at: QPointF, place: Place | None, *, vertex: Selection | None = None) -> None:
        """Open the menu of a pixel and its place (m) or vertex, or of the selection without a place."""
        placed, document, workspace = self._link.placed, self._document, self._workspace
        if placed is NOT_PLACED:
            return
        if place is not None:
            workspace.selection = vertex or kept(self._stack(place), workspace.selection)
        menu = selection_menu(self._view, document, workspace, placed, place and place[:2])
        if menu.isEmpty():
            menu.close()
        else:
            menu.popup(self._view.mapToGlobal(at.toPoint()))

    def _press(self, event: QMouseEvent) -> None:
        at = event.position()
        if self._start is not None:
            return  # another button: the first one's action continues
        self._start = self._last = at
        self._is_moved = self._is_double = False
        plain = event.modifiers() == Qt.KeyboardModifier.NoModifier
        projection, document = self._projection(), self._document
        mark = self._marks().handle_at(at.x(), at.y(), reach=REACH)
        if event.button() == _Button.LeftButton and plain and mark and projection:
            self._forget_drag()
            handle = mark.handle
            if refusal := drag_refusal(document, self._workspace, handle):
                self._document.message.emit(refusal)
                return
            self._drag = HandleDrag(document, self._link.placed, mark, projection, at)
            self._workspace.selection = mark.handle.selection
            self._scene.drag = self._drag

    def _move(self, event: QMouseEvent) -> None:
        at = event.position()
        projection = self._projection()
        if self._start is None:
            self._hover(at)
        elif self._drag is None:
            self._move_camera(at, event)
        elif projection is not None:
            self._drag.move(projection, at)
            if self._drag.problem:
                self._document.message.emit(self._drag.problem)
            self._view.update()

    def _release(self, event: QMouseEvent) -> None:
        if self._start is None or event.buttons() != _Button.NoButton:
            return
        at, self._start = event.position(), None
        if self._drag is not None:
            self._drag.finish()
            if self._drag.problem:
                self._document.message.emit(self._drag.problem)
            self._drag = None
            self._drop_timer.start()
            self._confirm_drop()
        elif not self._is_moved and not self._is_double:
            if event.button() == _Button.LeftButton:
                self._select(at)
            elif event.button() == _Button.RightButton:
                mark = self._marks().handle_at(at.x(), at.y(), reach=REACH)
                vertex = mark.handle.selection if mark is not None and mark.handle.is_vertex else None
                self._pick("menu", at, partial(self.open_menu, at, vertex=vertex))
        self._hover(at)

    def _double_click(self, event: QMouseEvent) -> None:
        """Insert a vertex in the selected vector under the mouse, or centre the terrain there."""
        if event.button() == _Button.LeftButton:
            self._start = self._last = event.position()
            self._is_moved, self._is_double = False, True
            self._pick("go", event.position(), self._go_to)

    def _wheel(self, event: QWheelEvent) -> None:
        notches = event.angleDelta().y() / 120.0
        projection = self._projection()
        if notches and projection is not None:
            at = event.position()
            self._link.send(zoom_motion(notches, *projection.picture_fraction(at.x(), at.y())))

    def _move_camera(self, at: QPointF, event: QMouseEvent) -> None:
        start = self._start
        if not self._is_moved and start is not None:
            offset = at - start
            if max(abs(offset.x()), abs(offset.y())) < _CLICK:
                return
            self._is_moved = True
            self._view.setCursor(Qt.CursorShape.ClosedHandCursor)
        offset, self._last = at - self._last, at
        shift = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        turns = event.buttons() == _Button.LeftButton and not shift
        height = max(self._view.height(), 1)
        self._link.send(
            drag_motion(self._link.view.mode, offset.x(), offset.y(), height=height, pans=not turns)
        )

    def _hover(self, at: QPointF) -> None:
        marks = self._marks()
        mark = marks.handle_at(at.x(), at.y(), reach=REACH)
        dot = None if mark is not None else marks.dot_at(at.x(), at.y(), reach=REACH)
        if mark is not None:
            self._view.setCursor(handle_cursor(mark))
        elif dot is not None:
            self._view.setCursor(Qt.CursorShape.PointingHandCursor)
        else:
            self._view.unsetCursor()
        self._set_hovered(mark.handle if mark is not None else dot.selection if dot is not None else None)
        if not self._pick_timer.isActive():
            self._pick_timer.start()

    def _set_hovered(self, hovered: Handle | Selection | None) -> None:
        if hovered != self._scene.hovered:
            self._scene.hovered = hovered
            self._view.update()

    def _pick_hovered(self) -> None:
        at = self._view.mapFromGlobal(self._view.cursor().pos()).toPointF()
        if self._start is None and self._view.underMouse() and "hover" not in self._picks:
            self._pick("hover", at, self.terrain_hovered.emit)

    def _select(self, at: QPointF) -> None:
        dot = self._marks().dot_at(at.x(), at.y(), reach=REACH)
        if dot is not None:
            self._workspace.selection = dot.selection
        else:
            self._pick("select", at, self._select_at)

    def _select_at(self, place: Place | None) -> None:
        stack = [] if place is None else self._stack(place)
        self._workspace.selection = next_below(stack, self._workspace.selection)

    def _stack(self, place: Place) -> list[Selection]:
        projection = self._projection()
        if projection is None:
            return []
        texel = projection.metres_per_px(place)
        own = self._document, self._workspace, self._link.placed
        return selections_at(*own, *place[:2], texel, styled=False)

    def _go_to(self, place: Place | None) -> None:
        """Insert a vertex in the selected vector at a place (m) on it, else centre the place."""
        with reported(self._document.message.emit):
            if place is not None and not self._insert_vertex(place):
                self._link.send(GoTo(place[0], place[1]))

    def _insert_vertex(self, place: Place) -> bool:
        projection = self._projection()
        if projection is None:
            return False
        reach = REACH * projection.metres_per_px(place)
        return insert_vertex(self._document, self._workspace, *place[:2], reach=reach)

    def _pick(self, purpose: str, at: QPointF, then: Callable[[Place | None], None]) -> None:
        """Ask the engine for the terrain at a pixel; replaces a pending pick of the same purpose."""
        projection = self._projection()
        if projection is not None:
            token = self._link.pick(*projection.picture_fraction(at.x(), at.y()))
            self._picks[purpose] = token, then

    def _answer(self, picked: PickResult) -> None:
        for purpose, (token, then) in tuple(self._picks.items()):
            if token == picked.token:
                del self._picks[purpose]
                then(picked.place)

    def _confirm_drop(self, *_: object) -> None:
        """Forget a dropped handle as soon as it has been placed there."""
        drag = self._scene.drag
        if self._drag is not None or drag is None:
            return
        handle, x, y = drag.handle, drag.x, drag.y
        if not handle.selection.is_placed:  # it moves at once
            self._forget_drag()
            return
        for each in handles_of(self._link.placed, handle.selection):
            is_same = (each.role, each.selection) == (handle.role, handle.selection)
            if is_same and max(abs(each.x - x), abs(each.y - y)) < _PLACED:
                self._forget_drag()
                return

    def _change_selection(self, *_: object) -> None:
        if self._drag is None:
            self._forget_drag()

    def _forget_drag(self) -> None:
        self._drop_timer.stop()
        if self._scene.drag is not None:
            self._scene.drag = None
            self._view.update()

    def _projection(self) -> Projection | None:
        return self._scene.projection(self._view.width(), self._view.height())

    def _marks(self) -> Marks:
        return self._scene.marks(self._view.width(), self._view.height())
