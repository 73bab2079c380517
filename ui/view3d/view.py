"""The 3-D view: finished pictures of the terrain, and over them what one can take hold of."""

from __future__ import annotations

import time
from dataclasses import replace
from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QPointF, QRectF, QSize, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QPainter
from PyQt6.QtWidgets import QSizePolicy, QWidget

from sketchterrain.ui.engine.orders import Look, Turn
from sketchterrain.ui.look.theme import looks
from sketchterrain.ui.models.chosen_acts import delete_or_reset
from sketchterrain.ui.view3d.aim import going_to, overview
from sketchterrain.ui.view3d.bar import Bar
from sketchterrain.ui.view3d.card import Card, notice_of
from sketchterrain.ui.view3d.compass import Compass, heading_of
from sketchterrain.ui.view3d.keyboard import Keyboard
from sketchterrain.ui.view3d.mouse import Mouse
from sketchterrain.ui.view3d.scene import Scene

if TYPE_CHECKING:
    from collections.abc import Callable

    from PyQt6.QtCore import QEvent
    from PyQt6.QtGui import (
        QFocusEvent,
        QHideEvent,
        QKeyEvent,
        QMouseEvent,
        QPaintEvent,
        QResizeEvent,
        QShowEvent,
        QWheelEvent,
    )

    from sketchterrain.ui.engine.link import EngineLink
    from sketchterrain.ui.engine.messages import FrameFacts, Trouble
    from sketchterrain.ui.engine.orders import ViewState
    from sketchterrain.ui.models.document import Document
    from sketchterrain.ui.models.workspace import Workspace

__all__ = ["View3D"]

_SETTLE: Final = 120
"""ms without another size until a picture of the new one is asked for."""
_REFINES = 0.6  # s without a finished picture until that is said
_EDGE = 10  # px, around what lies over the picture


