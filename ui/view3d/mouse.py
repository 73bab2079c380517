"""Mouse input of the 3-D view: it moves the camera, selects features and drags their handles."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from PyQt6.QtCore import QObject, QPointF, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QMouseEvent, QWheelEvent
from PyQt6.QtWidgets import QWidget

from sketchterrain.placement.feature_types import FEATURE_TYPES
from sketchterrain.ui.commands.placed_edits import exists
from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.engine.protocol import GoTo, PickResult, Placement
from sketchterrain.ui.menus import ContextMenu, add_selection_commands
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import FeatureDrag, Handle, add, handles_of, select_at
from sketchterrain.ui.models.workspace import Selection, Workspace
from sketchterrain.ui.view3d.marks import Grip, Marks
from sketchterrain.ui.view3d.navigation import dragged, zoomed
from sketchterrain.ui.view3d.projection import Projection
from sketchterrain.ui.view3d.scene import Scene


class Picks(QObject):
    """Asks the engine, and hands each answer to whom it is for."""

    def __init__(self, link: ViewSource, parent: QObject) -> None:
        super().__init__(parent)
        self._link = link
        self._waiting: dict[str, tuple[int, Callable[[tuple[float, float, float] | None], None]]] = {}
        link.picked.connect(self._take)

    def ask(
        self, kind: str, x: float, y: float, then: Callable[[tuple[float, float, float] | None], None]
    ) -> None:
        """Ask for a place of the picture (shares); an older question of that kind is forgotten."""
        self._waiting[kind] = self._link.pick(x, y), then

    def waits(self, kind: str) -> bool:
        """Whether a question of a kind is not answered yet."""
        return kind in self._waiting

    def forget(self) -> None:
        """Wait for no answer any more."""
        self._waiting.clear()

    def _take(self, picked: PickResult) -> None:
        for kind, (token, then) in tuple(self._waiting.items()):
            if token == picked.token:
                del self._waiting[kind]
                then(picked.place)


_ALONG = (
    Qt.CursorShape.SizeHorCursor,
    Qt.CursorShape.SizeFDiagCursor,
    Qt.CursorShape.SizeVerCursor,
    Qt.CursorShape.SizeBDiagCursor,
)


def grip_cursor(grip: Grip) -> Qt.CursorShape:
    """Return the cursor over a handle: all ways, or along the way in which it is drawn out."""
    if grip.handle.role in ("move", "point"):
        return Qt.CursorShape.SizeAllCursor
    angle = math.degrees(math.atan2(grip.y - grip.base_y, grip.x - grip.base_x))
    return _ALONG[round(angle / 45.0) % 4]


_FARTHEST = 3.0  # extents from the sketch's middle


class GripDrag:
    """Drags a handle by lines of sight.

    It moves on the level plane of the place where it was taken, not on the ground that is seen: that ground
    is what it changes, and a mountain would come nearer the more it is dragged.
    """

    def __init__(
        self, document: Document, placed: Placement, grip: Grip, projection: Projection, x: float, y: float
    ) -> None:
        self._level = grip.z
        self._middle = (0.5 * document.sketch.size[0], 0.5 * document.sketch.size[1])
        self._reach = _FARTHEST * document.sketch.extent
        self._grab = (x, y)
        self._moved = False
        start = projection.on_level(x, y, grip.z)
        self._drag = FeatureDrag(document, placed, grip.handle, grab=start)

    @property
    def now(self) -> tuple[Handle, float, float]:
        """The handle, and where it is (m)."""
        return self._drag.handle, self._drag.x, self._drag.y

    @property
    def problem(self) -> str:
        """Why the last motion changed nothing."""
        return self._drag.problem

    def to(self, projection: Projection, x: float, y: float) -> None:
        """Drag it on, to a place (px) of a picture; over the horizon it stays where it was."""
        if not self._moved and max(abs(x - self._grab[0]), abs(y - self._grab[1])) < 2.0:
            return
        self._moved = True
        place = projection.on_level(x, y, self._level)
        if place is None:
            return
        if max(abs(place[0] - self._middle[0]), abs(place[1] - self._middle[1])) <= self._reach:
            self._drag.to(*place)

    def finish(self) -> None:
        """Let go."""
        self._drag.finish()

    def cancel(self) -> None:
        """Let go and leave everything as it was."""
        self._drag.cancel()


def feature_menu(
    parent: QWidget,
    document: Document,
    workspace: Workspace,
    placed: Placement,
    *,
    selection: Selection | None,
    place: tuple[float, float] | None,
) -> ContextMenu:
    """Return the menu of a place."""
    menu = ContextMenu(parent)
    if selection is not None and exists(placed, selection):
        add_selection_commands(menu, document, workspace, placed, selection)
    if place is not None:
        menu.addSeparator()
        x, y = place
        for kind in FEATURE_TYPES:
            menu.add_command("add", f"Add {kind} here", partial(add, document, workspace, kind, x, y))
    return menu


_CLICK = 4.0  # px that the mouse may move in a click
_REACH = 11.0  # px from a handle or a mark
_ASKED = 120  # ms between questions for the ground under the mouse
_LINGERS = 1500  # ms that a handle is shown where it was left, until what was placed has come there too
_THERE = 0.5  # m; a handle that was placed so near has come there
_Button = Qt.MouseButton

Place = tuple[float, float, float]


class Mouse(QObject):
    """Follows the mouse over a view."""

    ground = pyqtSignal(object)
    """The ground under the mouse: (x, y, height) in m, or None."""
    message = pyqtSignal(str)

    def __init__(
        self,
        view: QWidget,
        scene: Scene,
        document: Document | None,
        workspace: Workspace,
        link: ViewSource,
    ) -> None:
        super().__init__(view)
        self._view, self._scene = view, scene
        self._document, self._workspace, self._link = document, workspace, link
        self._picks = Picks(link, self)
        self._drag: GripDrag | None = None
        self._start: QPointF | None = None
        self._last = QPointF()
        self._travels = self._doubled = False
        self.hovered: Handle | Selection | None = None
        self._asks = QTimer(self)
        self._asks.setSingleShot(True)
        self._asks.setInterval(_ASKED)
        self._asks.timeout.connect(self._ask_for_ground)
        self._lingers = QTimer(self)
        self._lingers.setSingleShot(True)
        self._lingers.setInterval(_LINGERS)
        self._lingers.timeout.connect(self._forget_drag)
        link.placed_changed.connect(self._come_there)
        workspace.selection_changed.connect(self._other_chosen)

    @property
    def drags(self) -> bool:
        """Whether a handle is being dragged."""
        return self._drag is not None

    @property
    def is_pressed(self) -> bool:
        """Whether a button is held."""
        return self._start is not None

    def press(self, event: QMouseEvent) -> None:
        """Take hold: of a handle, or of the ground."""
        at = event.position()
        if self._start is not None:
            return  # another button: what the first one began goes on
        self._start = self._last = at
        self._travels = self._doubled = False
        plain = event.modifiers() == Qt.KeyboardModifier.NoModifier
        projection, placed, document = self._projection(), self._link.placed, self._document
        grip = self._marks().grip_at(at.x(), at.y(), reach=_REACH)
        if event.button() == _Button.LeftButton and plain and grip and projection and placed and document:
            self._forget_drag()
            self._drag = GripDrag(document, placed, grip, projection, at.x(), at.y())
            self._workspace.selection = grip.handle.selection
            self._scene.dragged = self._drag.now

    def move(self, event: QMouseEvent) -> None:
        """Go on: drag the handle, move the eye, or see what is under the mouse."""
        at = event.position()
        if self._start is None:
            self._hover(at)
        elif self._drag is not None:
            projection = self._projection()
            if projection is not None:
                self._drag.to(projection, at.x(), at.y())
                self._scene.dragged = self._drag.now
                if self._drag.problem:
                    self.message.emit(self._drag.problem)
                self._view.update()
        else:
            self._travel(at, event)

    def release(self, event: QMouseEvent) -> None:
        """Let go; where nothing was moved it was a click."""
        if self._start is None or event.buttons() != _Button.NoButton:
            return
        at, self._start = event.position(), None
        if self._drag is not None:
            self._drag.finish()
            self._drag = None
            self._lingers.start()
            self._come_there()
        elif not self._travels and not self._doubled:
            if event.button() == _Button.LeftButton:
                self._select(at)
            elif event.button() == _Button.RightButton:
                self._ask("menu", at, lambda place: self.open_menu(at, place))
        self._hover(at)

    def double(self, event: QMouseEvent) -> None:
        """Bring the ground under the mouse into the middle."""
        if event.button() != _Button.LeftButton:
            return
        self._start = self._last = event.position()
        self._travels, self._doubled = False, True
        self._ask("go", event.position(), self._go_to)

    def wheel(self, event: QWheelEvent) -> None:
        """Zoom about the mouse."""
        notches = event.angleDelta().y() / 120.0
        projection = self._projection()
        if notches and projection is not None:
            at = event.position()
            self._link.send(zoomed(notches, *projection.share(at.x(), at.y())))

    def cancel(self) -> bool:
        """Cancel the drag of a handle; return whether there was one."""
        if self._drag is None:
            return False
        self._drag.cancel()
        self._drag, self._start = None, None
        self._forget_drag()
        return True

    def leave(self) -> None:
        """Take note that the mouse is elsewhere, or the view hidden."""
        self._asks.stop()
        self._set_hovered(None)
        self.ground.emit(None)

    def forget(self) -> None:
        """Wait for no answer any more: the engine ended."""
        self._picks.forget()

    def open_menu(self, at: QPointF, place: Place | None) -> None:
        """Open the menu of a place of the view (px) where ground (m) is seen, or of what is selected."""
        placed = self._link.placed
        if placed is None or self._document is None:
            return
        selection = self._workspace.selection if place is None else self._found(place)
        if place is not None:
            self._workspace.selection = selection
        menu = feature_menu(
            self._view,
            self._document,
            self._workspace,
            placed,
            selection=selection,
            place=None if place is None else place[:2],
        )
        if menu.isEmpty():
            menu.close()
        else:
            menu.popup(self._view.mapToGlobal(at.toPoint()))

    def _travel(self, at: QPointF, event: QMouseEvent) -> None:
        """Move the eye by what the mouse moved."""
        start = self._start
        if not self._travels and start is not None:
            way = at - start
            if max(abs(way.x()), abs(way.y())) < _CLICK:
                return
            self._travels = True
            self._view.setCursor(Qt.CursorShape.ClosedHandCursor)
        way, self._last = at - self._last, at
        shift = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        turns = event.buttons() == _Button.LeftButton and not shift
        height = max(self._view.height(), 1)
        motion = dragged(self._link.view.mode, way.x(), way.y(), height=height, pans=not turns)
        self._link.send(motion)

    def _hover(self, at: QPointF) -> None:
        marks = self._marks()
        grip = marks.grip_at(at.x(), at.y(), reach=_REACH)
        dot = None if grip is not None else marks.dot_at(at.x(), at.y(), reach=_REACH)
        if grip is not None:
            self._view.setCursor(grip_cursor(grip))
        elif dot is not None:
            self._view.setCursor(Qt.CursorShape.PointingHandCursor)
        else:
            self._view.unsetCursor()
        self._set_hovered(grip.handle if grip is not None else dot.selection if dot is not None else None)
        if not self._asks.isActive():
            self._asks.start()

    def _set_hovered(self, hovered: Handle | Selection | None) -> None:
        if hovered != self.hovered:
            self.hovered = hovered
            self._view.update()

    def _ask_for_ground(self) -> None:
        at = self._view.mapFromGlobal(self._view.cursor().pos()).toPointF()
        if self._start is None and self._view.underMouse() and not self._picks.waits("hover"):
            self._ask("hover", at, self.ground.emit)

    def _select(self, at: QPointF) -> None:
        dot = self._marks().dot_at(at.x(), at.y(), reach=_REACH)
        if dot is not None:
            self._workspace.selection = dot.selection
        else:
            self._ask("select", at, self._select_at)

    def _select_at(self, place: Place | None) -> None:
        self._workspace.selection = None if place is None else self._found(place)

    def _found(self, place: Place) -> Selection | None:
        projection, placed = self._projection(), self._link.placed
        if projection is None or placed is None:
            return None
        return select_at(placed, place[0], place[1], reach=_REACH * projection.metres_per_px(place))

    def _go_to(self, place: Place | None) -> None:
        if place is not None:
            self._link.send(GoTo(place[0], place[1]))

    def _ask(self, kind: str, at: QPointF, then: Callable[[Place | None], None]) -> None:
        projection = self._projection()
        if projection is not None:
            self._picks.ask(kind, *projection.share(at.x(), at.y()), then)

    def _come_there(self, *_: object) -> None:
        """Show a handle where it was placed again, as soon as that is where it was left."""
        dragged, placed = self._scene.dragged, self._link.placed
        if self._drag is not None or dragged is None or placed is None:
            return
        handle, x, y = dragged
        for each in handles_of(placed, handle.selection):
            same = (each.role, each.selection) == (handle.role, handle.selection)
            if same and max(abs(each.x - x), abs(each.y - y)) < _THERE:
                self._forget_drag()
                return

    def _other_chosen(self, *_: object) -> None:
        if self._drag is None:
            self._forget_drag()

    def _forget_drag(self) -> None:
        self._lingers.stop()
        if self._scene.dragged is not None:
            self._scene.dragged = None
            self._view.update()

    def _projection(self) -> Projection | None:
        return self._scene.projection(self._view.width(), self._view.height())

    def _marks(self) -> Marks:
        return self._scene.marks(self._view.width(), self._view.height())
