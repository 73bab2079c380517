"""The 3-D view: finished pictures of the terrain, marks over them, mouse and keyboard."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

from PyQt6.QtCore import QEvent, QObject, QPointF, QRectF, QSize, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import (
    QFocusEvent,
    QHideEvent,
    QKeyEvent,
    QMouseEvent,
    QPainter,
    QPaintEvent,
    QResizeEvent,
    QShowEvent,
    QWheelEvent,
)
from PyQt6.QtWidgets import QSizePolicy, QWidget

from sketchterrain.ui.actions import ShortcutOverride
from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.engine.protocol import MODES, ErrorReport, Look
from sketchterrain.ui.look.theme import looks
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.selection import delete_or_reset
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.view3d.hud import Hud
from sketchterrain.ui.view3d.mouse import Mouse
from sketchterrain.ui.view3d.navigation import FLYING_KEYS, Keys, going_to, overview
from sketchterrain.ui.view3d.scene import Scene

_SETTLE: Final = 120
"""ms without another size until a picture of the new one is asked for."""
_LEAST: Final = 16  # px


class PictureSize(QObject):
    """Asks for pictures of a view's size."""

    def __init__(self, view: QWidget, link: ViewSource) -> None:
        super().__init__(view)
        self._view, self._link = view, link
        self._ratio = view.devicePixelRatioF()
        self._timer = QTimer(self)
        self._timer.setSingleShot(True)
        self._timer.timeout.connect(self._ask)

    def begin(self) -> None:
        """Ask for pictures: the view is shown."""
        self._timer.start(0)

    def change(self) -> None:
        """Ask for another picture a little later: the view has another size."""
        self._timer.start(_SETTLE)

    def compare_screen(self) -> None:
        """Ask for another picture if the view is on a screen of another resolution now."""
        if self._view.devicePixelRatioF() != self._ratio:
            self._ratio = self._view.devicePixelRatioF()
            self.change()

    def end(self) -> None:
        """Ask for none any more: the view is hidden."""
        self._timer.stop()
        self._link.set_view(replace(self._link.view, width=0, height=0))

    def _ask(self) -> None:
        if self._view.isVisible():
            self._ratio = ratio = self._view.devicePixelRatioF()
            sides = (self._view.width(), self._view.height())
            width, height = (max(round(side * ratio), _LEAST) for side in sides)
            self._link.set_view(replace(self._link.view, width=width, height=height))


_Key = Qt.Key
_Modifier = Qt.KeyboardModifier
_MODE_KEYS: Final = dict(zip((_Key.Key_1, _Key.Key_2, _Key.Key_3), MODES, strict=True))
_OTHERS: Final = _Modifier.ControlModifier | _Modifier.AltModifier | _Modifier.MetaModifier


class Keyboard:
    """Follows keys."""

    def __init__(
        self,
        view: QWidget,
        link: ViewSource,
        workspace: Workspace,
        mouse: Mouse,
        commands: Mapping[int, Callable[[], None]],
    ) -> None:
        self._link, self._workspace, self._mouse = link, workspace, mouse
        self._commands = commands
        self._keys = Keys()
        ShortcutOverride(view, self.is_own)

    def is_own(self, event: QKeyEvent) -> bool:
        """Whether a key is the view's now; others are the window's."""
        if event.modifiers() & _OTHERS:
            return False
        if event.key() == _Key.Key_Escape:
            return self._mouse.drags or self._workspace.selection is not None
        return event.key() in FLYING_KEYS or event.key() in _MODE_KEYS or event.key() in self._commands

    def press(self, event: QKeyEvent) -> bool:
        """Do what a key says; return whether it was the view's."""
        key = event.key()
        if not self.is_own(event):
            if key == _Key.Key_Shift:
                self._tell(self._keys.hurry(quick=True))
            return False
        if event.isAutoRepeat():
            return True
        if key in FLYING_KEYS:
            self._tell(self._keys.press(key))
        elif key in _MODE_KEYS:
            self._link.set_view(replace(self._link.view, mode=_MODE_KEYS[_Key(key)]))
        elif key in self._commands:
            self._commands[key]()
        elif not self._mouse.cancel():
            self._workspace.selection = None
        return True

    def release(self, event: QKeyEvent) -> None:
        """Let a key go."""
        if event.isAutoRepeat():
            return
        if event.key() == _Key.Key_Shift:
            self._tell(self._keys.hurry(quick=False))
        self._tell(self._keys.release(event.key()))

    def let_go(self) -> None:
        """Let all keys go: their release is seen elsewhere."""
        self._tell(self._keys.let_go())

    def _tell(self, motion: object | None) -> None:
        if motion is not None:
            self._link.send(motion)


