"""Controls over the 3-D view: mode bar, compass, and a placeholder for a missing picture."""

import time
from dataclasses import dataclass
from typing import Final

from PyQt6.QtCore import QObject, QRectF, Qt, QTimer, pyqtSignal
from PyQt6.QtGui import QColor, QFont, QPainter, QPaintEvent, QPen
from PyQt6.QtWidgets import (
    QAbstractButton,
    QButtonGroup,
    QFrame,
    QLabel,
    QPushButton,
    QSizePolicy,
    QToolButton,
    QWidget,
)

from sketchterrain.ui.engine.link import ViewSource
from sketchterrain.ui.engine.protocol import MODES, ErrorReport, FrameFacts, Turn, ViewState
from sketchterrain.ui.look.theme import (
    MARGIN,
    active_theme,
    column,
    draw_icon,
    heading,
    icon,
    row,
    theme,
    tool_button,
)

_HELP: Final = {
    "orbit": "Orbit: drag turns, right drag or Shift moves, wheel zooms (1)",
    "fly": "Fly: W A S D, Q and E, drag looks around, Shift is faster (2)",
    "walk": "Walk on the ground: W A S D, drag looks around, Shift is faster (3)",
}
_PLATE = QColor(18, 21, 24, 165)
_SYMBOL = QColor(240, 243, 245)
_SIDE = 28


class ModeBar(QFrame):
    """A row of buttons on a dark plate, as pictures of terrain are dark in either theme."""

    mode_selected = pyqtSignal(str)
    see_all = pyqtSignal()
    see_best = pyqtSignal()
    picture_requested = pyqtSignal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("plate")
        self._row = row(self, margins=3, spacing=1)
        self._modes = QButtonGroup(self)
        for number, mode in enumerate(MODES):
            button = self._button(mode, _HELP[mode], mode.capitalize())
            button.setCheckable(True)
            self._modes.addButton(button, number)
        self._modes.idClicked.connect(lambda number: self.mode_selected.emit(MODES[number]))
        self._row.addSpacing(7)
        for name, tip, what, signal in (
            ("fit", "See the whole sketch (R)", "See the whole sketch", self.see_all),
            ("camera", "Go to the best viewpoint (C)", "Best view", self.see_best),
            ("screenshot", "Save a picture…", "Save a picture", self.picture_requested),
        ):
            self._button(name, tip, what).clicked.connect(signal)

    def show_mode(self, mode: str) -> None:
        button = self._modes.button(MODES.index(mode))
        if button is not None:
            button.setChecked(True)

    def _button(self, name: str, tip: str, what: str) -> QToolButton:
        button = tool_button(name, what, tip=tip)
        button.setIcon(icon(name, _SYMBOL))
        button.setFixedSize(_SIDE, _SIDE)
        self._row.addWidget(button)
        return button


_WIDTH = 380  # px of a placeholder
_TIME_DELAY = 2  # s of waiting after which the time is shown


@dataclass(frozen=True)
class Notice:
    """Text of a placeholder."""

    icon: str  # Name of an icon; empty while waiting, when the time is shown
    title: str
    line: str = ""
    button: str = ""


def notice_of(link: ViewSource, error: ErrorReport | None) -> Notice | None:
    """Return why there is no current picture; None if there is one."""
    if error is not None and error.source == "engine":
        return Notice("error", "The 3-D view stopped", error.line, "Start again")
    if link.facts.opengl_error:
        line = f"{link.facts.opengl_error}\n{link.without_view}".strip()
        return Notice("warning", "No 3-D view", line, "Try again")
    if link.picture is not None:
        return None
    if link.facts.device_error:
        return Notice("warning", "No device for the terrain", link.facts.device_error, "Try again")
    if error is not None:
        return Notice("error", "The 3-D view cannot be drawn", error.line, "Start again")
    return Notice("", "Preparing the terrain", link.activity or "Starting")


class Placeholder(QFrame):
    """Shows a `Notice`, or hides."""

    pressed = pyqtSignal()

    def __init__(self, parent: QWidget) -> None:
        super().__init__(parent)
        self.setObjectName("card")
        self.setMaximumWidth(_WIDTH)
        self.notice: Notice | None = None  # what is shown
        self._seconds = 0
        self._symbol, self._title, self._line = (
            QLabel(),
            heading(weight=QFont.Weight.Bold, scale=1.15),
            QLabel(),
        )
        self._line.setTextFormat(Qt.TextFormat.PlainText)
        self._line.setWordWrap(True)
        self._line.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self._line.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.MinimumExpanding)
        self._button = QPushButton()
        self._button.clicked.connect(self.pressed)
        for label in (self._title, self._line):
            label.setAlignment(Qt.AlignmentFlag.AlignHCenter)
        rows = column(self, self._symbol, self._title, self._line, self._button, margins=2 * MARGIN)
        for widget in (self._symbol, self._button):
            rows.setAlignment(widget, Qt.AlignmentFlag.AlignHCenter)
        self._clock = QTimer(self)
        self._clock.setInterval(1000)
        self._clock.timeout.connect(self._tick)
        active_theme.changed.connect(self._show_symbol)
        self.hide()

    def show_notice(self, notice: Notice | None) -> None:
        if notice == self.notice:
            return
        before, self.notice = self.notice, notice
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
        self._show_symbol()
        self._title.setText(notice.title)
        self._button.setText(notice.button)
        self._button.setVisible(bool(notice.button))
        self.setAccessibleName(notice.title)
        self._show_line()
        self.show()

    def _tick(self) -> None:
        self._seconds += 1
        self._show_line()

    def _show_symbol(self) -> None:
        name, colours = "" if self.notice is None else self.notice.icon, theme()
        colour = {"error": colours.error, "warning": colours.warning}.get(name, colours.text)
        self._symbol.setVisible(bool(name))
        if name:
            self._symbol.setPixmap(icon(name, colour).pixmap(32, 32))

    def _show_line(self) -> None:
        if self.notice is None:
            return
        line = self.notice.line
        if not self.notice.icon:
            line = line.rstrip(" .…") + " …"
            line += f" {self._seconds} s" if self._seconds >= _TIME_DELAY else ""
        self._line.setText(line)
        self._line.setVisible(bool(line))


