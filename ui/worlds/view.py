"""The picture of a world, and mouse and keys that move in it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from PyQt6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, pyqtSignal
from PyQt6.QtGui import QColor, QKeyEvent, QPainter
from PyQt6.QtWidgets import QSizePolicy, QWidget

from sketchterrain.ui.engine.protocol import MODES, GoTo, Look, Pose
from sketchterrain.ui.look.theme import theme
from sketchterrain.ui.view3d.hud import Hud
from sketchterrain.ui.view3d.navigation import FLYING_KEYS, Keys, dragged, overview, zoomed
from sketchterrain.ui.view3d.view import PictureSize

if TYPE_CHECKING:
    from PyQt6.QtGui import (
        QFocusEvent,
        QHideEvent,
        QMouseEvent,
        QPaintEvent,
        QResizeEvent,
        QShowEvent,
        QWheelEvent,
    )

    from sketchterrain.ui.engine.protocol import Picked, Trouble
    from sketchterrain.ui.worlds.link import WorldLink

__all__ = ["WorldView"]

_CLICK: Final = 4.0  # px that the mouse may move in a click
_VEIL: Final = 190
_Key = Qt.Key
_MODE_KEYS: Final = dict(zip((_Key.Key_1, _Key.Key_2, _Key.Key_3), MODES, strict=True))
_OTHERS: Final = (
    Qt.KeyboardModifier.ControlModifier | Qt.KeyboardModifier.AltModifier | Qt.KeyboardModifier.MetaModifier
)


class WorldView(QWidget):
    """Shows a world.

    Parameters
    ----------
    link
        Whose pictures these are.
    parent

    Attributes
    ----------
    bar : Bar
        Buttons in its upper left corner.
    """

    picture_wanted = pyqtSignal()
    """Its button for saving a picture was pressed."""

    def __init__(self, link: WorldLink, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._link = link
        self._keys = Keys()
        self._last: QPointF | None = None
        self._asked: int | None = None
        self._size, self._over = PictureSize(self, link), Hud(self, link)
        self.bar, self._card = self._over.bar, self._over.card
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(160, 120)
        self.setAccessibleName("The world")
        self.setAccessibleDescription("Arrow keys move, 1 to 3 choose how, R shows all of it.")
        link.trouble.connect(self._ask_no_more)
        link.working_changed.connect(self._refresh)
        link.picked.connect(self._go_to)
        self.bar.see_all.connect(self.see_all)
        self.bar.see_best.connect(self.see_best)
        self.bar.picture_wanted.connect(self.picture_wanted)

    def sizeHint(self) -> QSize:
        """Return a size to begin with."""
        return QSize(1180, 720)

    def see_all(self) -> None:
        """Look at all of the world from the south."""
        world = self._link.world
        if world is None:
            return
        aspect = max(self.width(), 1) / max(self.height(), 1)
        pose = overview(world.size, world.middle, aspect=aspect)
        south = -world.size[1]
        (x, y, z), (to_x, to_y, to_z) = pose.eye, pose.target
        self._link.tell(Look(Pose((x, y + south, z), (to_x, to_y + south, to_z), pose.fov)))

    def see_best(self) -> None:
        """Stand where the world looks best."""
        self._link.tell(Look(None))

    def _ask_no_more(self, trouble: Trouble) -> None:
        if trouble.what in ("engine", "view"):
            self._asked = None

    def _refresh(self, *_: object) -> None:
        self.update()

    def _share(self, at: QPointF) -> tuple[float, float]:
        return at.x() / max(self.width(), 1), at.y() / max(self.height(), 1)

    def _go_to(self, picked: Picked) -> None:
        if picked.token == self._asked and picked.place is not None:
            self._link.tell(GoTo(picked.place[0], picked.place[1]))

    def _tell(self, motion: object | None) -> None:
        if motion is not None:
            self._link.tell(motion)

    def resizeEvent(self, event: QResizeEvent | None) -> None:
        """Put what lies over the picture in its places; ask for another picture a little later."""
        self._over.place()
        self._size.change()

    def showEvent(self, event: QShowEvent | None) -> None:
        """Ask for pictures."""
        self._size.begin()

    def hideEvent(self, event: QHideEvent | None) -> None:
        """Ask for none any more."""
        self._tell(self._keys.let_go())
        self._size.end()

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the last picture."""
        painter, size = QPainter(self), QRectF(self.rect())
        colours, picture = theme(), self._link.picture
        if picture is None or picture.isNull():
            painter.fillRect(size, colours.canvas)
            return
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(size, picture)
        if self._card.notice is not None:
            veil = QColor(colours.canvas)
            veil.setAlpha(_VEIL)
            painter.fillRect(size, veil)

    @property
    def refines(self) -> bool:
        """Whether a better picture has been on its way for a while."""
        return self._over.refines

    def mousePressEvent(self, event: QMouseEvent | None) -> None:
        """Take hold of the picture."""
        if event is not None:
            self._last = event.position()

    def mouseMoveEvent(self, event: QMouseEvent | None) -> None:
        """Turn, look around or move over the ground."""
        if event is None or self._last is None:
            return
        way = event.position() - self._last
        if self.cursor().shape() != Qt.CursorShape.ClosedHandCursor:
            if max(abs(way.x()), abs(way.y())) < _CLICK:
                return
            self.setCursor(Qt.CursorShape.ClosedHandCursor)
        self._last = event.position()
        shift = bool(event.modifiers() & Qt.KeyboardModifier.ShiftModifier)
        turns = event.buttons() == Qt.MouseButton.LeftButton and not shift
        height = max(self.height(), 1)
        self._link.tell(dragged(self._link.view.mode, way.x(), way.y(), height=height, pans=not turns))

    def mouseReleaseEvent(self, event: QMouseEvent | None) -> None:
        """Let go."""
        if event is not None and event.buttons() == Qt.MouseButton.NoButton:
            self._last = None
            self.unsetCursor()

    def mouseDoubleClickEvent(self, event: QMouseEvent | None) -> None:
        """Bring the ground under the mouse into the middle."""
        if event is not None and event.button() == Qt.MouseButton.LeftButton:
            self._asked = self._link.pick(*self._share(event.position()))

    def wheelEvent(self, event: QWheelEvent | None) -> None:
        """Zoom about the mouse."""
        if event is not None and event.angleDelta().y():
            self._link.tell(zoomed(event.angleDelta().y() / 120.0, *self._share(event.position())))

    def event(self, event: QEvent | None) -> bool:
        """Keep the keys that move the eye from being shortcuts of the window."""
        override = QEvent.Type.ShortcutOverride
        if isinstance(event, QKeyEvent) and event.type() == override and self._is_own(event):
            event.accept()
            return True
        return super().event(event)

    def keyPressEvent(self, event: QKeyEvent | None) -> None:
        """Move, or choose how."""
        if event is None:
            return
        key = event.key()
        if key == _Key.Key_Shift:
            self._tell(self._keys.hurry(quick=True))
        if not self._is_own(event):
            super().keyPressEvent(event)
        elif event.isAutoRepeat():
            return
        elif key in _MODE_KEYS:
            self._over.use_mode(_MODE_KEYS[_Key(key)])
        elif key in (_Key.Key_R, _Key.Key_Home):
            self.see_all()
        elif key == _Key.Key_C:
            self.see_best()
        else:
            self._tell(self._keys.press(key))

    def keyReleaseEvent(self, event: QKeyEvent | None) -> None:
        """Let a key go."""
        if event is None or event.isAutoRepeat():
            return
        if event.key() == _Key.Key_Shift:
            self._tell(self._keys.hurry(quick=False))
        self._tell(self._keys.release(event.key()))

    def focusOutEvent(self, event: QFocusEvent | None) -> None:
        """Let all keys go."""
        self._tell(self._keys.let_go())

    @staticmethod
    def _is_own(event: QKeyEvent) -> bool:
        if event.modifiers() & _OTHERS:
            return False
        key = event.key()
        return key in FLYING_KEYS or key in _MODE_KEYS or key in (_Key.Key_R, _Key.Key_Home, _Key.Key_C)
