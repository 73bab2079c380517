"""The 3-D view: pictures of the terrain with marks over them, mouse and keyboard input."""

from collections.abc import Callable
from typing import Final

from PyQt6.QtCore import QPointF, QRectF, QSize, Qt
from PyQt6.QtGui import QFocusEvent, QHideEvent, QKeyEvent, QPainter, QPaintEvent, QResizeEvent, QShowEvent
from PyQt6.QtWidgets import QSizePolicy, QWidget

from sketchterrain.ui.actions import ShortcutOverride
from sketchterrain.ui.commands import reported
from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.engine.protocol import MODES, ErrorReport, Fly, Look
from sketchterrain.ui.look.theme import active_theme, draw_focus
from sketchterrain.ui.models.background import single_shot
from sketchterrain.ui.models.document import Document
from sketchterrain.ui.models.features import SelectedFeature
from sketchterrain.ui.models.selection import delete_or_reset
from sketchterrain.ui.models.workspace import Workspace
from sketchterrain.ui.view3d.camera import FLYING_KEYS, flight, motion_to, overview
from sketchterrain.ui.view3d.hud import Hud
from sketchterrain.ui.view3d.mouse import ViewMouse
from sketchterrain.ui.view3d.scene import Scene

_RESIZE_DELAY: Final = 120  # ms
_MIN_SIDE: Final = 16  # px of a picture

_Key = Qt.Key
_Modifier = Qt.KeyboardModifier
_MODE_KEYS: Final = dict(zip((_Key.Key_1, _Key.Key_2, _Key.Key_3), MODES, strict=True))
_OTHERS: Final = _Modifier.ControlModifier | _Modifier.AltModifier | _Modifier.MetaModifier