_COMPASS_SIDE = 40
_POINTS = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")


class Compass(QAbstractButton):
    """Compass; a click faces north."""

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
        """Bearing of the view, degrees."""
        return self._heading

    @heading.setter
    def heading(self, heading: float) -> None:
        if round(heading, 1) != round(self._heading, 1):
            self._heading = heading
            self._describe()
            self.update()

    def paintEvent(self, event: QPaintEvent | None) -> None:
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        rim = QPen(QColor(255, 255, 255, 210 if self.underMouse() or self.hasFocus() else 60), 1.2)
        painter.setPen(rim)
        painter.setBrush(_PLATE)
        painter.drawEllipse(QRectF(self.rect()).adjusted(1.0, 1.0, -1.0, -1.0))
        painter.translate(0.5 * _COMPASS_SIDE, 0.5 * _COMPASS_SIDE)
        painter.rotate(-self._heading)
        side = QRectF(-0.5 * _COMPASS_SIDE, -0.5 * _COMPASS_SIDE, _COMPASS_SIDE, _COMPASS_SIDE)
        draw_icon(painter, "compass", side, _SYMBOL)

    def _describe(self) -> None:
        point = _POINTS[round(self._heading / 45.0) % 8]
        self.setToolTip(f"Looking {point} ({self._heading:.0f}°); press to look north")
        self.setAccessibleDescription(f"Looking {point}")


_REFINING_DELAY: Final = 0.6  # s without a finished picture until "refining" is shown
_EDGE: Final = 10  # px around the controls


class Hud(QObject):
    """Places the controls over a view, which is repainted when a picture arrives."""

    def __init__(self, view: QWidget, link: ViewSource) -> None:
        super().__init__(view)
        self._view, self._link = view, link
        self._error: ErrorReport | None = None
        self._unsettled: float | None = None  # since when pictures are unfinished
        self.bar, self.compass, self.placeholder = ModeBar(view), Compass(view), Placeholder(view)
        controls = row(None, self.bar, 1, self.compass)
        controls.setAlignment(self.bar, Qt.AlignmentFlag.AlignTop)
        column(view, controls, 1, row(None, 1, (self.placeholder, _WIDTH), 1), 1, margins=_EDGE, spacing=0)
        link.frame_shown.connect(self._show_frame)
        link.facts_changed.connect(self._refresh)
        link.error_reported.connect(self._show_error)
        link.activity_changed.connect(self._refresh)
        link.view_changed.connect(self._show_view)
        self.bar.mode_selected.connect(lambda mode: link.change_view(mode=mode))
        self.compass.clicked.connect(self._face_north)
        self.placeholder.pressed.connect(self._restart)
        self._show_view(link.view)
        self._refresh()

    @property
    def is_refining(self) -> bool:
        """Whether a better picture has been pending for a while."""
        return self._unsettled is not None and time.monotonic() - self._unsettled > _REFINING_DELAY

    def _refresh(self, *_: object) -> None:
        self.placeholder.show_notice(notice_of(self._link, self._error))
        for each in (self.bar, self.compass):
            each.setVisible(self.placeholder.notice is None)

    def _face_north(self) -> None:
        heading = (self.compass.heading + 180.0) % 360.0 - 180.0
        self._link.send(Turn(heading if self._link.view.mode == "orbit" else -heading, 0.0))

    def _restart(self) -> None:
        self._error = None
        self._link.start()
        self._refresh()
        self._view.update()

    def _show_frame(self, frame: FrameFacts) -> None:
        self._error = None
        self.compass.heading = frame.pose.heading
        if frame.converged:
            self._unsettled = None
        elif self._unsettled is None:
            self._unsettled = time.monotonic()
        self._refresh()
        self._view.update()

    def _show_error(self, error: ErrorReport) -> None:
        if error.source in ("engine", "view"):
            self._error = error
            self._refresh()
            self._view.update()

    def _show_view(self, view: ViewState) -> None:
        self.bar.show_mode(view.mode)