class View3D(QWidget):
    """Shows the terrain of a document, or without one a stored world, in which nothing is selected."""

    hovered = pyqtSignal(object)
    """The ground under the mouse: (x, y, height) in m, or None."""
    message = pyqtSignal(str)
    """A line for the status bar."""
    picture_requested = pyqtSignal()
    """Its button for saving a picture was pressed."""

    def __init__(
        self,
        document: Document | None,
        workspace: Workspace,
        link: ViewSource,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self._document, self._workspace, self._link = document, workspace, link
        self._scene = Scene(document, workspace, link)
        self._mouse = Mouse(self, self._scene, document, workspace, link)
        self._by_key = False
        self._size, self._hud = PictureSize(self, link), Hud(self, link)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.PreventContextMenu)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self.setAccessibleName("3-D view")
        self.setAccessibleDescription("The terrain. Arrow keys move, F shows the selection, R all of it.")
        commands: dict[int, Callable[[], None]] = {
            Qt.Key.Key_F: self.see_selection,
            Qt.Key.Key_R: self.see_all,
            Qt.Key.Key_Home: self.see_all,
            Qt.Key.Key_C: self.see_best,
            Qt.Key.Key_Delete: self.delete_selection,
            Qt.Key.Key_Backspace: self.delete_selection,
            Qt.Key.Key_Menu: self._open_menu,
        }
        self._keyboard = Keyboard(self, link, workspace, self._mouse, commands)
        self._connect()

    def _connect(self) -> None:
        link, workspace = self._link, self._workspace
        link.facts_changed.connect(self._hud.show_card)
        link.error_reported.connect(self._take_trouble)
        for signal in (
            link.placed_changed,
            link.relief_changed,
            workspace.selection_changed,
            workspace.overlays_changed,
            workspace.tool_changed,
            looks.changed,
        ):
            signal.connect(self._refresh)
        self._mouse.ground.connect(self.hovered)
        self._mouse.message.connect(self.message)
        bar = self._hud.bar
        bar.see_all.connect(self.see_all)
        bar.see_best.connect(self.see_best)
        bar.picture_requested.connect(self.picture_requested)

    @property
    def bar(self) -> QWidget:
        """Buttons in its upper left corner."""
        return self._hud.bar

    def sizeHint(self) -> QSize:
        """Return a size to begin with."""
        return QSize(640, 480)

    def see_all(self) -> None:
        """Look at all of it from the south."""
        area, ground = self._link.area(), self._scene.ground()
        if area is None:
            return
        (west, south, east, north), height = area
        if ground is not None:
            height = float(ground.height(0.5 * (west + east), 0.5 * (south + north)))
        aspect = max(self.width(), 1) / max(self.height(), 1)
        self._link.send(Look(overview((west, south, east, north), height, aspect=aspect)))

    def see_best(self) -> None:
        """Stand where the terrain looks best."""
        self._link.send(Look(None))

    def see_selection(self) -> None:
        """Look at what is selected, or at the whole sketch."""
        area = self._link.area()
        motion = (
            None if area is None else going_to(self._link.placed, self._workspace.selection, size=area[0][2:])
        )
        if motion is None:
            self.see_all()
        else:
            self._link.send(motion)

    def delete_selection(self) -> None:
        """Delete what is selected; a control point of a river goes back to where it was generated."""
        placed, selection = self._link.placed, self._workspace.selection
        if self._document is not None and placed is not None and selection is not None:
            self.message.emit(delete_or_reset(self._document, self._workspace, placed, selection))

    def _open_menu(self) -> None:
        self._mouse.open_menu(QPointF(self.rect().center()), None)

    def _take_trouble(self, trouble: ErrorReport) -> None:
        if trouble.source == "engine":
            self._mouse.forget()

    def _refresh(self, *_: object) -> None:
        self.update()

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Put what lies over the picture in its places; ask for another picture a little later."""
        self._hud.place()
        self._size.change()

    def showEvent(self, event: QShowEvent | None) -> None:
        """Ask for pictures."""
        self._size.begin()

    def hideEvent(self, event: QHideEvent | None) -> None:
        """Ask for none any more."""
        self._mouse.cancel()
        self._mouse.leave()
        self._keyboard.let_go()
        self._size.end()

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the last picture and what lies over it."""
        self._size.compare_screen()
        painter = QPainter(self)
        self._scene.paint(
            painter,
            QRectF(self.rect()),
            self.devicePixelRatioF(),
            hovered=self._mouse.hovered,
            dim=self._hud.card.notice is not None,
            refines=self._hud.refines and not self._mouse.is_pressed,
        )
        if self._by_key and self.hasFocus():
            self._scene.paint_focus(painter, QRectF(self.rect()))

    def mousePressEvent(self, event: QMouseEvent | None) -> None:
        """See `Mouse`."""
        if event is not None:
            self._mouse.press(event)

    def mouseMoveEvent(self, event: QMouseEvent | None) -> None:
        """See `Mouse`."""
        if event is not None:
            self._mouse.move(event)

    def mouseReleaseEvent(self, event: QMouseEvent | None) -> None:
        """See `Mouse`."""
        if event is not None:
            self._mouse.release(event)

    def mouseDoubleClickEvent(self, event: QMouseEvent | None) -> None:
        """See `Mouse`."""
        if event is not None:
            self._mouse.double(event)

    def wheelEvent(self, event: QWheelEvent | None) -> None:
        """See `Mouse`."""
        if event is not None:
            self._mouse.wheel(event)

    def leaveEvent(self, event: QEvent | None) -> None:
        """Nothing is under the mouse any more."""
        self._mouse.leave()

    def keyPressEvent(self, event: QKeyEvent | None) -> None:
        """See `Keyboard`."""
        if event is not None and not self._keyboard.press(event):
            super().keyPressEvent(event)

    def keyReleaseEvent(self, event: QKeyEvent | None) -> None:
        """See `Keyboard`."""
        if event is not None:
            self._keyboard.release(event)

    def focusInEvent(self, event: QFocusEvent | None) -> None:
        """Show that keys come here, to one who came by a key."""
        by_key = (Qt.FocusReason.TabFocusReason, Qt.FocusReason.BacktabFocusReason)
        self._by_key = event is not None and event.reason() in by_key
        self.update()

    def focusOutEvent(self, event: QFocusEvent | None) -> None:
        """Let all keys go."""
        self._keyboard.let_go()
        self.update()
