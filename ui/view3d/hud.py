"""Controls over the 3-D view: mode bar, compass, and a card in place of a missing picture."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Final

from PyQt6.QtCore import QObject, QPointF, QRectF, QSize, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QColor, QPainter, QPaintEvent, QPen, QPolygonF
from PyQt6.QtWidgets import (
    QAbstractButton,
    QButtonGroup,
    QFrame,
    QHBoxLayout,
    QLabel,
    QPushButton,
    QSizePolicy,
    QToolButton,
    QVBoxLayout,
    QWidget,
)

from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.engine.protocol import MODES, ErrorReport, FrameFacts, Turn, ViewState
from sketchterrain.ui.look.theme import MARGIN, SPACING, draw_icon, looks, theme

_HELP: Final = {
    "orbit": "Turn around the terrain: drag turns, right drag or Shift moves, wheel zooms (1)",
    "fly": "Fly: W A S D, Q and E, drag looks around, Shift is faster (2)",
    "walk": "Walk on the ground: W A S D, drag looks around, Shift is faster (3)",
}
_PLATE = QColor(18, 21, 24, 165)
_SIGN = QColor(240, 243, 245)
_SIDE, _ICON = 28, 18


class _Button(QToolButton):
    """A light sign on the dark plate, in either theme."""

    def __init__(self, parent: QWidget, name: str) -> None:
        super().__init__(parent)
        self._name = name
        self.setFixedSize(_SIDE, _SIDE)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw it as it is: pressed, checked, under the mouse or with the focus."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        place = QRectF(self.rect())
        shine = 95 if self.isDown() else 70 if self.isChecked() else 38 if self.underMouse() else 0
        painter.setBrush(QColor(255, 255, 255, shine))
        painter.setPen(QColor(255, 255, 255, 170) if self.hasFocus() else Qt.PenStyle.NoPen)
        painter.drawRoundedRect(place.adjusted(0.5, 0.5, -0.5, -0.5), 5.0, 5.0)
        sign = QRectF(0.0, 0.0, _ICON, _ICON)
        sign.moveCenter(place.center())
        draw_icon(painter, self._name, sign, _SIGN)


class Bar(QFrame):
    """A row of buttons on a dark plate: pictures of ground are dark, whatever the theme."""

    mode_chosen = pyqtSignal(str)
    see_all = pyqtSignal()
    see_best = pyqtSignal()
    picture_requested = pyqtSignal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        row = QHBoxLayout(self)
        row.setContentsMargins(3, 3, 3, 3)
        row.setSpacing(1)
        self._modes = QButtonGroup(self)
        for number, mode in enumerate(MODES):
            button = self._button(mode, _HELP[mode], mode.capitalize())
            button.setCheckable(True)
            self._modes.addButton(button, number)
            row.addWidget(button)
        self._modes.idClicked.connect(self._choose)
        row.addSpacing(7)
        for name, tip, what, signal in (
            ("fit", "See the whole sketch (R)", "See the whole sketch", self.see_all),
            ("camera", "Stand where the terrain looks best (C)", "Best view", self.see_best),
            ("screenshot", "Save a picture…", "Save a picture", self.picture_requested),
        ):
            button = self._button(name, tip, what)
            button.clicked.connect(signal)
            row.addWidget(button)
        self.adjustSize()

    def show_mode(self, mode: str) -> None:
        """Mark how the eye moves."""
        button = self._modes.button(MODES.index(mode))
        if button is not None:
            button.setChecked(True)

    def _choose(self, number: int) -> None:
        self.mode_chosen.emit(MODES[number])

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the plate."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(_PLATE)
        painter.drawRoundedRect(QRectF(self.rect()), 7.0, 7.0)

    def _button(self, name: str, tip: str, what: str) -> _Button:
        button = _Button(self, name)
        button.setToolTip(tip)
        button.setAccessibleName(what)
        return button


_PATIENCE = 2  # s, after which it says how long it has been


@dataclass(frozen=True)
class Notice:
    """What a card says."""

    icon: str  # Of `ui.look.icons`; empty: one waits, and is told for how long
    title: str
    line: str = ""
    button: str = ""  # Empty where there is nothing to press


def notice_of(link: ViewSource, trouble: ErrorReport | None) -> Notice | None:
    """Return why there is no picture, or none that is worth looking at; None if all is well."""
    if trouble is not None and trouble.source == "engine":
        return Notice("error", "The 3-D view stopped", trouble.line, "Start again")
    if link.facts.opengl_error:
        line = f"{link.facts.opengl_error}\n{link.without_view}".strip()
        return Notice("warning", "There is no 3-D view", line, "Try again")
    if link.picture is not None:
        return None
    if link.facts.device_error:
        return Notice("warning", "There is no device for the terrain", link.facts.device_error, "Try again")
    if trouble is not None:
        return Notice("error", "The 3-D view cannot be drawn", trouble.line, "Start again")
    return Notice("", "Preparing the terrain", link.activity or "Starting")


class Card(QFrame):
    """Shows a `Notice`, or hides."""

    pressed = pyqtSignal()
    """Its button was pressed."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._notice: Notice | None = None
        self._seconds = 0
        self._mark = _Mark(self)
        self._title = QLabel(self)
        self._line = QLabel(self)
        self._line.setTextFormat(Qt.TextFormat.PlainText)
        self._line.setWordWrap(True)
        self._line.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._line.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.MinimumExpanding)
        self._button = QPushButton(self)
        self._button.setAutoDefault(False)
        self._button.clicked.connect(self.pressed)
        for label in (self._title, self._line):
            label.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        rows = QVBoxLayout(self)
        rows.setContentsMargins(2 * MARGIN, 2 * MARGIN, 2 * MARGIN, 2 * MARGIN)
        rows.setSpacing(SPACING)
        rows.addWidget(self._mark, 0, Qt.AlignmentFlag.AlignHCenter)
        rows.addWidget(self._title)
        rows.addWidget(self._line)
        rows.addWidget(self._button, 0, Qt.AlignmentFlag.AlignHCenter)
        font = self._title.font()
        font.setPointSizeF(font.pointSizeF() * 1.15)
        font.setBold(True)
        self._title.setFont(font)
        self._clock = QTimer(self)
        self._clock.setInterval(1000)
        self._clock.timeout.connect(self._tick)
        looks.changed.connect(self.update)
        self.hide()

    @property
    def notice(self) -> Notice | None:
        """What it says."""
        return self._notice

    def tell(self, notice: Notice | None) -> None:
        """Say something else, or hide."""
        if notice == self._notice:
            return
        before, self._notice = self._notice, notice
        if notice is None:
            self._clock.stop()
            self.hide()
            return
        waits = not notice.icon
        if waits and (before is None or before.icon):
            self._seconds = 0
            self._clock.start()
        elif not waits:
            self._clock.stop()
        self._mark.name = notice.icon
        self._mark.setVisible(bool(notice.icon))
        self._title.setText(notice.title)
        self._button.setText(notice.button)
        self._button.setVisible(bool(notice.button))
        self.setAccessibleName(notice.title)
        self._write()
        self.show()
        self.place()

    def place(self) -> None:
        """Come to the middle of the parent."""
        parent = self.parentWidget()
        if parent is None or self.isHidden():
            return
        width = min(380, parent.width() - 2 * MARGIN)
        self.setFixedWidth(max(width, 120))
        self.adjustSize()
        layout = self.layout()
        height = layout.totalHeightForWidth(self.width()) if layout is not None else self.height()
        self.resize(self.width(), min(max(height, 60), max(parent.height() - 2 * MARGIN, 60)))
        self.move((parent.width() - self.width()) // 2, (parent.height() - self.height()) // 2)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw a plate with a thin border."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        colours = theme()
        painter.setPen(colours.line)
        painter.setBrush(colours.window)
        painter.drawRoundedRect(QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5), 8.0, 8.0)

    def _tick(self) -> None:
        self._seconds += 1
        self._write()

    def _write(self) -> None:
        if self._notice is None:
            return
        line = self._notice.line
        if not self._notice.icon:
            line = line.rstrip(" .…") + " …"
            line += f" {self._seconds} s" if self._seconds >= _PATIENCE else ""
        self._line.setText(line)
        self._line.setVisible(bool(line))