class View3D(QWidget):
    """Shows the terrain of a document; a stored world has an empty one, where nothing can be selected."""

    def __init__(self, document: Document, workspace: Workspace, link: ViewSource) -> None:
        super().__init__()
        self._document, self._workspace, self._link = document, workspace, link
        self._scene = Scene(document, workspace, link)
        self._mouse = ViewMouse(self, self._scene)
        self._keys: set[int] = set()  # that fly and are held down, and Shift
        self._motion = Fly()
        self._hud = Hud(self, link)
        self._ratio = self.devicePixelRatioF()
        self._size_timer = single_shot(self, _RESIZE_DELAY, self._request_size)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.PreventContextMenu)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self.setAccessibleName("3-D view")
        self.setAccessibleDescription("The terrain. Arrow keys move, F shows the selection, R all of it.")
        self._commands: dict[int, Callable[[], None]] = {
            Qt.Key.Key_F: self.see_selection,
            Qt.Key.Key_R: self.see_all,
            Qt.Key.Key_Home: self.see_all,
            Qt.Key.Key_C: self.see_best,
            Qt.Key.Key_Delete: self.delete_selection,
            Qt.Key.Key_Backspace: self.delete_selection,
            Qt.Key.Key_Menu: self._open_menu,
        }
        ShortcutOverride(self, self._takes_key)
        link.error_reported.connect(self._handle_error)
        for signal in (
            *(document.sketch_changed, document.drapes.changed),
            *(link.placed_changed, link.relief_changed, active_theme.changed),
            *(workspace.selection_changed, workspace.overlays_changed, workspace.tool_changed),
        ):
            signal.connect(self._refresh)
        self.hovered = self._mouse.terrain_hovered
        self.bar = self._hud.bar
        self.picture_requested = self.bar.picture_requested
        self.bar.see_all.connect(self.see_all)
        self.bar.see_best.connect(self.see_best)

    def sizeHint(self) -> QSize:
        return QSize(640, 480)

    def see_all(self) -> None:
        """View everything from the south."""
        area, terrain = self._link.area(), self._scene.terrain()
        if area is None:
            return
        (west, south, east, north), height = area
        if terrain is not None:
            height = float(terrain.height(0.5 * (west + east), 0.5 * (south + north)))
        aspect = max(self.width(), 1) / max(self.height(), 1)
        self._link.send(Look(overview((west, south, east, north), height, aspect=aspect)))

    def see_best(self) -> None:
        self._link.send(Look(None))

    def see_selection(self) -> None:
        area, selection = self._link.area(), self._workspace.selection
        own = SelectedFeature.find(self._document, selection)
        lines = [] if own is None else own.lines()
        motion = None if area is None else motion_to(self._link.placed, selection, lines, size=area[0][2:])
        if motion is None:
            self.see_all()
        else:
            self._link.send(motion)

    def delete_selection(self) -> None:
        """Delete the selection, of a vector its active vertex; a river's control point is reset instead."""
        placed, selection = self._link.placed, self._workspace.selection
        if selection is not None:
            report = self._document.message.emit
            with reported(report):
                report(delete_or_reset(self._document, self._workspace, placed, selection))

    def _open_menu(self) -> None:
        self._mouse.open_menu(QPointF(self.rect().center()), None)

    def _handle_error(self, error: ErrorReport) -> None:
        if error.source == "engine":
            self._mouse.forget_picks()

    def _refresh(self, *_: object) -> None:
        self.update()

    def _request_size(self) -> None:
        if self.isVisible():
            self._ratio = ratio = self.devicePixelRatioF()
            width, height = (max(round(side * ratio), _MIN_SIDE) for side in (self.width(), self.height()))
            self._link.change_view(width=width, height=height)

    def _takes_key(self, event: QKeyEvent) -> bool:
        """Return whether a key means something here, so that no shortcut of the window gets it."""
        if event.modifiers() & _OTHERS:
            return False
        if event.key() == _Key.Key_Escape:
            return self._mouse.is_dragging or self._workspace.selection is not None
        return event.key() in FLYING_KEYS or event.key() in _MODE_KEYS or event.key() in self._commands

    def _hold_keys(self, keys: set[int]) -> None:
        self._keys, motion = keys, flight(keys)
        if motion != self._motion:
            self._motion = motion
            self._link.send(motion)

    def keyPressEvent(self, event: QKeyEvent | None) -> None:
        if event is None:
            return
        key = event.key()
        if not self._takes_key(event):
            if key == _Key.Key_Shift:
                self._hold_keys(self._keys | {key})
            super().keyPressEvent(event)
        elif event.isAutoRepeat():
            return
        elif key in FLYING_KEYS:
            self._hold_keys(self._keys | {key})
        elif key in _MODE_KEYS:
            self._link.change_view(mode=_MODE_KEYS[_Key(key)])
        elif key in self._commands:
            self._commands[key]()
        elif not self._mouse.cancel():
            self._workspace.selection = None

    def keyReleaseEvent(self, event: QKeyEvent | None) -> None:
        if event is not None and not event.isAutoRepeat():
            self._hold_keys(self._keys - {event.key()})

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        self._size_timer.start(_RESIZE_DELAY)

    def showEvent(self, event: QShowEvent | None) -> None:
        self._size_timer.start(0)

    def hideEvent(self, event: QHideEvent | None) -> None:
        self._mouse.cancel()
        self._mouse.leave()
        self._hold_keys(set())
        self._size_timer.stop()
        self._link.change_view(width=0, height=0)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        if self.devicePixelRatioF() != self._ratio:  # on another screen
            self._ratio = self.devicePixelRatioF()
            self._size_timer.start(_RESIZE_DELAY)
        painter = QPainter(self)
        self._scene.paint(
            painter,
            QRectF(self.rect()),
            self.devicePixelRatioF(),
            dim=self._hud.placeholder.notice is not None,
            is_refining=self._hud.is_refining and not self._mouse.is_pressed,
        )
        draw_focus(painter, self)

    def focusOutEvent(self, event: QFocusEvent | None) -> None:
        self._hold_keys(set())
        self.update()