class View3D(QWidget):
    """Shows the terrain.

    Parameters
    ----------
    document, workspace, link
    parent
    """

    hovered = pyqtSignal(object)
    """The ground under the mouse: (x, y, height) in m, or None."""
    message = pyqtSignal(str)
    """A line for the status bar."""
    picture_wanted = pyqtSignal()
    """Its button for saving a picture was pressed."""

    def __init__(
        self, document: Document, workspace: Workspace, link: EngineLink, parent: QWidget | None = None
    ) -> None:
        super().__init__(parent)
        self._document, self._workspace, self._link = document, workspace, link
        self._scene = Scene(document, workspace, link)
        self._mouse = Mouse(self, self._scene, document, workspace, link)
        self._trouble: Trouble | None = None
        self._unsettled: float | None = None
        self._by_key = False
        self._ratio = self.devicePixelRatioF()
        self._bar, self._compass, self._card = Bar(self), Compass(self), Card(self)
        self._sizes = QTimer(self)
        self._sizes.setSingleShot(True)
        self._sizes.timeout.connect(self._ask_for_size)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.PreventContextMenu)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self.setAccessibleName("3-D view")
        self.setAccessibleDescription("The terrain. Arrow keys move, F shows the selection, R all of it.")
        commands: dict[int, Callable[[], None]] = {
            Qt.Key.Key_F: self.see_chosen,
            Qt.Key.Key_R: self.see_all,
            Qt.Key.Key_Home: self.see_all,
            Qt.Key.Key_C: self.see_best,
            Qt.Key.Key_Delete: self.delete_chosen,
            Qt.Key.Key_Backspace: self.delete_chosen,
            Qt.Key.Key_Menu: self._open_menu,
        }
        self._keyboard = Keyboard(self, link, workspace, self._mouse, commands)
        self._connect()
        self._show_card()

    def _connect(self) -> None:
        link, workspace = self._link, self._workspace
        link.frame_shown.connect(self._take_frame)
        link.trouble.connect(self._take_trouble)
        link.view_changed.connect(self._take_view)
        for signal in (link.facts_changed, link.working_changed):
            signal.connect(self._show_card)
        for signal in (
            link.placed_changed,
            link.relief_changed,
            workspace.chosen_changed,
            workspace.overlays_changed,
            workspace.tool_changed,
            looks.changed,
        ):
            signal.connect(self._refresh)
        self._mouse.ground.connect(self.hovered)
        self._mouse.message.connect(self.message)
        self._bar.mode_chosen.connect(self._use_mode)
        self._bar.see_all.connect(self.see_all)
        self._bar.see_best.connect(self.see_best)
        self._bar.picture_wanted.connect(self.picture_wanted)
        self._compass.clicked.connect(self._face_north)
        self._card.pressed.connect(self._start_again)
        self._take_view(link.view)

    def sizeHint(self) -> QSize:
        """Return a size to begin with."""
        return QSize(640, 480)

    def see_all(self) -> None:
        """Look at all of the sketch from the south."""
        size, ground = self._document.sketch.size, self._scene.ground()
        height = 0.0 if ground is None else float(ground.height(0.5 * size[0], 0.5 * size[1]))
        aspect = max(self.width(), 1) / max(self.height(), 1)
        self._link.tell(Look(overview(size, height, aspect=aspect)))

    def see_best(self) -> None:
        """Stand where the terrain looks best."""
        self._link.tell(Look(None))

    def see_chosen(self) -> None:
        """Look at what is selected, or at the whole sketch."""
        size = self._document.sketch.size
        motion = going_to(self._link.placed, self._workspace.chosen, size=size)
        if motion is None:
            self.see_all()
        else:
            self._link.tell(motion)

    def delete_chosen(self) -> None:
        """Delete what is selected; a control point of a river goes back to where it was generated."""
        placed, chosen = self._link.placed, self._workspace.chosen
        if placed is not None and chosen is not None:
            self.message.emit(delete_or_reset(self._document, self._workspace, placed, chosen))

    def _use_mode(self, mode: str) -> None:
        self._link.show(replace(self._link.view, mode=mode))

    def _face_north(self) -> None:
        heading = (self._compass.heading + 180.0) % 360.0 - 180.0
        self._link.tell(Turn(heading if self._link.view.mode == "orbit" else -heading, 0.0))

    def _start_again(self) -> None:
        self._trouble = None
        self._link.start()
        self._show_card()
        self.update()

    def _open_menu(self) -> None:
        self._mouse.open_menu(QPointF(self.rect().center()), None)

    def _take_frame(self, frame: FrameFacts) -> None:
        self._trouble = None
        self._compass.heading = heading_of(frame.pose.eye, frame.pose.target)
        if frame.settled:
            self._unsettled = None
        elif self._unsettled is None:
            self._unsettled = time.monotonic()
        self._show_card()
        self.update()

    def _take_trouble(self, trouble: Trouble) -> None:
        if trouble.what in ("engine", "view"):
            self._trouble = trouble
            self._show_card()
            self.update()
        if trouble.what == "engine":
            self._mouse.forget()

    def _take_view(self, view: ViewState) -> None:
        self._bar.show_mode(view.mode)

    def _show_card(self, *_: object) -> None:
        self._card.tell(notice_of(self._link, self._trouble))
        for each in (self._bar, self._compass):
            each.setVisible(self._card.notice is None)

    def _refresh(self, *_: object) -> None:
        self.update()

    def _ask_for_size(self) -> None:
        if self.isVisible():
            ratio = self.devicePixelRatioF()
            self._ratio = ratio
            size = [max(round(side * ratio), 16) for side in (self.width(), self.height())]
            self._link.show(replace(self._link.view, width=size[0], height=size[1]))

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Put what lies over the picture in its places; ask for another picture a little later."""
        self._bar.move(_EDGE, _EDGE)
        self._compass.move(self.width() - self._compass.width() - _EDGE, _EDGE)
        self._card.place()
        self._sizes.start(_SETTLE)

    def showEvent(self, event: QShowEvent | None) -> None:
        """Ask for pictures."""
        self._sizes.start(0)

    def hideEvent(self, event: QHideEvent | None) -> None:
        """Ask for none any more."""
        self._sizes.stop()
        self._mouse.cancel()
        self._mouse.leave()
        self._keyboard.let_go()
        self._link.show(replace(self._link.view, width=0, height=0))

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the last picture and what lies over it."""
        if self.devicePixelRatioF() != self._ratio:  # it is on another screen now
            self._ratio = self.devicePixelRatioF()
            self._sizes.start(_SETTLE)
        late = self._unsettled is not None and time.monotonic() - self._unsettled > _REFINES
        painter = QPainter(self)
        self._scene.paint(
            painter,
            QRectF(self.rect()),
            self.devicePixelRatioF(),
            hovered=self._mouse.hovered,
            dim=self._card.notice is not None,
            refines=late and not self._mouse.is_pressed,
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