class _Mark(QWidget):
    """What kind of notice it is, by shape and colour."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.name = ""
        self.setFixedSize(32, 32)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw the icon in the colour of what it means."""
        if self.name:
            colours = theme()
            colour = {"error": colours.error, "warning": colours.warning}.get(self.name, colours.text)
            draw_icon(QPainter(self), self.name, QRectF(self.rect()), colour)


_NORTH = QColor("#ff7a66")
_SOUTH = QColor(235, 238, 240, 210)
_COMPASS_PLATE = QColor(18, 21, 24, 165)
_COMPASS_SIDE = 40
_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


def heading_of(eye: tuple[float, float, float], target: tuple[float, float, float]) -> float:
    """Return the compass bearing (degrees, 0 … 360) of a look from one place (m) to another."""
    return math.degrees(math.atan2(target[0] - eye[0], target[1] - eye[1])) % 360.0


class Compass(QAbstractButton):
    """Shows a heading in degrees."""

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self._heading = 0.0
        self.setFixedSize(_COMPASS_SIDE, _COMPASS_SIDE)
        self.setCursor(Qt.CursorShape.PointingHandCursor)
        self.setFocusPolicy(Qt.FocusPolicy.TabFocus)
        self.setAccessibleName("Compass")
        self._describe()

    @property
    def heading(self) -> float:
        """Compass bearing of the view, degrees."""
        return self._heading

    @heading.setter
    def heading(self, heading: float) -> None:
        if round(heading, 1) != round(self._heading, 1):
            self._heading = heading
            self._describe()
            self.update()

    def sizeHint(self) -> QSize:
        """Return its one size."""
        return QSize(_COMPASS_SIDE, _COMPASS_SIDE)

    def paintEvent(self, event: QPaintEvent | None) -> None:
        """Draw a needle on a round plate."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        rim = QPen(QColor(255, 255, 255, 210 if self.underMouse() or self.hasFocus() else 60), 1.2)
        painter.setPen(rim)
        painter.setBrush(_COMPASS_PLATE)
        painter.drawEllipse(QRectF(self.rect()).adjusted(1.0, 1.0, -1.0, -1.0))
        painter.translate(0.5 * _COMPASS_SIDE, 0.5 * _COMPASS_SIDE)
        painter.rotate(-self._heading)
        painter.setPen(Qt.PenStyle.NoPen)
        for colour, sign in ((_NORTH, -1.0), (_SOUTH, 1.0)):
            painter.setBrush(colour)
            corners = [QPointF(-3.4, 1.0), QPointF(0.0, 1.0 + 10.0 * sign), QPointF(3.4, 1.0)]
            painter.drawPolygon(QPolygonF(corners))
        font = painter.font()
        font.setPixelSize(8)
        font.setBold(True)
        painter.setFont(font)
        painter.setPen(_SOUTH)
        painter.translate(0.0, -13.0)
        painter.rotate(self._heading)
        painter.drawText(QRectF(-7.0, -6.0, 14.0, 12.0), Qt.AlignmentFlag.AlignCenter, "N")

    def _describe(self) -> None:
        point = _POINTS[round(self._heading / 45.0) % 8]
        self.setToolTip(f"Looking {point} ({self._heading:.0f}°); press to look north")
        self.setAccessibleDescription(f"Looking {point}")


_REFINES: Final = 0.6  # s without a finished picture until that is said
_EDGE: Final = 10  # px, around what lies over the picture


class Hud(QObject):
    """Lies over a view, which is repainted as pictures come."""

    def __init__(self, view: QWidget, link: ViewSource) -> None:
        super().__init__(view)
        self._view, self._link = view, link
        self._trouble: ErrorReport | None = None
        self._unsettled: float | None = None
        self.bar, self.compass, self.card = Bar(view), Compass(view), Card(view)
        link.frame_shown.connect(self._take_frame)
        link.error_reported.connect(self._take_trouble)
        link.activity_changed.connect(self.show_card)
        link.view_changed.connect(self._take_view)
        self.bar.mode_chosen.connect(self.use_mode)
        self.compass.clicked.connect(self._face_north)
        self.card.pressed.connect(self._start_again)
        self._take_view(link.view)
        self.show_card()

    @property
    def refines(self) -> bool:
        """Whether a better picture has been on its way for a while."""
        return self._unsettled is not None and time.monotonic() - self._unsettled > _REFINES

    def place(self) -> None:
        """Put all in its places, in a view of another size."""
        self.bar.move(_EDGE, _EDGE)
        self.compass.move(self._view.width() - self.compass.width() - _EDGE, _EDGE)
        self.card.place()

    def show_card(self, *_: object) -> None:
        """Show why there is no picture, or what one moves with."""
        self.card.tell(notice_of(self._link, self._trouble))
        for each in (self.bar, self.compass):
            each.setVisible(self.card.notice is None)

    def use_mode(self, mode: str) -> None:
        """Move in one of `MODES`."""
        self._link.set_view(replace(self._link.view, mode=mode))

    def _face_north(self) -> None:
        heading = (self.compass.heading + 180.0) % 360.0 - 180.0
        self._link.send(Turn(heading if self._link.view.mode == "orbit" else -heading, 0.0))

    def _start_again(self) -> None:
        self._trouble = None
        self._link.start()
        self.show_card()
        self._view.update()

    def _take_frame(self, frame: FrameFacts) -> None:
        self._trouble = None
        self.compass.heading = heading_of(frame.pose.eye, frame.pose.target)
        if frame.settled:
            self._unsettled = None
        elif self._unsettled is None:
            self._unsettled = time.monotonic()
        self.show_card()
        self._view.update()

    def _take_trouble(self, trouble: ErrorReport) -> None:
        if trouble.source in ("engine", "view"):
            self._trouble = trouble
            self.show_card()
            self._view.update()

    def _take_view(self, view: ViewState) -> None:
        self.bar.show_mode(view.mode)
